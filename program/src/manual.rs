//! A program's own manual: completions for shells, man pages, its reference as Markdown. All are made from the
//! definition of its command line, so none can go stale.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use clap::{Command, Subcommand};
use clap_complete::Shell;

use crate::{Context, ExitCode, Failure, print};

/// The requested document.
#[derive(Debug, Clone, Subcommand)]
pub enum Manual {
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
    /// Print this program's reference as Markdown
    Markdown,
}

/// A file of settings that comes with a program, every key with its comment.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Where it lies in the repository.
    pub path: &'static str,
    /// What it says.
    pub toml: &'static str,
    /// Its keys; none if another file of the same keys has them.
    pub rows: fn() -> Vec<settings::Row>,
}

/// Columns of the text in the reference, independent of the terminal.
const TEXT_WIDTH: usize = 110;

impl Manual {
    /// Runs the command. `chapters` are Markdown that stands at the end of the reference.
    ///
    /// # Errors
    /// If the manual cannot be printed or written.
    pub fn run(&self, command: Command, settings: &[Settings], chapters: &str) -> Result<ExitCode, Failure> {
        let name = command.get_name().to_owned();
        let mut command = command.bin_name(name.clone());
        match self {
            Self::Completions { shell } => {
                let mut text = Vec::new();
                clap_complete::generate(*shell, &mut command, name, &mut text);
                print(String::from_utf8_lossy(&text))?;
            }
            Self::Man { folder } => {
                let written = fs::create_dir_all(folder).and_then(|()| clap_mangen::generate_to(command, folder));
                written.context(format_args!("failed to write the manual into {}", folder.display()))?;
            }
            Self::Markdown => print(markdown(command, settings, chapters))?,
        }
        Ok(ExitCode::Ok)
    }
}

fn markdown(command: Command, settings: &[Settings], chapters: &str) -> String {
    let mut command = command.term_width(TEXT_WIDTH).color(clap::ColorChoice::Never);
    command.build();
    let mut text =
        format!("# {}\n\nMade by `{0} manual markdown`; change the program, not this page.\n", command.get_name());
    describe(&mut command, &mut text);
    for Settings { path, toml, rows } in settings {
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "\n## Settings: {path}\n\nEvery key, with the values that come with the program.\n\n```toml\n{toml}```\n"
        );
        let rows = rows();
        if !rows.is_empty() {
            text.push_str(
                "\nWhat each key may be. A key's name ends with its unit; `[]` stands for each table of a list. A key without a \
                 default must be there, if its table is.\n\n| key | value | default | meaning |\n|---|---|---|---|\n",
            );
        }
        for settings::Row { key, kind, default, meaning } in rows {
            let default = default.map_or_else(|| "–".to_owned(), |value| format!("`{value}`"));
            let _ = writeln!(text, "| `{key}` | {kind} | {default} | {meaning} |");
        }
    }
    text + chapters
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

    fn command() -> Command {
        let inner = Command::new("inner").about("Does a thing").arg(Arg::new("depth").long("depth").help("How deep"));
        Command::new("outer").about("Does things").subcommand(inner)
    }

    #[test]
    fn a_reference_has_every_command_every_flag_and_every_setting() {
        fn rows() -> Vec<settings::Row> {
            let [key, kind, meaning] = ["key", "a text", "Why."].map(str::to_owned);
            vec![settings::Row { key, kind, default: Some("\"now\"".to_owned()), meaning }]
        }
        let settings = [Settings { path: "a.toml", toml: "key = 1 # why\n", rows }];
        let text = markdown(command(), &settings, "\n## More\n");
        for words in [
            "# outer",
            "## outer inner",
            "--depth",
            "How deep",
            "## Settings: a.toml",
            "key = 1 # why\n```",
            "| `key` | a text | `\"now\"` | Why. |",
            "## More",
        ] {
            assert!(text.contains(words), "{words} is not in {text}");
        }
        assert_eq!(text.matches("```").count() % 2, 0);
    }

    #[test]
    fn man_pages_are_one_a_command() {
        let folder = tempfile::tempdir().unwrap();
        Manual::Man { folder: folder.path().join("man") }.run(command(), &[], "").unwrap();
        let names: Vec<String> = fs::read_dir(folder.path().join("man"))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter(|name| !name.contains("help"))
            .collect();
        assert!(names.contains(&"outer.1".to_owned()) && names.contains(&"outer-inner.1".to_owned()), "{names:?}");
    }
}
