//! Projection: a point cloud into a sensor's range image, and back.

mod empty_rays;
mod grid;
pub mod loss;
mod polar;

use serde::Serialize;
use thiserror::Error;

use crate::cloud::PointCloud;
use crate::label::class_of;
use crate::range_image::RangeImage;
use crate::rings::{RingSource, Rings};
use crate::sensor::Sensor;

pub use empty_rays::EmptyRays;
use grid::Grid;
pub(crate) use polar::Polar;

/// Marks a point without a pixel.
pub const NO_PIXEL: u32 = u32::MAX;

/// A cloud may have at most this share of points that are NaN, infinite or at the origin before it is refused.
pub const MAX_INVALID_SHARE: f64 = 0.5;

/// Unused places after each ring's in the table of winners. Rings one power of two apart would share one set of the processor's cache,
/// and a cloud that lists firing after firing visits all of them with each.
const GAP: usize = 16;

/// Columns that are painted together.
const TILE: usize = 64;

/// Ids of every label map that is known are below this (those of `label.rs` end at 259).
const LABEL_IDS: u32 = 512;

/// Projects clouds into one sensor's range images; keeps its tables and memory from scan to scan.
#[derive(Clone, Debug)]
pub struct Projector {
    sensor: Sensor,
    rings: Rings,
    grid: Grid,
    polar: Polar,
    row_of_point: Vec<u16>,
    /// Class by label id; ids past its end have none.
    classes: Vec<u8>,
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
    /// The number by which the cloud calls each of the sensor's rings.
    ring_of_row: Vec<u16>,
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
    /// Points are counted for another number of rings than the sensor has.
    #[error("points are counted for {found} rings, but the sensor has {rings}")]
    OtherRings {
        /// Rings that are counted.
        found: usize,
        /// Rings of the sensor.
        rings: usize,
    },
    /// The rings' counts are not those of this cloud.
    #[error("the rings are counted to have {counted} points, but the cloud has {points}")]
    OtherPoints {
        /// Sum of the counts.
        counted: u64,
        /// Points of the cloud.
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
        Self {
            rings: Rings::new(sensor),
            grid: Grid::new(sensor),
            polar: Polar::default(),
            row_of_point: Vec::new(),
            classes: (0..LABEL_IDS).map(class_of).collect(),
            sensor: sensor.clone(),
        }
    }

    /// The same, but rings are told by elevation alone, whatever the clouds' ring field or order say.
    #[must_use]
    pub fn by_elevation(mut self) -> Self {
        self.rings.use_elevation_alone();
        self
    }

    /// The sensor.
    pub fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// Projects a cloud; the nearest return wins a pixel, of two at one range the brighter.
    pub fn project(&mut self, cloud: &PointCloud) -> Result<Projection, ProjectionError> {
        let mut projection = Projection::default();
        self.project_into(cloud, &mut projection)?;
        Ok(projection)
    }

    /// [`project`](Self::project) into a projection that is already there, reusing its memory.
    ///
    /// After an error `out` is no projection of anything.
    pub fn project_into(&mut self, cloud: &PointCloud, out: &mut Projection) -> Result<(), ProjectionError> {
        self.project_counted_into(cloud, None, out)
    }

    /// [`project_into`](Self::project_into), where `counts` may say how many points each of the sensor's rings has: the cloud then lists
    /// them ring after ring, from the highest to the lowest, as CARLA does, and neither field nor elevation is asked.
    pub fn project_counted_into(
        &mut self,
        cloud: &PointCloud,
        counts: Option<&[u32]>,
        out: &mut Projection,
    ) -> Result<(), ProjectionError> {
        let points = cloud.len();
        if points >= NO_PIXEL as usize {
            return Err(ProjectionError::TooManyPoints(points));
        }
        self.polar.take(cloud);
        let ring_source = self.rings.assign(cloud, &self.polar, counts, &mut self.row_of_point)?;
        let mut report = self.polar.count(cloud, self.sensor.range_limits_m());
        let invalid = report.non_finite + report.zero_range;
        if invalid as f64 > MAX_INVALID_SHARE * points as f64 {
            return Err(ProjectionError::TooManyInvalid { invalid, points });
        }
        out.pixel_of_point.resize(points, NO_PIXEL);
        self.grid.pixels(cloud, &self.polar, &self.row_of_point, &mut out.pixel_of_point);
        let size = (self.sensor.rings().len(), self.sensor.columns());
        let (placed, lost) = out.let_the_nearest_win(cloud, &self.polar.range_m, &self.row_of_point, size);
        report.rings_seen = out.paint(cloud, &self.polar.range_m, size, &self.classes);
        report.projected = placed - lost;
        report.lost = lost;
        report.outside_view = points - placed - invalid - report.out_of_range;
        report.ring_source = ring_source;
        self.rings.numbers_in_cloud(ring_source, &mut out.ring_of_row);
        if let (RingSource::Counts, Some(field)) = (ring_source, &cloud.ring) {
            for (row, number) in self.row_of_point.iter().zip(field) {
                out.ring_of_row[usize::from(*row)] = *number;
            }
        }
        out.report = report;
        Ok(())
    }
}

