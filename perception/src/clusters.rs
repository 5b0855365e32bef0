//! DBSCAN: clusters of density-connected points (Ester, Kriegel, Sander & Xu 1996; the paper's section 2.4).

use rayon::prelude::*;
use schema::Vec3;
use serde::Serialize;
use settings::settings;

use crate::cells::Cells;

settings! {
    /// When points form a cluster.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct ClusterParams {
        /// Neighbours are at most this far away.
        pub radius_m: f32 where 1e-4..=0.2,
        /// A point with at least this many neighbours, including itself, is a core point.
        pub points_min: usize where 1..=1_000_000,
        /// A cluster with fewer points than this is noise.
        pub cluster_points_min: usize where 1..=10_000_000,
    }
}

impl ClusterParams {
    /// The paper's values: 0.02 m, 100 points, 500 points; for clouds of 2.5 mm ([`crate::surface_cloud`]).
    pub const PAPER: Self = Self { radius_m: 0.02, points_min: 100, cluster_points_min: 500 };
}

/// The cluster of every point, numbered by their first core points; `None` is noise.
///
/// A border point belongs to the first cluster that reaches it. The labels equal those of scikit-learn's
/// `DBSCAN(eps=radius_m, min_samples=points_min)`, with two exceptions: distances that round to exactly the radius, and
/// clusters below `cluster_points_min`, which are noise here and leave no gap in the numbers. All points must be
/// finite.
#[must_use]
pub fn clusters(points_m: &[Vec3], params: &ClusterParams) -> Vec<Option<usize>> {
    let cells = Cells::new(points_m, params.radius_m);
    let is_core = core_points(points_m, &cells, params);
    let reach = params.radius_m * params.radius_m;
    // Points of each cube without a label. Labelled points are removed, so neighbour searches become cheaper.
    let mut unlabelled: Vec<Vec<u32>> = (0..cells.len()).map(|cube| cells.points(cube).to_vec()).collect();
    let mut labels = vec![None; points_m.len()];
    let mut count = 0;
    for first in 0..points_m.len() {
        if !is_core[first] || labels[first].is_some() {
            continue;
        }
        // All points that are density-reachable from this core point.
        let mut open = vec![first as u32];
        while let Some(point) = open.pop() {
            let from = points_m[point as usize];
            for cube in cells.around(from) {
                let near = unlabelled[cube]
                    .extract_if(.., |other| (points_m[*other as usize] - from).length_squared() <= reach);
                for other in near {
                    labels[other as usize] = Some(count);
                    if is_core[other as usize] {
                        open.push(other);
                    }
                }
            }
        }
        count += 1;
    }
    without_small(labels, params.cluster_points_min)
}

fn core_points(points_m: &[Vec3], cells: &Cells, params: &ClusterParams) -> Vec<bool> {
    let reach = params.radius_m * params.radius_m;
    // As they lie in cubes, and so that the compiler vectorises the loop over them.
    let of = |axis: usize| -> Vec<f32> { cells.order().iter().map(|index| points_m[*index as usize][axis]).collect() };
    let (x_m, y_m, z_m) = (of(0), of(1), of(2));
    let is_core = |point: &Vec3| {
        let mut count = 0;
        for run in cells.runs_around(*point) {
            let run = x_m[run.clone()].iter().zip(&y_m[run.clone()]).zip(&z_m[run]);
            let near = run.map(|((x, y), z)| u32::from((Vec3::new(*x, *y, *z) - *point).length_squared() <= reach));
            count += near.sum::<u32>() as usize;
            if count >= params.points_min {
                return true;
            }
        }
        false
    };
    points_m.par_iter().with_min_len(256).map(is_core).collect()
}

fn without_small(mut labels: Vec<Option<usize>>, points_min: usize) -> Vec<Option<usize>> {
    let count = labels.iter().flatten().max().map_or(0, |last| last + 1);
    let mut sizes = vec![0; count];
    for label in labels.iter().flatten() {
        sizes[*label] += 1;
    }
    let mut next = 0..count;
    let numbers: Vec<Option<usize>> =
        sizes.into_iter().map(|size| if size >= points_min { next.next() } else { None }).collect();
    for label in &mut labels {
        *label = label.and_then(|old| numbers[old]);
    }
    labels
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// DBSCAN by its definition, over all pairs.
    fn slow(points_m: &[Vec3], params: &ClusterParams) -> Vec<Option<usize>> {
        let near = |a: usize| -> Vec<usize> {
            (0..points_m.len())
                .filter(|b| (points_m[a] - points_m[*b]).length_squared() <= params.radius_m.powi(2))
                .collect()
        };
        let neighbours: Vec<Vec<usize>> = (0..points_m.len()).map(near).collect();
        let mut labels = vec![None; points_m.len()];
        let mut count = 0;
        for first in 0..points_m.len() {
            if labels[first].is_some() || neighbours[first].len() < params.points_min {
                continue;
            }
            let mut open = vec![first];
            while let Some(point) = open.pop() {
                if labels[point].is_none() {
                    labels[point] = Some(count);
                    if neighbours[point].len() >= params.points_min {
                        open.extend(&neighbours[point]);
                    }
                }
            }
            count += 1;
        }
        without_small(labels, params.cluster_points_min)
    }

    proptest! {
        #[test]
        fn labels_are_those_of_the_definition(
            lattice in prop::collection::vec((0..30_i32, 0..30_i32, 0..4_i32), 0..400),
            points_min in 1..8_usize, cluster_points_min in 1..30_usize,
        ) {
            // Whole millimetres keep distances away from the radius of 2.1 mm.
            let points: Vec<Vec3> =
                lattice.iter().map(|(x, y, z)| Vec3::new(*x as f32, *y as f32, *z as f32) * 1e-3 - 0.01).collect();
            let params = ClusterParams { radius_m: 2.1e-3, points_min, cluster_points_min };
            prop_assert_eq!(clusters(&points, &params), slow(&points, &params));
        }
    }

    #[test]
    fn nothing_has_no_clusters_and_one_place_may_be_one() {
        let params = ClusterParams { radius_m: 0.01, points_min: 3, cluster_points_min: 3 };
        assert!(clusters(&[], &params).is_empty());
        assert_eq!(clusters(&[Vec3::ONE; 3], &params), [Some(0); 3]);
        assert_eq!(clusters(&[Vec3::ONE; 2], &params), [None; 2]);
    }

    #[test]
    fn a_wide_cloud_needs_no_more_memory() {
        let points: Vec<Vec3> = (0..300).map(|n| Vec3::splat((n / 3) as f32 * 1e4)).collect();
        let params = ClusterParams { radius_m: 0.01, points_min: 3, cluster_points_min: 1 };
        let labels = clusters(&points, &params);
        assert!(labels.iter().enumerate().all(|(n, label)| *label == Some(n / 3)));
        assert!(Cells::new(&points, params.radius_m).len() < 130_usize.pow(3));
    }
}
