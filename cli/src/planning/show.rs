//! A plan to look at: as a page, or drawn into the camera's image.

use planner::plan::{Plan, PointLabel, RankedGrasp, RejectReason};
use program::{ExitCode, Failure};
use report::overlay::{Grasp as DrawnGrasp, grey, overlay};
use report::view::{Body, Class, Line, View, flat_points};
use schema::{ColorImage, Gripper, Outcome, Vec3};

/// Most grasps of a page; more could not be distinguished.
const SHOWN_MAX: usize = 40;
/// Most grasps in an image.
const DRAWN_MAX: usize = 5;

/// The segmented cloud and the ranked grasps, the best with the whole gripper, as a page of one file.
#[must_use]
pub fn page(plan: &Plan, gripper: &Gripper, title: &str) -> String {
    let mut view = View::new(title);
    view.lines.push(Line::workspace(plan.region.corners_m()));
    let shown = plan.grasps.iter().take(SHOWN_MAX);
    for RankedGrasp { rank, workspace_from_grasp, opening_m, quality, width_m, object, doubt, .. } in shown {
        let width = width_m.map_or(String::new(), |width_m| format!(", {:.0} mm wide", 1e3 * width_m));
        let at = object.map_or(String::new(), |object| format!("\nat object {object}"));
        let last = doubt.map_or(String::new(), |doubt| format!("\nlast: {}", doubt.name().replace('_', " ")));
        let label = format!("grasp {rank}: quality {quality:.3}{width}{at}{last}");
        if *rank == 1 {
            let part = |part| Body::of_box(Class::Gripper, label.clone(), &part, &[*workspace_from_grasp]);
            view.bodies.extend(gripper.boxes(*opening_m).into_iter().map(part));
        } else {
            view.lines.push(Line::fork(Class::Gripper, label, gripper, workspace_from_grasp, *opening_m));
        }
    }
    let wall = Line { class: Class::Container, label: "edge of a wall".to_owned(), points_m: Vec::new(), frames: None };
    view.lines.extend(plan.walls.iter().map(|edge_m| Line { points_m: edge_m.clone(), ..wall.clone() }));
    for dropped in plan.dropped.iter().filter(|one| matches!(one.reason, RejectReason::Collision { .. })) {
        let (class, opening_m) = (Class::Grasp(Outcome::ApproachCollision), gripper.opening_m_max);
        let label = format!("dropped: {}", dropped.detail);
        view.lines.push(Line::fork(class, label, gripper, &dropped.workspace_from_grasp, opening_m));
    }
    view.hidden = vec![Outcome::ApproachCollision.name().to_owned()];
    for number in 0..plan.objects.len() {
        let is_target = plan.grasps.first().is_some_and(|best| best.object == Some(number));
        let class = if is_target { Class::Target } else { Class::Surface };
        view.points.push(points(plan, class, &format!("object {number}"), PointLabel::Object(number)));
    }
    view.points.push(points(plan, Class::Table, "table", PointLabel::Plane));
    view.points.push(points(plan, Class::Surface, "of no object", PointLabel::Noise));
    view.points.retain(|segment| !segment.points_m.is_empty());
    view.fact("grasps", plan.grasps.len().to_string());
    if plan.grasps.len() > SHOWN_MAX {
        view.fact("shown", format!("the best {SHOWN_MAX}"));
    }
    view.fact("objects", plan.objects.len().to_string());
    view.fact("gripper", format!("{}, opens {:.0} mm", gripper.name, 1e3 * gripper.opening_m_max));
    for reason in plan.reason.iter().chain(&plan.warnings) {
        view.fact("note", reason.clone());
    }
    view.page()
}

/// The points of a segment, to 0.1 mm.
fn points(plan: &Plan, class: Class, label: &str, wanted: PointLabel) -> Line {
    let all = plan.cloud.points_m.iter().zip(&plan.cloud.labels);
    let own = all.filter(|(point_m, label)| **label == wanted && point_m.is_finite()).map(|(point_m, _)| *point_m);
    let points_m =
        flat_points(own).into_iter().map(|point| point.map(|along_m| (along_m * 1e4).round() / 1e4)).collect();
    Line { class, label: label.to_owned(), points_m, frames: None }
}

