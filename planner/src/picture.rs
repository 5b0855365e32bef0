//! The picture of a plan: the segmented cloud and the ranked grasps, from the side and from above (PNG).
//!
//! [`report::still`] draws it; this module defines the content. Only the best grasp has fingers and palm as boxes,
//! because twelve complete hands would hide the objects; the others are forks of lines.

mod hand;
mod overlay;
mod relief;
pub(crate) mod tints;

use program::Failure;
use report::still::{Canvas, INK, Opacity, Outlook, Sheet, Symbol, Word};
use report::view::Line;
use schema::{Gripper, Intrinsics, Vec3};

use self::hand::{SHOWN, hand, points};
pub use self::overlay::{Hand, overlay};
use self::tints::{BEST, COLLISION, OTHER_DROP, THIN_LINE, of_label, of_place};
use crate::input::{ColorImage, refuse};
use crate::plan::{DroppedCandidate, ObjectCluster, Plan, PointLabel, RankedGrasp, RejectReason};

/// Width of the picture, in pixels.
pub const WIDTH_PX: usize = 1400;
/// Its height.
pub const HEIGHT_PX: usize = 760;

/// Maximum number of drawn grasps, from the best; more could not be distinguished.
const GRASPS_DRAWN_MAX: usize = 12;
/// Number of these with their rank written beside them.
const GRASPS_NUMBERED_MAX: usize = 5;
/// The picture is drawn at twice its size; all lengths below are in the large picture's pixels.
const LARGE: [usize; 2] = [WIDTH_PX * 2, HEIGHT_PX * 2];
const PANEL: [usize; 2] = [1376, 1304];
const PANEL_CORNERS: [[usize; 2]; 2] = [[16, 16], [1408, 16]];
const CAPTION_Y: [i32; 3] = [1362, 1422, 1482];
const CAPTION_X: i32 = 28;

const VIEWS: [(&str, Outlook); 2] = [
    ("from the side", Outlook { towards_eye: Vec3::new(0.42, -1.0, 0.72), up: Vec3::Z, sides_away: 4.5 }),
    ("from above", Outlook { towards_eye: Vec3::Z, up: Vec3::Y, sides_away: 7.0 }),
];

const ALWAYS: Opacity = Opacity { before: 1.0, behind: 1.0 };
/// Length of the axes at the workspace's origin, in its sides.
const AXIS_SHARE: f32 = 0.13;

/// Draws a plan as a PNG of [`WIDTH_PX`] × [`HEIGHT_PX`]. Its bytes are a pure function of the arguments.
///
/// # Errors
/// If a library fails; this does not depend on the plan.
pub fn draw(plan: &Plan, gripper: &Gripper, title: &str) -> Result<Vec<u8>, Failure> {
    let panel = |which: usize| panel(plan, gripper, VIEWS[which].1);
    let (side, above) = rayon::join(|| panel(0), || panel(1));
    let mut sheet = Sheet::new(LARGE);
    for (((canvas, words), corner), (view, _)) in [side, above].iter().zip(PANEL_CORNERS).zip(VIEWS) {
        sheet.panel(canvas, corner, view, words)?;
    }
    sheet.line(title, (CAPTION_X, CAPTION_Y[0]), 42)?;
    let summary = plan.reason.clone().unwrap_or_else(|| summary(plan));
    sheet.line(&summary, (CAPTION_X, CAPTION_Y[1]), 34)?;
    sheet.legend(&legend(plan), (CAPTION_X, CAPTION_Y[2]), 27)?;
    sheet.png()
}

/// Draws the best grasps into an image that the first camera took.
///
/// # Errors
/// As [`overlay`], and if the plan knows no camera.
pub fn draw_into(image: &ColorImage, lens: &Intrinsics, plan: &Plan, gripper: &Gripper) -> Result<Vec<u8>, Failure> {
    let best = plan.grasps.iter().take(GRASPS_NUMBERED_MAX);
    let hand = |grasp: &RankedGrasp| {
        grasp.camera_from_grasp.map(|camera_from_grasp| Hand { camera_from_grasp, opening_m: grasp.opening_m })
    };
    let hands: Option<Vec<Hand>> = best.map(hand).collect();
    match hands {
        Some(hands) => overlay(image, lens, &hands, gripper),
        None => Ok(refuse("the plan was made without a camera, so there is no image to draw into")?),
    }
}

