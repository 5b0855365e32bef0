//! Errors of predicted grasps.

use schema::{Quat, Vec3};

use super::{Found, SampleResult, VoxelSample};
use crate::scores::{GraspErrors, Spread, rotation_error_deg};

/// Of the held ones.
pub(super) fn errors<'a>(found: impl Iterator<Item = &'a Found>, voxel_size_m: f32) -> GraspErrors {
    let held: Vec<_> = found.filter(|(_, result)| result.label == 1).collect();
    let over = |error: &dyn Fn(&VoxelSample, &SampleResult) -> f64| {
        Spread::of(held.iter().map(|(sample, grasp)| error(&sample.data, grasp)).collect())
    };
    // The cosine between an axis of the true grasp and that of the predicted grasp.
    let cosine = |sample: &VoxelSample, grasp: &SampleResult, axis: Vec3| {
        (sample.target.rotation * axis).dot(Quat::from_array(grasp.answer) * axis)
    };
    let apart_deg = |cosine: f32| f64::from(libm::acosf(cosine.clamp(-1.0, 1.0)).to_degrees());
    GraspErrors {
        samples: held.len(),
        rotation_deg: over(&|_, grasp| rotation_error_deg(grasp.rotation)),
        approach_deg: over(&|sample, grasp| apart_deg(cosine(sample, grasp, Vec3::Z))),
        closing_deg: over(&|sample, grasp| apart_deg(cosine(sample, grasp, Vec3::Y).abs())),
        width_mm: over(&|_, grasp| 1e3 * f64::from(voxel_size_m) * f64::from(grasp.width).sqrt()),
    }
}
