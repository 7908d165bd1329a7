//! Burn → ONNX: captures a forward pass on Burn's capture device and writes it as one ONNX file.
//!
//! Any Burn module exports; nothing about it has to be declared but the names of its inputs and outputs and the axes that
//! stay free. The forward pass is traced at several sizes of those axes, so every number that follows from a size becomes
//! an expression of the sizes at run time.
//!
//! ```no_run
//! use burn::module::Module;
//! use burn::nn::conv::{Conv2d, Conv2dConfig};
//! use burn::tensor::{Device, Tensor, activation::leaky_relu};
//! use onnx::{Axis, Exporter};
//!
//! #[derive(Module, Debug)]
//! struct Net {
//!     conv: Conv2d,
//! }
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let device = Device::flex();
//! let net = Net { conv: Conv2dConfig::new([3, 8], [3, 3]).with_stride([2, 2]).init(&device) };
//! let bytes = Exporter::new()
//!     .input("image")
//!     .output("features")
//!     .dynamic(Axis::new("batch", 2).on("image", 0))
//!     .dynamic(Axis::new("column", 64).multiple_of(2).on("image", 3))
//!     .metadata("licence", "MIT")
//!     .export(
//!         &net,
//!         |sizes| Tensor::<4>::zeros([sizes["batch"], 3, 16, sizes["column"]], &device),
//!         |net, image| leaky_relu(net.conv.forward(image), 0.2),
//!     )?;
//! std::fs::write("model.onnx", bytes)?;
//! # Ok(())
//! # }
//! ```
//!
//! # Operations
//!
//! | Burn | ONNX |
//! |---|---|
//! | convolutions and transposed convolutions in 1 to 3 dimensions | `Conv`, `ConvTranspose` |
//! | `InstanceNorm`, `GroupNorm`; `BatchNorm`; `LayerNorm` | `InstanceNormalization`; `BatchNormalization`; `LayerNormalization` |
//! | `Linear`, `matmul`; `Embedding`, `select`; `gather` | `MatMul` and `Add`; `Gather`; `GatherElements` |
//! | maximum and average pooling; adaptive pooling to one or equal windows | `MaxPool`, `AveragePool`, `GlobalAveragePool` |
//! | nearest, bilinear and bicubic `interpolate` | `Resize` |
//! | `slice` with steps, `flip`; `cat`; `reshape`; `permute`; `expand`; `repeat`; `pad` | `Slice`; `Concat`; `Reshape`; `Transpose`; `Expand`; `Tile`; `Pad` |
//! | arithmetic, powers, `exp`, `log`, circular and hyperbolic functions, rounding, `erf`, `cumsum` | their namesakes; `atan2`, `hypot`, `log1p`, `trunc` in several nodes |
//! | comparisons and logic, `mask_where`, `mask_fill`, `clamp` | their namesakes, `Where`, `Clip` |
//! | mean, sum, product, maximum and minimum, whole or along axes; `argmax`, `argmin`, `any`, `all` | `Reduce…`, `ArgMax`, `ArgMin` |
//! | rectifiers, leaky, parametric and Gaussian (`gelu`) ones too, sigmoids, softmaxes | their namesakes |
//!
//! Anything else, sorting and scattering for example, is an [`Error::Operation`] that names the operation.
//!
//! # What a forward pass may not do
//!
//! - Read a value back: `into_scalar()`, `to_data()` and branches on values panic, for under capture there are none.
//! - Draw random numbers: an [`Error::Operation`]; make the noise an input.
//! - Fold a dynamic size into a number or a constant tensor: `x / width as f32`, or a table of `width` floats. These differ
//!   from trace to trace and are refused; so is `var` over a dynamic axis, which divides by its length. Integer ramps are
//!   fine: `Tensor::arange(0..width)` becomes `Range`.
//! - Take a different course at different sizes, for example a loop over the columns: [`Error::Diverging`].
//! - Create tensors on a stored device: use `input.device()`.
//!
//! Integers are int64 in the file, whatever integers the module's device has.
//! Dropout and batch normalisation are exported as in [`Module::valid`](burn::module::Module::valid).
//!
//! # Files that exist already
//!
//! [`Composition`] makes one file of two, the second taking what the first gives; [`cut`](cut()) and [`base_of`] take such a file apart;
//! [`with_metadata`] changes what a file says about itself.

mod axis;
mod boundary;
mod compose;
mod cut;
mod data;
mod error;
mod exporter;
mod file;
mod graph;
mod linear;
mod lower;
mod metadata;
mod norm;
mod proto;
mod trace;
mod traces;

pub use axis::{Axis, Sizes};
pub use boundary::Boundary;
pub use compose::{ComposeError, Composition, Disagreement};
pub use cut::{base_of, cut};
pub use error::{Error, Refusal};
pub use exporter::Exporter;
pub use file::{FileError, MAX_FILE_BYTES};
pub use metadata::with_metadata;
