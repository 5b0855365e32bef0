//! An experiment's file: which scenes, seen how, planned with what, and when a round ends. All problems are told at
//! once.
//!
//! Any key can be set from outside the file, and any of the planner's (`plan.ranking.policy`), so that an ablation is a
//! command.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use generator::{ContainerParams, Overrides, PackedParams, container_faults};
use perception::{DepthNoise, NoiseKind, camera_at};
use planner::{BuiltIn, Planner};
use program::Failure;
use schema::{Camera, Grid, View};
use settings::{Document, Reader, settings, words};
use shards::DatasetInfo;
use toml::Table;

use crate::catalogue::{Catalogue, CatalogueObject};
use crate::files::sha256;

/// The experiment that explains the keys: one of the files that come along.
pub const REFERENCE: &str = include_str!("../../configs/experiment/pile.toml");

/// What stands in an experiment's text before the planner's settings.
const PLANNER: &str = "\n# Planner\n";

/// A checked experiment.
#[derive(Debug, Clone)]
pub struct Config {
    /// What its file holds.
    pub keys: Keys,
    /// How scenes are made, grippers close and cameras see: a generator's config.
    pub scene: generator::Config,
    /// Which objects, and how they come to lie.
    pub objects: Objects,
    /// What is wrong with the cameras' depths.
    pub noise: DepthNoise,
    /// The planner's settings.
    pub plan: planner::Config,
    /// The network's file; `None` for the one that comes with the program.
    pub model: Option<PathBuf>,
    /// The experiment and the planner's settings, as resolved, for people.
    pub text: String,
    /// Who plans, for people.
    pub planned_by: String,
    /// Digest of all that decides a round but its seed and the network: those texts, what the files that they name
    /// hold, and the objects. It does not depend on where the files lie.
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
    Packed {
        /// How many.
        count: usize,
        /// How large: `packed` of the scene's config, if it has that.
        params: PackedParams,
    },
    /// Objects of a catalogue, dropped one by one: round after round the next of these names.
    Things(Vec<(String, Vec<CatalogueObject>)>),
}

impl Objects {
    /// What the scene of a round is called.
    #[must_use]
    pub fn group(&self, scene_id: u64) -> String {
        match self {
            Self::Pile { .. } => "pile".to_owned(),
            Self::Packed { .. } => "packed".to_owned(),
            Self::Things(groups) => groups[scene_id as usize % groups.len()].0.clone(),
        }
    }

    /// How many objects must be there once a scene is at rest: of named ones all.
    #[must_use]
    pub fn count_min(&self, scene_id: u64) -> usize {
        match self {
            Self::Pile { .. } | Self::Packed { .. } => 1,
            Self::Things(groups) => groups[scene_id as usize % groups.len()].1.len(),
        }
    }
}

settings! {
    /// Cameras evenly about the workspace, all looking at one point above the middle of its floor.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Views {
        /// How many.
        pub count: usize where 1..=32,
        /// How far away, in workspaces.
        pub radius_sizes: f32 where 1.0..=100.0,
        /// Angle from the vertical.
        pub polar_rad: f32 where 0.0..=core::f32::consts::FRAC_PI_2,
        /// Azimuth of the first.
        pub azimuth_rad: f32 where -10.0..=10.0,
        /// Height of the point, in metres.
        pub target_z_m: f32 where 0.0..=1.0,
    }
}

settings! {
    /// When a round ends before the table is empty.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub struct StopParams {
        /// So many failures in a row (VGN: 2).
        pub failures_max: u32 where 1..=1_000,
        /// Whether the planner is told which grasps failed since the last one that held, and avoids them. Otherwise the
        /// plan's next grasp is tried while the scene is as it was.
        pub avoid_failed: bool; or false,
        /// So many attempts in all.
        pub attempts_max: u32 where 1..=10_000,
    }
}

settings! {
    /// What an experiment's file holds.
    #[derive(Debug, Clone)]
    pub struct Keys {
        /// The protocol's name; every number carries it. Keys in braces stand for their values; what is set besides is
        /// added.
        pub protocol: String,
        /// Seeds of the scenes; each has all rounds.
        pub seeds: Vec<u64>,
        /// Rounds of a seed.
        pub rounds: u64 where 1..=1_000_000,
        /// `paper`, or the path of a generator's config.
        pub scene: String,
        /// Side of the square on which objects are dropped, in metres, in place of the scene's workspace; rounded up to
        /// whole voxels.
        pub table_size_m: f32 where 0.2..=0.95; or Grid::PAPER.size_m,
        /// `judge`, `paper` or `vgn`, or the path of a planner's settings.
        pub plan: String,
        /// `built-in`, or the path of a network.
        pub model: String,
        /// Which objects, and how they come to lie.
        pub objects: ObjectKeys,
        /// What the objects lie in, as in a generator's config, in place of the scene's.
        pub container: Option<Vec<ContainerParams>>; or None,
        /// Where the cameras stand.
        pub views: Views,
        /// What is wrong with their depths.
        pub noise: NoiseKeys,
        /// Which poses of the cameras the planner gets.
        pub frames: Frames; or Frames::Given,
        /// When a round ends.
        pub stop: StopParams,
        /// What becomes of a gripper that touches something on its way or moves another object.
        pub touching: Touching; or Touching::Fails,
        /// Which grasp of a plan is executed.
        pub choice: Choice; or Choice::First,
    }
    check Keys::agree
}

