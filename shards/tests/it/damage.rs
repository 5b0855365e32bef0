//! Every kind of damage to a dataset's files is found, with an error and the right exit code, and never with a panic.

use std::fs;
use std::path::Path;

use program::{ExitCode, Failure};
use shards::{Dataset, Draft, layout, verify};

use crate::sample;

/// The result of reading everything, as a trainer does.
fn read_all(dir: &Path) -> Result<(), Failure> {
    let dataset = Dataset::open(dir)?;
    for shard in 0..dataset.shard_count() {
        dataset.rows(shard, true)?.try_for_each(|rows| rows.map(drop))?;
    }
    Ok(())
}

/// The code with which `graspmill dataset verify` would end.
fn verified(dir: &Path) -> ExitCode {
    match verify(dir, |_| ()) {
        Ok(verified) => verified.exit_code,
        Err(e) => e.exit_code(),
    }
}

/// Every file with data or metadata.
fn files(dir: &Path) -> Vec<String> {
    let all = sample::files(dir).into_iter().map(|(path, _)| path.to_string_lossy().into_owned());
    all.filter(|name| ![layout::CARD, layout::SUCCESS].contains(&name.as_str())).collect()
}

/// Damages one file after the other in one way; each time verify must find it, and readers too unless it is a marker,
/// which they do not need.
fn check(damage: impl Fn(&[u8]) -> Vec<Vec<u8>>, expected: ExitCode) {
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), &sample::info(3));
    assert_eq!(verified(dir.path()), ExitCode::Ok);
    for name in files(dir.path()) {
        let path = dir.path().join(&name);
        let whole = fs::read(&path).unwrap();
        for (case, damaged) in damage(&whole).into_iter().enumerate() {
            fs::write(&path, damaged).unwrap();
            assert_eq!(verified(dir.path()), expected, "{name}, case {case}");
            if !name.starts_with("meta/shards") {
                let error = read_all(dir.path()).expect_err(&format!("{name}, case {case}"));
                assert_eq!(error.exit_code(), expected, "{name}, case {case}: {error}");
                let told = error.to_string();
                assert!(told.contains(&name), "{name}, case {case} is not named: {told}");
            }
        }
        fs::write(&path, whole).unwrap();
    }
    assert_eq!(verified(dir.path()), ExitCode::Ok);
}

#[test]
fn flipped_bits_are_found() {
    let flip = |whole: &[u8]| {
        (0..60)
            .map(|case| {
                let mut bytes = whole.to_vec();
                let at = case * (bytes.len() - 1) / 59;
                bytes[at] ^= 1 << (case % 8);
                bytes
            })
            .collect()
    };
    // A flip in info.json may leave its path unnamed only by naming the manifest, whose id it breaks.
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), &sample::info(3));
    for name in files(dir.path()) {
        let path = dir.path().join(&name);
        let whole = fs::read(&path).unwrap();
        let cases: Vec<Vec<u8>> = flip(&whole);
        for (case, damaged) in cases.into_iter().enumerate() {
            fs::write(&path, damaged).unwrap();
            assert_eq!(verified(dir.path()), ExitCode::Data, "{name}, case {case}");
            if !name.starts_with("meta/shards") {
                assert_eq!(read_all(dir.path()).unwrap_err().exit_code(), ExitCode::Data, "{name}, case {case}");
            }
        }
        fs::write(&path, whole).unwrap();
    }
}

#[test]
fn cut_and_lengthened_files_are_found() {
    check(
        |whole| {
            let mut cases: Vec<Vec<u8>> =
                [0, 1, 4, whole.len() / 2, whole.len() - 1].map(|n| whole[..n].to_vec()).into();
            cases.push([whole, b"PAR1"].concat());
            cases
        },
        ExitCode::Data,
    );
}

#[test]
fn zeroed_blocks_are_found() {
    let zeroed = |whole: &[u8]| {
        let mut bytes = whole.to_vec();
        let middle = bytes.len() / 2;
        bytes[middle..middle + 64].fill(0);
        vec![bytes]
    };
    check(zeroed, ExitCode::Data);
}

