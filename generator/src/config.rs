//! The generator's config: the settings of a dataset, each key with the type that the generator computes with.

use std::path::Path;

use perception::{SensorParams, ViewKind};
use schema::{
    CameraParams, Engine, Grid, Grippers, Physics, Procedure, SettleParams, ShapeKind, TsdfParams, Vec3, ViewParams,
};
use serde::Serialize;
use settings::{Document, Reader, settings, words};
use toml::Value;

use crate::containers::{ContainerParams, container_faults};
use crate::models::Models;
use crate::policy::Policy;
use crate::robustness::RobustnessParams;

/// Yaws per point, evenly over half a turn.
pub(crate) const YAWS: usize = 6;
/// The default config, built in so that the program runs anywhere.
const PAPER: [&str; 2] =
    [include_str!("../../configs/generate/paper.toml"), "the built-in configs/generate/paper.toml"];

/// Keys of `[objects]` for primitives only; a config with a catalogue has none of them.
pub(crate) const OF_PRIMITIVES: [&str; 4] = ["shapes", "size_m", "density_kg_m3", "friction"];

settings! {
    /// Which objects are dropped.
    #[derive(Debug, Clone, PartialEq, Serialize)]
    pub struct ObjectParams {
        /// Shapes, drawn evenly.
        pub shapes: Vec<ShapeKind>,
        /// How many are dropped …
        pub counts: Vec<usize> where 1..=64,
        /// Relative frequency of each entry of `counts`.
        pub count_weights: Vec<f32> where 0.0..=1e6,
        /// Every free extent is uniform in this range; at most half the workspace's side.
        pub size_m: [f32; 2] where 0.002..=1.5,
        /// Density, uniform.
        pub density_kg_m3: [f32; 2] where 1.0..=25_000.0,
        /// Friction coefficient, uniform.
        pub friction: [f32; 2] where 0.0..=5.0,
        /// Height of the drop above the table.
        pub drop_height_m: f32 where 0.0..=0.3,
        /// Side of the square in the middle of the workspace over which they are released, or stand packed; 0: all of
        /// the workspace. Where there is a container, it is the container's inside.
        #[serde(skip_serializing_if = "is_none")]
        pub room_m: f32 where 0.0..=1.2; or 0.0,
        /// The catalogue's objects that are dropped instead of primitives, if there is one.
        pub catalogue: Models; or Models::default(),
    }
    check ObjectParams::lists_agree
}

impl ObjectParams {
    /// Side of the square over which objects are released on a bare table, in metres.
    #[must_use]
    pub fn side_m(&self, grid: &Grid) -> f32 {
        if self.room_m > 0.0 { self.room_m.min(grid.size_m) } else { grid.size_m }
    }

    fn lists_agree(&self, reader: &mut Reader<'_>) {
        let (counts, weights) = (self.counts.len(), self.count_weights.len());
        reader.must("shapes", !self.shapes.is_empty(), || "must name at least one shape, got none");
        reader.must("counts", counts > 0, || "must have at least one count, got none");
        reader.must("count_weights", counts == weights, || {
            format!("must have as many values as objects.counts, {counts}, got {weights}")
        });
        reader.must("count_weights", self.count_weights.iter().sum::<f32>() > 0.0, || "must not all be 0");
    }
}

settings! {
    /// Packed scenes among the dropped ones: objects of `[objects]`, but upright and of these sizes; of a catalogue
    /// those that have them, with z up.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct PackedParams {
        /// Share of the scenes that are packed.
        pub share: f32 where 0.0..=1.0,
        /// Free extents in the plane, uniform; half-cylinders are half as deep as wide.
        pub width_m: [f32; 2] where 0.005..=0.2,
        /// Height, uniform.
        pub height_m: [f32; 2] where 0.005..=0.3,
        /// Minimum distance of their bounding rectangles.
        pub gap_m: f32 where 0.0..=0.1,
    }
}

