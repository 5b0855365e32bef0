//! The description of the running planner: `GET /v1/model`.

use schema::Grid;
use serde::Serialize;
use serde_json::Value;

use crate::Planner;
use crate::config::Config;
use crate::plan::GridAnswer;

/// The planner behind the service.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct ModelAnswer {
    /// The program's version.
    version: &'static str,
    /// SHA-256 of the network's weights file.
    model: String,
    /// The default order of grasps: `paper`, `vgn-random` or `vgn-best`.
    policy: &'static str,
    /// The gripper's name.
    gripper: String,
    /// The workspace.
    #[serde(with = "GridAnswer")]
    grid: Grid,
    /// The settings, with the keys of `configs/plan/*.toml`.
    config: Value,
}

impl ModelAnswer {
    pub(super) fn new(planner: &Planner) -> Self {
        let config = &planner.config;
        Self {
            version: env!("CARGO_PKG_VERSION"),
            model: planner.model_id.clone(),
            policy: config.ranking.policy.name(),
            gripper: config.gripper.name.clone(),
            grid: planner.grid,
            config: settings(config),
        }
    }
}

/// The keys of a settings file. Numbers go through text, which has them as people wrote them: 0.45, not
/// 0.44999998807907104.
fn settings(config: &Config) -> Value {
    let text = serde_json::to_string(config).unwrap_or_default();
    let mut settings: Value = serde_json::from_str(&text).unwrap_or_default();
    settings["gripper"] = Value::from(config.gripper.name.as_str());
    settings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BuiltIn;

    #[test]
    fn settings_are_shown_as_they_stand_in_the_file() {
        let file: toml::Table = BuiltIn::Judge.text().parse().unwrap();
        assert_eq!(settings(&BuiltIn::Judge.config().unwrap()), serde_json::to_value(file).unwrap());
    }
}
