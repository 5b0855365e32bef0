//! What a command prints and writes.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use crate::{Context, ExitCode, Failure, publish};

/// Prints to standard output, control characters escaped (as `\u001b`). A reader that closed it, such as `head`, had
/// enough: that is no error.
///
/// # Errors
/// If the output cannot be written, for example to a file on a full disk.
pub fn print(text: impl Display) -> Result<(), Failure> {
    let text = text.to_string();
    let mut out = io::stdout().lock();
    match out.write_all(escaped(&text).as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        printed => printed.context("failed to print"),
    }
}

/// Prints a line to standard error, control characters escaped. A closed standard error is no reason to fail.
pub fn print_error(text: &str) {
    let _ = writeln!(io::stderr(), "{}", escaped(text));
}

/// A text without control characters other than line breaks and tabs: what comes from a file must not command a
/// terminal. They are written as in JSON, `\u001b`, so that JSON stays JSON.
fn escaped(text: &str) -> Cow<'_, str> {
    let is_control = |letter: char| letter.is_control() && !"\n\t".contains(letter);
    if !text.contains(is_control) {
        return text.into();
    }
    let letter = |letter| if is_control(letter) { format!("\\u{:04x}", letter as u32) } else { letter.to_string() };
    text.chars().map(letter).collect()
}

/// Writes a requested output file with [`publish`].
///
/// # Errors
/// If it cannot be written; the message names it.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), Failure> {
    publish(path, bytes.as_ref()).context(format_args!("failed to write {}", path.display()))
}

/// A value as indented JSON, with a line break at the end.
///
/// # Errors
/// If the value has no JSON, which is a defect of the program.
pub fn json(value: &impl Serialize) -> Result<String, Failure> {
    let failed = |error| Failure::new(ExitCode::Internal, format!("failed to make JSON: {error}"));
    Ok(serde_json::to_string_pretty(value).map_err(failed)? + "\n")
}

/// Ends of paths to values that are too long to be told.
const LONG: [&str; 4] = [".corners_m", ".mesh", ".corners_100nm", ".triangles"];

/// The keys below `path` whose values differ, with both values.
#[must_use]
pub fn differences(path: &str, there: &Value, asked: &Value) -> Vec<String> {
    match (there, asked) {
        (Value::Object(old), Value::Object(new)) => {
            let keys: BTreeSet<&String> = old.keys().chain(new.keys()).collect();
            let inner = |key: &String| if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            keys.into_iter().flat_map(|key| differences(&inner(key), &there[key], &asked[key])).collect()
        }
        _ if there == asked => Vec::new(),
        // Lists of tables may be long: the differing element is more useful than both lists.
        (Value::Array(old), Value::Array(new)) if old.iter().chain(new).any(Value::is_object) => {
            if old.len() != new.len() {
                return vec![format!("{path} ({} of them there, {} asked for)", old.len(), new.len())];
            }
            let both = old.iter().zip(new).enumerate();
            both.flat_map(|(place, (old, new))| differences(&format!("{path}[{place}]"), old, new)).collect()
        }
        _ if LONG.iter().any(|key| path.ends_with(key)) => vec![path.to_owned()],
        _ => {
            let told = |value: &Value| if value.is_null() { "nothing".to_owned() } else { value.to_string() };
            let [there, asked] = [there, asked].map(told);
            vec![format!("{path} ({there:.200} there, {asked:.200} asked for)")]
        }
    }
}

/// The words of a command line as a person would type them into a shell.
pub fn command_line(words: impl IntoIterator<Item = impl AsRef<OsStr>>) -> String {
    words.into_iter().map(|word| quoted(&word.as_ref().to_string_lossy())).collect::<Vec<_>>().join(" ")
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let is_plain = |letter: char| letter.is_alphanumeric() || "-_./=:,+".contains(letter);
    if word.chars().all(is_plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_as_in_json() {
        assert_eq!(escaped("a\tb\n"), "a\tb\n");
        assert_eq!(escaped("\u{1b}[31m\r\u{7f}\u{9b}é"), r"\u001b[31m\u000d\u007f\u009bé");
    }

    #[test]
    fn words_are_quoted_where_a_shell_would_split_or_change_them() {
        assert_eq!(quoted("--views=3"), "--views=3");
        assert_eq!(quoted("pile, 3 views"), "'pile, 3 views'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
    }
}
