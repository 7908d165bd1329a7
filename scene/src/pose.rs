//! Where the sensor is, and how it moves during a sweep.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::scene::Scene;

/// Height of the sensor above the road where no pose is given: that of KITTI's car, in metres.
pub const SENSOR_HEIGHT_M: f32 = 1.73;

/// The sensor's place in the world when a sweep begins. The default is 1.73 m above the world's origin, looking along x.
///
/// The sensor's frame is turned by roll about x, then pitch about y, then yaw about z: positive yaw turns left, positive pitch looks
/// down, positive roll leans right.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Pose {
    /// Position of the sensor's origin in the world: x ahead, y left, z up, in metres.
    pub position_m: [f32; 3],
    /// Turn about the vertical axis.
    pub yaw_rad: f32,
    /// Turn about the axis to the left.
    pub pitch_rad: f32,
    /// Turn about the axis ahead.
    pub roll_rad: f32,
}

/// How the sensor moves while it turns, as it sees it itself when the sweep begins. The default is standing still.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Motion {
    /// Velocity in the sensor's frame at the sweep's start: ahead, left, up.
    pub velocity_m_s: [f32; 3],
    /// Turn rate about the sensor's own vertical axis, positive to the left.
    pub yaw_rate_rad_s: f32,
}

impl Default for Pose {
    fn default() -> Self {
        Self { position_m: [0.0, 0.0, SENSOR_HEIGHT_M], yaw_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 }
    }
}

/// A turned and moved frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WorldFromSensor {
    pub(crate) rotation: DMat3,
    pub(crate) translation_m: DVec3,
}

impl Pose {
    /// A level sensor at the usual height above the lowest surface at (x, y); `None` where there is none.
    pub fn above_ground(scene: &Scene, x_m: f32, y_m: f32, yaw_rad: f32) -> Option<Self> {
        let z_m = scene.ground_m(x_m, y_m)? + SENSOR_HEIGHT_M;
        Some(Self { position_m: [x_m, y_m, z_m], yaw_rad, ..Self::default() })
    }

    /// Where the sensor is `time_s` after the sweep's start.
    pub(crate) fn after(&self, motion: &Motion, time_s: f64) -> WorldFromSensor {
        let start = DMat3::from_rotation_z(f64::from(self.yaw_rad))
            * DMat3::from_rotation_y(f64::from(self.pitch_rad))
            * DMat3::from_rotation_x(f64::from(self.roll_rad));
        let velocity = DVec3::from_array(motion.velocity_m_s.map(f64::from));
        WorldFromSensor {
            rotation: start * DMat3::from_rotation_z(f64::from(motion.yaw_rate_rad_s) * time_s),
            translation_m: DVec3::from_array(self.position_m.map(f64::from)) + start * velocity * time_s,
        }
    }
}
