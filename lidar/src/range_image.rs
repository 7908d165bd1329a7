//! A range image: what every ray of a sensor's turn measured, `[ring, column]`.

use crate::cloud::PointCloud;
use crate::label::CLASS_IDS;
use crate::sensor::Sensor;

/// Ranges, reflectances and classes of one scan, each `[ring, column]`, row-major. A range of 0 is the one spelling of "no return";
/// where there is none, reflectance and class are 0 too.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RangeImage {
    rings: usize,
    columns: usize,
    pub(crate) range_m: Vec<f32>,
    pub(crate) reflectance: Vec<f32>,
    pub(crate) class: Vec<u8>,
}

impl RangeImage {
    /// An image without a return.
    pub fn empty(rings: usize, columns: usize) -> Self {
        let mut image = Self::default();
        image.clear(rings, columns);
        image
    }

    /// An image of these ranges (m, `[ring, column]`, 0 = no return), reflectances (0–1) and classes.
    ///
    /// Ranges that are not finite and positive become "no return".
    ///
    /// # Panics
    /// If the three differ in length or do not fill `columns`.
    pub fn from_channels(columns: usize, range_m: Vec<f32>, reflectance: Vec<f32>, class: Vec<u8>) -> Self {
        assert!(columns > 0 && range_m.len().is_multiple_of(columns), "{} pixels in {columns} columns", range_m.len());
        assert!(range_m.len() == reflectance.len() && range_m.len() == class.len(), "channels of one length");
        let mut image = Self { rings: range_m.len() / columns, columns, range_m, reflectance, class };
        for i in 0..image.range_m.len() {
            if !(image.range_m[i].is_finite() && image.range_m[i] > 0.0) {
                image.remove(i);
            }
        }
        image
    }

    /// Empties the image and gives it this size, reusing its memory.
    pub fn clear(&mut self, rings: usize, columns: usize) {
        self.range_m.clear();
        self.reflectance.clear();
        self.class.clear();
        self.reshape(rings, columns);
    }

    /// Gives the image this size, reusing its memory; whoever calls it sets every pixel, for those that there were stay.
    pub(crate) fn reshape(&mut self, rings: usize, columns: usize) {
        (self.rings, self.columns) = (rings, columns);
        let pixels = rings * columns;
        self.range_m.resize(pixels, 0.0);
        self.reflectance.resize(pixels, 0.0);
        self.class.resize(pixels, 0);
    }

    /// Number of rings (rows).
    pub fn rings(&self) -> usize {
        self.rings
    }

    /// Number of columns of a whole turn.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Ranges in metres, 0 where there is no return.
    pub fn range_m(&self) -> &[f32] {
        &self.range_m
    }

    /// Reflectances, 0–1.
    pub fn reflectance(&self) -> &[f32] {
        &self.reflectance
    }

    /// Classes of the learning map (see [`class_of`](crate::label::class_of)), 0 = unlabelled.
    pub fn class(&self) -> &[u8] {
        &self.class
    }

    /// Pixels with a return.
    pub fn returns(&self) -> usize {
        self.range_m.iter().filter(|r| **r > 0.0).count()
    }

    /// Makes pixel `i` one without a return.
    pub fn remove(&mut self, i: usize) {
        (self.range_m[i], self.reflectance[i], self.class[i]) = (0.0, 0.0, 0);
    }

    /// Sets pixel `i` to a return. `range_m` must be positive and finite.
    pub fn set(&mut self, i: usize, range_m: f32, reflectance: f32, class: u8) {
        debug_assert!(range_m > 0.0 && range_m.is_finite(), "range {range_m}");
        (self.range_m[i], self.reflectance[i], self.class[i]) = (range_m, reflectance, class);
    }

    /// Writes the model's input: range (m), reflectance and class index as one `[3, ring, column]` block.
    ///
    /// # Panics
    /// If `out` is not three images long.
    pub fn write_tensor(&self, out: &mut [f32]) {
        let pixels = self.range_m.len();
        assert_eq!(out.len(), 3 * pixels, "a [3, ring, column] block");
        out[..pixels].copy_from_slice(&self.range_m);
        out[pixels..2 * pixels].copy_from_slice(&self.reflectance);
        for (to, class) in out[2 * pixels..].iter_mut().zip(&self.class) {
            *to = f32::from(*class);
        }
    }

