//! Pooling.

use burn::backend::ir::{ModuleOperationIr as Module, TensorIr};

use super::Lowering;
use crate::error::Refusal;
use crate::proto::AttributeProto;
use crate::traces::constant;

/// The window of a pooling layer.
struct Window<'a> {
    kernel: &'a [usize],
    stride: &'a [usize],
    padding: &'a [usize],
    ceil: bool,
}

impl Window<'_> {
    fn settings(&self) -> Vec<AttributeProto> {
        let pads: Vec<usize> = self.padding.iter().chain(self.padding).copied().collect();
        vec![
            AttributeProto::ints("kernel_shape", self.kernel),
            AttributeProto::ints("strides", self.stride),
            AttributeProto::ints("pads", &pads),
            AttributeProto::int("ceil_mode", i64::from(self.ceil)),
        ]
    }
}

impl Lowering<'_> {
    pub(super) fn pool(&mut self, operation: &Module) -> Result<(), Refusal> {
        use std::slice::from_ref;
        match operation {
            Module::MaxPool1d(p) => {
                let (kernel, stride, padding) = (from_ref(&p.kernel_size), from_ref(&p.stride), from_ref(&p.padding));
                self.max_pool(
                    &p.x,
                    &Window { kernel, stride, padding, ceil: p.ceil_mode },
                    from_ref(&p.dilation),
                    &p.out,
                );
            }
            Module::MaxPool2d(p) => {
                let window =
                    Window { kernel: &p.kernel_size, stride: &p.stride, padding: &p.padding, ceil: p.ceil_mode };
                self.max_pool(&p.x, &window, &p.dilation, &p.out);
            }
            Module::AvgPool1d(p) => {
                let (kernel, stride, padding) = (from_ref(&p.kernel_size), from_ref(&p.stride), from_ref(&p.padding));
                let window = Window { kernel, stride, padding, ceil: p.ceil_mode };
                self.average_pool(&p.x, &window, p.count_include_pad, &p.out);
            }
            Module::AvgPool2d(p) => {
                let window =
                    Window { kernel: &p.kernel_size, stride: &p.stride, padding: &p.padding, ceil: p.ceil_mode };
                self.average_pool(&p.x, &window, p.count_include_pad, &p.out);
            }
            Module::AdaptiveAvgPool1d(p) => self.adaptive(&p.x, &[p.output_size], &p.out)?,
            Module::AdaptiveAvgPool2d(p) => self.adaptive(&p.x, &p.output_size, &p.out)?,
            Module::AdaptiveAvgPool3d(p) => self.adaptive(&p.x, &p.output_size, &p.out)?,
            _ => return Err(Refusal::NoCounterpart("")),
        }
        Ok(())
    }

    fn max_pool(&mut self, x: &TensorIr, window: &Window<'_>, dilation: &[usize], out: &TensorIr) {
        let mut settings = window.settings();
        settings.push(AttributeProto::ints("dilations", dilation));
        self.emit("MaxPool", &[x], out, settings);
    }

    fn average_pool(&mut self, x: &TensorIr, window: &Window<'_>, count_padding: bool, out: &TensorIr) {
        let mut settings = window.settings();
        settings.push(AttributeProto::int("count_include_pad", i64::from(count_padding)));
        self.emit("AveragePool", &[x], out, settings);
    }

    /// Adaptive pooling has a counterpart where all windows are alike: one window, or a constant input size that the output
    /// size divides.
    fn adaptive(&mut self, x: &TensorIr, output: &[usize], out: &TensorIr) -> Result<(), Refusal> {
        if output.iter().all(|size| *size == 1) {
            self.emit("GlobalAveragePool", &[x], out, Vec::new());
            return Ok(());
        }
        let window = |(samples, output): (&Vec<i64>, &usize)| {
            constant(samples)
                .map(|size| size as usize)
                .filter(|size| size.is_multiple_of(*output))
                .map(|size| size / output)
        };
        let sizes = &self.traces.dims(x.id)[2..];
        let kernel: Option<Vec<usize>> = sizes.iter().zip(output).map(window).collect();
        let kernel =
            kernel.ok_or(Refusal::NoCounterpart("adaptive pooling with windows of unequal or unknown size"))?;
        let padding = vec![0; kernel.len()];
        self.average_pool(x, &Window { kernel: &kernel, stride: &kernel, padding: &padding, ceil: false }, false, out);
        Ok(())
    }
}
