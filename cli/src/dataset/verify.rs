//! `graspmill dataset verify`: reads and checks everything.

use std::fmt::Write as _;
use std::io::{self, IsTerminal, Write as _};

use clap::Args;
use program::{ExitCode, Failure, print};
use shards::{Location, Verified};

use crate::parse::LocationParser;

/// Check every checksum, row, key and count; exit 65 and name what is wrong.
#[derive(Debug, Args)]
#[command(after_help = "\
To repair a damaged shard, delete the named file and run the generator again with the same config, seed and shards. The generator \
makes that shard again, byte for byte, and leaves the others alone.")]
pub(crate) struct Arguments {
    /// The dataset's folder or URL.
    #[arg(value_parser = LocationParser)]
    dataset: Location,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut stderr = io::stderr();
    let shows_progress = stderr.is_terminal();
    let verified = shards::verify(&arguments.dataset, |shard| {
        if shows_progress {
            let _ = write!(stderr, "\rshard {shard} read "); // a sign of life, worth no failure
        }
    })?;
    if shows_progress {
        let _ = write!(stderr, "\r\x1b[K");
    }
    print(text(&verified))?;
    Ok(verified.exit_code())
}

fn text(verified: &Verified) -> String {
    let Verified { counts, bytes, problems, more, listed, .. } = verified;
    let mut text: String = problems.iter().map(|problem| format!("{problem}\n")).collect();
    if *more > 0 {
        text += &format!("and {more} more\n");
    }
    let (attempts, objects, scenes) = (counts.labels.attempts, counts.objects, counts.scenes);
    // Writing to a String cannot fail.
    let _ = writeln!(text, "{attempts} attempts, {objects} objects, {scenes} scenes, {bytes} bytes read and checked");
    if !listed {
        text += "the store cannot list its objects: there may be files that do not belong to the dataset\n";
    }
    if verified.is_ok() {
        text + "ok\n"
    } else {
        text + &format!("NOT ok: {} problems\n", problems.len() as u64 + more)
    }
}
