//! How much a grasp that held depends on what nobody sees: it is repeated with heavier objects, with less friction, and
//! a little beside, as a camera's calibration leaves it.
//!
//! The label stays that of the attempt itself. What the repeats say is a second answer, so neither is a compromise.

use schema::{AttemptRecord, Gripper, Physics, Pose, Procedure, Purpose, Stream, Vec3, axis_angle, pose_from_parts};
use serde::Serialize;
use settings::{Reader, settings};
use simulator::{AttemptWorld, Scene};

settings! {
    /// Repeats of attempts that held: one for each pair of the factors, each moved anew.
    #[derive(Debug, Clone, PartialEq, Serialize)]
    pub struct RobustnessParams {
        /// Share of the scenes whose held attempts are repeated.
        pub share: f32 where 0.0..=1.0,
        /// By these the masses of the scene's objects are multiplied …
        pub density_factors: Vec<f32> where 0.05..=20.0,
        /// … and by these their friction coefficients.
        pub friction_factors: Vec<f32> where 0.05..=20.0,
        /// Standard deviation of the grasp's displacement along each axis.
        pub position_error_m: f32 where 0.0..=0.05,
        /// Standard deviation of its rotation about each axis.
        pub rotation_error_rad: f32 where 0.0..=0.5,
    }
    check RobustnessParams::has_repeats
}

impl RobustnessParams {
    fn has_repeats(&self, reader: &mut Reader<'_>) {
        for (key, factors) in [("density_factors", &self.density_factors), ("friction_factors", &self.friction_factors)]
        {
            reader.must(key, !factors.is_empty(), || "must have at least one factor, got none");
        }
    }
}

/// A scene's worlds, made ready to repeat its attempts.
pub(crate) struct Repeats<'a> {
    params: &'a RobustnessParams,
    seed: u64,
    scene_id: u64,
    worlds: Vec<AttemptWorld<'a>>,
}

impl<'a> Repeats<'a> {
    /// The repeats of a scene of a dataset, if it is one of those whose attempts are repeated.
    pub(crate) fn of_scene(
        params: Option<&'a RobustnessParams>,
        seed: u64,
        scene_id: u64,
        physics: &'a Physics,
        gripper: &'a Gripper,
        procedure: &'a Procedure,
        scene: &Scene,
    ) -> Option<Self> {
        let params = params?;
        let is_repeated = Stream::new(seed, scene_id, Purpose::Robustness, 0).uniform(0.0, 1.0) < params.share;
        let pairs = params
            .density_factors
            .iter()
            .flat_map(|density| params.friction_factors.iter().map(move |friction| (density, friction)));
        let world = |(density, friction): (&f32, &f32)| {
            let mut scene = scene.clone();
            for object in &mut scene.objects {
                object.mass_kg *= density;
                object.friction *= friction;
            }
            AttemptWorld::new(physics, gripper, procedure, &scene)
        };
        is_repeated.then(|| Self { params, seed, scene_id, worlds: pairs.map(world).collect() })
    }

    /// The share of an attempt's repeats that hold; none if the attempt did not.
    pub(crate) fn robustness(&self, attempt: &AttemptRecord) -> Option<f32> {
        if attempt.label() == 0 {
            return None;
        }
        let mut stream = Stream::new(self.seed, self.scene_id, Purpose::Robustness, 1 + attempt.attempt_id);
        let target = attempt.object_id as usize;
        let held = self.worlds.iter().filter(|world| {
            let RobustnessParams { position_error_m, rotation_error_rad, .. } = *self.params;
            let moved =
                moved_by_errors(&attempt.workspace_from_grasp, position_error_m, rotation_error_rad, &mut stream);
            world.execute(&moved, target).outcome.label() == 1
        });
        Some(held.count() as f32 / self.worlds.len() as f32)
    }
}

/// A grasp that is not reached exactly: normal errors of these standard deviations along and about each axis.
pub(crate) fn moved_by_errors(
    grasp: &Pose,
    position_error_m: f32,
    rotation_error_rad: f32,
    stream: &mut Stream,
) -> Pose {
    let mut draw = |deviation: f32| Vec3::from_array([(); 3].map(|()| stream.normal(0.0, deviation)));
    let (moved_m, turned) = (draw(position_error_m), draw(rotation_error_rad));
    let turn = turned.try_normalize().map_or(schema::Quat::IDENTITY, |axis| axis_angle(axis, turned.length()));
    pose_from_parts((turn * grasp.rotation).normalize(), grasp.translation + moved_m)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use settings::Document;

    use super::*;
    use crate::{Config, Overrides, make_scene};

    const JUDGE: &str = include_str!("../../configs/generate/judge.toml");

    /// Attempts of some scenes with the repeats that these settings ask for.
    fn attempts(set: &[(&str, &str)]) -> Vec<AttemptRecord> {
        let set: Vec<_> = set.iter().map(|(key, value)| (format!("robustness.{key}"), (*value).to_owned())).collect();
        let document = Document::parse(JUDGE, Path::new("judge.toml")).unwrap();
        let config = Config::read(document, Overrides { set: &set, ..Overrides::default() }).unwrap();
        (0..8).flat_map(|scene_id| make_scene(&config, scene_id, 40).unwrap().attempts).collect()
    }

    const ALIKE: [(&str, &str); 5] = [
        ("share", "1.0"),
        ("density_factors", "[1.0]"),
        ("friction_factors", "[1.0]"),
        ("position_error_m", "0.0"),
        ("rotation_error_rad", "0.0"),
    ];

    #[test]
    fn repeats_that_change_nothing_all_hold() {
        let found = attempts(&ALIKE);
        let held = found.iter().filter(|attempt| attempt.label() == 1).count();
        assert!(held > 30, "{held}");
        for attempt in &found {
            assert_eq!(attempt.robustness, (attempt.label() == 1).then_some(1.0), "{attempt:?}");
        }
    }

    /// The labels are those without repeats; heavier, smoother and moved things are held less often.
    #[test]
    fn what_is_harder_holds_less_often_and_changes_no_label() {
        let mean = |set: &[(&str, &str)]| {
            let found = attempts(&[&ALIKE[..], set].concat());
            let shares: Vec<f32> = found.iter().filter_map(|attempt| attempt.robustness).collect();
            (shares.iter().sum::<f32>() / shares.len() as f32, found)
        };
        let (plain, all) = mean(&[]);
        let harder = [
            [("density_factors", "[20.0]")],
            [("friction_factors", "[0.2]")],
            [("position_error_m", "0.01")],
            [("rotation_error_rad", "0.3")],
        ];
        for set in harder {
            let (share, found) = mean(&set);
            assert!(share < plain - 0.05, "{set:?}: {share}");
            let labels = |found: &[AttemptRecord]| {
                let label = |attempt: &AttemptRecord| (attempt.outcome, attempt.width_m, attempt.workspace_from_grasp);
                found.iter().map(label).collect::<Vec<_>>()
            };
            assert_eq!(labels(&found), labels(&all));
        }
        assert!(attempts(&[("share", "0.0")]).iter().all(|attempt| attempt.robustness.is_none()));
    }

    #[test]
    fn a_list_without_factors_is_refused() {
        let set = [("robustness.density_factors".to_owned(), "[]".to_owned())];
        let document = Document::parse(JUDGE, Path::new("judge.toml")).unwrap();
        let refused = Config::read(document, Overrides { set: &set, ..Overrides::default() }).unwrap_err().to_string();
        assert!(refused.contains("robustness.density_factors must have at least one factor"), "{refused}");
    }
}
