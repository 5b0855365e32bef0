//! An experiment's file: which scenes, seen how, planned with what, and when a round ends. All problems are told at once.
//!
//! Any key can be set from outside the file, and any of the planner's (`plan.ranking.policy`), so that an ablation is a command.

use std::path::{Path, PathBuf};

use generator::Overrides;
use perception::{DepthNoise, DexNoise, StereoNoise, camera_at};
use planner::Planner;
use schema::{Camera, Grid, View, keys_unlike};
use serde::Deserialize;
use sha2::{Digest as _, Sha256};

use crate::catalogue::{Catalogue, CatalogueError, Thing};
use crate::packed::PackedLaw;

/// The reference for what keys there are: one of the files that come along.
pub const REFERENCE: &str = include_str!("../../configs/experiment/pile.toml");

/// A checked experiment.
#[derive(Debug, Clone)]
pub struct Config {
    /// The protocol's name; every number carries it.
    pub protocol: String,
    /// Seeds of the scenes; each has all rounds.
    pub seeds: Vec<u64>,
    /// Rounds of a seed.
    pub rounds: u64,
    /// How scenes are made, hands close and cameras see: a generator's config.
    pub scene: generator::Config,
    /// Which objects, and how they come to lie.
    pub objects: Objects,
    /// Whether placements that the hand cannot span are drawn anew.
    pub viable_only: bool,
    /// Where the cameras stand.
    pub views: Views,
    /// What is wrong with their depths.
    pub noise: DepthNoise,
    /// When a round ends.
    pub stop: StopLaw,
    /// The planner's settings.
    pub plan: planner::Config,
    /// The network's file; `None` for the one that comes with the program.
    pub model: Option<PathBuf>,
    /// The experiment and the planner's settings, as resolved, for people.
    pub text: String,
    /// Digest of all that decides a round but its seed and the network: those texts, the files that they name, and the objects.
    pub digest: String,
}

/// Which objects lie on the table.
#[derive(Debug, Clone, PartialEq)]
pub enum Objects {
    /// So many, dropped one by one, as in training.
    Pile {
        /// How many.
        count: usize,
    },
    /// So many upright ones side by side.
    Packed(PackedLaw),
    /// Objects of a catalogue, dropped one by one: round after round the next of these names.
    Things(Vec<(String, Vec<Thing>)>),
}

impl Objects {
    /// What the scene of a round is called.
    #[must_use]
    pub fn group(&self, scene_id: u64) -> String {
        match self {
            Self::Pile { .. } => "pile".to_owned(),
            Self::Packed(_) => "packed".to_owned(),
            Self::Things(groups) => groups[scene_id as usize % groups.len()].0.clone(),
        }
    }

    /// How many objects must be there once a scene is at rest: of named ones all.
    #[must_use]
    pub fn count_min(&self, scene_id: u64) -> usize {
        match self {
            Self::Pile { .. } | Self::Packed(_) => 1,
            Self::Things(groups) => groups[scene_id as usize % groups.len()].1.len(),
        }
    }
}

/// Cameras evenly about the workspace, all looking at one point above the middle of its floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Views {
    /// How many.
    pub count: usize,
    /// How far away, in workspaces.
    pub radius_sizes: f32,
    /// Angle from the vertical.
    pub polar_rad: f32,
    /// Azimuth of the first.
    pub azimuth_rad: f32,
    /// Height of the point, in metres.
    pub target_z_m: f32,
}

/// When a round ends before the table is empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StopLaw {
    /// So many failures in a row (VGN: 2).
    pub failures_max: u32,
    /// So many attempts in all.
    pub attempts_max: u32,
}

