//! Grasps of an object alone, before anybody tried them: numbered, each a pure function of the seed and its number, and
//! the first so many of them spread over the object, however many are wanted.

use core::f32::consts::TAU;
use std::collections::VecDeque;

use rayon::prelude::*;
use schema::{GraspSource, Mat3, Pose, Purpose, Quat, Stream, Vec3, along_normal, axis_angle, pose_from_parts};
use simulator::FloatingWorld;

use super::params::{AnnotateParams, GraspShares};
use super::surface::{Surface, SurfacePoint};
use crate::mixture::displaced_grasp;

/// What is thinner than this, nobody grasps.
const WIDTH_M_MIN: f32 = 0.001;
/// The tips reach at least so far behind the points that are gripped …
const DEPTH_M_MIN: f32 = 0.003;
/// … and stay so far from what would stop them.
const ROOM_M: f32 = 0.001;
/// VGN's: tips are between −ε and 1 + ε finger lengths behind a point.
const DEPTH_SHARE: f32 = 0.1;
/// Sides from which the open gripper may try to come to two points.
const APPROACHES: u32 = 6;
/// The same where the question is whether it can come at all.
const SIDES: u32 = 24;

/// The fraction of a number times the inverse powers of the root of x⁶ = x + 1: numbered points that fill the unit cube
/// of five dimensions evenly (Roberts, 2018).
const STEPS: [f64; 5] = [0.881_271_461_634, 0.776_639_389_090, 0.684_430_129_585, 0.603_168_740_686, 0.531_555_397_716];
/// The golden section, by which sources take turns.
const TURN: f64 = 0.618_033_988_749_894_8;

/// Numbers that are tried for a grasp that is wanted, and for any: an object may have few, or none.
const NUMBERS_A_GRASP: u64 = 200;
const NUMBERS_MIN: u64 = 20_000;
/// Numbers that are tried at a time, on all cores.
const NUMBERS_CHUNK: u64 = 2_048;

/// What draws grasps.
pub(super) struct Draw<'a> {
    pub(super) params: &'a AnnotateParams,
    pub(super) world: &'a FloatingWorld<'a>,
    pub(super) surface: &'a Surface,
    /// Tangent of the cone in which a contact bears.
    pub(super) friction: f32,
}

impl Draw<'_> {
    /// The grasp of this number from a source, if there is one: many a point has none.
    fn grasp(&self, number: u64, source: GraspSource) -> Option<Pose> {
        let mut stream = Stream::new(self.params.seed, number, Purpose::Annotation, 0);
        match source {
            GraspSource::Normal => self.along_normal(number, &mut stream),
            GraspSource::Displaced => {
                let pose = self.antipodal(number, &mut stream)?;
                let mut stream = Stream::new(self.params.seed, number, Purpose::Annotation, 1);
                Some(displaced_grasp(&pose, true, &mut stream))
            }
            GraspSource::Antipodal | GraspSource::Given => self.antipodal(number, &mut stream),
        }
    }

    /// Numbers from 0 to 1 that belong to a grasp.
    fn spread(number: u64) -> [f32; 5] {
        STEPS.map(|step| ((number + 1) as f64 * step).fract() as f32)
    }

    /// A point of the surface that belongs to a number, for measuring what is covered.
    pub(super) fn point(&self, number: u64) -> Option<SurfacePoint> {
        let [along, u, v, ..] = Self::spread(number);
        self.surface.point([along, u, v])
    }

    /// The points across from a point between which and it a gripper can close: within the cones of both, and the open
    /// gripper is wider.
    fn pairs(&self, point: &SurfacePoint, inwards: Vec3) -> Vec<SurfacePoint> {
        let bears = |normal: Vec3, direction: Vec3| {
            let along = normal.dot(direction);
            along > 0.0 && normal.cross(direction).length() <= self.friction * along
        };
        if !bears(-point.normal, inwards) {
            return Vec::new();
        }
        let widths_m = WIDTH_M_MIN..=self.params.gripper.span_m();
        let mut across = self.surface.across(point.at_m, inwards);
        across.retain(|other| widths_m.contains(&(other.at_m - point.at_m).length()) && bears(other.normal, inwards));
        across
    }

    /// A grasp that closes along a direction about a point, from the first of so many sides from which the gripper can
    /// come; the `deep` share of the way in.
    fn reached(&self, middle_m: Vec3, closing: Vec3, around: f32, deep: f32, sides: u32) -> Option<Pose> {
        let length_m = self.params.gripper.finger_length_m;
        (0..sides).find_map(|side| {
            let rotation = closing_along(closing, TAU * (around + side as f32 / sides as f32));
            let approach = rotation * Vec3::Z;
            let deepest = pose_from_parts(rotation, middle_m + approach * length_m);
            let most_m = length_m - self.world.stops_short_m(&deepest)? - ROOM_M;
            let depth_m = DEPTH_M_MIN + deep * (most_m - DEPTH_M_MIN);
            let pose = pose_from_parts(rotation, middle_m + approach * depth_m);
            // Less deep, the gripper comes from further back.
            (most_m > DEPTH_M_MIN && self.world.is_reached(&pose)).then_some(pose)
        })
    }

    /// Whether there is a point straight across from a point of the surface, for a gripper to close on the two.
    pub(super) fn has_pair(&self, point: &SurfacePoint) -> bool {
        !self.pairs(point, -point.normal).is_empty()
    }

    /// Whether a gripper can come and do so.
    pub(super) fn is_graspable(&self, point: &SurfacePoint) -> bool {
        let inwards = -point.normal;
        let mut pairs = self.pairs(point, inwards).into_iter();
        pairs.any(|across| {
            let middle_m = 0.5 * (point.at_m + across.at_m);
            self.reached(middle_m, inwards, 0.0, 0.0, SIDES).is_some()
        })
    }

    fn antipodal(&self, number: u64, stream: &mut Stream) -> Option<Pose> {
        let [along, u, v, around, deep] = Self::spread(number);
        let point = self.surface.point([along, u, v])?;
        let cone_rad = libm::atanf(self.friction) * stream.uniform(0.0, 1.0).sqrt();
        let side = stream.uniform(0.0, TAU);
        let closing = along_normal(point.normal, side) * axis_angle(Vec3::X, cone_rad) * Vec3::Z;
        let pairs = self.pairs(&point, closing);
        if pairs.is_empty() {
            return None;
        }
        let middle_m = 0.5 * (point.at_m + pairs[stream.index(pairs.len())].at_m);
        self.reached(middle_m, closing, around, deep, APPROACHES)
    }

    fn along_normal(&self, number: u64, stream: &mut Stream) -> Option<Pose> {
        let point = self.point(number)?;
        let depth_m = self.params.gripper.finger_length_m * stream.uniform(-DEPTH_SHARE, 1.0 + DEPTH_SHARE);
        let rotation = along_normal(point.normal, stream.uniform(0.0, TAU));
        Some(pose_from_parts(rotation, point.at_m - point.normal * depth_m))
    }
}

