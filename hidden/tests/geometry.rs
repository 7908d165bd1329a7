//! Facts about geometric defects, where arithmetic says what must come out: on a plain, and in front of a wall.

use hidden::{Defect, Geometry, Noise, Range, Recipe, frame};
use lidar::{RangeImage, Sensor};
use scene::{Material, Mesh, Pose, Scene};

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// The distance of [`wall`].
const WALL_M: f64 = 20.0;

const HEIGHT_M: f64 = 1.73;

/// A flat square of this half size around `centre`, spanned by two unit vectors.
fn square(centre: [f32; 3], u: [f32; 3], v: [f32; 3], half_m: f32) -> Result<Scene, Box<dyn std::error::Error>> {
    let at = |a: f32, b: f32| std::array::from_fn(|k| centre[k] + half_m * (a * u[k] + b * v[k]));
    let mut mesh = Mesh::new();
    let material = mesh.add_material(Material::diffuse(50, 0.4));
    let corners = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
    mesh.add_triangles(&corners, &[[0, 1, 2], [0, 2, 3]], material)?;
    Ok(Scene::new(mesh))
}

fn plain() -> Result<Scene, Box<dyn std::error::Error>> {
    square([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 500.0)
}

/// A wall ahead, across the way.
fn wall() -> Result<Scene, Box<dyn std::error::Error>> {
    square([WALL_M as f32, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], 200.0)
}

/// Rings 2° up to 20° down; column 180 of 360 looks half a degree to the right of straight ahead.
fn sensor() -> Result<Sensor, lidar::sensor::SensorError> {
    Sensor::from_elevations_deg("test", [2.0, 0.0, -5.0, -10.0, -20.0], 360, (1.0, 100.0), 10.0)
}

/// Simulated and measured without noise.
fn pair(scene: &Scene, defects: Vec<Defect>) -> Result<(RangeImage, RangeImage), Box<dyn std::error::Error>> {
    let silent = Noise { range_sigma_m: 0.0, reflectance_sigma: 0.0, drop: 0.0 };
    let recipe = Recipe { noise: silent, ..Recipe::new(1, sensor()?, defects) };
    Ok(frame(&recipe, scene, &Pose::default(), 0))
}

fn at(image: &RangeImage, ring: usize, column: usize) -> f64 {
    f64::from(image.range_m()[ring * image.columns() + column])
}

const AHEAD: usize = 180;
const LEFT: usize = 90;
const RIGHT: usize = 270;
/// The first column of the sweep looks behind.
const BEHIND: usize = 0;

#[test]
fn rays_that_point_higher_meet_the_ground_farther_away_by_r_cot_elevation_times_the_angle() -> Outcome {
    let offset_deg = 0.05;
    let (simulated, measured) = pair(&plain()?, vec![Geometry::ElevationOffset { offset_deg }.into()])?;
    for (ring, elevation_deg) in [(2, 5.0_f64), (3, 10.0), (4, 20.0)] {
        for column in [BEHIND, LEFT, AHEAD, RIGHT] {
            let range_m = at(&simulated, ring, column);
            let expected_m = range_m * offset_deg.to_radians() / elevation_deg.to_radians().tan();
            let found_m = at(&measured, ring, column) - range_m;
            // The second order is δ / tan φ of the first: 1 % at 5°.
            assert!((found_m / expected_m - 1.0).abs() < 0.015, "ring {ring}: {found_m} m, expected {expected_m} m");
        }
    }
    Ok(())
}

#[test]
fn rays_that_point_higher_leave_a_facing_wall_where_it_is() -> Outcome {
    let (simulated, measured) = pair(&wall()?, vec![Geometry::ElevationOffset { offset_deg: 0.05 }.into()])?;
    for ring in [0, 1] {
        let moved_m = (at(&measured, ring, AHEAD) - at(&simulated, ring, AHEAD)).abs();
        // d / cos φ: 20 m · tan 2° · 0.00087 = 0.6 mm.
        assert!(moved_m < 0.001, "ring {ring}: {moved_m} m");
    }
    Ok(())
}

#[test]
fn a_ring_with_an_offset_of_its_own_moves_alone() -> Outcome {
    let offset_deg = vec![0.0, 0.0, 0.0, 0.1, 0.0];
    let (simulated, measured) = pair(&plain()?, vec![Geometry::ElevationOffsetPerRing { offset_deg }.into()])?;
    assert_eq!(at(&measured, 2, AHEAD), at(&simulated, 2, AHEAD));
    assert_eq!(at(&measured, 4, AHEAD), at(&simulated, 4, AHEAD));
    let expected_m = HEIGHT_M / 9.9_f64.to_radians().sin();
    assert!((at(&measured, 3, AHEAD) - expected_m).abs() < 1e-4);
    Ok(())
}

#[test]
fn rays_turned_to_the_left_see_what_is_there() -> Outcome {
    // The wall at azimuth θ is d / cos θ away; column 150 looks 29.5° to the left.
    let expected_m = |azimuth_deg: f64| WALL_M / azimuth_deg.to_radians().cos();
    let eccentric = Geometry::EncoderEccentricity {
        amplitude_deg: 2.0,
        phase_deg: 30.0,
        second_amplitude_deg: 1.0,
        second_phase_deg: 0.0,
    };
    let turned: [(Defect, f64); 3] = [
        (Geometry::MountYaw { yaw_deg: 2.0 }.into(), 31.5),
        (Geometry::AzimuthOffsetPerRing { offset_deg: vec![0.0, 2.0] }.into(), 31.5),
        (eccentric.into(), 29.5 + 2.0 * 59.5_f64.to_radians().sin() + 59.0_f64.to_radians().sin()),
    ];
    for (defect, azimuth_deg) in turned {
        let title = defect.title();
        let (simulated, measured) = pair(&wall()?, vec![defect])?;
        assert!((at(&simulated, 1, 150) - expected_m(29.5)).abs() < 1e-4);
        let found_m = at(&measured, 1, 150);
        assert!((found_m - expected_m(azimuth_deg)).abs() < 1e-4, "{title}: {found_m} m");
    }
    Ok(())
}

#[test]
fn a_sensor_on_a_crooked_mount_looks_down_ahead_or_leans_right() -> Outcome {
    let (ring, turn_deg) = (3, 1.0);
    let expected_m = |elevation_deg: f64| HEIGHT_M / elevation_deg.to_radians().sin();
    // Columns look half a degree beside the axes: cos 0.5° of the turn is 4·10⁻⁵° less.
    let near = |found_m: f64, elevation_deg: f64| (found_m / expected_m(elevation_deg) - 1.0).abs() < 1e-3;

    let (_, pitched) = pair(&plain()?, vec![Geometry::MountPitch { pitch_deg: turn_deg }.into()])?;
    assert!(near(at(&pitched, ring, AHEAD), 11.0) && near(at(&pitched, ring, BEHIND), 9.0));
    let (_, rolled) = pair(&plain()?, vec![Geometry::MountRoll { roll_deg: turn_deg }.into()])?;
    assert!(near(at(&rolled, ring, RIGHT), 11.0) && near(at(&rolled, ring, LEFT), 9.0));
    let (_, raised) = pair(&plain()?, vec![Geometry::MountHeight { offset_m: 0.173 }.into()])?;
    assert!((at(&raised, ring, AHEAD) - 1.1 * expected_m(10.0)).abs() < 1e-4);
    Ok(())
}

#[test]
fn a_moving_sensor_comes_nearer_to_what_is_ahead_while_it_turns() -> Outcome {
    let driving = Geometry::RollingShutter { velocity_x_m_s: 10.0, velocity_y_m_s: 0.0, yaw_rate_deg_s: 0.0 };
    let (simulated, measured) = pair(&wall()?, vec![driving.into()])?;
    // Half of a sweep of 0.1 s, at 10 m/s; half a column more.
    let expected_m = 10.0 * 0.1 * 180.5 / 360.0;
    let nearer_m = at(&simulated, 1, AHEAD) - at(&measured, 1, AHEAD);
    assert!((nearer_m - expected_m).abs() < 1e-3, "{nearer_m} m");

    let turning = Geometry::RollingShutter { velocity_x_m_s: 0.0, velocity_y_m_s: 0.0, yaw_rate_deg_s: 36.0 };
    let (_, measured) = pair(&wall()?, vec![turning.into()])?;
    // Column 150 looks 29.5° to the left and is sent 150.5/360 of 0.1 s after the start: 1.505° more.
    let expected_m = WALL_M / 31.005_f64.to_radians().cos();
    assert!((at(&measured, 1, 150) - expected_m).abs() < 1e-4);
    Ok(())
}

#[test]
fn errors_of_range_come_on_top_of_what_the_true_ray_meets() -> Outcome {
    let defects = vec![
        Range::RangeScale { scale: 0.01 }.into(),
        Geometry::ElevationOffset { offset_deg: 1.0 }.into(),
        Range::RangeOffset { offset_m: 0.1 }.into(),
    ];
    let (_, measured) = pair(&plain()?, defects)?;
    let expected_m = 1.01 * HEIGHT_M / 9.0_f64.to_radians().sin() + 0.1;
    assert!((at(&measured, 3, AHEAD) - expected_m).abs() < 1e-4);
    Ok(())
}
