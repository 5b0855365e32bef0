//! Turned and shifted training scenes, after VGN's augmentation (`apply_transform` in its `src/vgn/dataset.py`).
//!
//! A scene is turned by a number of quarter turns about the vertical through the middle of the volume, mirrored, and
//! shifted up or down by whole voxels. All map voxels to voxels, so the grid is permuted, never interpolated; the
//! supervised voxel and the grasp's orientation move along, and a half turn about the approach stays one. What is
//! shifted out at one end is lost and zeros enter at the other: in VGN's value convention 0 is "not observed or far
//! from a surface", and VGN fills with it too.
//!
//! Where it differs from VGN, and why. VGN draws for each sample; here the samples of a scene move together within an
//! epoch, so that its grid is still encoded once for all of them, and the draw is a pure function of (seed, epoch,
//! scene), whatever batches the samples are in. VGN moves the supervised voxel to a height drawn from U(6, 34); here
//! the scene is shifted by a whole number up to a limit, and never so far that one of its samples leaves the volume.
//! VGN turns about voxel 20, half a voxel beside the middle, and loses a row of voxels; here nothing is lost in
//! turning. VGN does not mirror. A mirrored scene is as likely as the scene, because gravity, the four shapes and the
//! gripper have a plane of symmetry; its grasp is the mirrored one with the fingers exchanged.

use core::f32::consts::FRAC_1_SQRT_2;
use core::ops::RangeInclusive;
use std::sync::Arc;

use schema::{Purpose, Quat, Stream};
use serde::Serialize;
use settings::settings;

use network::receptive_field::RESOLUTION;

settings! {
    /// Which motions are drawn.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
    pub struct Augmentation {
        /// Turns by 0°, 90°, 180° or 270° about the vertical, each as likely.
        pub quarter_turns: bool; or false,
        /// Mirrored in a vertical plane, or not, each as likely.
        #[serde(skip_serializing_if = "core::ops::Not::not")]
        pub mirrors: bool; or false,
        /// Most voxels by which a scene is shifted up or down.
        pub shift_z_voxels_max: usize where 0..=RESOLUTION - 1; or 0,
    }
}

impl Augmentation {
    /// None: the paper's.
    pub const OFF: Self = Self { quarter_turns: false, mirrors: false, shift_z_voxels_max: 0 };

    /// The motion of a scene in an epoch, whose samples lie at heights of `samples_z` voxels: of the shifts that keep
    /// them in the volume, each is as likely.
    #[must_use]
    pub fn draw(&self, seed: u64, epoch: u32, scene: u64, samples_z: RangeInclusive<usize>) -> Motion {
        let mut stream = Stream::new(seed, scene, Purpose::Augmentation, epoch);
        // Drawn whether wanted or not, so that each motion is the same with others and without.
        let turns = stream.index(4);
        let down = self.shift_z_voxels_max.min(*samples_z.start());
        let up = self.shift_z_voxels_max.min(RESOLUTION - 1 - samples_z.end());
        let shift_z_voxels = stream.index(down + up + 1) as isize - down as isize;
        let mirrored = self.mirrors & (stream.index(2) == 1);
        Motion { mirrored, quarter_turns: if self.quarter_turns { turns } else { 0 }, shift_z_voxels }
    }
}

/// A motion that maps voxels to voxels: a reflection of x in the middle of the volume, then quarter turns about its
/// vertical axis (x to y), then a shift along z.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Motion {
    /// Whether it is a reflection.
    pub mirrored: bool,
    /// Quarter turns, 0 to 3.
    pub quarter_turns: usize,
    /// Voxels upwards.
    pub shift_z_voxels: isize,
}

impl Motion {
    /// Everything stays.
    pub const NONE: Self = Self { mirrored: false, quarter_turns: 0, shift_z_voxels: 0 };

    /// A grid of 40³ values after the motion; the same grid if nothing moves.
    #[must_use]
    pub fn grid(&self, values: &Arc<[f32]>) -> Arc<[f32]> {
        if *self == Self::NONE {
            return Arc::clone(values);
        }
        const N: usize = RESOLUTION;
        let mut moved = vec![0.0; values.len()];
        let lost = self.shift_z_voxels.unsigned_abs().min(N);
        // Along z, what stays inside is one run.
        let (from, to) = if self.shift_z_voxels < 0 { (lost, 0) } else { (0, lost) };
        for column in 0..N * N {
            let [i, j] = self.turn([column / N, column % N]);
            let run = &values[column * N + from..][..N - lost];
            moved[(i * N + j) * N + to..][..N - lost].copy_from_slice(run);
        }
        moved.into()
    }

    /// Where a voxel comes to lie.
    ///
    /// # Panics
    /// If it leaves the volume.
    #[must_use]
    pub fn voxel(&self, [i, j, k]: [usize; 3]) -> [usize; 3] {
        let [i, j] = self.turn([i, j]);
        let k = k.checked_add_signed(self.shift_z_voxels).filter(|k| *k < RESOLUTION);
        [i, j, k.expect("a scene is never shifted so far that a sample leaves the volume")]
    }

