//! What is drawn on the scene: hands, objects' centroids, dropped candidates, the workspace's box and its axes.
//!
//! Only the best grasp gets its fingers and palm as they are; twelve whole hands would hide what they reach for, so the
//! others are forks of lines with the same places of finger tips, palm and wrist.

use schema::{Grasp, Grid, Gripper, HandBox, Vec3};

use super::eye::{Eye, Seen, box_corners};
use super::layer::{Layer, Opacity};
use super::tints::{COLLISION, INK, OTHER_DROP, Rgb, THIN_LINE, WHITE, lit, of_label, of_place};
use crate::plan::{Drop, DroppedCandidate, PointLabel, SeenObject};

const SHOWN: Opacity = Opacity { before: 1.0, behind: 0.22 };
const GLASS: Opacity = Opacity { before: 0.26, behind: 0.08 };
const ALWAYS: Opacity = Opacity { before: 1.0, behind: 1.0 };
/// White lines about dark ones lie this far behind them, so that they cover no other line of the same hand.
const HALO_BEHIND_M: f32 = 0.004;
const HALO_PX: f32 = 3.0;
/// Where the arrow's head begins and ends, in fingers' lengths behind the tips: before most objects, not within.
const ARROW_HEAD: [f32; 2] = [0.80, 0.38];
/// The stem's length behind the palm's front, in palms' lengths.
const STEM_PALMS: f32 = 1.5;
const AXIS_SHARE: f32 = 0.13;
const CUBE_EDGES: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];
/// Corners of a cube's faces in order round each, and their outward normals.
const CUBE_FACES: [([usize; 4], Vec3); 6] = [
    ([0, 2, 6, 4], Vec3::NEG_X),
    ([1, 3, 7, 5], Vec3::X),
    ([0, 1, 5, 4], Vec3::NEG_Y),
    ([2, 3, 7, 6], Vec3::Y),
    ([0, 1, 3, 2], Vec3::NEG_Z),
    ([4, 5, 7, 6], Vec3::Z),
];

/// A sheet to draw on, a layer of the same size to draw with, and who looks.
pub(super) struct Easel {
    pub(super) sheet: Layer,
    pub(super) scratch: Layer,
    pub(super) eye: Eye,
}

impl Easel {
    fn line(&mut self, from_m: Vec3, to_m: Vec3, radius_px: f32, colour: Rgb) {
        if let (Some(from), Some(to)) = (self.eye.see(from_m), self.eye.see(to_m)) {
            self.scratch.line(from, to, radius_px, colour);
        }
    }

    fn haloed_line(&mut self, from_m: Vec3, to_m: Vec3, radius_px: f32, colour: Rgb) {
        if let (Some(from), Some(to)) = (self.eye.see(from_m), self.eye.see(to_m)) {
            let behind = |seen: Seen| Seen { depth_m: seen.depth_m + HALO_BEHIND_M, ..seen };
            self.scratch.line(behind(from), behind(to), radius_px + HALO_PX, WHITE);
            self.scratch.line(from, to, radius_px, colour);
        }
    }

    fn disc(&mut self, at_m: Vec3, nearer_m: f32, radius_px: f32, colour: Rgb) {
        if let Some(seen) = self.eye.see(at_m) {
            self.scratch.disc(Seen { depth_m: seen.depth_m - nearer_m, ..seen }, radius_px, colour);
        }
    }

    fn lay(&mut self, opacity: Opacity) {
        self.sheet.lay(&mut self.scratch, opacity);
    }

    /// Thin lines along the workspace's edges, and its axes at the origin. Gives the axes' names and their places.
    pub(super) fn workspace(&mut self, grid: &Grid) -> Vec<(&'static str, Seen)> {
        let corners = box_corners(grid.size_m);
        for [from, to] in CUBE_EDGES {
            self.line(corners[from], corners[to], 1.0, THIN_LINE);
        }
        let length_m = AXIS_SHARE * grid.size_m;
        for axis in Vec3::AXES {
            self.line(Vec3::ZERO, axis * length_m, 2.6, INK);
        }
        self.lay(SHOWN);
        let ends = ["x", "y", "z"].into_iter().zip(Vec3::AXES);
        let seen = ends.filter_map(|(name, axis)| Some((name, self.eye.see(axis * (1.28 * length_m))?)));
        let Some(origin) = self.eye.see(Vec3::ZERO) else { return Vec::new() };
        // An axis that points at the eye would have its name on the origin.
        seen.filter(|(_, end)| (end.x - origin.x).abs().max((end.y - origin.y).abs()) > 30.0).collect()
    }

