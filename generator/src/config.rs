//! The generator's config: text to domain types once, at the edge, with everything that is wrong told at once.

use std::path::{Path, PathBuf};

use perception::ViewLaw;
use program::{Exit, ExitCode};
use schema::{Grid, Gripper, Intrinsics, Procedure, ShapeKind, keys_unlike};
use simulator::{Physics, SettleLaw};

use crate::laws::{CONTACT_FREQUENCY_HZ, GRAVITY_M_S2, SOLVER_ITERATIONS, STEP_RATE_HZ, TABLE_FRICTION};
use crate::models::Models;
use crate::normals::YAWS;
use crate::raw::RawConfig;

/// The default config and the built-in hand, in the binary, so that it runs anywhere.
const PAPER: &str = include_str!("../../configs/generate/paper.toml");

/// Keys that a config may have besides the paper's.
const OPTIONAL: &str = "[objects]\ncatalogue = \"everyday\"";
/// Keys of `[objects]` that say what primitives are like; a config with a catalogue may leave them out.
const OF_PRIMITIVES: [&str; 4] = ["shapes", "size_m", "density_kg_m3", "friction"];

/// Which objects are dropped.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectLaw {
    /// Shapes, drawn evenly.
    pub shapes: Vec<ShapeKind>,
    /// How many are dropped, with relative weights.
    pub counts: Vec<(usize, f32)>,
    /// Every free extent is uniform in this range.
    pub size_m: [f32; 2],
    /// Density, uniform.
    pub density_kg_m3: [f32; 2],
    /// Friction coefficient, uniform.
    pub friction: [f32; 2],
    /// Height of the drop above the table.
    pub drop_height_m: f32,
}

/// How grasps are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sampler {
    /// By the paper's rules (Appendix A).
    Rules,
    /// VGN's: a seen point of the surface, the hand along its normal, six yaws.
    Vgn,
}

impl Sampler {
    const ALL: [Self; 2] = [Self::Rules, Self::Vgn];

    /// The name in configs and datasets.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rules => "rules",
            Self::Vgn => "vgn",
        }
    }
}

/// Everything that decides the rows of a dataset.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Seed of every stream.
    pub seed: u64,
    /// Shards.
    pub shard_count: u32,
    /// Attempts in all.
    pub attempt_count: u64,
    /// Attempts per scene; the last scene takes the remainder.
    pub attempts_per_scene: u32,
    /// How grasps are drawn.
    pub sampler: Sampler,
    /// The hand.
    pub gripper: Gripper,
    /// The workspace.
    pub grid: Grid,
    /// What is dropped.
    pub objects: ObjectLaw,
    /// The catalogue's objects that are dropped instead of primitives, if there is one.
    pub models: Models,
    /// When it rests.
    pub settle: SettleLaw,
    /// Tries at a scene.
    pub tries_max: u32,
    /// Where the cameras stand.
    pub views: ViewLaw,
    /// Their lens.
    pub intrinsics: Intrinsics,
    /// Truncation of the TSDF.
    pub truncation_voxels: f32,
    /// The engine's settings.
    pub physics: Physics,
    /// The attempt.
    pub procedure: Procedure,
}

/// What the command line says instead of the file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Overrides {
    /// `--seed`.
    pub seed: Option<u64>,
    /// `--shards`.
    pub shards: Option<u64>,
    /// `--attempts`.
    pub attempts: Option<u64>,
}

/// Why a config is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("failed to read the config: {source}: {}", .path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not TOML.
    #[error("the config is not TOML: {message}: {file}")]
    Parse {
        /// Which file.
        file: String,
        /// Where and why.
        message: String,
    },
    /// Keys or values that cannot be; all of them.
    #[error("the config has {} problem{}:\n  {}\n({file})", .problems.len(), if .problems.len() == 1 { "" } else { "s" },
            .problems.join("\n  "))]
    Invalid {
        /// Which file.
        file: String,
        /// One message each, with the key's path.
        problems: Vec<String>,
    },
}

impl Exit for ConfigError {
    /// Always [`ExitCode::Config`].
    fn exit_code(&self) -> ExitCode {
        ExitCode::Config
    }
}

impl Config {
    /// The config from a file, or the paper's if there is none, with the command line's overrides.
    ///
    /// # Errors
    /// [`ConfigError`] names everything that is wrong.
    pub fn load(path: Option<&Path>, overrides: Overrides) -> Result<Self, ConfigError> {
        match path {
            None => Self::from_toml(PAPER, "the built-in configs/generate/paper.toml", None, overrides),
            Some(path) => {
                let text = std::fs::read_to_string(path)
                    .map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
                Self::from_toml(&text, &path.display().to_string(), path.parent(), overrides)
            }
        }
    }