    /// An offset from a voxel after the motion.
    #[must_use]
    pub fn offset(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let [x, y] = (0..self.quarter_turns).fold([if self.mirrored { -x } else { x }, y], |[x, y], _| [-y, x]);
        [x, y, z]
    }

    /// A grasp's orientation after the motion. A mirrored gripper has its fingers exchanged, which makes it a rotation.
    #[must_use]
    pub fn rotation(&self, rotation: Quat) -> Quat {
        let half = [
            Quat::IDENTITY,
            Quat::from_xyzw(0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2),
            Quat::from_xyzw(0.0, 0.0, 1.0, 0.0),
            Quat::from_xyzw(0.0, 0.0, FRAC_1_SQRT_2, -FRAC_1_SQRT_2),
        ];
        let Quat { x, y, z, w } = rotation;
        let rotation = if self.mirrored { Quat::from_xyzw(x, -y, -z, w) } else { rotation };
        if self.quarter_turns == 0 { rotation } else { half[self.quarter_turns % 4] * rotation }
    }

    fn turn(&self, [i, j]: [usize; 2]) -> [usize; 2] {
        let column = [if self.mirrored { RESOLUTION - 1 - i } else { i }, j];
        (0..self.quarter_turns).fold(column, |[i, j], _| [RESOLUTION - 1 - j, i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel::loss::half_turn;
    use schema::{Vec3, axis_angle};

    const N: usize = RESOLUTION;

    fn grid_of(value: impl Fn(Vec3) -> f32) -> Arc<[f32]> {
        let at = |at: usize| Vec3::new((at / (N * N)) as f32, (at / N % N) as f32, (at % N) as f32) + 0.5;
        (0..N.pow(3)).map(|voxel| value(at(voxel))).collect()
    }

    fn motions() -> impl Iterator<Item = Motion> {
        let turns = (0..8).map(|number| (number >= 4, number % 4));
        turns.flat_map(|(mirrored, quarter_turns)| {
            [-9, 0, 4].map(|shift_z_voxels| Motion { mirrored, quarter_turns, shift_z_voxels })
        })
    }

    /// A point, in voxels, after the motion: by the closed form of a reflection and a rotation about the middle.
    fn moved(motion: Motion, point: Vec3) -> Vec3 {
        let (sin, cos) = [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][motion.quarter_turns];
        let (x, y) = (point.x - N as f32 / 2.0, point.y - N as f32 / 2.0);
        let x = if motion.mirrored { -x } else { x };
        Vec3::new(cos * x - sin * y, sin * x + cos * y, 0.0)
            + Vec3::new(N as f32 / 2.0, N as f32 / 2.0, point.z + motion.shift_z_voxels as f32)
    }

    #[test]
    fn four_quarter_turns_are_none() {
        let turn = Motion { quarter_turns: 1, ..Motion::NONE };
        let grid = grid_of(|p| p.x + 100.0 * p.y + 10_000.0 * p.z);
        let back = (0..4).fold(Arc::clone(&grid), |grid, _| turn.grid(&grid));
        assert_eq!(back, grid);
        assert_ne!(turn.grid(&grid), grid);
        assert_eq!((0..4).fold([3, 17, 25], |voxel, _| turn.voxel(voxel)), [3, 17, 25]);
        let rotation = axis_angle(Vec3::new(0.6, 0.0, 0.8), 1.1);
        let back = (0..4).fold(rotation, |rotation, _| turn.rotation(rotation));
        assert!(back.dot(rotation).abs() > 1.0 - 1e-6, "{back} {rotation}");
        for quarter_turns in 0..4 {
            let (at_once, one_by_one) = (Motion { quarter_turns, ..Motion::NONE }, vec![turn; quarter_turns]);
            assert_eq!(at_once.grid(&grid), one_by_one.iter().fold(Arc::clone(&grid), |grid, turn| turn.grid(&grid)));
            let apart = one_by_one.iter().fold(rotation, |rotation, turn| turn.rotation(rotation));
            assert!(apart.dot(at_once.rotation(rotation)).abs() > 1.0 - 1e-6);
        }
    }

    /// Truncated distance to a box with unlike sides beside the middle, in VGN's values; exact in half voxels.
    fn box_values(centre: Vec3, half: Vec3) -> impl Fn(Vec3) -> f32 {
        move |point| {
            let apart = (point - centre).abs() - half;
            let distance = (apart.max_element() / 4.0).clamp(-1.0, 1.0);
            if distance.abs() < 0.98 { 0.5 * (distance + 1.0) } else { 0.0 }
        }
    }

    #[test]
    fn a_moved_grid_is_the_grid_of_the_moved_scene() {
        let (centre, half) = (Vec3::new(14.5, 22.0, 17.0), Vec3::new(6.0, 3.5, 2.5));
        let before = grid_of(box_values(centre, half));
        for motion in motions() {
            let half = if motion.quarter_turns % 2 == 1 { Vec3::new(half.y, half.x, half.z) } else { half };
            assert_eq!(motion.grid(&before), grid_of(box_values(moved(motion, centre), half)), "{motion:?}");
        }
    }

    /// The supervised voxel, the finger tips' voxels and the ones behind the gripper hold what they held before.
    #[test]
    fn the_gripper_keeps_its_place_in_the_scene() {
        let mut draw = Stream::new(4, 0, Purpose::Views, 0);
        let grid: Arc<[f32]> = (0..N.pow(3)).map(|_| draw.uniform(0.0, 1.0)).collect();
        let voxel_at = |p: Vec3| [p.x, p.y, p.z].map(|x| x.floor() as usize);
        let value = |grid: &[f32], [i, j, k]: [usize; 3]| grid[(i * N + j) * N + k];
        let clear = |p: Vec3| [p.x, p.y, p.z].iter().all(|x| (x - x.floor() - 0.5).abs() < 0.499);
        let mut seen = 0;
        for _ in 0..200 {
            let voxel = [12 + draw.index(16), 12 + draw.index(16), 18 + draw.index(8)];
            let (rotation, width) = (draw.rotation(), draw.uniform(2.0, 10.0));
            for motion in motions() {
                let after = motion.grid(&grid);
                let (voxel_after, rotation_after) = (motion.voxel(voxel), motion.rotation(rotation));
                let offset = Vec3::from_array(motion.offset((rotation * Vec3::Z).to_array()));
                assert!((offset - rotation_after * Vec3::Z).length() < 1e-5, "{motion:?}");
                assert_eq!(value(&after, voxel_after), value(&grid, voxel));
                let turned = motion.rotation(half_turn(rotation)).dot(half_turn(rotation_after));
                assert!(turned.abs() > 1.0 - 1e-5, "a half turn stays one: {turned}");
                for part in [Vec3::Y * width / 2.0, Vec3::Y * -width / 2.0, Vec3::Z * -8.0, Vec3::X * 3.0] {
                    let middle = |[i, j, k]: [usize; 3]| Vec3::new(i as f32, j as f32, k as f32) + 0.5;
                    let was = middle(voxel) + rotation * part;
                    // Of a mirrored gripper, what was on one side is on the other.
                    let own = if motion.mirrored { Vec3::new(-part.x, part.y, part.z) } else { part };
                    let is = middle(voxel_after) + rotation_after * own;
                    assert!((is - moved(motion, was)).length() < 1e-4, "{motion:?}: {is} {}", moved(motion, was));
                    if clear(was) {
                        assert_eq!(value(&after, voxel_at(is)), value(&grid, voxel_at(was)), "{motion:?}");
                        seen += 1;
                    }
                }
            }
        }
        assert!(seen > 9_000, "{seen}");
    }

    #[test]
    fn draws_are_of_seed_epoch_and_scene_and_keep_samples_inside() {
        let both = Augmentation { quarter_turns: true, mirrors: true, shift_z_voxels_max: 5 };
        let draw = |augmentation: Augmentation, scene| augmentation.draw(3, 2, scene, 2..=38);
        let (mut turns, mut mirrored) = ([0; 4], 0);
        for scene in 0..4000 {
            let motion = draw(both, scene);
            assert_eq!(motion, draw(both, scene));
            assert!((-2..=1).contains(&motion.shift_z_voxels));
            turns[motion.quarter_turns] += 1;
            mirrored += usize::from(motion.mirrored);
            let turned = draw(Augmentation { shift_z_voxels_max: 0, ..both }, scene);
            assert_eq!(turned, Motion { shift_z_voxels: 0, ..motion });
            let shifted = draw(Augmentation { quarter_turns: false, ..both }, scene);
            assert_eq!(shifted, Motion { quarter_turns: 0, ..motion });
            let unmirrored = draw(Augmentation { mirrors: false, ..both }, scene);
            assert_eq!(unmirrored, Motion { mirrored: false, ..motion });
            assert_eq!(draw(Augmentation::OFF, scene), Motion::NONE);
        }
        assert!(turns.iter().all(|count| (880..1120).contains(count)), "{turns:?}");
        assert!((1850..2150).contains(&mirrored), "{mirrored}");
        let others = (0..50).filter(|scene| both.draw(3, 3, *scene, 2..=38) != draw(both, *scene)).count();
        assert!(others > 30, "another epoch draws anew: {others}");
    }

    #[test]
    fn no_motion_is_the_same_memory() {
        let grid = grid_of(|p| p.x);
        assert!(Arc::ptr_eq(&grid, &Motion::NONE.grid(&grid)));
    }
}
