//! What objects lie in: a bin, a tray or a shelf that stands on the table and never moves.
//!
//! A container is a few numbers, from which its convex parts follow. It stands in the middle of the workspace, its
//! sides along the workspace's axes; the table is its floor.

use serde::{Deserialize, Serialize};
use settings::words;

use crate::{Grid, Polyhedron, Vec3};

words! {
    /// Kinds of containers.
    #[derive(PartialOrd, Ord, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum ContainerKind {
        /// Four walls.
        Bin = "bin",
        /// Four low walls.
        Tray = "tray",
        /// Two side walls, a back wall at +y and a board over them; it is open at −y.
        Shelf = "shelf",
    }
}

/// A container.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Container {
    /// Its kind.
    pub kind: ContainerKind,
    /// Lengths along x and y between the walls' upper edges, in metres.
    pub inner_m: [f32; 2],
    /// Height of the walls above the table, in metres; a shelf's board lies on them.
    pub height_m: f32,
    /// Thickness of walls and board, in metres, along the horizontal and the vertical.
    pub thickness_m: f32,
    /// How far the walls lean outwards, from the vertical.
    pub slope_rad: f32,
}

impl Container {
    /// Shortest and longest inner side, in metres.
    pub const INNER_M: [f32; 2] = [0.05, 2.5];
    /// Lowest and highest wall.
    pub const HEIGHT_M: [f32; 2] = [0.005, 1.0];
    /// Thinnest and thickest wall.
    pub const THICKNESS_M: [f32; 2] = [0.001, 0.1];
    /// Steepest and flattest wall.
    pub const SLOPE_RAD: [f32; 2] = [0.0, 0.6];

    /// Checks its numbers, and that it fits into a workspace.
    ///
    /// # Errors
    /// What is wrong.
    pub fn check(&self, grid: &Grid) -> Result<(), String> {
        let [x_m, y_m] = self.inner_m;
        // What the slope leaves of the floor.
        let floor_m = x_m.min(y_m) - 2.0 * self.lean_m();
        for (name, got, [least, most]) in [
            ("inner_x_m", x_m, Self::INNER_M),
            ("inner_y_m", y_m, Self::INNER_M),
            ("height_m", self.height_m, Self::HEIGHT_M),
            ("thickness_m", self.thickness_m, Self::THICKNESS_M),
            ("slope_rad", self.slope_rad, Self::SLOPE_RAD),
            ("floor", floor_m, Self::INNER_M),
        ] {
            if !(least..=most).contains(&got) {
                return Err(format!("a container's {name} must be between {least} and {most}, got {got}"));
            }
        }
        let [width_m, depth_m, height_m] = self.outer_m();
        let Grid { size_m, table_z_m, .. } = *grid;
        if width_m.max(depth_m) > size_m || table_z_m + height_m > size_m {
            return Err(format!(
                "a container must fit into a workspace of {size_m} m that has its table at {table_z_m} m"
            ));
        }
        Ok(())
    }

    /// Its numbers: inner lengths along x and y, height, thickness (in metres), slope (in radians).
    #[must_use]
    pub fn sizes(&self) -> [f32; 5] {
        let [x_m, y_m] = self.inner_m;
        [x_m, y_m, self.height_m, self.thickness_m, self.slope_rad]
    }

    /// The container of a kind with these numbers, as [`Self::sizes`] has them.
    #[must_use]
    pub fn of_sizes(kind: ContainerKind, [x_m, y_m, height_m, thickness_m, slope_rad]: [f32; 5]) -> Self {
        Self { kind, inner_m: [x_m, y_m], height_m, thickness_m, slope_rad }
    }

    /// Lengths of its bounding box along x, y and z, in metres.
    #[must_use]
    pub fn outer_m(&self) -> [f32; 3] {
        let [width_m, depth_m] = self.inner_m.map(|inner_m| inner_m + 2.0 * self.thickness_m);
        let board_m = if self.kind == ContainerKind::Shelf { self.thickness_m } else { 0.0 };
        [width_m, depth_m, self.height_m + board_m]
    }