settings! {
    /// Which objects lie on the table.
    #[derive(Debug, Clone)]
    pub struct ObjectKeys {
        /// How they come to lie.
        pub kind: Kind,
        /// How many.
        pub count: usize where 1..=60,
        /// Free extents of those of a pile, in place of the scene's.
        pub size_m: Option<[f32; 2]> where 0.002..=0.15; or None,
        /// `everyday`, `household-train`, `household-held-out`, or the path of a catalogue.
        pub catalogue: String,
        /// The catalogue's objects or sets, round after round the next.
        pub names: Vec<String>,
        /// Whether placements that the gripper cannot span are drawn anew.
        pub viable_only: bool,
    }
}

words! {
    /// What becomes of a gripper that touches something on its way, or moves another object.
    pub enum Touching {
        /// The attempt has failed: the label's contract.
        Fails = "fails",
        /// The gripper halts at the first touch, closes there and may move other objects: rounds of VGN and GIGA.
        Halts = "halts",
    }
}

words! {
    /// Which poses of the cameras the planner gets.
    pub enum Frames {
        /// Those in the workspace.
        Given = "given",
        /// Those in the frame of the first camera: the planner finds the table.
        Found = "found",
    }
}

words! {
    /// Which grasp of a plan is executed.
    pub enum Choice {
        /// The first.
        First = "first",
        /// The first that will hold; without one the round ends. It shows what a planner that knew every outcome
        /// would clear with the grasps that it considers (with `plan.detection.quality_min=1e-6`).
        Holds = "holds",
    }
}

words! {
    /// How objects come to lie.
    pub enum Kind {
        /// Dropped one by one, as in training.
        Pile = "pile",
        /// Upright, side by side.
        Packed = "packed",
        /// Those of a catalogue, dropped one by one.
        Things = "things",
    }
}

settings! {
    /// A sensor's faults.
    #[derive(Debug, Clone)]
    pub struct NoiseKeys {
        /// Which model.
        pub kind: NoiseKind,
        /// Standard deviation of `gaussian`.
        pub std_m: f32 where 0.0..=1.0,
    }
}

impl Keys {
    fn agree(&self, reader: &mut Reader<'_>) {
        let Self { seeds, objects, .. } = self;
        if !(1..=1_000).contains(&seeds.len()) {
            reader.fault(format_args!("number of seeds must be between 1 and 1000, got {}", seeds.len()));
        }
        let mut once = seeds.clone();
        once.sort_unstable();
        once.dedup();
        reader.must("seeds", once.len() == seeds.len(), || "must be different ones");
        reader.must(
            "objects.names",
            objects.names.is_empty() == (objects.kind != Kind::Things),
            || "must be there for objects.kind \"things\", and not for the others",
        );
    }
}

impl Config {
    /// Reads a file, or [`REFERENCE`]; paths in a file are taken from its folder. `set` are keys and values (TOML) in
    /// place of the file's.
    ///
    /// # Errors
    /// [`settings::Error`] of the file, or of one that it names.
    pub fn read(path: Option<&Path>, set: &[(String, String)]) -> Result<Self, settings::Error> {
        Self::resolve(Document::load(path, [REFERENCE, "pile.toml"])?, set)
    }

