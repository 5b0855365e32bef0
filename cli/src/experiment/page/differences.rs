//! The settings of experiments, and in which of them several differ.

use std::collections::{BTreeMap, BTreeSet};

use report::document::{Block, Cell, Table};

use super::Played;

/// What stands between an experiment's settings and its planner's.
const PLANNER: &str = "\n# Planner\n";

/// The settings of a report as keys and values; the planner's are `plan.key`. A text that is no TOML has none.
pub(super) fn keys(config: &str) -> BTreeMap<String, String> {
    let (experiment, plan) = config.split_once(PLANNER).unwrap_or((config, ""));
    [settings::flat(experiment, ""), settings::flat(plan, "plan.")].into_iter().flatten().collect()
}

/// A row for each setting in which experiments differ, and the weights and versions among them.
pub(super) fn blocks(all: &[Played], names: &[String]) -> Vec<Block> {
    let settings = |one: &Played| {
        let mut keys = keys(&one.report.about.config);
        keys.remove("protocol"); // the name
        keys.insert("network".to_owned(), one.report.about.model_id.clone());
        keys.extend(one.report.about.versions.iter().map(|(name, version)| (name.clone(), version.clone())));
        keys
    };
    let settings: Vec<BTreeMap<String, String>> = all.iter().map(settings).collect();
    let every: BTreeSet<&String> = settings.iter().flat_map(BTreeMap::keys).collect();
    let differs = |key: &&&String| settings.iter().any(|one| one.get(**key) != settings[0].get(**key));
    let mut rows = Vec::new();
    for key in every.iter().filter(differs) {
        for (at, (one, name)) in settings.iter().zip(names).enumerate() {
            let value = one.get(*key).map_or_else(|| "–".to_owned(), Clone::clone);
            let key = if at == 0 { (*key).clone() } else { String::new() };
            rows.push(vec![Cell::Code(key), name.as_str().into(), Cell::Code(value)]);
        }
    }
    if rows.is_empty() {
        return vec![Block::Text("Their settings are the same.".to_owned())];
    }
    vec![
        Block::Text("Settings that differ:".to_owned()),
        Block::Table(Table::new(["setting", "experiment", "value"], rows)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_of_the_planner_are_told_from_those_of_the_experiment() {
        let keys =
            keys("seeds = [1]\n\n[views]\ncount = 6\n\n# Planner\nseed = 2\n\n[ranking]\npolicy = \"vgn-best\"\n");
        let found: Vec<(&str, &str)> = keys.iter().map(|(key, value)| (key.as_str(), value.as_str())).collect();
        let expected =
            [("plan.ranking.policy", "\"vgn-best\""), ("plan.seed", "2"), ("seeds", "[1]"), ("views.count", "6")];
        assert_eq!(found, expected);
    }
}
