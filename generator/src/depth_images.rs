//! Depth images of a stored scene, as a robot's camera would save them, and the views file for the planner.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use perception::camera_at;
use program::{Exit, ExitCode};
use schema::{Camera, CameraParams, DepthImage, Intrinsics, View};
use shards::{Dataset, ReadError};
use simulator::{ModelError, Scene, SceneRays, bodies_of};

/// Metres per unit of the images: a tenth of a millimetre, so that rounding is negligible against a voxel.
const SCALE_M: f32 = 1e-4;

/// The views of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Views {
    /// The views of its TSDF.
    Stored,
    /// This many views evenly around it (VGN: 30° from the vertical, two workspaces away).
    Around(usize),
}

/// Why no images were written.
#[derive(Debug, thiserror::Error)]
pub enum DepthImagesError {
    /// The dataset cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The dataset does not say what its camera was.
    #[error("meta/info.json has no camera")]
    Camera,
    /// A model of the dataset is no body.
    #[error("meta/info.json: {0}")]
    Model(#[from] ModelError),
    /// The folder cannot be written.
    #[error("failed to write: {source}: {}", .path.display())]
    Write {
        /// What was to be written.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl Exit for DepthImagesError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Read(error) => error.exit_code(),
            Self::Camera | Self::Model(_) => ExitCode::Data,
            Self::Write { .. } => ExitCode::TryAgain,
        }
    }
}

/// Writes `depth-0.png` (16 bit) and so on, and `views.toml`, into `folder`; returns the path of the latter.
///
/// # Errors
/// [`DepthImagesError`].
pub fn write_depth_images(
    dataset: &Dataset,
    scene_id: u64,
    views: Views,
    folder: &Path,
) -> Result<PathBuf, DepthImagesError> {
    let info = dataset.info();
    let rows = dataset.read_scene(scene_id)?;
    let lens = info.section::<CameraParams>("camera").ok_or(DepthImagesError::Camera)?.intrinsics();
    let views = match views {
        Views::Stored => rows.scene.views.clone(),
        Views::Around(count) => around(count, info.grid.size_m),
    };
    let scene = Scene::from_records(info.grid.table_z_m, &rows.objects, &bodies_of(&info.models)?);
    let rays = SceneRays::new(&scene);
    let written = |path: &Path, result: io::Result<()>| {
        result.map_err(|source| DepthImagesError::Write { path: path.to_owned(), source })
    };
    written(folder, fs::create_dir_all(folder))?;
    let mut text = head(dataset, scene_id, &lens);
    for (number, view) in views.iter().enumerate() {
        let camera = camera_at(view, &info.grid, lens);
        let name = format!("depth-{number}.png");
        let path = folder.join(&name);
        written(&path, write_png(&path, &rays.render(&camera)))?;
        add_view(&mut text, &name, &camera);
    }
    let path = folder.join("views.toml");
    written(&path, fs::write(&path, text))?;
    Ok(path)
}

fn around(count: usize, size_m: f32) -> Vec<View> {
    let azimuth = |number: usize| core::f32::consts::TAU * number as f32 / count as f32;
    (0..count)
        .map(|number| View {
            radius_m: 2.0 * size_m,
            polar_rad: core::f32::consts::FRAC_PI_6,
            azimuth_rad: azimuth(number),
        })
        .collect()
}

fn head(dataset: &Dataset, scene_id: u64, lens: &Intrinsics) -> String {
    let Intrinsics { width_px, height_px, fx_px, fy_px, cx_px, cy_px } = lens;
    format!(
        "# Scene {scene_id} of dataset {}, for planner plan --views.\n\n\
         [intrinsics]\nwidth_px = {width_px}\nheight_px = {height_px}\nfx_px = {fx_px:?}\nfy_px = {fy_px:?}\n\
         cx_px = {cx_px:?}\ncy_px = {cy_px:?}\n",
        dataset.id()
    )
}

fn add_view(text: &mut String, name: &str, camera: &Camera) {
    let pose = camera.workspace_from_camera;
    let (position, rotation) = (pose.translation.to_array(), pose.rotation.to_array());
    // Writing into a String cannot fail.
    let _ = write!(
        text,
        "\n[[views]]\ndepth = \"{name}\"\ndepth_scale_m = {SCALE_M:?}\n\
         workspace_from_camera = {{ position_m = {position:?}, quaternion_xyzw = {rotation:?} }}\n"
    );
}

fn write_png(path: &Path, image: &DepthImage) -> io::Result<()> {
    let units = |depth_m: &f32| (depth_m / SCALE_M).round().clamp(0.0, f32::from(u16::MAX)) as u16;
    let bytes: Vec<u8> = image.depth_m.iter().flat_map(|depth_m| units(depth_m).to_be_bytes()).collect();
    let mut file = BufWriter::new(File::create(path)?);
    let mut encoder = png::Encoder::new(&mut file, image.width_px as u32, image.height_px as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&bytes)?;
    writer.finish()?;
    file.flush()
}
