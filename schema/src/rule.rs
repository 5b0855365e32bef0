//! The rules that grasps are drawn by, by name: the rows of the paper's Appendix A, and VGN's approach along the
//! surface's normal. `law.rs` has the distributions of the rows.

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

/// A row of Appendix A: a shape and the object axis along which it is approached. Without an axis: the shape is
/// approached along its surface's normal, as VGN's grasps are; models never are otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Rule {
    /// The shape.
    pub shape: Shape,
    /// The object axis of the approach; `None` along the surface's normal.
    pub approach: Option<Axis>,
}

impl Rule {
    /// The twelve rows of Appendix A.
    #[must_use]
    pub fn all() -> [Self; 12] {
        core::array::from_fn(|i| Self { shape: ShapeKind::ALL[i / 3].into(), approach: Some(Axis::ALL[i % 3]) })
    }

    /// The four approaches along the surface's normal.
    #[must_use]
    pub fn along_normals() -> [Self; 4] {
        ShapeKind::ALL.map(|kind| Self { shape: kind.into(), approach: None })
    }

    /// The approach to a model, along its surface's normal. All models share the rule's name.
    #[must_use]
    pub fn of_model(number: u16) -> Self {
        Self { shape: Shape::Model(number), approach: None }
    }

    /// Place among all rules' names: [`Self::all`], then [`Self::along_normals`], then that of all models.
    #[must_use]
    pub fn index(self) -> usize {
        let Shape::Primitive(kind) = self.shape else { return 16 };
        let shape = kind as usize;
        self.approach.map_or(12 + shape, |axis| 3 * shape + axis as usize)
    }

    /// The name in shards and reports, such as `tri_prism_x`.
    #[must_use]
    pub fn name(self) -> &'static str {
        const NAMES: [[&str; 4]; 4] = [
            ["cuboid_x", "cuboid_y", "cuboid_z", "cuboid_normal"],
            ["cylinder_x", "cylinder_y", "cylinder_z", "cylinder_normal"],
            ["tri_prism_x", "tri_prism_y", "tri_prism_z", "tri_prism_normal"],
            ["half_cylinder_x", "half_cylinder_y", "half_cylinder_z", "half_cylinder_normal"],
        ];
        let Shape::Primitive(kind) = self.shape else { return "model_normal" };
        NAMES[kind as usize][self.approach.map_or(3, |axis| axis as usize)]
    }

    /// The rule with this name; of the models', whose name does not say which, the first's.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        let all = Self::all().into_iter().chain(Self::along_normals()).chain([Self::of_model(0)]);
        all.into_iter().find(|rule| rule.name() == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_shape_and_axis_and_lead_back() {
        for (place, rule) in Rule::all().into_iter().chain(Rule::along_normals()).enumerate() {
            let approach = rule.approach.map_or("normal", Axis::name);
            assert_eq!(rule.name(), format!("{}_{approach}", rule.shape.name(&[])));
            assert_eq!((Rule::from_name(rule.name()), rule.index()), (Some(rule), place));
        }
        assert_eq!((Rule::of_model(7).name(), Rule::of_model(7).index()), ("model_normal", 16));
        assert_eq!(Rule::from_name("model_normal"), Some(Rule::of_model(0)));
    }
}
