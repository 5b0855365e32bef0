//! Compute devices: the host, or a device that the program was built for.
//!
//! GPUs are the cargo feature `wgpu` of this crate (Vulkan, Metal or DirectX), off by default because it compiles for
//! minutes. Only this module depends on it.
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

/// A device's name on the command line: `cpu`, `wgpu`, `wgpu:1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceName {
    /// The host, the only device with bitwise reproducible results.
    #[default]
    Cpu,
    /// A graphics adapter of Vulkan, Metal or DirectX, by its index.
    Wgpu(usize),
}

impl std::fmt::Display for DeviceName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Cpu => write!(f, "cpu"),
            Self::Wgpu(number) => write!(f, "wgpu:{number}"),
        }
    }
}

impl FromStr for DeviceName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = match text.strip_prefix("wgpu") {
            None if text == "cpu" => return Ok(Self::Cpu),
            Some("") => Some(0),
            rest => rest.and_then(|rest| rest.strip_prefix(':')?.parse().ok()),
        };
        number.map(Self::Wgpu).ok_or_else(|| format!("a device is cpu, wgpu or wgpu:N, not {text:?}"))
    }
}

impl DeviceName {
    /// The device itself.
    ///
    /// # Errors
    /// If the program was built without it or the machine has none: another command or machine is needed.
    pub fn open(self) -> Result<Device, Failure> {
        let Self::Wgpu(number) = self else { return Ok(Device::Host) };
        let text = match wgpu() {
            Some(mut devices) if number < devices.len() => return Ok(devices.swap_remove(number)),
            Some(devices) => format!("there is no device {self}: the machine has {}", devices.len()),
            None => {
                "this program was built without wgpu: cargo build --release -p graspmill --features wgpu makes one \
                     that has it"
                    .to_owned()
            }
        };
        Err(Failure::new(ExitCode::Config, text))
    }
}

/// All graphics adapters; `None` if the program was built without `wgpu`.
fn wgpu() -> Option<Vec<Device>> {
    #[cfg(feature = "wgpu")]
    {
        let adapters = burn::tensor::Device::enumerate(burn::tensor::DeviceType::Wgpu);
        Some(adapters.to_vec().into_iter().map(Device::Burn).collect())
    }
    #[cfg(not(feature = "wgpu"))]
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_written() {
        for (text, name) in [("cpu", DeviceName::Cpu), ("wgpu:1", DeviceName::Wgpu(1)), ("wgpu:0", DeviceName::Wgpu(0))]
        {
            assert_eq!(text.parse(), Ok(name));
            assert_eq!(name.to_string(), text);
        }
        assert_eq!("wgpu".parse(), Ok(DeviceName::Wgpu(0)));
        for text in ["", "gpu", "cuda", "wgpu:", "wgpu:x", "cpu:0", "wgpu:-1"] {
            let error = text.parse::<DeviceName>().unwrap_err();
            assert!(error.ends_with(&format!("not {text:?}")), "{error}");
        }
    }

    #[test]
    fn a_device_that_is_not_there_is_told_with_what_to_do() {
        assert_eq!(DeviceName::Cpu.open().unwrap(), Device::Host);
        let error = DeviceName::Wgpu(4096).open().unwrap_err();
        let expected = if cfg!(feature = "wgpu") { "there is no device wgpu:4096" } else { "--features wgpu" };
        assert!(error.to_string().contains(expected), "{error}");
    }
}
