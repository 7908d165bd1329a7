//! Defects of geometry: the true ray is not where the sensor's description says.

use glam::{DMat3, DVec3};
use lidar::Sensor;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use crate::defect::Truth;
use crate::dice::{ring_pattern, sign};
use crate::sweep::Ray;

/// The true ray is not where the sensor's description says. Positive angles point the true ray higher or more to the left.
///
/// In lists with one value a ring, rings past the end have no error.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "defect", rename_all = "snake_case", deny_unknown_fields)]
pub enum Geometry {
    /// All rings look higher.
    ElevationOffset {
        /// φ + δ.
        offset_deg: f64,
    },
    /// Each ring looks higher by its own angle.
    ElevationOffsetPerRing {
        /// φ + δ of each ring.
        offset_deg: Vec<f64>,
    },
    /// Each ring looks to the left by its own angle.
    AzimuthOffsetPerRing {
        /// θ + δ of each ring.
        offset_deg: Vec<f64>,
    },
    /// The encoder's disc sits off its axis (first harmonic) or is oval (second).
    EncoderEccentricity {
        /// a in θ + a·sin(θ + b).
        amplitude_deg: f64,
        /// b.
        phase_deg: f64,
        /// a₂ in θ + a₂·sin(2θ + b₂); 0 for none.
        second_amplitude_deg: f64,
        /// b₂.
        second_phase_deg: f64,
    },
    /// The sensor is turned about the axis ahead: positive leans right. True direction = Rz(yaw)·Ry(pitch)·Rx(roll)·described one.
    MountRoll {
        /// Angle.
        roll_deg: f64,
    },
    /// The sensor is turned about the axis to the left: positive looks down.
    MountPitch {
        /// Angle.
        pitch_deg: f64,
    },
    /// The sensor is turned about the vertical axis: positive looks left.
    MountYaw {
        /// Angle.
        yaw_deg: f64,
    },
    /// The sensor is higher than it is said to be.
    MountHeight {
        /// Height to add.
        offset_m: f64,
    },
    /// The sensor moves while it turns, and the scan is reported as if it stood where it was at the sweep's start.
    RollingShutter {
        /// Velocity ahead.
        velocity_x_m_s: f64,
        /// Velocity to the left.
        velocity_y_m_s: f64,
        /// Turn rate, positive to the left.
        yaw_rate_deg_s: f64,
    },
}

impl Geometry {
    /// Names, as in the effect library.
    pub(crate) const NAMES: &[&str] = &[
        "elevation_offset",
        "elevation_offset_per_ring",
        "azimuth_offset_per_ring",
        "encoder_eccentricity",
        "mount_roll",
        "mount_pitch",
        "mount_yaw",
        "mount_height",
        "rolling_shutter",
    ];

