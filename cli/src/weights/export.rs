//! `graspmill weights export`: a checkpoint's weights for other programs.

use std::path::PathBuf;

use clap::Args;
use network::Architecture;
use network::interchange::{Target, export};
use program::{ExitCode, Failure, print};

use crate::parse::one_of;

const EXAMPLES: &str = "\
Examples:
  graspmill weights export runs/paper/best.safetensors --format onnx --out vgn.onnx
  graspmill weights export runs/paper/best.safetensors --format safetensors --out vgn.safetensors

safetensors: the 18 tensors of VGN's ConvNet, or the 14 of a judge; in PyTorch,
  net.load_state_dict(safetensors.torch.load_file(FILE), strict=True)
onnx: input tsdf [batch, 1, 40, 40, 40]; outputs quality (0 to 1), rotation (unit quaternion
  x, y, z, w) and width (voxels)
onnx of a judge: inputs crop [batch, 4, 8, 20, 28] and facts [batch, 16], which scripts/judge_onnx.py computes;
  output outcomes [batch, 6]";

/// Write a checkpoint's weights for PyTorch or an ONNX runtime.
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub(crate) struct Arguments {
    /// A checkpoint of trainer, such as RUN/best.safetensors.
    checkpoint: PathBuf,
    /// What to write: the weights alone, or the whole network.
    #[arg(long, value_parser = one_of!(Target))]
    format: Target,
    /// The file to write.
    #[arg(long)]
    out: PathBuf,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let checkpoint = export(&arguments.checkpoint, &arguments.out, arguments.format, arguments.force)?;
    let network = match &checkpoint.architecture {
        Architecture::Voxel(params) => format!("{params}"),
        Architecture::Judge(scope) => format!("judge of    {}", scope.hand_in_words()),
    };
    print(format_args!("{network}\nwritten     {}\n", arguments.out.display()))?;
    Ok(ExitCode::Ok)
}