/// Why an experiment's file is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("failed to read the configuration: {source}: {}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Keys that are unknown, missing or out of range, all of them.
    #[error("{} problem{} in the configuration {}:\n  {}", .problems.len(), if .problems.len() == 1 { "" } else { "s" }, .path.display(), .problems.join("\n  "))]
    Invalid {
        /// The file.
        path: PathBuf,
        /// One message a problem, beginning with the key's path.
        problems: Vec<String>,
    },
    /// The generator's config.
    #[error(transparent)]
    Scene(#[from] generator::ConfigError),
    /// The planner's.
    #[error(transparent)]
    Plan(#[from] planner::ConfigError),
    /// The objects.
    #[error(transparent)]
    Objects(#[from] CatalogueError),
}

#[derive(Deserialize)]
struct Raw {
    protocol: String,
    seeds: Vec<u64>,
    rounds: u64,
    scene: String,
    plan: String,
    model: String,
    objects: RawObjects,
    views: RawViews,
    noise: RawNoise,
    stop: RawStop,
}

#[derive(Deserialize)]
struct RawObjects {
    kind: String,
    count: u64,
    catalogue: String,
    names: Vec<String>,
    viable_only: bool,
}

#[derive(Deserialize)]
struct RawViews {
    count: u64,
    radius_sizes: f32,
    polar_rad: f32,
    azimuth_rad: f32,
    target_z_m: f32,
}

#[derive(Deserialize)]
struct RawNoise {
    kind: String,
    std_m: f32,
}

#[derive(Deserialize)]
struct RawStop {
    failures_max: u64,
    attempts_max: u64,
}

impl Config {
    /// Reads a file; paths in it are taken from its folder. `set` are keys and values (TOML) in place of the file's.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn read(path: &Path, set: &[(String, String)]) -> Result<Self, ConfigError> {
        Self::parse(&text_of(path)?, path, set)
    }

    /// Checks the text of a file.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn parse(text: &str, path: &Path, set: &[(String, String)]) -> Result<Self, ConfigError> {
        let invalid = |problems| ConfigError::Invalid { path: path.to_owned(), problems };
        let syntax = |e: toml::de::Error| invalid(vec![e.to_string().trim().to_owned()]);
        let mut table: toml::Table = text.parse().map_err(syntax)?;
        let (of_plan, own): (Vec<_>, Vec<_>) = set.iter().partition(|(key, _)| key.starts_with("plan."));
        own.into_iter().try_for_each(|(key, value)| put(&mut table, key, value)).map_err(|e| invalid(vec![e]))?;
        let unlike = keys_unlike(&table, &REFERENCE.parse().map_err(syntax)?);
        if !unlike.is_empty() {
            return Err(invalid(unlike));
        }
        let (resolved, raw_table) = (table.to_string(), table.clone());
        let raw: Raw = table.try_into().map_err(syntax)?;
        let mut problems = problems(&raw);
        let folder = path.parent().unwrap_or(Path::new(""));
        let file = |name: &str, built_in: &str| (name != built_in).then(|| folder.join(name));
        let scene = generator::Config::load(file(&raw.scene, "paper").as_deref(), Overrides::default())?;
        let plan_path = file(&raw.plan, "paper");
        let plan_text = plan_path.as_deref().map_or(Ok(planner::config::PAPER.to_owned()), text_of)?;
        let mut plan_table: toml::Table = plan_text.parse().map_err(syntax)?;
        let mut of_plan = of_plan.into_iter().map(|(key, value)| (key.trim_start_matches("plan."), value));
        of_plan.try_for_each(|(key, value)| put(&mut plan_table, key, value)).map_err(|e| invalid(vec![e]))?;
        let plan_text = plan_table.to_string();
        let plan =
            planner::Config::parse(&plan_text, plan_path.as_deref().unwrap_or(Path::new("configs/plan/paper.toml")))?;
        let objects = objects(&raw.objects, file(&raw.objects.catalogue, "everyday").as_deref(), &mut problems)?;
        problems.extend(mismatches(&scene, &plan));
        if !problems.is_empty() {
            return Err(invalid(problems));
        }
        let mut protocol_only = raw_table;
        protocol_only.retain(|key, _| !["seeds", "rounds"].contains(&key));
        let all = format!("{protocol_only:?} {scene:?} {plan:?} {objects:?}");
        Ok(Self {
            objects,
            digest: Sha256::digest(all).iter().map(|byte| format!("{byte:02x}")).collect(),
            viable_only: raw.objects.viable_only,
            views: Views {
                count: raw.views.count as usize,
                radius_sizes: raw.views.radius_sizes,
                polar_rad: raw.views.polar_rad,
                azimuth_rad: raw.views.azimuth_rad,
                target_z_m: raw.views.target_z_m,
            },
            noise: match raw.noise.kind.as_str() {
                "gaussian" => DepthNoise::Gaussian { std_m: raw.noise.std_m },
                "dex" => DepthNoise::Dex(DexNoise::GIGA),
                "d435" => DepthNoise::Stereo(StereoNoise { focal_px: scene.intrinsics.fx_px, ..StereoNoise::D435 }),
                _ => DepthNoise::None,
            },
            stop: StopLaw { failures_max: raw.stop.failures_max as u32, attempts_max: raw.stop.attempts_max as u32 },
            model: file(&raw.model, "built-in"),
            text: format!("{resolved}\n# Planner\n{plan_text}"),
            protocol: raw.protocol,
            seeds: raw.seeds,
            rounds: raw.rounds,
            scene,
            plan,
        })
    }

    /// Rounds of all seeds: at most 10⁹.
    #[must_use]
    pub fn round_count(&self) -> u64 {
        self.rounds * self.seeds.len() as u64
    }

    /// The planner of the experiment.
    ///
    /// # Errors
    /// [`planner::PlannerError`] if its network cannot be read.
    pub fn planner(&self) -> Result<Planner, planner::PlannerError> {
        match &self.model {
            Some(model) => Planner::new(model, self.plan.clone()),
            None => Planner::built_in(self.plan.clone()),
        }
    }

    /// The cameras.
    #[must_use]
    pub fn cameras(&self) -> Vec<Camera> {
        let Views { count, radius_sizes, polar_rad, azimuth_rad, target_z_m } = self.views;
        let turn = |number: usize| core::f32::consts::TAU * number as f32 / count as f32;
        let radius_m = radius_sizes * self.scene.grid.size_m;
        let camera = |number: usize| {
            let view = View { radius_m, polar_rad, azimuth_rad: azimuth_rad + turn(number) };
            let mut camera = camera_at(&view, &self.scene.grid, self.scene.intrinsics);
            camera.workspace_from_camera.translation.z += target_z_m;
            camera
        };
        (0..count).map(camera).collect()
    }
}

