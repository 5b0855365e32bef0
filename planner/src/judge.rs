//! Grasps by a judge: collision-free candidates are proposed, and the judge says how likely each of them holds.

use grasps::{Judge, ObservedScene, ScoredGrasp, Search, Spread};
use schema::{Grasp, Grid, Purpose, Stream, Vec3};

use crate::config::{Config, JudgeParams};
use crate::gripper_volume::towards_wrist;
use crate::method::{Candidates, Method, Request, Stage};
use crate::observation::PlanOptions;
use crate::plan::{DroppedCandidate, RankedGrasp, RejectReason};
use crate::steady::put_first;
use crate::timing::{Timings, timed};
use crate::volume::Workspace;

impl Method for Judge {
    fn workspace(&self, config: &Config, options: &PlanOptions) -> Workspace {
        let [wide_m, deep_m, high_m] = config.judge.reach_m;
        let (half_m, middle_m) = (0.5 * Vec3::new(wide_m, deep_m, 0.0), 0.5 * Grid::PAPER.size_m);
        let middle_m = Vec3::new(middle_m, middle_m, 0.0);
        let [low_m, high] = match options.workspace_size_m {
            Some(size_m) => [Vec3::ZERO, Vec3::splat(size_m)],
            None => [middle_m - half_m, middle_m + half_m],
        };
        let within_m = Some([low_m, high.with_z(Grid::PAPER.table_z_m + high_m)]);
        Workspace { within_m, grid: options.workspace(&Grid::PAPER) }
    }

    fn candidates(
        &self,
        seen: ObservedScene<'_>,
        scene: u64,
        request: &Request<'_>,
        timings_ms: &mut Timings,
    ) -> Candidates {
        let Request { config, options, limiter, widths, doubts } = *request;
        let mut stream = Stream::new(config.seed, scene, Purpose::Proposals, 0);
        // As it is offered: of a grasp and its half turn the one nearer to the wrist.
        let wrist = options.wrist();
        let failed_m: Vec<Vec3> = options.avoid.iter().map(|failed| failed.translation).collect();
        let (about_m, better) = (&limiter.about_m(), &|grasp: &Grasp| widths.centred(grasp));
        let JudgeParams { proposals, asked, apart_m, .. } = config.judge;
        let asked = asked.unwrap_or(proposals);
        let spread = if options.each { Spread::Each } else { Spread::Shared };
        let previous = options.previous.map(|workspace_from_grasp| Grasp { workspace_from_grasp, width_m: 0.0 });
        // Grasps whose tips are nearer to each other than this close on the same thing: it is no wider than the gripper
        // opens.
        let other_m = 0.5 * config.gripper.opening_m_max;
        // In a container the next grasp is of another thing, if there is one: this one is heavy, slippery, or held by
        // what nobody sees, and a second grasp of it likely fails, too. What is no thing comes last, as does what a
        // board may be over that nobody saw.
        let off_m = if limiter.is_in_container() { &failed_m[..] } else { &[] };
        let (is_of_things, is_below) = (doubts.are_beside_things(), limiter.may_have_board());
        let mut ask = |is_any: bool| {
            let are_wanted = |candidates: &[Grasp]| {
                let offered = |grasp: &Grasp| towards_wrist(&config.gripper, &grasp.workspace_from_grasp, wrist);
                let broken = limiter.broken(&candidates.iter().map(offered).collect::<Vec<_>>());
                let is_meant = |grasp: &Grasp| {
                    let tips_m = grasp.workspace_from_grasp.translation;
                    off_m.iter().all(|failed_m| (tips_m - *failed_m).length() > other_m)
                        && !(is_of_things && doubts.of(&grasp.workspace_from_grasp).is_some())
                        && !(is_below && limiter.meets_board(&grasp.workspace_from_grasp))
                };
                candidates.iter().zip(broken).map(|(it, broken)| broken.is_none() && (is_any || is_meant(it))).collect()
            };
            let are_wanted = &are_wanted;
            let search = Search { proposals, asked, spread, previous, apart_m, about_m, are_wanted, better };
            self.scored_grasps(seen, &search, &mut stream)
        };
        let epsilon = config.detection.quality_min;
        let (judged, proposed) = timed(timings_ms, "judge", || {
            let others = ask(false);
            let is_all = off_m.is_empty() && !is_of_things && !is_below;
            let is_enough = is_all || others.0.first().is_some_and(|best| best.quality() >= epsilon);
            if is_enough { others } else { ask(true) }
        });
        selected(judged, proposed, request)
    }

    fn settle(&self, candidates: &mut Candidates, request: &Request<'_>) {
        let reached = candidates.stages.last().map_or(0, |stage| stage.count);
        let none = request.none_found(&candidates.dropped, reached);
        candidates.end_stage("found", none);
    }
}

/// Of judged grasps, best first, and of so many proposed ones, those that reach ε and are apart from better ones.
fn selected(mut scored: Vec<ScoredGrasp>, proposed: usize, request: &Request<'_>) -> Candidates {
    let best = scored.first().map_or(0.0, ScoredGrasp::quality);
    if let Some(previous) = &request.options.previous {
        // Before better ones suppress it.
        put_first(&mut scored, previous, |one| (one.quality(), one.grasp.workspace_from_grasp));
    }
    let (epsilon, apart_m) = (request.config.detection.quality_min, request.config.judge.apart_m);
    let (mut grasps, mut kept, mut dropped, mut reached) = (Vec::new(), Vec::<&ScoredGrasp>::new(), Vec::new(), 0);
    for judged in &scored {
        let (gripper, wrist) = (&request.config.gripper, request.options.wrist());
        let pose = towards_wrist(gripper, &judged.grasp.workspace_from_grasp, wrist);
        let grasp =
            RankedGrasp { robustness: judged.robustness, ..RankedGrasp::new(pose, None, judged.quality(), None) };
        let reason = if grasp.quality.is_nan() {
            Some(RejectReason::NotANumber)
        } else if grasp.quality < epsilon {
            Some(RejectReason::Quality { likeliest: Some(judged.likeliest()) })
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
    let no_numbers = scored.iter().filter(|judged| judged.quality().is_nan()).count();
    let none_reached = if no_numbers > 0 {
        format!("of {} answers of the network {no_numbers} are not numbers: are its weights damaged?", scored.len())
    } else {
        request.none_good_enough(best)
    };
    let stages = vec![
        Stage::new("proposed", proposed, request.none_proposed()),
        Stage::new("judged", scored.len(), request.none_proposed()),
        Stage::new("quality_reached", reached, none_reached),
    ];
    Candidates { grasps, dropped, stages }
}
