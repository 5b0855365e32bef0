//! Settings as a list, to show and to compare them.

use toml::{Table, Value};

/// The keys and values of a TOML text; those of inner tables as `table.key`. A text that is no TOML has none.
#[must_use]
pub fn flat(text: &str) -> Vec<(String, String)> {
    let table: Table = text.parse().unwrap_or_default();
    flattened(&table, "", Value::as_table).into_iter().map(|(key, value)| (key, value.to_string())).collect()
}

/// The keys and values of a table in any format; `inner` is the table that a value is, if it is one.
pub fn flattened<'a, V: 'a, T>(table: T, prefix: &str, inner: fn(&'a V) -> Option<T>) -> Vec<(String, &'a V)>
where
    T: IntoIterator<Item = (&'a String, &'a V)>,
{
    let rows = table.into_iter().flat_map(|(key, value)| match inner(value) {
        Some(table) => flattened(table, &format!("{prefix}{key}."), inner),
        None => vec![(format!("{prefix}{key}"), value)],
    });
    rows.collect()
}