/// Grasps from all sources in turn, each source in the order of its numbers.
pub(super) struct Supply<'a> {
    draw: &'a Draw<'a>,
    sources: Vec<Drawn>,
    /// How many turns there were.
    turns: u64,
}

/// What was drawn from a source, and how far.
struct Drawn {
    source: GraspSource,
    share: f32,
    next_number: u64,
    last_number: u64,
    ready: VecDeque<(u64, Pose)>,
}

impl<'a> Supply<'a> {
    pub(super) fn new(draw: &'a Draw<'a>) -> Self {
        let GraspShares { antipodal, normal, displaced } = draw.params.shares;
        let sources = [GraspSource::Antipodal, GraspSource::Normal, GraspSource::Displaced];
        let drawn = |(place, (source, share)): (u64, (GraspSource, f32))| {
            let first = place << 30;
            let last_number = first + NUMBERS_MIN + NUMBERS_A_GRASP * draw.params.grasps as u64;
            Drawn { source, share, next_number: first, last_number, ready: VecDeque::new() }
        };
        let sources = (0..).zip(sources.into_iter().zip([antipodal, normal, displaced])).map(drawn);
        Self { draw, sources: sources.filter(|drawn| drawn.share > 0.0).collect(), turns: 0 }
    }

    /// The next grasps with their numbers, at most so many; none if no source has any more.
    pub(super) fn next(&mut self, count: usize) -> Vec<(u64, Pose, GraspSource)> {
        let all: f32 = self.sources.iter().map(|drawn| drawn.share).sum();
        let mut drawn = Vec::with_capacity(count);
        while drawn.len() < count && !self.sources.is_empty() {
            let mut place = ((self.turns as f64 * TURN).fract() as f32) * all;
            self.turns += 1;
            let turn = self.sources.iter().position(|drawn| {
                place -= drawn.share;
                place < 0.0
            });
            let source = &mut self.sources[turn.unwrap_or(0)];
            if source.ready.is_empty() {
                source.draw_more(self.draw);
            }
            match source.ready.pop_front() {
                Some((number, pose)) => drawn.push((number, pose, source.source)),
                // The first that has no more ends all: their shares are what was asked for.
                None => self.sources.clear(),
            }
        }
        drawn
    }
}

impl Drawn {
    fn draw_more(&mut self, draw: &Draw<'_>) {
        while self.ready.is_empty() && self.next_number < self.last_number {
            let first = self.next_number;
            self.next_number = (first + NUMBERS_CHUNK).min(self.last_number);
            let one = |number: u64| Some((number, draw.grasp(number, self.source)?));
            let more: Vec<(u64, Pose)> = (first..self.next_number).into_par_iter().filter_map(one).collect();
            self.ready.extend(more);
        }
    }
}

/// The orientation that closes along a direction, its approach turned about it.
fn closing_along(closing: Vec3, angle_rad: f32) -> Quat {
    let start = if closing.z.abs() < 0.9 { Vec3::Z } else { Vec3::X };
    let x = closing.cross(start).normalize();
    let untilted = Quat::from_mat3(&Mat3::from_cols(x, closing, x.cross(closing)));
    (untilted * axis_angle(Vec3::Y, angle_rad)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gripper_that_closes_along_a_direction_does_so_from_every_side() {
        for closing in [Vec3::X, -Vec3::Z, Vec3::new(0.3, -0.5, 0.7).normalize()] {
            for turn in 0..7 {
                let rotation = closing_along(closing, turn as f32);
                assert!((rotation * Vec3::Y - closing).length() < 1e-5, "{closing}");
                let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| rotation * axis);
                assert!((x.cross(y) - z).length() < 1e-5);
            }
        }
    }

    /// As many of the first so many fall into each half of each of the five directions, and into each quarter of two.
    #[test]
    fn numbers_fill_the_cube_evenly_from_the_first() {
        for count in [64_u64, 500, 2_000] {
            let points: Vec<[f32; 5]> = (0..count).map(Draw::spread).collect();
            for a in 0..5 {
                for b in a + 1..5 {
                    let in_quarter = points.iter().filter(|p| p[a] < 0.5 && p[b] < 0.5).count() as f32;
                    let share = in_quarter / count as f32;
                    assert!((share - 0.25).abs() < 2.5 / (count as f32).sqrt() * 0.25, "{count}: {a} {b} {share}");
                }
            }
        }
    }
}