impl PackedParams {
    /// Household sizes, a millimetre apart: the packed scenes of our experiments.
    pub const HOUSEHOLD: Self = Self { share: 1.0, width_m: [0.03, 0.06], height_m: [0.06, 0.14], gap_m: 0.001 };

    /// Whether an object of a catalogue has these sizes.
    pub(crate) fn fits(&self, extents_m: Vec3) -> bool {
        let is_within = |[low, high]: [f32; 2], size_m: f32| (low..=high).contains(&size_m);
        is_within(self.width_m, extents_m.x)
            && is_within(self.width_m, extents_m.y)
            && is_within(self.height_m, extents_m.z)
    }
}

words! {
    /// How grasps are drawn.
    pub enum Sampler {
        /// By the paper's rules (Appendix A).
        Rules = "rules",
        /// VGN's: a seen point of the surface, the gripper along its normal, six yaws.
        Vgn = "vgn",
        /// Several ways, each with its share: for a judge, which must tell apart what grasps of all kinds meet.
        Mixed = "mixed",
    }
}

words! {
    /// Along which of the axes that Appendix A leaves open a gripper closes.
    pub enum RuleClosing {
        /// One of them, drawn.
        Drawn = "drawn",
        /// That along which the object is narrowest, as people grip.
        Narrowest = "narrowest",
    }
}

settings! {
    /// How many of a scene's attempts are drawn in which way, of `sampler = "mixed"`. The shares make 1.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct Shares {
        /// By the paper's rules.
        pub rules: f32 where 0.0..=1.0,
        /// VGN's, in sixes.
        pub normals: f32 where 0.0..=1.0,
        /// Grasp candidates proposed on what the scene's cameras saw.
        pub proposals: f32 where 0.0..=1.0,
        /// Proposals that the policy's judge rates highest; without a policy, as `proposals`.
        pub judged: f32 where 0.0..=1.0,
        /// Grasps that held in another attempt of the scene, moved by up to 30 mm and turned by up to 30 degrees.
        pub displaced: f32 where 0.0..=1.0,
        /// The same, moved but not turned.
        #[serde(skip_serializing_if = "is_none")]
        pub shifted: f32 where 0.0..=1.0; or 0.0,
    }
}

/// What is not stored, so that configs from before it keep their identity.
fn is_none(value: &f32) -> bool {
    *value == 0.0
}

impl Shares {
    /// What a config has that draws in one way.
    pub const NONE: Self = Self { rules: 0.0, normals: 0.0, proposals: 0.0, judged: 0.0, displaced: 0.0, shifted: 0.0 };

    fn sum(self) -> f32 {
        self.rules + self.normals + self.proposals + self.judged + self.displaced + self.shifted
    }
}

settings! {
    /// Everything that decides the rows of a dataset.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Config {
        /// Seed of every stream.
        pub seed: u64,
        /// Shards.
        pub shards: u32 where 1..=100_000,
        /// Attempts in all.
        pub attempts: u64 where 1..=1_000_000_000_000,
        /// Attempts per scene; the last scene takes the remainder.
        pub attempts_per_scene: u32 where 1..=10_000,
        /// How grasps are drawn.
        pub sampler: Sampler,
        /// The shares of a mixed sampler.
        pub shares: Shares; or Shares::NONE,
        /// Along which axis grasps by the rules close where Appendix A leaves it open.
        pub rule_closing: RuleClosing; or RuleClosing::Drawn,
        /// Weights of a judge, whose best grasps are executed.
        pub policy: Option<Policy>; or None,
        /// The gripper, or several that take turns from scene to scene: their names or files, or a table of ranges.
        pub gripper: Grippers,
        /// The workspace.
        pub grid: Grid,
        /// What is dropped.
        pub objects: ObjectParams,
        /// Share of the scenes in which nothing lies that the gripper cannot span: wider objects are drawn anew.
        pub spanned_share: f32 where 0.0..=1.0; or 0.0,
        /// Which scenes are packed instead.
        pub packed: Option<PackedParams>; or None,
        /// How attempts that held are repeated to learn how much they depend on what nobody sees.
        pub robustness: Option<RobustnessParams>; or None,
        /// What the objects lie in: kinds of containers, each with its share of the scenes; the others have none.
        pub container: Vec<ContainerParams>; or Vec::new(),
        /// When it rests.
        pub settle: SettleParams,
        /// Where the cameras stand.
        pub views: ViewParams,
        /// Other kinds of observations, each with its share of the scenes; `views` has what they leave.
        pub view_kinds: Vec<ViewKind>; or Vec::new(),
        /// Sensor noise and errors of the cameras' poses.
        pub sensor: Option<SensorParams>; or None,
        /// Their lens.
        pub camera: CameraParams,
        /// TSDF fusion of the depth images.
        pub tsdf: TsdfParams,
        /// The engine's settings.
        pub physics: Physics,
        /// The attempt.
        pub procedure: Procedure,
    }
    check Config::keys_agree
}