/// The scene from one side, with its labels.
fn panel(plan: &Plan, gripper: &Gripper, outlook: Outlook) -> (Canvas, Vec<Word>) {
    let mut canvas = Canvas::new(plan.region.corners_m(), outlook, PANEL);
    let colours = plan.cloud.labels.iter().map(|label| of_label(*label));
    canvas.surface(plan.cloud.points_m.iter().copied().zip(colours), plan.region.voxel_size_m);
    let axes = workspace(&mut canvas, plan.region.corners_m());
    dropped(&mut canvas, &plan.dropped);
    centroids(&mut canvas, &plan.objects);
    let count = plan.grasps.len().min(GRASPS_DRAWN_MAX);
    // The best is drawn last, on top.
    let mut stems: Vec<(usize, [f32; 2])> = (0..count)
        .rev()
        .filter_map(|place| {
            let RankedGrasp { workspace_from_grasp, opening_m, .. } = &plan.grasps[place];
            Some((place, hand(&mut canvas, workspace_from_grasp, *opening_m, gripper, [place, count])?))
        })
        .filter(|(place, _)| *place < GRASPS_NUMBERED_MAX)
        .collect();
    stems.reverse();
    let mut words = numbers(&stems);
    words.extend(axes);
    (canvas, words)
}

/// Thin lines along the edges of the part of the workspace that was looked at, and the workspace's axes at its origin.
/// Returns the axes' names.
fn workspace(canvas: &mut Canvas, [low_m, high_m]: [Vec3; 2]) -> Vec<Word> {
    canvas.line(&points(&Line::workspace([low_m, high_m])), 1.0, THIN_LINE);
    let length_m = AXIS_SHARE * (high_m - low_m).max_element();
    for axis in Vec3::AXES {
        canvas.line(&[Vec3::ZERO, axis * length_m], 2.6, INK);
    }
    canvas.lay(SHOWN);
    let Some(origin) = canvas.see(Vec3::ZERO) else { return Vec::new() };
    let ends = ["x", "y", "z"].into_iter().zip(Vec3::AXES);
    let seen = ends.filter_map(|(name, axis)| Some((name, canvas.see(axis * (1.28 * length_m))?)));
    // An axis towards the viewer would have its name on the origin.
    let seen = seen.filter(|(_, [x, y])| (x - origin[0]).abs().max((y - origin[1]).abs()) > 30.0);
    seen.map(|(name, [x, y])| Word { text: name.to_owned(), at: (x as i32, y as i32), size: 30, colour: INK }).collect()
}

/// A dot at each dropped candidate's finger tips; collisions are larger and on top.
fn dropped(canvas: &mut Canvas, dropped: &[DroppedCandidate]) {
    for collisions in [false, true] {
        let (radius_px, colour) = if collisions { (7.0, COLLISION) } else { (5.0, OTHER_DROP) };
        let wanted =
            |candidate: &&DroppedCandidate| matches!(candidate.reason, RejectReason::Collision { .. }) == collisions;
        for candidate in dropped.iter().filter(wanted) {
            canvas.dot(candidate.workspace_from_grasp.translation, 0.0, radius_px, colour);
        }
        canvas.lay(SHOWN);
    }
}

/// A dot in the object's colour at each centroid, visible through the object.
fn centroids(canvas: &mut Canvas, objects: &[ObjectCluster]) {
    for (number, object) in objects.iter().enumerate() {
        let tint = of_label(PointLabel::Object(number));
        for (step, (radius_px, colour)) in [(13.0, [255; 3]), (10.0, INK), (6.0, tint)].into_iter().enumerate() {
            canvas.dot(object.centroid_m, 1e-4 * step as f32, radius_px, colour);
        }
        canvas.lay(ALWAYS);
    }
}

