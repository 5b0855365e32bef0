//! The description of the running planner: `GET /v1/model`.

use serde::Serialize;
use serde_json::{Value, json};

use crate::Planner;
use crate::config::Config;

/// The program's version, SHA-256 of the network's weights file, the default order of grasps, the gripper's name,
/// the workspace, and the settings, with the keys of `configs/plan/*.toml`.
pub(super) fn answer(planner: &Planner) -> Value {
    let Planner { model_id, config, grid, .. } = planner;
    let (size_m, table_z_m) = (written(&grid.size_m), written(&grid.table_z_m));
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "model": model_id,
        "policy": config.ranking.policy.name(),
        "gripper": config.gripper.name,
        "grid": { "size_m": size_m, "resolution": grid.resolution, "table_z_m": table_z_m },
        "config": settings(config),
    })
}

/// The keys of a settings file.
fn settings(config: &Config) -> Value {
    let mut settings = written(config);
    settings["gripper"] = Value::from(config.gripper.name.as_str());
    settings
}

/// Numbers go through text, which has them as people wrote them: 0.45, not 0.44999998807907104.
pub(super) fn written(value: &impl Serialize) -> Value {
    serde_json::from_str(&serde_json::to_string(value).unwrap_or_default()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BuiltIn;

    #[test]
    fn settings_are_shown_as_they_stand_in_the_file() {
        let mut file: toml::Table = BuiltIn::Judge.text().parse().unwrap();
        file["ranking"].as_table_mut().unwrap().insert("without_object".to_owned(), "last".into()); // its one word
        assert_eq!(settings(&BuiltIn::Judge.config().unwrap()), serde_json::to_value(file).unwrap());
    }
}
