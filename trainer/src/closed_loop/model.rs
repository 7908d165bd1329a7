//! A sensor model: a noise floor and the effects behind it, with their parameters.

use std::ops::Range;
use std::sync::Arc;

use burn::tensor::{Tensor, s};

use crate::effects::{Channel, Effect, Evidence, Image, Kind, NoiseFloor, Parameter, Values};

/// An effect with the values of its parameters.
#[derive(Clone, Debug)]
pub struct Term {
    /// The effect.
    pub effect: Arc<dyn Effect>,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// Their values in a fit's units, all in a row: see [`Term::physical`].
    pub fitted: Vec<f64>,
    rings: usize,
}

/// A noise floor and effects.
#[derive(Clone, Debug)]
pub struct SensorModel {
    /// The noise floor first, then the effects in the order in which they were added.
    pub terms: Vec<Term>,
}

impl Term {
    /// An effect at the start of its parameters.
    pub fn new(effect: Arc<dyn Effect>, rings: usize) -> Self {
        let parameters = effect.parameters();
        let n = parameters.iter().map(|p| p.len(rings)).sum();
        Self { effect, parameters, fitted: vec![0.0; n], rings }
    }

    /// The same with these physical values, all in a row.
    ///
    /// # Panics
    /// If there are not as many as the effect has.
    #[must_use]
    pub fn at(mut self, physical: &[f64]) -> Self {
        assert_eq!(physical.len(), self.fitted.len(), "numbers of effect {}", self.name());
        for (parameter, range) in self.layout() {
            let start = parameter.kind.to_line(parameter.start);
            for i in range {
                self.fitted[i] = (parameter.kind.to_line(physical[i]) - start) / parameter.scale;
            }
        }
        self
    }

    /// How many rings the sensor has.
    pub fn rings(&self) -> usize {
        self.rings
    }

    /// Name of the effect.
    pub fn name(&self) -> &'static str {
        self.effect.about().name
    }

    /// Each parameter and where its numbers stand.
    pub fn layout(&self) -> Vec<(Parameter, Range<usize>)> {
        let mut from = 0;
        let place = |p: &Parameter| {
            let range = from..from + p.len(self.rings);
            from = range.end;
            (*p, range)
        };
        self.parameters.iter().map(place).collect()
    }

    /// The physical values.
    pub fn physical(&self) -> Vec<f64> {
        let mut out = Vec::with_capacity(self.fitted.len());
        for (parameter, range) in self.layout() {
            let start = parameter.kind.to_line(parameter.start);
            out.extend(range.map(|i| parameter.kind.from_line(start + parameter.scale * self.fitted[i])));
        }
        out
    }

    /// Standard errors of the physical values, from those of the fit's.
    pub fn physical_stderr(&self, stderr: &[f64]) -> Vec<f64> {
        let mut out = Vec::with_capacity(stderr.len());
        for (parameter, range) in self.layout() {
            let start = parameter.kind.to_line(parameter.start);
            out.extend(range.map(|i| match parameter.kind {
                Kind::Found => parameter.scale,
                kind => parameter.scale * kind.slope(start + parameter.scale * self.fitted[i]) * stderr[i],
            }));
        }
        out
    }

    /// The values as tensors, from the fit's numbers in a row.
    pub fn values(&self, fitted: &Tensor<1>) -> Values {
        let value = |(parameter, range): (Parameter, Range<usize>)| {
            let line = fitted.clone().slice(s![range.start as i64..range.end as i64]) * parameter.scale;
            parameter.kind.tensor_from_line(line + parameter.kind.to_line(parameter.start))
        };
        Values::new(self.layout().into_iter().map(value).collect())
    }

    /// The effect on an image, with the values that it has.
    pub fn forward(&self, image: Image) -> Image {
        let fitted: Vec<f32> = self.fitted.iter().map(|x| *x as f32).collect();
        let values = self.values(&Tensor::from_floats(fitted.as_slice(), &image.device()));
        self.effect.forward(&values, image)
    }

    /// Whether it moves rays.
    pub fn is_geometric(&self) -> bool {
        self.effect.about().channel == Channel::Geometry
    }
}

impl SensorModel {
    /// A noise floor alone.
    pub fn ideal(rings: usize) -> Self {
        Self { terms: vec![Term::new(Arc::new(NoiseFloor), rings)] }
    }

    /// The same model with the noise that evidence of it shows: where a fit of the noise floor should start.
    #[must_use]
    pub fn with_noise_of(mut self, evidence: &Evidence) -> Self {
        if let Some(start) = self.terms[0].effect.starts(evidence).first() {
            self.terms[0] = self.terms[0].clone().at(start);
        }
        self
    }

    /// The effects, without the noise floor.
    pub fn effects(&self) -> &[Term] {
        &self.terms[1..]
    }

    /// The same model with these terms: those that it has, known by their names, take the new values; the others are added.
    #[must_use]
    pub fn with(&self, terms: &[Term]) -> Self {
        let mut model = self.clone();
        for term in terms {
            match model.terms.iter_mut().find(|t| t.name() == term.name()) {
                Some(place) => *place = term.clone(),
                None => model.terms.push(term.clone()),
            }
        }
        model
    }

    /// The same model without an effect.
    #[must_use]
    pub fn without(&self, name: &str) -> Self {
        Self { terms: self.terms.iter().filter(|t| t.name() != name).cloned().collect() }
    }

    /// Whether an effect of this name is there.
    pub fn has(&self, name: &str) -> bool {
        self.effects().iter().any(|term| term.name() == name)
    }

    /// Whether any of its effects moves rays.
    pub fn moves_rays(&self) -> bool {
        self.terms.iter().any(Term::is_geometric)
    }

    /// The image that the sensor has: moved rays first, then everything that happens to their returns.
    pub fn forward(&self, image: Image) -> Image {
        self.forward_with(image, &|term, image| term.forward(image), None)
    }

    /// The same with a say in how each term acts; `last`, if any, is one more effect, after its like.
    pub fn forward_with(&self, image: Image, act: &dyn Fn(&Term, Image) -> Image, last: Option<&Term>) -> Image {
        let (moving, other): (Vec<&Term>, Vec<&Term>) = self.terms.iter().chain(last).partition(|t| t.is_geometric());
        let image = moving.into_iter().fold(image, |image, term| act(term, image)).resample();
        other.into_iter().fold(image, |image, term| act(term, image))
    }
}