    pub(crate) fn name(&self) -> &'static str {
        Self::NAMES[match self {
            Self::ElevationOffset { .. } => 0,
            Self::ElevationOffsetPerRing { .. } => 1,
            Self::AzimuthOffsetPerRing { .. } => 2,
            Self::EncoderEccentricity { .. } => 3,
            Self::MountRoll { .. } => 4,
            Self::MountPitch { .. } => 5,
            Self::MountYaw { .. } => 6,
            Self::MountHeight { .. } => 7,
            Self::RollingShutter { .. } => 8,
        }]
    }

    pub(crate) fn truth(&self) -> Truth {
        match self {
            Self::ElevationOffset { offset_deg } => vec![("offset_deg", *offset_deg)],
            Self::ElevationOffsetPerRing { offset_deg } | Self::AzimuthOffsetPerRing { offset_deg } => {
                offset_deg.iter().map(|offset| ("offset_deg", *offset)).collect()
            }
            Self::EncoderEccentricity { amplitude_deg, phase_deg, second_amplitude_deg, second_phase_deg } => vec![
                ("amplitude_deg", *amplitude_deg),
                ("phase_deg", *phase_deg),
                ("second_amplitude_deg", *second_amplitude_deg),
                ("second_phase_deg", *second_phase_deg),
            ],
            Self::MountRoll { roll_deg } => vec![("roll_deg", *roll_deg)],
            Self::MountPitch { pitch_deg } => vec![("pitch_deg", *pitch_deg)],
            Self::MountYaw { yaw_deg } => vec![("yaw_deg", *yaw_deg)],
            Self::MountHeight { offset_m } => vec![("offset_m", *offset_m)],
            Self::RollingShutter { velocity_x_m_s, velocity_y_m_s, yaw_rate_deg_s } => vec![
                ("velocity_x_m_s", *velocity_x_m_s),
                ("velocity_y_m_s", *velocity_y_m_s),
                ("yaw_rate_deg_s", *yaw_rate_deg_s),
            ],
        }
    }

    /// Size 1: what the calibrations of an HDL-64E differ by (elevations 0.03–0.2°), a bracket's tolerance, a car in town.
    pub(crate) fn typical(name: &str, size: f64, sensor: &Sensor, dice: &mut dyn Rng) -> Option<Self> {
        let rings = sensor.rings().len();
        let turn_deg = 360.0;
        Some(match name {
            "elevation_offset" => Self::ElevationOffset { offset_deg: 0.15 * size * sign(dice) },
            "elevation_offset_per_ring" => {
                Self::ElevationOffsetPerRing { offset_deg: ring_pattern(rings, 0.08 * size, dice) }
            }
            "azimuth_offset_per_ring" => {
                Self::AzimuthOffsetPerRing { offset_deg: ring_pattern(rings, 0.15 * size, dice) }
            }
            "encoder_eccentricity" => Self::EncoderEccentricity {
                amplitude_deg: 0.2 * size,
                phase_deg: dice.random_range(-0.5..0.5) * turn_deg,
                second_amplitude_deg: if dice.random() { 0.1 * size } else { 0.0 },
                second_phase_deg: dice.random_range(-0.5..0.5) * turn_deg,
            },
            "mount_roll" => Self::MountRoll { roll_deg: 0.3 * size * sign(dice) },
            "mount_pitch" => Self::MountPitch { pitch_deg: 0.3 * size * sign(dice) },
            "mount_yaw" => Self::MountYaw { yaw_deg: 0.5 * size * sign(dice) },
            "mount_height" => Self::MountHeight { offset_m: 0.05 * size * sign(dice) },
            "rolling_shutter" => Self::RollingShutter {
                velocity_x_m_s: 10.0 * size * sign(dice),
                velocity_y_m_s: 0.5 * size * sign(dice),
                yaw_rate_deg_s: 10.0 * size * sign(dice),
            },
            _ => return None,
        })
    }
}

/// Where the rays of a sensor with geometric defects really go: all of its defects together.
#[derive(Clone, Debug, Default)]
pub(crate) struct Aim {
    elevation_rad: f64,
    elevation_of_ring_rad: Vec<f64>,
    azimuth_of_ring_rad: Vec<f64>,
    encoder: Vec<Harmonic>,
    roll_rad: f64,
    pitch_rad: f64,
    yaw_rad: f64,
    height_m: f64,
    velocity_m_s: DVec3,
    yaw_rate_rad_s: f64,
}

/// An error of the encoder: amplitude · sin(order · θ + phase).
#[derive(Clone, Copy, Debug)]
struct Harmonic {
    order: f64,
    amplitude_rad: f64,
    phase_rad: f64,
}

/// A true ray, in the frame that the sensor is said to be in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beam {
    pub(crate) from_m: DVec3,
    pub(crate) direction: DVec3,
    /// Where the beam leaves, from the true sensor's own origin and in its own frame: ranges count from that origin.
    pub(crate) beside_m: DVec3,
    /// The direction in the true sensor's own frame.
    pub(crate) from_sensor: DVec3,
}

