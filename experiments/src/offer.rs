//! Who plans the rounds: our planner in this process, or anyone's.

use planner::input::InputError;
use planner::{FindTable, Observation, PlanOptions, Planner, View};
use schema::{Grid, Pose, Vec3};
use simulator::{Scene, SceneRays};

use crate::config::{Config, Frames};

/// What a planner is asked.
#[derive(Debug)]
pub struct Look<'a> {
    /// The experiment.
    pub config: &'a Config,
    /// The truth, of which planners of single objects are told which pixels show which object.
    pub scene: &'a Scene,
    /// The images, with the cameras' poses in the workspace.
    pub views: Vec<View>,
    /// Grasps that failed, in the workspace; none like them is wanted.
    pub failed: Vec<Pose>,
}

impl Look<'_> {
    /// Puts cameras and failed grasps into the frame that the planner knows. That frame in the workspace, if it is the
    /// first camera's.
    pub fn into_their_frame(&mut self) -> Option<Pose> {
        let first = self.views.first().filter(|_| self.config.keys.frames == Frames::Found)?;
        let workspace_from_first = first.camera.workspace_from_camera;
        let in_first = |pose: &mut Pose| *pose = workspace_from_first.inverse() * *pose;
        self.views.iter_mut().for_each(|view| in_first(&mut view.camera.workspace_from_camera));
        self.failed.iter_mut().for_each(in_first);
        Some(workspace_from_first)
    }

    /// The side of the workspace that a planner with the scene's poses is told, in metres, if it is not the paper's.
    #[must_use]
    pub fn workspace_size_m(&self) -> Option<f32> {
        let grid = self.config.scene.grid;
        let is_other = grid.resolution != Grid::PAPER.resolution && self.config.keys.frames == Frames::Given;
        is_other.then_some(grid.size_m)
    }

    /// What our planner is asked, and the frame that it knows in the workspace, if it is the first camera's.
    #[must_use]
    pub fn as_ours(mut self) -> (Observation, PlanOptions, Option<Pose>) {
        // Where the table is to be found, the planner knows nothing but the first camera's frame.
        let workspace_from_first = self.into_their_frame();
        let options = PlanOptions {
            workspace_size_m: self.workspace_size_m(),
            find_table: workspace_from_first.map(|_| FindTable::default()),
            avoid: self.failed,
            ..PlanOptions::default()
        };
        (Observation::Views(self.views), options, workspace_from_first)
    }

    /// The object that each pixel of each view shows in truth, by its place in the scene.
    #[must_use]
    pub fn shown(&self) -> Vec<Vec<Option<usize>>> {
        let alone = |objects| Scene { objects, fixtures: Vec::new(), ..self.scene.clone() };
        let (all, table) = (SceneRays::new(self.scene), SceneRays::new(&alone(Vec::new())));
        let each: Vec<SceneRays> =
            self.scene.objects.iter().map(|object| SceneRays::new(&alone(vec![object.clone()]))).collect();
        let of_view = |view: &View| {
            let depth_m = |rays: &SceneRays| rays.render(&view.camera).depth_m;
            let (truth_m, bare_m) = (depth_m(&all), depth_m(&table));
            let each_m: Vec<Vec<f32>> = each.iter().map(depth_m).collect();
            let of_pixel = |pixel: usize| {
                // What hides the table there.
                let is_shown = |own_m: &Vec<f32>| own_m[pixel] == truth_m[pixel] && own_m[pixel] != bare_m[pixel];
                each_m.iter().position(is_shown)
            };
            (0..truth_m.len()).map(of_pixel).collect()
        };
        self.views.iter().map(of_view).collect()
    }
}

/// A grasp that a planner offers.
#[derive(Debug, Clone, PartialEq)]
pub struct Offer {
    /// The grasp, as this project has its axes, in the workspace.
    pub workspace_from_grasp: Pose,
    /// How wide the gripper is when it holds, or how far it opens, in metres.
    pub width_m: f32,
    /// How sure the planner is.
    pub quality: f32,
    /// Eq. 8's ρ in metres, if there is one.
    pub rho_m: Option<f32>,
}

/// Largest distance from the workspace's origin along an axis, in metres, that physics takes.
const FAR_M_MAX: f32 = 1e3;

