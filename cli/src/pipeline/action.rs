//! What a step does, as values and as the command that does the same.

use std::path::{Path, PathBuf};

use program::command_line;
use trainer::run_folder::SavedAs;

/// In three quarters of a round's scenes with choices lies what the hand can span. Of objects of all sizes, a hand that
/// opens 40 mm holds a quarter as many as one of 100.
const SPANNED: [&str; 2] = ["spanned_share", "0.75"];

/// One step, which can be repeated at any time: it goes on where it was stopped.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Step {
    /// What it does.
    pub(crate) what: String,
    /// How.
    pub(crate) action: Action,
}

/// A command, with its arguments.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Action {
    /// `graspmill generate`.
    Generate { config: PathBuf, attempts: u64, shards: u64, seed: u64, policy: Option<PathBuf>, out: PathBuf },
    /// `graspmill fit`.
    Fit { config: PathBuf, epochs: u32, run: PathBuf, data: Vec<PathBuf>, from: Option<PathBuf> },
    /// `graspmill evaluate`, on all samples.
    Evaluate { run: PathBuf, data: PathBuf, report: PathBuf },
    /// `graspmill experiment run`.
    Experiment { config: PathBuf, out: PathBuf, seed: u64, rounds: u32, set: Vec<(String, String)> },
}

impl Action {
    /// A file that is there when it is done.
    pub(crate) fn done(&self) -> PathBuf {
        match self {
            Self::Generate { out, .. } => out.join("_SUCCESS"),
            Self::Fit { run, .. } => SavedAs::Best.path(run),
            Self::Evaluate { report, .. } => report.join("evaluation.json"),
            Self::Experiment { out, .. } => out.join("report.json"),
        }
    }

    /// `--set` of a dataset.
    pub(crate) fn generator_settings(policy: Option<&Path>) -> Vec<(String, String)> {
        policy.into_iter().map(|_| SPANNED.map(str::to_owned).into()).collect()
    }

    /// The command that does the same.
    pub(crate) fn command(&self) -> String {
        let mut words: Vec<String> = Vec::new();
        let mut add = |parts: &[&dyn ToString]| words.extend(parts.iter().map(|part| part.to_string()));
        match self {
            Self::Generate { config, attempts, shards, seed, policy, out } => {
                add(&[&"graspmill generate --config", &text(config), &"--attempts", attempts, &"--shards", shards]);
                add(&[&"--seed", seed, &"--out", &text(out)]);
                policy.iter().for_each(|policy| add(&[&"--policy", &text(policy)]));
                let set = Self::generator_settings(policy.as_deref());
                set.iter().for_each(|(key, value)| add(&[&"--set", &quoted(&format!("{key}={value}"))]));
            }
            Self::Fit { config, epochs, run, data, from } => {
                add(&[&"graspmill fit --resume --config", &text(config), &"--epochs", epochs, &"--run", &text(run)]);
                data.iter().for_each(|data| add(&[&"--data", &text(data)]));
                from.iter().for_each(|from| add(&[&"--from", &text(from)]));
            }
            Self::Evaluate { run, data, report } => {
                add(&[&"graspmill evaluate --run", &text(run), &"--data", &text(data), &"--split all"]);
                add(&[&"--report", &text(report)]);
            }
            Self::Experiment { config, out, seed, rounds, set } => {
                add(&[&"graspmill experiment run", &text(config), &"--out", &text(out), &"--seed", seed]);
                add(&[&"--rounds", rounds]);
                set.iter().for_each(|(key, value)| add(&[&"--set", &quoted(&format!("{key}={value}"))]));
            }
        }
        words.join(" ")
    }
}

fn text(path: &Path) -> String {
    quoted(&path.display().to_string())
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    command_line([word])
}
