//! The journal of an experiment: the rounds that were played, one a line, from which an interrupted run continues.
//!
//! A last line without a line break was cut off: its round is played again.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use program::{Context as _, ExitCode, Failure, open_as, unread};
use serde::Serialize;

use crate::files::bytes;
use crate::record::Round;

/// The journal's name.
const JOURNAL: &str = "journal.jsonl";

/// The first line: the program and the experiment that wrote the journal.
#[derive(Debug, Serialize)]
pub(crate) struct Identity {
    pub(crate) version: String,
    pub(crate) model: String,
    pub(crate) config: String,
    pub(crate) seeds: Vec<u64>,
    /// Rounds of a seed where there are several.
    pub(crate) rounds: u64,
}

/// A journal to which rounds are added.
#[derive(Debug)]
pub(crate) struct Journal {
    file: Mutex<File>,
    path: PathBuf,
}

impl Journal {
    /// Opens the journal of a folder, without a truncated last line, or begins it. Also returns its rounds, by number.
    pub(crate) fn open(folder: &Path, identity: &Identity) -> Result<(Self, Vec<Round>), Failure> {
        let path = folder.join(JOURNAL);
        let first = line(identity).context("failed to begin a journal")?;
        let text = match whole_lines(&path)? {
            Some(text) => text,
            None => {
                program::write(&path, &first)?;
                first.clone()
            }
        };
        let rounds = text.strip_prefix(&first).ok_or_else(|| {
            let text = "the folder holds another experiment: its experiment.toml, network or program differs";
            Failure::new(ExitCode::Config, format!("{text}: {}", path.display()))
        })?;
        let rounds = rounds_of(rounds).map_err(|error| unread(&path, &error))?;
        let file = open_as(&path, File::options().append(true));
        let file = file.and_then(|file| file.set_len(text.len() as u64).map(|()| file));
        let file = file.context(format_args!("failed to write {}", path.display()))?;
        Ok((Self { file: Mutex::new(file), path }, rounds))
    }

    /// Adds a round.
    pub(crate) fn push(&self, round: &Round) -> Result<(), Failure> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let written = line(round).and_then(|line| file.write_all(line.as_bytes()));
        written.context(format_args!("failed to write {}", self.path.display()))
    }
}

/// The lines of a journal, without a truncated last one; `None` if there is no journal.
fn whole_lines(path: &Path) -> Result<Option<String>, Failure> {
    let Some(mut bytes) = bytes(path)? else { return Ok(None) };
    bytes.truncate(bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1));
    let damaged = |error| unread(path, &io::Error::new(ErrorKind::InvalidData, error));
    String::from_utf8(bytes).map(Some).map_err(damaged)
}

/// The rounds of a journal's lines after the first, by number.
fn rounds_of(text: &str) -> io::Result<Vec<Round>> {
    let mut rounds = BTreeMap::new();
    for (number, line) in (2..).zip(text.lines()) {
        let damaged = |error| io::Error::new(ErrorKind::InvalidData, format!("line {number} is not a round: {error}"));
        let round: Round = serde_json::from_str(line).map_err(damaged)?;
        rounds.insert(round.round, round);
    }
    Ok(rounds.into_values().collect())
}

/// A line of the journal, with its line break.
fn line(value: &impl Serialize) -> io::Result<String> {
    Ok(serde_json::to_string(value)? + "\n")
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::record::Ending;

    fn identity(config: &str) -> Identity {
        let [version, model, config] = ["0.2.0", "c0ffee", config].map(str::to_owned);
        Identity { version, model, config, seeds: vec![7, 8], rounds: 2 }
    }

    fn round(number: u64) -> Round {
        Round {
            round: number,
            seed: 7 + number / 2,
            scene_id: number % 2,
            group: "pile".to_owned(),
            unviable_count: 0,
            object_count: 3,
            removed_count: 0,
            lost_count: 1,
            ending: Ending::NoGrasp,
            no_answer: None,
            container: None,
            attempts: Vec::new(),
            left: Vec::new(),
        }
    }

    /// A folder with a journal of three rounds, and its text.
    fn begun() -> (tempfile::TempDir, String) {
        let folder = tempfile::tempdir().unwrap();
        let (journal, rounds) = Journal::open(folder.path(), &identity("a")).unwrap();
        assert_eq!(rounds, []);
        [2, 0, 1].iter().for_each(|number| journal.push(&round(*number)).unwrap());
        let text = fs::read_to_string(folder.path().join(JOURNAL)).unwrap();
        (folder, text)
    }

    fn read(folder: &Path, text: &str) -> Result<Vec<Round>, Failure> {
        fs::write(folder.join(JOURNAL), text).unwrap();
        Journal::open(folder, &identity("a")).map(|(_, rounds)| rounds)
    }

    #[test]
    fn a_journal_that_was_cut_off_goes_on_after_its_last_whole_line() {
        let (folder, text) = begun();
        assert_eq!(read(folder.path(), &text).unwrap(), [0, 1, 2].map(round));
        let first = text.find('\n').unwrap() + 1; // written at once
        for end in first..text.len() {
            let whole = text[..end].matches('\n').count();
            fs::write(folder.path().join(JOURNAL), &text[..end]).unwrap();
            let (_, rounds) = Journal::open(folder.path(), &identity("a")).unwrap();
            assert_eq!(rounds.len(), whole - 1, "cut to {end} bytes");
        }
        let (journal, rounds) = Journal::open(folder.path(), &identity("a")).unwrap();
        assert_eq!(rounds, [round(0), round(2)]);
        journal.push(&round(1)).unwrap();
        assert_eq!(fs::read_to_string(folder.path().join(JOURNAL)).unwrap(), text);
        assert_eq!(Journal::open(folder.path(), &identity("b")).unwrap_err().exit_code(), ExitCode::Config);
    }

    #[test]
    fn a_line_that_is_no_round_is_named() {
        let (folder, text) = begun();
        let failure = read(folder.path(), &text.replacen("\"round\":0", "\"round\":-", 1)).unwrap_err();
        assert!(failure.exit_code() == ExitCode::Data, "{failure}");
        assert!(failure.to_string().contains("line 3 is not a round"), "{failure}");
    }
}