/// What planner and scenes must have in common.
fn mismatches(scene: &generator::Config, plan: &planner::Config) -> Vec<String> {
    let (grid, expected) = (scene.grid, Grid::PAPER);
    let mut problems = Vec::new();
    if (grid.resolution, grid.size_m) != (expected.resolution, expected.size_m) {
        let (n, side_m) = (expected.resolution, expected.size_m);
        problems.push(format!("the scenes' grid must be the planner's, {n}\u{b3} voxels in {side_m} m: scene"));
    }
    if scene.gripper != plan.gripper {
        let (planned, executed) = (&plan.gripper.name, &scene.gripper.name);
        problems
            .push(format!("the planner's hand, {planned}, must be the one that executes, {executed}: plan.gripper"));
    }
    problems
}

fn text_of(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })
}

/// Puts a value, as TOML or as plain text, in the place of a key such as `views.count`.
fn put(table: &mut toml::Table, key: &str, value: &str) -> Result<(), String> {
    let parsed = format!("value = {value}").parse::<toml::Table>().ok().and_then(|mut one| one.remove("value"));
    let value = parsed.unwrap_or_else(|| toml::Value::String(value.to_owned()));
    let mut parts: Vec<&str> = key.split('.').collect();
    let last = parts.pop().unwrap_or_default();
    let mut place = table;
    for part in parts {
        place =
            place.get_mut(part).and_then(toml::Value::as_table_mut).ok_or_else(|| format!("there is no key {key}"))?;
    }
    let slot = place.get_mut(last).ok_or_else(|| format!("there is no key {key}"))?;
    *slot = match (&*slot, value) {
        (toml::Value::Float(_), toml::Value::Integer(whole)) => toml::Value::Float(whole as f64),
        (_, value) => value,
    };
    Ok(())
}

/// What lies on the tables.
fn objects(raw: &RawObjects, catalogue: Option<&Path>, problems: &mut Vec<String>) -> Result<Objects, ConfigError> {
    let count = raw.count as usize;
    if raw.names.is_empty() != (raw.kind != "things") {
        problems.push("objects.names must be there for objects.kind \"things\", and not for the others".to_owned());
    }
    Ok(match raw.kind.as_str() {
        "packed" => Objects::Packed(PackedLaw { count, ..PackedLaw::default() }),
        "things" => {
            let catalogue = Catalogue::read(catalogue)?;
            let mut groups = Vec::new();
            for name in &raw.names {
                match catalogue.named(name) {
                    Some(things) => groups.push((name.clone(), things.into_iter().cloned().collect())),
                    None => problems
                        .push(format!("objects.names must be among {}, got {name}", catalogue.names().join(", "))),
                }
            }
            Objects::Things(groups)
        }
        _ => Objects::Pile { count },
    })
}

fn problems(raw: &Raw) -> Vec<String> {
    let wholes = [
        ("rounds", raw.rounds, 1, 1_000_000),
        ("number of seeds", raw.seeds.len() as u64, 1, 1_000),
        ("objects.count", raw.objects.count, 1, 20),
        ("views.count", raw.views.count, 1, 32),
        ("stop.failures_max", raw.stop.failures_max, 1, 1_000),
        ("stop.attempts_max", raw.stop.attempts_max, 1, 10_000),
    ];
    let reals = [
        ("views.radius_sizes", raw.views.radius_sizes, 1.0, 100.0),
        ("views.polar_rad", raw.views.polar_rad, 0.0, core::f32::consts::FRAC_PI_2),
        ("views.azimuth_rad", raw.views.azimuth_rad, -10.0, 10.0),
        ("views.target_z_m", raw.views.target_z_m, 0.0, 1.0),
        ("noise.std_m", raw.noise.std_m, 0.0, 1.0),
    ];
    let words: [(&str, &str, &[&str]); 2] = [
        ("objects.kind", &raw.objects.kind, &["pile", "packed", "things"]),
        ("noise.kind", &raw.noise.kind, &["none", "gaussian", "d435", "dex"]),
    ];
    let mut once = raw.seeds.clone();
    once.sort_unstable();
    once.dedup();
    let repeated = (once.len() < raw.seeds.len()).then(|| "seeds must be different ones".to_owned());
    let whole = wholes.iter().filter(|(_, value, low, high)| !(low..=high).contains(&value));
    let real = reals.iter().filter(|(_, value, low, high)| !(low..=high).contains(&value));
    let word = words.iter().filter(|(_, value, all)| !all.contains(value));
    whole
        .map(|(key, value, low, high)| format!("{key} must be between {low} and {high}, got {value}"))
        .chain(real.map(|(key, value, low, high)| format!("{key} must be between {low} and {high}, got {value}")))
        .chain(word.map(|(key, value, all)| format!("{key} must be one of {}, got {value}", all.join(", "))))
        .chain(repeated)
        .collect()
}