#[test]
fn missing_files_are_found() {
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), &sample::info(3));
    for name in files(dir.path()) {
        let path = dir.path().join(&name);
        let whole = fs::read(&path).unwrap();
        fs::remove_file(&path).unwrap();
        let expected = match name.as_str() {
            layout::INFO => ExitCode::Config,
            layout::MANIFEST => ExitCode::Incomplete,
            _ => ExitCode::Data,
        };
        assert_eq!(verified(dir.path()), expected, "{name}");
        fs::write(&path, whole).unwrap();
    }
    let nowhere = Dataset::open(&dir.path().join("nowhere")).unwrap_err();
    assert_eq!(nowhere.exit_code(), ExitCode::Config, "{nowhere}");
}

#[test]
fn swapped_files_and_files_of_another_dataset_are_found() {
    let (dir, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    sample::write(dir.path(), &sample::info(3));
    sample::write(other.path(), &sample::info(4));
    let names = files(dir.path());
    for name in &names {
        let path = dir.path().join(name);
        let whole = fs::read(&path).unwrap();
        fs::copy(other.path().join(name), &path).unwrap();
        assert_eq!(verified(dir.path()), ExitCode::Data, "{name} of another dataset");
        fs::write(&path, &whole).unwrap();
        let sibling = name.replace("00000", "00001").replace("00001-of-00001", "00001-of-00002");
        if sibling != *name && names.contains(&sibling) {
            fs::copy(dir.path().join(&sibling), &path).unwrap();
            assert_eq!(verified(dir.path()), ExitCode::Data, "{name} is {sibling}");
            fs::write(&path, &whole).unwrap();
        }
    }
    assert_eq!(verified(dir.path()), ExitCode::Ok);
}

#[test]
fn a_stray_file_that_globs_would_read_is_found() {
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), &sample::info(3));
    fs::write(dir.path().join("attempts/.hidden#host-1-a.tmp"), "left by a killed writer").unwrap();
    assert_eq!(verified(dir.path()), ExitCode::Ok);
    fs::write(dir.path().join("attempts/copy.parquet"), "mine").unwrap();
    let found = verify(dir.path(), |_| ()).unwrap();
    assert_eq!(found.problems.len(), 1);
    assert!(found.problems[0].starts_with("attempts/copy.parquet is not in the manifest"), "{:?}", found.problems);
}

#[test]
fn every_damaged_shard_is_told_not_only_the_first() {
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), &sample::info(3));
    for name in ["attempts/shard-00000-of-00002.parquet", "scenes/shard-00001-of-00002.parquet"] {
        fs::remove_file(dir.path().join(name)).unwrap();
    }
    let found = verify(dir.path(), |_| ()).unwrap();
    assert_eq!(found.problems.len(), 2, "{:?}", found.problems);
    assert!(found.problems[0].starts_with("shard 0: the file is missing"), "{:?}", found.problems);
    assert!(found.problems[1].starts_with("shard 1: the file is missing"), "{:?}", found.problems);
}

/// Such as a missing right: running again does not help, and nothing says that the bytes are damaged.
#[test]
fn what_cannot_be_opened_is_neither_damaged_nor_a_matter_of_time() {
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), &sample::info(3));
    let marker = dir.path().join("meta/shards/00001.json");
    fs::remove_file(&marker).unwrap();
    std::os::unix::fs::symlink("00001.json", &marker).unwrap();
    assert_eq!(verified(dir.path()), ExitCode::Config);
    fs::remove_file(dir.path().join("scenes/shard-00000-of-00002.parquet")).unwrap();
    assert_eq!(verified(dir.path()), ExitCode::Data);
}

#[test]
fn an_edited_info_and_an_unknown_version_are_told_for_what_they_are() {
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), &sample::info(3));
    let path = dir.path().join(layout::INFO);
    let whole = fs::read_to_string(&path).unwrap();
    fs::write(&path, whole.replace("\"seed\": 3", "\"seed\": 4")).unwrap();
    let message = Dataset::open(dir.path()).unwrap_err().to_string();
    assert!(message.contains("the SHA-256 of meta/info.json"), "{message}");
    let error = Draft::open(dir.path()).unwrap().finalize().unwrap_err();
    assert_eq!(error.exit_code(), ExitCode::Data);
    assert!(error.to_string().starts_with("meta/shards/00000.json belongs to dataset "), "{error}");
    fs::write(&path, whole.replace("\"format_version\": 1", "\"format_version\": 9")).unwrap();
    let error = Dataset::open(dir.path()).unwrap_err();
    assert_eq!(error.exit_code(), ExitCode::Data);
    assert!(error.to_string().contains("got 9; read it with a newer graspmill"), "{error}");
    assert_eq!(verified(dir.path()), ExitCode::Data);
}
