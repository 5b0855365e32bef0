//! The rules that grasps are drawn by, by name: the rows of the paper's Appendix A, VGN's approach along the surface's
//! normal, proposals, and displaced grasps. `law.rs` has the distributions of the rows.

use settings::words;

use crate::{Shape, ShapeKind, Vec3};

words! {
    /// An axis of the object frame.
    #[derive(PartialOrd, Ord)]
    pub enum Axis {
        /// x.
        X = "x",
        /// y.
        Y = "y",
        /// z.
        Z = "z",
    }
}

impl Axis {
    /// Unit vector.
    #[must_use]
    pub fn unit(self) -> Vec3 {
        match self {
            Self::X => Vec3::X,
            Self::Y => Vec3::Y,
            Self::Z => Vec3::Z,
        }
    }

    /// The component of `v` along this axis.
    #[must_use]
    pub fn of(self, v: Vec3) -> f32 {
        self.unit().dot(v)
    }
}

/// How a grasp was drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Approach {
    /// Along an object axis, by a row of Appendix A.
    Axis(Axis),
    /// Along the surface's normal, as VGN's grasps are.
    Normal,
    /// A grasp candidate, proposed on what the cameras saw.
    Proposal,
    /// A grasp of the same scene that held, displaced.
    Displaced,
    /// A proposal that a judge holds for one of the best.
    Judged,
}

impl Approach {
    /// All of them; the first three are the axes.
    pub const ALL: [Self; 7] = [
        Self::Axis(Axis::X),
        Self::Axis(Axis::Y),
        Self::Axis(Axis::Z),
        Self::Normal,
        Self::Proposal,
        Self::Displaced,
        Self::Judged,
    ];

    /// The object axis.
    #[must_use]
    pub fn axis(self) -> Option<Axis> {
        if let Self::Axis(axis) = self { Some(axis) } else { None }
    }

    /// Place in [`Self::ALL`].
    #[must_use]
    pub fn index(self) -> usize {
        Self::ALL.into_iter().take_while(|other| *other != self).count()
    }

    /// The name in shards.
    #[must_use]
    pub fn name(self) -> &'static str {
        ["x", "y", "z", "normal", "proposal", "displaced", "judged"][self.index()]
    }

    /// The one with this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|approach| approach.name() == name)
    }
}

/// Names by shape, in the order of [`Approach::ALL`].
macro_rules! names {
    ($($shape:literal)*) => {
        [$([
            concat!($shape, "_x"),
            concat!($shape, "_y"),
            concat!($shape, "_z"),
            concat!($shape, "_normal"),
            concat!($shape, "_proposal"),
            concat!($shape, "_displaced"),
            concat!($shape, "_judged"),
        ]),*]
    };
}

/// Models are approached along no axis; `shards` refuses such rows.
const NAMES: [[&str; 7]; 5] = names!["cuboid" "cylinder" "tri_prism" "half_cylinder" "model"];

/// A target's shape and how the grasp was drawn. Models have no axes that Appendix A knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Rule {
    /// The shape.
    pub shape: Shape,
    /// How the grasp was drawn.
    pub approach: Approach,
}

impl Rule {
    /// The twelve rows of Appendix A.
    #[must_use]
    pub fn of_the_paper() -> [Self; 12] {
        core::array::from_fn(|i| Self { shape: ShapeKind::ALL[i / 3].into(), approach: Approach::ALL[i % 3] })
    }

    /// One rule for each name, in the order of [`Self::index`]. All models share a rule's name.
    pub fn all() -> impl Iterator<Item = Self> {
        let others = Approach::ALL[3..].iter().flat_map(|approach| {
            let shapes = ShapeKind::ALL.map(Shape::Primitive).into_iter().chain([Shape::Model(0)]);
            shapes.map(|shape| Self { shape, approach: *approach })
        });
        Self::of_the_paper().into_iter().chain(others)
    }

    /// The rule that stands for all with the same name.
    #[must_use]
    pub fn named(self) -> Self {
        let shape = if matches!(self.shape, Shape::Model(_)) { Shape::Model(0) } else { self.shape };
        Self { shape, ..self }
    }

    /// Place of the name among all.
    #[must_use]
    pub fn index(self) -> usize {
        let shape = if let Shape::Primitive(kind) = self.shape { kind as usize } else { 4 };
        match self.approach {
            Approach::Axis(axis) => 3 * shape + axis as usize,
            other => 12 + 5 * (other.index() - 3) + shape,
        }
    }

    /// The name in shards and reports, such as `tri_prism_x`.
    #[must_use]
    pub fn name(self) -> &'static str {
        let shape = if let Shape::Primitive(kind) = self.shape { kind as usize } else { 4 };
        NAMES[shape][self.approach.index()]
    }

    /// The rule with this name; of the models', whose name does not say which, the first's.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::all().find(|rule| rule.name() == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_shape_and_approach_and_lead_back() {
        let mut names = Vec::new();
        for (place, rule) in Rule::all().enumerate() {
            let shape = if let Shape::Primitive(kind) = rule.shape { kind.name() } else { "model" };
            assert_eq!(rule.name(), format!("{shape}_{}", rule.approach.name()));
            assert_eq!((Rule::from_name(rule.name()), rule.index()), (Some(rule), place));
            assert_eq!(Approach::from_name(rule.approach.name()), Some(rule.approach));
            names.push(rule.name());
        }
        // Twelve rows of Appendix A, then for each other approach the four shapes and all models.
        assert_eq!(names.len(), 12 + 4 * 5);
        let of_model = Rule { shape: Shape::Model(7), approach: Approach::Normal };
        assert_eq!((of_model.name(), of_model.index()), ("model_normal", 16));
        assert_eq!(of_model.named(), Rule { shape: Shape::Model(0), approach: Approach::Normal });
    }
}
