//! The sensor's rays as tensors, and by how much the true ones deviate.

use burn::tensor::{Device, Tensor, TensorData};
use lidar::Sensor;

/// Directions of the rays as the sensor's description has them.
#[derive(Clone, Debug)]
pub struct Rays {
    /// Elevation in radians, `[1, ring, 1]`.
    pub elevation_rad: Tensor<3>,
    /// Azimuth in radians, to the left of ahead, `[1, ring, column]`.
    pub azimuth_rad: Tensor<3>,
    /// Phase in the sweep, 0 to 1 at the columns' middles, `[1, 1, column]`.
    pub phase: Tensor<3>,
    /// Elevation of the ring above minus this ring's, in radians, `[1, ring, 1]`; the topmost ring's is that of the next below.
    pub above_rad: Tensor<3>,
    /// Elevation of this ring minus that of the ring below, in radians, `[1, ring, 1]`; the lowest ring's is that of the next above.
    pub below_rad: Tensor<3>,
    /// The ring whose elevation is nearest to each of evenly spaced ones, from the topmost ring's down: `[entry]`.
    pub nearest_ring: Tensor<1>,
    /// Distance of those elevations in radians.
    pub entry_rad: f64,
    /// Azimuth of each ring's columns to the left of the encoder's in radians, `[ring]`; `None` if they look along it.
    pub offset_rad: Option<Tensor<1>>,
    /// Number of the ring, `[1, ring, 1]`.
    pub ring: Tensor<3>,
    /// Number of the column, `[1, 1, column]`.
    pub column: Tensor<3>,
    /// Duration of a sweep in s.
    pub sweep_s: f64,
    /// Nearest and farthest range that the sensor reports, in m.
    pub limits_m: (f64, f64),
}

/// Deviation of the true rays from the described ones; `None` is none.
#[derive(Clone, Debug, Default)]
pub struct Bend {
    /// Upwards, in radians, broadcasts to `[1, ring, column]`.
    pub elevation_rad: Option<Tensor<3>>,
    /// To the left, in radians.
    pub azimuth_rad: Option<Tensor<3>>,
    /// Displacement of the origin: ahead, left, up, in m.
    pub origin_m: Option<[Tensor<3>; 3]>,
}

impl Rays {
    /// The rays of a sensor.
    pub fn new(sensor: &Sensor, device: &Device) -> Self {
        let (rings, columns) = (sensor.rings().len(), sensor.columns());
        let elevation: Vec<f64> = sensor.rings().iter().map(|r| r.elevation_rad).collect();
        let gap = |k: usize| {
            if rings < 2 { 1.0 } else { (elevation[k.min(rings - 2)] - elevation[k.min(rings - 2) + 1]).max(1e-6) }
        };
        let azimuth: Vec<f32> = (0..rings * columns)
            .map(|i| (sensor.azimuth_rad(i % columns) + sensor.rings()[i / columns].azimuth_offset_rad) as f32)
            .collect();
        let phase = |c: usize| (c as f32 + 0.5) / columns as f32;
        let per_ring = |value: &dyn Fn(usize) -> f64| {
            let values: Vec<f32> = (0..rings).map(|k| value(k) as f32).collect();
            Tensor::from_data(TensorData::new(values, [1, rings, 1]), device)
        };
        let per_column = |value: &dyn Fn(usize) -> f32| {
            let values: Vec<f32> = (0..columns).map(value).collect();
            Tensor::from_data(TensorData::new(values, [1, 1, columns]), device)
        };
        // Entries finer than the narrowest gap by far, but never more than a table should have.
        let top = elevation.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let bottom = elevation.iter().copied().fold(f64::INFINITY, f64::min);
        let narrowest = (0..rings).map(&gap).fold(f64::INFINITY, f64::min);
        let entries = ((top - bottom) / narrowest * 16.0).ceil().clamp(1.0, 4096.0);
        let entry_rad = ((top - bottom) / entries).max(1e-6);
        let nearest = |entry: usize| {
            let off = |k: &usize| (elevation[*k] - (top - entry as f64 * entry_rad)).abs();
            (0..rings).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0) as f32
        };
        let list = |values: Vec<f32>| Tensor::<1>::from_floats(values.as_slice(), device);
        let offsets: Vec<f32> = sensor.rings().iter().map(|r| r.azimuth_offset_rad as f32).collect();
        Self {
            nearest_ring: list((0..=entries as usize).map(nearest).collect()),
            entry_rad,
            offset_rad: offsets.iter().any(|x| *x != 0.0).then(|| list(offsets)),
            elevation_rad: per_ring(&|k| elevation[k]),
            azimuth_rad: Tensor::from_data(TensorData::new(azimuth, [1, rings, columns]), device),
            phase: per_column(&phase),
            above_rad: per_ring(&|k| gap(k.saturating_sub(1))),
            below_rad: per_ring(&|k| gap(k)),
            ring: per_ring(&|k| k as f64),
            column: per_column(&|c| c as f32),
            sweep_s: 1.0 / f64::from(sensor.rotation_hz()),
            limits_m: (f64::from(sensor.range_limits_m().0), f64::from(sensor.range_limits_m().1)),
        }
    }

    /// Unit vectors along rays with these deviations, `[1, ring, column]` each: ahead, left, up.
    pub fn directions(&self, bend: &Bend) -> [Tensor<3>; 3] {
        let [elevation, azimuth] = self.angles(bend);
        let level = elevation.clone().cos();
        [level.clone() * azimuth.clone().cos(), level * azimuth.clone().sin(), elevation.sin() + azimuth.zeros_like()]
    }

    /// Elevations and azimuths of rays with these deviations, in radians.
    pub fn angles(&self, bend: &Bend) -> [Tensor<3>; 2] {
        let elevation = add(&self.elevation_rad, bend.elevation_rad.as_ref());
        [elevation, add(&self.azimuth_rad, bend.azimuth_rad.as_ref())]
    }

    /// Numbers of rings and columns.
    pub fn size(&self) -> [usize; 2] {
        let [_, rings, columns] = self.azimuth_rad.dims();
        [rings, columns]
    }
}

