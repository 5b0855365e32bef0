//! The law by which an object alone is gripped, and what a grip is put to.

use core::f32::consts::PI;

use schema::{GripTest, Gripper, Physics, Procedure, Vec3};
use simulator::{Hold, Load, Shake};

/// Standard gravity, in m/s².
pub(super) const G_M_S2: f32 = 9.806_65;
/// An object is held if it ends between both fingers, having moved by no more than 10 mm and turned by no more than 20
/// degrees against them. The margins ask for the same, and all tests but the lift.
pub(super) const HOLD: Hold = Hold { moved_m_max: 0.01, turned_rad_max: 0.349 };
/// A lift asks, as scenes do, only that it comes along for half of the way, however it swings: so a robot's counts.
const LIFTED: Hold = Hold { moved_m_max: 0.05, turned_rad_max: PI };
/// How long a pull lasts, in seconds, but for those of GraspDataGen.
const PULL_S: f32 = 0.25;

/// The settings of every floating world. Blades and walls of cups are thinner than the 2 mm at which jaws have met in
/// scenes: here nothing is left between them. Fingers sink in half as deep as there: they cut through edges.
pub static PHYSICS: Physics = Physics { finger_depth_m_max: 0.000_05, ..Physics::STANDARD };
/// See [`PHYSICS`]. A jaw that goes alone needs twice the time of two.
pub static PROCEDURE: Procedure = Procedure { empty_width_m: 0.0001, close_time_s_max: 5.0, ..Procedure::PAPER };

/// The six directions of the gripper's axes, out of the gripper first.
pub(super) fn sides() -> [Vec3; 6] {
    [Vec3::Z, Vec3::X, -Vec3::X, -Vec3::Z, Vec3::Y, -Vec3::Y]
}

/// A pull of so many g in a direction.
pub(super) fn pull(direction: Vec3, g: f32) -> Load {
    Load::Pull { acceleration_m_s2: direction * (g * G_M_S2), time_s: PULL_S }
}

/// When an object counts as lost in a test.
pub(super) fn hold(test: GripTest) -> Hold {
    if test == GripTest::Lift { LIFTED } else { HOLD }
}

/// What the test puts a grip to.
pub(super) fn loads(test: GripTest, gripper: &Gripper) -> Vec<Load> {
    match test {
        GripTest::Lift => vec![pull(Vec3::Z, 1.0)],
        GripTest::Turn => sides().map(|direction| pull(direction, 1.0)).to_vec(),
        GripTest::Tug => [[0.0, 0.0], [2.0, 0.0], [-2.0, 0.0], [0.0, 2.0], [0.0, -2.0]]
            .map(|[x, y]| Vec3::new(x, y, 1.0).normalize() * G_M_S2)
            .map(|acceleration_m_s2| Load::Pull { acceleration_m_s2, time_s: 0.5 })
            .to_vec(),
        GripTest::Shake => {
            let base_m = gripper.finger_length_m + gripper.palm_length_m;
            vec![Load::Shake(Shake {
                way_m: Vec3::Z * 0.08,
                turn_rad: Vec3::Y,
                pivot_m: Vec3::Z * -base_m,
                rate_hz: 2.0,
                cycles: 2.0,
            })]
        }
    }
}

#[cfg(test)]
mod tests {
    use schema::{Pose, ShapeKind, Solid};
    use simulator::FloatingWorld;

    use super::*;

    /// At 50 mm/s it takes 1.3 s to where the cube is, twice as long as two fingers.
    #[test]
    fn one_jaw_alone_comes_to_a_small_cube() {
        let text = include_str!("../../../configs/grippers/parallel_jaw_80.toml");
        let gripper = Gripper::from_toml(&format!("{text}\njaws = [{{}}, {{ slide_m = [0.0, -0.08, 0.0] }}]")).unwrap();
        let cube = Solid::new(ShapeKind::Cuboid, Vec3::splat(0.015)).unwrap().into();
        let world = FloatingWorld::new(&PHYSICS, &gripper, &PROCEDURE, &cube, 0.05, 0.6);
        let grip = world.close(&Pose::from_translation(Vec3::new(0.0, 0.03, 0.005))).ok().unwrap();
        assert!((grip.width_m() - 0.015).abs() < 5e-4, "{}", grip.width_m());
    }
}
