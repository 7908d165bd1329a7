//! Where fits may look for their starts.

use burn::tensor::Tensor;

use super::data::Batch;
use super::model::SensorModel;
use super::predicted::numbers;
use crate::effects::Evidence;

/// What the model predicts and what was measured, side by side.
pub fn evidence(model: &SensorModel, batches: &[&Batch]) -> Evidence {
    let mut out = Evidence::default();
    for batch in batches {
        let image = model.forward(batch.image.clone());
        let [frames, rings, columns] = batch.observed.range_m.dims();
        (out.rings, out.columns) = (rings, columns);
        out.elevation_rad =
            numbers(&image.rays.elevation_rad, image.rays.elevation_rad.dims()).into_iter().map(f64::from).collect();
        let full = |x: &Tensor<3>| numbers(x, [frames, rings, columns]);
        let hit = image.surface.hit.clone();
        out.range_m.extend(full(&(image.report.range_m.clone() * hit)));
        out.reflectance.extend(full(&image.report.reflectance));
        out.surface_reflectance.extend(full(&image.surface.reflectance));
        out.cos_incidence.extend(full(&image.surface.cos_incidence));
        out.class.extend(full(&image.surface.class));
        out.reported.extend(full(&image.reported()));
        out.measured_range_m.extend(full(&batch.observed.range_m));
        out.measured_reflectance.extend(full(&batch.observed.reflectance));
    }
    out
}
