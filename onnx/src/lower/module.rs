//! Layers: convolutions, linear maps, embeddings, normalisations and resizing.

use burn::backend::ir::{
    BatchNormOpIr, InterpolateModeIr, InterpolateOpIr, LayerNormOpIr, LinearOpIr, ModuleOperationIr as Module, TensorIr,
};

use super::Lowering;
use crate::error::Refusal;
use crate::proto::AttributeProto;
use crate::traces::constant;

/// The geometry of a convolution.
struct Conv<'a> {
    stride: &'a [usize],
    /// Before and after, for each axis.
    padding: Vec<(usize, usize)>,
    dilation: &'a [usize],
    groups: usize,
    /// Of a transposed convolution.
    output_padding: Option<&'a [usize]>,
}

impl Lowering<'_> {
    pub(super) fn module(&mut self, operation: &Module) -> Result<(), Refusal> {
        match operation {
            Module::BatchNorm(norm) => self.batch_norm(norm),
            Module::LayerNorm(norm) => self.layer_norm(norm),
            Module::Linear(linear) => self.linear(linear),
            Module::Embedding(embedding) => {
                let rows = vec![AttributeProto::int("axis", 0)];
                self.emit("Gather", &[&embedding.weights, &embedding.indices], &embedding.out, rows);
            }
            Module::Interpolate(resize) => self.resize(resize)?,
            other => return self.convolution(other),
        }
        Ok(())
    }

    fn convolution(&mut self, operation: &Module) -> Result<(), Refusal> {
        macro_rules! conv {
            ($conv:ident, $padding:expr, $output_padding:expr) => {{
                let options = &$conv.options;
                let geometry = Conv {
                    stride: &options.stride,
                    padding: options.padding.iter().map($padding).collect(),
                    dilation: &options.dilation,
                    groups: options.groups,
                    output_padding: $output_padding,
                };
                self.conv([&$conv.x, &$conv.weight], $conv.bias.as_ref(), &$conv.out, &geometry);
            }};
        }
        match operation {
            Module::Conv1d(conv) => conv!(conv, |pair| *pair, None),
            Module::Conv2d(conv) => conv!(conv, |pair| *pair, None),
            Module::Conv3d(conv) => conv!(conv, |width| (*width, *width), None),
            Module::ConvTranspose1d(conv) => conv!(conv, |width| (*width, *width), Some(&conv.options.padding_out)),
            Module::ConvTranspose2d(conv) => conv!(conv, |width| (*width, *width), Some(&conv.options.padding_out)),
            Module::ConvTranspose3d(conv) => conv!(conv, |width| (*width, *width), Some(&conv.options.padding_out)),
            other => return self.pool(other),
        }
        Ok(())
    }

    fn conv(&mut self, [x, weight]: [&TensorIr; 2], bias: Option<&TensorIr>, out: &TensorIr, conv: &Conv<'_>) {
        let kernel: Vec<usize> = weight.shape.iter().skip(2).copied().collect();
        let pads: Vec<usize> =
            conv.padding.iter().map(|pair| pair.0).chain(conv.padding.iter().map(|pair| pair.1)).collect();
        let mut settings = vec![
            AttributeProto::ints("kernel_shape", &kernel),
            AttributeProto::ints("strides", conv.stride),
            AttributeProto::ints("dilations", conv.dilation),
            AttributeProto::ints("pads", &pads),
            AttributeProto::int("group", conv.groups as i64),
        ];
        settings.extend(conv.output_padding.map(|padding| AttributeProto::ints("output_padding", padding)));
        let op = if conv.output_padding.is_some() { "ConvTranspose" } else { "Conv" };
        let inputs: Vec<&TensorIr> = [x, weight].into_iter().chain(bias).collect();
        self.emit(op, &inputs, out, settings);
    }

    fn batch_norm(&mut self, norm: &BatchNormOpIr) {
        let inputs = [&norm.x, &norm.gamma, &norm.beta, &norm.mean, &norm.variance];
        let epsilon = vec![AttributeProto::float("epsilon", norm.epsilon.elem())];
        self.emit("BatchNormalization", &inputs, &norm.out, epsilon);
    }

    fn layer_norm(&mut self, norm: &LayerNormOpIr) {
        let inputs: Vec<&TensorIr> = [&norm.input, &norm.gamma].into_iter().chain(&norm.beta).collect();
        let settings = vec![AttributeProto::int("axis", -1), AttributeProto::float("epsilon", norm.epsilon.elem())];
        self.emit("LayerNormalization", &inputs, &norm.out, settings);
    }

    fn linear(&mut self, linear: &LinearOpIr) {
        let Some(bias) = &linear.bias else {
            return self.emit("MatMul", &[&linear.x, &linear.weight], &linear.out, vec![]);
        };
        let inputs = vec![self.name(&linear.x), self.name(&linear.weight)];
        let product = self.graph.value("MatMul", inputs, Vec::new());
        let inputs = vec![product, self.name(bias)];
        self.emit_named("Add", inputs, &linear.out, Vec::new());
    }

    fn resize(&mut self, resize: &InterpolateOpIr) -> Result<(), Refusal> {
        let between = if resize.options.align_corners { "align_corners" } else { "half_pixel" };
        let (mode, coordinates) = match resize.options.mode {
            InterpolateModeIr::Nearest => ("nearest", "asymmetric"),
            InterpolateModeIr::Bilinear => ("linear", between),
            InterpolateModeIr::Bicubic => ("cubic", between),
            _ => return Err(Refusal::NoCounterpart("this way of interpolating")),
        };
        let mut settings = vec![
            AttributeProto::text("mode", mode),
            AttributeProto::text("coordinate_transformation_mode", coordinates),
        ];
        if mode == "nearest" {
            settings.push(AttributeProto::text("nearest_mode", "floor"));
        }
        let traces = self.traces;
        let (from, to) = (traces.dims(resize.x.id), traces.dims(resize.out.id));
        let scales: Option<Vec<f32>> = from.iter().zip(to).map(|(from, to)| scale(from, to)).collect();
        let x = self.name(&resize.x);
        let inputs = if let Some(scales) = scales {
            vec![x, String::new(), self.graph.floats(&scales)]
        } else {
            vec![x, String::new(), String::new(), self.shape_of(resize.out.id)?]
        };
        self.emit_named("Resize", inputs, &resize.out, settings);
        Ok(())
    }
}

/// The factor between two sizes, where the graph may say it as one: it has to be exact in float32, for the runtime rounds
/// size × factor down.
fn scale(from: &[i64], to: &[i64]) -> Option<f32> {
    let sixteenths: Vec<i64> =
        from.iter().zip(to).map(|(from, to)| if 16 * to % from == 0 { 16 * to / from } else { -1 }).collect();
    constant(&sixteenths).filter(|factor| *factor > 0).map(|factor| factor as f32 / 16.0)
}
