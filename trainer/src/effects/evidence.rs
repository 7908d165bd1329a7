//! Simulated and measured pixels side by side, from which an effect may guess where its fit should start.

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
