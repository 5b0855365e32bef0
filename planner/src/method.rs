//! What the two ways of finding grasps have in common: candidates, and the stages that they passed.

use std::fmt::Debug;

use grasps::ObservedScene;
use schema::Pose;

use crate::config::Config;
use crate::doubt::Doubts;
use crate::gripper_volume::are_alike;
use crate::limits::Limiter;
use crate::observation::{Limits, PlanOptions};
use crate::plan::{DroppedCandidate, RankedGrasp, RejectReason};
use crate::timing::Timings;
use crate::volume::Workspace;
use crate::width::Widths;

/// A network with its way of finding grasps: [`crate::voxel`] or [`crate::judge`].
pub(crate) trait Method: Debug + Send + Sync {
    /// Where it looks for grasps.
    fn workspace(&self, config: &Config, options: &PlanOptions) -> Workspace;

    /// Candidates in what was seen. `scene` is a number that distinguishes scenes.
    fn candidates(
        &self,
        seen: ObservedScene<'_>,
        scene: u64,
        request: &Request<'_>,
        timings_ms: &mut Timings,
    ) -> Candidates;

    /// Ends with the stage of those that are left.
    fn settle(&self, candidates: &mut Candidates, request: &Request<'_>);
}

/// What was asked for.
#[derive(Clone, Copy)]
pub(crate) struct Request<'a> {
    pub(crate) config: &'a Config,
    pub(crate) options: &'a PlanOptions,
    pub(crate) limiter: &'a Limiter<'a>,
    pub(crate) widths: &'a Widths<'a>,
    pub(crate) doubts: &'a Doubts,
}

impl Request<'_> {
    /// Whether a grasp is like one that failed.
    pub(crate) fn is_avoided(&self, workspace_from_grasp: &Pose) -> bool {
        self.options.avoid.iter().any(|failed| are_alike(failed, workspace_from_grasp))
    }

    /// What the limits refused, to be said after another reason.
    fn beyond_limits(&self, before: &str, after: &str) -> String {
        self.limiter.rejections().map(|counts| format!("{before}{counts}{after}")).unwrap_or_default()
    }

    /// Why nothing was proposed.
    pub(crate) fn none_proposed(&self) -> String {
        let counts = self.beyond_limits("no grasp candidate keeps the limits that were asked for: ", "");
        if counts.is_empty() {
            "no collision-free grasp candidate was found on the observed surface".to_owned()
        } else {
            counts
        }
    }

    /// Why none of the candidates reaches ε. The limits come second: candidates that keep them were judged.
    pub(crate) fn none_good_enough(&self, quality_best: f32) -> String {
        let limits = self.beyond_limits("; others are beyond the limits that were asked for: ", "");
        format!("{}{limits}", self.below(quality_best))
    }

    /// That the best quality is below ε.
    fn below(&self, quality_best: f32) -> String {
        // Rounded down, so that 0.8997 does not become 0.9.
        let (best, least) = ((quality_best * 1e3).floor() * 1e-3, self.config.detection.quality_min);
        format!("no grasp has a quality of {least} or more: the best has {best:.3}")
    }

    /// Why an object has no grasps, if this is the best of its candidates.
    pub(crate) fn none_of_object(&self, best: Option<&DroppedCandidate>) -> String {
        match best {
            Some(DroppedCandidate { reason: RejectReason::Quality { .. }, quality, .. }) => self.below(*quality),
            Some(best) => best.detail.clone(),
            None if self.options.limits != Limits::default() || self.limiter.rejections().is_some() => {
                "no grasp candidate at it keeps the limits that were asked for".to_owned()
            }
            None => "no grasp candidate was found at it".to_owned(),
        }
    }

    /// Why none of `count` candidates that reach ε is left.
    pub(crate) fn none_found(&self, dropped: &[DroppedCandidate], count: usize) -> String {
        let of = |is_meant: fn(&RejectReason) -> bool| dropped.iter().filter(|one| is_meant(&one.reason)).count();
        let limited = format!("are beyond the limits that were asked for{}", self.beyond_limits(" (", ")"));
        let parts = [
            (of(|reason| *reason == RejectReason::Avoided), "are like grasps that failed"),
            (of(|reason| matches!(reason, RejectReason::Limited { .. })), &limited),
        ];
        let parts = parts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
        format!("of {count} grasps that are good enough {}", parts.collect::<Vec<_>>().join(", "))
    }
}

/// A stage of a plan.
#[derive(Debug)]
pub(crate) struct Stage {
    /// Its key in the plan's JSON.
    pub(crate) name: &'static str,
    /// Candidates that passed it.
    pub(crate) count: usize,
    /// What to say if none did, and some had passed the stage before.
    pub(crate) none: String,
}

impl Stage {
    pub(crate) fn new(name: &'static str, count: usize, none: impl Into<String>) -> Self {
        Self { name, count, none: none.into() }
    }
}

/// Grasps that reach ε, and the others if requested.
#[derive(Debug)]
pub(crate) struct Candidates {
    pub(crate) grasps: Vec<RankedGrasp>,
    pub(crate) dropped: Vec<DroppedCandidate>,
    /// In their order.
    pub(crate) stages: Vec<Stage>,
}

impl Candidates {
    /// Drops grasps with a reason.
    pub(crate) fn drop_where(&mut self, mut reason: impl FnMut(&mut RankedGrasp) -> Option<RejectReason>) {
        let dropped = &mut self.dropped;
        self.grasps.retain_mut(|ranked| {
            let reason = reason(ranked);
            dropped.extend(reason.map(|reason| DroppedCandidate::new(ranked, reason)));
            reason.is_none()
        });
    }

    /// Ends a stage with the grasps that are left.
    pub(crate) fn end_stage(&mut self, name: &'static str, none: impl Into<String>) {
        self.stages.push(Stage::new(name, self.grasps.len(), none));
    }
}
