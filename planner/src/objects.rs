//! The objects of a plan: how many grasps each has, or why it has none.

use std::collections::BTreeSet;
use std::mem::take;

use crate::method::Request;
use crate::plan::{DroppedCandidate, ObjectCluster, RankedGrasp, SegmentedCloud};
use crate::rank::attribute;

/// Puts the first grasp of each object before all others; both keep their order.
pub(crate) fn each_first(grasps: &mut Vec<RankedGrasp>) {
    let mut seen = BTreeSet::new();
    let is_first = |ranked: &RankedGrasp| ranked.object.is_some_and(|object| seen.insert(object));
    let (firsts, others): (Vec<_>, Vec<_>) = take(grasps).into_iter().partition(is_first);
    grasps.extend(firsts);
    grasps.extend(others);
}

/// Tells each object its grasps, of which it knows its own, or what became of its best candidate.
pub(crate) fn tell(
    objects: &mut [ObjectCluster],
    grasps: &[RankedGrasp],
    dropped: &[DroppedCandidate],
    cloud: &SegmentedCloud,
    request: &Request<'_>,
) {
    for (ranked, object) in grasps.iter().filter_map(|ranked| Some((ranked, ranked.object?))) {
        let object = &mut objects[object];
        object.grasp_count += 1;
        object.quality_best = Some(object.quality_best.map_or(ranked.quality, |best| best.max(ranked.quality)));
    }
    for object in objects.iter_mut() {
        object.base_centroid_m = request.options.base_from_workspace.map(|base| base * object.centroid_m);
    }
    if objects.iter().all(|object| object.grasp_count > 0) {
        return;
    }
    let as_ranked = |one: &DroppedCandidate| RankedGrasp::new(one.workspace_from_grasp, None, one.quality, None);
    let mut others: Vec<RankedGrasp> = dropped.iter().map(as_ranked).collect();
    attribute(&mut others, cloud, objects, &request.config.ranking);
    for (number, object) in objects.iter_mut().enumerate().filter(|(_, object)| object.grasp_count == 0) {
        let own = dropped.iter().zip(&others).filter(|(_, ranked)| ranked.object == Some(number)).map(|(one, _)| one);
        let best = own.max_by(|a, b| a.quality.total_cmp(&b.quality));
        object.reason = Some(request.none_of_object(best));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_grasp_of_each_object_comes_first() {
        let of = |object, quality| RankedGrasp { object, quality, ..RankedGrasp::default() };
        let mut grasps = vec![of(Some(1), 0.9), of(Some(1), 0.8), of(None, 0.7), of(Some(0), 0.6), of(Some(1), 0.5)];
        each_first(&mut grasps);
        assert_eq!(grasps.iter().map(|ranked| ranked.quality).collect::<Vec<_>>(), [0.9, 0.6, 0.8, 0.7, 0.5]);
    }
}
