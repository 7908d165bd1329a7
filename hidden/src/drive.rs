//! A drive along a street: poses a few metres apart, each where a car has room.

use rand::RngExt;
use scene::{Pose, Scene};

use crate::dice::Dice;

/// Half a car's length and width.
const HALF_CAR_M: [f32; 2] = [2.5, 1.0];

/// Nothing may stand or hang lower than this over the car.
const CLEARANCE_M: f64 = 2.5;

/// Places tried along the street before the drive gives up and stops at its origin, which is always free.
const TRIES: usize = 60;

/// As many poses as frames, along the street through its origin: 3–6 m apart, a little off the lane's middle and heading.
pub(crate) fn poses(street: &Scene, frames: usize, dice: &mut Dice) -> Vec<Pose> {
    let apart_m: f32 = dice.random_range(3.0..6.0);
    let mut along_m = -0.5 * apart_m * frames.saturating_sub(1) as f32;
    (0..frames)
        .map(|_| {
            let (left_m, yaw_rad) = (dice.random_range(-0.4..0.4), dice.random_range(-0.1..0.1));
            // A car in the way: go on a little.
            let mut places = (0..TRIES).map(|k| along_m + 0.5 * k as f32);
            let free = places.find(|x_m| has_room(street, *x_m, left_m));
            along_m = free.unwrap_or(along_m) + apart_m;
            let [x_m, y_m] = free.map_or([0.0; 2], |x_m| [x_m, left_m]);
            Pose::above_ground(street, x_m, y_m, yaw_rad).unwrap_or_else(|| Pose { yaw_rad, ..Pose::default() })
        })
        .collect()
}

/// Whether nothing stands on the ground or hangs low where a car would be.
fn has_room(street: &Scene, x_m: f32, y_m: f32) -> bool {
    let grid = (-2..=2).flat_map(|i| (-2..=2).map(move |k| (i, k)));
    grid.map(|(i, k)| [x_m + 0.5 * i as f32 * HALF_CAR_M[0], y_m + 0.5 * k as f32 * HALF_CAR_M[1]]).all(|[x, y]| {
        street.ground_m(x, y).is_some_and(|ground_m| {
            let from_m = [f64::from(x), f64::from(y), f64::from(ground_m) + 0.05];
            street.hit(from_m, [0.0, 0.0, 1.0], CLEARANCE_M).is_none()
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dice::{Purpose, dice};
    use scene::street::{StreetConfig, street};

    #[test]
    fn no_pose_is_inside_or_next_to_a_thing() {
        for seed in 0..6 {
            let street = street(seed, &StreetConfig::default());
            let poses = poses(&street, 4, &mut dice(seed, Purpose::Scene, 0));
            assert_eq!(poses.len(), 4);
            for pose in poses {
                let from_m = pose.position_m.map(f64::from);
                for k in 0..360 {
                    let (sin, cos) = f64::from(k).to_radians().sin_cos();
                    let hit = street.hit(from_m, [cos, sin, 0.0], 100.0);
                    let distance_m = hit.map_or(f64::INFINITY, |hit| hit.distance_m);
                    assert!(distance_m > 0.5, "seed {seed}: {distance_m} m at {k}° from {pose:?}");
                }
            }
        }
    }
}
