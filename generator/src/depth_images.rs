//! Depth images of a stored scene, as a robot's camera would save them, and the views file for the planner.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

use perception::{SensorParams, camera_at};
use program::{Context, Failure, write};
use schema::{Camera, CameraParams, DepthImage, Intrinsics, View};
use shards::Dataset;
use simulator::{Scene, SceneRays};

use crate::build::sensor;
use crate::dataset_info::{bodies_of, info_lacks};

/// Metres per unit of the images: a tenth of a millimetre, so that rounding is negligible against a voxel.
const SCALE_M: f32 = 1e-4;

/// Writes `depth-0.png` (16 bit) and so on, and `views.toml`, into `folder`; returns the path of the latter.
/// The images are those that the scene's TSDF was made of, with the noise of its sensor; or, without noise, from so
/// many views evenly around it (VGN: 30° from the vertical, two workspaces away).
///
/// # Errors
/// If the dataset does not say what its cameras saw, or the folder cannot be written.
pub fn write_depth_images(
    dataset: &Dataset,
    scene_id: u64,
    from: Option<u8>,
    folder: &Path,
) -> Result<PathBuf, Failure> {
    let info = dataset.info();
    let rows = dataset.read_scene(scene_id)?;
    let lens = info.section::<CameraParams>("camera").ok_or_else(|| info_lacks(" has no camera"))?.intrinsics();
    let views = match from {
        None => rows.scene.views.clone(),
        Some(count) => around(count, info.grid.size_m),
    };
    let scene =
        Scene::from_records(info.grid.table_z_m, rows.scene.fixtures(&info.grid), &rows.objects, &bodies_of(info)?);
    let rays = SceneRays::new(&scene);
    fs::create_dir_all(folder).context(format_args!("failed to write {}", folder.display()))?;
    let mut text = head(dataset, scene_id, &lens);
    let params = info.section::<SensorParams>("sensor").filter(|_| from.is_none());
    let mut sensor = params.as_ref().map(|params| sensor(params, info.seed, scene_id, &lens));
    for (number, view) in views.iter().enumerate() {
        let camera = camera_at(view, &info.grid, lens);
        let name = format!("depth-{number}.png");
        let image = match &mut sensor {
            Some(sensor) => sensor.image(&camera, |real| rays.render(real)),
            None => rays.render(&camera),
        };
        write(&folder.join(&name), png(&image)?)?;
        add_view(&mut text, &name, &camera);
    }
    let path = folder.join("views.toml");
    write(&path, text)?;
    Ok(path)
}

fn around(count: u8, size_m: f32) -> Vec<View> {
    let azimuth = |number: u8| core::f32::consts::TAU * f32::from(number) / f32::from(count);
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
        "# Scene {scene_id} of dataset {}, for graspmill plan --views.\n\n\
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

fn png(image: &DepthImage) -> io::Result<Vec<u8>> {
    let units = |depth_m: &f32| (depth_m / SCALE_M).round().clamp(0.0, f32::from(u16::MAX)) as u16;
    let data: Vec<u8> = image.depth_m.iter().flat_map(|depth_m| units(depth_m).to_be_bytes()).collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width_px as u32, image.height_px as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&data)?;
    writer.finish()?;
    Ok(bytes)
}