    /// The config from the text of a TOML file; gripper paths are taken from `folder`.
    ///
    /// # Errors
    /// [`ConfigError`] names everything that is wrong.
    pub fn from_toml(text: &str, file: &str, folder: Option<&Path>, overrides: Overrides) -> Result<Self, ConfigError> {
        let parse = |text: &str| {
            text.parse::<toml::Table>()
                .map_err(|e| ConfigError::Parse { file: file.to_owned(), message: e.to_string().trim().to_owned() })
        };
        let (given, reference) = with_optional(parse(text)?, parse(PAPER)?, parse(OPTIONAL)?);
        let mut problems = keys_unlike(&given, &reference);
        let sound = toml::Value::Table(sound_parts(given, &reference));
        let raw: RawConfig = sound.try_into().map_err(|e: toml::de::Error| ConfigError::Parse {
            file: file.to_owned(),
            message: e.message().to_owned(),
        })?;
        let config = Self::from_raw(raw, folder, overrides, &mut problems);
        match config {
            Some(config) if problems.is_empty() => Ok(config),
            _ => Err(ConfigError::Invalid { file: file.to_owned(), problems }),
        }
    }

    /// Domain types from raw ones; every violation goes to `problems`.
    fn from_raw(
        mut raw: RawConfig,
        folder: Option<&Path>,
        overrides: Overrides,
        problems: &mut Vec<String>,
    ) -> Option<Self> {
        raw.seed = overrides.seed.unwrap_or(raw.seed);
        raw.shards = overrides.shards.unwrap_or(raw.shards);
        raw.attempts = overrides.attempts.unwrap_or(raw.attempts);
        let mut check = Check(problems);
        check.whole("shards", raw.shards, 1, 100_000);
        check.whole("attempts", raw.attempts, 1, 1_000_000_000_000);
        check.whole("attempts_per_scene", raw.attempts_per_scene, 1, 10_000);
        if raw.attempts_per_scene > 0 {
            let scenes = raw.attempts.div_ceil(raw.attempts_per_scene);
            check.that(raw.shards <= scenes, || {
                format!(
                    "shards must be at most the number of scenes, {scenes} ({} attempts, {} a scene), got {}",
                    raw.attempts, raw.attempts_per_scene, raw.shards
                )
            });
        }
        check.whole("grid.resolution", raw.grid.resolution, 8, 128);
        check.real("grid.size_m", raw.grid.size_m, 0.05, 3.0);
        check.real("grid.table_z_m", raw.grid.table_z_m, 0.0, 0.5 * raw.grid.size_m.max(0.0));
        let objects = check.objects(&raw);
        check.whole("settle.solver_iterations", raw.settle.solver_iterations, 1, 1_000);
        check.real("settle.damping_1_s", raw.settle.damping_1_s, 0.0, 20.0);
        check.real("settle.linear_speed_m_s_max", raw.settle.linear_speed_m_s_max, 1e-4, 1.0);
        check.real("settle.angular_speed_rad_s_max", raw.settle.angular_speed_rad_s_max, 1e-3, 10.0);
        check.real("settle.rest_time_s", raw.settle.rest_time_s, 0.01, 10.0);
        check.real("settle.time_s_max", raw.settle.time_s_max, raw.settle.rest_time_s, 60.0);
        check.whole("settle.tries_max", raw.settle.tries_max, 1, 10_000);
        let views = check.views(&raw);
        check.whole("camera.width_px", raw.camera.width_px, 16, 4096);
        check.whole("camera.height_px", raw.camera.height_px, 16, 4096);
        check.real("camera.focal_px", raw.camera.focal_px, 10.0, 10_000.0);
        check.real("tsdf.truncation_voxels", raw.tsdf.truncation_voxels, 1.0, 20.0);
        check.real("physics.step_rate_hz", raw.physics.step_rate_hz, STEP_RATE_HZ[0], STEP_RATE_HZ[1]);
        let [low, high] = SOLVER_ITERATIONS;
        check.whole("physics.solver_iterations", raw.physics.solver_iterations, low, high);
        let [low, high] = CONTACT_FREQUENCY_HZ;
        check.real("physics.contact_frequency_hz", raw.physics.contact_frequency_hz, low, high);
        check.real("physics.gravity_m_s2", raw.physics.gravity_m_s2, GRAVITY_M_S2[0], GRAVITY_M_S2[1]);
        check.real("physics.table_friction", raw.physics.table_friction, TABLE_FRICTION[0], TABLE_FRICTION[1]);
        check.procedure(&raw.procedure);
        let gripper = check.gripper(&raw.gripper, folder);
        check.closes(gripper.as_ref(), &raw.procedure);
        let sampler = Sampler::ALL.into_iter().find(|sampler| sampler.name() == raw.sampler);
        check.that(sampler.is_some(), || {
            format!("sampler must be one of {}, got {}", Sampler::ALL.map(Sampler::name).join(", "), raw.sampler)
        });
        let parted = sampler == Some(Sampler::Vgn) && !raw.attempts_per_scene.is_multiple_of(YAWS as u64);
        check.that(!parted, || {
            let got = raw.attempts_per_scene;
            format!("attempts_per_scene must be a multiple of the {YAWS} yaws at a point, got {got}")
        });
        let models = check.models(&raw, sampler, folder);
        let (objects, views, gripper, sampler) = (objects?, views?, gripper?, sampler?);
        let (width_px, height_px) = (raw.camera.width_px as usize, raw.camera.height_px as usize);
        Some(Self {
            seed: raw.seed,
            shard_count: u32::try_from(raw.shards).ok()?,
            attempt_count: raw.attempts,
            attempts_per_scene: u32::try_from(raw.attempts_per_scene).ok()?,
            sampler,
            gripper,
            grid: Grid {
                resolution: raw.grid.resolution as usize,
                size_m: raw.grid.size_m,
                table_z_m: raw.grid.table_z_m,
            },
            objects,
            models: models?,
            settle: SettleLaw {
                solver_iterations: raw.settle.solver_iterations as usize,
                damping_1_s: raw.settle.damping_1_s,
                linear_speed_m_s_max: raw.settle.linear_speed_m_s_max,
                angular_speed_rad_s_max: raw.settle.angular_speed_rad_s_max,
                rest_time_s: raw.settle.rest_time_s,
                time_s_max: raw.settle.time_s_max,
            },
            tries_max: u32::try_from(raw.settle.tries_max).ok()?,
            views,
            intrinsics: Intrinsics {
                width_px,
                height_px,
                fx_px: raw.camera.focal_px,
                fy_px: raw.camera.focal_px,
                cx_px: 0.5 * width_px as f32,
                cy_px: 0.5 * height_px as f32,
            },
            truncation_voxels: raw.tsdf.truncation_voxels,
            physics: raw.physics.into(),
            procedure: raw.procedure,
        })
    }
}

