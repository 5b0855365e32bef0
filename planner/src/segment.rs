//! Segments the cloud of a scene into the table, the objects and the rest.

use perception::{clusters, find_plane};
use schema::{Purpose, Stream, Vec3};

use crate::config::Config;
use crate::plan::{ObjectCluster, PointLabel, SegmentedCloud};

/// The cloud with its segments, and its objects.
pub type Segments = (SegmentedCloud, Vec<ObjectCluster>);

/// Finds the plane and clusters the remaining points; objects are numbered by the heights of their centroids, from the
/// top.
#[must_use]
pub fn segment(points_m: Vec<Vec3>, config: &Config) -> Segments {
    let plane = find_plane(&points_m, &config.plane, &mut Stream::new(config.seed, 0, Purpose::Plane, 0));
    let mut labels = vec![PointLabel::Noise; points_m.len()];
    for inlier in plane.iter().flat_map(|found| &found.inliers) {
        labels[*inlier] = PointLabel::Plane;
    }
    let off: Vec<usize> = (0..labels.len()).filter(|at| labels[*at] == PointLabel::Noise).collect();
    let off_m: Vec<Vec3> = off.iter().map(|at| points_m[*at]).collect();
    let found = clusters(&off_m, &config.clusters);
    let (objects, numbers) = top_down(&off_m, &found);
    for (at, cluster) in off.into_iter().zip(found) {
        if let Some(cluster) = cluster {
            labels[at] = PointLabel::Object(numbers[cluster]);
        }
    }
    (SegmentedCloud { points_m, labels, plane }, objects)
}

/// The clusters as objects from the top, and each cluster's index among them.
fn top_down(points_m: &[Vec3], found: &[Option<usize>]) -> (Vec<ObjectCluster>, Vec<usize>) {
    let count = found.iter().flatten().max().map_or(0, |last| last + 1);
    let mut objects = vec![ObjectCluster::default(); count];
    for (point, cluster) in points_m.iter().zip(found) {
        if let Some(cluster) = cluster {
            let object = &mut objects[*cluster];
            object.point_count += 1;
            // A running mean avoids large sums in single precision.
            object.centroid_m += (*point - object.centroid_m) / object.point_count as f32;
        }
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| objects[*b].centroid_m.z.total_cmp(&objects[*a].centroid_m.z));
    let mut numbers = vec![0; count];
    for (number, cluster) in order.iter().enumerate() {
        numbers[*cluster] = number;
    }
    (order.into_iter().map(|cluster| objects[cluster].clone()).collect(), numbers)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BuiltIn;

    /// The faces of a box on a lattice of 2.5 mm.
    fn boxed(low: Vec3, size: Vec3) -> Vec<Vec3> {
        let count = (size / 0.0025).to_array().map(|n| n.round() as i32);
        let mut points = Vec::new();
        for i in 0..=count[0] {
            for j in 0..=count[1] {
                for k in 0..=count[2] {
                    if i == 0 || i == count[0] || j == 0 || j == count[1] || k == count[2] {
                        points.push(low + Vec3::new(i as f32, j as f32, k as f32) * 0.0025);
                    }
                }
            }
        }
        points
    }

    fn table() -> Vec<Vec3> {
        let lattice = (0..119).flat_map(|i| (0..119).map(move |j| [i as f32 * 0.0025, j as f32 * 0.0025]));
        lattice.map(|[x, y]| Vec3::new(x + 0.001, y + 0.001, 0.05)).collect()
    }

    #[test]
    fn two_boxes_on_a_table_are_two_objects_from_the_top() {
        let low = boxed(Vec3::new(0.05, 0.05, 0.05), Vec3::new(0.05, 0.05, 0.04));
        let high = boxed(Vec3::new(0.18, 0.18, 0.05), Vec3::new(0.04, 0.04, 0.08));
        let points: Vec<Vec3> = table().into_iter().chain(low).chain(high).collect();
        let (cloud, objects) = segment(points, &BuiltIn::Paper.config().unwrap());
        assert_eq!(objects.len(), 2);
        assert!((cloud.plane.as_ref().unwrap().plane.offset_m - 0.05).abs() < 5e-4);
        assert!((objects[0].centroid_m.truncate() - Vec3::splat(0.2).truncate()).length() < 1e-3, "{objects:?}");
        assert!((objects[1].centroid_m.truncate() - Vec3::splat(0.075).truncate()).length() < 1e-3);
        for (point, label) in cloud.points_m.iter().zip(&cloud.labels) {
            let expected = match point.z - 0.05 {
                height if height < 0.0099 => PointLabel::Plane,
                height if height > 0.0101 => PointLabel::Object(usize::from(point.x < 0.15)),
                _ => continue,
            };
            assert_eq!(*label, expected, "{point}");
        }
        assert_eq!(objects[0].point_count, cloud.labels.iter().filter(|l| **l == PointLabel::Object(0)).count());
    }

    #[test]
    fn a_bare_table_and_nothing_have_no_objects() {
        let config = BuiltIn::Paper.config().unwrap();
        let (cloud, objects) = segment(table(), &config);
        assert!(objects.is_empty() && cloud.labels.iter().all(|label| *label == PointLabel::Plane));
        let (cloud, objects) = segment(Vec::new(), &config);
        assert!(objects.is_empty() && cloud.plane.is_none());
    }
}
