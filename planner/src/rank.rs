//! The order of grasps: those of which something is to be doubted come last; else Eq. 8 within objects and objects from
//! the top down, or VGN's orders.

use core::cmp::Ordering;

use perception::nearest;
use schema::{Stream, Vec3};

use crate::config::{Policy, RankingParams};
use crate::plan::{ObjectCluster, RankedGrasp, SegmentedCloud};

/// A grasp whose width was not seen comes after one that is less sure by up to this. It holds as often as the judge
/// says of convex things, but is not in the middle of a rim.
const UNSEEN: f32 = 0.03;

/// Eq. 8: the distance to the object's centroid, weighted by axis, over the quality; in metres.
#[must_use]
pub fn rho_m(position_m: Vec3, centroid_m: Vec3, quality: f32, weights: [f32; 3]) -> f32 {
    let off = position_m - centroid_m;
    (Vec3::from_array(weights) * off * off).element_sum().sqrt() / quality
}

/// Assigns each grasp its object, that of the nearest point, and ρ.
pub(crate) fn attribute(
    grasps: &mut [RankedGrasp],
    cloud: &SegmentedCloud,
    objects: &[ObjectCluster],
    params: &RankingParams,
) {
    let (points_m, numbers): (Vec<Vec3>, Vec<usize>) = cloud.of_objects().unzip();
    let tips_m: Vec<Vec3> = grasps.iter().map(|ranked| ranked.workspace_from_grasp.translation).collect();
    let nearest = nearest(&tips_m, &points_m, params.object_distance_m_max);
    for ((ranked, tips_m), nearest) in grasps.iter_mut().zip(tips_m).zip(nearest) {
        ranked.object = nearest.map(|point| numbers[point]);
        ranked.rho_m =
            ranked.object.map(|object| rho_m(tips_m, objects[object].centroid_m, ranked.quality, params.weights));
    }
}

/// Sorts grasps by the policy, best first, but those that are to be doubted last. Equal grasps keep the order of their
/// voxels.
pub(crate) fn order(grasps: &mut [RankedGrasp], policy: Policy, mut chance: Stream) {
    match policy {
        Policy::Paper => grasps.sort_by(|a, b| top_down(a, b).then(b.quality.total_cmp(&a.quality))),
        Policy::VgnBest => grasps.sort_by(|a, b| sureness(b).total_cmp(&sureness(a))),
        Policy::VgnRandom => chance.shuffle(grasps),
    }
    grasps.sort_by_key(|ranked| ranked.doubt);
}

/// The quality times the robustness, where that is known; less where the width was not seen.
fn sureness(ranked: &RankedGrasp) -> f32 {
    ranked.quality * ranked.robustness.unwrap_or(1.0) - if ranked.width_m.is_none() { UNSEEN } else { 0.0 }
}

/// Objects are numbered from the top; grasps without an object come last.
fn top_down(a: &RankedGrasp, b: &RankedGrasp) -> Ordering {
    let key = |ranked: &RankedGrasp| ranked.object.unwrap_or(usize::MAX);
    let rho = |ranked: &RankedGrasp| ranked.rho_m.unwrap_or(f32::INFINITY);
    key(a).cmp(&key(b)).then(rho(a).total_cmp(&rho(b)))
}

#[cfg(test)]
mod tests {
    use schema::{Purpose, Quat, pose_from_parts};

    use super::*;
    use crate::plan::PointLabel;
    use crate::{BuiltIn, Doubt};

    fn grasp(position_m: [f32; 3], quality: f32) -> RankedGrasp {
        let workspace_from_grasp = pose_from_parts(Quat::IDENTITY, Vec3::from_array(position_m));
        RankedGrasp::new(workspace_from_grasp, Some(0.04), quality, None)
    }

    fn chance(scene: u64) -> Stream {
        Stream::new(1, scene, Purpose::Ranking, 0)
    }

