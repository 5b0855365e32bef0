//! Checks a table's file before parquet-rs decodes it: the footer, the column chunks and the page headers must be in
//! place, and their sizes must be consistent with the number of rows. Checksums do not help here, because an attacker
//! who changes a file also changes its checksums.
//!
//! Checks of rows, values and chunks alone are not enough. Without the walk over the footer (`thrift.rs`) and the page
//! headers, and with all other checks in place, files in `hostile.rs` and `fuzz/seeds` have these effects on parquet-rs
//! 60:
//!
//! | file | stopped by | without it |
//! |---|---|---|
//! | footer of 480 kB, 60,000 nested groups | footer walk | stack overflow, the process aborts |
//! | footer of 20 bytes, 2^31 children | footer walk | allocation of 17 GB, the process aborts |
//! | footer of 400 bytes, lists of 2^31 booleans | footer walk | minutes at full load |
//! | 17 kB, a dictionary page of one name of 256 MiB | page walk | 1.04 GB of memory, and the name may have 2 GB |
//! | `late-finding-2`, an empty dictionary | page walk | a division by zero, which becomes an error |
//!
//! The walk also finds the positions of pages, so that one scene is read without its row group. The file's own index of
//! pages is not read, because it can be wrong.

use std::fs::File;
use std::sync::Arc;

use parquet::arrow::ArrowSchemaConverter;
use parquet::basic::{Compression, Type};
use parquet::file::metadata::page_index::PageIndexBuilder;
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaData, ParquetMetaDataReader};
use parquet::file::page_index::offset_index::{OffsetIndexMetaData, PageLocation};
use parquet::file::reader::{ChunkReader, Length};

use crate::Table;
use crate::format::check::{VIEWS_MAX, must};
use crate::format::column::{Form, Kind};
use crate::format::footer::{FOOTER, PAGE_HEADER};
use crate::format::thrift;

type Checked<T = ()> = Result<T, String>;

const MAGIC: &[u8; 4] = b"PAR1";
/// Bytes of the footer's length and the magic number.
const TAIL: u64 = 8;
/// Maximum size of a footer: enough for the row groups of about a million scenes.
const FOOTER_MAX: u64 = 16 << 20;
/// Maximum size of a page header.
const HEADER_MAX: u64 = 1024;
/// Maximum average size of a page's values, and additional bytes for levels and run lengths.
const VALUE_MAX: i64 = 9;
const NAME_MAX: i64 = 64;
const PAGE_SLACK: i64 = 1024;

// Numbers from parquet.thrift. Dictionary indices have one of two, before and after version 2 of the format.
const DATA_PAGE: i64 = 0;
const DICTIONARY_PAGE: i64 = 2;
const PLAIN: i64 = 0;
const PLAIN_DICTIONARY: i64 = 2;
const RLE: i64 = 3;
const RLE_DICTIONARY: i64 = 8;
const BYTE_STREAM_SPLIT: i64 = 9;
const ENCODINGS: [i64; 4] = [PLAIN, PLAIN_DICTIONARY, RLE_DICTIONARY, BYTE_STREAM_SPLIT];
const NAME_ENCODINGS: [i64; 2] = [PLAIN_DICTIONARY, RLE_DICTIONARY];
const DICTIONARY_ENCODINGS: [i64; 2] = [PLAIN, PLAIN_DICTIONARY];

/// The expected properties of a table's file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Expected {
    /// The table.
    pub(crate) table: Table,
    /// What its columns depend on.
    pub(crate) form: Form,
    /// Total number of rows.
    pub(crate) rows: u64,
}

/// A file with a checked footer.
pub(crate) struct Frame<'a> {
    file: &'a File,
    expected: Expected,
    /// The end of the column chunks.
    end: u64,
    metadata: ParquetMetaData,
}

