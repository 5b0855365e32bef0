//! A mixture of samplers, for datasets that teach a judge: where grasps come from matters more than how many.
//!
//! By the paper's rules nearly every grasp that is reached holds, so its label is a collision test. Along normals
//! and as proposals grasps are reached of which many fail; and grasps that held, displaced a little, show where holding
//! ends.

use core::f32::consts::FRAC_PI_6;

use grasps::{CandidateSampler, Judge, ObservedScene, ScoredGrasp, Search, Spread};
use schema::{
    Approach, AttemptRecord, Grasp, ObjectRecord, Pose, Purpose, Rule, Stream, Vec3, View, VoxelGrid, axis_angle,
    pose_from_parts,
};
use simulator::{Scene, SceneRays};

use crate::candidates::{Candidate, draw_candidates};
use crate::config::{Config, Sampler, Shares, YAWS};
use crate::normals::draw_along_normals;

/// Maximum displacement of a grasp that held.
const MOVE_M_MAX: f32 = 0.03;
/// Maximum angle by which it is turned.
const TURN_RAD_MAX: f32 = FRAC_PI_6;
/// How far before the tips, along the approach, a proposed grasp closes.
const CLOSING_M: f32 = 0.01;

/// Of what is seen of a bin most is wall: so many times as many candidates are proposed as are wanted …
const SPARES: usize = 4;
/// … and at most this part of the wanted ones, one in so many, close on a wall. Those that a judge chooses may all do:
/// a judge that was kept from the walls that it likes went on taking them, at 0.9 to 0.99.
const ON_WALLS_PART: usize = 2;

/// Number of proposals among which a judge chooses.
const JUDGED_OF: usize = 256;
/// Of grasps whose tips are nearer to each other than this, a judge chooses only the best.
const APART_M: f32 = 0.01;

/// A way of drawing candidates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    Rules,
    Normals,
    Proposals,
    /// Proposals that the policy rates highest.
    Judged,
}

/// How many of a scene's `count` attempts come from which source, in the order in which they are drawn. What remains is
/// displaced, by moves alone or also by turns.
pub(crate) fn sources(config: &Config, count: usize) -> Vec<(Source, usize)> {
    let Shares { rules, normals, proposals, judged, .. } = match config.sampler {
        Sampler::Rules => return vec![(Source::Rules, count)],
        Sampler::Vgn => return vec![(Source::Normals, count)],
        Sampler::Mixed => config.shares,
    };
    let part = |share: f32| (share * count as f32).round() as usize;
    let normals = part(normals) / YAWS * YAWS;
    // Shares are at most 1, so normals fit; the sum of rounded parts may not.
    let rules = part(rules).min(count - normals);
    let left = count - normals - rules;
    let (judged, proposals) = match config.policy {
        None => (0, part(proposals) + part(judged)),
        Some(_) => (part(judged).min(left), part(proposals)),
    };
    vec![
        (Source::Rules, rules),
        (Source::Normals, normals),
        (Source::Proposals, proposals.min(left - judged)),
        (Source::Judged, judged),
    ]
}

/// A scene at rest, its rows, and what its cameras see.
pub(crate) struct Observed<'a> {
    pub(crate) config: &'a Config,
    pub(crate) scene: &'a Scene,
    pub(crate) objects: &'a [ObjectRecord],
    pub(crate) rays: &'a SceneRays,
    pub(crate) views: &'a [View],
    pub(crate) tsdf: &'a VoxelGrid,
}

