//! What computes a training's steps.

use anyhow::Result;
#[cfg(not(all(feature = "tch", feature = "wgpu")))]
use anyhow::bail;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};

/// What computes a training's steps. Everything else, scores and exports too, is computed by [`Backend::Flex`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// Burn's own on the processor, always there.
    #[default]
    Flex,
    /// `LibTorch` on the processor, with the feature `tch`.
    Tch,
    /// A graphics card by Vulkan, Metal or `DirectX`, with the feature `wgpu`.
    Wgpu,
}

impl Backend {
    /// Where tensors are to live; an error where this program was built without the backend.
    pub fn device(self) -> Result<Device> {
        match self {
            Self::Flex => Ok(Device::flex()),
            #[cfg(feature = "tch")]
            #[allow(deprecated, reason = "the fastest that Burn has on a processor, as long as it has it")]
            Self::Tch => Ok(Device::libtorch()),
            #[cfg(not(feature = "tch"))]
            Self::Tch => bail!("backend \"tch\" is not part of this program: build it with --features tch"),
            #[cfg(feature = "wgpu")]
            Self::Wgpu => Ok(Device::wgpu(burn::tensor::DeviceKind::DefaultDevice)),
            #[cfg(not(feature = "wgpu"))]
            Self::Wgpu => bail!("backend \"wgpu\" is not part of this program: build it with --features wgpu"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backends_that_were_not_built_in_are_refused_by_name() {
        assert!(Backend::Flex.device().is_ok());
        for (backend, built_in) in [(Backend::Tch, cfg!(feature = "tch")), (Backend::Wgpu, cfg!(feature = "wgpu"))] {
            let name = format!("{backend:?}").to_lowercase();
            let refusal = backend.device().map_or_else(|e| e.to_string(), |_| String::new());
            assert_eq!(refusal.contains(&format!("--features {name}")), !built_in, "{refusal}");
        }
    }
}
