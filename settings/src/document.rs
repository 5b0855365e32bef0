//! The only reader of settings: a TOML file or a built-in text, overrides, and stored settings.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};

use serde::Serialize;
use toml::{Table, Value};

use crate::{Error, Reader, Setting, hint};

/// The text of settings, parsed but not yet checked.
#[derive(Debug, Clone)]
pub struct Document {
    table: Table,
    path: PathBuf,
}

impl Document {
    /// The document in a file, or a built-in one, given by its text and the path for messages.
    ///
    /// # Errors
    /// [`Error::Read`] and [`Error::Syntax`].
    pub fn load(path: Option<&Path>, [built_in, name]: [&str; 2]) -> Result<Self, Error> {
        match path {
            None => Self::parse(built_in, Path::new(name)),
            Some(path) => {
                let text = read_text(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
                Self::parse(&text, path)
            }
        }
    }

    /// The document in a text. Messages name `path`, and paths in the text are relative to its folder.
    ///
    /// # Errors
    /// [`Error::Syntax`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let syntax =
            |e: toml::de::Error| Error::Syntax { path: path.to_owned(), message: e.to_string().trim().to_owned() };
        Ok(Self { table: text.parse().map_err(syntax)?, path: path.to_owned() })
    }

    /// The table, including overrides.
    #[must_use]
    pub fn table(&self) -> &Table {
        &self.table
    }

    /// The table, for changes before it is read.
    pub fn table_mut(&mut self) -> &mut Table {
        &mut self.table
    }

    /// Overrides a key such as `views.count` by a value, given as TOML or as plain text.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the document has no such key.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), Error> {
        let parsed = format!("value = {value}").parse::<Table>().ok().and_then(|mut one| one.remove("value"));
        let value = parsed.unwrap_or_else(|| Value::String(value.to_owned()));
        let mut parts = key.split('.');
        let first = self.table.get_mut(parts.next().unwrap_or_default());
        let slot = parts.fold(first, |slot, part| slot?.as_table_mut()?.get_mut(part));
        let Some(slot) = slot else {
            let paths = paths(&self.table, "");
            let hint = hint(key, paths.iter().map(String::as_str));
            return Err(self.invalid(vec![format!("there is no key {key}{hint}")]));
        };
        *slot = match (&*slot, value) {
            (Value::Float(_), Value::Integer(whole)) => Value::Float(whole as f64),
            (_, value) => value,
        };
        Ok(())
    }

    /// Reads all settings.
    ///
    /// # Errors
    /// [`Error::Invalid`] with every unknown, missing and invalid key.
    pub fn read<T: Setting<Limits = ()>>(&self) -> Result<T, Error> {
        self.read_as("")
    }

    /// Reads all settings; messages begin with `path`.
    ///
    /// # Errors
    /// As [`Document::read`].
    pub fn read_as<T: Setting<Limits = ()>>(&self, path: &str) -> Result<T, Error> {
        let mut reader = Reader::new(self.folder(), path);
        let read = T::read(&Value::Table(self.table.clone()), &(), &mut reader);
        match read {
            Some(read) if reader.is_sound() => Ok(read),
            _ => Err(self.invalid(reader.into_faults())),
        }
    }

    /// The folder of relative paths.
    #[must_use]
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// An error for faults that the rows do not cover.
    #[must_use]
    pub fn invalid(&self, faults: Vec<String>) -> Error {
        Error::Invalid { path: self.path.clone(), faults }
    }
}

/// The paths of all keys of a table, each after `before`.
fn paths(table: &Table, before: &str) -> Vec<String> {
    let below = |(key, value): (&String, &Value)| {
        let path = format!("{before}{key}");
        let deeper = value.as_table().map(|inner| paths(inner, &format!("{path}.")));
        [vec![path], deeper.unwrap_or_default()].concat()
    };
    table.iter().flat_map(below).collect()
}

/// Largest text of settings, in bytes.
const TEXT_BYTES_MAX: u64 = 64 << 20;

/// The text of a file that a user names. It may be a pipe, as shells make them of a command's output.
///
/// # Errors
/// What the system reports; [`ErrorKind::InvalidData`] if the text has more than 64 MiB or is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    if File::open(path)?.take(TEXT_BYTES_MAX + 1).read_to_string(&mut text)? as u64 > TEXT_BYTES_MAX {
        return Err(io::Error::new(ErrorKind::InvalidData, "settings must have at most 64 MiB"));
    }
    Ok(text)
}

/// The values out of range in settings that were not read from a document; `path` is their path.
#[must_use]
pub fn faults_of<T: Setting<Limits = ()> + Serialize>(settings: &T, path: &str) -> Vec<String> {
    read_stored::<T>(settings, path).err().unwrap_or_default()
}

/// Reads stored settings, in JSON or another serde format; `path` is their path.
///
/// # Errors
/// All faults, as for a document.
pub fn read_stored<T: Setting<Limits = ()>>(stored: &impl Serialize, path: &str) -> Result<T, Vec<String>> {
    let mut reader = Reader::new(Path::new(""), path);
    let read = match Value::try_from(stored) {
        Ok(value) => T::read(&value, &(), &mut reader),
        Err(e) => {
            reader.fault(format_args!("cannot be settings: {e}"));
            None
        }
    };
    read.filter(|_| reader.is_sound()).ok_or(reader.into_faults())
}
