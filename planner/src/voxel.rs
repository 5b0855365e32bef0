//! Grasps by a network that answers for every voxel, the paper's or VGN's: its detections, and the grasp that it
//! predicts at each.

pub mod detect;

use grasps::ObservedScene;
use network::{DenseGrids, DenseNetwork, GraspOrigin};
use schema::{Grid, Pose, Quat, Vec3, pose_from_parts};

use crate::config::Config;
use crate::gripper_volume::towards_wrist;
use crate::method::{Candidates, Method, Request, Stage};
use crate::observation::PlanOptions;
use crate::plan::{DroppedCandidate, RankedGrasp, RejectReason};
use crate::timing::{Timings, timed};
use crate::volume::Workspace;
use detect::{Detected, Detection, Side, detect};

/// A network of voxels, and where it has a grasp's origin.
#[derive(Debug)]
pub(crate) struct VoxelMethod {
    pub(crate) network: DenseNetwork,
    pub(crate) origin: GraspOrigin,
}

impl Method for VoxelMethod {
    fn workspace(&self, _: &Config, _: &PlanOptions) -> Workspace {
        Workspace::cube(Grid::PAPER)
    }

    fn candidates(
        &self,
        seen: ObservedScene<'_>,
        _: u64,
        request: &Request<'_>,
        timings_ms: &mut Timings,
    ) -> Candidates {
        let (grid, params) = (&Grid::PAPER, &request.config.detection);
        let values = &seen.field.values;
        let grids = timed(timings_ms, "network", || self.network.infer(values));
        let detected: Detected = timed(timings_ms, "detect", || {
            let sigmoid = |logit: &f32| 1.0 / (1.0 + libm::expf(-logit));
            let quality: Vec<f32> = grids.quality_logit.iter().map(sigmoid).collect();
            detect(grid, values, &quality, &grids.width_voxels, Side::of(self.origin), params)
        });
        let misses = if request.options.explain { detected.misses(grid, params) } else { Vec::new() };
        let grasp_at = |detection: &Detection| self.grasp_at(grid, detection, &grids, request);
        let missed = |(miss, reason)| DroppedCandidate::new(&grasp_at(&miss), reason);
        let (low, high) = (params.width_voxels_min, params.width_voxels_max);
        let widths = format!("no grasp has a width between {low} and {high} voxels");
        let stages = vec![
            Stage::new("voxels", grid.len(), ""),
            Stage::new("near_surface", detected.near_surface, "no voxel on the grasps' side of a surface was seen"),
            Stage::new("width_within_limits", detected.width_within_limits, widths),
            Stage::new("quality_reached", detected.quality_reached, request.none_good_enough(detected.quality_best)),
            Stage::new("detections", detected.found.len(), ""),
        ];
        Candidates {
            grasps: detected.found.iter().map(grasp_at).collect(),
            dropped: misses.into_iter().map(missed).collect(),
            stages,
        }
    }

    fn settle(&self, candidates: &mut Candidates, request: &Request<'_>) {
        let detections = candidates.grasps.len();
        candidates
            .drop_where(|ranked| request.is_avoided(&ranked.workspace_from_grasp).then_some(RejectReason::Avoided));
        let poses: Vec<Pose> = candidates.grasps.iter().map(|ranked| ranked.workspace_from_grasp).collect();
        let mut broken = request.limiter.broken(&poses).into_iter();
        candidates.drop_where(|_| broken.next().flatten().map(|limit| RejectReason::Limited { limit }));
        let none = request.none_found(&candidates.dropped, detections);
        candidates.end_stage("found", none);
    }
}

impl VoxelMethod {
    /// The grasp that the network predicts in a voxel, turned towards the wrist.
    fn grasp_at(&self, grid: &Grid, detection: &Detection, grids: &DenseGrids, request: &Request<'_>) -> RankedGrasp {
        let Detection { voxel, quality } = *detection;
        let (flat, count) = (grid.flat(voxel), grid.len());
        let [x, y, z, w] = [0, 1, 2, 3].map(|part| grids.rotation[part * count + flat]);
        let rotation = Quat::from_xyzw(x, y, z, w).normalize();
        // A head that says where the tips are knows it better than to a voxel.
        let tips_m = match grids.tips_voxels.len() {
            0 => self.origin.tips_m(voxel, rotation, grid),
            _ => {
                let offset = [0, 1, 2].map(|part| grids.tips_voxels[part * count + flat]);
                grid.centre_m(voxel) + Vec3::from_array(offset) * grid.voxel_size_m()
            }
        };
        let workspace_from_grasp = pose_from_parts(rotation, tips_m);
        let width_m = grids.width_voxels[flat] * grid.voxel_size_m();
        let gripper = &request.config.gripper;
        let pose = towards_wrist(gripper, &workspace_from_grasp, request.options.wrist());
        let pose = match gripper.aside_m(width_m) {
            0.0 => pose,
            aside_m => pose * Pose::from_translation(Vec3::Y * aside_m),
        };
        RankedGrasp::new(pose, Some(width_m), quality, Some(voxel))
    }
}
