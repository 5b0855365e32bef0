//! What the network answers at a voxel: one grasp, as the paper has it, or a grasp by closing direction.
//!
//! A quaternion says one closing direction. Where two are right, or half a turn apart are the same, what it learns is
//! their mean. The *head by closing* says instead
//!
//! - the approach, as a direction;
//! - how likely each closing direction is: a histogram over half a turn, because the fingers are alike. It has as many
//!   peaks as there are ways to grip;
//! - quality and width for any closing direction, as `a + b cos 2φ + c sin 2φ` of its turn φ: two crossed ways to grip
//!   have values of their own;
//! - where the point between the finger tips is, seen from the voxel.
//!
//! The *turn* of a grasp is that about its approach, from the grasp that the shortest rotation makes of one that comes
//! from straight above with its closing direction along −y.

use core::f32::consts::PI;

use schema::{Quat, Vec3};
use settings::words;

use crate::layers::{LAYERS, LayerShape, NORM_SQUARED_MIN, layer};

words! {
    /// What the network answers at a voxel.
    pub enum Head {
        /// The paper's: a quality, one orientation as a quaternion, a width.
        Quaternion = "quaternion",
        /// An approach, the likely closing directions, and quality and width by closing direction.
        Closings = "closings",
    }
}

/// Closing directions that are told apart, over half a turn.
pub const TURNS: usize = 15;

/// The layers of the head by closing, after the six that all networks share.
pub(crate) const CLOSINGS: [LayerShape; 11] = [
    LAYERS[0],
    LAYERS[1],
    LAYERS[2],
    LAYERS[3],
    LAYERS[4],
    LAYERS[5],
    layer("conv_qual", 16, 3, 5, 1),
    layer("conv_approach", 16, 3, 5, 1),
    layer("conv_turn", 16, TURNS, 5, 1),
    layer("conv_width", 16, 3, 5, 1),
    layer("conv_tips", 16, 3, 5, 1),
];

impl Head {
    /// The layers of a network with this head, in the order of their parameters.
    #[must_use]
    pub const fn layers(self) -> &'static [LayerShape] {
        match self {
            Self::Quaternion => &LAYERS,
            Self::Closings => &CLOSINGS,
        }
    }

    /// Numbers that it gives at a voxel: the channels of its layers, one layer after the other.
    #[must_use]
    pub const fn outputs(self) -> usize {
        match self {
            Self::Quaternion => 6,
            Self::Closings => ClosingsHead::OUTPUTS,
        }
    }

    /// The grasp that a voxel answers with, given its outputs.
    ///
    /// # Panics
    /// If there are fewer outputs than [`Self::outputs`].
    #[must_use]
    pub fn answer(self, outputs: &[f32]) -> Answer {
        match self {
            Self::Quaternion => {
                let &[quality_logit, x, y, z, w, width_voxels] = outputs.first_chunk().expect("six outputs a voxel");
                let norm = (x * x + y * y + z * z + w * w).max(NORM_SQUARED_MIN).sqrt();
                let rotation = [x, y, z, w].map(|part| part / norm);
                Answer { quality_logit, rotation, width_voxels, tips_voxels: None }
            }
            Self::Closings => ClosingsHead::new(outputs).answer(),
        }
    }
}

/// A grasp that a voxel answers with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Logit of its quality.
    pub quality_logit: f32,
    /// Its orientation: a unit quaternion xyzw, or zeros where the network gave none.
    pub rotation: [f32; 4],
    /// Its opening, in voxels.
    pub width_voxels: f32,
    /// The point between its tips as seen from the centre of the voxel, in voxels, if the head says it.
    pub tips_voxels: Option<[f32; 3]>,
}

/// The outputs of the head by closing at a voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosingsHead {
    /// Factors of the logit of the quality for [`waves`].
    pub quality: [f32; 3],
    /// The approach, of any length.
    pub approach: [f32; 3],
    /// Logits of the histogram of turns.
    pub turns: [f32; TURNS],
    /// Factors of the width in voxels for [`waves`].
    pub width_voxels: [f32; 3],
    /// The point between the tips as seen from the centre of the voxel, in voxels.
    pub tips_voxels: [f32; 3],
}

impl ClosingsHead {
    /// How many there are.
    pub const OUTPUTS: usize = 12 + TURNS;

