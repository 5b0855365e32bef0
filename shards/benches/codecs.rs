//! Measures codecs and encodings on the tables of a dataset: bytes a scene, and the time to write and to read one.
//! `cargo bench -p shards --bench codecs -- DIR` reads shard 0 and writes it to a temporary file in every way.
#![expect(clippy::print_stdout, reason = "it prints a table")]

use std::fs::File;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result};
use arrow::RecordBatch;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::{ColumnPath, SchemaDescriptor};
use shards::{Table, layout};

#[derive(Clone, Copy, PartialEq)]
enum Floats {
    Plain,
    Dictionary,
    ByteStreamSplit,
}

fn main() -> Result<()> {
    let Some(dir) = std::env::args().skip(1).find(|arg| arg != "--bench").map(PathBuf::from) else {
        println!("not measured: codecs takes DIR");
        return Ok(());
    };
    let dataset = shards::Dataset::open(&dir)?;
    let scenes = dataset.info().scenes_of(0).count() as f64;
    println!("{:<10}{:<8}{:<14}{:>12}{:>12}{:>12}", "table", "codec", "floats", "B/scene", "write ms", "read ms");
    for table in Table::ALL {
        let path = dir.join(layout::table_file(table, 0, dataset.shard_count()));
        let batches = read(File::open(path)?)?;
        for level in [0, 1, 3, 6, 9] {
            for (floats, name) in
                [(Floats::Plain, "plain"), (Floats::Dictionary, "dictionary"), (Floats::ByteStreamSplit, "split")]
            {
                let start = Instant::now();
                let file = write(&batches, level, floats)?;
                let write_ms = start.elapsed().as_secs_f64() * 1e3 / scenes;
                let length = file.metadata()?.len() as f64 / scenes;
                let start = Instant::now();
                read(file)?;
                let read_ms = start.elapsed().as_secs_f64() * 1e3 / scenes;
                let codec = if level == 0 { "none".to_owned() } else { format!("zstd {level}") };
                println!("{:<10}{codec:<8}{name:<14}{length:>12.0}{write_ms:>12.3}{read_ms:>12.3}", table.name());
            }
        }
    }
    Ok(())
}

fn read(file: File) -> Result<Vec<RecordBatch>> {
    Ok(ParquetRecordBatchReaderBuilder::try_new(file)?.with_batch_size(8).build()?.collect::<Result<_, _>>()?)
}

fn write(batches: &[RecordBatch], level: i32, floats: Floats) -> Result<File> {
    let schema = batches.first().context("no rows")?.schema();
    let leaves: SchemaDescriptor = parquet::arrow::ArrowSchemaConverter::new().convert(&schema)?;
    let mut builder = WriterProperties::builder().set_max_row_group_row_count(None);
    if level > 0 {
        builder = builder.set_compression(Compression::ZSTD(ZstdLevel::try_new(level)?));
    }
    for leaf in leaves.columns() {
        if leaf.physical_type() == parquet::basic::Type::FLOAT {
            let path = ColumnPath::new(leaf.path().parts().to_vec());
            builder = builder
                .set_column_statistics_enabled(path.clone(), EnabledStatistics::None)
                .set_column_dictionary_enabled(path.clone(), floats == Floats::Dictionary);
            if floats == Floats::ByteStreamSplit {
                builder = builder.set_column_encoding(path, Encoding::BYTE_STREAM_SPLIT);
            }
        }
    }
    let mut writer = ArrowWriter::try_new(tempfile::tempfile()?, schema, Some(builder.build()))?;
    for batch in batches {
        writer.write(batch)?;
    }
    Ok(writer.into_inner()?)
}
