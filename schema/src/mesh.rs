//! The surface of an object as triangles, of which its convex parts are only near.

use core::fmt::Display;
use core::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::Vec3;

/// Corners are whole multiples of a tenth of a micrometre, in 1/m.
const STEPS_PER_M: f64 = 1e7;
/// Most triangles of a mesh.
const TRIANGLES_MAX: usize = 1_000_000;
/// Largest coordinate of a corner, in metres.
const FAR_M: f32 = 10.0;

/// Triangles in space, closed or not. Files have them as two texts of whole numbers, because they are many: the corners
/// in tenths of a micrometre, and the triangles as numbers of corners, from 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Texts", into = "Texts")]
pub struct TriangleMesh {
    corners_m: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Texts {
    corners_100nm: String,
    triangles: String,
}

impl TriangleMesh {
    /// A mesh of corners in metres, which are rounded to a tenth of a micrometre, and triangles as corner numbers.
    ///
    /// # Errors
    /// Why these are no mesh: a rule, the value, and the limit.
    pub fn new(corners_m: &[Vec3], triangles: Vec<[u32; 3]>) -> Result<Self, String> {
        let (count, corners) = (triangles.len(), corners_m.len());
        if !(1..=TRIANGLES_MAX).contains(&count) {
            return Err(format!("a mesh must have 1 to {TRIANGLES_MAX} triangles, got {count}"));
        }
        if let Some(corner) = triangles.iter().flatten().find(|corner| **corner as usize >= corners) {
            return Err(format!("a mesh's triangles must name its {corners} corners from 0, got {corner}"));
        }
        let mut coordinates = corners_m.iter().flat_map(|corner_m| corner_m.to_array());
        if let Some(far) = coordinates.find(|x_m| !(-FAR_M..=FAR_M).contains(x_m)) {
            return Err(format!("a mesh's corners must lie within {FAR_M} m of its origin, got {far}"));
        }
        Ok(Self { corners_m: corners_m.iter().map(|corner_m| in_steps(*corner_m)).collect(), triangles })
    }

    /// The corners, in metres.
    #[must_use]
    pub fn corners_m(&self) -> &[Vec3] {
        &self.corners_m
    }

    /// The triangles as numbers of corners.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The mesh in a frame that has the same axes and lies `-by_m` from its own.
    #[must_use]
    pub fn moved(&self, by_m: Vec3) -> Self {
        let corners_m = self.corners_m.iter().map(|corner_m| in_steps(*corner_m + by_m)).collect();
        Self { corners_m, triangles: self.triangles.clone() }
    }
}

/// A coordinate in whole steps; from one that is, the number that it was made of, or one that makes it again.
fn steps(x_m: f32) -> i64 {
    (f64::from(x_m) * STEPS_PER_M).round() as i64
}

fn metres(steps: i64) -> f32 {
    (steps as f64 / STEPS_PER_M) as f32
}

fn in_steps(corner_m: Vec3) -> Vec3 {
    Vec3::from_array(corner_m.to_array().map(|x_m| metres(steps(x_m))))
}

impl From<TriangleMesh> for Texts {
    fn from(TriangleMesh { corners_m, triangles }: TriangleMesh) -> Self {
        let corners = corners_m.into_iter().map(|corner_m| corner_m.to_array().map(steps));
        Self { corners_100nm: text(corners), triangles: text(triangles.into_iter()) }
    }
}

impl TryFrom<Texts> for TriangleMesh {
    type Error = String;

    fn try_from(Texts { corners_100nm, triangles }: Texts) -> Result<Self, String> {
        let corners = numbers("corners_100nm", &corners_100nm)?;
        let corners_m: Vec<Vec3> = corners.into_iter().map(|corner| Vec3::from_array(corner.map(metres))).collect();
        Self::new(&corners_m, numbers("triangles", &triangles)?)
    }
}

fn text<N: Display>(triples: impl Iterator<Item = [N; 3]>) -> String {
    triples.map(|[a, b, c]| format!("{a} {b} {c}")).collect::<Vec<_>>().join(" ")
}

fn numbers<N: Copy + FromStr>(key: &str, text: &str) -> Result<Vec<[N; 3]>, String> {
    let all = text.split_ascii_whitespace().map(str::parse::<N>).collect::<Result<Vec<N>, _>>();
    let all = all.map_err(|_| format!("a mesh's {key} must be whole numbers in their range"))?;
    match all.as_chunks::<3>() {
        (triples, []) => Ok(triples.to_vec()),
        (_, rest) => Err(format!("a mesh's {key} must be threes of numbers, got {} more", rest.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_is_read_as_it_was_written_near_and_far() {
        for scale in [1e-6, 0.013, 0.77, 9.9] {
            let corners = [[0.1, 0.7, -1.0], [-0.333_333_3, 0.25, 0.999_999_9], [0.0, -0.0, 0.123_456_7]];
            let corners = corners.map(|corner| Vec3::from_array(corner) * scale);
            let mesh = TriangleMesh::new(&corners, vec![[0, 1, 2], [2, 1, 0]]).unwrap();
            let back = TriangleMesh::try_from(Texts::from(mesh.clone())).unwrap();
            let bits = |mesh: &TriangleMesh| -> Vec<[u32; 3]> {
                mesh.corners_m().iter().map(|corner_m| corner_m.to_array().map(f32::to_bits)).collect()
            };
            assert_eq!((bits(&back), back.triangles()), (bits(&mesh), mesh.triangles()), "{scale}");
            for (corner, given) in mesh.corners_m().iter().zip(&corners) {
                // Half a step, and half a step of single precision.
                assert!((*corner - *given).abs().max_element() <= 5.1e-8 + 6e-8 * scale, "{corner} of {given}");
            }
        }
    }

    #[test]
    fn what_is_no_mesh_is_refused_with_the_rule() {
        let read = |corners: &str, triangles: &str| {
            let texts = Texts { corners_100nm: corners.to_owned(), triangles: triangles.to_owned() };
            TriangleMesh::try_from(texts).map_or_else(|told| told, |_| "a mesh".to_owned())
        };
        let three = "0 0 0  10 0 0\n0 10 -5";
        assert_eq!(read(three, "0 1 2"), "a mesh");
        for (corners, triangles, told) in [
            (three, "", "1 to 1000000 triangles, got 0"),
            (three, "0 1 3", "must name its 3 corners from 0, got 3"),
            (three, "0 1 -1", "triangles must be whole numbers"),
            (three, "0 1 2 0", "triangles must be threes of numbers, got 1 more"),
            ("0 0 0 1.5 0 0 1 1 1", "0 1 2", "corners_100nm must be whole numbers"),
            ("0 0 0 100000010 0 0 1 1 1", "0 1 2", "within 10 m of its origin, got 10.000001"),
            ("0 0 0 10 0 0 0 10", "0 1 2", "corners_100nm must be threes of numbers, got 2 more"),
        ] {
            assert!(read(corners, triangles).contains(told), "{told}: {}", read(corners, triangles));
        }
        let nan = [Vec3::ZERO, Vec3::X, Vec3::new(0.0, f32::NAN, 0.0)];
        assert!(TriangleMesh::new(&nan, vec![[0, 1, 2]]).unwrap_err().ends_with("got NaN"));
    }
}