/// Optional keys that the given table has, in the reference too, so that they are known; and what the given table may leave out
/// because of them, filled in.
fn with_optional(
    mut given: toml::Table,
    mut reference: toml::Table,
    optional: toml::Table,
) -> (toml::Table, toml::Table) {
    for (section, keys) in &optional {
        let (Some(toml::Value::Table(given)), Some(toml::Value::Table(reference)), toml::Value::Table(keys)) =
            (given.get_mut(section), reference.get_mut(section), keys)
        else {
            continue;
        };
        for (key, value) in keys.iter().filter(|(key, _)| given.contains_key(*key)).collect::<Vec<_>>() {
            for left_out in OF_PRIMITIVES.iter().filter(|key| !given.contains_key(**key)).collect::<Vec<_>>() {
                given.insert((*left_out).to_owned(), reference[*left_out].clone());
            }
            reference.insert(key.clone(), value.clone());
        }
    }
    (given, reference)
}

/// The given table without what the reference does not have, and with the reference's values where it has none of the
/// right kind: so that ranges can be checked besides keys.
fn sound_parts(given: toml::Table, reference: &toml::Table) -> toml::Table {
    let mut sound = reference.clone();
    for (key, value) in given {
        match (sound.get_mut(&key), value) {
            (Some(toml::Value::Table(inner)), toml::Value::Table(value)) => *inner = sound_parts(value, inner),
            (Some(slot), value) => {
                let single = |value: &toml::Value| toml::Table::from_iter([(key.clone(), value.clone())]);
                if keys_unlike(&single(&value), &single(slot)).is_empty() {
                    *slot = value;
                }
            }
            (None, _) => {}
        }
    }
    sound
}

/// Collects violations.
struct Check<'a>(&'a mut Vec<String>);

