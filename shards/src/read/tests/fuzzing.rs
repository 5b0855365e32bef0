//! The functions of the fuzz targets in `fuzz/`, and a test that replays their seeds and past findings. For any bytes
//! these functions must return: without a panic, without hanging, and without more memory than the rows need.

use std::fs::File;
use std::io::{Seek, Write};
use std::sync::OnceLock;

use arrow::RecordBatch;
use schema::{AttemptRecord, SceneRecord};

use crate::format::check;
use crate::format::frame::Expected;
use crate::format::summary::ShardSummary;
use crate::format::{decode, seal};
use crate::read::table_reader::{Batches, PANICKED, Part};
use crate::synthetic;
use crate::{DatasetInfo, Manifest, Table};

/// Panics of parquet-rs 60 on values in pages, which become errors; any other is a finding.
const KNOWN_PANICS: [&str; 2] = [
    // An unterminated varint of a run's length: the first with overflow checks, the second without.
    "attempt to shift left with overflow",
    "Num of bytes exceed MAX_VLQ_BYTE_LEN (10)",
];

/// A byte that selects a dataset and a table, then a file of that table. Its checksum is assumed to match, as for an
/// attacker or a broken tool that writes both. The result says whether all rows were read and are valid.
///
/// # Errors
/// What is wrong with the file.
///
/// # Panics
/// If the decoder panicked in an unknown way.
pub fn shard_reader(data: &[u8]) -> Result<(), String> {
    let read = read_table(data);
    let panic = read.as_ref().err().and_then(|message| message.strip_prefix(PANICKED));
    assert!(panic.is_none_or(|panic| KNOWN_PANICS.contains(&panic)), "{panic:?}");
    read
}

fn read_table(data: &[u8]) -> Result<(), String> {
    let (selector, bytes) = data.split_first().ok_or("no selector")?;
    let number = usize::from(*selector) / 3 % INFOS;
    let info = info(number);
    let table = Table::ALL[usize::from(*selector) % 3];
    let expected = Expected { table, form: info.form(), rows: row_count(table, number, &info) };
    let file = file(bytes);
    let whole = Part { batch_rows: 8192, ..Part::default() };
    let one = Part { rows: Some(&[1]), batch_rows: 1, ..Part::default() };
    match table {
        Table::Attempts => {
            let checked = |row: &AttemptRecord| check::attempt(row, info.gripper_of(row.scene_id));
            let of_scene = Part { rows: Some(&[3, 4, 5]), ..whole };
            let read = [whole, of_scene]
                .map(|part| rows(&file, expected, part, |batch| decode::attempts(batch, &info), checked));
            read.into_iter().collect()
        }
        Table::Objects => rows(&file, expected, whole, |batch| decode::objects(batch, &info.models), check::object),
        Table::Scenes => {
            let eight = Part { batch_rows: 8, ..whole };
            let heads = Part { without: Some("tsdf"), ..eight };
            let read = [eight, heads, one].map(|part| {
                rows(
                    &file,
                    expected,
                    part,
                    |batch| decode::scenes(batch, &info),
                    |scene: &SceneRecord| {
                        check::scene_head(scene, &info)?;
                        if part.without.is_some() { Ok(()) } else { check::tsdf(&scene.tsdf, &info) }
                    },
                )
            });
            read.into_iter().collect()
        }
    }
}

/// Reads a table like [`crate::Dataset`], below its checksums.
fn rows<R>(
    file: &File,
    expected: Expected,
    part: Part<'_>,
    decode: impl Fn(&RecordBatch) -> Result<Vec<R>, String>,
    check: impl Fn(&R) -> Result<(), String>,
) -> Result<(), String> {
    let file = file.try_clone().map_err(|e| e.to_string())?;
    for batch in Batches::open(file, expected, part)? {
        let rows = decode(&batch?)?;
        rows.iter().try_for_each(&check)?;
    }
    Ok(())
}

/// The texts of `meta/`: the info, a marker and the manifest, separated by NUL. Missing seals and ids are assumed to be
/// valid, so that the checks after them are reached.
///
/// # Errors
/// What is wrong with the texts.
///
/// # Panics
/// If a parsed value differs from its serialisation.
pub fn metadata(data: &[u8]) -> Result<(), String> {
    let mut parts = data.split(|byte| *byte == 0).map(String::from_utf8_lossy);
    let mut next = || parts.next().unwrap_or_default();
    let given = DatasetInfo::from_json(next().as_bytes());
    let info = given.clone().unwrap_or_else(|_| info(0));
    let id = info.dataset_id();
    let back = DatasetInfo::from_json(info.to_json());
    assert_eq!(back.map(without_config), Ok(without_config(info.clone())), "an info comes back as it was");
    for shard in [0, info.shard_count / 2, info.shard_count - 1] {
        let scenes = info.scenes_of(shard);
        assert_eq!((info.shard_of(scenes.start), info.shard_of(scenes.end - 1)), (Some(shard), Some(shard)));
        assert!(info.attempts_of_scene(scenes.start) > 0);
    }
    let marker = unseal::<ShardSummary>(&next()).map(|mut marker| {
        marker.dataset_id.clone_from(&id);
        marker.problems(&info, &id)
    });
    let manifest = unseal::<Manifest>(&next()).map(|mut manifest| {
        manifest.dataset_id.clone_from(&id);
        manifest.shards.iter_mut().for_each(|shard| shard.dataset_id.clone_from(&id));
        manifest.problems(&info, &id)
    });
    let problems = [given.map(|_| Vec::new()), marker, manifest].map(|read| read.unwrap_or_else(|e| vec![e])).concat();
    if problems.is_empty() { Ok(()) } else { Err(problems.join("; ")) }
}

