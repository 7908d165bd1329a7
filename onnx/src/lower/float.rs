//! Functions of floats.

use std::f32::consts::PI;

use burn::backend::ir::{BinaryOpIr, FloatOperationIr as Float, UnaryOpIr};

use super::Lowering;
use crate::error::Refusal;

impl Lowering<'_> {
    pub(super) fn float(&mut self, operation: &Float) -> Result<(), Refusal> {
        if let Some((op, unary)) = unary(operation) {
            self.emit(op, &[&unary.input], &unary.out, vec![]);
            return Ok(());
        }
        match operation {
            Float::Powf(pair) => self.emit("Pow", &[&pair.lhs, &pair.rhs], &pair.out, vec![]),
            Float::PowfScalar(scalar) => self.emit_scalar("Pow", scalar)?,
            Float::Matmul(matmul) => self.emit("MatMul", &[&matmul.lhs, &matmul.rhs], &matmul.out, vec![]),
            Float::IntoInt(cast) => self.cast(cast)?,
            Float::Log1p(unary) => {
                let (x, one) = (self.name(&unary.input), self.graph.float(1.0));
                let sum = self.graph.value("Add", vec![x, one], Vec::new());
                self.emit_named("Log", vec![sum], &unary.out, Vec::new());
            }
            Float::Trunc(unary) => {
                let x = self.name(&unary.input);
                let magnitude = self.graph.value("Abs", vec![x.clone()], Vec::new());
                let whole = self.graph.value("Floor", vec![magnitude], Vec::new());
                let sign = self.graph.value("Sign", vec![x], Vec::new());
                self.emit_named("Mul", vec![whole, sign], &unary.out, Vec::new());
            }
            Float::Hypot(pair) => {
                let (x, y) = (self.name(&pair.lhs), self.name(&pair.rhs));
                let xx = self.graph.value("Mul", vec![x.clone(), x], Vec::new());
                let yy = self.graph.value("Mul", vec![y.clone(), y], Vec::new());
                let sum = self.graph.value("Add", vec![xx, yy], Vec::new());
                self.emit_named("Sqrt", vec![sum], &pair.out, Vec::new());
            }
            Float::ArcTan2(pair) => self.atan2(pair),
            Float::Random(_) => return Err(Refusal::Random),
            _ => return Err(Refusal::NoCounterpart("")),
        }
        Ok(())
    }

    /// ONNX has no `atan2`: `atan(y / x)`, plus π with the sign of y where x < 0, and 0 at the origin, where y / x is none.
    fn atan2(&mut self, pair: &BinaryOpIr) {
        let (y, x) = (self.name(&pair.lhs), self.name(&pair.rhs));
        let (zero, pi, minus_pi) = (self.graph.float(0.0), self.graph.float(PI), self.graph.float(-PI));
        let node = |lowering: &mut Self, op: &str, inputs: [&String; 2]| {
            lowering.graph.value(op, inputs.map(String::clone).to_vec(), Vec::new())
        };
        let choose = |lowering: &mut Self, inputs: [&String; 3]| {
            lowering.graph.value("Where", inputs.map(String::clone).to_vec(), Vec::new())
        };
        let ratio = node(self, "Div", [&y, &x]);
        let angle = self.graph.value("Atan", vec![ratio], Vec::new());
        let (no_y, no_x) = (node(self, "Equal", [&y, &zero]), node(self, "Equal", [&x, &zero]));
        let at_origin = node(self, "And", [&no_y, &no_x]);
        let angle = choose(self, [&at_origin, &zero, &angle]);
        let (below, behind) = (node(self, "Less", [&y, &zero]), node(self, "Less", [&x, &zero]));
        let half_turn = choose(self, [&below, &minus_pi, &pi]);
        let turn = choose(self, [&behind, &half_turn, &zero]);
        self.emit_named("Add", vec![angle, turn], &pair.out, Vec::new());
    }
}

/// The functions that ONNX has under one name.
fn unary(operation: &Float) -> Option<(&'static str, &UnaryOpIr)> {
    Some(match operation {
        Float::Exp(unary) => ("Exp", unary),
        Float::Log(unary) => ("Log", unary),
        Float::Erf(unary) => ("Erf", unary),
        Float::Sqrt(unary) => ("Sqrt", unary),
        Float::Recip(unary) => ("Reciprocal", unary),
        Float::Sin(unary) => ("Sin", unary),
        Float::Cos(unary) => ("Cos", unary),
        Float::Tan(unary) => ("Tan", unary),
        Float::Sinh(unary) => ("Sinh", unary),
        Float::Cosh(unary) => ("Cosh", unary),
        Float::Tanh(unary) => ("Tanh", unary),
        Float::ArcSin(unary) => ("Asin", unary),
        Float::ArcCos(unary) => ("Acos", unary),
        Float::ArcTan(unary) => ("Atan", unary),
        Float::ArcSinh(unary) => ("Asinh", unary),
        Float::ArcCosh(unary) => ("Acosh", unary),
        Float::ArcTanh(unary) => ("Atanh", unary),
        Float::Round(unary) => ("Round", unary),
        Float::Floor(unary) => ("Floor", unary),
        Float::Ceil(unary) => ("Ceil", unary),
        _ => return None,
    })
}
