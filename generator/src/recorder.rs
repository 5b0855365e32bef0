//! Records an attempt for display: poses at up to sixty frames per second, and events.

use schema::{Event, EventKind, Gripper, HitKind, Outcome, Physics, Pose, Procedure, Vec3};
use simulator::{AttemptEvent, Execution, Moment, Obstruction, Phase, Watcher};

/// Frames a second.
const FRAME_RATE_HZ: f32 = 60.0;
/// Displayed duration of the approach; the gate itself simulates no time.
const APPROACH_TIME_S: f32 = 0.6;

/// Names of the boxes of the gripper.
pub const BOX_NAMES: [&str; 5] =
    ["left finger", "right finger", "palm", "left finger behind its tip", "right finger behind its tip"];

/// What happened in an attempt, for whoever shows it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// All poses, frame by frame.
    pub frames: Vec<Frame>,
    /// What happened, in order.
    pub events: Vec<Event>,
}

/// All poses at a time.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Seconds since the first frame.
    pub time_s: f32,
    /// Of the objects.
    pub objects: Vec<Pose>,
    /// Of the boxes of the open gripper.
    pub gripper: [Pose; 3],
}

/// A recording of an attempt.
pub(crate) struct Recorder<'a> {
    gripper: &'a Gripper,
    pregrasp_distance_m: f32,
    step_rate_hz: f32,
    workspace_from_grasp: Pose,
    /// The scene at rest.
    at_rest: Vec<Pose>,
    pub(crate) recording: Recording,
    phase: Option<Phase>,
    /// Time at which the open gripper was at the grasp, and the step of the last frame since then.
    grasp_time_s: f32,
    shot_steps: Option<usize>,
    /// The last step that was seen.
    steps: usize,
}

impl<'a> Recorder<'a> {
    /// Of a grasp.
    pub(crate) fn new(
        gripper: &'a Gripper,
        procedure: &Procedure,
        physics: &Physics,
        workspace_from_grasp: Pose,
        at_rest: Vec<Pose>,
    ) -> Self {
        Self {
            gripper,
            pregrasp_distance_m: procedure.pregrasp_distance_m,
            step_rate_hz: physics.step_rate_hz,
            workspace_from_grasp,
            at_rest,
            recording: Recording::default(),
            phase: None,
            grasp_time_s: 0.0,
            shot_steps: None,
            steps: 0,
        }
    }

    /// Adds frames of the open gripper moving from the pre-grasp to the grasp or what stops it.
    pub(crate) fn approach(&mut self, obstruction: Option<&Obstruction>) {
        let distance_m = self.pregrasp_distance_m;
        let travel_m = obstruction.map_or(distance_m, |obstruction| obstruction.travel_m);
        self.happens(EventKind::Phase, "approach");
        self.happens(
            EventKind::Note,
            "the gate is geometric and simulates no time: the speed of the approach is for display only",
        );
        let time_s = APPROACH_TIME_S * (travel_m / distance_m).clamp(0.0, 1.0);
        let count = (time_s * FRAME_RATE_HZ).ceil() as usize;
        for frame in 0..=count {
            let gone_m = if count == 0 { travel_m } else { travel_m * frame as f32 / count as f32 };
            let pose = self.workspace_from_grasp * Pose::from_translation(Vec3::Z * (gone_m - distance_m));
            self.still(frame as f32 / FRAME_RATE_HZ, [pose; 3]);
        }
        self.grasp_time_s = self.recording.frames.last().map_or(0.0, |frame| frame.time_s);
        if let Some(obstruction) = obstruction {
            self.happens(EventKind::Note, describe_obstruction(obstruction));
        }
    }

    /// Adds frames of free fingers closing for some steps, which are not simulated.
    fn close_freely(&mut self, steps: usize) {
        let stride = self.stride();
        for step in (stride..=steps).step_by(stride) {
            let closed_m = self.gripper.closing_speed_m_s / self.step_rate_hz * step as f32;
            let moved = |inward: f32| self.workspace_from_grasp * Pose::from_translation(Vec3::Y * (inward * closed_m));
            let boxes = [moved(1.0), moved(-1.0), self.workspace_from_grasp];
            self.still(self.grasp_time_s + step as f32 / self.step_rate_hz, boxes);
        }
    }

    fn stride(&self) -> usize {
        ((self.step_rate_hz / FRAME_RATE_HZ).ceil() as usize).max(1)
    }

    fn still(&mut self, time_s: f32, gripper: [Pose; 3]) {
        self.recording.frames.push(Frame { time_s, objects: self.at_rest.clone(), gripper });
    }

    /// Adds a frame, unless the last frame was of the same step.
    fn shoot(&mut self, moment: &Moment<'_>) {
        if self.shot_steps == Some(moment.steps) {
            return;
        }
        self.shot_steps = Some(moment.steps);
        let time_s = self.grasp_time_s + moment.steps as f32 / self.step_rate_hz;
        self.recording.frames.push(Frame { time_s, objects: moment.objects(), gripper: moment.gripper() });
    }