impl<'a> Frame<'a> {
    /// Reads the footer.
    pub(crate) fn read(file: &'a File, expected: Expected) -> Checked<Self> {
        let length = file.len();
        let tail_at = length.checked_sub(TAIL).ok_or("the file is too short")?;
        let tail = bytes(file, tail_at, TAIL)?;
        let (size, magic) = tail.split_at(4);
        must(magic == MAGIC, || "the file does not end as a Parquet file".to_owned())?;
        let size: u64 = size.iter().rev().fold(0, |size, byte| size << 8 | u64::from(*byte));
        let end = tail_at.checked_sub(size).filter(|_| size <= FOOTER_MAX);
        let end = end.ok_or_else(|| format!("the footer cannot have {size} bytes"))?;
        let footer = bytes(file, end, size)?;
        let mut children = 0;
        let measured = thrift::measure(&footer, &FOOTER, &mut |path, value| {
            if path == [2, 5] {
                children = children.max(value);
            }
        });
        let measured = measured.map_err(|e| format!("the footer is damaged: {e}"))?;
        must(measured == footer.len(), || "the footer is damaged: it ends too early".to_owned())?;
        must(children <= crate::format::footer::SCHEMA_MAX as i64, || {
            "the footer is damaged: too many columns".to_owned()
        })?;
        let metadata = ParquetMetaDataReader::decode_metadata(&footer).map_err(|e| e.to_string())?;
        let frame = Self { file, expected, end, metadata };
        frame.check_schema()?;
        frame.check_rows()?;
        Ok(frame)
    }

    /// Checks the pages of some columns. Returns the metadata for the decoder, with the positions of pages if rows
    /// are to be skipped.
    pub(crate) fn check_pages(self, columns: &[usize], is_skipping: bool) -> Checked<ParquetMetaData> {
        let groups = 0..self.metadata.num_row_groups();
        let schema = self.metadata.file_metadata().schema_descr();
        let leaves = (0..schema.num_columns()).filter(|leaf| columns.contains(&schema.get_column_root_idx(*leaf)));
        let mut places = PageIndexBuilder::default();
        if is_skipping {
            places.allocate_offset_indexes(groups.len(), schema.num_columns());
        }
        for (group, leaf) in groups.flat_map(|group| leaves.clone().map(move |leaf| (group, leaf))) {
            if let Some(page_locations) = self.pages(group, leaf)? {
                let index = OffsetIndexMetaData { page_locations, unencoded_byte_array_data_bytes: None };
                places.put_offset_index(index, group, leaf); // if there is a place for it
            }
        }
        Ok(self.metadata.into_builder().set_page_index(Some(Arc::new(places.build()))).build())
    }

    /// Names, order and types must be those of the table.
    fn check_schema(&self) -> Checked {
        let Expected { table, form, .. } = self.expected;
        let expected = ArrowSchemaConverter::new().convert(&table.arrow_schema(form)).map_err(|e| e.to_string())?;
        let found = self.metadata.file_metadata().schema_descr();
        must(expected.root_schema().get_fields() == found.root_schema().get_fields(), || {
            format!("columns must have the names, types and order of those of {}", table.name())
        })
    }

    /// Row groups must have the expected number of rows, and their column chunks as many values. Chunks must not
    /// overlap: if they shared pages, few pages could give many rows.
    fn check_rows(&self) -> Checked {
        let expected = self.expected.rows;
        let groups = self.metadata.row_groups();
        let (mut sum, mut at) = (0, MAGIC.len() as u64);
        for (number, group) in groups.iter().enumerate() {
            let rows = u64::try_from(group.num_rows()).ok().filter(|rows| (1..=expected).contains(rows));
            let rows = rows.ok_or_else(|| format!("row group {number} cannot have {} rows", group.num_rows()))?;
            sum += rows; // at most 2^20 groups of `expected`, which is at most 2^44
            for (leaf, chunk) in group.columns().iter().enumerate() {
                let in_chunk = |message| format!("row group {number}, column {}: {message}", chunk.column_path());
                at = self.check_chunk(chunk, self.kind(leaf), rows, at).map_err(in_chunk)?;
            }
        }
        let said = self.metadata.file_metadata().num_rows();
        must(sum == expected && u64::try_from(said) == Ok(expected), || {
            format!("the file must have {expected} rows, its row groups have {sum}, its footer says {said}")
        })
    }

