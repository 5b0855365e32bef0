//! Files that were damaged and sealed again, as by an attacker or a broken tool: all checksums match, so only the
//! decoder can find the damage. It must not panic, hang or exhaust the memory.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use arrow::{DictionaryArray, Int32Array, RecordBatch, StringArray};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::properties::{EnabledStatistics, WriterProperties, WriterVersion};
use schema::{Purpose, Stream};

use super::fuzzing;
use crate::format::{layout, seal};
use crate::synthetic;
use crate::{Dataset, Draft, Finalized, Manifest, Table, verify};

fn write(dir: &Path) -> Manifest {
    let mut info = synthetic::info(5, 1, 40, 8);
    info.grid.resolution = 4;
    let draft = Draft::begin(dir, &info).unwrap();
    let mut writer = draft.shard(0).unwrap();
    for scene in info.scenes_of(0) {
        writer.push(&synthetic::scene_rows(scene, info.seed, &info)).unwrap();
    }
    writer.commit().unwrap();
    let Finalized::Complete(manifest) = draft.finalize().unwrap() else { panic!("complete") };
    manifest
}

/// Replaces a table's file and updates all checksums.
fn plant(dir: &Path, manifest: &Manifest, table: Table, bytes: &[u8]) {
    let mut manifest = manifest.clone();
    let shard = &mut manifest.shards[0];
    let file = match table {
        Table::Attempts => &mut shard.attempts,
        Table::Scenes => &mut shard.scenes,
        Table::Objects => &mut shard.objects,
    };
    file.bytes = bytes.len() as u64;
    file.sha256 = seal::sha256_hex(bytes);
    fs::write(dir.join(&file.path), bytes).unwrap();
    fs::write(dir.join(layout::marker(0)), seal::seal(shard)).unwrap();
    fs::write(dir.join(layout::MANIFEST), seal::seal(&manifest)).unwrap();
}

#[test]
fn damage_under_a_right_checksum_is_survived() {
    let dir = tempfile::tempdir().unwrap();
    let manifest = write(dir.path());
    let mut draw = Stream::new(0, 0, Purpose::Shuffle, 0);
    let mut found = 0;
    for table in Table::ALL {
        let path = dir.path().join(&manifest.shards[0].file(table).path);
        let whole = fs::read(&path).unwrap();
        for _ in 0..250 {
            let mut bytes = whole.clone();
            // Half of the damage goes to the footer, which contains the sizes and offsets.
            let from = if draw.unit() < 0.5 { bytes.len() - bytes.len() / 4 } else { 0 };
            for _ in 0..=draw.index(3) {
                let at = from + draw.index(bytes.len() - from);
                bytes[at] = draw.bits() as u8;
            }
            plant(dir.path(), &manifest, table, &bytes);
            found += usize::from(!verify(dir.path(), |_| ()).unwrap().is_ok());
        }
        plant(dir.path(), &manifest, table, &whole);
        assert!(verify(dir.path(), |_| ()).unwrap().is_ok());
    }
    assert!(found > 500, "only {found} of 750 damaged files were noticed");
}

/// An integer in Thrift's compact protocol, before its zigzag encoding.
fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

/// A group of a schema with some children.
fn group(children: u64) -> Vec<u8> {
    [&[0x35, 0, 0x18, 1, b'a', 0x15], &varint(2 * children)[..], &[0]].concat()
}

/// Small footers with which parquet-rs 60 alone ends the process or runs for minutes: it exhausts the stack, reserves
/// 16 GB, counts to 10^11, or reserves 0.8 GB for empty row groups.
#[test]
fn a_footer_that_asks_for_much_is_refused_before_it_is_decoded() {
    let head = [0x15, 2, 0x19, 0xfc];
    let nested = [&head[..], &varint(60_000), &group(1).repeat(60_000)].concat();
    let broad = [&head[..], &[1], &group(i32::MAX as u64)].concat();
    let truths = [&[0x09, 0x28, 0xf1][..], &varint(i32::MAX as u64)].concat();
    let counting = [&[0x15, 2][..], &truths.repeat(50)].concat();
    let rows = [&[0x16, 0, 0x19, 0xfc][..], &varint(8_000_000), &[0; 8_000_000]].concat();
    let empty = [&[0x15, 2, 0x19, 0x1c][..], &group(0), &rows].concat();
    for (footer, reason) in [
        (nested, "a list is too long in field 2"),
        (broad, "too many columns"),
        (counting, "a field is unknown or in the wrong place in field 1"),
        (empty, "a list is too long in field 4"),
    ] {
        let footer = [&footer[..], &[0]].concat();
        let file = [b"\0PAR1", &footer[..], &(footer.len() as u32).to_le_bytes(), b"PAR1"].concat();
        assert_eq!(fuzzing::shard_reader(&file), Err(format!("the footer is damaged: {reason}")));
    }
}

/// A file of a few kB with a dictionary of one name of 16 MiB, which compresses well. Rows, values and chunks are in
/// order. parquet-rs alone takes four times the name's size, and the name may have 2 GB.
#[test]
fn a_page_that_grows_beyond_its_values_is_refused_before_it_is_decompressed() {
    const NAME_BYTES: usize = 16 << 20;
    let dir = tempfile::tempdir().unwrap();
    let manifest = write(dir.path());
    let path = dir.path().join(&manifest.shards[0].attempts.path);
    let file = fs::File::open(&path).unwrap();
    let batch = ParquetRecordBatchReaderBuilder::try_new(file).unwrap().build().unwrap().next().unwrap().unwrap();
    let mut columns = batch.columns().to_vec();
    let names = Arc::new(StringArray::from(vec!["a".repeat(NAME_BYTES)]));
    let keys = Int32Array::from(vec![0; batch.num_rows()]);
    columns[batch.schema().index_of("shape").unwrap()] = Arc::new(DictionaryArray::try_new(keys, names).unwrap());
    let properties = WriterProperties::builder()
        .set_writer_version(WriterVersion::PARQUET_1_0)
        .set_dictionary_page_size_limit(2 * NAME_BYTES)
        .set_statistics_enabled(EnabledStatistics::None)
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1).unwrap()))
        .build();
    let mut writer = ArrowWriter::try_new(Vec::new(), batch.schema(), Some(properties)).unwrap();
    writer.write(&RecordBatch::try_new(batch.schema(), columns).unwrap()).unwrap();
    let bytes = writer.into_inner().unwrap();
    assert!(bytes.len() < 20_000, "{}", bytes.len());
    plant(dir.path(), &manifest, Table::Attempts, &bytes);
    let error = Dataset::open(dir.path()).unwrap().rows(0, false).map(drop).unwrap_err().to_string();
    let refusal = format!("column \"shape\": a page of 1 values cannot have {} bytes", NAME_BYTES + 4);
    assert!(error.contains(&refusal), "{error}");
}
