//! The usual mistakes in a camera's pose. If the table is not observed at its expected height, each of them is tried as
//! an explanation: a pose that is the inverse of what its key says, camera axes as OpenGL has them (y up, z
//! backwards), and millimetres.

use schema::{Grid, Pose, Quat, Vec3};

use crate::View;

/// The floor is divided into so many cells along each side.
const CELLS: usize = 10;
/// A cell shows the table if something was seen in it this close to the table's height: sensors' scales are off by 3 %.
const HEIGHT_OFF_M_MAX: f32 = 0.02;
/// A mistake explains where the table was seen if then it would be seen where it is in this share of the cells …
const SHARE_MIN: f32 = 0.3;
/// … and in this many times as many as without: whatever is seen from a wrong pose may lie at that height by chance.
const TIMES_MIN: f32 = 4.0;
/// About so many pixels along an image's width are looked at.
const COLUMNS: usize = 160;
/// From a camera that looks along +z with y down to one that looks along -z with y up, and back.
const HALF_TURN_ABOUT_X: Quat = Quat::from_xyzw(1.0, 0.0, 0.0, 0.0);

/// A camera's pose as it was given.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Extrinsics {
    /// Its key.
    pub(crate) key: &'static str,
    /// The pose under that key.
    pub(crate) given: Pose,
    /// Whether the key begins with `camera_from`.
    pub(crate) is_inverse: bool,
    /// The workspace from the key's other frame.
    pub(crate) workspace_from_target: Pose,
}

/// Mistakes that occur together.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Mistakes {
    is_inverted: bool,
    is_opengl: bool,
    is_in_mm: bool,
}

impl Mistakes {
    const NONE: Self = Self { is_inverted: false, is_opengl: false, is_in_mm: false };
    /// What is tried, the simplest explanation first.
    const TRIED: [Self; 7] = [
        Self { is_opengl: true, ..Self::NONE },
        Self { is_inverted: true, ..Self::NONE },
        Self { is_in_mm: true, ..Self::NONE },
        Self { is_inverted: true, is_opengl: true, ..Self::NONE },
        Self { is_opengl: true, is_in_mm: true, ..Self::NONE },
        Self { is_inverted: true, is_in_mm: true, ..Self::NONE },
        Self { is_inverted: true, is_opengl: true, is_in_mm: true },
    ];

    /// What was given instead of the pose of a key.
    fn describe(self, key: &str) -> String {
        let inverse = key.split_once("_from_").map_or_else(String::new, |(to, from)| format!("{from}_from_{to}"));
        let parts = [
            (self.is_inverted, format!("the inverse, {inverse}")),
            (self.is_opengl, "in OpenGL's camera axes, y up and z backwards".to_owned()),
            (self.is_in_mm, "in millimetres".to_owned()),
        ];
        parts.into_iter().filter(|(is, _)| *is).map(|(_, what)| what).collect::<Vec<_>>().join(", ")
    }
}

impl Extrinsics {
    /// The camera in the workspace.
    pub(crate) fn workspace_from_camera(&self) -> Pose {
        self.corrected(Mistakes::NONE)
    }

    /// The camera in the workspace if these mistakes were made.
    fn corrected(&self, mistakes: Mistakes) -> Pose {
        let mut given = self.given;
        if mistakes.is_in_mm {
            given.translation *= 1e-3;
        }
        let target_from_camera = if self.is_inverse == mistakes.is_inverted { given } else { given.inverse() };
        let workspace_from_camera = self.workspace_from_target * target_from_camera;
        if mistakes.is_opengl {
            return Pose::from_parts(
                workspace_from_camera.translation,
                workspace_from_camera.rotation * HALF_TURN_ABOUT_X,
            );
        }
        workspace_from_camera
    }
}

/// Warnings for views that do not see the table where the workspace has it, but would if their poses were mistaken in a
/// usual way; one for all views with the same mistake.
pub(crate) fn table_elsewhere(views: &[View], extrinsics: &[Extrinsics], grid: &Grid) -> Vec<String> {
    let explained: Vec<_> =
        views.iter().zip(extrinsics).map(|(view, given)| (given.key, explanation(view, given, grid))).collect();
    let mut warnings = Vec::new();
    for (first, (key, found)) in explained.iter().enumerate() {
        let Some((mistakes, share)) = found else { continue };
        let is_alike = |(other, found): &(&str, Option<(Mistakes, f32)>)| {
            other == key && found.is_some_and(|(other, _)| other == *mistakes)
        };
        if explained[..first].iter().any(is_alike) {
            continue;
        }
        let alike: Vec<String> =
            (first..views.len()).filter(|at| is_alike(&explained[*at])).map(|at| format!("views[{at}]")).collect();
        warnings.push(format!(
            "the table was not seen at z = {:.0} mm, where the workspace has it; it would be seen there, in {:.0} % of the \
             workspace, if {key} were {}: {}",
            1e3 * grid.table_z_m,
            1e2 * share,
            mistakes.describe(key),
            alike.join(", ")
        ));
    }
    warnings
}

/// The mistakes that best explain why a view does not see the table where it is, and the share of the floor in which it
/// then would.
fn explanation(view: &View, given: &Extrinsics, grid: &Grid) -> Option<(Mistakes, f32)> {
    let share_if = |mistakes: Mistakes| table_share(view, &given.corrected(mistakes), grid);
    let share_min = SHARE_MIN.max(TIMES_MIN * share_if(Mistakes::NONE));
    if share_min > 1.0 {
        return None;
    }
    let tried = Mistakes::TRIED.map(|mistakes| (mistakes, share_if(mistakes)));
    let best = tried.into_iter().reduce(|best, next| if next.1 > best.1 { next } else { best });
    best.filter(|(_, share)| *share >= share_min)
}

