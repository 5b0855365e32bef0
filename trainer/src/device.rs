//! Compute devices: the host, or a device that the program was built for.
//!
//! Devices other than the host are cargo features of this crate, off by default because they compile for minutes:
//! `cuda` (needs an NVIDIA driver with NVRTC at run time; Burn's backend downloads an LLVM bundle at build time) and
//! `wgpu` (Vulkan, Metal or DirectX). Only this module depends on them.
//!
//! A batch is sent to a device in the host's parts (`Batch::parts`). Whole batches would use the device
//! better, which was not tried yet. Weights and the optimiser stay on the host.

use std::str::FromStr;

use program::{ExitCode, Failure};

/// A compute device.
#[derive(Debug, Clone, PartialEq)]
pub enum Device {
    /// The host, with the kernels of the crate `network`.
    Host,
    /// A device of Burn.
    #[cfg(feature = "graph")]
    Burn(burn::tensor::Device),
}

/// A device's name on the command line: `cpu`, `cuda`, `cuda:1`, `wgpu`, `wgpu:0`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceName {
    /// The host, the only device with bitwise reproducible results.
    #[default]
    Cpu,
    /// An NVIDIA GPU, by its index.
    Cuda(usize),
    /// A graphics adapter of Vulkan, Metal or DirectX, by its index.
    Wgpu(usize),
}

impl std::fmt::Display for DeviceName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Cpu => write!(f, "cpu"),
            Self::Cuda(number) => write!(f, "cuda:{number}"),
            Self::Wgpu(number) => write!(f, "wgpu:{number}"),
        }
    }
}

impl FromStr for DeviceName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let unknown = || format!("a device is cpu, cuda, cuda:N, wgpu or wgpu:N, not {text:?}");
        let (kind, number) = match text.split_once(':') {
            Some((kind, number)) => (kind, Some(number.parse().map_err(|_| unknown())?)),
            None => (text, None),
        };
        match (kind, number) {
            ("cpu", None) => Ok(Self::Cpu),
            ("cuda", number) => Ok(Self::Cuda(number.unwrap_or(0))),
            ("wgpu", number) => Ok(Self::Wgpu(number.unwrap_or(0))),
            _ => Err(unknown()),
        }
    }
}

impl DeviceName {
    /// The device itself.
    ///
    /// # Errors
    /// If the program was built without it or the machine has none: another command or machine is needed.
    pub fn open(self) -> Result<Device, Failure> {
        let (devices, feature, number) = match self {
            Self::Cpu => return Ok(Device::Host),
            Self::Cuda(number) => (cuda(), "cuda", number),
            Self::Wgpu(number) => (wgpu(), "wgpu", number),
        };
        let text = match devices {
            Some(mut devices) if number < devices.len() => return Ok(devices.swap_remove(number)),
            Some(devices) => {
                let found = match devices.len() {
                    0 => "none was".to_owned(),
                    1 => "one was".to_owned(),
                    count => format!("{count} were"),
                };
                format!("there is no device {self}: {found} found")
            }
            None => format!(
                "this program was built without {feature}: cargo build --release -p trainer --features {feature} makes \
                 one that has it"
            ),
        };
        Err(Failure::new(ExitCode::Config, text))
    }
}

/// All NVIDIA GPUs; `None` if the program was built without CUDA.
fn cuda() -> Option<Vec<Device>> {
    #[cfg(feature = "cuda")]
    return Some(listed(burn::tensor::DeviceType::Cuda));
    #[cfg(not(feature = "cuda"))]
    None
}

/// All graphics adapters; `None` if the program was built without `wgpu`.
fn wgpu() -> Option<Vec<Device>> {
    #[cfg(feature = "wgpu")]
    return Some(listed(burn::tensor::DeviceType::Wgpu));
    #[cfg(not(feature = "wgpu"))]
    None
}

#[cfg(any(feature = "cuda", feature = "wgpu"))]
fn listed(kind: burn::tensor::DeviceType) -> Vec<Device> {
    burn::tensor::Device::enumerate(kind).to_vec().into_iter().map(Device::Burn).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_written() {
        for (text, name) in [("cpu", DeviceName::Cpu), ("cuda:1", DeviceName::Cuda(1)), ("wgpu:0", DeviceName::Wgpu(0))]
        {
            assert_eq!(text.parse(), Ok(name));
            assert_eq!(name.to_string(), text);
        }
        assert_eq!("cuda".parse(), Ok(DeviceName::Cuda(0)));
        for text in ["", "gpu", "cuda:", "cuda:x", "cpu:0", "wgpu:-1"] {
            let error = text.parse::<DeviceName>().unwrap_err();
            assert!(error.ends_with(&format!("not {text:?}")), "{error}");
        }
    }

    #[test]
    fn a_device_that_is_not_there_is_told_with_what_to_do() {
        assert_eq!(DeviceName::Cpu.open().unwrap(), Device::Host);
        let error = DeviceName::Cuda(4096).open().unwrap_err();
        let expected = if cfg!(feature = "cuda") { "there is no device cuda:4096" } else { "--features cuda" };
        assert!(error.to_string().contains(expected), "{error}");
    }
}
