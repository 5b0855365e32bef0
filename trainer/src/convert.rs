//! `trainer import` and `trainer export`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use network::interchange::{InterchangeError, Target, export, import};
use network::upsampling::Upsampling;

pub(crate) const IMPORT_EXAMPLES: &str = "\
Examples:
  trainer import vgn_conv.pth --out vgn.safetensors
  trainer evaluate --model vgn.safetensors --data grasps --split all
  trainer import weights.safetensors --upsampling linear --out linear.safetensors

Read are safetensors and what torch.save writes of a state dict, new (zip) or before PyTorch 1.6
(pickles), alone or under \"state_dict\", \"model_state_dict\" or \"model\". Nothing in a file is run.
\"module.\" before the names is taken off; float64, float16 and bfloat16 become float32.";

pub(crate) const EXPORT_EXAMPLES: &str = "\
Examples:
  trainer export runs/paper/best.safetensors --format onnx --out vgn.onnx
  trainer export runs/paper/best.safetensors --format safetensors --out vgn.safetensors

safetensors: the 18 tensors of VGN's ConvNet; in PyTorch,
  net.load_state_dict(safetensors.torch.load_file(FILE), strict=True)
onnx: input tsdf [batch, 1, 40, 40, 40]; outputs quality (0 to 1), rotation (unit quaternion
  x, y, z, w) and width (voxels)";

#[derive(Args)]
pub(crate) struct ImportArgs {
    /// A state dict of VGN's network: .pth, .pt or .safetensors.
    file: PathBuf,
    /// The checkpoint to write, for `evaluate --model`.
    #[arg(long)]
    out: PathBuf,
    /// How the network doubles its grids, which a state dict does not say. VGN's code: nearest.
    #[arg(long, value_enum, default_value_t = UpsamplingArg::Nearest)]
    upsampling: UpsamplingArg,
    /// Replace the file that is there.
    #[arg(long)]
    force: bool,
}

#[derive(Args)]
pub(crate) struct ExportArgs {
    /// A checkpoint of trainer, such as RUN/best.safetensors.
    checkpoint: PathBuf,
    /// What to write.
    #[arg(long, value_enum)]
    format: FormatArg,
    /// The file to write.
    #[arg(long)]
    out: PathBuf,
    /// Replace the file that is there.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum UpsamplingArg {
    /// Each value eight times, as VGN's code does.
    Nearest,
    /// Trilinear, as the paper says.
    Linear,
}

#[derive(Clone, Copy, ValueEnum)]
enum FormatArg {
    /// The weights under VGN's names.
    Safetensors,
    /// The whole network.
    Onnx,
}

pub(crate) fn run_import(args: &ImportArgs) -> Result<program::ExitCode, InterchangeError> {
    let upsampling = match args.upsampling {
        UpsamplingArg::Nearest => Upsampling::Nearest,
        UpsamplingArg::Linear => Upsampling::Linear,
    };
    let imported = import(&args.file, &args.out, upsampling, args.force)?;
    crate::console::print(&format!("read        {}: {}", imported.source.name(), args.file.display()));
    if !imported.prefix.is_empty() {
        crate::console::print(&format!("names       {:?} before each was taken off", imported.prefix));
    }
    if !imported.converted_from.is_empty() {
        crate::console::print(&format!("numbers     {} converted to float32", imported.converted_from.join(" and ")));
    }
    crate::console::print(&format!(
        "upsampling  {}: a state dict does not say; --upsampling changes it",
        upsampling.name()
    ));
    crate::console::print(&format!("checkpoint  {}", args.out.display()));
    Ok(program::ExitCode::Ok)
}

pub(crate) fn run_export(args: &ExportArgs) -> Result<program::ExitCode, InterchangeError> {
    let target = match args.format {
        FormatArg::Safetensors => Target::Safetensors,
        FormatArg::Onnx => Target::Onnx,
    };
    let checkpoint = export(&args.checkpoint, &args.out, target, args.force)?;
    crate::console::print(&format!("upsampling  {}", checkpoint.upsampling.name()));
    crate::console::print(&format!("written     {}", args.out.display()));
    Ok(program::ExitCode::Ok)
}