    /// A low object at x = 0.1 and a high one at x = 0.2, each of two points.
    fn scene() -> (SegmentedCloud, Vec<ObjectCluster>) {
        let high = [Vec3::new(0.2, 0.1, 0.11), Vec3::new(0.2, 0.1, 0.13)];
        let low = [Vec3::new(0.1, 0.1, 0.06), Vec3::new(0.1, 0.1, 0.08)];
        let cloud = SegmentedCloud {
            points_m: high.into_iter().chain(low).chain([Vec3::new(0.15, 0.1, 0.05)]).collect(),
            labels: [0, 0, 1, 1].map(PointLabel::Object).into_iter().chain([PointLabel::Plane]).collect(),
            plane: None,
        };
        let object = |centroid_m| ObjectCluster { centroid_m, point_count: 2, ..Default::default() };
        (cloud, vec![object(Vec3::new(0.2, 0.1, 0.12)), object(Vec3::new(0.1, 0.1, 0.07))])
    }

    #[test]
    fn eq_8_by_hand() {
        let rho = rho_m(Vec3::new(0.02, -0.01, 0.05), Vec3::ZERO, 0.95, [0.45, 0.45, 0.1]);
        let by_hand = (0.45 * 0.0004 + 0.45 * 0.0001 + 0.1 * 0.0025_f64).sqrt() / 0.95;
        assert!((f64::from(rho) - by_hand).abs() < 1e-8, "{rho} against {by_hand}");
    }

    #[test]
    fn the_paper_takes_the_highest_object_first_and_its_middle() {
        let (cloud, objects) = scene();
        let params = BuiltIn::Paper.config().unwrap().ranking;
        let mut grasps = vec![
            grasp([0.1, 0.1, 0.07], 0.99),
            grasp([0.2, 0.115, 0.12], 0.95),
            grasp([0.3, 0.3, 0.3], 1.0),
            grasp([0.2, 0.105, 0.12], 0.91),
            grasp([0.25, 0.25, 0.3], 0.92),
        ];
        attribute(&mut grasps, &cloud, &objects, &params);
        assert_eq!(grasps.iter().map(|g| g.object).collect::<Vec<_>>(), [Some(1), Some(0), None, Some(0), None]);
        let qualities = |policy| {
            let mut ordered = grasps.clone();
            order(&mut ordered, policy, chance(1));
            ordered.iter().map(|g| g.quality).collect::<Vec<_>>()
        };
        assert_eq!(qualities(Policy::Paper), [0.91, 0.95, 0.99, 1.0, 0.92]);
        assert_eq!(qualities(Policy::VgnBest), [1.0, 0.99, 0.95, 0.92, 0.91]);
        let mut by_chance = qualities(Policy::VgnRandom);
        assert_eq!(by_chance, qualities(Policy::VgnRandom));
        by_chance.sort_by(f32::total_cmp);
        assert_eq!(by_chance, [0.91, 0.92, 0.95, 0.99, 1.0]);
    }

    #[test]
    fn what_is_doubted_comes_last_and_an_unseen_width_costs_a_little() {
        let of = |quality: f32, width_m: Option<f32>, doubt: Option<Doubt>| RankedGrasp {
            width_m,
            doubt,
            ..grasp([0.0; 3], quality)
        };
        let mut grasps = vec![
            of(0.99, Some(0.04), Some(Doubt::Cut)),
            of(0.98, None, Some(Doubt::NoDepth)),
            of(0.71, Some(0.04), None),
            of(0.92, Some(0.04), None),
            of(0.97, None, None),
            of(0.95, Some(0.04), None),
            of(0.96, Some(0.04), Some(Doubt::BentTable)),
            of(0.94, Some(0.04), Some(Doubt::NoDepth)),
        ];
        for (policy, first) in [(Policy::VgnBest, [0.95, 0.97]), (Policy::Paper, [0.97, 0.95])] {
            order(&mut grasps, policy, chance(1));
            let qualities: Vec<f32> = grasps.iter().map(|g| g.quality).collect();
            assert_eq!(qualities, [&first[..], &[0.92, 0.71, 0.98, 0.94, 0.96, 0.99]].concat());
        }
    }

    #[test]
    fn chance_puts_each_grasp_first_equally_often() {
        let mut firsts = [0; 4];
        for scene in 0..4_000 {
            let mut grasps: Vec<RankedGrasp> = (0..4_u8).map(|n| grasp([0.0; 3], f32::from(n))).collect();
            order(&mut grasps, Policy::VgnRandom, chance(scene));
            firsts[grasps[0].quality as usize] += 1;
        }
        assert!(firsts.iter().all(|count| (870..1130).contains(count)), "{firsts:?}");
    }
}