    /// The end of the chunk, which must not begin before `from`.
    fn check_chunk(&self, chunk: &ColumnChunkMetaData, kind: Kind, rows: u64, from: u64) -> Checked<u64> {
        let (low, high) = match kind {
            Kind::Views => (rows, rows.saturating_mul(VIEWS_MAX as u64)),
            Kind::Voxels => [rows.saturating_mul((self.expected.form.resolution as u64).pow(3)); 2].into(),
            Kind::I64 | Kind::I32 | Kind::U8 | Kind::F32 | Kind::Name => (rows, rows),
        };
        let values = chunk.num_values();
        must(u64::try_from(values).is_ok_and(|values| (low..=high).contains(&values)), || {
            format!("values must be between {low} and {high}, got {values}")
        })?;
        let is_known = matches!(chunk.compression(), Compression::ZSTD(_) | Compression::UNCOMPRESSED);
        must(is_known, || format!("compression must be zstd or none, got {}", chunk.compression()))?;
        let (Ok(start), Ok(length)) = (u64::try_from(start(chunk)), u64::try_from(chunk.compressed_size())) else {
            return Err("its place cannot be negative".to_owned());
        };
        let end = start.saturating_add(length);
        must(from <= start && end <= self.end, || {
            format!("it must lie between bytes {from} and {}, got {start} to {end}", self.end)
        })?;
        Ok(end)
    }

    fn kind(&self, leaf: usize) -> Kind {
        let Expected { table, form, .. } = self.expected;
        table.columns(form)[self.metadata.file_metadata().schema_descr().get_column_root_idx(leaf)].kind
    }

    /// Checks the pages of a column chunk; returns their positions by rows, if these are known without decoding.
    fn pages(&self, group: usize, leaf: usize) -> Checked<Option<Vec<PageLocation>>> {
        let chunk = self.metadata.row_group(group).column(leaf);
        let in_chunk = |message| format!("row group {group}, column {}: {message}", chunk.column_path());
        let pages = self.walk(chunk).map_err(in_chunk)?;
        let values_of_row = match self.kind(leaf) {
            Kind::Views => return Ok(None),
            Kind::Voxels => (self.expected.form.resolution as i64).pow(3),
            Kind::I64 | Kind::I32 | Kind::U8 | Kind::F32 | Kind::Name => 1,
        };
        let location = |page: &Page| PageLocation {
            offset: page.offset,
            compressed_page_size: page.size,
            first_row_index: page.first_value / values_of_row,
        };
        let starts_rows = pages.iter().all(|page| page.first_value % values_of_row == 0);
        Ok(starts_rows.then(|| pages.iter().map(location).collect()))
    }

    fn walk(&self, chunk: &ColumnChunkMetaData) -> Checked<Vec<Page>> {
        // Neither is negative, and together they are below `end`: `check_chunk`.
        let (mut at, length) = (start(chunk) as u64, chunk.compressed_size() as u64);
        let end = at + length;
        let mut dictionary = chunk.dictionary_page_offset().map(|_| false);
        let (mut pages, mut values) = (Vec::new(), 0);
        while at < end {
            let header = Header::read(&bytes(self.file, at, HEADER_MAX.min(end - at))?)?;
            let size = header.check(chunk, end - at)?;
            let left = chunk.num_values() - values;
            must((0..=left).contains(&header.values), || format!("a page cannot have {} values", header.values))?;
            if header.is_dictionary {
                must(dictionary == Some(false), || "a dictionary is in the wrong place".to_owned())?;
                dictionary = Some(true);
            } else {
                let uses_dictionary = NAME_ENCODINGS.contains(&header.encoding);
                must(dictionary.unwrap_or(!uses_dictionary), || "the dictionary is missing".to_owned())?;
                must(header.values > 0, || "a page is empty".to_owned())?;
                pages.push(Page { offset: at as i64, size, first_value: values });
                values += header.values;
            }
            at += size as u64;
        }
        must(values == chunk.num_values(), || format!("pages must have {} values, got {values}", chunk.num_values()))?;
        Ok(pages)
    }
}

