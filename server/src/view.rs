//! A scan before and after, point by point or as a picture: what a person looks at.

use lidar::label::class_of;
use lidar::picture::{self, PictureError};
use lidar::projection::NO_PIXEL;
use lidar::{Measured, PointCloud, Projection, RangeImage};
use serde::Serialize;

use crate::model::Model;
use crate::pipeline::{Fit, ScanError};

/// Points that are listed as JSON at most.
pub(crate) const MAX_LISTED: usize = 10_000;

/// A scan that has gone its way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View<'a> {
    /// The scan as it came, in the sender's frame.
    pub(crate) simulated: &'a PointCloud,
    /// The scan as the sensor reports it, in the sender's frame.
    pub(crate) realistic: &'a PointCloud,
    pub(crate) projection: &'a Projection,
    pub(crate) measured: Measured<'a>,
    pub(crate) fit: &'a Fit,
}

/// What became of a point.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum Fate {
    /// It is in the answer.
    Kept,
    /// The sensor does not report its ray.
    Dropped,
    /// It has no ray: a nearer point has it, or the point is out of the sensor's range or view, or no point at all.
    Unseen,
    /// The answer has it on a ray where the scan has none.
    Added,
}

/// A point before and after.
#[derive(Clone, Copy, Debug, Serialize)]
struct Point {
    fate: Fate,
    /// Place in the range image; the first ring is the model's first, the middle column looks ahead.
    ring: Option<usize>,
    column: Option<usize>,
    label: Option<u32>,
    before: Option<Return>,
    after: Option<Return>,
}

/// What a sensor reports of a point; numbers that are none are `null` in JSON.
#[derive(Clone, Copy, Debug, Serialize)]
struct Return {
    x: f32,
    y: f32,
    z: f32,
    range_m: f32,
    /// 0–1.
    reflectance: f32,
}

/// The JSON; its numbers are those of the answer's headers.
#[derive(Debug, Serialize)]
struct Listing<'a> {
    model: &'a str,
    model_version: Option<u64>,
    model_digest: String,
    seed: u64,
    points_in: usize,
    points_kept: usize,
    points_added: usize,
    points_dropped: usize,
    points_lost: usize,
    points_invalid: usize,
    points_out_of_range: usize,
    grid_coverage: f64,
    warning: Option<&'a str>,
    points: Vec<Point>,
}

/// Refuses to list more than [`MAX_LISTED`] points.
pub(crate) fn check_listed(points: usize) -> Result<(), ScanError> {
    if points > MAX_LISTED { Err(ScanError::TooManyToList { points }) } else { Ok(()) }
}

impl View<'_> {
    /// Range and reflectance, before and after beside each other, as PNG.
    pub(crate) fn picture(&self) -> Result<Vec<u8>, PictureError> {
        let before = &self.projection.image;
        let kept =
            |values: &[f32]| values.iter().zip(self.measured.keep).map(|(v, k)| if *k { *v } else { 0.0 }).collect();
        let (range_m, reflectance) = (kept(self.measured.range_m), kept(self.measured.reflectance));
        let after = RangeImage::from_channels(before.columns(), range_m, reflectance, before.class().to_vec());
        picture::beside(&[(before, "range, simulated"), (&after, "range, as the sensor reports it")])
    }

    /// Every point of the scan in its order, then those that the answer adds.
    pub(crate) fn json(&self, model: &Model, seed: u64) -> Result<Vec<u8>, ScanError> {
        check_listed(self.simulated.len() + self.fit.added)?;
        let listing = Listing {
            model: &model.name,
            model_version: model.version,
            model_digest: format!("sha256:{}", model.digest),
            seed,
            points_in: self.fit.report.points_in,
            points_kept: self.fit.kept,
            points_added: self.fit.added,
            points_dropped: self.fit.dropped(),
            points_lost: self.fit.report.lost,
            points_invalid: self.fit.invalid(),
            points_out_of_range: self.fit.out_of_range(),
            grid_coverage: self.fit.coverage.rings,
            warning: self.fit.warning.as_deref(),
            points: self.points().collect(),
        };
        // Nothing in it can fail to be JSON.
        Ok(serde_json::to_vec(&listing).unwrap_or_default())
    }

    /// The same points, ten little-endian float32 each: x, y, z and reflectance before (an added point's are its place after and 0), range
    /// in m and reflectance after (0 where the answer has it not), ring, column (−1 without a pixel), class of the learning map, and fate:
    /// 0 kept, 1 dropped, 2 unseen, 3 added.
    pub(crate) fn records(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(40 * (self.simulated.len() + self.fit.added));
        for point in self.points() {
            let Some(place) = point.before.or(point.after) else { continue };
            let index = |index: Option<usize>| index.map_or(-1.0, |index| index as f32);
            let record = [
                place.x,
                place.y,
                place.z,
                point.before.map_or(0.0, |before| before.reflectance),
                point.after.map_or(0.0, |after| after.range_m),
                point.after.map_or(0.0, |after| after.reflectance),
                index(point.ring),
                index(point.column),
                point.label.map_or(0.0, |label| f32::from(class_of(label))),
                f32::from(point.fate as u8),
            ];
            bytes.extend(record.into_iter().flat_map(f32::to_le_bytes));
        }
        bytes
    }

    fn points(&self) -> impl Iterator<Item = Point> {
        let (image, keep) = (&self.projection.image, self.measured.keep);
        let place = move |pixel: usize| (Some(pixel / image.columns()), Some(pixel % image.columns()));
        let mut reported = 0;
        let simulated = self.projection.pixel_of_point.iter().enumerate().map(move |(i, pixel)| {
            let pixel = (*pixel != NO_PIXEL).then_some(*pixel as usize);
            let fate = match pixel {
                None => Fate::Unseen,
                Some(pixel) if keep[pixel] => Fate::Kept,
                Some(_) => Fate::Dropped,
            };
            let after = matches!(fate, Fate::Kept).then(|| Return::of(self.realistic, reported));
            reported += usize::from(after.is_some());
            let (ring, column) = pixel.map_or((None, None), place);
            let label = self.simulated.label.as_ref().map(|label| label[i]);
            Point { fate, ring, column, label, before: Some(Return::of(self.simulated, i)), after }
        });
        // Added ones follow the kept ones, in the order of their pixels.
        let empty = (0..keep.len()).filter(move |pixel| keep[*pixel] && image.range_m()[*pixel] <= 0.0);
        let added = empty.zip(self.fit.kept..self.realistic.len()).map(move |(pixel, k)| {
            let (ring, column) = place(pixel);
            let after = Some(Return::of(self.realistic, k));
            Point { fate: Fate::Added, ring, column, label: None, before: None, after }
        });
        simulated.chain(added)
    }
}

impl Return {
    fn of(cloud: &PointCloud, i: usize) -> Self {
        let reflectance = (cloud.intensity[i] / cloud.full_scale).clamp(0.0, 1.0);
        Self { x: cloud.x[i], y: cloud.y[i], z: cloud.z[i], range_m: cloud.range_m(i), reflectance }
    }
}
