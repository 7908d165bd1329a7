//! Simulated and measured pixels side by side, from which an effect may guess where its fit should start.

/// About so many pixels are enough to compare candidates by.
const LOOKED_AT: usize = 20_000;

/// Pixels of several scans, each list `[scan, ring, column]`, row-major.
#[derive(Clone, Debug, Default)]
pub struct Evidence {
    /// Number of rings.
    pub rings: usize,
    /// Number of columns.
    pub columns: usize,
    /// Elevation of each ring in radians.
    pub elevation_rad: Vec<f64>,
    /// Range that the current model predicts, in m; 0 where it hits nothing.
    pub range_m: Vec<f32>,
    /// Reflectance that the current model predicts.
    pub reflectance: Vec<f32>,
    /// Reflectance of the surface in the simulation.
    pub surface_reflectance: Vec<f32>,
    /// Cosine of the incidence angle.
    pub cos_incidence: Vec<f32>,
    /// Class index.
    pub class: Vec<f32>,
    /// Probability with which the current model reports the ray.
    pub reported: Vec<f32>,
    /// Measured range in m; 0 where there is no return.
    pub measured_range_m: Vec<f32>,
    /// Measured reflectance.
    pub measured_reflectance: Vec<f32>,
}

impl Evidence {
    /// Numbers of the pixels.
    pub fn pixels(&self) -> std::ops::Range<usize> {
        0..self.range_m.len()
    }

    /// Whether a pixel has a return.
    pub fn returned(&self, pixel: usize) -> bool {
        self.measured_range_m[pixel] > 0.0
    }

    /// The candidate under which it is likeliest which rays are reported, if `keep` is the probability that it leaves to a pixel that the
    /// current model reports. The model's base rate is matched to each candidate, for the model has been fitted without it.
    pub fn likeliest(
        &self,
        candidates: impl IntoIterator<Item = Vec<f64>>,
        keep: impl Fn(&[f64], usize) -> f64,
    ) -> Option<Vec<f64>> {
        let every = (self.range_m.len() / LOOKED_AT).max(1);
        let pixels: Vec<usize> = self.pixels().step_by(every).filter(|i| self.reported[*i] > 0.01).collect();
        let returns = pixels.iter().filter(|i| self.returned(**i)).count() as f64;
        let log_likelihood = |candidate: &Vec<f64>| {
            let kept: Vec<f64> = pixels.iter().map(|i| f64::from(self.reported[*i]) * keep(candidate, *i)).collect();
            let base = returns / kept.iter().sum::<f64>().max(1e-9);
            let of = |(i, kept): (&usize, &f64)| {
                let p = (base * kept).clamp(1e-4, 1.0 - 1e-4);
                if self.returned(*i) { p.ln() } else { (1.0 - p).ln() }
            };
            pixels.iter().zip(&kept).map(of).sum::<f64>()
        };
        candidates
            .into_iter()
            .map(|candidate| (log_likelihood(&candidate), candidate))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, candidate)| candidate)
    }

    /// The value below which the share `q` of the values lies; `None` if there are none.
    pub fn quantile(values: impl IntoIterator<Item = f32>, q: f64) -> Option<f64> {
        let mut values: Vec<f32> = values.into_iter().filter(|v| v.is_finite()).collect();
        if values.is_empty() {
            return None;
        }
        let at = ((values.len() - 1) as f64 * q.clamp(0.0, 1.0)).round() as usize;
        let (_, value, _) = values.select_nth_unstable_by(at, f32::total_cmp);
        Some(f64::from(*value))
    }
}