    /// From the outputs in their order.
    ///
    /// # Panics
    /// If there are fewer than [`Self::OUTPUTS`].
    #[must_use]
    pub fn new(outputs: &[f32]) -> Self {
        let part = |from: usize| core::array::from_fn(|at| outputs[from + at]);
        Self {
            quality: part(0),
            approach: part(3),
            turns: core::array::from_fn(|at| outputs[6 + at]),
            width_voxels: part(6 + TURNS),
            tips_voxels: part(9 + TURNS),
        }
    }

    /// The outputs in their order.
    #[must_use]
    pub fn outputs(&self) -> [f32; Self::OUTPUTS] {
        let Self { quality, approach, turns, width_voxels, tips_voxels } = self;
        let mut parts = quality.iter().chain(approach).chain(turns).chain(width_voxels).chain(tips_voxels);
        core::array::from_fn(|_| *parts.next().expect("as many parts as outputs"))
    }

    /// The approach as a unit vector, and the length that it had.
    #[must_use]
    pub fn approach(&self) -> (Vec3, f32) {
        let raw = Vec3::from_array(self.approach);
        let length = raw.length_squared().max(NORM_SQUARED_MIN).sqrt();
        (raw / length, length)
    }

    /// How likely each turn of the histogram is.
    #[must_use]
    pub fn shares(&self) -> [f32; TURNS] {
        let most = self.turns.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let shares = self.turns.map(|logit| libm::expf(logit - most));
        let sum: f32 = shares.iter().sum();
        shares.map(|share| share / sum)
    }

    /// The logit of the quality at a turn.
    #[must_use]
    pub fn quality_logit(&self, turn_rad: f32) -> f32 {
        at_turn(&self.quality, turn_rad)
    }

    /// The width at a turn.
    #[must_use]
    pub fn width_voxels(&self, turn_rad: f32) -> f32 {
        at_turn(&self.width_voxels, turn_rad)
    }

    /// The grasp at the peak of the histogram at which most grasps hold: quality times share, the share being that of
    /// the peak and its two neighbours.
    #[must_use]
    pub fn answer(&self) -> Answer {
        let shares = self.shares();
        let around = |at: usize| [TURNS - 1, 0, 1].map(|by| shares[(at + by) % TURNS]);
        let mut best = (f32::NEG_INFINITY, 0.0, 0.0);
        for at in 0..TURNS {
            let [before, own, after] = around(at);
            if own < before || own < after {
                continue;
            }
            let share = before + own + after;
            let turn_rad = (at as f32 + (after - before) / share) * (PI / TURNS as f32);
            let quality_logit = self.quality_logit(turn_rad);
            let score = share / (1.0 + libm::expf(-quality_logit));
            if score > best.0 {
                best = (score, turn_rad, quality_logit);
            }
        }
        let (_, turn_rad, quality_logit) = best;
        let rotation = grasp_rotation(self.approach().0, turn_rad).to_array();
        let tips_voxels = Some(self.tips_voxels);
        Answer { quality_logit, rotation, width_voxels: self.width_voxels(turn_rad), tips_voxels }
    }
}

/// 1, cos 2φ and sin 2φ of a turn φ: the same half a turn later.
#[must_use]
pub fn waves(turn_rad: f32) -> [f32; 3] {
    [1.0, libm::cosf(2.0 * turn_rad), libm::sinf(2.0 * turn_rad)]
}

fn at_turn(factors: &[f32; 3], turn_rad: f32) -> f32 {
    waves(turn_rad).iter().zip(factors).map(|(wave, factor)| wave * factor).sum()
}

/// The grasp with an approach and a turn of 0.
fn unturned(approach: Vec3) -> Quat {
    let down = -Vec3::Z;
    let (across, along) = (down.cross(approach), down.dot(approach));
    // Straight up every axis across is as short.
    let shortest = if along < -0.999_999 {
        Quat::from_xyzw(1.0, 0.0, 0.0, 0.0)
    } else {
        Quat::from_xyzw(across.x, across.y, across.z, 1.0 + along).normalize()
    };
    shortest * Quat::from_xyzw(1.0, 0.0, 0.0, 0.0)
}

/// The turn of a grasp about its approach, at least 0 and below π.
#[must_use]
pub fn turn_of(rotation: Quat) -> f32 {
    let left = unturned(rotation * Vec3::Z).inverse() * rotation;
    let turn_rad = (2.0 * libm::atan2f(left.z, left.w)).rem_euclid(PI);
    if turn_rad < PI { turn_rad } else { 0.0 }
}

/// The grasp with an approach, a unit vector, and a turn.
#[must_use]
pub fn grasp_rotation(approach: Vec3, turn_rad: f32) -> Quat {
    let (sin, cos) = (libm::sinf(0.5 * turn_rad), libm::cosf(0.5 * turn_rad));
    (unturned(approach) * Quat::from_xyzw(0.0, 0.0, sin, cos)).normalize()
}