/// Overrides from the command line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Overrides<'a> {
    /// `--seed`.
    pub seed: Option<u64>,
    /// `--shards`.
    pub shards: Option<u64>,
    /// `--attempts`.
    pub attempts: Option<u64>,
    /// `--policy`, from the working folder.
    pub policy: Option<&'a Path>,
    /// `--set`: keys and their values.
    pub set: &'a [(String, String)],
}

impl Config {
    /// The config from a file, or the paper's if there is none, with the command line's overrides.
    ///
    /// # Errors
    /// [`settings::Error`] with all faults.
    pub fn load(path: Option<&Path>, overrides: Overrides<'_>) -> Result<Self, settings::Error> {
        Self::read(Document::load(path, PAPER)?, overrides)
    }

    /// The config in a document; the paths of gripper and catalogue are relative to its folder.
    ///
    /// # Errors
    /// [`settings::Error`] with all faults.
    pub fn read(mut document: Document, overrides: Overrides<'_>) -> Result<Self, settings::Error> {
        overrides.set.iter().try_for_each(|(key, value)| document.set(key, value))?;
        let table = document.table_mut();
        for (key, value) in [("shards", overrides.shards), ("attempts", overrides.attempts)] {
            // Values that TOML cannot hold are far beyond the limits.
            let value = value.map(|value| Value::Integer(i64::try_from(value).unwrap_or(i64::MAX)));
            table.extend(value.map(|value| (key.to_owned(), value)));
        }
        if let Some(policy) = overrides.policy {
            // The config's paths are taken from its folder.
            let policy = std::path::absolute(policy).unwrap_or_else(|_| policy.to_owned());
            table.insert("policy".to_owned(), Value::String(policy.display().to_string()));
        }
        let mut without_effect = Vec::new();
        if let Some(objects) = table.get_mut("objects").and_then(Value::as_table_mut)
            && objects.contains_key("catalogue")
        {
            let paper = Document::parse(PAPER[0], Path::new(PAPER[1]))?;
            for key in OF_PRIMITIVES {
                if objects.insert(key.to_owned(), paper.table()["objects"][key].clone()).is_some() {
                    without_effect.push(format!(
                        "objects.{key} must be left out beside objects.catalogue: it is for primitives, and a catalogue's objects \
                         have their own"
                    ));
                }
            }
        }
        let read = document.read::<Self>();
        if !without_effect.is_empty() {
            let faults = if let Err(settings::Error::Invalid { faults, .. }) = read { faults } else { Vec::new() };
            return Err(document.invalid([faults, without_effect].concat()));
        }
        let config = read?;
        Ok(Self { seed: overrides.seed.unwrap_or(config.seed), ..config })
    }