impl Observed<'_> {
    /// Draws `count` candidates; fewer if so many are not proposed.
    pub(crate) fn draw(&self, source: Source, count: usize, stream: &mut Stream) -> Vec<Candidate> {
        let Self { config, scene, objects, rays, views, tsdf } = self;
        let scene_id = objects[0].scene_id;
        let gripper = config.gripper.of_scene(scene_id);
        let own_stream = |number| Stream::new(config.seed, scene_id, Purpose::Proposals, number);
        match source {
            _ if count == 0 => Vec::new(),
            Source::Rules => draw_candidates(objects, count, config.rule_closing, stream),
            Source::Normals => draw_along_normals(config, scene, objects, rays, views, count, stream),
            Source::Proposals => {
                let sampler = CandidateSampler::new(gripper, config.procedure.pregrasp_distance_m);
                // Among walls most candidates close on those.
                let spares = if scene.fixtures.is_empty() { 1 } else { SPARES };
                let grasps = sampler.sample(tsdf, count * spares, &mut own_stream(0));
                self.candidates(Approach::Proposal, count, grasps.iter().map(|grasp| grasp.workspace_from_grasp))
            }
            Source::Judged => {
                let judge = config.policy.as_ref().and_then(|policy| policy.judge(gripper, &config.grid).ok());
                let seen =
                    ObservedScene { field: tsdf, fine: None, views: views.len(), reach_m: tsdf.lattice.corners_m() };
                let best = judge.map_or_else(Vec::new, |judge| best(&judge, seen, count, &mut own_stream(2)));
                self.candidates(Approach::Judged, count, best.iter().map(|scored| scored.grasp.workspace_from_grasp))
            }
        }
    }

    /// Up to `count` proposed grasps, each of the object that is nearest to where the fingers close. Of proposals some
    /// close on a wall of the container at most.
    fn candidates(&self, approach: Approach, count: usize, grasps: impl Iterator<Item = Pose>) -> Vec<Candidate> {
        let closing_m = |grasp: &Pose| grasp.transform_point(Vec3::new(0.0, 0.0, -CLOSING_M));
        let mut on_walls = 0;
        let will_do = |grasp: &Pose| {
            let is_on_wall = approach == Approach::Proposal && self.scene.is_at_fixture(closing_m(grasp));
            on_walls += usize::from(is_on_wall);
            !is_on_wall || on_walls <= count / ON_WALLS_PART
        };
        let candidate = |workspace_from_grasp: Pose| {
            let closing_m = closing_m(&workspace_from_grasp);
            let object_id = self.scene.nearest(closing_m).unwrap_or(0);
            let rule = Rule { shape: self.objects[object_id].shape.shape(), approach };
            Candidate::undrawn(rule, object_id, workspace_from_grasp)
        };
        grasps.filter(will_do).take(count).map(candidate).collect()
    }
}

/// The best proposals of a scene that are apart from better ones.
fn best(judge: &Judge, seen: ObservedScene<'_>, count: usize, stream: &mut Stream) -> Vec<ScoredGrasp> {
    let mut best: Vec<ScoredGrasp> = Vec::with_capacity(count);
    let all = |grasps: &[Grasp]| vec![true; grasps.len()];
    let search = Search {
        proposals: JUDGED_OF,
        asked: JUDGED_OF,
        spread: Spread::Evenly,
        previous: None,
        apart_m: APART_M,
        about_m: &[],
        are_wanted: &all,
        better: &|_| None,
    };
    let (scored, _) = judge.scored_grasps(seen, &search, stream);
    for scored in scored {
        if best.len() < count && best.iter().all(|better| !better.is_near(&scored, APART_M)) {
            best.push(scored);
        }
    }
    best
}

/// Grasps of a scene that held, in turn, each displaced at random. Where none held, any of it are.
pub(crate) fn displaced(config: &Config, attempts: &[AttemptRecord], count: usize, scene_id: u64) -> Vec<Candidate> {
    if count == 0 {
        return Vec::new();
    }
    let mut stream = Stream::new(config.seed, scene_id, Purpose::Proposals, 1);
    let held: Vec<&AttemptRecord> = attempts.iter().filter(|attempt| attempt.label() == 1).collect();
    let from: Vec<&AttemptRecord> = if held.is_empty() { attempts.iter().collect() } else { held };
    // Of what is missing of the proposals, too, in the ratio of their shares.
    let Shares { displaced, shifted, .. } = config.shares;
    let shifted = (count as f32 * shifted / (displaced + shifted).max(f32::MIN_POSITIVE)).round() as usize;
    (0..count)
        .map(|number| {
            let AttemptRecord { rule, object_id, workspace_from_grasp, .. } = from[number % from.len()];
            let pose = displaced_grasp(workspace_from_grasp, number >= shifted, &mut stream);
            Candidate::undrawn(Rule { approach: Approach::Displaced, ..*rule }, *object_id as usize, pose)
        })
        .collect()
}