impl Projection {
    /// Gives each pixel to its nearest point and takes it from the others. Returns how many points had a pixel, and how many lost it.
    fn let_the_nearest_win(
        &mut self,
        cloud: &PointCloud,
        range_m: &[f32],
        rows: &[u16],
        (rings, columns): (usize, usize),
    ) -> (usize, usize) {
        self.selected.clear();
        self.selected.resize(rings * (columns + GAP), NO_PIXEL);
        let (mut placed, mut lost) = (0, 0);
        let (pixel_of_point, selected) = (self.pixel_of_point.as_mut_slice(), self.selected.as_mut_slice());
        let rows = &rows[..pixel_of_point.len()];
        for i in 0..pixel_of_point.len() {
            // Without a pixel there is no place either: NO_PIXEL lies beyond them all.
            let place = pixel_of_point[i] as usize + GAP * usize::from(rows[i]);
            let Some(winner) = selected.get_mut(place) else { continue };
            placed += 1;
            if *winner == NO_PIXEL {
                *winner = i as u32;
                continue;
            }
            lost += 1;
            let mut loser = i;
            if nearer(cloud, range_m, i, *winner as usize) {
                loser = *winner as usize;
                *winner = i as u32;
            }
            pixel_of_point[loser] = NO_PIXEL;
        }
        (placed, lost)
    }

    /// Fills the image with the winners' values; returns how many rings have one.
    fn paint(
        &mut self,
        cloud: &PointCloud,
        range_m: &[f32],
        (rings, columns): (usize, usize),
        classes: &[u8],
    ) -> usize {
        self.image.clear(rings, columns);
        let to_reflectance = 1.0 / cloud.full_scale;
        let points = cloud.len();
        let (range_m, intensity) = (&range_m[..points], &cloud.intensity[..points]);
        let label = cloud.label.as_ref().map(|label| &label[..points]);
        // Tile by tile, since the points of a few columns lie together in memory whether the cloud lists ring after ring or firing
        // after firing.
        for first in (0..columns).step_by(TILE) {
            for row in 0..rings {
                let pixels = row * columns + first..row * columns + (first + TILE).min(columns);
                let winners = pixels.start + GAP * row..pixels.end + GAP * row;
                let image = self.image.range_m[pixels.clone()]
                    .iter_mut()
                    .zip(&mut self.image.reflectance[pixels.clone()])
                    .zip(&mut self.image.class[pixels.clone()]);
                for (&winner, ((range, reflectance), class)) in self.selected[winners].iter().zip(image) {
                    let i = winner as usize;
                    if i < points {
                        *range = range_m[i];
                        let value = intensity[i] * to_reflectance;
                        let value = if value > 0.0 { value } else { 0.0 };
                        *reflectance = if value < 1.0 { value } else { 1.0 };
                        if let Some(label) = label {
                            *class = classes.get((label[i] & 0xffff) as usize).copied().unwrap_or(0);
                        }
                    }
                }
            }
        }
        let seen = |row: &&[u32]| row.iter().any(|winner| *winner != NO_PIXEL);
        self.selected.chunks(columns + GAP).filter(seen).count()
    }

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
        // Every point is moved and written, and the next one over it if its ray is not kept: a branch would not be foreseen, for a model's
        // drops follow no pattern.
        let points = cloud.len();
        self.selected.resize(points, 0);
        for values in [&mut out.x, &mut out.y, &mut out.z, &mut out.intensity] {
            values.resize(points, 0.0);
        }
        let places = cloud.x.iter().zip(&cloud.y).zip(&cloud.z);
        let mut kept = 0;
        for ((i, pixel), ((x, y), z)) in (0..).zip(&self.pixel_of_point).zip(places) {
            let pixel = *pixel as usize;
            let Some(simulated_m) = self.image.range_m.get(pixel) else { continue };
            let measured_m = measured.range_m[pixel];
            let stretch = measured_m / simulated_m;
            (out.x[kept], out.y[kept], out.z[kept]) = (x * stretch, y * stretch, z * stretch);
            out.intensity[kept] = measured.reflectance[pixel] * cloud.full_scale;
            self.selected[kept] = i;
            kept += usize::from(measured.keep[pixel]) & usize::from(measured_m > 0.0);
        }
        for values in [&mut out.x, &mut out.y, &mut out.z, &mut out.intensity] {
            values.truncate(kept);
        }
        self.selected.truncate(kept);
        out.select_rest_from(cloud, &self.selected);
    }
}

/// True if point `i` takes the pixel from point `j`: the nearer one does; of two at one range the brighter, of those the one with the
/// higher label, of those the first. So the image does not depend on the order of the points.
fn nearer(cloud: &PointCloud, range_m: &[f32], i: usize, j: usize) -> bool {
    if range_m[i] != range_m[j] {
        return range_m[i] < range_m[j];
    }
    let label = |k: usize| cloud.label.as_ref().map_or(0, |label| label[k]);
    cloud.intensity[j].total_cmp(&cloud.intensity[i]).then(label(j).cmp(&label(i))).then(i.cmp(&j)).is_lt()
}
