//! Turns a parsed request into an observation and options: reads files, checks cameras and poses, and adds the key's
//! path to each error. Over HTTP only the request itself is read.

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use schema::{Camera, Grid, Pose, Vec3};

use crate::frame::moved;
use crate::input::camera::{PoseInput, intrinsics, point, pose};
use crate::input::cloud::read_cloud;
use crate::input::depth::{SIDE_PX_MAX, read_depth};
use crate::input::error::{InputError, refuse, shown};
use crate::input::file::read_file;
use crate::input::mask::read_mask;
use crate::input::options::options;
use crate::input::request::{RequestInput, SourceInput, VIEWS_MAX, ViewInput, parse_file, parse_json};
use crate::input::tsdf::read_tsdf;
use crate::{Mask, Observation, PlanOptions, PoseKey, Target, View};

/// Maximum number of pixels of all its depth images together: 32 images of full HD, or four of the largest.
const PIXELS_MAX: usize = 4 * SIDE_PX_MAX * SIDE_PX_MAX;

/// A checked request.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The observation.
    pub observation: Observation,
    /// The options.
    pub options: PlanOptions,
    /// Warnings about unusual but valid input.
    pub warnings: Vec<String>,
}

/// Checks a request; its paths are relative to `folder`, and refused if that is `None`.
///
/// # Errors
/// [`InputError`], naming the key.
pub fn assemble(input: &RequestInput, folder: Option<&Path>, grid: Grid) -> Result<Request, InputError> {
    let mut options = options(input, finds_table(input))?;
    let grid = options.workspace(&grid);
    let PlanOptions { base_from_workspace, workspace_from_cloud, .. } = options;
    let mut assembly = Assembly { input, folder, base_from_workspace, workspace_from_cloud, warnings: Vec::new() };
    let observation = match (&input.views, &input.tsdf, &input.cloud) {
        (Some(views), None, None) => assembly.views(views).map(|(seen, masks)| {
            if masks.iter().any(Option::is_some) {
                options.limits.target = Some(Target::Masks(masks));
            }
            seen
        }),
        (None, Some(tsdf), None) => assembly.read(tsdf, "tsdf", |bytes| read_tsdf(bytes, grid)).map(Observation::Tsdf),
        (None, None, Some(cloud)) => assembly.cloud(cloud).map(|(seen, object_m)| {
            options.limits.target = object_m.map(Target::Points).or_else(|| options.limits.target.take());
            seen
        }),
        (views, tsdf, cloud) => {
            let given = [views.is_some(), tsdf.is_some(), cloud.is_some()].into_iter().filter(|is| *is).count();
            refuse(format!("a request must have exactly one of views, tsdf and cloud, got {given}"))
        }
    }?;
    let [of_cloud, of_views] = [("cloud", input.cloud.is_some()), ("views", input.views.is_some())];
    for (key, is_given, (whole, is_there)) in [
        ("eyes_m", input.eyes_m.is_some(), of_cloud),
        ("object", input.object.is_some(), of_cloud),
        ("workspace_from_cloud", input.workspace_from_cloud.is_some(), of_cloud),
        ("intrinsics", input.intrinsics.is_some(), of_views),
    ] {
        if is_given && !is_there {
            return refuse(format!("{key} goes with {whole}: {key}"));
        }
    }
    Ok(Request { observation, options, warnings: assembly.warnings })
}

/// Whether the table is to be found: `"table"` stands for the pose of the first view, or of the cloud.
fn finds_table(input: &RequestInput) -> bool {
    let first = input.views.as_ref().and_then(|views| views.first()?.workspace_from_camera.as_ref());
    [first, input.workspace_from_cloud.as_ref()].contains(&Some(&PoseInput::Table))
}

/// A request to the service: without paths, because the service reads no files.
///
/// # Errors
/// [`InputError`], naming the key; [`InputError::is_syntax`] if it is not JSON.
pub fn from_json(bytes: &[u8], grid: Grid) -> Result<Request, InputError> {
    assemble(&parse_json::<RequestInput>(bytes)?, None, grid)
}

