//! One scan drawn from the distribution of what the sensor reports, inside the graph.

use burn::tensor::Tensor;

use super::image::Image;

/// Uniform numbers that [`Image::draw`] wants for each ray: range noise, reflectance noise, which return it is, and where
/// it is or how it strays from a step or a maximum.
pub const NOISE_CHANNELS: usize = 4;

/// A drawn scan, `[batch, ring, column]`.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// Range in m.
    pub range_m: Tensor<3>,
    /// Reflectance, 0–1.
    pub reflectance: Tensor<3>,
    /// Probability that the ray is reported; whoever draws the scan decides by it.
    pub keep: Tensor<3>,
}

impl Image {
    /// Draws what each ray reports if it reports anything, from independent uniform numbers; ½ throughout gives the median. Outliers,
    /// which stand for what a model cannot explain, are never drawn.
    pub fn draw(self, noise: [Tensor<3>; NOISE_CHANNELS]) -> Drawn {
        let [range_noise, reflectance_noise, which, place] = noise;
        let report = &self.report;
        let keep = self.reported();
        let mut range_m = report.range_m.clone() + normal(range_noise) * report.range_sigma_m.clone();
        let (sigma, like) = (&report.reflectance_sigma, range_m.zeros_like());
        let mut reflectance = report.reflectance.clone() + normal(reflectance_noise.clone()) * sigma.clone();
        if let Some(other) = &self.other_angle {
            let [mean, sigma] = other.reflectance(&report.reflectance, sigma);
            let comes = which.clone().lower(like.clone() + other.share.clone());
            reflectance = reflectance.mask_where(comes, mean + normal(reflectance_noise) * sigma);
        }
        if let (Some(other), Some(beside)) = (&self.other, self.beside()) {
            let passed = place.clone().greater(beside * -1.0 + 1.0).float();
            range_m = range_m + (other.surface.range_m.clone() - self.surface.range_m.clone()) * passed.clone();
            reflectance = reflectance + (other.surface.reflectance.clone() - self.surface.reflectance.clone()) * passed;
        }
        if let Some(ceiling) = &self.ceiling {
            let scatter = normal(place.clone()) * ceiling.scatter.clone();
            reflectance = reflectance.min_pair(like.clone() + ceiling.maximum.clone()) + scatter;
        }
        let mut left = place.clone();
        for mixed in &self.mixed {
            let share = left.clone() / mixed.probability.clone().clamp_min(1e-9);
            let between = mixed.near_m.clone() + share.clone() * (mixed.far_m.clone() - mixed.near_m.clone());
            let comes = share.clone().lower_elem(1.0).bool_and(share.greater_equal_elem(0.0));
            range_m = range_m.mask_where(comes, between + self.range_error_m());
            left = left - mixed.probability.clone();
        }
        // Extra returns replace the surface's, the later ones the earlier: `which` is used up from above.
        let which = which * keep.clone();
        let (mut above, mut none) = (keep.clone(), like.clone() + 1.0);
        for extra in self.extra.iter().rev() {
            let below = above.clone() - none.clone() * extra.probability.clone();
            let come = which.clone().greater_equal(below.clone()).bool_and(which.clone().lower(above));
            range_m = range_m.mask_where(come.clone(), like.clone() + extra.place.draw(place.clone()));
            reflectance = reflectance.mask_where(come, like.clone() + extra.reflectance.clone());
            (above, none) = (below, none * (extra.probability.clone() * -1.0 + 1.0));
        }
        if let Some(quantum) = &self.quantum {
            let tooth = normal(place) * quantum.tooth_m.clone();
            range_m = (range_m / quantum.step_m.clone()).round() * quantum.step_m.clone() + tooth;
        }
        Drawn { range_m: range_m.clamp_min(0.0), reflectance: reflectance.clamp(0.0, 1.0), keep }
    }
}

/// The standard normal quantile of `u` in [0, 1): 0 at ½, so that noise of ½ everywhere draws the median.
///
/// √2·erf⁻¹(2u − 1) by the single-precision polynomials of Giles, "Approximating the erfinv function" (GPU Computing Gems, 2011).
pub fn normal(u: Tensor<3>) -> Tensor<3> {
    let x = (u * 2.0 - 1.0).clamp(-0.999_999, 0.999_999);
    let w = ((x.clone() * -1.0 + 1.0) * (x.clone() + 1.0)).log() * -1.0;
    let centre = horner(
        &(w.clone() - 2.5),
        &[
            2.810_226_36e-8,
            3.432_739_39e-7,
            -3.523_387_7e-6,
            -4.391_506_54e-6,
            2.185_808_7e-4,
            -1.253_725_03e-3,
            -4.177_681_64e-3,
            2.466_407_27e-1,
            1.501_409_41,
        ],
    );
    let tail = horner(
        &(w.clone().clamp_min(1e-6).sqrt() - 3.0),
        &[
            -2.002_142_57e-4,
            1.009_505_58e-4,
            1.349_343_22e-3,
            -3.673_428_44e-3,
            5.739_507_73e-3,
            -7.622_461_3e-3,
            9.438_870_47e-3,
            1.001_674_06,
            2.832_976_82,
        ],
    );
    centre.mask_where(w.greater_equal_elem(5.0), tail) * x * std::f64::consts::SQRT_2
}

/// Standard normal distribution function.
pub(crate) fn cumulative(z: &Tensor<3>) -> Tensor<3> {
    (z.clone() * std::f64::consts::FRAC_1_SQRT_2).erf() * 0.5 + 0.5
}

fn horner(w: &Tensor<3>, coefficients: &[f64]) -> Tensor<3> {
    let first = w.clone() * 0.0 + coefficients[0];
    coefficients[1..].iter().fold(first, |sum, c| sum * w.clone() + *c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    #[test]
    fn quantiles_of_the_normal_distribution_come_out() {
        let u = [0.5, 0.841_344_75, 0.158_655_25, 0.977_249_87, 0.999, 0.001];
        let expected = [0.0, 1.0, -1.0, 2.0, 3.090_232, -3.090_232];
        let drawn = normal(Tensor::<1>::from_floats(u, &Device::flex()).reshape([1, 1, 6]));
        for (drawn, expected) in drawn.into_data().iter::<f32>().zip(expected) {
            assert!((drawn - expected).abs() < 3e-4, "{drawn} for {expected}");
        }
    }
}