impl Offer {
    /// Whether its pose is one that physics takes, and its numbers are some that the journal can hold.
    fn is_sound(&self) -> bool {
        let Pose { rotation, translation, .. } = self.workspace_from_grasp;
        let numbers = [self.width_m, self.quality, self.rho_m.unwrap_or_default()];
        // False for NaN.
        let is_pose =
            (rotation.length_squared() - 1.0).abs() < 1e-2 && translation.abs().cmple(Vec3::splat(FAR_M_MAX)).all();
        is_pose && numbers.iter().all(|number| number.is_finite())
    }
}

/// The offers of a planner, in the workspace, if all of them can be executed and written down.
pub(crate) fn sound(offers: Vec<Offer>) -> Result<Vec<Offer>, NoPlan> {
    let Some(odd) = offers.iter().find(|offer| !offer.is_sound()) else { return Ok(offers) };
    let Offer { workspace_from_grasp: Pose { rotation, translation, .. }, width_m, quality, rho_m } = odd;
    Err(NoPlan::NoAnswer(format!(
        "a grasp must be a rotation, a place within {FAR_M_MAX} m and finite numbers, got {rotation} at {translation}, \
         width {width_m}, quality {quality}, rho {rho_m:?}"
    )))
}

/// Why a planner gave no plan.
#[derive(Debug)]
pub enum NoPlan {
    /// Our planner refuses what the experiment shows it: the experiment is wrong.
    Refused(InputError),
    /// A planner elsewhere failed, said nothing in time, or answered nonsense: the round is over.
    NoAnswer(String),
}

/// A planner.
pub trait Plans: Sync {
    /// What tells its results from those of another.
    fn id(&self) -> String;

    /// Its grasps, the best first.
    ///
    /// # Errors
    /// [`NoPlan`].
    fn plan(&self, look: Look<'_>) -> Result<Vec<Offer>, NoPlan>;
}

impl Plans for Planner {
    fn id(&self) -> String {
        self.model_id.clone()
    }

    fn plan(&self, look: Look<'_>) -> Result<Vec<Offer>, NoPlan> {
        let (observation, options, workspace_from_first) = look.as_ours();
        let plan = Self::plan(self, &observation, &options).map_err(NoPlan::Refused)?;
        let offer = |grasp: &planner::plan::RankedGrasp| Offer {
            workspace_from_grasp: workspace_from_first
                .zip(grasp.camera_from_grasp)
                .map_or(grasp.workspace_from_grasp, |(first, grasp)| first * grasp),
            width_m: grasp.width_m.unwrap_or(grasp.opening_m),
            quality: grasp.quality,
            rho_m: grasp.rho_m,
        };
        Ok(plan.grasps.iter().map(offer).collect())
    }
}

#[cfg(test)]
mod tests {
    use schema::Quat;

    use super::*;

    #[test]
    fn what_physics_or_the_journal_cannot_hold_is_no_answer() {
        let offer = |at_m: Vec3, rotation: Quat, quality: f32| Offer {
            workspace_from_grasp: Pose::from_parts(at_m, rotation),
            width_m: 0.04,
            quality,
            rho_m: None,
        };
        let good = offer(Vec3::new(0.1, 0.2, 1e3), Quat::IDENTITY, -3e38);
        assert_eq!(sound(vec![good.clone()]).unwrap(), std::slice::from_ref(&good));
        for odd in [
            offer(Vec3::splat(3e38), Quat::IDENTITY, 0.5),
            offer(Vec3::new(0.0, f32::INFINITY, 0.0), Quat::IDENTITY, 0.5),
            offer(Vec3::new(0.0, 0.0, f32::NAN), Quat::IDENTITY, 0.5),
            offer(Vec3::ZERO, Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), 0.5),
            offer(Vec3::ZERO, Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0), 0.5),
            offer(Vec3::ZERO, Quat::IDENTITY, f32::INFINITY),
            Offer { width_m: f32::NAN, ..good.clone() },
            Offer { rho_m: Some(f32::INFINITY), ..good.clone() },
        ] {
            let told = sound(vec![good.clone(), odd.clone()]);
            assert!(matches!(&told, Err(NoPlan::NoAnswer(why)) if why.contains("within 1000 m")), "{odd:?}: {told:?}");
        }
    }
}