/// A turn as shares of the two nearest ones of the histogram.
#[must_use]
pub fn shares_of(turn_rad: f32) -> [f32; TURNS] {
    let mut shares = [0.0; TURNS];
    let at = turn_rad * (TURNS as f32 / PI);
    let low = libm::floorf(at);
    shares[low as usize % TURNS] += 1.0 - (at - low);
    shares[(low as usize + 1) % TURNS] += at - low;
    shares
}

#[cfg(test)]
mod tests {
    use schema::{Purpose, Stream, axis_angle};

    use super::*;

    #[test]
    fn a_grasp_comes_back_from_its_approach_and_its_turn() {
        let mut stream = Stream::new(3, 1, Purpose::Weights, 0);
        for _ in 0..2_000 {
            let rotation = stream.rotation();
            let (approach, turn_rad) = (rotation * Vec3::Z, turn_of(rotation));
            assert!((0.0..PI).contains(&turn_rad));
            let back = grasp_rotation(approach, turn_rad);
            assert!((back * Vec3::Z - approach).length() < 2e-3, "{rotation}");
            assert!((back * Vec3::Y).dot(rotation * Vec3::Y).abs() > 0.9999, "{rotation}");
            let exchanged = turn_of(rotation * axis_angle(Vec3::Z, PI));
            let apart = (exchanged - turn_rad).abs();
            assert!(apart.min(PI - apart) < 2e-3, "exchanged fingers are the same closing");
        }
    }

    /// By hand: straight down with the closing direction along −y is no turn, along x a quarter.
    #[test]
    fn turns_from_straight_above_are_those_of_the_closing_direction() {
        for degrees in 0..180 {
            let turn_rad = (degrees as f32).to_radians();
            let rotation = grasp_rotation(-Vec3::Z, turn_rad);
            let closing = rotation * Vec3::Y;
            let expected = Vec3::new(-libm::sinf(turn_rad), -libm::cosf(turn_rad), 0.0);
            assert!((closing - expected).length() < 1e-5, "{degrees}: {closing}");
        }
    }

    fn head(shares: [f32; TURNS]) -> ClosingsHead {
        ClosingsHead {
            quality: [0.0; 3],
            approach: [0.0, 0.0, -2.0],
            turns: shares.map(|share| libm::logf(share.max(1e-6))),
            width_voxels: [6.0, 1.0, 0.0],
            tips_voxels: [1.0, 2.0, -6.0],
        }
    }

    fn turn_in(answer: &Answer) -> f32 {
        turn_of(Quat::from_array(answer.rotation))
    }

    #[test]
    fn a_histogram_of_one_turn_is_answered_by_it() {
        for degrees in 0..180 {
            let turn_rad = (degrees as f32).to_radians();
            let answer = head(shares_of(turn_rad)).answer();
            let off = (turn_in(&answer) - turn_rad).abs();
            assert!(off.min(PI - off) < 0.01, "{degrees} {off}");
            assert!((answer.width_voxels - 6.0 - libm::cosf(2.0 * turn_rad)).abs() < 0.03);
            assert_eq!(answer.tips_voxels, Some([1.0, 2.0, -6.0]));
        }
    }

    #[test]
    fn of_two_crossed_closings_the_better_is_answered() {
        let (one, other) = (0.4, 0.4 + core::f32::consts::FRAC_PI_2);
        let (here, there) = (shares_of(one), shares_of(other));
        let both = head(core::array::from_fn(|at| 0.6 * here[at] + 0.4 * there[at]));
        assert!((turn_in(&both.answer()) - one).abs() < 0.01, "of equal quality the more likely");
        let [_, cos, sin] = waves(other);
        let second = ClosingsHead { quality: [0.0, 2.0 * cos, 2.0 * sin], ..both };
        assert!((turn_in(&second.answer()) - other).abs() < 0.01, "less likely, but it holds");
        assert!((second.answer().quality_logit - 2.0).abs() < 0.01);
    }

    #[test]
    fn outputs_come_back_in_their_order() {
        let outputs: [f32; ClosingsHead::OUTPUTS] = core::array::from_fn(|at| at as f32);
        assert_eq!(ClosingsHead::new(&outputs).outputs(), outputs);
        for kind in Head::ALL {
            let channels: usize = kind.layers()[LAYERS.len() - 3..].iter().map(|layer| layer.channels_out).sum();
            assert_eq!(kind.outputs(), channels);
        }
    }
}