/// Draws the best grasps and the edges of walls into an image that the first camera took, or into its depth in grey, as
/// PNG.
///
/// # Errors
/// As [`overlay`], and if there was no camera.
pub fn draw_into(
    color: Option<ColorImage>,
    first: Option<&planner::View>,
    plan: &Plan,
    gripper: &Gripper,
) -> Result<Vec<u8>, Failure> {
    let Some(planner::View { image, camera, .. }) = first else {
        let refused = "the plan was made without a camera, so there is no image to draw into";
        return Err(Failure::new(ExitCode::Config, refused));
    };
    let best = plan.grasps.iter().take(DRAWN_MAX);
    let drawn = |grasp: &RankedGrasp| {
        grasp.camera_from_grasp.map(|camera_from_grasp| DrawnGrasp { camera_from_grasp, opening_m: grasp.opening_m })
    };
    let drawn: Vec<DrawnGrasp> = best.filter_map(drawn).collect();
    let camera_from_workspace = plan.workspace_from_camera.unwrap_or_default().inverse();
    let in_camera =
        |edge_m: &Vec<[f32; 3]>| edge_m.iter().map(|at| camera_from_workspace * Vec3::from_array(*at)).collect();
    let walls_m: Vec<Vec<Vec3>> = plan.walls.iter().map(in_camera).collect();
    overlay(color.unwrap_or_else(|| grey(image)), &camera.intrinsics, &drawn, &walls_m, gripper)
}

#[cfg(test)]
mod tests {
    use planner::{Config, PlanOptions, Planner, demo};
    use report::view::View;

    use super::*;

    /// The view that a page has inside.
    fn view(page: &str) -> View {
        let start = page.find("type=\"application/json\">").unwrap() + "type=\"application/json\">".len();
        serde_json::from_str(page[start..].split("</script>").next().unwrap()).unwrap()
    }

    #[test]
    fn a_page_has_every_point_of_the_cloud_and_the_grasps_where_the_plan_has_them() {
        let planner = Planner::built_in(Config::load(None).unwrap()).unwrap();
        let request = planner::input::assemble(&demo::request().unwrap(), None, planner.grid).unwrap();
        let mut plan = planner.plan(&request.observation, &PlanOptions::default()).unwrap();
        let gripper = &planner.config.gripper;
        let shown = view(&page(&plan, gripper, "demo"));
        let points: usize = shown.points.iter().map(|segment| segment.points_m.len()).sum();
        assert_eq!(points, plan.cloud.points_m.len());
        let best = plan.grasps[0].workspace_from_grasp;
        let finger = &shown.bodies[0];
        assert_eq!((shown.bodies.len(), finger.poses.len()), (3, 1));
        assert!((Vec3::from_slice(&finger.poses[0][..3]) - best.translation).length() < 1e-6);
        let others = plan.grasps.len().min(SHOWN_MAX) - 1;
        assert_eq!(shown.lines.iter().filter(|line| line.class == Class::Gripper).count(), others);
        plan.cloud.points_m[0] = Vec3::splat(f32::NAN);
        plan.walls = vec![vec![[0.0; 3], [0.1, 0.0, 0.1]]];
        plan.grasps[0].doubt = Some(planner::Doubt::Cut);
        let doubted = view(&page(&plan, gripper, "demo"));
        assert!(doubted.lines.iter().any(|line| line.class == Class::Container && line.points_m == plan.walls[0]));
        assert!(doubted.bodies[0].label.ends_with("last: cut by border"), "{}", doubted.bodies[0].label);
        plan.grasps.clear();
        let without = view(&page(&plan, gripper, "<demo>"));
        assert!(without.bodies.is_empty() && without.title == "<demo>", "{:?}", without.title);
    }
}
