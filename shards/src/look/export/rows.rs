//! Rows as JSON: the columns of the table by name, in order.

use std::fmt::Write as _;

use arrow::array::{Array, AsArray, RecordBatch};
use arrow::datatypes::{Float32Type, Int32Type, Int64Type, UInt8Type};

use crate::{Column, Form, Kind, Table};

/// Every row of a table as a JSON object without its voxels. The columns of `batch` are those of `table`.
pub(super) fn json(table: Table, form: Form, batch: &RecordBatch) -> Vec<String> {
    (0..batch.num_rows()).map(|row| object(table.columns(form), batch, row)).collect()
}

/// An array of JSON values, one per line.
pub(super) fn array(values: &[String]) -> String {
    if values.is_empty() { "[]\n".to_owned() } else { format!("[\n{}\n]\n", values.join(",\n")) }
}

fn object(columns: &[Column], batch: &RecordBatch, row: usize) -> String {
    let columns = columns.iter().zip(batch.columns()).filter(|(column, _)| column.kind != Kind::Voxels);
    let cells: Vec<String> =
        columns.map(|(column, cells)| format!("\"{}\": {}", column.name, cell(column.kind, cells, row))).collect();
    format!("{{{}}}", cells.join(", "))
}

fn cell(kind: Kind, cells: &dyn Array, row: usize) -> String {
    if cells.is_null(row) {
        return "null".to_owned();
    }
    match kind {
        Kind::I64 => cells.as_primitive::<Int64Type>().value(row).to_string(),
        Kind::I32 => cells.as_primitive::<Int32Type>().value(row).to_string(),
        Kind::U8 => cells.as_primitive::<UInt8Type>().value(row).to_string(),
        Kind::F32 => real(cells.as_primitive::<Float32Type>().value(row)),
        Kind::Name => {
            let names = cells.as_dictionary::<Int32Type>();
            let name = names.key(row).map_or("", |key| names.values().as_string::<i32>().value(key));
            format!("\"{name}\"") // our own names: letters and underscores
        }
        Kind::Views => views(&cells.as_list::<i32>().value(row)),
        Kind::Voxels => "null".to_owned(), // excluded above
    }
}

fn views(views: &dyn Array) -> String {
    let fields = views.as_struct();
    let view = |row: usize| {
        let mut text = String::new();
        for (name, cells) in fields.column_names().into_iter().zip(fields.columns()) {
            let comma = if text.is_empty() { "" } else { ", " };
            // Writing to a String cannot fail.
            let _ = write!(text, "{comma}\"{name}\": {}", real(cells.as_primitive::<Float32Type>().value(row)));
        }
        format!("{{{text}}}")
    };
    format!("[{}]", (0..fields.len()).map(view).collect::<Vec<_>>().join(", "))
}

/// The shortest text that parses to the same value; `null` for NaN, which JSON does not have.
fn real(value: f32) -> String {
    if value.is_finite() { value.to_string() } else { "null".to_owned() }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;
    use crate::format::encode;
    use crate::synthetic;

    #[test]
    fn a_row_has_every_column_and_its_values() {
        let info = synthetic::info(5, 1, 40, 40);
        let rows = synthetic::scene_rows(0, info.seed, &info);
        let text = array(&json(Table::Attempts, info.form(), &encode::attempts(&rows.attempts, &[]).unwrap()));
        let found: Vec<Value> = serde_json::from_str(&text).unwrap();
        assert_eq!(found.len(), rows.attempts.len());
        for (found, row) in found.iter().zip(&rows.attempts) {
            let keys = Table::Attempts.columns(info.form()).iter().map(|column| column.name);
            assert!(keys.clone().all(|key| found.get(key).is_some()), "{found}");
            assert_eq!(found.as_object().unwrap().len(), keys.count());
            assert_eq!(found["rule"], row.rule.name());
            assert_eq!(found["label"], row.label());
            assert_eq!(found["width_m"].as_f64().map(|w| w as f32), row.width_m);
            assert_eq!(found["x_m"].as_f64().unwrap() as f32, row.workspace_from_grasp.translation.x);
        }
        assert!(found.iter().any(|row| row["hit"].is_null()) && found.iter().any(|row| row["hit"].is_string()));

        let scenes =
            json(Table::Scenes, info.form(), &encode::scenes(std::slice::from_ref(&rows.scene), &info).unwrap());
        let scene: Value = serde_json::from_str(&scenes[0]).unwrap();
        assert!(scene.get("tsdf").is_none());
        assert_eq!(scene["views"].as_array().unwrap().len(), rows.scene.views.len());
        assert_eq!(scene["views"][0]["radius_m"].as_f64().unwrap() as f32, rows.scene.views[0].radius_m);
    }

    #[test]
    fn an_array_of_nothing_is_json_too() {
        assert_eq!(serde_json::from_str::<Value>(&array(&[])).unwrap(), serde_json::json!([]));
    }
}
