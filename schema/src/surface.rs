//! The surface of an object, which pages draw and on which fingers are told to press: the triangles of its mesh, or
//! where it has none the faces of its convex parts.

use crate::{Face, Plane, Polyhedron, TriangleMesh, Vec3};

/// Flat faces with common corners.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Surface {
    /// The corners, in metres.
    pub corners_m: Vec<Vec3>,
    /// The faces; triangles without an area are left out.
    pub faces: Vec<Face>,
}

impl Surface {
    /// The triangles of a mesh, or the faces of all parts, which are in the same frame.
    #[must_use]
    pub fn of(mesh: Option<&TriangleMesh>, parts: &[Polyhedron]) -> Self {
        if let Some(mesh) = mesh {
            let triangle = |triangle: &[u32; 3]| {
                let ring = triangle.map(|corner| corner as usize);
                // In double precision, because triangles may be narrow.
                let [a, b, c] = ring.map(|corner| mesh.corners_m()[corner].as_dvec3());
                let normal = (b - a).cross(c - a).try_normalize()?;
                let plane = Plane { normal: normal.as_vec3(), offset_m: normal.dot(a) as f32 };
                Some(Face { plane, ring: ring.into() })
            };
            let faces = mesh.triangles().iter().filter_map(triangle).collect();
            return Self { corners_m: mesh.corners_m().to_vec(), faces };
        }
        let mut surface = Self::default();
        for part in parts {
            let first = surface.corners_m.len();
            surface.corners_m.extend(part.corners_m());
            let moved = |face: &Face| Face { ring: face.ring.iter().map(|corner| first + corner).collect(), ..*face };
            surface.faces.extend(part.faces().iter().map(moved));
        }
        surface
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pose, ShapeKind, Solid};

    #[test]
    fn a_mesh_hides_the_parts_and_parts_keep_their_faces_and_corners() {
        let part = Polyhedron::from(&Solid::new(ShapeKind::Cuboid, Vec3::new(0.02, 0.04, 0.06)).unwrap());
        let parts = [part.clone(), part.moved(&Pose::from_translation(Vec3::X))];
        let surface = Surface::of(None, &parts);
        assert_eq!((surface.corners_m.len(), surface.faces.len()), (16, 12));
        for (number, face) in surface.faces.iter().enumerate() {
            let own = &parts[number / 6];
            let same = &own.faces()[number % 6];
            assert_eq!(face.plane, same.plane);
            let corners_m: Vec<Vec3> = face.ring.iter().map(|corner| surface.corners_m[*corner]).collect();
            assert_eq!(corners_m, same.ring.iter().map(|corner| own.corners_m()[*corner]).collect::<Vec<_>>());
        }
        let corners_m = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Y * 0.5];
        let mesh = TriangleMesh::new(&corners_m, vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        let shown = Surface::of(Some(&mesh), &parts);
        let plane = Plane { normal: Vec3::Z, offset_m: 0.0 };
        assert_eq!(shown.faces, [Face { plane, ring: vec![0, 1, 2] }], "the other has no area");
        assert_eq!(shown.corners_m, corners_m);
    }
}
