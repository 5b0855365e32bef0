//! The grammar of footers and page headers: exactly what parquet-rs writes for our tables. Other fields are refused; if
//! a new version of parquet-rs writes one, the round-trip tests fail.

use crate::format::thrift::Shape::{self, Binary, Bool, I8, I16, I32, I64, List, OneOf, Struct};

/// Maximum number of schema elements; `scenes` has 24.
pub(crate) const SCHEMA_MAX: usize = 64;
/// Maximum numbers of row groups, of entries of other lists, and of levels of a histogram.
const GROUPS_MAX: usize = 1 << 20;
const ENTRIES_MAX: usize = 64;

/// `FileMetaData` of parquet.thrift.
pub(crate) const FOOTER: Shape = Struct(&[
    (1, I32),
    (2, List(SCHEMA_MAX, &SCHEMA_ELEMENT)),
    (3, I64),
    (4, List(GROUPS_MAX, &ROW_GROUP)),
    (5, List(ENTRIES_MAX, &Struct(&[(1, Binary), (2, Binary)]))),
    (6, Binary),
    (7, List(ENTRIES_MAX, &OneOf(&[(1, NOTHING), (2, NOTHING)]))),
]);

const NOTHING: Shape = Struct(&[]);

const SCHEMA_ELEMENT: Shape = Struct(&[
    (1, I32),
    (2, I32),
    (3, I32),
    (4, Binary),
    (5, I32),
    (6, I32),
    (7, I32),
    (8, I32),
    (9, I32),
    (10, OneOf(&[(1, NOTHING), (3, NOTHING), (10, Struct(&[(1, I8), (2, Bool)]))])),
]);

const ROW_GROUP: Shape =
    Struct(&[(1, List(ENTRIES_MAX, &COLUMN_CHUNK)), (2, I64), (3, I64), (5, I64), (6, I64), (7, I16)]);

const COLUMN_CHUNK: Shape = Struct(&[(2, I64), (3, COLUMN), (4, I64), (5, I32), (6, I64), (7, I32)]);

const COLUMN: Shape = Struct(&[
    (1, I32),
    (2, List(ENTRIES_MAX, &I32)),
    (3, List(ENTRIES_MAX, &Binary)),
    (4, I32),
    (5, I64),
    (6, I64),
    (7, I64),
    (9, I64),
    (11, I64),
    (12, STATISTICS),
    (13, List(ENTRIES_MAX, &Struct(&[(1, I32), (2, I32), (3, I32)]))),
    (16, Struct(&[(1, I64), (2, List(ENTRIES_MAX, &I64)), (3, List(ENTRIES_MAX, &I64))])),
]);

const STATISTICS: Shape =
    Struct(&[(1, Binary), (2, Binary), (3, I64), (4, I64), (5, Binary), (6, Binary), (7, Bool), (8, Bool), (9, I64)]);

/// `PageHeader` of parquet.thrift, for pages of version 1.
pub(crate) const PAGE_HEADER: Shape = Struct(&[
    (1, I32),
    (2, I32),
    (3, I32),
    (4, I32),
    (5, Struct(&[(1, I32), (2, I32), (3, I32), (4, I32), (5, STATISTICS)])),
    (7, Struct(&[(1, I32), (2, I32), (3, Bool)])),
]);
