//! The command line.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::str::FromStr;

use clap::{Parser, Subcommand};

/// Generate a grasp dataset: random stacked scenes, rule-based grasps executed in physics, labels, Parquet shards.
///
/// Running the same command again continues: committed shards are skipped, and the bytes are those of an uninterrupted
/// run. A dataset is a pure function of the config, the seed and this program's version.
#[derive(Debug, Parser)]
#[command(name = "generator", version, after_help = EXAMPLES)]
#[command(subcommand_negates_reqs = true, args_conflicts_with_subcommands = true, subcommand_value_name = "COMMAND")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub command: Option<Command>,

    /// Number of shards; part of the dataset's identity [default: the config's]
    #[arg(long, value_name = "N")]
    pub shards: Option<u64>,

    /// Only these shards: one, several, or ranges, such as 3 or 0,4,8-11
    #[arg(long, value_name = "LIST")]
    pub shard_index: Option<ShardIndices>,

    /// Attempts in the whole dataset [default: the config's]
    #[arg(long, value_name = "N")]
    pub attempts: Option<u64>,

    /// Seed of every random draw [default: the config's]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,

    /// Threads; never changes the bytes [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=4096))]
    pub threads: Option<u64>,

    /// Config file [default: the built-in configs/generate/paper.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Folder of the dataset; made if missing
    #[arg(long, value_name = "DIR", required = true)]
    pub out: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Measure what generating costs, stage by stage, and what its shortcuts change
    Bench(BenchArguments),
    /// Execute a dataset's attempts again, from its rows alone: do they end as stored?
    Repeat(RepeatArguments),
}

#[derive(Debug, clap::Args)]
pub(crate) struct RepeatArguments {
    /// Folder of the dataset
    pub dataset: PathBuf,

    /// Only the first N scenes [default: all]
    #[arg(long, value_name = "N")]
    pub scenes: Option<u64>,

    /// Threads [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=4096))]
    pub threads: Option<u64>,
}

#[derive(Debug, clap::Args)]
pub(crate) struct BenchArguments {
    /// Attempts of every run
    #[arg(long, value_name = "N", default_value_t = 12_000)]
    pub attempts: u64,

    /// Attempts that are executed again by slower settings; 0 for none
    #[arg(long, value_name = "N", default_value_t = 3_000)]
    pub repeat: u64,

    /// Seed of every random draw [default: the config's]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,

    /// Threads of the widest run [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=4096))]
    pub threads: Option<u64>,

    /// Config file [default: the built-in configs/generate/paper.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Write the report as Markdown too
    #[arg(long, value_name = "FILE")]
    pub markdown: Option<PathBuf>,

    /// Write everything as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

const EXAMPLES: &str = "\
Examples:
  generator --shards 64 --out grasps                    the paper's 200,000 attempts
  generator --config my.toml --shards 4 --attempts 2400 --out small
  generator --shards 64 --shard-index 3 --out grasps    one shard, as a cluster job does
  shards verify grasps && shards report grasps
  generator bench --markdown bench.md                   what an attempt costs on this machine

Exit codes:
   0  done
   1  internal error
   2  wrong command line
  65  a shard or an attempt came out differently from an earlier run, or a dataset is damaged
  75  I/O trouble or stopped by a signal: run again
  78  wrong configuration, or the folder holds something else

GRASPMILL_LOG=info shows which shards are skipped and committed.";

/// Shard indices from text such as `0,4,8-11`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ShardIndices(pub BTreeSet<u32>);

/// The most shards a range may name.
const INDICES_MAX: u32 = 100_000;

impl FromStr for ShardIndices {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |part: &str| part.trim().parse::<u32>().map_err(|_| format!("`{part}` is no shard index"));
        let mut indices = BTreeSet::new();
        for part in text.split(',') {
            let (first, last) = match part.split_once('-') {
                Some((first, last)) => (number(first)?, number(last)?),
                None => (number(part)?, number(part)?),
            };
            if first > last {
                return Err(format!("the range `{part}` is empty"));
            }
            if last >= INDICES_MAX {
                return Err(format!("a shard index must be below {INDICES_MAX}, got {last}"));
            }
            indices.extend(first..=last);
        }
        Ok(Self(indices))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Vec<u32>, String> {
        text.parse::<ShardIndices>().map(|indices| indices.0.into_iter().collect())
    }

    #[test]
    fn indices_come_alone_in_lists_and_in_ranges() {
        assert_eq!(parse("3"), Ok(vec![3]));
        assert_eq!(parse("0,4, 8-10,9"), Ok(vec![0, 4, 8, 9, 10]));
        for bad in ["", "x", "3-1", "1,,2", "-1", "0-4294967295"] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }
}