/// Ranks beside the ends of the stems, where no better rank is written already.
fn numbers(stems: &[(usize, [f32; 2])]) -> Vec<Word> {
    let mut words: Vec<Word> = Vec::new();
    for (place, stem) in stems {
        let size = if *place == 0 { 52 } else { 38 };
        let colour = if *place == 0 { BEST.map(|value| value / 2) } else { INK };
        let near = [(0, -1), (1, -1), (-1, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (0, 1)];
        let offsets = [34, 68, 102].into_iter().flat_map(|step| near.map(|(dx, dy)| (dx * step, dy * step)));
        let mut places = offsets.map(|(dx, dy)| (stem[0] as i32 + dx, stem[1] as i32 + dy));
        let is_free = |at: &(i32, i32)| {
            let inside = (30..PANEL[0] as i32 - 30).contains(&at.0) && (80..PANEL[1] as i32 - 30).contains(&at.1);
            inside && words.iter().all(|word| (word.at.0 - at.0).abs() > 38 || (word.at.1 - at.1).abs() > 46)
        };
        if let Some(at) = places.find(is_free) {
            words.push(Word { text: (place + 1).to_string(), at, size, colour });
        }
    }
    words
}

/// The number of grasps and the quality of the best.
fn summary(plan: &Plan) -> String {
    let count = |number: usize, what: &str| format!("{number} {what}{}", if number == 1 { "" } else { "s" });
    let mut text = format!("{}, {}", count(plan.grasps.len(), "grasp"), count(plan.objects.len(), "object"));
    if plan.grasps.len() > GRASPS_DRAWN_MAX {
        text.push_str(&format!("; the best {GRASPS_DRAWN_MAX} are drawn"));
    }
    if let Some(best) = plan.grasps.first() {
        text.push_str(&format!("; the best: quality {:.3}", best.quality));
        if let Some(width_m) = best.width_m {
            text.push_str(&format!(", width {:.0} mm", 1000.0 * width_m));
        }
        if let Some(rho_m) = best.rho_m {
            text.push_str(&format!(", rho {:.1} mm", 1000.0 * rho_m));
        }
    }
    text
}

/// What is in the picture, and how it is drawn.
fn legend(plan: &Plan) -> Vec<(Symbol, &'static str)> {
    let is_collision = |drop: &RejectReason| matches!(drop, RejectReason::Collision { .. });
    let dropped = |collisions: bool| plan.dropped.iter().any(|candidate| is_collision(&candidate.reason) == collisions);
    let labelled = |label: PointLabel| plan.cloud.labels.contains(&label);
    let entries = [
        (!plan.grasps.is_empty(), Symbol::Bar(10, BEST), "best grasp, its arrow the approach"),
        (plan.grasps.len() > 1, Symbol::Bar(5, of_place(1, 2)), "others: the lighter, the lower their rank"),
        (!plan.objects.is_empty(), Symbol::Ring(of_label(PointLabel::Object(0))), "object's centroid"),
        (labelled(PointLabel::Plane), Symbol::Square(of_label(PointLabel::Plane)), "plane"),
        (labelled(PointLabel::Noise), Symbol::Square(of_label(PointLabel::Noise)), "noise"),
        (dropped(true), Symbol::Dot(8, COLLISION), "dropped: would collide"),
        (dropped(false), Symbol::Dot(6, OTHER_DROP), "dropped: for another reason"),
    ];
    entries.into_iter().filter(|(is_there, ..)| *is_there).map(|(_, sample, name)| (sample, name)).collect()
}

#[cfg(test)]
mod tests {
    use report::still::lit;
    use schema::{Grid, axis_angle, pose_from_parts};

    use super::tints::Rgb;
    use super::*;
    use crate::config::Policy;
    use crate::plan::{FORMAT, Funnel, SegmentedCloud};

    fn gripper() -> Gripper {
        Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).unwrap()
    }

    /// Points on the upper five faces of a box from `low` to `high`, 2.5 mm apart.
    fn box_points(low: Vec3, high: Vec3) -> Vec<Vec3> {
        let steps = |axis: usize| (((high[axis] - low[axis]) / 0.0025).round() as usize).max(1);
        let mut points = Vec::new();
        for (i, j, k) in
            (0..=steps(0)).flat_map(|i| (0..=steps(1)).flat_map(move |j| (0..=steps(2)).map(move |k| (i, j, k))))
        {
            let on_side = i == 0 || j == 0 || i == steps(0) || j == steps(1);
            if on_side || k == steps(2) {
                points.push(low + Vec3::new(i as f32, j as f32, k as f32) * 0.0025);
            }
        }
        points
    }

    fn grasp(x: f32, y: f32, z: f32, turn_rad: f32, width_m: f32, quality: f32, object: usize) -> RankedGrasp {
        let down = axis_angle(Vec3::X, std::f32::consts::PI);
        let pose = pose_from_parts(axis_angle(Vec3::Z, turn_rad) * down, Vec3::new(x, y, z));
        RankedGrasp {
            rank: 0,
            workspace_from_grasp: pose,
            camera_from_grasp: None,
            base_from_grasp: None,
            workspace_from_flange: None,
            base_from_flange: None,
            width_m: Some(width_m),
            width_seen_share: None,
            opening_m: width_m,
            quality,
            robustness: None,
            object: Some(object),
            rho_m: Some(0.031),
            voxel: None,
        }
    }

    fn plan() -> Plan {
        let boxes = [
            (Vec3::new(0.05, 0.06, 0.05), Vec3::new(0.10, 0.10, 0.13)),
            (Vec3::new(0.16, 0.05, 0.05), Vec3::new(0.24, 0.09, 0.09)),
            (Vec3::new(0.10, 0.18, 0.05), Vec3::new(0.15, 0.25, 0.11)),
        ];
        let mut points_m = box_points(Vec3::new(0.0, 0.0, 0.05), Vec3::new(0.30, 0.30, 0.05));
        let mut labels = vec![PointLabel::Plane; points_m.len()];
        for (number, (low, high)) in boxes.into_iter().enumerate() {
            points_m.extend(box_points(low, high));
            labels.resize(points_m.len(), PointLabel::Object(number));
        }
        let objects = boxes.map(|(low, high)| ObjectCluster { centroid_m: (low + high) * 0.5, point_count: 2000 });
        Plan {
            format: FORMAT,
            model: String::new(),
            policy: Policy::Paper,
            gripper: String::new(),
            flange_from_grasp: None,
            region: Grid::PAPER.into(),
            workspace_from_camera: None,
            table: None,
            grasps: vec![
                grasp(0.075, 0.08, 0.10, 0.0, 0.04, 0.98, 0),
                grasp(0.20, 0.07, 0.06, 0.0, 0.04, 0.95, 1),
                grasp(0.125, 0.215, 0.08, std::f32::consts::FRAC_PI_2, 0.05, 0.93, 2),
            ],
            objects: objects.to_vec(),
            cloud: SegmentedCloud { points_m, labels, plane: None },
            funnel: Funnel::default(),
            reason: None,
            warnings: Vec::new(),
            dropped: Vec::new(),
            timings_ms: Vec::new(),
        }
    }

    fn empty() -> Plan {
        Plan {
            grasps: Vec::new(),
            objects: Vec::new(),
            cloud: SegmentedCloud { points_m: Vec::new(), labels: Vec::new(), plane: None },
            reason: Some("nothing was seen inside the workspace".to_owned()),
            ..plan()
        }
    }

    fn decoded(bytes: &[u8]) -> Vec<Rgb> {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width as usize, info.height as usize), (WIDTH_PX, HEIGHT_PX));
        pixels.as_chunks::<3>().0.to_vec()
    }

    fn count(pixels: &[Rgb], wanted: impl Fn(&Rgb) -> bool) -> usize {
        pixels.iter().filter(|pixel| wanted(pixel)).count()
    }

    fn near(pixel: Rgb, colour: Rgb, tolerance: u8) -> bool {
        pixel.iter().zip(colour).all(|(a, b)| a.abs_diff(b) <= tolerance)
    }

    /// Where a point is in the picture, in another way: in doubles, by the angle of sight and a box fitted by hand.
    fn pixel_of(view: usize, point: Vec3) -> [usize; 2] {
        let doubles = |v: Vec3| v.to_array().map(f64::from);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let unit = |a: [f64; 3]| a.map(|value| value / dot(a, a).sqrt());
        let outlook = VIEWS[view].1;
        let back = unit(doubles(outlook.towards_eye));
        let right = unit(cross(doubles(outlook.up), back));
        let up = cross(back, right);
        let eye = back.map(|value| 0.15 + value * f64::from(outlook.sides_away) * 0.30);
        let seen = |p: [f64; 3]| {
            let d = [p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]];
            [dot(d, right) / -dot(d, back), -dot(d, up) / -dot(d, back)]
        };
        let corner = |at: usize| [0, 1, 2].map(|bit| if at >> bit & 1 == 1 { 0.30 } else { 0.0 });
        let ends = |axis: usize| {
            let values = (0..8).map(|at| seen(corner(at))[axis]);
            [values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max)]
        };
        let panel = PANEL.map(|size| size as f64);
        let focal = [0, 1].map(|axis| 0.92 * panel[axis] / (ends(axis)[1] - ends(axis)[0]));
        let focal = focal[0].min(focal[1]);
        [0, 1].map(|axis| {
            let from_middle = seen(doubles(point))[axis] - 0.5 * (ends(axis)[0] + ends(axis)[1]);
            let large = 0.5 * panel[axis] + from_middle * focal + PANEL_CORNERS[view][axis] as f64;
            (large / 2.0) as usize
        })
    }

    #[test]
    fn objects_and_the_best_hand_are_where_they_belong() {
        let bare = decoded(&draw(&Plan { grasps: Vec::new(), ..plan() }, &gripper(), "three boxes").unwrap());
        let pixels = decoded(&draw(&plan(), &gripper(), "three boxes").unwrap());
        let at = |pixels: &[Rgb], [x, y]: [usize; 2]| pixels[y * WIDTH_PX + x];
        // Level faces are lit fully: they have their tint.
        for (object, top) in
            [(0, Vec3::new(0.057, 0.067, 0.13)), (1, Vec3::new(0.167, 0.057, 0.09)), (2, Vec3::new(0.143, 0.187, 0.11))]
        {
            let tint = of_label(PointLabel::Object(object));
            assert!(near(at(&bare, pixel_of(1, top)), tint, 12), "{object}: {:?}", at(&bare, pixel_of(1, top)));
        }
        // The best hand's fingers stand at y = 0.08 ± 25 mm, from z = 0.10 up to 0.15; the nearer is seen from the
        // side.
        let finger = at(&pixels, pixel_of(0, Vec3::new(0.075, 0.05, 0.12)));
        let shades = [0.92, 0.92 + 0.22, 0.92 - 0.22].map(|light| lit(BEST, light));
        assert!(shades.iter().any(|shade| near(finger, *shade, 6)), "{finger:?}");
        let greens = |pixels: &[Rgb]| count(pixels, |[r, g, b]| *g > 120 && *r < 40 && *b < 140);
        assert!(greens(&pixels) > 400);
        assert_eq!(greens(&bare), 0);
    }

    #[test]
    fn without_grasps_the_reason_is_written() {
        let spoken = decoded(&draw(&empty(), &gripper(), "nothing").unwrap());
        let silent = decoded(&draw(&Plan { reason: Some(String::new()), ..empty() }, &gripper(), "nothing").unwrap());
        let caption = (CAPTION_Y[1] as usize / 2 - 14) * WIDTH_PX..(CAPTION_Y[1] as usize / 2 + 14) * WIDTH_PX;
        let dark = |pixels: &[Rgb]| count(&pixels[caption.clone()], |pixel| pixel[1] < 100);
        assert_eq!(dark(&silent), 0);
        assert!(dark(&spoken) > 500, "{}", dark(&spoken));
        assert_eq!(spoken[..caption.start], silent[..caption.start]);
    }

    #[test]
    fn the_same_plan_gives_the_same_bytes_and_another_gives_others() {
        let bytes = |plan: &Plan, title: &str| draw(plan, &gripper(), title).unwrap();
        let first = bytes(&plan(), "title");
        assert_eq!(first, bytes(&plan(), "title"));
        assert_ne!(first, bytes(&plan(), "another"));
        let mut moved = plan();
        moved.grasps.swap(0, 1);
        assert_ne!(first, bytes(&moved, "title"));
    }

    #[test]
    fn dropped_candidates_are_dots_and_have_a_legend() {
        let dropped = |reason: RejectReason| DroppedCandidate::new(&grasp(0.27, 0.27, 0.06, 0.0, 0.04, 0.9, 0), reason);
        for (reason, colour) in
            [(RejectReason::Collision { points: 7 }, COLLISION), (RejectReason::Suppressed, OTHER_DROP)]
        {
            let pixels = decoded(&draw(&Plan { dropped: vec![dropped(reason)], ..plan() }, &gripper(), "").unwrap());
            for view in [0, 1] {
                let [x, y] = pixel_of(view, Vec3::new(0.27, 0.27, 0.06));
                assert!(near(pixels[y * WIDTH_PX + x], colour, 2), "{view}: {:?}", pixels[y * WIDTH_PX + x]);
            }
            assert!(count(&pixels[WIDTH_PX * 670..], |pixel| *pixel == colour) > 20);
        }
    }

    #[test]
    fn nonsense_is_drawn_as_far_as_it_goes() {
        let mut odd = plan();
        odd.cloud.points_m[0] = Vec3::splat(f32::NAN);
        odd.cloud.points_m[1] = Vec3::splat(1e30);
        odd.grasps[0].workspace_from_grasp.translation = Vec3::splat(f32::NAN);
        odd.grasps[1].opening_m = f32::INFINITY;
        let title = format!("{}\n\u{7}", "a title that is far too long ".repeat(50));
        decoded(&draw(&odd, &gripper(), &title).unwrap());
    }
}
