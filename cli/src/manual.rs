//! The manual: completions for shells, man pages, the reference as Markdown. All are made from the definition of the
//! command line, of the settings and of the tables, so none can go stale.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use clap::{Command, CommandFactory, Subcommand};
use clap_complete::Shell;
use program::{Context, ExitCode, Failure, print};
use settings::{Row, rows_of, words};

use crate::Graspmill;
use crate::parse::one_of;

/// Write shell completions, man pages, or the reference
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum Manual {
    /// Print completions for a shell, to be sourced or put where the shell looks for them
    Completions {
        /// Which shell
        shell: Shell,
    },
    /// Write man pages, one for the program and one for each command
    Man {
        /// Into this folder; made if missing
        folder: PathBuf,
    },
    /// Print a page of the reference as Markdown
    Markdown {
        /// Which page
        #[arg(default_value = "commands", value_parser = one_of!(Page))]
        page: Page,
    },
}

words! {
    /// A page of the reference.
    pub(crate) enum Page {
        /// Every command with its help.
        Commands = "commands",
        /// Every key of every kind of settings.
        Settings = "settings",
        /// Every column of a dataset.
        Tables = "tables",
    }
}

/// Files of settings that come with the program: where each lies in the repository, what it says, every key with its
/// comment, and its keys, unless another file of the same keys has them.
type Settings = (&'static str, &'static str, fn() -> Vec<Row>);

const SETTINGS: &[Settings] = &[
    #[cfg(feature = "full")]
    ("configs/generate/paper.toml", include_str!("../../configs/generate/paper.toml"), rows_of::<generator::Config>),
    (
        "configs/grippers/parallel_jaw_80.toml",
        include_str!("../../configs/grippers/parallel_jaw_80.toml"),
        rows_of::<schema::Gripper>,
    ),
    #[cfg(feature = "full")]
    ("configs/train/paper.toml", trainer::config::PAPER, rows_of::<trainer::config::Config>),
    ("configs/plan/paper.toml", planner::BuiltIn::Paper.text(), rows_of::<planner::Config>),
    ("configs/plan/judge.toml", planner::BuiltIn::Judge.text(), Vec::new),
    #[cfg(feature = "full")]
    ("configs/experiment/pile.toml", experiments::config::REFERENCE, rows_of::<experiments::config::Keys>),
];

/// Columns of the text in the reference, independent of the terminal.
const TEXT_WIDTH: usize = 110;

impl Manual {
    /// Runs the command.
    pub(crate) fn run(&self) -> Result<ExitCode, Failure> {
        let mut command = Graspmill::command().bin_name("graspmill");
        match self {
            Self::Completions { shell } => {
                let mut text = Vec::new();
                clap_complete::generate(*shell, &mut command, "graspmill", &mut text);
                print(String::from_utf8_lossy(&text))?;
            }
            Self::Man { folder } => {
                let written = fs::create_dir_all(folder).and_then(|()| clap_mangen::generate_to(command, folder));
                written.context(format_args!("failed to write the manual into {}", folder.display()))?;
            }
            Self::Markdown { page } => {
                let body = match page {
                    Page::Commands => commands(command),
                    Page::Settings => settings_page(SETTINGS),
                    Page::Tables => tables(),
                };
                let name = page.name();
                print(format_args!(
                    "# {}{}\n\nMade by `graspmill manual markdown {name}`; change the program, not this page.\n{body}",
                    name[..1].to_uppercase(),
                    &name[1..]
                ))?;
            }
        }
        Ok(ExitCode::Ok)
    }
}

fn commands(command: Command) -> String {
    let mut command = command.term_width(TEXT_WIDTH).color(clap::ColorChoice::Never);
    command.build();
    let mut text = String::new();
    describe(&mut command, &mut text);
    text
}

fn settings_page(settings: &[Settings]) -> String {
    let mut text = "\nWhat each key may be. A key's name ends with its unit; `[]` stands for each table of a list. A key without a \
                    default must be there, if its table is.\n"
        .to_owned();
    for (path, toml, rows) in settings {
        // Writing to a String cannot fail.
        let _ = write!(text, "\n## {path}\n\n```toml\n{toml}```\n");
        let rows = rows();
        if !rows.is_empty() {
            text.push_str("\n| key | value | default | meaning |\n|---|---|---|---|\n");
        }
        for Row { key, kind, default, meaning } in rows {
            let default = default.map_or_else(|| "–".to_owned(), |value| format!("`{value}`"));
            let _ = writeln!(text, "| `{key}` | {kind} | {default} | {meaning} |");
        }
    }
    text
}

/// The tables on disk: the paper's voxels, and all columns.
#[cfg(feature = "full")]
fn tables() -> String {
    use shards::{Form, Table};

    const FORM: Form = Form { resolution: 40, has_grippers: true, has_containers: true, has_repeats: true };
    Table::ALL.into_iter().map(|table| format!("\n## {}\n\n{}", table.name(), table.described(FORM))).collect()
}

#[cfg(not(feature = "full"))]
fn tables() -> String {
    String::new()
}

/// The help of a command and of those below it.
fn describe(command: &mut Command, text: &mut String) {
    let name = command.get_bin_name().unwrap_or(command.get_name()).to_owned();
    let help = command.render_long_help().to_string();
    let lines: Vec<&str> = help.trim().lines().map(str::trim_end).collect();
    let _ = write!(text, "\n## {name}\n\n```text\n{}\n```\n", lines.join("\n"));
    let below = command.get_subcommands_mut().filter(|sub| sub.get_name() != "help");
    below.for_each(|sub| describe(sub, text));
}

#[cfg(test)]
mod tests {
    use clap::Arg;

    use super::*;

    #[test]
    fn a_reference_has_every_command_every_flag_and_every_setting() {
        fn rows() -> Vec<Row> {
            let [key, kind, meaning] = ["key", "a text", "Why."].map(str::to_owned);
            vec![Row { key, kind, default: Some("\"now\"".to_owned()), meaning }]
        }
        let inner = Command::new("inner").about("Does a thing").arg(Arg::new("depth").long("depth").help("How deep"));
        let command = Command::new("outer").about("Does things").subcommand(inner);
        let text = commands(command) + &settings_page(&[("a.toml", "key = 1 # why\n", rows)]);
        for words in [
            "## outer\n",
            "## outer inner",
            "--depth",
            "How deep",
            "## a.toml",
            "key = 1 # why\n```",
            "| `key` | a text | `\"now\"` | Why. |",
        ] {
            assert!(text.contains(words), "{words} is not in {text}");
        }
        assert_eq!(text.matches("```").count() % 2, 0);
    }

    #[test]
    fn man_pages_are_one_a_command() {
        let folder = tempfile::tempdir().unwrap();
        Manual::Man { folder: folder.path().join("man") }.run().unwrap();
        for name in ["graspmill.1", "graspmill-plan.1", "graspmill-dataset-verify.1"] {
            assert!(folder.path().join("man").join(name).exists(), "{name}");
        }
    }

    #[test]
    fn the_command_line_is_consistent() {
        Graspmill::command().debug_assert();
    }
}
