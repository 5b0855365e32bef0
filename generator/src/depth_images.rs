//! Depth images of a stored scene, as the cameras of its dataset saw it.

use perception::{SensorParams, camera_at};
use program::Failure;
use schema::{CameraParams, DepthImage, SceneRows};
use shards::DatasetInfo;
use simulator::{Scene, SceneRays};

use crate::build::sensor;
use crate::dataset_info::{bodies_of, info_lacks};

/// The images that the scene's TSDF was made of, with the noise of the dataset's sensor, if it has one.
///
/// # Errors
/// If the dataset does not say what its cameras saw.
pub fn depth_images(info: &DatasetInfo, rows: &SceneRows) -> Result<Vec<DepthImage>, Failure> {
    let lens = info.section::<CameraParams>("camera").ok_or_else(|| info_lacks(" has no camera"))?.intrinsics();
    let fixtures = rows.scene.fixtures(&info.grid);
    let scene = Scene::from_records(info.grid.table_z_m, fixtures, &rows.objects, &bodies_of(info)?);
    let rays = SceneRays::new(&scene);
    let params = info.section::<SensorParams>("sensor");
    let mut sensor = params.as_ref().map(|params| sensor(params, info.seed, rows.scene.scene_id, &lens));
    let cameras = rows.scene.views.iter().map(|view| camera_at(view, &info.grid, lens));
    let image = |camera| match &mut sensor {
        Some(sensor) => sensor.image(&camera, |real| rays.render(real)),
        None => rays.render(&camera),
    };
    Ok(cameras.map(image).collect())
}