/// The share of the floor's cells in which a view shows something at the table's height.
fn table_share(View { image, camera }: &View, workspace_from_camera: &Pose, grid: &Grid) -> f32 {
    let stride = image.width_px.div_ceil(COLUMNS).max(1);
    let mut is_seen = [false; CELLS * CELLS];
    for pixel in
        (0..image.height_px).step_by(stride).flat_map(|v| (0..image.width_px).step_by(stride).map(move |u| [u, v]))
    {
        let Some(depth_m) = image.at(pixel).filter(|depth_m| depth_m.is_finite()) else { continue };
        let seen_m: Vec3 = *workspace_from_camera * (camera.intrinsics.ray(pixel) * depth_m);
        let [x, y] = [seen_m.x, seen_m.y].map(|along_m| along_m / grid.size_m);
        let is_inside = (0.0..1.0).contains(&x) && (0.0..1.0).contains(&y);
        if is_inside && (seen_m.z - grid.table_z_m).abs() <= HEIGHT_OFF_M_MAX {
            let [column, row] = [x, y].map(|share| (share * CELLS as f32) as usize);
            is_seen[row * CELLS + column] = true;
        }
    }
    is_seen.iter().filter(|is| **is).count() as f32 / is_seen.len() as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Observation;
    use crate::demo;
    use crate::input::assemble;

    /// The demo's views.
    fn demo_views() -> Vec<View> {
        let request = assemble(&demo::request().unwrap(), None, Grid::PAPER).unwrap();
        assert_eq!(request.warnings, Vec::<String>::new());
        let Observation::Views(views) = request.observation else { panic!("the demo has views") };
        views
    }

    /// The warnings if the demo's poses are given wrongly under this key.
    fn warnings(key: &'static str, given: impl Fn(&Pose) -> Pose) -> Vec<String> {
        let views = demo_views();
        let workspace_from_target = Pose::from_parts(Vec3::new(-0.4, 0.2, 0.1), Quat::from_xyzw(0.0, 0.0, 0.6, 0.8));
        let workspace_from_target = if key.contains("base") { workspace_from_target } else { Pose::IDENTITY };
        let extrinsics = |view: &View| Extrinsics {
            key,
            given: given(&(workspace_from_target.inverse() * view.camera.workspace_from_camera)),
            is_inverse: key.starts_with("camera_from"),
            workspace_from_target,
        };
        let extrinsics: Vec<Extrinsics> = views.iter().map(extrinsics).collect();
        table_elsewhere(&views, &extrinsics, &Grid::PAPER)
    }

    fn in_opengl(pose: &Pose) -> Pose {
        Pose::from_parts(pose.translation, pose.rotation * HALF_TURN_ABOUT_X)
    }

    fn in_mm(pose: &Pose) -> Pose {
        Pose::from_parts(pose.translation * 1e3, pose.rotation)
    }

    type Mistake = fn(&Pose) -> Pose;

    #[test]
    fn every_usual_mistake_is_recognised_and_named() {
        for [to, from] in [["workspace", "camera"], ["base", "camera"]] {
            let key: &'static str = if to == "base" { "base_from_camera" } else { "workspace_from_camera" };
            assert!(warnings(key, |pose| *pose).is_empty());
            let cases: [(Mistake, String); 5] = [
                (in_opengl, "in OpenGL's camera axes, y up and z backwards".to_owned()),
                (|pose| pose.inverse(), format!("the inverse, {from}_from_{to}")),
                (in_mm, "in millimetres".to_owned()),
                // OpenGL's view matrix: from the world to the camera, in OpenGL's axes.
                (|pose| in_opengl(pose).inverse(), format!("the inverse, {from}_from_{to}, in OpenGL's")),
                (|pose| in_mm(&pose.inverse()), format!("the inverse, {from}_from_{to}, in millimetres")),
            ];
            for (mistake, expected) in cases {
                let all = warnings(key, mistake);
                let [warning] = &all[..] else { panic!("{all:?}") };
                assert!(warning.contains(&expected), "{warning}");
                assert!(warning.ends_with(": views[0], views[1], views[2]"), "{warning}");
            }
        }
        let inverted = &warnings("camera_from_base", |pose| *pose)[0];
        assert!(inverted.contains("if camera_from_base were the inverse, base_from_camera: views[0]"), "{inverted}");
        assert!(warnings("camera_from_base", Pose::inverse).is_empty());
    }

    #[test]
    fn a_pose_that_is_wrong_in_another_way_is_not_explained() {
        let aside = warnings("workspace_from_camera", |pose| {
            Pose::from_parts(pose.translation + Vec3::new(1.0, 0.0, 0.3), pose.rotation)
        });
        assert!(aside.is_empty(), "{aside:?}");
    }

    #[test]
    fn one_wrong_view_among_others_is_named() {
        let views = demo_views();
        let mut extrinsics = views.iter().map(|view| Extrinsics {
            key: "workspace_from_camera",
            given: view.camera.workspace_from_camera,
            is_inverse: false,
            workspace_from_target: Pose::IDENTITY,
        });
        let mut extrinsics: [Extrinsics; 3] = std::array::from_fn(|_| extrinsics.next().unwrap());
        extrinsics[1].given = in_opengl(&extrinsics[1].given);
        let warnings = table_elsewhere(&views, &extrinsics, &Grid::PAPER);
        assert!(warnings.len() == 1 && warnings[0].ends_with(": views[1]"), "{warnings:?}");
    }
}