    /// Checks across sections.
    fn keys_agree(&self, reader: &mut Reader<'_>) {
        let Self { shards, attempts, attempts_per_scene, sampler, gripper, grid, objects, procedure, physics, .. } =
            self;
        let scenes = attempts.div_ceil(u64::from(*attempts_per_scene));
        reader.must("shards", u64::from(*shards) <= scenes, || {
            format!(
                "must be at most the number of scenes, {scenes} ({attempts} attempts, {attempts_per_scene} a scene), got {shards}"
            )
        });
        let is_whole = *sampler != Sampler::Vgn || attempts_per_scene.is_multiple_of(YAWS as u32);
        reader.must("attempts_per_scene", is_whole, || {
            format!("must be a multiple of the {YAWS} yaws at a point, got {attempts_per_scene}")
        });
        let [low, high] = objects.size_m;
        let most = 0.5 * grid.size_m;
        reader.must("objects.size_m", high <= most, || {
            format!("must be a range [low, high] within [0.002, {most}], got [{low}, {high}]")
        });
        // A gripper without enough time to close would label narrow objects as slipped.
        for one in gripper.all() {
            let way_m = one.ways_m().into_iter().fold(0.0, f32::max);
            let (needs_s, got) = (way_m / one.closing_speed_m_s, procedure.close_time_s_max);
            reader.must("procedure.close_time_s_max", needs_s <= got + 1e-4, || {
                format!("must be at least the {needs_s:.2} s in which {} closes, got {got}", one.name)
            });
            let is_known = one.jaws.is_empty() || physics.engine == Engine::Stepper;
            reader.must("physics.engine", is_known, || {
                format!("must be stepper for the jaws of {}: rapier knows fingers that slide alike", one.name)
            });
        }
        let wanted = if *sampler == Sampler::Mixed { 1.0 } else { 0.0 };
        let got = self.shares.sum();
        reader.must("shares", (got - wanted).abs() < 1e-3, || {
            format!("must make {wanted} for sampler = \"{}\", got {got}", sampler.name())
        });
        if let Some(policy) = &self.policy {
            let problem = || "needs shares.judged above 0: its grasps have no share of the attempts".to_owned();
            reader.must("policy", self.shares.judged > 0.0, problem);
            let failure = gripper.all().iter().find_map(|one| policy.judge(one, grid).err());
            if let Some(failure) = failure {
                reader.within("policy", |reader| reader.report(failure));
            }
        }
        let kinds: f32 = self.view_kinds.iter().map(|kind| kind.share).sum();
        reader.must("view_kinds", kinds < 1.0 + 1e-3, || format!("must have shares of 1 at most in all, got {kinds}"));
        if let Some(packed) = self.packed {
            let (most, [_, high]) = (grid.size_m - grid.table_z_m, packed.height_m);
            reader.must("packed.height_m", high <= most, || {
                format!("must be at most the {most} m of the workspace above the table, got {high}")
            });
            let models = objects.catalogue.stored();
            let fits = models.is_empty() || models.iter().any(|model| packed.fits(model.extents_m));
            reader.must("packed", fits, || "must have sizes that an object of the catalogue has".to_owned());
        }
        for fault in container_faults(&self.container, grid) {
            reader.within("container", |reader| reader.report(fault));
        }
        self.catalogue_fits(reader);
    }

