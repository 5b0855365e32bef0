//! Grasps of an object alone, before anybody tried them: numbered, each a pure function of the seed and its number, and
//! the first so many of them spread over the object, however many are wanted.
//!
//! Two facing points are gripped as people do it. Pads that lie flat press on patches with a radius ρ, as long as the
//! gripper reaches in. Of skewed ones only edges and corners press, and half a degree can take three quarters of the
//! pull that a grip bears. No skew is so small that it does not matter, so none is the measure of all: skews are ninth
//! powers, half of them within a 512th of the cone of friction, a quarter beyond a 13th, and some at its end. By the
//! same law the approach is turned away from the longest edge of the face or the direction across it: along edges the
//! palm comes nearest, and the patches are longest. For the same reason most grasps are deep. A pull at a centre of
//! mass that is d beside the patches turns the object about the closing direction, and friction bears only ρ / (ρ + d)
//! of what it bears in the middle: a point is taken as often as that, so that every place has its turn.

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
/// Sides from which the open gripper may try to come to two points: quarter turns, then those halfway between them.
const APPROACHES: u32 = 8;
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
const NUMBERS_CHUNK: u64 = 256;

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

    /// The middles between a point and those across from it, for each across from which a gripper can close: within the
    /// cones of both, and the open gripper is wider.
    pub(super) fn middles_m(&self, point: &SurfacePoint, inwards: Vec3) -> Vec<Vec3> {
        let bears = |normal: Vec3| {
            let along = normal.dot(inwards);
            along > 0.0 && normal.cross(inwards).length() <= self.friction * along
        };
        if !bears(-point.normal) {
            return Vec::new();
        }
        let widths_m = WIDTH_M_MIN..=self.params.gripper.span_m();
        let across = self.surface.inside(point.at_m, inwards).into_iter();
        let across = across.map(|of| self.surface.ended(of, point.at_m, inwards));
        let across = across.filter(|of| widths_m.contains(&of.exit_m) && bears(of.exit_normal));
        across.map(|of| point.at_m + inwards * (0.5 * of.exit_m)).collect()
    }

    /// A grasp that closes along a direction about a point, from the first of so many sides from which the gripper can
    /// come, the first being `around` turns away from `along`; the `deep` share of the way in.
    fn reached(&self, middle_m: Vec3, [closing, along]: [Vec3; 2], around: f32, deep: f32, sides: u32) -> Option<Pose> {
        let length_m = self.params.gripper.finger_length_m;
        (0..sides).find_map(|side| {
            let turns = 0.25 * (side % 4) as f32 + (side / 4) as f32 / sides as f32;
            let rotation = closing_along(closing, along, TAU * (around + turns));
            let approach = rotation * Vec3::Z;
            let deepest = pose_from_parts(rotation, middle_m + approach * length_m);
            let most_m = length_m - self.world.stops_short_m(&deepest)? - ROOM_M;
            let depth_m = DEPTH_M_MIN + deep * (most_m - DEPTH_M_MIN);
            let pose = pose_from_parts(rotation, middle_m + approach * depth_m);
            // Less deep, the gripper comes from further back.
            (most_m > DEPTH_M_MIN && self.world.is_reached(&pose)).then_some(pose)
        })
    }

    /// Whether a gripper can come and do so.
    pub(super) fn is_graspable(&self, point: &SurfacePoint) -> bool {
        let inwards = -point.normal;
        let mut middles_m = self.middles_m(point, inwards).into_iter();
        middles_m.any(|middle_m| self.reached(middle_m, [inwards, point.along], 0.0, 0.0, SIDES).is_some())
    }

    fn antipodal(&self, number: u64, stream: &mut Stream) -> Option<Pose> {
        let [along, u, v, around, deep] = Self::spread(number);
        let point = self.surface.point([along, u, v])?;
        let gripper = &self.params.gripper;
        let patch_m = 0.5 * libm::hypotf(gripper.finger_width_m, gripper.finger_length_m);
        let beside_m = (point.at_m - self.world.centre_of_mass_m()).cross(point.normal).length();
        if stream.uniform(0.0, patch_m + beside_m) > patch_m {
            return None;
        }
        let skew_rad = libm::atanf(self.friction) * mostly_little(stream.uniform(0.0, 1.0));
        let side = stream.uniform(0.0, TAU);
        let closing = along_normal(point.normal, side) * axis_angle(Vec3::X, skew_rad) * Vec3::Z;
        let middles_m = self.middles_m(&point, closing);
        if middles_m.is_empty() {
            return None;
        }
        let middle_m = middles_m[stream.index(middles_m.len())];
        let quarters = 4.0 * around;
        let around = 0.25 * (quarters.floor() + 0.5 * mostly_little(2.0 * quarters.fract() - 1.0));
        let reached = self.reached(middle_m, [closing, point.along], around, 1.0 - deep * deep, APPROACHES);
        reached.map(|pose| self.world.beside_fixed_jaw(&pose))
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

/// Makes of numbers that are spread evenly between -1 and 1 such that are mostly near 0.
fn mostly_little(number: f32) -> f32 {
    let cube = number * number * number;
    cube * cube * cube
}

/// The orientation that closes along a direction, its approach turned about it from another.
fn closing_along(closing: Vec3, along: Vec3, angle_rad: f32) -> Quat {
    let x = closing.cross(along).normalize();
    let unturned = Quat::from_mat3(&Mat3::from_cols(x, closing, x.cross(closing)));
    (unturned * axis_angle(Vec3::Y, angle_rad)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gripper_that_closes_along_a_direction_does_so_from_every_side() {
        for closing in [Vec3::X, -Vec3::Z, Vec3::new(0.3, -0.5, 0.7).normalize()] {
            let along = closing.any_orthonormal_vector();
            assert!((closing_along(closing, along + closing, 0.0) * Vec3::Z - along).length() < 1e-5, "{closing}");
            for turn in 0..7 {
                let rotation = closing_along(closing, along, turn as f32);
                assert!((rotation * Vec3::Y - closing).length() < 1e-5, "{closing}");
                let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| rotation * axis);
                assert!((x.cross(y) - z).length() < 1e-5);
            }
        }
    }

    #[test]
    fn half_of_the_numbers_are_little_and_some_reach_the_ends() {
        let numbers: Vec<f32> = (0..=2_000).map(|n| mostly_little(n as f32 / 1_000.0 - 1.0)).collect();
        let within = |most: f32| numbers.iter().filter(|number| number.abs() <= most).count();
        assert_eq!([within(1.0 / 512.0), within(0.5), within(1.0)], [1_001, 1_851, 2_001]);
        assert!(numbers.is_sorted() && numbers[0] < -0.99 && numbers[2_000] > 0.99);
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
