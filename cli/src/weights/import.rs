//! `graspmill weights import`: a state dict to a checkpoint.

use std::path::PathBuf;

use clap::Args;
use network::BEHIND_TIPS_M_MAX;
use network::interchange::{GivenParams, import};
use network::upsampling::Upsampling;
use program::{ExitCode, Failure, print};

use crate::parse::{between, one_of};

const EXAMPLES: &str = "\
Examples:
  graspmill weights import weights.safetensors --out checkpoint.safetensors
  graspmill evaluate --model checkpoint.safetensors --data grasps --split all
  graspmill weights import weights.safetensors --upsampling linear --out linear.safetensors

Wrappers' prefixes (\"module.\", \"_orig_mod.\") are removed from the names; float64, float16 and
bfloat16 become float32.";

/// Make a checkpoint from weights written by PyTorch or another program.
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", ExitCode::HELP))]
pub(crate) struct Arguments {
    /// A state dict of VGN's network as safetensors; PyTorch's own files are converted in Python, by
    /// graspmill.torch.VoxelNetwork.load(FILE).save(NEW).
    file: PathBuf,
    /// The checkpoint to write, for `evaluate --model`.
    #[arg(long)]
    out: PathBuf,
    /// How the network doubles its grids. Without it what the file says (graspmill.torch writes it), or else nearest,
    /// as in VGN's code.
    #[arg(long, value_parser = one_of!(Upsampling))]
    upsampling: Option<Upsampling>,
    /// How far behind the finger tips, in metres, the network has a grasp's origin. Without it what the file says, or
    /// else 0.05, between the roots of the fingers, as in VGN's code.
    #[arg(long, value_name = "M", value_parser = between(0.0..=BEHIND_TIPS_M_MAX))]
    origin_behind_tips_m: Option<f32>,
    /// Place of that origin in its voxel along each axis: 0.5 where positions were rounded down, 0 where to the
    /// nearest. Without it what the file says, or else 0, as in VGN's code.
    #[arg(long, value_name = "X", value_parser = between(0.0..=1.0_f32))]
    voxel_offset: Option<f32>,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let given = GivenParams {
        upsampling: arguments.upsampling,
        origin_behind_tips_m: arguments.origin_behind_tips_m,
        voxel_offset: arguments.voxel_offset,
    };
    let imported = import(&arguments.file, &arguments.out, given, arguments.force)?;
    let mut text = format!("read        {}\n", arguments.file.display());
    if !imported.prefix.is_empty() {
        text += &format!("names       prefix {:?} removed\n", imported.prefix);
    }
    if !imported.converted_from.is_empty() {
        text += &format!("numbers     {} converted to float32\n", imported.converted_from.join(" and "));
    }
    let params = imported.checkpoint.architecture.voxel("an import")?;
    text += &format!(
        "{params}\n            (what weights do not tell: --upsampling, --origin-behind-tips-m and --voxel-offset say it)\n"
    );
    text += &format!("checkpoint  {}\n", arguments.out.display());
    print(text)?;
    Ok(ExitCode::Ok)
}
