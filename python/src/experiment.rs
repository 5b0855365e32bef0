//! `graspmill.experiment`: rounds in physics, whose grasps a function of the caller may plan.
//!
//! The rounds run on threads of their own. The function is called by the package's Python half, for one round after the
//! other, while the rounds that wait for it stand still.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Sender, channel};

use experiments::config::Config;
use experiments::offer::{Look, NoPlan, Offer, Plans};
use experiments::record::Round;
use graspmill::experiment::page::{document, play};
use numpy::{PyArray2, PyArrayMethods as _};
use planner::View;
use program::{ExitCode, Failure};
use pyo3::prelude::*;
use schema::{Pose, Vec3};

use crate::fault::{array, free, raised};
use crate::pool::Apart;
use crate::scene::{Seven, Simulation, pose, rows, seven};

/// What the rounds tell: that one waits for grasps, or that all are played.
#[derive(Debug)]
enum Step {
    Asked(Box<Seen>, Sender<Answer>),
    /// With the rates in a few lines.
    Played(String),
}

/// Grasps in the frame of what was seen, the best first, or why there are none.
type Answer = Result<Vec<Offer>, String>;

/// A function of the caller.
#[derive(Debug)]
struct Function {
    id: String,
    tell: Sender<Result<Step, Failure>>,
}

impl Plans for Function {
    fn id(&self) -> String {
        self.id.clone()
    }

    fn plan(&self, mut look: Look<'_>) -> Result<Vec<Offer>, NoPlan> {
        let shown = look.shown();
        let workspace_from_first = look.into_their_frame();
        let workspace_from_theirs = workspace_from_first.unwrap_or(Pose::IDENTITY);
        let (answer, answers) = channel();
        let seen = Seen {
            object_count: look.scene.objects.len(),
            shown,
            workspace_size_m: look.workspace_size_m(),
            down: workspace_from_theirs.rotation.inverse() * Vec3::NEG_Z,
            finds_table: workspace_from_first.is_some(),
            views: look.views,
            failed: look.failed,
        };
        // Nobody answers, or listens, after the run was stopped.
        _ = self.tell.send(Ok(Step::Asked(Box::new(seen), answer)));
        let answer = answers.recv().unwrap_or_else(|_| Err("the run was stopped".to_owned()));
        let mut offers = answer.map_err(NoPlan::NoAnswer)?;
        for offer in &mut offers {
            offer.workspace_from_grasp = workspace_from_theirs * offer.workspace_from_grasp;
        }
        Ok(offers)
    }
}

/// What a function is shown.
#[pyclass(frozen, module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Seen {
    views: Vec<View>,
    /// Of each view the object that each pixel shows.
    shown: Vec<Vec<Option<usize>>>,
    /// Objects of the scene.
    #[pyo3(get)]
    object_count: usize,
    failed: Vec<Pose>,
    down: Vec3,
    /// Whether poses are in the first camera's frame, which has no pose.
    #[pyo3(get)]
    finds_table: bool,
    #[pyo3(get)]
    workspace_size_m: Option<f32>,
}

#[pymethods]
impl Seen {
    /// The views' depth images in metres, `[height, width]`.
    fn depths<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
        let image = |view: &View| {
            let shape = [view.image.height_px, view.image.width_px];
            array(py, view.image.depth_m.clone())?.reshape(shape)
        };
        self.views.iter().map(image).collect()
    }

    /// Which object each pixel shows, `[height, width]`, -1 for none.
    fn objects<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<i32>>>> {
        let image = |(view, shown): (&View, &Vec<Option<usize>>)| {
            let shape = [view.image.height_px, view.image.width_px];
            array(py, shown.iter().map(|object| object.map_or(-1, |object| object as i32)).collect())?.reshape(shape)
        };
        self.views.iter().zip(&self.shown).map(image).collect()
    }

    /// Of each camera the six numbers of its lens, and its pose.
    fn cameras(&self) -> Vec<([f32; 6], Seven)> {
        let camera = |View { camera, .. }: &View| {
            let lens = camera.intrinsics;
            let size_px = [lens.width_px as f32, lens.height_px as f32];
            (
                [size_px[0], size_px[1], lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px],
                seven(&camera.workspace_from_camera),
            )
        };
        self.views.iter().map(camera).collect()
    }

    /// Grasps that failed, `[N, 7]`.
    fn failed<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        rows(py, self.failed.iter().copied())
    }

    /// Where gravity points.
    #[getter]
    fn down(&self) -> [f32; 3] {
        self.down.to_array()
    }
}