/// A grasp that is moved by up to [`MOVE_M_MAX`] and, if `is_turned`, turned by up to [`TURN_RAD_MAX`] about its own
/// origin.
pub(crate) fn displaced_grasp(grasp: &Pose, is_turned: bool, stream: &mut Stream) -> Pose {
    let axis = stream.rotation() * Vec3::Z;
    let turn_rad = stream.uniform(0.0, TURN_RAD_MAX);
    let turn = axis_angle(axis, if is_turned { turn_rad } else { 0.0 });
    let moved_m = stream.rotation() * Vec3::new(0.0, 0.0, stream.uniform(0.0, MOVE_M_MAX));
    pose_from_parts((turn * grasp.rotation).normalize(), grasp.translation + moved_m)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use schema::SceneRows;
    use settings::Document;

    use super::*;
    use crate::build::make_scene;
    use crate::config::Overrides;

    const JUDGE: &str = include_str!("../../configs/generate/judge.toml");

    fn config(text: &str) -> Result<Config, settings::Error> {
        Config::read(Document::parse(text, Path::new("judge.toml")).unwrap(), Overrides::default())
    }

    fn of(rows: &SceneRows, is_it: impl Fn(Approach) -> bool) -> Vec<&AttemptRecord> {
        rows.attempts.iter().filter(|attempt| is_it(attempt.rule.approach)).collect()
    }

    #[test]
    fn a_scenes_attempts_have_their_shares_and_come_again() {
        let config = config(JUDGE).unwrap();
        let rows = make_scene(&config, 5, 60).unwrap();
        assert_eq!(rows, make_scene(&config, 5, 60).unwrap());
        let counts = [
            of(&rows, |approach| approach.axis().is_some()),
            of(&rows, |approach| approach == Approach::Normal),
            of(&rows, |approach| approach == Approach::Proposal),
            of(&rows, |approach| approach == Approach::Displaced),
        ];
        let [rules, normals, proposals, displaced] = counts.map(|attempts| attempts.len());
        // Where fewer candidates are proposed, more are displaced.
        assert_eq!((rules, normals, proposals + displaced), (18, 6, 36));
        assert!((5..=24).contains(&proposals), "{proposals}");
        // The last scene of a dataset may have fewer.
        for count in [1, 7, 23] {
            assert_eq!(make_scene(&config, 5, count).unwrap().attempts.len(), count as usize);
        }
    }

    /// Noise changes what is seen and nothing else; packed scenes have their share and stand upright.
    #[test]
    fn labels_stay_the_truth_whatever_the_cameras_see() {
        let noisy = config(JUDGE).unwrap();
        let clean = Config { sensor: None, ..noisy.clone() };
        let mut packed = 0;
        for scene in 0..12 {
            let [noisy, clean] = [&noisy, &clean].map(|config| make_scene(config, scene, 30).unwrap());
            assert_eq!((&noisy.objects, &noisy.scene.views), (&clean.objects, &clean.scene.views));
            assert_ne!(noisy.scene.tsdf, clean.scene.tsdf, "scene {scene}");
            // The rules do not look at images.
            let by_rules = |rows: &SceneRows| of(rows, |a| a.axis().is_some()).into_iter().cloned().collect::<Vec<_>>();
            assert_eq!(by_rules(&noisy), by_rules(&clean));
            let upright = noisy.objects.iter().all(|object| {
                let extents_m = object.shape.extents_m();
                let up = object.workspace_from_object.rotation.inverse() * Vec3::Z;
                up.abs().max_element() > 0.99 && extents_m.max_element() >= 0.04
            });
            packed += usize::from(upright && noisy.objects.iter().any(|o| o.shape.extents_m().max_element() > 0.1));
        }
        assert!((1..=8).contains(&packed), "{packed}");
    }

    #[test]
    fn a_policys_grasps_hold_more_often_than_proposals_and_name_it() {
        let text = JUDGE.replace("sampler = ", "policy = \"../models/judge.safetensors\"\nsampler = ");
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/judge.toml");
        let config = Config::read(Document::parse(&text, Path::new(path)).unwrap(), Overrides::default()).unwrap();
        let scenes: Vec<SceneRows> = (0..6).map(|scene| make_scene(&config, scene, 60).unwrap()).collect();
        let held = |wanted: Approach| {
            let attempts = scenes.iter().flat_map(|rows| of(rows, |approach| approach == wanted));
            let labels: Vec<u8> = attempts.map(|attempt| attempt.label()).collect();
            assert!(labels.len() > 30, "{wanted:?}: {}", labels.len());
            labels.iter().map(|label| f32::from(*label)).sum::<f32>() / labels.len() as f32
        };
        let [judged, proposed] = [Approach::Judged, Approach::Proposal].map(held);
        assert!(judged > proposed + 0.2, "{judged} {proposed}");
        assert_eq!(scenes[0], make_scene(&config, 0, 60).unwrap());
        // The digest of the weights is a part of the identity.
        let policy = config.dataset_info().config["policy"].as_str().unwrap().to_owned();
        let file = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/judge.safetensors")).unwrap();
        assert_eq!(policy, network::checkpoint::digest(&file));
        let refused = |text: String| {
            Config::read(Document::parse(&text, Path::new(path)).unwrap(), Overrides::default())
                .unwrap_err()
                .to_string()
        };
        let message =
            refused(text.replace("judged = 0.25 ", "judged = 0.0 ").replace("proposals = 0.15 ", "proposals = 0.4 "));
        assert!(message.contains("policy") && message.contains("shares.judged"), "{message}");
        let message = refused(text.replace("models/judge", "models/paper-200k"));
        assert!(message.starts_with("policy") || message.contains("policy: "), "{message}");
    }

    /// The shipped config for networks of voxels: all of its displaced grasps are turned as one that held.
    #[test]
    fn shifted_grasps_are_turned_as_one_that_held() {
        let text = include_str!("../../configs/generate/voxel.toml");
        let config = config(text).unwrap();
        let (mut seen, mut moved) = (0, 0);
        for scene in 0..6 {
            let rows = make_scene(&config, scene, 60).unwrap();
            let from = of(&rows, |approach| approach != Approach::Displaced);
            assert_eq!(from.len(), 36, "by the rules");
            for attempt in of(&rows, |approach| approach == Approach::Displaced) {
                let pose = attempt.workspace_from_grasp;
                let from = from.iter().map(|from| from.workspace_from_grasp);
                let turned_alike = from.filter(|from| from.rotation.dot(pose.rotation).abs() > 1.0 - 1e-6);
                let off_m = turned_alike.map(|from| (from.translation - pose.translation).length());
                let off_m = off_m.fold(f32::INFINITY, f32::min);
                assert!(off_m < MOVE_M_MAX + 1e-5, "{off_m}");
                (seen, moved) = (seen + 1, moved + usize::from(off_m > 0.01));
            }
        }
        assert!(seen == 6 * 24 && moved > seen / 3, "{seen} {moved}");
        // Configs from before the share keep their identity.
        let share = |text| super::tests::config(text).unwrap().dataset_info().config["shares"]["shifted"].clone();
        assert_eq!((share(text), share(JUDGE)), (serde_json::json!(0.4_f32), serde_json::Value::Null));
    }

    #[test]
    fn displaced_grasps_are_near_one_that_held() {
        let config = config(JUDGE).unwrap();
        let mut seen = 0;
        for scene in 0..8 {
            let rows = make_scene(&config, scene, 60).unwrap();
            let held: Vec<&AttemptRecord> =
                of(&rows, |approach| approach != Approach::Displaced).into_iter().filter(|a| a.label() == 1).collect();
            for attempt in of(&rows, |approach| approach == Approach::Displaced) {
                let is_near = |from: &&AttemptRecord| {
                    let (here, there) = (attempt.workspace_from_grasp, from.workspace_from_grasp);
                    let turn_rad = 2.0 * libm::acosf(here.rotation.dot(there.rotation).abs().min(1.0));
                    (here.translation - there.translation).length() < MOVE_M_MAX + 1e-5
                        && turn_rad < TURN_RAD_MAX + 1e-3
                        && from.object_id == attempt.object_id
                };
                assert!(held.is_empty() || held.iter().any(is_near), "scene {scene}, attempt {}", attempt.attempt_id);
                seen += usize::from(!held.is_empty());
            }
        }
        assert!(seen > 36, "{seen}");
    }

    #[test]
    fn proposals_without_anything_to_touch_give_way_to_normals() {
        // For a gripper too wide to stand anywhere nothing is proposed.
        let text = JUDGE
            .replace("rules = 0.3 ", "rules = 0.0 ")
            .replace("normals = 0.15 ", "normals = 0.0 ")
            .replace("proposals = 0.15 ", "proposals = 1.0 ")
            .replace("judged = 0.25 ", "judged = 0.0 ")
            .replace("displaced = 0.15 ", "displaced = 0.0 ");
        let mut config = config(&text).unwrap();
        let mut gripper = config.gripper.all()[0].clone();
        (gripper.palm_breadth_m, gripper.palm_width_m, gripper.palm_length_m) = (0.5, 0.5, 0.5);
        gripper.finger_length_m = 0.005;
        config.gripper = gripper.into();
        let rows = make_scene(&config, 1, 12).unwrap();
        assert_eq!(rows.attempts.len(), 12);
    }

    #[test]
    fn shares_belong_to_the_mixed_sampler_and_make_one() {
        let refused = |text: String| config(&text).unwrap_err().to_string();
        let message = refused(JUDGE.replace("proposals = 0.15 ", "proposals = 0.05 "));
        assert!(message.contains("shares") && message.contains("0.9"), "{message}");
        let message = refused(JUDGE.replace("sampler = \"mixed\"", "sampler = \"rules\""));
        assert!(message.contains("shares") && message.contains("\"rules\""), "{message}");
    }
}