    /// Adds an event at the time of the last frame, or before the first.
    pub(crate) fn happens(&mut self, kind: EventKind, text: impl Into<String>) {
        let frame = self.recording.frames.len().saturating_sub(1);
        self.recording.events.push(Event { frame, kind, text: text.into() });
    }

    /// Begins one of the loads that a grip has to bear, and gives the steps that were before it.
    pub(crate) fn bears(&mut self, what: String) -> usize {
        self.phase = Some(Phase::Bear);
        self.happens(EventKind::Phase, what);
        self.steps
    }

    fn begin(&mut self, phase: Phase) {
        if self.phase.replace(phase) == Some(phase) {
            return;
        }
        self.happens(
            EventKind::Phase,
            match phase {
                Phase::Close => "close",
                Phase::Retreat => "retreat",
                Phase::Hold => "hold",
                Phase::Bear => "bear",
                Phase::After => "after the decision: for display only",
            },
        );
    }
}

impl Watcher for Recorder<'_> {
    fn step(&mut self, moment: &Moment<'_>) {
        self.begin(moment.phase);
        self.steps = moment.steps;
        if moment.steps.is_multiple_of(self.stride()) {
            self.shoot(moment);
        }
    }

    fn event(&mut self, event: AttemptEvent, moment: Option<&Moment<'_>>) {
        if let Some(moment) = moment {
            self.shoot(moment);
        }
        match event {
            AttemptEvent::ClosedFreely { steps } if steps > 0 => {
                self.begin(Phase::Close);
                self.happens(EventKind::Note, describe_event(&event));
                self.close_freely(steps);
            }
            AttemptEvent::ClosedFreely { .. } => {}
            AttemptEvent::Decided(execution) => {
                let kind = if execution.outcome == Outcome::Held { EventKind::Held } else { EventKind::Failed };
                self.happens(kind, describe_end(&execution));
            }
            _ => self.happens(EventKind::Note, describe_event(&event)),
        }
    }
}

fn describe_obstruction(obstruction: &Obstruction) -> String {
    let what = match (obstruction.hit.object_id, obstruction.hit.kind) {
        (Some(id), _) => format!("object {id}"),
        (None, HitKind::Container) => "the container".to_owned(),
        (None, _) => "the table".to_owned(),
    };
    if obstruction.outcome == Outcome::PregraspCollision {
        format!("the gripper is within its clearance of {what} already before the approach")
    } else {
        format!("the gripper comes within its clearance of {what} after {} of the approach", mm(obstruction.travel_m))
    }
}

fn mm(metres: f32) -> String {
    format!("{:.1} mm", metres * 1000.0)
}

/// An event as text.
fn describe_event(event: &AttemptEvent) -> String {
    match event {
        AttemptEvent::ClosedFreely { steps } => {
            format!("nothing is near the fingers for {steps} steps: these steps are not simulated")
        }
        AttemptEvent::FingersStopped { width_m } => format!("both fingers have stopped, {} apart", mm(*width_m)),
        AttemptEvent::ClosingTimeOver { width_m } => {
            format!("the time limit of closing is reached at {}", mm(*width_m))
        }
        AttemptEvent::JawsMet { width_m } => format!("the jaws have met at {}", mm(*width_m)),
        AttemptEvent::Pushed { object_id, moved_m } => {
            format!("object {object_id} was moved by {}, more than the limit", mm(*moved_m))
        }
        AttemptEvent::NearContainer => "the gripper came too close to the container".to_owned(),
        AttemptEvent::NearTable => "a finger ended too close to the table".to_owned(),
        AttemptEvent::RidesAlong { rest_m } => format!(
            "the target moves with the gripper, everything else rests and the way is free: the lift ends {} early",
            mm(*rest_m)
        ),
        AttemptEvent::LeftBehind { travel_m, travel_m_min } => {
            format!("the target moved {} with the gripper; at least {} are required", mm(*travel_m), mm(*travel_m_min))
        }
        AttemptEvent::NotGripped => "the target moved with the gripper, but not both fingers press on it".to_owned(),
        AttemptEvent::Gripped { travel_m } => {
            format!("the target moved {} with the gripper, and both fingers press on it", mm(*travel_m))
        }
        AttemptEvent::Decided(execution) => describe_end(execution),
    }
}

/// The end of an attempt as text.
#[must_use]
pub fn describe_end(execution: &Execution) -> String {
    let hit = execution.hit.map(|hit| (hit.kind, hit.object_id.map(|id| id as u32)));
    describe_outcome(execution.outcome, hit, execution.width_m)
}

/// An outcome with what was hit and the opening, as text.
#[must_use]
pub fn describe_outcome(outcome: Outcome, hit: Option<(HitKind, Option<u32>)>, width_m: Option<f32>) -> String {
    let hit = match hit {
        None => String::new(),
        Some((HitKind::Other, Some(id))) => format!(" with object {id}"),
        Some((kind, _)) => format!(" with the {}", kind.name()),
    };
    let width = width_m.map_or(String::new(), |width_m| format!(", {}", mm(width_m)));
    format!("{}{hit}{width}", outcome.name())
}
