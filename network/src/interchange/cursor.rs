//! Bytes read from front to back. Nothing is copied, so a length that lies costs nothing.

use super::problem::{Problem, damaged};

/// A place in a file's bytes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// The next `count` bytes.
    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], Problem> {
        let taken = self.at.checked_add(count).and_then(|end| self.bytes.get(self.at..end));
        let Some(taken) = taken else {
            return damaged(format!(
                "it ends at byte {}, {count} bytes were to follow byte {}",
                self.bytes.len(),
                self.at
            ));
        };
        self.at += count;
        Ok(taken)
    }

    /// The next `count` bytes, `count` as a file says it.
    pub(super) fn take_long(&mut self, count: u64) -> Result<&'a [u8], Problem> {
        self.take(usize::try_from(count).unwrap_or(usize::MAX))
    }

    /// A number of `len` bytes, at most 8, little-endian.
    pub(super) fn number(&mut self, len: usize) -> Result<u64, Problem> {
        let mut wide = [0; 8];
        wide[..len].copy_from_slice(self.take(len)?);
        Ok(u64::from_le_bytes(wide))
    }

    /// A number of `len` bytes, and that many bytes.
    pub(super) fn counted(&mut self, len: usize) -> Result<&'a [u8], Problem> {
        let count = self.number(len)?;
        self.take_long(count)
    }

    /// Up to the next line feed, which is passed over.
    pub(super) fn line(&mut self) -> Result<&'a [u8], Problem> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let Some(length) = rest.iter().position(|byte| *byte == b'\n') else { return damaged("a line without an end") };
        self.at += length + 1;
        Ok(&rest[..length])
    }
}
