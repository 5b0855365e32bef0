//! The segmented cloud as a PLY file, which point-cloud viewers open.
//!
//! A point has its position, a colour by its segment, and `label`: the object's index, −1 for noise, −2 for the
//! plane.

use crate::plan::{Plan, PointLabel};

const HEADER: &str = "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n\
                      property uchar blue\nproperty int label\nend_header\n";

const PLANE: [u8; 3] = [226; 3];
const NOISE: [u8; 3] = [150; 3];
/// Colours of Okabe and Ito (2008), which the colour-blind distinguish: sky blue, purple, yellow, orange, blue; then
/// darker versions. No object is green as the best grasp or vermilion as a collision.
const OBJECTS: [[u8; 3]; 10] = [
    [86, 180, 233],
    [204, 121, 167],
    [240, 228, 66],
    [230, 159, 0],
    [0, 114, 178],
    [56, 118, 153],
    [134, 79, 110],
    [158, 150, 43],
    [151, 104, 0],
    [0, 75, 117],
];

/// The colour of a point. After ten objects the colours repeat.
const fn colour_of(label: PointLabel) -> [u8; 3] {
    match label {
        PointLabel::Plane => PLANE,
        PointLabel::Noise => NOISE,
        PointLabel::Object(object) => OBJECTS[object % OBJECTS.len()],
    }
}

/// The cloud as binary, little-endian PLY; metres, in the workspace.
#[must_use]
pub fn write_ply(plan: &Plan) -> Vec<u8> {
    let points = plan.cloud.points_m.iter().zip(&plan.cloud.labels);
    let count = points.len();
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{HEADER}").into_bytes();
    for (point_m, label) in points {
        for coordinate in point_m.to_array() {
            bytes.extend(coordinate.to_le_bytes());
        }
        bytes.extend(colour_of(*label));
        let number = match label {
            PointLabel::Plane => -2,
            PointLabel::Noise => -1,
            PointLabel::Object(object) => i32::try_from(*object).unwrap_or(i32::MAX),
        };
        bytes.extend(number.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use ply_rs_bw::parser::Parser;
    use ply_rs_bw::ply::{DefaultElement, Encoding, Property};
    use schema::{Grid, Vec3};

    use super::*;
    use crate::config::Policy;
    use crate::plan::{FORMAT, Funnel, SegmentedCloud};

    fn plan(points_m: Vec<Vec3>, labels: Vec<PointLabel>) -> Plan {
        Plan {
            format: FORMAT,
            model: String::new(),
            policy: Policy::Paper,
            gripper: String::new(),
            flange_from_grasp: None,
            region: Grid::PAPER.into(),
            workspace_from_camera: None,
            table: None,
            grasps: Vec::new(),
            objects: Vec::new(),
            cloud: SegmentedCloud { points_m, labels, plane: None },
            funnel: Funnel::default(),
            reason: None,
            warnings: Vec::new(),
            dropped: Vec::new(),
            timings_ms: Vec::new(),
        }
    }

    #[test]
    fn another_reader_finds_the_points_their_tints_and_their_labels() {
        let points = vec![Vec3::new(0.1, 0.2, 0.05), Vec3::new(0.0, -0.3, 1e-3), Vec3::X, Vec3::Y];
        let labels = vec![PointLabel::Plane, PointLabel::Noise, PointLabel::Object(0), PointLabel::Object(12)];
        let bytes = write_ply(&plan(points.clone(), labels.clone()));
        let ply = Parser::<DefaultElement>::new().read_ply(&mut bytes.as_slice()).unwrap();
        assert_eq!(ply.header.encoding, Encoding::BinaryLittleEndian);
        let vertices = &ply.payload["vertex"];
        assert_eq!(vertices.len(), 4);
        for (at, wanted) in [-2, -1, 0, 12].into_iter().enumerate() {
            let vertex = &vertices[at];
            for (name, coordinate) in ["x", "y", "z"].into_iter().zip(points[at].to_array()) {
                assert_eq!(vertex[name], Property::Float(coordinate));
            }
            for (name, channel) in ["red", "green", "blue"].into_iter().zip(colour_of(labels[at])) {
                assert_eq!(vertex[name], Property::UChar(channel));
            }
            assert_eq!(vertex["label"], Property::Int(wanted));
        }
    }

    #[test]
    fn an_empty_cloud_is_a_file_without_points() {
        let bytes = write_ply(&plan(Vec::new(), Vec::new()));
        let ply = Parser::<DefaultElement>::new().read_ply(&mut bytes.as_slice()).unwrap();
        assert!(ply.payload["vertex"].is_empty());
        assert!(bytes.ends_with(b"end_header\n"));
    }
}