    /// The returns as points, each where the sensor's own ray of its pixel meets the measured range: a cloud from image and sensor
    /// alone. Ring and label are set, intensity is the reflectance.
    ///
    /// # Panics
    /// If the image has not the sensor's size.
    pub fn to_cloud(&self, sensor: &Sensor) -> PointCloud {
        assert_eq!(
            (self.rings, self.columns),
            (sensor.rings().len(), sensor.columns()),
            "an image of the sensor's size"
        );
        let mut cloud = PointCloud::new(1.0);
        let (mut rings, mut labels) = (Vec::new(), Vec::new());
        for ring in 0..self.rings {
            for column in 0..self.columns {
                let pixel = ring * self.columns + column;
                let range_m = f64::from(self.range_m[pixel]);
                if range_m > 0.0 {
                    let [x, y, z] = sensor.point_m(ring, column, range_m);
                    cloud.x.push(x as f32);
                    cloud.y.push(y as f32);
                    cloud.z.push(z as f32);
                    cloud.intensity.push(self.reflectance[pixel]);
                    rings.push(ring as u16);
                    labels.push(CLASS_IDS.get(usize::from(self.class[pixel])).copied().unwrap_or(0));
                }
            }
        }
        cloud.ring = Some(rings);
        cloud.label = Some(labels);
        cloud
    }

    /// The image on a coarser grid of columns: each coarse pixel takes the nearest return of the fine pixels whose centres it covers.
    #[must_use]
    pub fn resample_columns(&self, columns: usize) -> Self {
        let mut out = Self::empty(self.rings, columns);
        for ring in 0..self.rings {
            for column in 0..self.columns {
                let from = ring * self.columns + column;
                let range_m = self.range_m[from];
                let to = ring * columns + (2 * column + 1) * columns / (2 * self.columns);
                if range_m > 0.0 && (out.range_m[to] == 0.0 || range_m < out.range_m[to]) {
                    out.set(to, range_m, self.reflectance[from], self.class[from]);
                }
            }
        }
        out
    }

    /// The image on a coarser grid of columns: each coarse pixel takes the fine pixel in its middle, return or none, so that as many rays
    /// are lost as before.
    #[must_use]
    pub fn pick_columns(&self, columns: usize) -> Self {
        let mut out = Self::empty(self.rings, columns);
        for ring in 0..self.rings {
            for column in 0..columns {
                let from = ring * self.columns + (2 * column + 1) * self.columns / (2 * columns);
                if self.range_m[from] > 0.0 {
                    let (reflectance, class) = (self.reflectance[from], self.class[from]);
                    out.set(ring * columns + column, self.range_m[from], reflectance, class);
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coarser_grid_takes_the_nearest_return_of_what_it_covers() {
        let image = RangeImage::from_channels(4, vec![9.0, 5.0, 0.0, 7.0], vec![0.9, 0.5, 0.3, 0.7], vec![9, 5, 3, 7]);
        let coarse = image.resample_columns(2);
        assert_eq!(coarse.range_m(), [5.0, 7.0]);
        assert_eq!(coarse.reflectance(), [0.5, 0.7]);
        assert_eq!(image.resample_columns(4), image);
    }

    #[test]
    fn picked_columns_lose_as_many_rays_as_all() {
        let range_m = vec![9.0, 5.0, 0.0, 7.0, 0.0, 2.0];
        let image = RangeImage::from_channels(6, range_m, vec![0.5; 6], vec![3; 6]);
        assert_eq!(image.pick_columns(2).range_m(), [5.0, 0.0]);
        assert_eq!(image.pick_columns(3).range_m(), [5.0, 7.0, 2.0]);
        assert_eq!(image.pick_columns(6), image);
    }

    #[test]
    fn no_return_has_one_spelling() {
        let image =
            RangeImage::from_channels(5, vec![1.0, f32::NAN, -1.0, f32::INFINITY, 0.0], vec![0.5; 5], vec![3; 5]);
        assert_eq!(image.range_m(), [1.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(image.reflectance(), [0.5, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(image.returns(), 1);
    }
}
