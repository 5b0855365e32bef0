//! Grasps by a judge: collision-free candidates are proposed, and the judge says how likely each of them holds.

use grasps::{Judge, ObservedScene, ScoredGrasp};
use schema::{Grasp, Grid, Purpose, Stream};

use crate::hand::towards_wrist;
use crate::method::{Candidates, Method, Request, Stage};
use crate::plan::{DroppedCandidate, RankedGrasp, RejectReason, SegmentedCloud};
use crate::timing::{Timings, timed};

/// A judge, and the workspace in which it was trained.
#[derive(Debug)]
pub(crate) struct JudgeMethod {
    pub(crate) judge: Judge,
    pub(crate) grid: Grid,
}

impl Method for JudgeMethod {
    fn candidates(
        &self,
        seen: ObservedScene<'_>,
        scene: u64,
        request: &Request<'_>,
        timings_ms: &mut Timings,
    ) -> Candidates {
        let Request { config, options, limiter } = *request;
        let mut stream = Stream::new(config.seed, scene, Purpose::Proposals, 0);
        // As dense in a larger workspace as in the network's.
        let areas = (seen.field.grid.size_m / self.grid.size_m).powi(2).max(1.0);
        let proposals = (config.judge.proposals as f32 * areas).round() as usize;
        // As it is offered: of a hand and its half turn the one nearer to the wrist.
        let wrist = options.wrist();
        let is_wanted = |hand: &Grasp| limiter.broken(&towards_wrist(&hand.workspace_from_grasp, wrist)).is_none();
        let judged = timed(timings_ms, "judge", || self.judge.scored_grasps(seen, proposals, &mut stream, &is_wanted));
        selected(&judged, request)
    }

    fn settle(&self, candidates: &mut Candidates, _: &SegmentedCloud, request: &Request<'_>) {
        let reached = candidates.stages.last().map_or(0, |stage| stage.count);
        let none = request.none_found(&candidates.dropped, reached);
        candidates.end_stage("found", none);
    }
}

/// Of judged hands, best first, those that reach ε and are apart from better ones.
fn selected(hands: &[ScoredGrasp], request: &Request<'_>) -> Candidates {
    let (epsilon, apart_m) = (request.config.detection.quality_min, request.config.judge.apart_m);
    let (mut grasps, mut kept, mut dropped, mut reached) = (Vec::new(), Vec::<&ScoredGrasp>::new(), Vec::new(), 0);
    for judged in hands {
        let pose = towards_wrist(&judged.grasp.workspace_from_grasp, request.options.wrist());
        let grasp = RankedGrasp::new(pose, judged.grasp.width_m, judged.quality(), None);
        let reason = if grasp.quality.is_nan() {
            Some(RejectReason::NotANumber)
        } else if grasp.quality < epsilon {
            let (outcome, probability) = judged.likeliest();
            Some(RejectReason::Judged { outcome, probability })
        } else {
            reached += 1;
            if request.is_avoided(&grasp.workspace_from_grasp) {
                Some(RejectReason::Avoided)
            } else {
                kept.iter().any(|better| better.is_near(judged, apart_m)).then_some(RejectReason::Suppressed)
            }
        };
        match reason {
            Some(reason) => dropped.push(DroppedCandidate::new(&grasp, reason)),
            None => {
                grasps.push(grasp);
                kept.push(judged);
            }
        }
    }
    let best = hands.first().map_or(0.0, ScoredGrasp::quality);
    let no_numbers = hands.iter().filter(|judged| judged.quality().is_nan()).count();
    let none_reached = if no_numbers > 0 {
        format!("of {} answers of the network {no_numbers} are not numbers: are its weights damaged?", hands.len())
    } else {
        request.none_good_enough(best)
    };
    let stages = vec![
        Stage::new("proposed", hands.len(), request.none_proposed()),
        Stage::new("quality_reached", reached, none_reached),
    ];
    Candidates { grasps, dropped, stages }
}