impl Check<'_> {
    fn that(&mut self, holds: bool, message: impl FnOnce() -> String) {
        if !holds {
            self.0.push(message());
        }
    }

    fn whole(&mut self, key: &str, value: u64, low: u64, high: u64) {
        self.that((low..=high).contains(&value), || format!("{key} must be between {low} and {high}, got {value}"));
    }

    fn real(&mut self, key: &str, value: f32, low: f32, high: f32) {
        self.that((low..=high).contains(&value), || format!("{key} must be between {low} and {high}, got {value}"));
    }

    fn range(&mut self, key: &str, values: &[f32], low: f32, high: f32) -> Option<[f32; 2]> {
        let range = match values {
            [a, b] if low <= *a && a <= b && *b <= high => Some([*a, *b]),
            _ => None,
        };
        self.that(range.is_some(), || {
            format!("{key} must be a range [low, high] within [{low}, {high}], got {values:?}")
        });
        range
    }

    fn objects(&mut self, raw: &RawConfig) -> Option<ObjectLaw> {
        let given = &raw.objects;
        let mut shapes = Vec::new();
        for name in &given.shapes {
            match ShapeKind::from_name(name) {
                Some(kind) => shapes.push(kind),
                None => self.0.push(format!(
                    "objects.shapes must be among {}, got {name}",
                    ShapeKind::ALL.map(ShapeKind::name).join(", ")
                )),
            }
        }
        self.that(!given.shapes.is_empty(), || "objects.shapes must name at least one shape, got none".to_owned());
        self.that(!given.counts.is_empty(), || "objects.counts must have at least one count, got none".to_owned());
        for count in &given.counts {
            self.whole("objects.counts", *count, 1, 64);
        }
        for weight in &given.count_weights {
            self.real("objects.count_weights", *weight, 0.0, 1e6);
        }
        self.that(given.counts.len() == given.count_weights.len(), || {
            let (counts, weights) = (given.counts.len(), given.count_weights.len());
            format!("objects.count_weights must have as many values as objects.counts, {counts}, got {weights}")
        });
        self.that(given.count_weights.iter().sum::<f32>() > 0.0, || {
            "objects.count_weights must not all be 0".to_owned()
        });
        let size_m = self.range("objects.size_m", &given.size_m, 0.002, 0.5 * raw.grid.size_m);
        let density_kg_m3 = self.range("objects.density_kg_m3", &given.density_kg_m3, 1.0, 25_000.0);
        let friction = self.range("objects.friction", &given.friction, 0.0, 5.0);
        self.real("objects.drop_height_m", given.drop_height_m, 0.0, 0.3);
        Some(ObjectLaw {
            shapes,
            counts: given.counts.iter().map(|c| *c as usize).zip(given.count_weights.iter().copied()).collect(),
            size_m: size_m?,
            density_kg_m3: density_kg_m3?,
            friction: friction?,
            drop_height_m: given.drop_height_m,
        })
    }

    /// The catalogue's objects: drawn along normals, since Appendix A has rules for primitives only, and small enough to fall
    /// into the workspace.
    fn models(&mut self, raw: &RawConfig, sampler: Option<Sampler>, folder: Option<&Path>) -> Option<Models> {
        let Some(name) = &raw.objects.catalogue else { return Some(Models::default()) };
        self.that(sampler != Some(Sampler::Rules), || {
            "objects.catalogue needs sampler = \"vgn\": the rules are those of the four primitive shapes".to_owned()
        });
        match Models::read(name, folder) {
            Ok(models) => {
                for (body, size_m) in models.bodies().iter().map(|body| (body, 2.0 * body.bounding_radius_m())) {
                    self.that(size_m <= raw.grid.size_m, || {
                        let (name, side_m) = (body.name(), raw.grid.size_m);
                        format!("objects.catalogue: {name} must fit into grid.size_m {side_m} in any pose, and is {size_m} m long")
                    });
                    // Let go lower, it would begin within the table.
                    self.that(0.5 * size_m <= raw.objects.drop_height_m, || {
                        let (name, radius_m, got) = (body.name(), 0.5 * size_m, raw.objects.drop_height_m);
                        format!("objects.drop_height_m must be at least {radius_m} for {name}, got {got}")
                    });
                }
                Some(models)
            }
            Err(problems) => {
                self.0.extend(problems.into_iter().map(|problem| format!("objects.catalogue: {problem}")));
                None
            }
        }
    }

    fn views(&mut self, raw: &RawConfig) -> Option<ViewLaw> {
        let given = &raw.views;
        let radius = self.range("views.radius_sizes", &given.radius_sizes, 1.0, 100.0);
        let polar = self.range("views.polar_rad", &given.polar_rad, 0.0, core::f32::consts::FRAC_PI_2);
        let counts = match given.counts[..] {
            [low, high] if 1 <= low && low <= high && high <= 100 => Some([low as usize, high as usize]),
            _ => None,
        };
        self.that(counts.is_some(), || {
            format!("views.counts must be a range [low, high] within [1, 100], got {:?}", given.counts)
        });
        let ([count_min, count_max], [radius_sizes_min, radius_sizes_max]) = (counts?, radius?);
        let [polar_rad_min, polar_rad_max] = polar?;
        Some(ViewLaw { count_min, count_max, radius_sizes_min, radius_sizes_max, polar_rad_min, polar_rad_max })
    }

    fn procedure(&mut self, given: &Procedure) {
        for (key, value, low, high) in [
            ("pregrasp_distance_m", given.pregrasp_distance_m, 0.0, 0.5),
            ("retreat_distance_m", given.retreat_distance_m, 0.01, 1.0),
            ("retreat_cone_rad", given.retreat_cone_rad, 0.0, core::f32::consts::PI),
            ("retreat_speed_m_s", given.retreat_speed_m_s, 0.01, 2.0),
            ("close_time_s_max", given.close_time_s_max, 0.1, 20.0),
            ("hold_time_s", given.hold_time_s, 0.0, 60.0),
            ("empty_width_m", given.empty_width_m, 0.0, 0.05),
            ("held_travel_share_min", given.held_travel_share_min, 0.0, 1.0),
            ("other_push_m_max", given.other_push_m_max, 0.0, 1.0),
            ("other_lift_m_max", given.other_lift_m_max, 0.0, 1.0),
        ] {
            self.real(&format!("procedure.{key}"), value, low, high);
        }
    }

    /// A hand that has no time to close calls narrow objects slipped.
    fn closes(&mut self, gripper: Option<&Gripper>, procedure: &Procedure) {
        let Some(gripper) = gripper else { return };
        let needs_s = 0.5 * gripper.opening_m_max / gripper.closing_speed_m_s;
        self.that(needs_s <= procedure.close_time_s_max + 1e-4, || {
            let (name, got) = (&gripper.name, procedure.close_time_s_max);
            format!("procedure.close_time_s_max must be at least the {needs_s:.2} s in which {name} closes, got {got}")
        });
    }

    fn gripper(&mut self, name: &str, folder: Option<&Path>) -> Option<Gripper> {
        let read = |file: &str| {
            let path = folder.unwrap_or(Path::new("")).join(file);
            std::fs::read_to_string(&path).map_err(|e| format!("failed to read the gripper: {e}: {}", path.display()))
        };
        match Gripper::named(name, read) {
            Ok(gripper) => Some(gripper),
            Err(message) => {
                self.0.push(message);
                None
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems(text: &str) -> Vec<String> {
        match Config::from_toml(text, "test.toml", None, Overrides::default()) {
            Err(ConfigError::Invalid { problems, .. }) => problems,
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
        assert_eq!(config.intrinsics, Intrinsics::VGN);
        assert_eq!(config.physics, Physics::STANDARD);
        assert_eq!(config.procedure, Procedure::PAPER);
    }

    #[test]
    fn everything_that_is_wrong_is_told_at_once() {
        let text = PAPER
            .replace("resolution = 40 ", "resolution = 400 ")
            .replace("step_rate_hz = 240.0", "step_rate_hz = \"fast\"")
            .replace("[settle]", "bogus = 1\n[settle]")
            .replace("hold_time_s = 0.25", "")
            .replace("\"half_cylinder\"]", "\"torus\"]");
        let problems = problems(&text);
        for expected in [
            "grid.resolution must be between 8 and 128, got 400",
            "physics.step_rate_hz must be a number, got \"fast\"",
            "objects.bogus is no key of this file",
            "procedure.hold_time_s is missing, a number",
            "objects.shapes must be among cuboid, cylinder, tri_prism, half_cylinder, got torus",
        ] {
            assert!(problems.iter().any(|p| p == expected), "{expected:?} is not among {problems:#?}");
        }
        assert_eq!(problems.len(), 5, "{problems:#?}");
    }

    #[test]
    fn a_hand_that_has_no_time_to_close_is_refused() {
        let problems = problems(&PAPER.replace("close_time_s_max = 1.0", "close_time_s_max = 0.7"));
        let expected =
            "procedure.close_time_s_max must be at least the 0.80 s in which parallel_jaw_80 closes, got 0.7";
        assert_eq!(problems, [expected]);
    }

    #[test]
    fn no_shards_and_more_shards_than_scenes_are_refused() {
        let with_shards = |shards| Overrides { shards: Some(shards), attempts: Some(120), ..Overrides::default() };
        let message = |shards| Config::load(None, with_shards(shards)).unwrap_err().to_string();
        assert!(message(0).contains("shards must be between 1 and 100000, got 0"), "{}", message(0));
        assert!(message(3).contains("shards must be at most the number of scenes, 2"), "{}", message(3));
        assert!(Config::load(None, with_shards(2)).is_ok());
    }
}
