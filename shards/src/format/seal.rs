//! Sealed JSON: a pretty-printed object whose last key, `seal`, is the SHA-256 of the text without it. It detects
//! damage to markers and the manifest, such as a flipped digit in a row count.

use std::fs::File;
use std::io::{Read, Seek};

use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

const HEAD: &str = ",\n  \"seal\": \"";
const TAIL: &str = "\"\n}\n";
const END: &str = "\n}\n";
const DIGEST_LENGTH: usize = 64;

/// SHA-256 in lower-case hex.
pub(crate) fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// SHA-256 of a file in hex, read a megabyte at a time; rewinds the file.
pub(crate) fn sha256_of_file(file: &mut File) -> std::io::Result<String> {
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 20];
    loop {
        let count = file.read(&mut buffer)?;
        if count == 0 {
            file.rewind()?;
            return Ok(hex(&hash.finalize()));
        }
        hash.update(&buffer[..count]);
    }
}

/// Bytes in lower-case hex.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Pretty JSON with a final newline. Types with string keys cannot fail.
pub(crate) fn pretty(value: &impl Serialize) -> String {
    let mut text = serde_json::to_string_pretty(value).unwrap_or_default();
    text.push('\n');
    text
}

/// The sealed text of a struct with at least one field.
pub(crate) fn seal(value: &impl Serialize) -> String {
    // In place, because the manifest of a hundred thousand shards has a quarter of a gigabyte.
    let mut text = pretty(value);
    text.truncate(text.strip_suffix(END).unwrap_or(&text).len());
    let digest = sha256_hex(text.as_bytes());
    text.extend([HEAD, &digest, TAIL]);
    text
}

/// Parses a sealed text.
///
/// # Errors
/// What is wrong, unless the text is exactly as [`seal`] wrote it.
pub(crate) fn unseal<T: DeserializeOwned>(mut text: Vec<u8>) -> Result<T, String> {
    let missing = "it does not end with its seal; it was cut off or edited";
    let rest = text.strip_suffix(TAIL.as_bytes()).ok_or(missing)?;
    let length = rest.len().checked_sub(HEAD.len() + DIGEST_LENGTH).ok_or(missing)?;
    let (body, seal) = rest.split_at(length);
    let digest = seal.strip_prefix(HEAD.as_bytes()).ok_or(missing)?;
    if sha256_hex(body).as_bytes() != digest {
        return Err("its seal does not fit; it was edited or damaged".to_owned());
    }
    text.truncate(length);
    text.extend_from_slice(END.as_bytes());
    serde_json::from_slice(&text).map_err(|e| format!("not understood: {e}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Sample {
        rows: u32,
        name: String,
    }

    #[test]
    fn every_edit_breaks_the_seal() {
        let sample = Sample { rows: 17, name: "x".to_owned() };
        let text = seal(&sample);
        let text = text.into_bytes();
        assert_eq!(unseal::<Sample>(text.clone()).unwrap(), sample);
        for position in 0..text.len() {
            let mut edited = text.clone();
            edited[position] ^= 1;
            assert!(unseal::<Sample>(edited).is_err(), "byte {position}");
            assert!(unseal::<Sample>(text[..position].to_vec()).is_err(), "cut at {position}");
        }
    }
}
