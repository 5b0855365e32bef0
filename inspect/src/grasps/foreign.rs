//! Forms of others. Each has its own frame of the hand; ours has its origin between the tips, +z approach, +y closing.

use std::fmt::Write as _;

use program::{ExitCode, Failure};
use schema::{Gripper, Mat3, ObjectGrasp, ObjectGrasps, Outcome, Pose, Quat, Vec3};
use serde_json::json;

use crate::npy;

/// GraspNet's origin is this far behind the tips.
pub(super) const GRASPNET_DEPTH_M: f32 = 0.02;
/// Its score is this less the smallest friction.
const GRASPNET_SCORE: f32 = 1.1;

/// From the base of the hand to its tips, along the approach: the flange's distance if the hand's file has it, else
/// palm and fingers.
pub(super) fn base_to_tips_m(gripper: &Gripper) -> f32 {
    let flange = gripper.flange_from_grasp.map(|flange_from_grasp| flange_from_grasp.position_m[2]);
    flange.unwrap_or(gripper.finger_length_m + gripper.palm_length_m)
}

/// The base of the hand at a grasp, with the axes of the grasp.
fn base(grasp: &ObjectGrasp, gripper: &Gripper) -> Pose {
    grasp.object_from_grasp * Pose::from_translation(Vec3::new(0.0, 0.0, -base_to_tips_m(gripper)))
}

/// The same hand with its closing direction called x instead of y: x = our y, y = our −x, z = our z.
fn closing_along_x(pose: &Pose) -> Pose {
    let quarter = core::f32::consts::FRAC_1_SQRT_2;
    Pose::from_parts(pose.translation, (pose.rotation * Quat::from_xyzw(0.0, 0.0, quarter, quarter)).normalize())
}

/// A pose as a row-major matrix of four rows.
fn rows(pose: &Pose) -> [[f32; 4]; 4] {
    let turned = Mat3::from_quat(pose.rotation);
    let ([x, y, z], at) = ([turned.x_axis, turned.y_axis, turned.z_axis], pose.translation.to_array());
    let row = |i: usize| [x.to_array()[i], y.to_array()[i], z.to_array()[i], at[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// Origin at the hand's base, +z approach, +y closing. Confidence is 1 for what was held, and 0 for all else.
///
/// Joints are written for hands whose joints are known; others have none. Numbers have a fixed number of decimals: YAML
/// 1.1 takes 1e-5 for a word.
pub(super) fn isaac_grasp(set: &ObjectGrasps) -> String {
    let hand = &set.gripper.name;
    let joint = (hand == "franka_hand").then_some("panda_finger_joint1");
    let mut text = "format: isaac_grasp\nformat_version: 1.0\n".to_owned();
    // Writing to a String cannot fail, here and below.
    let _ = writeln!(text, "object_frame: {}\ngripper_frame: {}", json!(set.name), json!(hand));
    let _ = writeln!(text, "object_file: {}\nobject_scale: {:.10}", json!(set.file), set.scale_m);
    text += if set.grasps.is_empty() { "grasps: {}\n" } else { "grasps:\n" };
    for (number, grasp) in set.grasps.iter().enumerate() {
        let base = base(grasp, &set.gripper);
        let ([x, y, z], [qx, qy, qz, qw]) = (base.translation.to_array(), base.rotation.to_array());
        let confidence = f32::from(grasp.outcome.label());
        let _ = writeln!(
            text,
            "  grasp_{number}:\n    confidence: {confidence:.1}\n    position: [{x:.7}, {y:.7}, {z:.7}]\n    \
             orientation: {{w: {qw:.8}, xyz: [{qx:.8}, {qy:.8}, {qz:.8}]}}"
        );
        let Some(joint) = joint else { continue };
        if let Some(width_m) = grasp.width_m {
            let _ = writeln!(text, "    cspace_position: {{{joint}: {:.6}}}", 0.5 * width_m);
        }
        let _ = writeln!(text, "    pregrasp_cspace_position: {{{joint}: {:.6}}}", 0.5 * set.gripper.opening_m_max);
    }
    text
}

/// Origin at the hand's base, +z approach, +x closing, as ACRONYM's.
pub(super) fn graspgen(set: &ObjectGrasps) -> String {
    let base = |grasp: &ObjectGrasp| rows(&closing_along_x(&base(grasp, &set.gripper)));
    let contacts = |grasp: &ObjectGrasp| grasp.contacts_m.map(|at_m| at_m.map(|at_m| at_m.to_array()));
    let is_held = |grasp: &ObjectGrasp| grasp.outcome == Outcome::Held;
    let value = json!({
        "object": { "file": set.file, "scale": set.scale_m },
        "gripper": {
            "name": set.gripper.name,
            "width": set.gripper.opening_m_max,
            "depth": base_to_tips_m(&set.gripper),
        },
        "grasps": {
            "transforms": set.grasps.iter().map(base).collect::<Vec<_>>(),
            "object_in_gripper": set.grasps.iter().map(is_held).collect::<Vec<_>>(),
            "contacts_m": set.grasps.iter().map(contacts).collect::<Vec<_>>(),
        },
    });
    format!("{value}\n")
}

/// Origin between the tips, +z approach, +y closing: our own frame. Only grasps that held.
///
/// # Errors
/// [`Failure`] if the zip cannot be made.
pub(super) fn molmospaces(set: &ObjectGrasps) -> Result<Vec<u8>, Failure> {
    let values: Vec<f64> =
        set.held().flat_map(|grasp| rows(&grasp.object_from_grasp)).flatten().map(f64::from).collect();
    let array = npy::f64s(&[values.len() / 16, 4, 4], &values);
    npy::npz("transforms", &array)
        .map_err(|error| Failure::new(ExitCode::Internal, format!("failed to make a zip: {error}")))
}

/// Score, width, height, depth, nine of the rotation, three of the position, object: +x approach, +y closing, origin
/// 20 mm behind the tips. Only grasps that held; the score is 1.1 less the smallest friction where that was measured, 0
/// where even its own is too small, and 1 where nothing was measured. The object has no number: −1.
pub(super) fn graspnet(set: &ObjectGrasps) -> Vec<u8> {
    let grasp = |grasp: &ObjectGrasp| -> Vec<f64> {
        let Pose { translation, rotation, .. } = grasp.object_from_grasp;
        let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| rotation * axis);
        // Theirs: x = our z, y = our y, z = x × y = our −x.
        let axes = [z, y, -x];
        let at_m = translation - z * GRASPNET_DEPTH_M;
        let measured = |margins: schema::Margins| {
            margins.friction_min.map_or(0.0, |friction| (GRASPNET_SCORE - friction).max(0.0))
        };
        let score = grasp.margins.map_or(1.0, measured);
        let width_m = grasp.width_m.unwrap_or(0.0);
        let row = |i: usize| axes.map(|axis| axis.to_array()[i]);
        let numbers = [score, width_m, set.gripper.finger_width_m, GRASPNET_DEPTH_M];
        let matrix = [row(0), row(1), row(2)].concat();
        numbers.into_iter().chain(matrix).chain(at_m.to_array()).chain([-1.0]).map(f64::from).collect()
    };
    let values: Vec<f64> = set.held().flat_map(grasp).collect();
    npy::f64s(&[values.len() / 17, 17], &values)
}
