//! Finds normalisations over space that Burn records operation by operation, so that each becomes one
//! `InstanceNormalization`.

use std::collections::{HashMap, HashSet};

use burn::backend::capture::TensorId;
use burn::backend::ir::{BaseOperationIr, FloatOperationIr, NumericOperationIr as Numeric, OperationIr, TensorIr};

/// One normalisation: `(x − mean) / √(variance + ε)`, over all but the first two axes.
#[derive(Clone)]
pub(crate) struct Norm {
    /// What is normalised: `[batch, group, …]`.
    pub(crate) input: TensorIr,
    /// Scale and offset for each group; without them 1 and 0.
    pub(crate) affine: Option<(TensorIr, TensorIr)>,
    /// ε.
    pub(crate) epsilon: f32,
}

/// The normalisations of a trace, by the operation that completes them.
#[derive(Default)]
pub(crate) struct Norms {
    pub(crate) at: HashMap<usize, Norm>,
    /// Tensors within a normalisation, which its ONNX node leaves without a value.
    pub(crate) within: HashSet<TensorId>,
}

impl Norms {
    /// Searches a trace. Burn's `GroupNorm` and `InstanceNorm` reshape to `[batch, group, rest]`, normalise the last axis,
    /// reshape back, and scale and shift by reshaped parameters; where the groups are the channels all of it is one norm.
    pub(crate) fn find(operations: &[OperationIr]) -> Self {
        let mut found = Self::default();
        let definitions = Definitions::new(operations);
        for (index, operation) in operations.iter().enumerate() {
            if let Some(norm) = definitions.core(operation, &mut found.within) {
                found.at.insert(index, norm);
            } else if let Some(norm) = definitions.affine(operation, &found) {
                found.at.insert(index, norm);
            }
        }
        found
    }
}

/// Which operation defines a tensor.
struct Definitions<'a> {
    operations: &'a [OperationIr],
    at: HashMap<TensorId, usize>,
}

impl<'a> Definitions<'a> {
    fn new(operations: &'a [OperationIr]) -> Self {
        let outputs =
            |(index, operation): (usize, &'a OperationIr)| operation.outputs().map(move |out| (out.id, index));
        Self { operations, at: operations.iter().enumerate().flat_map(outputs).collect() }
    }

    fn of(&self, tensor: &TensorIr) -> Option<&'a OperationIr> {
        self.at.get(&tensor.id).map(|index| &self.operations[*index])
    }

    fn numeric(&self, tensor: &TensorIr) -> Option<&'a Numeric> {
        match self.of(tensor)? {
            OperationIr::NumericFloat(_, numeric) => Some(numeric),
            _ => None,
        }
    }

    /// `(r − mean(r)) / √(mean((r − mean(r))²) + ε)` over the last of three axes.
    fn core(&self, operation: &OperationIr, within: &mut HashSet<TensorId>) -> Option<Norm> {
        let OperationIr::NumericFloat(_, Numeric::Div(div)) = operation else { return None };
        let OperationIr::Float(_, FloatOperationIr::Sqrt(root)) = self.of(&div.rhs)? else { return None };
        let Numeric::AddScalar(variance) = self.numeric(&root.input)? else { return None };
        let Numeric::MeanDim(mean_square) = self.numeric(&variance.lhs)? else { return None };
        let centred = match self.numeric(&mean_square.input)? {
            Numeric::Mul(square) if square.lhs.id == square.rhs.id => &square.lhs,
            Numeric::PowiScalar(square) if square.rhs.elem::<f64>() == 2.0 => &square.lhs,
            _ => return None,
        };
        let Numeric::Sub(sub) = self.numeric(centred)? else { return None };
        let Numeric::MeanDim(mean) = self.numeric(&sub.rhs)? else { return None };
        let one_input = centred.id == div.lhs.id && mean.input.id == sub.lhs.id;
        let last_of_three = sub.lhs.shape.num_dims() == 3 && mean.axis == 2 && mean_square.axis == 2;
        if !one_input || !last_of_three {
            return None;
        }
        within.extend(
            [&div.rhs, &root.input, &variance.lhs, &mean_square.input, centred, &sub.rhs].map(|tensor| tensor.id),
        );
        Some(Norm { input: sub.lhs.clone(), affine: None, epsilon: variance.rhs.elem() })
    }

    /// `reshape(norm(reshape(x))) · reshape(γ) + reshape(β)` with one γ and β for each channel of x.
    fn affine(&self, operation: &OperationIr, found: &Norms) -> Option<Norm> {
        let OperationIr::NumericFloat(_, Numeric::Add(add)) = operation else { return None };
        let Numeric::Mul(mul) = self.numeric(&add.lhs)? else { return None };
        let normalised = self.reshaped(&mul.lhs)?;
        let norm = found.at.get(self.at.get(&normalised.id)?)?;
        let x = self.reshaped(&norm.input)?;
        let channels = norm.input.shape[1];
        let per_channel = |tensor: &TensorIr| {
            let vector = self.reshaped(tensor)?;
            let on_channels = tensor.shape.num_dims() == x.shape.num_dims() && tensor.shape[1] == channels;
            (on_channels && vector.shape.num_dims() == 1 && vector.shape[0] == channels).then(|| vector.clone())
        };
        let whole =
            norm.affine.is_none() && x.shape.num_dims() > 2 && x.shape[1] == channels && x.shape == mul.lhs.shape;
        let affine = (per_channel(&mul.rhs)?, per_channel(&add.rhs)?);
        whole.then(|| Norm { input: x.clone(), affine: Some(affine), epsilon: norm.epsilon })
    }

    /// What `tensor` is a reshape of.
    fn reshaped(&self, tensor: &TensorIr) -> Option<&'a TensorIr> {
        match self.of(tensor)? {
            OperationIr::BaseFloat(BaseOperationIr::Reshape(reshape)) => Some(&reshape.input),
            _ => None,
        }
    }
}
