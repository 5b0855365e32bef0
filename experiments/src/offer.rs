//! Who plans the rounds: our planner in this process, or anyone's.

use planner::input::InputError;
use planner::{FindTable, Observation, PlanOptions, Planner, View};
use schema::{Grid, Pose};
use simulator::Scene;

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
    /// Hands that failed, in the workspace; none like them is wanted.
    pub failed: &'a [Pose],
}

impl Look<'_> {
    /// The first camera in the workspace, if the planner knows nothing but its frame.
    #[must_use]
    pub fn workspace_from_first(&self) -> Option<Pose> {
        match self.config.keys.frames {
            Frames::Given => None,
            Frames::Found => self.views.first().map(|view| view.camera.workspace_from_camera),
        }
    }
}

/// A grasp that a planner offers.
#[derive(Debug, Clone, PartialEq)]
pub struct Offer {
    /// The grasp, as this project has its axes, in the workspace.
    pub workspace_from_grasp: Pose,
    /// How wide the hand is when it holds, or how far it opens, in metres.
    pub width_m: f32,
    /// How sure the planner is.
    pub quality: f32,
    /// Eq. 8's ρ in metres, if there is one.
    pub rho_m: Option<f32>,
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

    fn plan(&self, mut look: Look<'_>) -> Result<Vec<Offer>, NoPlan> {
        let grid = look.config.scene.grid;
        let mut options = PlanOptions {
            workspace_size_m: (grid.resolution != Grid::PAPER.resolution).then_some(grid.size_m),
            avoid: look.failed.to_vec(),
            ..PlanOptions::default()
        };
        // Where the table is to be found, the planner knows nothing but the first camera's frame.
        let workspace_from_first = look.workspace_from_first();
        if let Some(workspace_from_first) = workspace_from_first {
            let in_first = |pose: &mut Pose| *pose = workspace_from_first.inverse() * *pose;
            look.views.iter_mut().for_each(|view| in_first(&mut view.camera.workspace_from_camera));
            options.avoid.iter_mut().for_each(in_first);
            (options.find_table, options.workspace_size_m) = (Some(FindTable::default()), None);
        }
        let plan = Self::plan(self, &Observation::Views(look.views), &options).map_err(NoPlan::Refused)?;
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
