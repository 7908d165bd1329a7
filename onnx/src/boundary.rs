//! What crosses the boundary of a traced forward pass: tensors, and tuples of up to four of them.

use burn::backend::capture::CaptureBackend;
use burn::backend::ir::TensorIr;
use burn::tensor::{Bool, Device, Float, Int, Tensor};

use crate::error::Error;

/// Inputs or outputs of a forward pass. A struct of tensors can implement it field by field.
pub trait Boundary: Sized {
    /// Moves every tensor to `device`, without its autodiff graph.
    #[must_use]
    fn to_capture(self, device: &Device) -> Self;

    /// The captured tensors, in the order of the graph's inputs or outputs.
    fn captured(&self) -> Result<Vec<TensorIr>, Error>;
}

macro_rules! tensor_boundary {
    ($($kind:ty: $transfer:expr),+) => {
        $(impl<const D: usize> Boundary for Tensor<D, $kind> {
            fn to_capture(self, device: &Device) -> Self {
                let transfer: fn(Self, &Device) -> Self = $transfer;
                transfer(self.without_autodiff(), device)
            }

            fn captured(&self) -> Result<Vec<TensorIr>, Error> {
                let primitive = self.clone().try_into_primitive::<CaptureBackend>().map_err(|_| Error::ForeignTensor)?;
                Ok(vec![TensorIr::uninit(primitive.id(), self.shape(), self.dtype())])
            }
        })+
    };
}

macro_rules! tuple_boundary {
    ($($part:ident $index:tt),+) => {
        impl<$($part: Boundary),+> Boundary for ($($part,)+) {
            fn to_capture(self, device: &Device) -> Self {
                ($(self.$index.to_capture(device),)+)
            }

            fn captured(&self) -> Result<Vec<TensorIr>, Error> {
                let mut tensors = Vec::new();
                $(tensors.extend(self.$index.captured()?);)+
                Ok(tensors)
            }
        }
    };
}

// Integers and truth values take the capture device's types, int64 and one byte, whatever the device at home has: the
// integers that a forward pass makes on the way have them too, and Burn adds only like to like.
tensor_boundary!(
    Float: |tensor, device| tensor.to_device(device),
    Int: |tensor, device| Tensor::from_data(tensor.into_data(), device),
    Bool: |tensor, device| Tensor::from_data(tensor.into_data(), device)
);
tuple_boundary!(A 0);
tuple_boundary!(A 0, B 1);
tuple_boundary!(A 0, B 1, C 2);
tuple_boundary!(A 0, B 1, C 2, E 3);