/// A request from a file, TOML or JSON, after some `changes`; its paths are relative to the file's folder.
///
/// # Errors
/// [`InputError`], naming the key and the file.
pub fn from_file(path: &Path, grid: Grid, changes: impl FnOnce(&mut RequestInput)) -> Result<Request, InputError> {
    let mut input = parse_file(path)?;
    changes(&mut input);
    let folder = path.parent().unwrap_or(Path::new(""));
    assemble(&input, Some(folder), grid).map_err(|error| error.at(&path.display().to_string()))
}

/// The bytes of base64, whose line ends and blanks are skipped: `base64` wraps its lines.
pub(crate) fn decode_base64(text: &str) -> Result<Vec<u8>, base64::DecodeError> {
    // Text without blanks, the usual one, is not looked at twice.
    STANDARD
        .decode(text)
        .or_else(|_| STANDARD.decode(text.bytes().filter(|byte| !byte.is_ascii_whitespace()).collect::<Vec<u8>>()))
}

/// A request whose observation is being read.
struct Assembly<'a> {
    input: &'a RequestInput,
    folder: Option<&'a Path>,
    base_from_workspace: Option<Pose>,
    workspace_from_cloud: Option<Pose>,
    warnings: Vec<String>,
}

impl Assembly<'_> {
    /// The content of a source, parsed by `parse`, with the key's path on every error.
    fn read<T>(
        &self,
        source: &SourceInput,
        at: &str,
        parse: impl FnOnce(&[u8]) -> Result<T, InputError>,
    ) -> Result<T, InputError> {
        let bytes = match (source, self.folder) {
            (SourceInput::Data(input), _) => decode_base64(&input.data).map_err(|error| {
                InputError::Value(format!("must be base64 of the standard alphabet, padded: {error}: {at}.data"))
            })?,
            (SourceInput::Path(path), Some(folder)) => read_file(&folder.join(path))?,
            (SourceInput::Path(_), None) => {
                return refuse(format!("over HTTP a file is {{ \"data\": \"<base64>\" }}, a path is refused: {at}"));
            }
        };
        parse(&bytes).map_err(|error| match source {
            SourceInput::Path(path) => error.at(&shown(path)).at(at),
            SourceInput::Data(_) => error.at(at),
        })
    }

    /// The views, and of each its mask.
    fn views(&mut self, views: &[ViewInput]) -> Result<(Observation, Vec<Option<Mask>>), InputError> {
        if !(1..=VIEWS_MAX).contains(&views.len()) {
            return refuse(format!("must have 1 to {VIEWS_MAX} entries, got {}: views", views.len()));
        }
        let mut pixels_left = PIXELS_MAX;
        if let (Some(number), Some(_)) = (views.iter().position(|view| view.mask.is_some()), self.input.target_m) {
            return refuse(format!("a request has either masks or target_m: views[{number}].mask"));
        }
        let mut seen: Vec<View> = Vec::with_capacity(views.len());
        let mut masks = Vec::with_capacity(views.len());
        for (number, view) in views.iter().enumerate() {
            let at = format!("views[{number}]");
            let first = seen.first().map(|first| first.camera.workspace_from_camera);
            let (pose, key) = self.place_of(view, first, &at)?;
            let given_mask = view.mask.as_ref();
            let view = self.view(view, pose, key, &at, pixels_left)?;
            let size = [view.image.width_px, view.image.height_px];
            let read = |source| self.read(source, &format!("{at}.mask"), |bytes| read_mask(bytes, size));
            masks.push(given_mask.map(read).transpose()?);
            pixels_left -= view.image.depth_m.len();
            seen.push(view);
        }
        Ok((Observation::Views(seen), masks))
    }

    fn view(
        &mut self,
        view: &ViewInput,
        workspace_from_camera: Pose,
        key: PoseKey,
        at: &str,
        pixels_max: usize,
    ) -> Result<View, InputError> {
        let (lens, lens_at) = match (&view.intrinsics, &self.input.intrinsics) {
            (Some(lens), _) => (lens, format!("{at}.intrinsics")),
            (None, Some(lens)) => (lens, "intrinsics".to_owned()),
            (None, None) => return refuse(format!("neither the view nor the request has intrinsics: {at}")),
        };
        let depth_at = format!("{at}.depth");
        let scale_m = view.depth_scale_m.map(|scale_m| scale_m as f32);
        let (image, odd) = self.read(&view.depth, &depth_at, |bytes| read_depth(bytes, scale_m, pixels_max))?;
        self.warnings.extend(odd.into_iter().map(|warning| format!("{warning}: {depth_at}")));
        let intrinsics = intrinsics(lens, [image.width_px, image.height_px], &lens_at)?;
        Ok(View { image, camera: Camera { intrinsics, workspace_from_camera }, key })
    }

    /// The camera in the workspace, from its pose under one of five keys. Where the table is to be found, the first
    /// camera's frame stands for the workspace.
    fn place_of(&self, view: &ViewInput, first: Option<Pose>, at: &str) -> Result<(Pose, PoseKey), InputError> {
        let given = [
            &view.workspace_from_camera,
            &view.camera_from_workspace,
            &view.base_from_camera,
            &view.camera_from_base,
            &view.first_from_camera,
        ];
        let mut given = PoseKey::ALL.into_iter().zip(given).filter_map(|(key, input)| Some((key, input.as_ref()?)));
        let (Some((key, input)), None) = (given.next(), given.next()) else {
            let [keys @ .., last] = PoseKey::ALL.map(PoseKey::name);
            return refuse(format!(
                "a view must have exactly one of {} and {last} (or workspace_from_camera = \"table\", to find the table): {at}",
                keys.join(", ")
            ));
        };
        let at = format!("{at}.{}", key.name());
        if first.is_none() && (key, input) == (PoseKey::WorkspaceFromCamera, &PoseInput::Table) {
            return Ok((Pose::IDENTITY, key));
        }
        let given = pose(input, &at)?;
        let target_from_camera = if key.is_inverse() { given.inverse() } else { given };
        let workspace_from_target = match (key, self.base_from_workspace, first) {
            (PoseKey::FirstFromCamera, _, Some(first)) => first,
            (PoseKey::FirstFromCamera, _, None) => return refuse(format!("is for views after the first: {at}")),
            (_, Some(base_from_workspace), _) if key.is_of_base() => base_from_workspace.inverse(),
            (_, None, _) if key.is_of_base() => {
                return refuse(format!("needs the request's base_from_workspace: {at}"));
            }
            _ if finds_table(self.input) => {
                return refuse(format!("must be first_from_camera, as the table is found: {at}"));
            }
            _ => Pose::IDENTITY,
        };
        Ok((workspace_from_target * target_from_camera, key))
    }

    /// The cloud with its object, and the points of that.
    fn cloud(&mut self, cloud: &SourceInput) -> Result<(Observation, Option<Vec<Vec3>>), InputError> {
        let eye = |(number, xyz): (usize, &[f64; 3])| point(*xyz, &format!("eyes_m[{number}]"));
        let eyes = |rows: &Vec<[f64; 3]>| rows.iter().enumerate().map(eye).collect::<Result<Vec<Vec3>, _>>();
        let given = self.input.eyes_m.as_ref().map(eyes).transpose()?;
        let mut points_m = self.points(cloud, "cloud")?;
        let mut object_m = match &self.input.object {
            Some(_) if self.input.target_m.is_some() => {
                return refuse("a request has either object or target_m: object");
            }
            Some(object) => Some(self.points(object, "object")?),
            None => None,
        };
        points_m.extend(object_m.iter().flatten());
        let seen = Observation::Cloud { points_m, eyes_m: given.unwrap_or_default() };
        let Some(workspace_from_cloud) = self.workspace_from_cloud else { return Ok((seen, object_m)) };
        object_m.iter_mut().flatten().for_each(|at_m| *at_m = workspace_from_cloud * *at_m);
        Ok((moved(&seen, &workspace_from_cloud), object_m))
    }

    /// The points of a file.
    fn points(&mut self, source: &SourceInput, key: &str) -> Result<Vec<Vec3>, InputError> {
        let (points_m, dropped) = self.read(source, key, read_cloud)?;
        if dropped > points_m.len() {
            let left = points_m.len();
            self.warnings
                .push(format!("{dropped} points without finite coordinates were left out, {left} are left: {key}"));
        }
        Ok(points_m)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use schema::{Intrinsics, VoxelGrid};
    use serde_json::{Value, json};

    use super::*;
    use crate::Policy;
    use crate::input::tests::{npy_of, png_of};

    fn base64(bytes: &[u8]) -> Value {
        json!({ "data": STANDARD.encode(bytes) })
    }

    fn png() -> Vec<u8> {
        png_of(4, 3, &[600; 12])
    }

    fn lens() -> Value {
        json!({ "fx_px": 5, "fy_px": 5, "cx_px": 2, "cy_px": 1.5 })
    }

    /// Shifted by 1 m along x.
    fn shifted() -> Value {
        json!([[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    }

    fn request() -> Value {
        json!({ "views": [{ "depth": base64(&png()), "intrinsics": lens(), "workspace_from_camera": shifted() }] })
    }

    fn read(request: &Value) -> Result<Request, InputError> {
        from_json(request.to_string().as_bytes(), Grid::PAPER)
    }

    fn message(request: &Value) -> String {
        read(request).unwrap_err().to_string()
    }

    fn views(request: &Request) -> &[View] {
        let Observation::Views(views) = &request.observation else { panic!("no views") };
        views
    }

    #[test]
    fn a_view_is_an_image_a_lens_and_a_pose() {
        let read = read(&request()).unwrap();
        let [view] = views(&read) else { panic!("one view") };
        assert_eq!(view.image.depth_m, [0.6; 12]);
        let lens = Intrinsics { width_px: 4, height_px: 3, fx_px: 5.0, fy_px: 5.0, cx_px: 2.0, cy_px: 1.5 };
        assert_eq!(view.camera.intrinsics, lens);
        assert_eq!(view.camera.workspace_from_camera.translation, Vec3::X);
        assert_eq!(read.options, PlanOptions::default());
        assert!(read.warnings.is_empty());
    }

    #[test]
    fn base64_may_have_line_ends_and_blanks() {
        let mut request = request();
        let text = request["views"][0]["depth"]["data"].as_str().unwrap().to_owned();
        let lines: Vec<_> = text.as_bytes().chunks(76).map(|line| str::from_utf8(line).unwrap()).collect();
        for wrapped in [lines.join("\n") + "\n", lines.join("\r\n"), format!(" {text}\t")] {
            request["views"][0]["depth"]["data"] = json!(wrapped);
            assert_eq!(read(&request).unwrap(), read(&super::tests::request()).unwrap());
        }
        request["views"][0]["depth"]["data"] = json!(lines.join("\n").replacen('A', "?", 1));
        let said = message(&request);
        assert!(said.starts_with("must be base64 of the standard alphabet, padded: Invalid symbol 63"), "{said}");
    }

    #[test]
    fn a_camera_may_be_given_in_the_robots_base() {
        let mut request = request();
        let view = request["views"][0].as_object_mut().unwrap();
        view.remove("intrinsics");
        view.remove("workspace_from_camera");
        view.insert("base_from_camera".to_owned(), json!({ "position_m": [1, 1, 2], "quaternion_xyzw": [0, 0, 0, 1] }));
        request["intrinsics"] = lens();
        assert!(message(&request).ends_with("needs the request's base_from_workspace: views[0].base_from_camera"));
        // The workspace's x is the base's y, and it lies at (1, 0, 0): the camera is at (1, 0, 2) in it.
        request["base_from_workspace"] = json!([[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
        let read = read(&request).unwrap();
        let at_m = views(&read)[0].camera.workspace_from_camera.translation;
        assert!((at_m - Vec3::new(1.0, 0.0, 2.0)).length() < 1e-6, "{at_m}");
        assert!(read.options.base_from_workspace.is_some());
        // The inverse under its own name: the camera's frame has the axes of the base, so the base is at (-1, -1, -2).
        let view = request["views"][0].as_object_mut().unwrap();
        view.remove("base_from_camera");
        view.insert(
            "camera_from_base".to_owned(),
            json!({ "position_m": [-1, -1, -2], "quaternion_xyzw": [0, 0, 0, 1] }),
        );
        let inverse = super::tests::read(&request).unwrap();
        assert_eq!(views(&inverse)[0].camera, views(&read)[0].camera);
    }

    #[test]
    fn an_extrinsic_matrix_may_be_given_as_it_is() {
        let mut request = request();
        let view = request["views"][0].as_object_mut().unwrap();
        view.remove("workspace_from_camera");
        view.insert("camera_from_workspace".to_owned(), shifted());
        let at_m = views(&read(&request).unwrap())[0].camera.workspace_from_camera.translation;
        assert!((at_m + Vec3::X).length() < 1e-6, "{at_m}");
    }

    #[test]
    fn options_are_read() {
        let mut request = request();
        request["policy"] = json!("vgn-best");
        request["check_collisions"] = json!(false);
        request["grasps_max"] = json!(7);
        request["explain"] = json!(true);
        request["workspace_from_wrist"] = json!({ "quaternion_xyzw": [1, 0, 0, 0] });
        let options = read(&request).unwrap().options;
        assert_eq!((options.policy, options.check_collisions), (Some(Policy::VgnBest), Some(false)));
        assert_eq!((options.grasps_max, options.explain), (Some(7), true));
        assert_eq!(options.workspace_from_wrist, Some(schema::Quat::from_xyzw(1.0, 0.0, 0.0, 0.0)));
    }

    #[test]
    fn grids_and_clouds_are_taken_too() {
        let grid = VoxelGrid::new(Grid::PAPER, vec![0.25; 64_000]).unwrap();
        let request = json!({ "tsdf": base64(&npy_of(&[1, 40, 40, 40], &grid.values)) });
        assert_eq!(read(&request).unwrap().observation, Observation::Tsdf(grid));
        let points = [0.1, 0.1, 0.1, f32::NAN, 0.0, 0.0, f32::NAN, 0.0, 0.0];
        let request = json!({ "cloud": base64(&npy_of(&[3, 3], &points)), "eyes_m": [[0, 0, 1], [0, 1, 1]] });
        let read = read(&request).unwrap();
        let (points_m, eyes_m) = (vec![Vec3::splat(0.1)], vec![Vec3::Z, Vec3::new(0.0, 1.0, 1.0)]);
        assert_eq!(read.observation, Observation::Cloud { points_m, eyes_m });
        assert_eq!(read.warnings, ["2 points without finite coordinates were left out, 1 are left: cloud"]);
    }

    #[test]
    fn each_error_names_its_key() {
        let with = |pointer: &str, value: Value| {
            let mut request = request();
            let (table, key) = pointer.rsplit_once('/').unwrap();
            request.pointer_mut(table).unwrap()[key] = value;
            message(&request)
        };
        let cases = [
            ("/color", json!(1), "unknown field `color`"),
            ("/views/0/color", json!(1), ": views[0]"),
            ("/views/0/intrinsics", json!({ "fx_px": 1 }), "missing field `fy_px`: views[0].intrinsics"),
            ("/views/0/depth", json!("depth.png"), "a path is refused: views[0].depth"),
            ("/views/0/depth", json!({ "data": "?" }), ": views[0].depth.data"),
            ("/views/0/depth", base64(b"GIF89a"), "got other bytes: views[0].depth"),
            ("/views/0/depth", base64(&png_of(1, 1, &[0])), "no pixel has a depth: views[0].depth"),
            ("/views/0/depth_scale_m", json!(5), "depth_scale_m must be between 1e-6 and 1, got 5: views[0].depth"),
            ("/views/0/workspace_from_camera", json!([[1]]), ": views[0].workspace_from_camera"),
            ("/views/0/workspace_from_camera", json!("up"), ": views[0].workspace_from_camera"),
            ("/base_from_workspace", json!("table"), "or a cloud's pose: base_from_workspace"),
            (
                "/views/0/base_from_camera",
                shifted(),
                "exactly one of workspace_from_camera, camera_from_workspace, base_from_camera, camera_from_base and first_from_camera (or",
            ),
            ("/views/0/workspace_from_camera", Value::Null, "exactly one of"),
            ("/views/0/intrinsics", Value::Null, "has intrinsics: views[0]"),
            ("/views", json!([]), "must have 1 to 32 entries, got 0: views"),
            ("/views", json!("many"), ": views"),
            ("/views", Value::Null, "exactly one of views, tsdf and cloud, got 0"),
            ("/tsdf", base64(b""), "exactly one of views, tsdf and cloud, got 2"),
            ("/eyes_m", json!([[0, 0, 0]]), "eyes_m goes with cloud"),
            ("/policy", json!("best"), "expected one of `paper`, `vgn-random`, `vgn-best`: policy"),
            ("/grasps_max", json!(0), "must be between 1 and 10000, got 0: grasps_max"),
            ("/grasps_max", json!(-1), ": grasps_max"),
            ("/avoid", json!([[1]]), ": avoid"),
            (
                "/avoid",
                json!(vec![json!({ "position_m": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1] }); 257]),
                "at most 256",
            ),
            ("/eyes_m", json!([[0, 0, 1], [0, 0]]), "must have 3 numbers, got 2: eyes_m[1]"),
            ("/views/0/intrinsics/fx_px", json!("wide"), ": views[0].intrinsics.fx_px"),
            ("/base_from_workspace", json!([[1]]), ": base_from_workspace"),
            ("/workspace_from_wrist", json!({ "quaternion_xyzw": [0, 0, 1] }), ": workspace_from_wrist"),
        ];
        for (pointer, value, wanted) in cases {
            let message = with(pointer, value);
            assert!(message.contains(wanted), "{pointer}: {message}");
        }
    }

    #[test]
    fn what_is_not_json_is_distinguished_from_what_is_wrong() {
        for text in ["", "{", "views", "{\"views\": [}", "\u{0}"] {
            assert!(from_json(text.as_bytes(), Grid::PAPER).unwrap_err().is_syntax(), "{text}");
        }
        let no_lens = "{\"intrinsics\": [540, 480, 540, 540, 320, 240, 0, 0, 1]}";
        let too_large = "{\"intrinsics\": {\"fx_px\": 1e999}}";
        for text in ["[]", "7", "{}", "{\"views\": 7}", no_lens, too_large] {
            assert!(!from_json(text.as_bytes(), Grid::PAPER).unwrap_err().is_syntax(), "{text}");
        }
        let no_text = from_json(b"{\"policy\": \"\xff\"}", Grid::PAPER).unwrap_err();
        assert!(no_text.is_syntax() && no_text.to_string().contains("not UTF-8"), "{no_text}");
    }

    #[test]
    fn files_in_both_languages_say_the_same() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("depth-0.png"), png()).unwrap();
        let toml = "intrinsics = { fx_px = 5, fy_px = 5.0, cx_px = 2, cy_px = 1.5 }\n[[views]]\n\
                    depth = \"depth-0.png\"\n\
                    workspace_from_camera = [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n";
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            fs::write(&path, text).unwrap();
            path
        };
        let wanted = read(&request()).unwrap();
        assert_eq!(from_file(&write("request.toml", toml), Grid::PAPER, |_| ()).unwrap(), wanted);
        let json = request().to_string();
        assert_eq!(from_file(&write("request.json", &json), Grid::PAPER, |_| ()).unwrap(), wanted);
        assert_eq!(from_file(&write("request", &json), Grid::PAPER, |_| ()).unwrap(), wanted, "by its first byte");
        let said = |name: &str, text: &str| from_file(&write(name, text), Grid::PAPER, |_| ()).unwrap_err().to_string();
        assert!(said("a.toml", &toml.replace("depth-0", "depth-1")).contains("depth-1.png: "));
        let unknown = said("b.toml", &toml.replace("depth =", "deep ="));
        assert!(unknown.contains("views[0]") && unknown.ends_with("b.toml"), "{unknown}");
        assert!(said("c.toml", &format!("{toml}depth_scale_m = nan\n")).contains("depth_scale_m must be between"));
        assert!(said("d.toml", "views = [").starts_with("not TOML"));
        assert!(
            from_file(&folder.path().join("none.toml"), Grid::PAPER, |_| ())
                .unwrap_err()
                .to_string()
                .contains("none.toml: ")
        );
    }

    #[test]
    fn a_request_has_at_most_32_views() {
        let mut request = request();
        let view = request["views"][0].clone();
        request["views"] = Value::Array(vec![view; 33]);
        assert_eq!(message(&request), "must have at most 32 entries, got 33: views");
    }

    #[test]
    fn a_cloud_has_at_most_32_eyes() {
        let cloud = base64(&npy_of(&[1, 3], &[0.1; 3]));
        let seen_from = |count: usize| json!({ "cloud": cloud, "eyes_m": vec![[0, 0, 1]; count] });
        assert!(read(&seen_from(32)).is_ok());
        assert_eq!(message(&seen_from(33)), "must have at most 32 entries, got 33: eyes_m");
    }
}
