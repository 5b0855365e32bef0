//! `graspmill weights export`: a checkpoint's weights for other programs.

use std::path::PathBuf;

use clap::Args;
use network::interchange::export;
use program::{ExitCode, Failure, print};

use crate::parse::others_do;

const EXAMPLES: &str = "\
Examples:
  graspmill weights export runs/paper/best.safetensors --format onnx --out vgn.onnx
  graspmill weights export runs/paper/best.safetensors --format safetensors --out vgn.safetensors

safetensors: the 18 tensors of VGN's ConvNet, or the 14 of a judge; in PyTorch,
  net.load_state_dict(safetensors.torch.load_file(FILE), strict=True)
onnx: input tsdf [batch, 1, 40, 40, 40]; outputs quality (0 to 1), rotation (unit quaternion
  x, y, z, w) and width (voxels)
onnx of a judge: inputs crop [batch, 4, 8, 20, 28] and facts [batch, 16], which scripts/judge_onnx.py computes;
  output outcomes [batch, 6]
The program of the Python package writes onnx: pip install graspmill[onnx], then the same command";

/// Write a checkpoint's weights for PyTorch or an ONNX runtime.
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub(crate) struct Arguments {
    /// A checkpoint of trainer, such as RUN/best.safetensors.
    checkpoint: PathBuf,
    /// What to write: the weights alone, or the whole network.
    #[arg(long, value_parser = ["safetensors", "onnx"])]
    format: String,
    /// The file to write.
    #[arg(long)]
    out: PathBuf,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if arguments.format == "onnx" {
        return Err(others_do("writes ONNX", "[onnx]"));
    }
    let checkpoint = export(&arguments.checkpoint, &arguments.out, arguments.force)?;
    print(format_args!("{}\nwritten     {}\n", checkpoint.architecture, arguments.out.display()))?;
    Ok(ExitCode::Ok)
}
