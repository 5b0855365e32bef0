//! Settings as a list, to show and to compare them.

use toml::{Table, Value};

/// The keys and values of a TOML text; those of inner tables as `table.key`. A text that is no TOML has none.
#[must_use]
pub fn flat(text: &str) -> Vec<(String, String)> {
    let table: Table = text.parse().unwrap_or_default();
    flattened(&table, "")
}

fn flattened(table: &Table, prefix: &str) -> Vec<(String, String)> {
    let rows = table.iter().flat_map(|(key, value)| match value {
        Value::Table(inner) => flattened(inner, &format!("{prefix}{key}.")),
        value => vec![(format!("{prefix}{key}"), value.to_string())],
    });
    rows.collect()
}