    /// The experiment in a document.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn resolve(mut document: Document, set: &[(String, String)]) -> Result<Self, settings::Error> {
        let (of_plan, own): (Vec<_>, Vec<_>) = set.iter().partition(|(key, _)| key.starts_with("plan."));
        own.into_iter().try_for_each(|(key, value)| document.set(key, value))?;
        let mut keys: Keys = document.read()?;
        keys.protocol += &changes(set);
        let file = |name: &str, built_in: &str| (name != built_in).then(|| document.folder().join(name));
        let mut scene = generator::Config::load(file(&keys.scene, "paper").as_deref(), Overrides::default())?;
        scene.grid = scene.grid.over(keys.table_size_m);
        scene.objects.size_m = keys.objects.size_m.unwrap_or(scene.objects.size_m);
        if let Some(container) = &keys.container {
            scene.container.clone_from(container);
        }
        let faults = container_faults(&scene.container, &scene.grid);
        if !faults.is_empty() {
            return Err(document.invalid(faults.iter().map(|fault| format!("container: {fault}")).collect()));
        }
        let plan_path = match BuiltIn::from_name(&keys.plan) {
            Some(named) => PathBuf::from(named.name()),
            None => document.folder().join(&keys.plan),
        };
        let mut plan = planner::Config::document(Some(&plan_path))?;
        let mut of_plan = of_plan.into_iter().map(|(key, value)| (key.trim_start_matches("plan."), value));
        of_plan.try_for_each(|(key, value)| plan.set(key, value))?;
        let text = format!("{}{PLANNER}{}", document.table(), plan.table());
        let plan: planner::Config = plan.read()?;
        // Who plans executes.
        scene.gripper = plan.gripper.clone().into();
        let objects = objects(&keys, &scene, &plan, document.folder());
        let objects = objects.map_err(|problem| document.invalid(vec![problem]))?;
        Ok(Self {
            digest: digest(document.table().clone(), &scene, &plan, &objects),
            objects,
            noise: keys.noise.kind.noise(keys.noise.std_m, scene.camera.focal_px),
            model: file(&keys.model, "built-in"),
            planned_by: match keys.model.as_str() {
                "built-in" => last(&keys.plan).to_owned(),
                model => format!("{} with {}", last(&keys.plan), last(model)),
            },
            text,
            keys,
            scene,
            plan,
        })
    }

    /// Says in its text who plans in place of our planner, of whose settings the gripper alone counts: the others are
    /// left out.
    pub fn tell_planner(&mut self, who: &str) {
        self.planned_by = who.replace(char::is_control, " ");
        let (own, plan) = self.text.split_once(PLANNER).unwrap_or((&self.text, ""));
        let [mut own, mut plan] = [own, plan].map(|text| text.parse::<Table>().unwrap_or_default());
        own.retain(|key, _| key != "plan" && key != "model");
        plan.retain(|key, _| key == "gripper");
        self.text = format!("{own}\n# Planned by {}.\n{plan}", self.planned_by);
    }

    /// Rounds of all seeds: at most 10⁹.
    #[must_use]
    pub fn round_count(&self) -> u64 {
        self.keys.rounds * self.keys.seeds.len() as u64
    }

    /// The planner of the experiment.
    ///
    /// # Errors
    /// If its network cannot be read.
    pub fn planner(&self) -> Result<Planner, Failure> {
        match &self.model {
            Some(model) => Planner::new(model, self.plan.clone()),
            None => Planner::built_in(self.plan.clone()),
        }
    }

    /// The cameras.
    #[must_use]
    pub fn cameras(&self) -> Vec<Camera> {
        let Views { count, radius_sizes, polar_rad, azimuth_rad, target_z_m } = self.keys.views;
        let turn = |number: usize| core::f32::consts::TAU * number as f32 / count as f32;
        let radius_m = radius_sizes * self.scene.grid.size_m;
        let camera = |number: usize| {
            let view = View { radius_m, polar_rad, azimuth_rad: azimuth_rad + turn(number) };
            let mut camera = camera_at(&view, &self.scene.grid, self.scene.camera.intrinsics());
            camera.workspace_from_camera.translation.z += target_z_m;
            camera
        };
        (0..count).map(camera).collect()
    }
}

/// What was set, unless the protocol's name was set: of paths the last part.
fn changes(set: &[(String, String)]) -> String {
    let told = |(key, value): &(String, String)| {
        let is_said = ["seeds", "rounds"].contains(&key.as_str());
        if is_said { String::new() } else { format!(", {key} = {}", last(value.trim_matches('"'))) }
    };
    if set.iter().any(|(key, _)| key == "protocol") { String::new() } else { set.iter().map(told).collect() }
}

