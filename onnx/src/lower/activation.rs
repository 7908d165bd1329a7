//! Activation functions.

use burn::backend::ir::ActivationOperationIr as Activation;

use super::Lowering;
use crate::error::Refusal;
use crate::proto::AttributeProto;

impl Lowering<'_> {
    pub(super) fn activation(&mut self, operation: &Activation) -> Result<(), Refusal> {
        let axis = |axis: usize| vec![AttributeProto::int("axis", axis as i64)];
        match operation {
            Activation::Relu(unary) => self.emit("Relu", &[&unary.input], &unary.out, vec![]),
            Activation::Sigmoid(unary) => self.emit("Sigmoid", &[&unary.input], &unary.out, vec![]),
            Activation::LeakyRelu(scalar) => {
                let slope = vec![AttributeProto::float("alpha", scalar.rhs.elem())];
                self.emit("LeakyRelu", &[&scalar.lhs], &scalar.out, slope);
            }
            Activation::PRelu(pair) => self.emit("PRelu", &[&pair.lhs, &pair.rhs], &pair.out, vec![]),
            Activation::HardSigmoid(hard) => {
                let slope = AttributeProto::float("alpha", hard.alpha.elem());
                let offset = AttributeProto::float("beta", hard.beta.elem());
                self.emit("HardSigmoid", &[&hard.tensor], &hard.out, vec![slope, offset]);
            }
            Activation::Softmax(dim) => self.emit("Softmax", &[&dim.input], &dim.out, axis(dim.axis)),
            Activation::LogSoftmax(dim) => self.emit("LogSoftmax", &[&dim.input], &dim.out, axis(dim.axis)),
            Activation::Softmin(dim) => {
                let x = self.name(&dim.input);
                let negative = self.graph.value("Neg", vec![x], Vec::new());
                self.emit_named("Softmax", vec![negative], &dim.out, axis(dim.axis));
            }
            Activation::LogSigmoid(unary) => {
                let x = self.name(&unary.input);
                let negative = self.graph.value("Neg", vec![x], Vec::new());
                let softplus = self.graph.value("Softplus", vec![negative], Vec::new());
                self.emit_named("Neg", vec![softplus], &unary.out, Vec::new());
            }
            // ½ x (1 + erf(x / √2)): `Gelu` itself came with opset 20, and runtimes know this pattern.
            Activation::Gelu(unary) => {
                let x = self.name(&unary.input);
                let (root, one, half) =
                    (self.graph.float(2.0_f32.sqrt()), self.graph.float(1.0), self.graph.float(0.5));
                let scaled = self.graph.value("Div", vec![x.clone(), root], Vec::new());
                let erf = self.graph.value("Erf", vec![scaled], Vec::new());
                let sum = self.graph.value("Add", vec![erf, one], Vec::new());
                let product = self.graph.value("Mul", vec![x, sum], Vec::new());
                self.emit_named("Mul", vec![product, half], &unary.out, Vec::new());
            }
            _ => return Err(Refusal::NoCounterpart("")),
        }
        Ok(())
    }
}
