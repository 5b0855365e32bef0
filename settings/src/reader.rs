//! Reads a table key by key and collects every fault with its path.

use std::fmt::Display;
use std::path::Path;

use toml::{Table, Value};

use crate::Setting;

/// Where reading stands: the path of the key that is read, and all faults so far.
#[derive(Debug)]
pub struct Reader<'a> {
    path: String,
    faults: Vec<String>,
    folder: &'a Path,
}

/// Most characters of a wrong value that a message repeats.
const SHOWN_MAX: usize = 100;

/// `, did you mean …?` with the name that is most like a wrong one, or has it in itself; nothing if none is.
#[must_use]
pub fn hint<'n>(wrong: &str, names: impl IntoIterator<Item = &'n str>) -> String {
    let distance = |name: &&str| strsim::damerau_levenshtein(name, wrong);
    let is_near = |name: &&str| {
        let letters = wrong.chars().count();
        distance(name) <= (letters / 3).max(1) || (letters > 2 && name.contains(wrong))
    };
    let nearest = names.into_iter().filter(is_near).min_by_key(distance);
    nearest.map(|name| format!(", did you mean {name}?")).unwrap_or_default()
}

impl<'a> Reader<'a> {
    pub(crate) fn new(folder: &'a Path, path: &str) -> Self {
        Self { path: path.to_owned(), faults: Vec::new(), folder }
    }

    pub(crate) fn into_faults(self) -> Vec<String> {
        self.faults
    }

    /// Whether there are faults.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.faults.is_empty()
    }

    /// The settings' folder, where relative paths begin.
    #[must_use]
    pub fn folder(&self) -> &Path {
        self.folder
    }

    /// The text of a file that a setting names; a relative path begins in the settings' folder.
    ///
    /// # Errors
    /// What the system reports, with the path.
    pub fn text_of(&self, file: &str) -> Result<String, String> {
        let path = self.folder.join(file);
        crate::read_text(&path).map_err(|e| format!("cannot be read: {e}: {}", path.display()))
    }

    /// Notes a fault of the key that is read: `{path} {rule}`.
    pub fn fault(&mut self, rule: impl Display) {
        self.faults.push(format!("{} {rule}", self.path).trim_start().to_owned());
    }

    /// Notes what is wrong with what the key names: `{path}: {problem}`.
    pub fn report(&mut self, problem: impl Display) {
        self.faults.push(format!("{}: {problem}", self.path));
    }

    /// Notes that the key must be `rule` and is `value`.
    pub fn misfit(&mut self, rule: impl Display, value: &Value) {
        let mut got = value.to_string();
        if let Some((end, _)) = got.char_indices().nth(SHOWN_MAX) {
            got.truncate(end);
            got.push('…');
        }
        self.fault(format_args!("must be {rule}, got {got}"));
    }

    /// Notes a fault of a key in the table that is read unless `holds`; `rule` begins with `must`.
    pub fn must<R: Display>(&mut self, key: &str, holds: bool, rule: impl FnOnce() -> R) {
        if !holds {
            self.within(key, |reader| reader.fault(rule()));
        }
    }

    /// Does something one key deeper.
    pub fn within<T>(&mut self, key: &str, act: impl FnOnce(&mut Self) -> T) -> T {
        let length = self.path.len();
        if length > 0 {
            self.path.push('.');
        }
        self.path.push_str(key);
        let result = act(self);
        self.path.truncate(length);
        result
    }

    /// Reads settings that stand in a file of their own; their faults end with its name.
    pub fn in_file<T: Setting<Limits = ()>>(&mut self, file: &str, text: &str) -> Option<T> {
        let before = self.faults.len();
        let read = match text.parse::<Table>() {
            Ok(table) => T::read(&Value::Table(table), &(), self),
            Err(e) => {
                self.fault(format_args!("is not TOML: {}", e.message()));
                None
            }
        };
        self.faults[before..].iter_mut().for_each(|fault| fault.push_str(&format!(": {}", file.escape_debug())));
        read
    }

    /// The value as a table; keys that are not among `keys` are faults.
    pub fn table<'v>(&mut self, value: &'v Value, keys: &[&str]) -> Option<&'v Table> {
        let Some(table) = value.as_table() else {
            self.misfit("a table", value);
            return None;
        };
        for key in table.keys().filter(|key| !keys.contains(&key.as_str())) {
            let hint = hint(key, keys.iter().copied());
            // Quoted keys may contain anything.
            let key = key.escape_debug().to_string();
            self.within(&key, |reader| reader.fault(format_args!("is an unknown key{hint}")));
        }
        Some(table)
    }

    /// The setting under a key: read, or its default; a fault if it is missing and has none.
    pub fn key<T: Setting>(
        &mut self,
        table: &Table,
        key: &str,
        limits: &T::Limits,
        default: Option<T>,
        kind: &str,
        read: fn(&Value, &T::Limits, &mut Self) -> Option<T>,
    ) -> Option<T> {
        self.within(key, |reader| match table.get(key) {
            Some(value) => read(value, limits, reader),
            None if default.is_some() => default,
            None => {
                reader.fault(format_args!("is missing: {kind}"));
                None
            }
        })
    }
}