/// The last part of a path.
fn last(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

/// What lies on the tables, whose voxels must be the planner's.
fn objects(keys: &Keys, scene: &generator::Config, plan: &planner::Config, folder: &Path) -> Result<Objects, String> {
    let (grid, expected) = (scene.grid, Grid::PAPER);
    if grid != (Grid { table_z_m: grid.table_z_m, ..expected.over(grid.size_m) }) {
        let (n, side_m) = (expected.resolution, expected.size_m);
        return Err(format!("the scenes' grid must have the planner's voxels, {n} in {side_m} m: scene"));
    }
    if keys.frames == Frames::Found && plan.network != BuiltIn::Judge {
        return Err(format!("frames must be \"given\" for the network {}: frames", plan.network.name()));
    }
    let keys = &keys.objects;
    Ok(match keys.kind {
        Kind::Pile => Objects::Pile { count: keys.count },
        Kind::Packed => Objects::Packed { count: keys.count, params: scene.packed.unwrap_or(PackedParams::HOUSEHOLD) },
        Kind::Things => {
            let catalogue = Catalogue::named(&keys.catalogue, folder).map_err(|e| format!("objects.catalogue: {e}"))?;
            let group = |name: &String| {
                let things = catalogue.find(name).ok_or_else(|| {
                    format!("objects.names must be among {}, got {}", catalogue.names().join(", "), name.escape_debug())
                })?;
                Ok((name.clone(), things.into_iter().cloned().collect()))
            };
            Objects::Things(keys.names.iter().map(group).collect::<Result<_, String>>()?)
        }
    })
}

/// The scenes as a dataset would have them: a catalogue's objects are models.
pub(crate) fn info_of(scene: &generator::Config, objects: &Objects) -> DatasetInfo {
    let mut info = scene.dataset_info();
    if let Objects::Things(groups) = objects {
        let things = groups.iter().flat_map(|(_, things)| things);
        let models = things.filter_map(|thing| thing.body.to_model(thing.mass_kg, thing.friction).ok());
        info.models = models.map(Arc::new).collect();
    }
    info
}

/// Digest of what decides a round, as it is stored: no name in this code is part of it.
fn digest(mut keys: Table, scene: &generator::Config, plan: &planner::Config, objects: &Objects) -> String {
    keys.retain(|key, _| !["seeds", "rounds"].contains(&key));
    let info = DatasetInfo { code_version: String::new(), ..info_of(scene, objects) }; // the journal has the version
    // Settings are numbers, words and tables of them, which always have a JSON form.
    let plan = serde_json::to_string(plan).unwrap_or_default();
    sha256(format!("{keys}\n{}\n{plan}", info.to_json()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digest_of(text: &str, set: &[(&str, &str)]) -> String {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/experiment/some.toml");
        let set: Vec<_> = set.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
        Config::resolve(Document::parse(text, &path).unwrap(), &set).unwrap().digest
    }

    #[test]
    fn the_text_says_who_plans_and_no_key_that_does_nothing() {
        let mut config = Config::read(None, &[]).unwrap();
        assert!(config.text.contains("\n# Planner\n") && config.text.contains("quality_min"), "{}", config.text);
        assert_eq!(config.planned_by, "judge");
        config.tell_planner("me\n[views]");
        let (own, plan) = config.text.split_once("\n# Planned by me [views].\n").unwrap();
        assert_eq!(plan, "gripper = \"parallel_jaw_80\"\n");
        for (key, counts) in [("plan", false), ("model", false), ("frames", true), ("touching", true)] {
            assert_eq!(own.lines().any(|line| line.starts_with(&format!("{key} = "))), counts, "{key}: {own}");
        }
    }

    /// A number must not carry the name of settings that did not run.
    #[test]
    fn the_protocol_is_that_of_the_settings_that_run() {
        let named = |file: &str, set: &[(&str, &str)]| {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/experiment").join(file);
            let set: Vec<_> = set.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
            Config::read(Some(&path), &set).unwrap().keys.protocol
        };
        assert_eq!(named("giga-pile.toml", &[]), "GIGA pile, 5 objects, 1 side view, dex noise");
        let d435 = [("noise.kind", "d435"), ("rounds", "3")];
        assert_eq!(named("giga-pile.toml", &d435), "GIGA pile, 5 objects, 1 side view, dex noise, noise.kind = d435");
        let more = [("objects.count", "7"), ("noise.kind", "\"dex\""), ("plan", "../plan/vgn.toml")];
        assert_eq!(
            named("pile.toml", &more),
            "pile, 5 objects, 6 views, objects.count = 7, noise.kind = dex, plan = vgn.toml"
        );
        assert_eq!(named("pile.toml", &[("protocol", "mine"), ("objects.count", "7")]), "mine");
    }

    #[test]
    fn the_digest_changes_with_every_part_that_decides_a_round_and_with_nothing_else() {
        let pile = digest_of(REFERENCE, &[]);
        let plain: String =
            REFERENCE.lines().filter(|line| !line.starts_with('#')).map(|line| format!("{line}\n")).collect();
        assert_eq!(digest_of(&plain, &[("seeds", "[7]"), ("rounds", "3")]), pile);
        for (key, value) in [
            ("views.count", "5"),
            ("objects.count", "4"),
            ("scene", "../generate/vgn.toml"),
            ("plan.detection.quality_min", "0.8"),
            ("scene", "../generate/everyday.toml"),
            ("touching", "halts"),
            ("choice", "holds"),
            ("plan", "paper"),
            ("plan.ranking.policy", "paper"),
        ] {
            assert_ne!(digest_of(REFERENCE, &[(key, value)]), pile, "{key}");
        }
    }
}