/// An experiment whose rounds are being played.
#[pyclass(module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Experiment {
    /// Dropped before the answer: it shall stop before the round that waits hears that nobody answers.
    work: Apart<Step>,
    config: Arc<Config>,
    /// Of the round that waits.
    answer: Option<Sender<Answer>>,
    /// The rates in a few lines, once all rounds are played.
    #[pyo3(get)]
    in_short: Option<String>,
}

#[pymethods]
impl Experiment {
    /// Begins it. Our planner plans, or a function whose results have this id and which is called so; `command` is what
    /// the report names.
    #[new]
    fn new(
        out: PathBuf,
        config: Option<PathBuf>,
        set: Vec<(String, String)>,
        planner: Option<(String, String)>,
        command: String,
        threads: usize,
    ) -> PyResult<Self> {
        let mut config = Config::read(config.as_deref(), &set).map_err(|error| raised(&error.into()))?;
        if let Some((_, who)) = &planner {
            config.tell_planner(who);
        }
        let config = Arc::new(config);
        let asked = Arc::clone(&config);
        let work = Apart::start(1, move |tell, counts| {
            let planner: Box<dyn Plans> = match planner {
                Some((id, _)) => Box::new(Function { id, tell: tell.clone() }),
                None => Box::new(asked.planner()?),
            };
            let on_round = |round: &Round| counts.add(1, round.removed_count.into());
            let played = play(&asked, &*planner, command, threads, &out, &counts.stop, &on_round)?;
            let stopped = || Failure::new(ExitCode::TryAgain, "the experiment was stopped");
            played.map(Step::Played).ok_or_else(stopped)
        })?;
        Ok(Self { work, config, answer: None, in_short: None })
    }

    /// The gripper that executes.
    fn gripper(&self) -> Simulation {
        let generator::Config { physics, procedure, settle, grid, .. } = &self.config.scene;
        Simulation {
            gripper: self.config.plan.gripper.clone(),
            physics: *physics,
            procedure: *procedure,
            settle: *settle,
            grid: *grid,
        }
    }

    /// Rounds that are there, all rounds, and grasps that held.
    #[getter]
    fn counts(&self) -> (u64, u64, u64) {
        let [rounds, held] = self.work.counts.told();
        (rounds, self.config.round_count(), held)
    }

    /// What a round shows its planner, if one asks within a moment.
    fn soon(&mut self, py: Python<'_>) -> PyResult<Option<Seen>> {
        match self.work.soon(py)? {
            Some(Step::Asked(seen, answer)) => {
                self.answer = Some(answer);
                Ok(Some(*seen))
            }
            Some(Step::Played(in_short)) => {
                self.in_short = Some(in_short);
                Ok(None)
            }
            None => Ok(None),
        }
    }

    /// Grasps for the round that asked, the best first: poses, scores, and where they are known widths and ρ in metres.
    fn answer(&mut self, grasps: Vec<(Seven, f32, Option<f32>, Option<f32>)>) {
        let opening_m = self.config.plan.gripper.opening_m_max; // where no width is known
        let offer = |(at, quality, width_m, rho_m): (Seven, f32, Option<f32>, Option<f32>)| Offer {
            workspace_from_grasp: pose(at),
            width_m: width_m.unwrap_or(opening_m),
            quality,
            rho_m,
        };
        self.tell(Ok(grasps.into_iter().map(offer).collect()));
    }

    /// There are no grasps for the round that asked: why.
    fn fail(&mut self, why: String) {
        self.tell(Err(why));
    }

    /// Stops it, and waits until what is done is kept.
    fn stop(&mut self, py: Python<'_>) {
        self.work.counts.stop.store(true, Ordering::Relaxed); // as when it is dropped
        self.answer = None;
        self.work.stop(py);
    }
}

impl Experiment {
    fn tell(&mut self, answer: Answer) {
        // A round that has failed otherwise does not listen.
        _ = self.answer.take().map(|asked| asked.send(answer));
    }
}

/// The page of an experiment that is done.
#[pyfunction]
pub(crate) fn experiment_page(py: Python<'_>, folder: PathBuf) -> PyResult<String> {
    free(py, || Ok::<_, Failure>(document(&[folder])?.html()))
}