/// The start of a column chunk.
fn start(chunk: &ColumnChunkMetaData) -> i64 {
    chunk.dictionary_page_offset().unwrap_or(chunk.data_page_offset())
}

fn bytes(file: &File, at: u64, length: u64) -> Checked<impl std::ops::Deref<Target = [u8]>> {
    file.get_bytes(at, length as usize).map_err(|e| e.to_string()) // at most FOOTER_MAX
}

/// A page of values.
struct Page {
    offset: i64,
    /// Its position, with its header.
    size: i32,
    first_value: i64,
}

/// The content of a page header.
#[derive(Debug, Default)]
struct Header {
    /// Bytes of the header itself.
    length: usize,
    is_dictionary: bool,
    /// Size of the values, and their size on the disk.
    plain: i64,
    stored: i64,
    values: i64,
    encoding: i64,
    /// Whether levels are encoded as runs.
    is_run_length: bool,
}

impl Header {
    fn read(bytes: &[u8]) -> Checked<Self> {
        let mut header = Self { is_run_length: true, ..Self::default() };
        let (mut kind, mut fields) = (-1, 0);
        let measured = thrift::measure(bytes, &PAGE_HEADER, &mut |path, value| match path {
            [1] => kind = value,
            [2] => header.plain = value,
            [3] => header.stored = value,
            [5 | 7, 1] => (header.values, fields) = (value, fields + i64::from(path[0])),
            [5 | 7, 2] => header.encoding = value,
            [5, 3 | 4] => header.is_run_length &= value == RLE,
            _ => {}
        });
        header.length = measured.map_err(|e| format!("the header of a page is damaged: {e}"))?;
        header.is_dictionary = kind == DICTIONARY_PAGE;
        // Exactly one of the fields for values and for a dictionary.
        let is_whole = (kind, fields) == (DATA_PAGE, 5) || (kind, fields) == (DICTIONARY_PAGE, 7);
        must(is_whole, || format!("a page cannot be of kind {kind}"))?;
        Ok(header)
    }

    /// The size of header and page, if it fits the rest of the column chunk.
    fn check(&self, chunk: &ColumnChunkMetaData, left: u64) -> Checked<i32> {
        // Names always have a dictionary; without one the decoder may read beyond their page when skipping values.
        let is_names = chunk.column_type() == Type::BYTE_ARRAY;
        let encodings = match (self.is_dictionary, is_names) {
            (true, _) => &DICTIONARY_ENCODINGS[..],
            (false, true) => &NAME_ENCODINGS,
            (false, false) => &ENCODINGS,
        };
        must(encodings.contains(&self.encoding) && self.is_run_length, || {
            format!("a page's encoding cannot be {}", self.encoding)
        })?;
        // A dictionary has neither levels nor runs; an empty one has no bytes at all, or the decoder divides by 0.
        let value_max = if is_names { NAME_MAX } else { VALUE_MAX };
        let slack = if self.is_dictionary { 0 } else { PAGE_SLACK };
        let most = value_max.saturating_mul(self.values).saturating_add(slack);
        // Plain values that are never null have a known size.
        let column = chunk.column_descr();
        let is_exact = !is_names
            && (column.max_def_level(), column.max_rep_level()) == (0, 0)
            && (self.is_dictionary || !NAME_ENCODINGS.contains(&self.encoding));
        let width = if chunk.column_type() == Type::INT64 { 8 } else { 4 };
        let sizes = if is_exact { [width * self.values.clamp(0, most); 2] } else { [0, most] };
        must((sizes[0]..=sizes[1]).contains(&self.plain), || {
            format!("a page of {} values cannot have {} bytes", self.values, self.plain)
        })?;
        let is_bare = chunk.compression() == Compression::UNCOMPRESSED;
        let size = i64::try_from(self.length).ok().and_then(|length| length.checked_add(self.stored));
        let size =
            size.filter(|size| self.stored >= 0 && (*size as u64) <= left && (!is_bare || self.stored == self.plain));
        let size = size.and_then(|size| i32::try_from(size).ok());
        size.ok_or_else(|| format!("a page cannot have {} bytes on the disk", self.stored))
    }
}
