//! Uncompressed files in a zip archive, as PyTorch stores them.
//!
//! PKWARE's APPNOTE.TXT 6.3.10: the end record (4.3.16) and its 64-bit form (4.3.14, 4.3.15), the central directory
//! (4.3.12), local headers (4.3.7). Compressed entries are refused, so contents are never larger than the file.

use std::collections::BTreeMap;

use super::cursor::Cursor;
use super::problem::{Problem, damaged, shown, unsupported};

/// The first bytes of every zip file with an entry.
pub(super) const SIGNATURE: &[u8] = b"PK\x03\x04";

const END_SIGNATURE: &[u8] = b"PK\x05\x06";
const END_LEN: usize = 22;
const COMMENT_LEN_MAX: usize = 0xFFFF;
const END_64_SIGNATURE: &[u8] = b"PK\x06\x06";
const LOCATOR_64_SIGNATURE: &[u8] = b"PK\x06\x07";
const LOCATOR_64_LEN: usize = 20;
const ENTRY_SIGNATURE: &[u8] = b"PK\x01\x02";
const LOCAL_LEN: u64 = 30;
const EXTRA_64: u64 = 1;
/// Marks a number that does not fit into 32 bits and is stored in 64 bits elsewhere.
const ELSEWHERE: u64 = u32::MAX as u64;

/// An entry as the directory describes it.
struct Entry<'a> {
    name: &'a str,
    header_at: u64,
    len: u64,
    crc32: u64,
}

/// The contents of an archive's entries by their names, compared with their checksums.
pub(super) fn read(bytes: &[u8]) -> Result<BTreeMap<&str, &[u8]>, Problem> {
    let mut rest = Cursor::new(directory(bytes)?);
    let (mut entries, mut total) = (BTreeMap::new(), 0_u64);
    while !rest.is_at_end() {
        let entry = entry(&mut rest)?;
        // Overlapping entries could make a small file expand to many bytes.
        total = total.saturating_add(entry.len);
        if total > bytes.len() as u64 {
            return damaged("the zip's entries are larger than the file");
        }
        if entries.insert(entry.name, contents(bytes, &entry)?).is_some() {
            return damaged(format!("{} is in the zip twice", shown(entry.name)));
        }
    }
    Ok(entries)
}

fn contents<'a>(bytes: &'a [u8], entry: &Entry<'_>) -> Result<&'a [u8], Problem> {
    let mut header = Cursor::new(slice(bytes, entry.header_at, LOCAL_LEN)?);
    if header.take(4)? != SIGNATURE {
        return damaged(format!("the zip's directory points beside {}", shown(entry.name)));
    }
    header.take(22)?; // version, flags, method, time, date, checksum, lengths: the directory has them
    let names_len = header.number(2)? + header.number(2)?;
    let contents = slice(bytes, entry.header_at + LOCAL_LEN + names_len, entry.len)?;
    if u64::from(crc32(contents)) != entry.crc32 {
        return damaged(format!("the checksum of {} differs", shown(entry.name)));
    }
    Ok(contents)
}

fn slice(bytes: &[u8], at: u64, len: u64) -> Result<&[u8], Problem> {
    let mut cursor = Cursor::new(bytes);
    cursor.take_long(at)?;
    cursor.take_long(len)
}

/// The central directory.
fn directory(bytes: &[u8]) -> Result<&[u8], Problem> {
    let first = bytes.len().saturating_sub(END_LEN + COMMENT_LEN_MAX);
    let found = bytes[first..].windows(END_LEN).rposition(|window| window.starts_with(END_SIGNATURE));
    let Some(end_at) = found.map(|at| first + at) else { return damaged("a zip that is cut off") };
    let mut end = Cursor::new(&bytes[end_at + 12..]);
    let (mut len, mut at) = (end.number(4)?, end.number(4)?);
    let locator =
        end_at.checked_sub(LOCATOR_64_LEN).and_then(|at| bytes[at..end_at].strip_prefix(LOCATOR_64_SIGNATURE));
    if let Some(locator) = locator
        && (len == ELSEWHERE || at == ELSEWHERE)
    {
        let mut locator = Cursor::new(locator);
        locator.take(4)?; // disk
        let mut end = Cursor::new(slice(bytes, locator.number(8)?, 56)?);
        if end.take(4)? != END_64_SIGNATURE {
            return damaged("the zip's locator points beside its end record");
        }
        end.take(36)?; // length, versions, disks, counts
        (len, at) = (end.number(8)?, end.number(8)?);
    }
    slice(bytes, at, len)
}

/// The next entry of the central directory.
fn entry<'a>(directory: &mut Cursor<'a>) -> Result<Entry<'a>, Problem> {
    if directory.take(4)? != ENTRY_SIGNATURE {
        return damaged("the zip's directory is damaged");
    }
    directory.take(4)?; // versions
    let (flags, method) = (directory.number(2)?, directory.number(2)?);
    directory.take(4)?; // time, date
    let (crc32, packed_len, len) = (directory.number(4)?, directory.number(4)?, directory.number(4)?);
    let (name_len, extra_len, comment_len) = (directory.number(2)?, directory.number(2)?, directory.number(2)?);
    directory.take(8)?; // disk, attributes
    let header_at = directory.number(4)?;
    let name = directory.take_long(name_len)?;
    let extra = directory.take_long(extra_len)?;
    directory.take_long(comment_len)?;
    let Ok(name) = std::str::from_utf8(name) else { return damaged("a name in the zip is not UTF-8") };
    if flags & 1 != 0 {
        return unsupported("an encrypted zip");
    }
    if method != 0 {
        return unsupported(format!(
            "{} is compressed, which torch.save never does: unpack it and pack it again with zip -0",
            shown(name)
        ));
    }
    let [len, packed_len, header_at] = wide([len, packed_len, header_at], extra)?;
    if len != packed_len {
        return damaged(format!("{} has two lengths, {len} and {packed_len}", shown(name)));
    }
    Ok(Entry { name, header_at, len, crc32 })
}

/// Length, packed length and offset of an entry; values that do not fit into 32 bits are in extra field 1.
fn wide(mut values: [u64; 3], extra: &[u8]) -> Result<[u64; 3], Problem> {
    if values.contains(&ELSEWHERE) {
        let mut fields = Cursor::new(extra);
        let mut field = loop {
            let (id, field) = (fields.number(2)?, fields.counted(2)?);
            if id == EXTRA_64 {
                break Cursor::new(field);
            }
        };
        for value in values.iter_mut().filter(|value| **value == ELSEWHERE) {
            *value = field.number(8)?;
        }
    }
    Ok(values)
}

/// The checksum of zip, PNG and Ethernet: polynomial 0xEDB88320, reflected.
pub(super) fn crc32(bytes: &[u8]) -> u32 {
    let mut table = [0_u32; 256];
    for (byte, slot) in (0_u32..).zip(&mut table) {
        *slot = (0..8).fold(byte, |crc, _| (crc >> 1) ^ (0xEDB8_8320 & 0_u32.wrapping_sub(crc & 1)));
    }
    !bytes.iter().fold(u32::MAX, |crc, byte| (crc >> 8) ^ table[((crc ^ u32::from(*byte)) & 0xFF) as usize])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_catalogue() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
        assert_eq!(crc32(b""), 0);
    }
}