impl Bend {
    /// Whether the rays are as described.
    pub fn is_none(&self) -> bool {
        self.elevation_rad.is_none() && self.azimuth_rad.is_none() && self.origin_m.is_none()
    }

    /// Turns the rays upwards by this much more.
    pub fn up(&mut self, angle_rad: Tensor<3>) {
        self.elevation_rad = Some(sum(self.elevation_rad.take(), angle_rad));
    }

    /// Turns the rays to the left by this much more.
    pub fn left(&mut self, angle_rad: Tensor<3>) {
        self.azimuth_rad = Some(sum(self.azimuth_rad.take(), angle_rad));
    }

    /// Turns the rays as they are bent so far with the whole sensor; `turned` gives a direction (ahead, left, up) after the turn.
    ///
    /// Exact: with h the level part of a direction, sin Δφ = z'·h − h'·z and sin Δθ = (x·y' − y·x') / (h·h').
    pub fn turn(&mut self, rays: &Rays, turned: impl FnOnce([Tensor<3>; 3]) -> [Tensor<3>; 3]) {
        let [x, y, z] = rays.directions(self);
        let [new_x, new_y, new_z] = turned([x.clone(), y.clone(), z.clone()]);
        let level = |x: &Tensor<3>, y: &Tensor<3>| (x.clone().square() + y.clone().square()).clamp_min(1e-12).sqrt();
        let (h, new_h) = (level(&x, &y), level(&new_x, &new_y));
        let across = (x * new_y - y * new_x) / (h.clone() * new_h.clone());
        self.up((new_z * h - new_h * z).asin());
        self.left(across.asin());
    }

    /// Moves their origins by this much more: ahead, left, up, in m.
    pub fn shift(&mut self, by_m: [Tensor<3>; 3]) {
        self.origin_m = Some(match self.origin_m.take() {
            None => by_m,
            Some([x, y, z]) => {
                let [dx, dy, dz] = by_m;
                [x + dx, y + dy, z + dz]
            }
        });
    }
}

fn add(x: &Tensor<3>, by: Option<&Tensor<3>>) -> Tensor<3> {
    by.map_or_else(|| x.clone(), |by| x.clone() + by.clone())
}

fn sum(x: Option<Tensor<3>>, by: Tensor<3>) -> Tensor<3> {
    match x {
        None => by,
        Some(x) => x + by,
    }
}
