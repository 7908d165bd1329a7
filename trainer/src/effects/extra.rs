//! Returns that come from no surface of the simulation.

use burn::tensor::Tensor;

/// A return that replaces what the ray would have measured, where it comes.
#[derive(Clone, Debug)]
pub struct Extra {
    /// Probability of one, a ray.
    pub probability: Tensor<3>,
    /// Where it is.
    pub place: Place,
    /// Its mean reflectance, for scans that are drawn; as a likelihood its reflectance says nothing.
    pub reflectance: Tensor<3>,
}

/// Distribution of an extra return's range.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a handful exist at a time, each beside tensors of megabytes")]
pub enum Place {
    /// Uniform between two ranges, in m.
    Uniform {
        /// The nearer end.
        from_m: Tensor<3>,
        /// The farther end.
        to_m: Tensor<3>,
    },
    /// Normal around a range, in m.
    At {
        /// The range.
        range_m: Tensor<3>,
        /// Its standard deviation.
        sigma_m: Tensor<3>,
    },
    /// Exponentially ever rarer from a nearest range on, cut off at a farthest, in m.
    Exponential {
        /// The nearest range.
        from_m: Tensor<3>,
        /// The range over which it falls by e.
        scale_m: Tensor<3>,
        /// The farthest range.
        to_m: Tensor<3>,
    },
}

impl Place {
    /// Probability density at a range, per metre.
    pub fn density(&self, range_m: &Tensor<3>) -> Tensor<3> {
        match self {
            Self::Uniform { from_m, to_m } => {
                let width = (to_m.clone() - from_m.clone()).clamp_min(1e-3);
                inside(range_m, from_m, to_m) / width
            }
            Self::At { range_m: at, sigma_m } => {
                let z = (range_m.clone() - at.clone()) / sigma_m.clone();
                (z.square() * -0.5).exp() / (sigma_m.clone() * (2.0 * std::f64::consts::PI).sqrt())
            }
            Self::Exponential { from_m, scale_m, to_m } => {
                let whole = ((from_m.clone() - to_m.clone()) / scale_m.clone()).exp() * -1.0 + 1.0;
                let density = ((from_m.clone() - range_m.clone()).clamp_max(0.0) / scale_m.clone()).exp();
                inside(range_m, from_m, to_m) * density / (scale_m.clone() * whole.clamp_min(1e-6))
            }
        }
    }

    /// The range at which the distribution function is `u`, `u` uniform in [0, 1): a draw.
    pub fn draw(&self, u: Tensor<3>) -> Tensor<3> {
        match self {
            Self::Uniform { from_m, to_m } => from_m.clone() + u * (to_m.clone() - from_m.clone()),
            Self::At { range_m, sigma_m } => range_m.clone() + super::draw::normal(u) * sigma_m.clone(),
            Self::Exponential { from_m, scale_m, to_m } => {
                let whole = ((from_m.clone() - to_m.clone()) / scale_m.clone()).exp() * -1.0 + 1.0;
                from_m.clone() - (u * whole * -1.0 + 1.0).clamp_min(1e-9).log() * scale_m.clone()
            }
        }
    }
}

fn inside(x: &Tensor<3>, from: &Tensor<3>, to: &Tensor<3>) -> Tensor<3> {
    let (from, to) = (x.clone() - from.clone(), to.clone() - x.clone());
    from.greater_equal_elem(0.0).float() * to.greater_equal_elem(0.0).float()
}