    /// A dot in its object's tint at each centroid, seen through the object.
    pub(super) fn centroids(&mut self, objects: &[SeenObject]) {
        for (number, object) in objects.iter().enumerate() {
            self.disc(object.centroid_m, 0.0, 13.0, WHITE);
            self.disc(object.centroid_m, 1e-4, 10.0, INK);
            self.disc(object.centroid_m, 2e-4, 6.0, of_label(PointLabel::Object(number)));
            self.lay(ALWAYS);
        }
    }

    /// A dot at each dropped candidate's finger tips; collisions are larger and on top.
    pub(super) fn dropped(&mut self, dropped: &[DroppedCandidate]) {
        for collisions in [false, true] {
            let (radius_px, colour) = if collisions { (7.0, COLLISION) } else { (5.0, OTHER_DROP) };
            let wanted = |candidate: &&DroppedCandidate| matches!(candidate.drop, Drop::Collision { .. }) == collisions;
            for candidate in dropped.iter().filter(wanted) {
                self.disc(candidate.grasp.workspace_from_grasp.translation, 0.0, radius_px, colour);
            }
            self.lay(SHOWN);
        }
    }

    /// The hand of the grasp in this place (0 is the best) of `count`. Gives where its stem ends.
    pub(super) fn hand(&mut self, grasp: &Grasp, gripper: &Gripper, place: usize, count: usize) -> Option<Seen> {
        let colour = of_place(place, count);
        if place == 0 {
            self.block(grasp, &gripper.palm(), colour);
            self.lay(GLASS);
            for finger in gripper.fingers(grasp.width_m) {
                self.block(grasp, &finger, colour);
            }
            self.arrow(grasp, gripper);
        } else {
            self.fork(grasp, gripper, colour, if place < 4 { 5.0 } else { 3.4 });
        }
        self.lay(SHOWN);
        self.eye.see(grasp.workspace_from_grasp.transform_point(stem_end_m(gripper)))
    }

    /// Two fingers, a palm and a stem, as lines.
    fn fork(&mut self, grasp: &Grasp, gripper: &Gripper, colour: Rgb, radius_px: f32) {
        let place = |point_m: Vec3| grasp.workspace_from_grasp.transform_point(point_m);
        let palm_m = Vec3::new(0.0, 0.0, -gripper.finger_length_m);
        for finger in gripper.fingers(grasp.width_m) {
            let side_m = Vec3::new(0.0, finger.centre_m.y, 0.0);
            self.haloed_line(place(side_m), place(side_m + palm_m), radius_px, colour);
            self.haloed_line(place(side_m + palm_m), place(palm_m), radius_px, colour);
        }
        self.haloed_line(place(palm_m), place(stem_end_m(gripper)), radius_px, colour);
    }

    /// From the stem's end to between the fingers: the way the hand comes.
    fn arrow(&mut self, grasp: &Grasp, gripper: &Gripper) {
        let place = |z_m: f32| grasp.workspace_from_grasp.transform_point(Vec3::new(0.0, 0.0, z_m));
        let [neck_m, tip_m] = ARROW_HEAD.map(|share| place(-share * gripper.finger_length_m));
        self.haloed_line(place(stem_end_m(gripper).z), neck_m, 4.0, INK);
        if let (Some(neck), Some(tip)) = (self.eye.see(neck_m), self.eye.see(tip_m)) {
            let across = |share: f32| Seen {
                x: neck.x + share * (tip.y - neck.y),
                y: neck.y - share * (tip.x - neck.x),
                depth_m: neck.depth_m,
            };
            self.scratch.triangle([across(-0.5), across(0.5), tip], INK);
        }
    }

    /// A box of the hand with its edges.
    fn block(&mut self, grasp: &Grasp, part: &HandBox, colour: Rgb) {
        let pose = &grasp.workspace_from_grasp;
        let corners = box_corners(2.0)
            .map(|corner| self.eye.see(pose.transform_point(part.centre_m + (corner - Vec3::ONE) * part.half_m)));
        for (around, normal) in CUBE_FACES {
            if let [Some(a), Some(b), Some(c), Some(d)] = around.map(|at| corners[at]) {
                let face = lit(colour, 0.92 + 0.22 * (pose.rotation * normal).z);
                self.scratch.triangle([a, b, c], face);
                self.scratch.triangle([a, c, d], face);
            }
        }
        let nearer = |seen: Seen| Seen { depth_m: seen.depth_m - 0.001, ..seen };
        for [from, to] in CUBE_EDGES {
            if let (Some(from), Some(to)) = (corners[from], corners[to]) {
                self.scratch.line(nearer(from), nearer(to), 1.3, lit(colour, 0.45));
            }
        }
    }
}

/// Where the stem ends, in the grasp frame.
fn stem_end_m(gripper: &Gripper) -> Vec3 {
    Vec3::new(0.0, 0.0, -gripper.finger_length_m - STEM_PALMS * gripper.palm_length_m)
}
