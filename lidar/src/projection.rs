//! Projection: a point cloud into a sensor's range image, and back.

use std::f64::consts::{PI, TAU};

use serde::Serialize;
use thiserror::Error;

use crate::cloud::PointCloud;
use crate::label::class_of;
use crate::range_image::RangeImage;
use crate::rings::{RingSource, Rings};
use crate::sensor::Sensor;

/// Marks a point without a pixel.
pub const NO_PIXEL: u32 = u32::MAX;

/// A cloud may have at most this share of points that are NaN, infinite or at the origin before it is refused.
pub const MAX_INVALID_SHARE: f64 = 0.5;

/// Projects clouds into one sensor's range images; keeps its tables and memory from scan to scan.
#[derive(Clone, Debug)]
pub struct Projector {
    sensor: Sensor,
    rings: Rings,
    row_of_point: Vec<u16>,
}

/// A projected scan: the image, and which pixel each point won.
///
/// A pixel's ray is that of the point that won it: [`reconstruct_into`](Self::reconstruct_into) moves that point along its own
/// direction from the sensor's origin, so a scan that nothing changes comes back bit for bit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Projection {
    /// The range image.
    pub image: RangeImage,
    /// Pixel (ring · columns + column) of each point, [`NO_PIXEL`] where it has none.
    pub pixel_of_point: Vec<u32>,
    /// What became of the points.
    pub report: Report,
    selected: Vec<u32>,
}

/// What became of a cloud's points; `points_in` is the sum of all the other counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Report {
    /// Points of the cloud.
    pub points_in: usize,
    /// Points that won a pixel.
    pub projected: usize,
    /// Points that lost their pixel to a nearer one.
    pub lost: usize,
    /// Points with a NaN or infinite coordinate.
    pub non_finite: usize,
    /// Points at the sensor's origin.
    pub zero_range: usize,
    /// Points nearer or farther than the sensor sees.
    pub out_of_range: usize,
    /// Points above or below every ring.
    pub outside_view: usize,
    /// Rings that have a point.
    pub rings_seen: usize,
    /// How the rings were told.
    pub ring_source: RingSource,
}

/// A cloud that cannot be projected.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ProjectionError {
    /// Too many points are no points.
    #[error("{invalid} of {points} points are NaN, infinite or at the origin; at most {} % may be", MAX_INVALID_SHARE * 100.0)]
    TooManyInvalid {
        /// Points that are none.
        invalid: usize,
        /// Points in all.
        points: usize,
    },
    /// More points than a pixel index can count.
    #[error("{0} points are more than 2³² − 2")]
    TooManyPoints(usize),
}

/// What a model says the sensor measures, each `[ring, column]`.
#[derive(Clone, Copy, Debug)]
pub struct Measured<'a> {
    /// Range in metres.
    pub range_m: &'a [f32],
    /// Reflectance, 0–1.
    pub reflectance: &'a [f32],
    /// Whether the sensor reports the ray.
    pub keep: &'a [bool],
}

impl Projector {
    /// A projector for this sensor.
    pub fn new(sensor: &Sensor) -> Self {
        Self { rings: Rings::new(sensor), sensor: sensor.clone(), row_of_point: Vec::new() }
    }

    /// The sensor.
    pub fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// Projects a cloud; the nearest return wins a pixel.
    pub fn project(&mut self, cloud: &PointCloud) -> Result<Projection, ProjectionError> {
        let mut projection = Projection::default();
        self.project_into(cloud, &mut projection)?;
        Ok(projection)
    }

