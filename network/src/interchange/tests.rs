//! Damaged and hostile files and files of other networks: each ends in an error, without delay.

use std::io::{Cursor, Write as _};

use ::zip::write::SimpleFileOptions;
use ::zip::{CompressionMethod, ZipWriter};
use proptest::prelude::*;

use super::problem::Problem;
use super::{Source, read_weights, zip};

const ZIP: &[u8] = include_bytes!("../../tests/state_dicts/zip.pth");
const LEGACY: &[u8] = include_bytes!("../../tests/state_dicts/legacy.pth");
const NESTED: &[u8] = include_bytes!("../../tests/state_dicts/nested.pth");
const WHOLE_MODEL: &[u8] = include_bytes!("../../tests/state_dicts/whole_model.pth");
const FILES: [&[u8]; 4] = [ZIP, LEGACY, NESTED, WHOLE_MODEL];

/// The entries of a file of `torch.save`.
fn entries(file: &[u8]) -> Vec<(String, Vec<u8>)> {
    zip::read(file).unwrap().into_iter().map(|(name, contents)| (name, contents.to_vec())).collect()
}

/// A zip of stored entries.
fn packed(entries: &[(String, Vec<u8>)]) -> Vec<u8> {
    let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, contents) in entries {
        zip.start_file(name, stored).unwrap();
        zip.write_all(contents).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn problem(file: &[u8]) -> Problem {
    read_weights(file).map(|(source, _)| source).unwrap_err()
}

fn told(problem: &Problem) -> String {
    match problem {
        Problem::Damaged(text) | Problem::Unsupported(text) => text.clone(),
        Problem::Architecture(problems) => problems.join("; "),
    }
}

/// A file with changed contents of one entry.
fn with(file: &[u8], suffix: &str, change: impl Fn(&mut Vec<u8>)) -> Vec<u8> {
    let mut entries = entries(file);
    let (_, contents) = entries.iter_mut().find(|(name, _)| name.ends_with(suffix)).unwrap();
    change(contents);
    packed(&entries)
}

fn replaced(contents: &mut Vec<u8>, from: &[u8], to: &[u8]) {
    let at = contents.windows(from.len()).position(|window| window == from).unwrap();
    contents.splice(at..at + from.len(), to.iter().copied());
}

#[test]
fn a_zip_packed_anew_is_the_same() {
    let (source, expected) = read_weights(ZIP).unwrap();
    assert_eq!(source, Source::TorchZip);
    assert_eq!(read_weights(&packed(&entries(ZIP))).unwrap().1, expected);
    assert_eq!(read_weights(LEGACY).unwrap(), (Source::TorchLegacy, expected));
}

#[test]
fn what_is_wrong_is_told() {
    let pickle = |from: &'static [u8], to: &'static [u8]| with(ZIP, "data.pkl", |bytes| replaced(bytes, from, to));
    for (file, words) in [
        (WHOLE_MODEL.to_vec(), "torch.nn.modules.conv.Conv3d"),
        (pickle(b"ctorch._utils\n_rebuild_tensor_v2\n", b"cbuiltins\neval\n"), "names builtins.eval,"),
        (pickle(b"FloatStorage", b"LongStorage"), "storage 0 has 8192 bytes, 2048 numbers of int64"),
        (
            pickle(b"conv_qual.bias", b"conv_qual.Bias"),
            "conv_qual.bias is missing; conv_qual.Bias is not in the network",
        ),
        (with(ZIP, "byteorder", |bytes| *bytes = b"big".to_vec()), "big-endian"),
        (with(ZIP, "data/0", |bytes| bytes.truncate(8188)), "storage 0 has 8188 bytes"),
        (
            packed(&entries(ZIP).into_iter().filter(|(name, _)| !name.ends_with("data/0")).collect::<Vec<_>>()),
            "missing",
        ),
        (packed(&[("readme.txt".to_owned(), Vec::new())]), "a zip without data.pkl"),
        (ZIP[..ZIP.len() / 2].to_vec(), "a zip that is cut off"),
        (LEGACY[..LEGACY.len() - 1].to_vec(), "it ends at byte"),
        (b"\x80\x02}q\x00.".to_vec(), "not one of torch.save"),
        ([&[b'x'; 257][..], b"ustar"].concat(), "a tar file"),
        (Vec::new(), "neither"),
    ] {
        let told = told(&problem(&file));
        assert!(told.contains(words), "{words:?} is not in {told:?}");
    }
    let mut flipped = ZIP.to_vec();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    assert_eq!(problem(&flipped), Problem::Damaged("the checksum of zip/data/0 differs".to_owned()));
}

#[test]
fn a_tensor_beside_its_storage_is_damaged() {
    // The second tensor's offset, 11 after the reference to its storage, becomes 255 * 2^16.
    let file = with(ZIP, "data.pkl", |bytes| replaced(bytes, b"QK\x0b", b"QJ\x00\x00\xff\x00"));
    assert!(told(&problem(&file)).contains("does not lie in its 2048 numbers"));
}

#[test]
fn a_compressed_zip_is_refused() {
    let mut file = packed(&entries(ZIP));
    let directory = file.windows(4).position(|window| window == b"PK\x01\x02").unwrap();
    file[directory + 10] = 8; // deflated
    assert!(told(&problem(&file)).contains("is compressed"));
}

proptest! {
    /// Valid files with flipped, cut, doubled and overwritten bytes.
    #[test]
    fn damaged_files_end(
        number in 0..FILES.len(),
        changes in proptest::collection::vec((0.0..1.0_f64, 0_u8..4, any::<u8>()), 1..6),
    ) {
        let mut file = FILES[number].to_vec();
        damage(&mut file, &changes);
        let _ = read_weights(&file);
    }

    /// The same inside a pickle with a valid checksum.
    #[test]
    fn damaged_pickles_end(
        number in 0..FILES.len(),
        changes in proptest::collection::vec((0.0..1.0_f64, 0_u8..4, any::<u8>()), 1..6),
    ) {
        if number != 1 {
            let file = with(FILES[number], "data.pkl", |pickle| damage(pickle, &changes));
            let _ = read_weights(&file);
        } else {
            let (pickles, numbers) = LEGACY.split_at(LEGACY.len() - 8200);
            let mut pickles = pickles.to_vec();
            damage(&mut pickles, &changes);
            let _ = read_weights(&[&pickles, numbers].concat());
        }
    }

    #[test]
    fn any_bytes_end(bytes in proptest::collection::vec(any::<u8>(), 0..300), begin in 0_usize..4) {
        let begin: &[u8] = [&b"PK\x03\x04"[..], &LEGACY[..21], b"\x40\0\0\0\0\0\0\0{", b""][begin];
        let _ = read_weights(&[begin, &bytes].concat());
    }
}

fn damage(file: &mut Vec<u8>, changes: &[(f64, u8, u8)]) {
    for (place, kind, value) in changes {
        let at = (place * file.len() as f64) as usize;
        match kind {
            0 if at < file.len() => file[at] ^= 1 << (value % 8),
            1 if at < file.len() => file[at] = *value,
            2 => file.truncate(at.max(1)),
            _ => {
                let end = (at + usize::from(*value)).min(file.len());
                let part = file[at..end].to_vec();
                file.splice(at..at, part);
            }
        }
    }
}
