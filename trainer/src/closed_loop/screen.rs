//! How the residual depends on what is known of each ray.

/// A screening; see [`Outcome`](super::outcome::Outcome).
#[derive(Clone, Debug, Default)]
pub struct Screening {}
