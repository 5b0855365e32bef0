//! Compares a TOML document's keys with a reference document and reports *all* faults at once.

use toml::{Table, Value};

/// What in `table` is not as in `reference`: unknown keys, missing keys, values of another type; each with its path.
/// Whole numbers pass for real ones, and arrays are compared by their first element.
#[must_use]
pub fn keys_unlike(table: &Table, reference: &Table) -> Vec<String> {
    let mut problems = Vec::new();
    compare(table, reference, "", &mut problems);
    problems
}

fn compare(table: &Table, reference: &Table, prefix: &str, problems: &mut Vec<String>) {
    for (key, value) in table {
        let path = format!("{prefix}{key}");
        match (reference.get(key), value) {
            (None, _) => problems.push(format!("{path} is no key of this file")),
            (Some(Value::Table(inner)), Value::Table(given)) => compare(given, inner, &format!("{path}."), problems),
            (Some(expected), given) if !alike(given, expected) => {
                problems.push(format!("{path} must be {}, got {given}", describe(expected)));
            }
            _ => {}
        }
    }
    for (key, expected) in reference {
        if !table.contains_key(key) {
            problems.push(format!("{prefix}{key} is missing, {}", describe(expected)));
        }
    }
}

fn alike(given: &Value, expected: &Value) -> bool {
    match (given, expected) {
        (Value::Integer(_), Value::Float(_)) => true,
        (Value::Array(given), Value::Array(expected)) => {
            given.iter().all(|value| expected.first().is_none_or(|first| alike(value, first)))
        }
        _ => given.same_type(expected),
    }
}

fn describe(value: &Value) -> String {
    match value {
        Value::String(_) => "a text".to_owned(),
        Value::Integer(_) => "a whole number".to_owned(),
        Value::Float(_) => "a number".to_owned(),
        Value::Boolean(_) => "true or false".to_owned(),
        Value::Datetime(_) => "a date".to_owned(),
        Value::Array(values) => match values.first() {
            Some(first) => format!("a list, each {}", describe(first)),
            None => "a list".to_owned(),
        },
        Value::Table(_) => "a table".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_that_is_wrong_is_told_at_once() {
        let reference = "a = 1\nb = 2.0\nlist = [0.1]\n[t]\nc = \"x\"\nd = true".parse().unwrap();
        let given = "a = 1.5\nb = 2\nlist = [1, \"x\"]\nz = 1\n[t]\nc = \"y\"\ne = 1".parse().unwrap();
        let mut problems = keys_unlike(&given, &reference);
        problems.sort();
        assert_eq!(
            problems,
            [
                "a must be a whole number, got 1.5",
                "list must be a list, each a number, got [1, \"x\"]",
                "t.d is missing, true or false",
                "t.e is no key of this file",
                "z is no key of this file",
            ]
        );
    }

    #[test]
    fn the_reference_is_like_itself() {
        let reference: Table = "a = 1\n[t]\nc = \"x\"".parse().unwrap();
        assert!(keys_unlike(&reference, &reference).is_empty());
    }
}
