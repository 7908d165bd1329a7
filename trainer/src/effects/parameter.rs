//! A number that a fit finds: its unit, where the fit starts, and how it may move.

use burn::tensor::Tensor;

/// What a parameter is and where its fit starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Name with unit, such as `offset_deg`.
    pub name: &'static str,
    /// One number for the sensor, or several.
    pub extent: Extent,
    /// How the fit moves it.
    pub kind: Kind,
    /// Where the fit starts: the value that leaves a scan as it is, or for positive numbers a small one.
    pub start: f64,
    /// Typical size of its deviation from the start (for [`Kind::Positive`] and [`Kind::Probability`], of the logarithm or logit): the
    /// fit's unit.
    pub scale: f64,
    /// Values that a sensor could have; a fit outside is no explanation.
    pub prior: (f64, f64),
}

/// How many numbers a parameter is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// One.
    One,
    /// One a ring.
    PerRing,
    /// This many, each of which acts on pixels of its own or shares them with its neighbours alone (the knots of a table).
    Knots(usize),
}

/// The transform through which a fit sees a parameter, so that it moves on the whole real line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Any number.
    Free,
    /// Above 0: fitted as its logarithm.
    Positive,
    /// Between 0 and 1: fitted as its logit.
    Probability,
    /// Any number, which only [`Effect::starts`](super::Effect::starts) can find, because the likelihood is flat but for a needle: a fit
    /// holds it, and [`Parameter::scale`] is its standard error.
    Found,
}

impl Parameter {
    /// A free number around 0.
    pub const fn free(name: &'static str, scale: f64, prior: (f64, f64)) -> Self {
        Self { name, extent: Extent::One, kind: Kind::Free, start: 0.0, scale, prior }
    }

    /// A positive number.
    pub const fn positive(name: &'static str, start: f64, prior: (f64, f64)) -> Self {
        Self { name, extent: Extent::One, kind: Kind::Positive, start, scale: 0.5, prior }
    }

    /// A probability.
    pub const fn probability(name: &'static str, start: f64, prior: (f64, f64)) -> Self {
        Self { name, extent: Extent::One, kind: Kind::Probability, start, scale: 0.5, prior }
    }

    /// A number that a search finds with this standard error, and no fit moves.
    pub const fn found(name: &'static str, start: f64, stderr: f64, prior: (f64, f64)) -> Self {
        Self { name, extent: Extent::One, kind: Kind::Found, start, scale: stderr, prior }
    }

    /// The same, one a ring.
    #[must_use]
    pub const fn per_ring(mut self) -> Self {
        self.extent = Extent::PerRing;
        self
    }

    /// The same, starting elsewhere.
    #[must_use]
    pub const fn from(mut self, start: f64) -> Self {
        self.start = start;
        self
    }

    /// How many numbers it is for a sensor of `rings` rings.
    pub fn len(&self, rings: usize) -> usize {
        match self.extent {
            Extent::One => 1,
            Extent::PerRing => rings,
            Extent::Knots(n) => n,
        }
    }
}

impl Kind {
    /// From the parameter's own values to the line that a fit moves on.
    pub fn to_line(self, value: f64) -> f64 {
        match self {
            Self::Free | Self::Found => value,
            Self::Positive => value.max(1e-12).ln(),
            Self::Probability => (value.clamp(1e-9, 1.0 - 1e-9) / (1.0 - value.clamp(1e-9, 1.0 - 1e-9))).ln(),
        }
    }

    /// The way back.
    pub fn from_line(self, line: f64) -> f64 {
        match self {
            Self::Free | Self::Found => line,
            Self::Positive => line.exp(),
            Self::Probability => 1.0 / (1.0 + (-line).exp()),
        }
    }

    /// Derivative of the way back: what turns a standard error on the line into one of the parameter.
    pub fn slope(self, line: f64) -> f64 {
        match self {
            Self::Free | Self::Found => 1.0,
            Self::Positive => line.exp(),
            Self::Probability => self.from_line(line) * (1.0 - self.from_line(line)),
        }
    }

    /// The way back, for a tensor.
    pub fn tensor_from_line(self, line: Tensor<1>) -> Tensor<1> {
        match self {
            Self::Free | Self::Found => line,
            Self::Positive => line.exp(),
            Self::Probability => burn::tensor::activation::sigmoid(line),
        }
    }
}

/// The values of an effect's parameters, one tensor a parameter in the order of its list.
#[derive(Clone, Debug)]
pub struct Values(Vec<Tensor<1>>);

impl Values {
    /// One tensor a parameter.
    pub fn new(values: Vec<Tensor<1>>) -> Self {
        Self(values)
    }

    /// Parameter `i`, one number: `[1, 1, 1]`.
    pub fn one(&self, i: usize) -> Tensor<3> {
        self.0[i].clone().reshape([1, 1, 1])
    }

    /// Parameter `i`, one number a ring: `[1, ring, 1]`.
    pub fn per_ring(&self, i: usize) -> Tensor<3> {
        let rings = self.0[i].dims()[0];
        self.0[i].clone().reshape([1, rings, 1])
    }

    /// Parameter `i` as it is: `[n]`.
    pub fn all(&self, i: usize) -> Tensor<1> {
        self.0[i].clone()
    }
}