    /// [`project`](Self::project) into a projection that is already there, reusing its memory.
    pub fn project_into(&mut self, cloud: &PointCloud, out: &mut Projection) -> Result<(), ProjectionError> {
        let points = cloud.len();
        if points >= NO_PIXEL as usize {
            return Err(ProjectionError::TooManyPoints(points));
        }
        let ring_source = self.rings.assign(cloud, &mut self.row_of_point);
        let (rings, columns) = (self.sensor.rings().len(), self.sensor.columns());
        let (nearest_m, farthest_m) = self.sensor.range_limits_m();
        out.image.clear(rings, columns);
        out.pixel_of_point.clear();
        out.pixel_of_point.resize(points, NO_PIXEL);
        let mut report = Report { points_in: points, ring_source, ..Report::default() };

        // The winner of each pixel is kept in `selected` while points are placed; the losers are marked afterwards.
        out.selected.clear();
        out.selected.resize(rings * columns, NO_PIXEL);
        for i in 0..points {
            let range_m = cloud.range_m(i);
            if !range_m.is_finite() {
                report.non_finite += 1;
            } else if range_m == 0.0 {
                report.zero_range += 1;
            } else if range_m < nearest_m || range_m > farthest_m {
                report.out_of_range += 1;
            } else if usize::from(self.row_of_point[i]) >= rings {
                report.outside_view += 1;
            } else {
                let row = usize::from(self.row_of_point[i]);
                let pixel = row * columns + self.column(row, cloud.x[i], cloud.y[i]);
                let winner = out.selected[pixel];
                if winner != NO_PIXEL {
                    report.lost += 1;
                    if range_m >= out.image.range_m[pixel] {
                        continue;
                    }
                    out.pixel_of_point[winner as usize] = NO_PIXEL;
                }
                out.selected[pixel] = i as u32;
                out.pixel_of_point[i] = pixel as u32;
                out.image.range_m[pixel] = range_m;
            }
        }
        let invalid = report.non_finite + report.zero_range;
        if invalid as f64 > MAX_INVALID_SHARE * points as f64 {
            return Err(ProjectionError::TooManyInvalid { invalid, points });
        }
        let to_reflectance = 1.0 / cloud.full_scale;
        for row in 0..rings {
            let mut seen = false;
            for pixel in row * columns..(row + 1) * columns {
                let winner = out.selected[pixel] as usize;
                if winner < points {
                    seen = true;
                    let reflectance = cloud.intensity[winner] * to_reflectance;
                    out.image.reflectance[pixel] =
                        if reflectance.is_finite() { reflectance.clamp(0.0, 1.0) } else { 0.0 };
                    out.image.class[pixel] = cloud.label.as_ref().map_or(0, |label| class_of(label[winner]));
                }
            }
            report.rings_seen += usize::from(seen);
        }
        report.projected = points - report.lost - invalid - report.out_of_range - report.outside_view;
        out.report = report;
        Ok(())
    }

    fn column(&self, row: usize, x: f32, y: f32) -> usize {
        let ring = &self.sensor.rings()[row];
        let (x, y) = (f64::from(x), f64::from(y));
        let mut azimuth = y.atan2(x) - ring.azimuth_offset_rad;
        if ring.lateral_m != 0.0 {
            azimuth -= (ring.lateral_m / x.hypot(y).max(ring.lateral_m.abs())).asin();
        }
        let columns = self.sensor.columns() as f64;
        let turn = ((PI - azimuth) / TAU).rem_euclid(1.0);
        ((turn * columns) as usize).min(self.sensor.columns() - 1)
    }
}

impl Projection {
    /// The cloud as the sensor measured it: every point that won a pixel whose ray is kept, in the cloud's order and with all its
    /// fields, moved along its own ray to the measured range, with the measured reflectance as intensity.
    ///
    /// # Panics
    /// If `cloud` is not the one that was projected, or `measured` has not this image's size.
    pub fn reconstruct(&mut self, cloud: &PointCloud, measured: Measured<'_>) -> PointCloud {
        let mut out = PointCloud::default();
        self.reconstruct_into(cloud, measured, &mut out);
        out
    }

    /// [`reconstruct`](Self::reconstruct) into a cloud that is already there, reusing its memory.
    pub fn reconstruct_into(&mut self, cloud: &PointCloud, measured: Measured<'_>, out: &mut PointCloud) {
        let pixels = self.image.range_m.len();
        assert_eq!(cloud.len(), self.pixel_of_point.len(), "the cloud that was projected");
        for length in [measured.range_m.len(), measured.reflectance.len(), measured.keep.len()] {
            assert_eq!(length, pixels, "measured channels of the image's size");
        }
        self.selected.clear();
        for (i, pixel) in self.pixel_of_point.iter().enumerate() {
            let pixel = *pixel as usize;
            if pixel < pixels && measured.keep[pixel] && measured.range_m[pixel] > 0.0 {
                self.selected.push(i as u32);
            }
        }
        out.select_from(cloud, &self.selected);
        for (k, i) in self.selected.iter().enumerate() {
            let pixel = self.pixel_of_point[*i as usize] as usize;
            let stretch = measured.range_m[pixel] / self.image.range_m[pixel];
            out.x[k] *= stretch;
            out.y[k] *= stretch;
            out.z[k] *= stretch;
            out.intensity[k] = measured.reflectance[pixel] * cloud.full_scale;
        }
    }
}
