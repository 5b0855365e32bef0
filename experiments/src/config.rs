//! An experiment's file: which scenes, seen how, planned with what, and when a round ends. All problems are told at once.

use std::path::{Path, PathBuf};

use generator::Overrides;
use perception::{DepthNoise, DexNoise};
use planner::Planner;
use schema::{View, keys_unlike};
use serde::Deserialize;

use crate::packed::PackedLaw;

/// The reference for what keys there are.
const REFERENCE: &str = include_str!("../../configs/experiment/pile.toml");

/// A checked experiment.
#[derive(Debug, Clone)]
pub struct Config {
    /// The protocol's name; every number carries it.
    pub protocol: String,
    /// Seed of every scene.
    pub seed: u64,
    /// Rounds.
    pub rounds: u64,
    /// How scenes are made, hands close and cameras see: a generator's config.
    pub scene: generator::Config,
    /// Which objects, and how they come to lie.
    pub objects: Objects,
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
    /// The file as it was read.
    pub text: String,
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
}

/// Cameras evenly about the workspace, all looking at the middle of its floor.
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
}

#[derive(Deserialize)]
struct Raw {
    protocol: String,
    seed: u64,
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
}

#[derive(Deserialize)]
struct RawViews {
    count: u64,
    radius_sizes: f32,
    polar_rad: f32,
    azimuth_rad: f32,
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
    /// Reads a file; paths in it are taken from its folder.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// Checks the text of a file.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let invalid = |problems| ConfigError::Invalid { path: path.to_owned(), problems };
        let syntax = |e: toml::de::Error| invalid(vec![e.message().to_owned()]);
        let table: toml::Table = text.parse().map_err(syntax)?;
        let unlike = keys_unlike(&table, &REFERENCE.parse().map_err(syntax)?);
        if !unlike.is_empty() {
            return Err(invalid(unlike));
        }
        let raw: Raw = table.try_into().map_err(syntax)?;
        let problems = problems(&raw);
        if !problems.is_empty() {
            return Err(invalid(problems));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let file = |name: &str, built_in: &str| (name != built_in).then(|| folder.join(name));
        let scene = generator::Config::load(file(&raw.scene, "paper").as_deref(), Overrides::default())?;
        let plan = match file(&raw.plan, "paper") {
            Some(path) => planner::Config::read(&path)?,
            None => planner::Config::built_in()?,
        };
        Ok(Self {
            objects: match raw.objects.kind.as_str() {
                "packed" => Objects::Packed(PackedLaw { count: raw.objects.count as usize, ..PackedLaw::default() }),
                _ => Objects::Pile { count: raw.objects.count as usize },
            },
            views: Views {
                count: raw.views.count as usize,
                radius_sizes: raw.views.radius_sizes,
                polar_rad: raw.views.polar_rad,
                azimuth_rad: raw.views.azimuth_rad,
            },
            noise: match raw.noise.kind.as_str() {
                "gaussian" => DepthNoise::Gaussian { std_m: raw.noise.std_m },
                "dex" => DepthNoise::Dex(DexNoise::GIGA),
                _ => DepthNoise::None,
            },
            stop: StopLaw { failures_max: raw.stop.failures_max as u32, attempts_max: raw.stop.attempts_max as u32 },
            model: file(&raw.model, "built-in"),
            protocol: raw.protocol,
            seed: raw.seed,
            rounds: raw.rounds,
            scene,
            plan,
            text: text.to_owned(),
        })
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

    /// Where the cameras stand.
    #[must_use]
    pub fn views(&self) -> Vec<View> {
        let Views { count, radius_sizes, polar_rad, azimuth_rad } = self.views;
        let turn = |number: usize| core::f32::consts::TAU * number as f32 / count as f32;
        (0..count)
            .map(|number| View {
                radius_m: radius_sizes * self.scene.grid.size_m,
                polar_rad,
                azimuth_rad: azimuth_rad + turn(number),
            })
            .collect()
    }
}

fn problems(raw: &Raw) -> Vec<String> {
    let wholes = [
        ("rounds", raw.rounds, 1, 1_000_000),
        ("objects.count", raw.objects.count, 1, 20),
        ("views.count", raw.views.count, 1, 32),
        ("stop.failures_max", raw.stop.failures_max, 1, 1_000),
        ("stop.attempts_max", raw.stop.attempts_max, 1, 10_000),
    ];
    let reals = [
        ("views.radius_sizes", raw.views.radius_sizes, 1.0, 100.0),
        ("views.polar_rad", raw.views.polar_rad, 0.0, core::f32::consts::FRAC_PI_2),
        ("views.azimuth_rad", raw.views.azimuth_rad, -10.0, 10.0),
        ("noise.std_m", raw.noise.std_m, 0.0, 1.0),
    ];
    let words: [(&str, &str, &[&str]); 2] = [
        ("objects.kind", &raw.objects.kind, &["pile", "packed"]),
        ("noise.kind", &raw.noise.kind, &["none", "gaussian", "dex"]),
    ];
    let whole = wholes.iter().filter(|(_, value, low, high)| !(low..=high).contains(&value));
    let real = reals.iter().filter(|(_, value, low, high)| !(low..=high).contains(&value));
    let word = words.iter().filter(|(_, value, all)| !all.contains(value));
    whole
        .map(|(key, value, low, high)| format!("{key} must be between {low} and {high}, got {value}"))
        .chain(real.map(|(key, value, low, high)| format!("{key} must be between {low} and {high}, got {value}")))
        .chain(word.map(|(key, value, all)| format!("{key} must be one of {}, got {value}", all.join(", "))))
        .collect()
}