/// The generator's config is kept as text, because numbers may change in their last digit when parsed.
fn without_config(info: DatasetInfo) -> DatasetInfo {
    DatasetInfo { config: serde_json::Value::Null, ..info }
}

fn unseal<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, String> {
    let sealed = seal::unseal(text.as_bytes().to_vec());
    sealed.or_else(|_| serde_json::from_str(text).map_err(|e| e.to_string()))
}

const INFOS: usize = 2;

/// The datasets of the seeds: one row group, and two.
fn info(number: usize) -> DatasetInfo {
    let mut info = if number == 0 { synthetic::info(5, 1, 8, 3) } else { synthetic::info(5, 1, 260, 1) };
    info.grid.resolution = 4;
    info
}

/// The summary of a shard for a manifest.
fn row_count(table: Table, number: usize, info: &DatasetInfo) -> u64 {
    static OBJECTS: [OnceLock<u64>; INFOS] = [const { OnceLock::new() }; INFOS];
    let objects = |scene| synthetic::scene_rows(scene, info.seed, info).objects.len() as u64;
    match table {
        Table::Attempts => info.attempt_count,
        Table::Scenes => info.scene_count,
        Table::Objects => *OBJECTS[number].get_or_init(|| (0..info.scene_count).map(objects).sum()),
    }
}

fn file(bytes: &[u8]) -> File {
    let mut file = tempfile::tempfile().expect("a scratch file");
    file.write_all(bytes).and_then(|()| file.rewind()).expect("room for the file");
    file
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::{Path, PathBuf};

    use arrow::RecordBatchReader;
    use parquet::arrow::ArrowWriter;
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
    use parquet::file::properties::{WriterProperties, WriterVersion};

    use super::*;
    use crate::format::layout;
    use crate::{Draft, Finalized};

    fn seeds(target: &str) -> Vec<(PathBuf, Vec<u8>)> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds").join(target);
        let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let mut seeds: Vec<_> = paths.map(|path| (path.clone(), fs::read(path).unwrap())).collect();
        seeds.sort();
        assert!(!seeds.is_empty());
        seeds
    }

    /// Seeds named `whole-…` are files of the writer.
    fn replay(target: &str, read: fn(&[u8]) -> Result<(), String>) {
        for (path, bytes) in seeds(target) {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let result = read(&bytes);
            assert_eq!(result.is_ok(), name.starts_with("whole-"), "{name}: {result:?}");
        }
    }

    #[test]
    fn seeds_and_past_findings_of_the_shard_reader_are_survived() {
        replay("shard_reader", shard_reader);
    }

    #[test]
    fn seeds_and_past_findings_of_the_metadata_are_survived() {
        replay("metadata", metadata);
    }

    /// Writes the seeds again: `cargo test --workspace write_the_seeds -- --ignored`.
    #[test]
    #[ignore = "writes fuzz/seeds"]
    fn write_the_seeds() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds");
        for number in 0..INFOS {
            let info = info(number);
            let dir = tempfile::tempdir().unwrap();
            let draft = Draft::begin(dir.path(), &info).unwrap();
            let mut writer = draft.shard(0).unwrap();
            for scene in info.scenes_of(0) {
                writer.push(&synthetic::scene_rows(scene, info.seed, &info)).unwrap();
            }
            writer.commit().unwrap();
            let Finalized::Complete(manifest) = draft.finalize().unwrap() else { panic!("complete") };
            for (place, table) in Table::ALL.into_iter().enumerate() {
                let path = dir.path().join(&manifest.shards[0].file(table).path);
                let selector = [(3 * number + place) as u8];
                let write = |kind: &str, bytes: &[u8]| {
                    let name = format!("shard_reader/whole-{}-{number}{kind}", table.name());
                    fs::write(folder.join(name), [&selector[..], bytes].concat()).unwrap();
                };
                write("", &fs::read(&path).unwrap());
                if number == 0 {
                    write("-bare", &bare(&path));
                }
            }
            let texts = [layout::INFO, &layout::marker(0), layout::MANIFEST];
            let texts = texts.map(|name| fs::read(dir.path().join(name)).unwrap());
            fs::write(folder.join(format!("metadata/whole-{number}")), texts.join(&0)).unwrap();
        }
    }

    /// The same rows in many uncompressed pages, so that a fuzzer reaches values and levels.
    fn bare(path: &Path) -> Vec<u8> {
        let file = File::open(path).unwrap();
        let mut reader = ParquetRecordBatchReaderBuilder::try_new(file).unwrap().build().unwrap();
        let properties = WriterProperties::builder()
            .set_writer_version(WriterVersion::PARQUET_1_0)
            .set_data_page_row_count_limit(2)
            .set_write_batch_size(1)
            .build();
        let mut writer = ArrowWriter::try_new(Vec::new(), reader.schema(), Some(properties)).unwrap();
        reader.try_for_each(|batch| writer.write(&batch.unwrap())).unwrap();
        writer.into_inner().unwrap()
    }
}