    /// How much further out the walls are at their upper edges than at their feet, in metres.
    fn lean_m(&self) -> f32 {
        self.height_m * libm::tanf(self.slope_rad)
    }

    /// The lower and the upper corner of the box between the walls' feet, in the workspace, in metres; open upwards
    /// unless there is a board.
    #[must_use]
    pub fn free_m(&self, grid: &Grid) -> [Vec3; 2] {
        let [x_m, y_m] = self.inner_m.map(|inner_m| 0.5 * inner_m - self.lean_m());
        let (middle_m, half_m) = (Vec3::new(0.5 * grid.size_m, 0.5 * grid.size_m, 0.0), Vec3::new(x_m, y_m, 0.0));
        let top_m = if self.kind == ContainerKind::Shelf { grid.table_z_m + self.height_m } else { f32::INFINITY };
        [middle_m - half_m + Vec3::Z * grid.table_z_m, (middle_m + half_m).with_z(top_m)]
    }

    /// Its convex parts in the workspace: the walls at −x, +x, +y and −y, which meet in mitres, or the board in place
    /// of the last.
    ///
    /// # Panics
    /// If [`Self::check`] refuses it.
    #[must_use]
    pub fn parts(&self, grid: &Grid) -> Vec<Polyhedron> {
        let middle_m = Vec3::new(0.5 * grid.size_m, 0.5 * grid.size_m, grid.table_z_m);
        let corner = |[x, y]: [f32; 2], out_m: f32, z_m: f32| {
            let half_m = self.inner_m.map(|inner_m| 0.5 * inner_m + out_m);
            middle_m + Vec3::new(x * half_m[0], y * half_m[1], z_m)
        };
        let between = |ends: &[[f32; 2]], levels_m: &[[f32; 3]]| {
            let corners = levels_m.iter().flat_map(|[z_m, inner_m, outer_m]| {
                let at = move |end: &[f32; 2]| [corner(*end, *inner_m, *z_m), corner(*end, *outer_m, *z_m)];
                ends.iter().flat_map(at)
            });
            Polyhedron::hull_of(&corners.collect::<Vec<_>>()).expect("walls of a checked container are thick enough")
        };
        let (height_m, thickness_m, lean_m) = (self.height_m, self.thickness_m, self.lean_m());
        let wall = [[0.0, -lean_m, thickness_m - lean_m], [height_m, 0.0, thickness_m]];
        let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]];
        let [left, back, right, front] = [0, 1, 2, 3].map(|side| [corners[side], corners[(side + 1) % 4]]);
        let mut parts: Vec<Polyhedron> = [left, right, back].iter().map(|ends| between(ends, &wall)).collect();
        parts.push(match self.kind {
            ContainerKind::Bin | ContainerKind::Tray => between(&front, &wall),
            ContainerKind::Shelf => {
                // The inner and the outer outline lie in one face, so the inner one is dropped.
                between(&corners, &[height_m, height_m + thickness_m].map(|z_m| [z_m, 0.0, thickness_m]))
            }
        });
        parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounds_m;

    const BIN: Container = Container {
        kind: ContainerKind::Bin,
        inner_m: [0.26, 0.20],
        height_m: 0.1,
        thickness_m: 0.004,
        slope_rad: 0.1,
    };

    fn shelf() -> Container {
        Container { kind: ContainerKind::Shelf, slope_rad: 0.0, height_m: 0.2, ..BIN }
    }

    fn is_inside(part: &Polyhedron, point: Vec3) -> bool {
        part.planes().all(|plane| plane.normal.dot(point) <= plane.offset_m)
    }

    /// The share of a fine raster of points that the parts hold, times its volume, against the closed form; and no
    /// point is in two parts.
    #[test]
    fn the_parts_enclose_the_walls_and_do_not_overlap() {
        let grid = Grid::PAPER;
        for container in [BIN, Container { kind: ContainerKind::Tray, height_m: 0.02, ..BIN }, shelf()] {
            container.check(&grid).unwrap();
            let parts = container.parts(&grid);
            assert_eq!(parts.len(), 4);
            let volume_m3: f32 = parts.iter().map(Polyhedron::volume_m3).sum();
            // At every height a frame of the same thickness, whose outline shrinks with the slope.
            let (t, [x, y]) = (container.thickness_m, container.inner_m);
            let mean = |inner: f32| inner - container.height_m * libm::tanf(container.slope_rad);
            let frame_m2 = (mean(x) + 2.0 * t) * (mean(y) + 2.0 * t) - mean(x) * mean(y);
            let expected_m3 = match container.kind {
                ContainerKind::Shelf => {
                    (frame_m2 - t * (x + t)) * container.height_m + (x + 2.0 * t) * (y + 2.0 * t) * t
                }
                _ => frame_m2 * container.height_m,
            };
            // The inner outline of mitred walls: the corners lie on the diagonal.
            assert!((volume_m3 - expected_m3).abs() < 2e-3 * expected_m3, "{volume_m3} {expected_m3}");
            let [low, high] = bounds_m(parts.iter().flat_map(|part| part.corners_m()));
            let outer = Vec3::from_array(container.outer_m());
            assert!((high - low - outer).length() < 1e-6, "{low} {high} {outer}");
            assert!((0.5 * (low + high)).truncate().distance(Vec3::splat(0.15).truncate()) < 1e-6);
            assert!((low.z - grid.table_z_m).abs() < 1e-6);
            let inside = |point: Vec3| parts.iter().filter(|part| is_inside(part, point)).count();
            let mut walls = 0;
            for cell in 0..60 * 60 * 20 {
                // No point lies on a mitre.
                let [i, j, k] = [cell % 60, cell / 60 % 60, cell / 3_600].map(|n| n as f32);
                let at = Vec3::new(0.005 * (i + 0.41), 0.005 * (j + 0.17), 0.05 + 0.0125 * (k + 0.41));
                let count = inside(at);
                assert!(count <= 1, "{at:?}");
                walls += count;
            }
            assert!(walls > 50, "{walls}");
        }
    }

    #[test]
    fn walls_lean_outwards_and_a_shelf_is_open_at_the_front() {
        let grid = Grid::PAPER;
        let holds =
            |container: Container, point: Vec3| container.parts(&grid).iter().any(|part| is_inside(part, point));
        // The left wall's inner face is at 0.15 - 0.13 at the top and 10 mm further in at the foot.
        let [top, foot] = [0.1499, 0.0501].map(|z_m| Vec3::new(0.019, 0.15, z_m));
        assert!(holds(BIN, top) && !holds(BIN, foot) && holds(BIN, foot + Vec3::X * 0.009));
        let [front, back] = [0.15 - 0.102, 0.15 + 0.102].map(|y_m| Vec3::new(0.15, y_m, 0.149));
        assert!(holds(BIN, front) && holds(BIN, back) && !holds(shelf(), front) && holds(shelf(), back));
        assert!(holds(shelf(), Vec3::new(0.15, 0.15, 0.252)) && !holds(BIN, Vec3::new(0.15, 0.15, 0.152)));
    }

    #[test]
    fn what_is_out_of_range_or_of_the_workspace_is_refused() {
        let refused = |container: Container| container.check(&Grid::PAPER).unwrap_err();
        assert_eq!(
            refused(Container { thickness_m: 0.0, ..BIN }),
            "a container's thickness_m must be between 0.001 and 0.1, got 0"
        );
        assert!(refused(Container { inner_m: [0.295, 0.2], ..BIN }).contains("must fit into a workspace of 0.3 m"));
        assert!(refused(Container { height_m: 0.248, ..shelf() }).contains("must fit"));
        assert!(refused(Container { slope_rad: f32::NAN, ..BIN }).contains("slope_rad"));
        assert!(refused(Container { slope_rad: 0.6, height_m: 0.2, ..BIN }).contains("floor"));
    }
}