impl Aim {
    /// The described aim when there are no defects.
    pub(crate) fn new<'a>(defects: impl IntoIterator<Item = &'a Geometry>) -> Self {
        let mut aim = Self::default();
        for defect in defects {
            match defect {
                Geometry::ElevationOffset { offset_deg } => aim.elevation_rad += offset_deg.to_radians(),
                Geometry::ElevationOffsetPerRing { offset_deg } => add(&mut aim.elevation_of_ring_rad, offset_deg),
                Geometry::AzimuthOffsetPerRing { offset_deg } => add(&mut aim.azimuth_of_ring_rad, offset_deg),
                Geometry::EncoderEccentricity { amplitude_deg, phase_deg, second_amplitude_deg, second_phase_deg } => {
                    let harmonic = |order, amplitude: &f64, phase: &f64| Harmonic {
                        order,
                        amplitude_rad: amplitude.to_radians(),
                        phase_rad: phase.to_radians(),
                    };
                    aim.encoder.push(harmonic(1.0, amplitude_deg, phase_deg));
                    aim.encoder.push(harmonic(2.0, second_amplitude_deg, second_phase_deg));
                }
                Geometry::MountRoll { roll_deg } => aim.roll_rad += roll_deg.to_radians(),
                Geometry::MountPitch { pitch_deg } => aim.pitch_rad += pitch_deg.to_radians(),
                Geometry::MountYaw { yaw_deg } => aim.yaw_rad += yaw_deg.to_radians(),
                Geometry::MountHeight { offset_m } => aim.height_m += offset_m,
                Geometry::RollingShutter { velocity_x_m_s, velocity_y_m_s, yaw_rate_deg_s } => {
                    aim.velocity_m_s += DVec3::new(*velocity_x_m_s, *velocity_y_m_s, 0.0);
                    aim.yaw_rate_rad_s += yaw_rate_deg_s.to_radians();
                }
            }
        }
        aim
    }

    /// The true ray of a pixel: the beam within the sensor, the sensor on its mount, the mount on what carries it.
    pub(crate) fn beam(&self, sensor: &Sensor, ray: &Ray) -> Beam {
        let of_ring = |list: &[f64]| list.get(ray.ring).copied().unwrap_or(0.0);
        let wobble = |h: &Harmonic| h.amplitude_rad * (h.order * ray.azimuth_rad + h.phase_rad).sin();
        let elevation = ray.elevation_rad + self.elevation_rad + of_ring(&self.elevation_of_ring_rad);
        let azimuth =
            ray.azimuth_rad + of_ring(&self.azimuth_of_ring_rad) + self.encoder.iter().map(wobble).sum::<f64>();
        let laser = sensor.rings()[ray.ring];
        let beside_m = DVec3::new(-laser.lateral_m * azimuth.sin(), laser.lateral_m * azimuth.cos(), laser.height_m);
        let from_sensor = DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());

        let mount = DMat3::from_rotation_z(self.yaw_rad)
            * DMat3::from_rotation_y(self.pitch_rad)
            * DMat3::from_rotation_x(self.roll_rad);
        let mounted_m = mount * beside_m + DVec3::Z * self.height_m;

        let time_s = ray.phase / f64::from(sensor.rotation_hz());
        let heading = DMat3::from_rotation_z(self.yaw_rate_rad_s * time_s);
        Beam {
            from_m: self.velocity_m_s * time_s + heading * mounted_m,
            direction: heading * mount * from_sensor,
            beside_m,
            from_sensor,
        }
    }
}

/// Adds one angle a ring to a list that may be shorter.
fn add(to_rad: &mut Vec<f64>, offset_deg: &[f64]) {
    if to_rad.len() < offset_deg.len() {
        to_rad.resize(offset_deg.len(), 0.0);
    }
    for (to, offset) in to_rad.iter_mut().zip(offset_deg) {
        *to += offset.to_radians();
    }
}
