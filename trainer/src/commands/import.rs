//! `trainer import`: a state dict to a checkpoint.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use network::interchange::import;
use network::upsampling::Upsampling;
use program::{ExitCode, Failure, print};

const EXAMPLES: &str = "\
Examples:
  trainer import vgn_conv.pth --out vgn.safetensors
  trainer evaluate --model vgn.safetensors --data grasps --split all
  trainer import weights.safetensors --upsampling linear --out linear.safetensors

Reads safetensors and state dicts written by torch.save, new (zip) or before PyTorch 1.6 (pickles),
alone or under \"state_dict\", \"model_state_dict\" or \"model\". No code in a file is run. A \"module.\"
prefix is removed from the names; float64, float16 and bfloat16 become float32.";

/// Make a checkpoint from weights written by PyTorch or another program.
#[derive(Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub(crate) struct Arguments {
    /// A state dict of VGN's network: .pth, .pt or .safetensors.
    file: PathBuf,
    /// The checkpoint to write, for `evaluate --model`.
    #[arg(long)]
    out: PathBuf,
    /// How the network doubles its grids; a state dict does not record it. VGN's code: nearest.
    #[arg(long, value_enum, default_value_t = UpsamplingArgument::Nearest)]
    upsampling: UpsamplingArgument,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum UpsamplingArgument {
    /// Each value eight times, as in VGN's code.
    Nearest,
    /// Trilinear, as in the paper.
    Linear,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let upsampling = match arguments.upsampling {
        UpsamplingArgument::Nearest => Upsampling::Nearest,
        UpsamplingArgument::Linear => Upsampling::Linear,
    };
    let imported = import(&arguments.file, &arguments.out, upsampling, arguments.force)?;
    let mut text = format!("read        {}: {}\n", imported.source.name(), arguments.file.display());
    if !imported.prefix.is_empty() {
        text += &format!("names       prefix {:?} removed\n", imported.prefix);
    }
    if !imported.converted_from.is_empty() {
        text += &format!("numbers     {} converted to float32\n", imported.converted_from.join(" and "));
    }
    text += &format!("upsampling  {}: not recorded in a state dict; --upsampling changes it\n", upsampling.name());
    text += &format!("checkpoint  {}\n", arguments.out.display());
    print(text)?;
    Ok(ExitCode::Ok)
}
