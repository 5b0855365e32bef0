//! `graspmill dataset verify`: reads and checks everything.

use clap::Args;
use indicatif::ProgressBar;
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
    let bar = ProgressBar::new_spinner();
    let verified = shards::verify(&arguments.dataset, |shard| bar.set_message(format!("shard {shard} read")))?;
    bar.finish_and_clear();
    print(text(&verified))?;
    Ok(verified.exit_code)
}

fn text(verified: &Verified) -> String {
    let Verified { counts, bytes, problems, listed, .. } = verified;
    let mut text: String = problems.iter().map(|problem| format!("{problem}\n")).collect();
    let (attempts, objects, scenes) = (counts.labels.attempts, counts.objects, counts.scenes);
    text += &format!("{attempts} attempts, {objects} objects, {scenes} scenes, {bytes} bytes read and checked\n");
    if !listed {
        text += "the store cannot list its objects: there may be files that do not belong to the dataset\n";
    }
    if verified.is_ok() { text + "ok\n" } else { text + &format!("NOT ok: {} problems\n", problems.len()) }
}
