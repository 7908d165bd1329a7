//! Facts about casting rays: geometry, motion, and agreement with the library's own projection.

use std::f64::consts::{FRAC_PI_4, PI};

use lidar::sensor::BUILTIN;
use lidar::{Projector, Ring, Sensor};
use scene::street::{StreetConfig, street};
use scene::{Cast, Material, Mesh, Motion, Pose, Scene, cast};

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// A flat square of this half size around `centre`, spanned by two unit vectors.
fn square(centre: [f32; 3], u: [f32; 3], v: [f32; 3], half_m: f32) -> Result<Scene, Box<dyn std::error::Error>> {
    let at = |a: f32, b: f32| std::array::from_fn(|k| centre[k] + half_m * (a * u[k] + b * v[k]));
    let mut mesh = Mesh::new();
    let material = mesh.add_material(Material::diffuse(50, 0.4));
    let corners = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
    mesh.add_triangles(&corners, &[[0, 1, 2], [0, 2, 3]], material)?;
    Ok(Scene::new(mesh))
}

fn ground() -> Result<Scene, Box<dyn std::error::Error>> {
    square([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 500.0)
}

/// A wall 30 m ahead, across the way.
fn wall() -> Result<Scene, Box<dyn std::error::Error>> {
    square([30.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], 200.0)
}

#[test]
fn a_plane_below_is_met_at_its_height_over_the_sine_of_the_elevation() -> Outcome {
    let sensor = Sensor::builtin("hdl64e")?;
    let scan = cast(&ground()?, &sensor, &Pose::default(), &Motion::default());
    for (ring, beam) in sensor.rings().iter().enumerate() {
        let expected_m = 1.73 / (-beam.elevation_rad).sin();
        let seen = expected_m > 0.0 && expected_m < 120.0;
        for column in 0..sensor.columns() {
            let i = ring * sensor.columns() + column;
            let range_m = f64::from(scan.image.range_m()[i]);
            if seen {
                // Half a step of f32 at 120 m is 4 µm.
                assert!((range_m - expected_m).abs() < 1e-5 * expected_m.max(1.0), "{ring}: {range_m} {expected_m}");
                assert!((f64::from(scan.incidence_rad[i]) - (0.5 * PI + beam.elevation_rad)).abs() < 1e-5);
                assert!((scan.normal[i][2] - 1.0).abs() < 1e-6, "the normal points at the sensor");
            } else {
                assert_eq!(range_m, 0.0);
            }
        }
    }
    Ok(())
}

#[test]
fn a_leaning_sensor_sees_a_leaning_ground() -> Outcome {
    let sensor = Sensor::from_elevations_deg("one", [-20.0], 360, (0.5, 100.0), 10.0)?;
    // Pitch down by 10°: straight ahead the ring now looks 30° down, behind only 10°.
    let pose = Pose { pitch_rad: 10f32.to_radians(), ..Pose::default() };
    let scan = cast(&ground()?, &sensor, &pose, &Motion::default());
    let ahead_m = f64::from(scan.image.range_m()[180]);
    let behind_m = f64::from(scan.image.range_m()[0]);
    assert!((ahead_m - 1.73 / 0.5).abs() < 1e-3, "{ahead_m}");
    assert!((behind_m - 1.73 / 10f64.to_radians().sin()).abs() < 0.02, "{behind_m}");
    Ok(())
}

#[test]
fn driving_shears_a_wall_by_velocity_times_time() -> Outcome {
    let sensor = Sensor::builtin("hdl32e")?;
    let motion = Motion { velocity_m_s: [20.0, 3.0, 0.0], yaw_rate_rad_s: 0.0 };
    let cloud = cast(&wall()?, &sensor, &Pose::default(), &motion).cloud;
    let times = cloud.time_s.ok_or("times")?;
    assert!(cloud.x.len() > 5000 && times.iter().any(|t| *t > 0.03));
    for (x, t) in cloud.x.iter().zip(&times) {
        assert!((f64::from(*x) - (30.0 - 20.0 * t)).abs() < 1e-4, "{x} at {t}");
    }
    Ok(())
}

#[test]
fn turning_turns_a_wall_the_other_way() -> Outcome {
    let sensor = Sensor::builtin("vlp16")?;
    let rate = 0.8;
    let motion = Motion { velocity_m_s: [0.0; 3], yaw_rate_rad_s: rate };
    let cloud = cast(&wall()?, &sensor, &Pose::default(), &motion).cloud;
    let times = cloud.time_s.ok_or("times")?;
    for (i, time_s) in times.iter().enumerate() {
        let (sin, cos) = (f64::from(rate) * time_s).sin_cos();
        let x = cos * f64::from(cloud.x[i]) - sin * f64::from(cloud.y[i]);
        assert!((x - 30.0).abs() < 1e-4, "{x}");
    }
    Ok(())
}

#[test]
fn a_wall_hides_what_is_behind_it_even_if_it_is_too_near_to_be_seen() -> Outcome {
    let sensor = Sensor::from_elevations_deg("flat", [0.0], 64, (5.0, 100.0), 10.0)?;
    let mut mesh = Mesh::new();
    let material = mesh.add_material(Material::diffuse(50, 0.4));
    for x in [3.0, 40.0] {
        let corners = [[x, -90.0, -90.0], [x, 90.0, -90.0], [x, 0.0, 180.0]];
        mesh.add_triangles(&corners, &[[0, 1, 2]], material)?;
    }
    let scan = cast(&Scene::new(mesh), &sensor, &Pose::default(), &Motion::default());
    assert_eq!(scan.image.range_m()[32], 0.0);
    assert!(cast(&Scene::new(Mesh::new()), &sensor, &Pose::default(), &Motion::default()).cloud.is_empty());
    Ok(())
}

/// A box around the origin, each wall cut into many cells so that rays meet edges and corners from everywhere.
fn closed_box(half_m: f32, cells: usize) -> Result<Scene, Box<dyn std::error::Error>> {
    let mut mesh = Mesh::new();
    let material = mesh.add_material(Material::diffuse(50, 0.4));
    let place = |i: usize| 2.0 * half_m * i as f32 / cells as f32 - half_m;
    for axis in 0..3 {
        for side in [-half_m, half_m] {
            for i in 0..cells {
                for j in 0..cells {
                    let corner = |a: usize, b: usize| {
                        let mut at = [side; 3];
                        (at[(axis + 1) % 3], at[(axis + 2) % 3]) = (place(a), place(b));
                        at
                    };
                    let corners = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                    mesh.add_triangles(&corners, &[[0, 1, 2], [0, 2, 3]], material)?;
                }
            }
        }
    }
    Ok(Scene::new(mesh))
}

#[test]
fn no_ray_leaves_a_closed_box() -> Outcome {
    // 8 columns' centres and these elevations meet edges and corners exactly when the sensor is in the middle.
    let diagonal = (0.5f64.sqrt()).atan().to_degrees();
    let exact = Sensor::from_elevations_deg("exact", [45.0, diagonal, 0.0, -diagonal, -45.0], 8, (0.0, 500.0), 10.0)?;
    let turned = Pose { position_m: [0.0; 3], yaw_rad: (0.5 * FRAC_PI_4) as f32, ..Pose::default() };
    let elevations = (0..64).map(|e| 2.0 - 0.42 * f64::from(e));
    let dense = Sensor::from_elevations_deg("dense", elevations, 4096, (0.0, 500.0), 10.0)?;
    let elevations = (0..170).map(|e| 84.5 - f64::from(e));
    let all_around = Sensor::from_elevations_deg("all around", elevations, 720, (0.0, 500.0), 10.0)?;
    for (half_m, cells) in [(1.0, 1), (10.0, 7), (60.0, 60)] {
        let scene = closed_box(half_m, cells)?;
        // In the middle, and so near to the walls that rays graze them.
        for offset in [[0.0f32, 0.0, 0.0], [0.9999, 0.3, -0.2], [0.999, -0.999, 0.999], [0.123, 0.456, -0.789]] {
            let pose = Pose { position_m: offset.map(|o| o * half_m), ..turned };
            for sensor in [&exact, &dense, &all_around] {
                let scan = cast(&scene, sensor, &pose, &Motion::default());
                assert_eq!(scan.cloud.len(), sensor.pixels(), "{} in ±{half_m} m at {offset:?}", sensor.name);
                let reach_m = scan.image.range_m().iter().fold(0.0f32, |a, b| a.max(*b));
                assert!(reach_m < 2.0 * half_m * 1.733, "a ray went {reach_m} m");
            }
        }
    }
    Ok(())
}

#[test]
fn cloud_and_image_agree_and_project_back_without_loss_for_every_sensor() -> Outcome {
    let scene = street(3, &StreetConfig::default());
    let rings = (0..32).map(|i| Ring {
        elevation_rad: (2.0 - 0.8 * f64::from(i)).to_radians(),
        azimuth_offset_rad: 0.02 * f64::from(i % 4),
        height_m: 0.1 - 0.005 * f64::from(i),
        lateral_m: if i % 2 == 0 { 0.026 } else { -0.026 },
    });
    let mut sensors = vec![Sensor::new("beams beside the axis", rings.collect(), 1024, (0.9, 120.0), 10.0)?];
    for name in BUILTIN {
        sensors.push(Sensor::builtin(name)?);
    }
    let motion = Motion { velocity_m_s: [12.0, 0.0, 0.0], yaw_rate_rad_s: 0.2 };
    for sensor in &sensors {
        let scan = cast(&scene, sensor, &Pose::default(), &motion);
        scan.cloud.check()?;
        assert_eq!(scan.cloud.len(), scan.image.returns(), "{}", sensor.name);
        let projection = Projector::new(sensor).project(&scan.cloud)?;
        assert_eq!(projection.report.lost, 0, "{}", sensor.name);
        assert_eq!(projection.report.projected, scan.cloud.len(), "{}: {:?}", sensor.name, projection.report);
        assert_eq!(projection.image, scan.image, "{}", sensor.name);
    }
    Ok(())
}

#[test]
fn every_incidence_is_the_angle_between_ray_and_normal() -> Outcome {
    let sensor = Sensor::builtin("hdl64e")?;
    let pose = Pose { yaw_rad: 0.3, pitch_rad: 0.02, roll_rad: -0.05, ..Pose::default() };
    let scan = cast(&street(5, &StreetConfig::default()), &sensor, &pose, &Motion::default());
    let mut seen = 0;
    for i in 0..sensor.pixels() {
        let normal = scan.normal[i].map(f64::from);
        let length: f64 = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
        if scan.image.range_m()[i] == 0.0 {
            assert_eq!((length, scan.incidence_rad[i]), (0.0, 0.0));
            continue;
        }
        seen += 1;
        let ray = sensor.direction(i / sensor.columns(), i % sensor.columns());
        let cosine: f64 = -(0..3).map(|k| ray[k] * normal[k]).sum::<f64>();
        assert!((length - 1.0).abs() < 1e-6 && cosine >= -1e-6);
        // acos is steep at 1: compare cosines.
        assert!((cosine - f64::from(scan.incidence_rad[i]).cos()).abs() < 2e-6, "{cosine}");
    }
    assert!(seen > sensor.pixels() / 2);
    let Cast { cloud, .. } = scan;
    let names: Vec<&str> = cloud.extra.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["incidence_rad", "normal_x", "normal_y", "normal_z"]);
    Ok(())
}

#[test]
fn points_come_ring_by_ring_with_the_time_of_their_column() -> Outcome {
    let sensor = Sensor::builtin("hdl64e")?;
    let cloud = cast(&street(2, &StreetConfig::default()), &sensor, &Pose::default(), &Motion::default()).cloud;
    let (ring, time_s) = (cloud.ring.ok_or("ring")?, cloud.time_s.ok_or("time")?);
    assert!((1..ring.len()).all(|i| (ring[i], time_s[i]) > (ring[i - 1], time_s[i - 1])));
    assert!(time_s.iter().all(|t| (0.0..0.1).contains(t)));
    Ok(())
}