    /// A catalogue needs grasps along normals, because Appendix A has rules for primitives only, and its objects must
    /// be small enough to fall into the workspace.
    fn catalogue_fits(&self, reader: &mut Reader<'_>) {
        let Self { objects: ObjectParams { catalogue, drop_height_m, .. }, grid, .. } = self;
        reader.must(
            "objects.catalogue",
            catalogue.is_empty() || (self.sampler != Sampler::Rules && self.shares.rules == 0.0),
            || "needs sampler = \"vgn\", or \"mixed\" without rules: the rules are those of the four primitive shapes",
        );
        for (name, size_m) in catalogue.bodies().iter().map(|body| (body.name(), 2.0 * body.bounding_radius_m())) {
            if size_m > grid.size_m {
                let side_m = grid.size_m;
                let problem =
                    format_args!("{name} must fit into grid.size_m {side_m} in any pose, and is {size_m} m long");
                reader.within("objects.catalogue", |reader| reader.report(problem));
            }
            // Released lower, it would start inside the table.
            let radius_m = 0.5 * size_m;
            reader.must("objects.drop_height_m", radius_m <= *drop_height_m, || {
                format!("must be at least {radius_m} for {name}, got {drop_height_m}")
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use schema::Intrinsics;

    use super::*;

    fn problems(text: &str) -> Vec<String> {
        match Config::read(Document::parse(text, Path::new("test.toml")).unwrap(), Overrides::default()) {
            Err(settings::Error::Invalid { faults, .. }) => faults,
            other => panic!("expected problems, got {other:?}"),
        }
    }

    #[test]
    fn the_papers_config_is_the_papers() {
        let config = Config::load(None, Overrides::default()).unwrap();
        let info = config.dataset_info();
        assert_eq!((info.attempt_count, info.attempts_per_scene, info.shard_count), (200_000, 60, 64));
        assert_eq!(info.scene_count, 3334);
        assert_eq!(config.grid, Grid::PAPER);
        assert_eq!(config.camera.intrinsics(), Intrinsics::VGN);
        assert_eq!(config.physics, Physics::STANDARD);
        assert_eq!(config.settle, SettleParams::STANDARD);
        assert_eq!(config.views, ViewParams { polar_rad: config.views.polar_rad, ..ViewParams::VGN });
        assert_eq!(config.procedure, Procedure::PAPER);
    }

    #[test]
    fn everything_that_is_wrong_is_reported_at_once() {
        let text = PAPER[0]
            .replace("resolution = 40 ", "resolution = 400 ")
            .replace("step_rate_hz = 240.0", "step_rate_hz = \"fast\"")
            .replace("\n[settle]", "\nbogus = 1\n[settle]")
            .replace("hold_time_s = 0.25", "")
            .replace("\"half_cylinder\"]", "\"torus\"]");
        let problems = problems(&text);
        for (key, value) in [
            ("grid.resolution", "400"),
            ("physics.step_rate_hz", "fast"),
            ("objects.bogus", ""),
            ("procedure.hold_time_s", ""),
            ("objects.shapes", "torus"),
        ] {
            assert!(problems.iter().any(|p| p.starts_with(key) && p.contains(value)), "{key}: {problems:#?}");
        }
        assert_eq!(problems.len(), 5, "{problems:#?}");
    }

    #[test]
    fn a_gripper_that_has_no_time_to_close_is_refused() {
        let problems = problems(&PAPER[0].replace("close_time_s_max = 1.0", "close_time_s_max = 0.7"));
        assert!(problems.len() == 1 && problems[0].starts_with("procedure.close_time_s_max"), "{problems:?}");
    }

    #[test]
    fn keys_that_a_catalogue_leaves_without_effect_are_refused() {
        let everyday = include_str!("../../configs/generate/everyday.toml");
        assert!(Config::read(Document::parse(everyday, Path::new("x")).unwrap(), Overrides::default()).is_ok());
        let problems =
            problems(&everyday.replace("[objects]\n", "[objects]\nsize_m = [0.03, 0.08]\nfriction = \"high\"\n"));
        assert_eq!(problems.len(), 2, "{problems:#?}");
        for (problem, key) in problems.iter().zip(["size_m", "friction"]) {
            assert!(problem.starts_with(&format!("objects.{key} ")), "{problem}");
        }
    }

    #[test]
    fn no_shards_and_more_shards_than_scenes_are_refused() {
        let with_shards = |shards| Overrides { shards: Some(shards), attempts: Some(120), ..Overrides::default() };
        let message = |shards| Config::load(None, with_shards(shards)).unwrap_err().to_string();
        assert!(message(0).contains("shards must be between 1"), "{}", message(0));
        assert!(message(3).contains("shards must be at most"), "{}", message(3));
        assert!(Config::load(None, with_shards(2)).is_ok());
    }
}
