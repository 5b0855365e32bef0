//! `trainer curves`: a run's curves, drawn again.

use std::path::PathBuf;

use clap::Args;
use program::{ExitCode, Failure, print};
use trainer::curves::draw_curves;

/// Draw a run's curves again from its metrics.jsonl: loss.svg, loss.png, accuracy.svg, accuracy.png.
#[derive(Args)]
#[command(after_help = ExitCode::HELP)]
pub(crate) struct Arguments {
    /// The run's folder.
    #[arg(long)]
    run: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    for path in draw_curves(&arguments.run)? {
        print(format_args!("{}\n", path.display()))?;
    }
    Ok(ExitCode::Ok)
}
