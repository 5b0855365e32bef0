//! Uncompressed files in a zip archive, as PyTorch stores them.
//!
//! Compressed entries are refused, so contents are never larger than the file.

use std::collections::BTreeMap;
use std::io::{self, Cursor};

use ::zip::result::{ZipError, ZipResult};
use ::zip::{CompressionMethod, ZipArchive};

use super::problem::{Problem, damaged, shown, unsupported};

/// The first bytes of a zip.
pub(super) const SIGNATURE: &[u8] = b"PK\x03\x04";

/// All entries by name. Their checksums are verified.
pub(super) fn read(bytes: &[u8]) -> Result<BTreeMap<String, &[u8]>, Problem> {
    let mut archive = whole(ZipArchive::new(Cursor::new(bytes)))?;
    let numbers = 0..archive.len();
    for number in numbers.clone() {
        let entry = whole(archive.by_index_data(number))?;
        if entry.encrypted() {
            return unsupported("an encrypted zip");
        }
        if entry.compression() != CompressionMethod::Stored {
            return unsupported(format!(
                "{} is compressed, which torch.save never does: unpack it and pack it again with zip -0",
                shown(&whole(entry.name())?)
            ));
        }
    }
    // No name twice, no contents of two entries, no header that contradicts the directory.
    whole(archive.validate_header_consistency())?;
    let contents = |number: usize| {
        let mut entry = whole(archive.by_index(number))?;
        let name = whole(entry.name())?.into_owned();
        let Ok(len) = io::copy(&mut entry, &mut io::sink()) else {
            return damaged(format!("the checksum of {} differs", shown(&name)));
        };
        let start = entry.data_start().unwrap_or(u64::MAX);
        let slice = bytes.get(start as usize..).and_then(|rest| rest.get(..len as usize)); // within the file
        Ok((name, slice.unwrap_or_default()))
    };
    numbers.map(contents).collect()
}

fn whole<T>(read: ZipResult<T>) -> Result<T, Problem> {
    read.or_else(|error: ZipError| damaged(format!("a zip that is cut off or damaged: {error}")))
}
