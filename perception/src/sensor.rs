//! A depth camera as robots have it: with its noise, and not exactly where it is believed to stand.

use schema::{Camera, DepthImage, Grid, Stream, Vec3, axis_angle};
use serde::Serialize;
use settings::{Reader, settings, words};

use crate::{DepthNoise, DexNoise, StereoNoise, add_depth_noise, depth_factor, table_around};

words! {
    /// A model of a sensor's noise.
    pub enum NoiseKind {
        /// None.
        None = "none",
        /// Independent in every pixel.
        Gaussian = "gaussian",
        /// A RealSense D435's by its data sheet.
        D435 = "d435",
        /// GIGA's.
        Dex = "dex",
        /// A D435's as it was measured, with the colour camera's view.
        D435Real = "d435_real",
        /// A Kinect's of 2010.
        Kinect = "kinect",
    }
}

impl NoiseKind {
    /// The noise; `std_m` is that of `gaussian`, `focal_px` the lens of sensors.
    #[must_use]
    pub fn noise(self, std_m: f32, focal_px: f32) -> DepthNoise {
        match self {
            Self::None => DepthNoise::None,
            Self::Gaussian => DepthNoise::Gaussian { std_m },
            Self::Dex => DepthNoise::Dex(DexNoise::GIGA),
            Self::D435 => DepthNoise::Stereo(StereoNoise { focal_px, ..StereoNoise::D435 }),
            Self::D435Real => DepthNoise::Stereo(StereoNoise::D435_REAL.through(focal_px)),
            Self::Kinect => DepthNoise::Stereo(StereoNoise::KINECT.through(focal_px)),
        }
    }
}

settings! {
    /// Sensor noise and errors of the cameras' poses in a dataset. The kind of noise is drawn for a scene, the errors
    /// for a view.
    #[derive(Debug, Clone, PartialEq, Serialize)]
    pub struct SensorParams {
        /// Kinds of noise …
        pub noise: Vec<NoiseKind>,
        /// … and how often each is drawn, relative to each other.
        pub noise_weights: Vec<f32> where 0.0..=1e6,
        /// Standard deviation of `gaussian`, uniform.
        pub gaussian_std_m: [f32; 2] where 0.0..=0.1,
        /// Standard deviation, along each axis, of how far a camera stands from where it is believed to stand.
        pub position_error_m: f32 where 0.0..=0.1,
        /// Standard deviation, about each axis, of how it is turned.
        pub rotation_error_rad: f32 where 0.0..=0.2,
        /// Whether each image is first scaled so that most of it lies on the table, as `cloud.scale_to_table` of a
        /// planner does.
        pub scale_to_table: bool,
    }
    check SensorParams::lists_agree
}

impl SensorParams {
    fn lists_agree(&self, reader: &mut Reader<'_>) {
        let (kinds, weights) = (self.noise.len(), self.noise_weights.len());
        reader.must("noise", kinds > 0, || "must have at least one kind, got none");
        reader.must("noise_weights", kinds == weights, || {
            format!("must have as many values as noise, {kinds}, got {weights}")
        });
        reader.must("noise_weights", self.noise_weights.iter().sum::<f32>() > 0.0, || "must not all be 0");
    }
}

/// The sensor of a scene: its noise was drawn.
#[derive(Debug)]
pub struct Sensor<'a> {
    params: &'a SensorParams,
    /// Which noise it has.
    pub kind: NoiseKind,
    noise: DepthNoise,
    stream: Stream,
}

impl<'a> Sensor<'a> {
    /// Draws the noise of a scene's sensor.
    #[must_use]
    pub fn draw(params: &'a SensorParams, focal_px: f32, mut stream: Stream) -> Self {
        let kind = *stream.weighted(&params.noise, &params.noise_weights);
        let std_m = stream.uniform(params.gaussian_std_m[0], params.gaussian_std_m[1]);
        Self { params, kind, noise: kind.noise(std_m, focal_px), stream }
    }

    /// The image of the camera that is believed to be `camera`, from `render`, which knows the scene; view after view.
    pub fn image(&mut self, camera: &Camera, render: impl FnOnce(&Camera) -> DepthImage) -> DepthImage {
        let mut image = render(&self.misplaced(camera));
        add_depth_noise(&mut image, &self.noise, &mut self.stream);
        image
    }

    /// The image as it is fused.
    #[must_use]
    pub fn corrected(&self, mut image: DepthImage, camera: &Camera, grid: &Grid) -> DepthImage {
        if self.params.scale_to_table {
            let factor = depth_factor(&image, camera, &table_around(grid));
            image.depth_m.iter_mut().for_each(|depth_m| *depth_m /= factor);
        }
        image
    }

    /// Where the camera stands that is believed to be `camera`.
    fn misplaced(&mut self, camera: &Camera) -> Camera {
        let mut vector = |std: f32| Vec3::new(0.0, 0.0, 0.0).map(|_| self.stream.normal(0.0, std));
        let (moved_m, turned_rad) = (vector(self.params.position_error_m), vector(self.params.rotation_error_rad));
        let mut real = *camera;
        real.workspace_from_camera.translation += moved_m;
        let angle_rad = turned_rad.length();
        if angle_rad > 0.0 {
            let turn = axis_angle(turned_rad / angle_rad, angle_rad);
            real.workspace_from_camera.rotation = (turn * real.workspace_from_camera.rotation).normalize();
        }
        real
    }
}

#[cfg(test)]
mod tests {
    use schema::{Intrinsics, Purpose, View};

    use super::*;
    use crate::camera_at;

    fn params() -> SensorParams {
        SensorParams {
            noise: vec![NoiseKind::None, NoiseKind::Dex],
            noise_weights: vec![1.0, 3.0],
            gaussian_std_m: [0.001, 0.005],
            position_error_m: 0.002,
            rotation_error_rad: 0.004,
            scale_to_table: false,
        }
    }

    #[test]
    fn kinds_come_by_their_weights_and_cameras_stand_a_little_off() {
        let view = View { radius_m: 0.6, polar_rad: 1.0, azimuth_rad: 0.3 };
        let camera = camera_at(&view, &Grid::PAPER, Intrinsics::VGN);
        let (params, mut dex, mut moved_m, mut turned_rad) = (params(), 0, Vec::new(), Vec::new());
        for scene in 0..4_000 {
            let mut sensor = Sensor::draw(&params, 540.0, Stream::new(7, scene, Purpose::DepthNoise, 0));
            dex += u32::from(sensor.kind == NoiseKind::Dex);
            let real = sensor.misplaced(&camera).workspace_from_camera;
            let believed = camera.workspace_from_camera;
            moved_m.push((real.translation - believed.translation).length_squared());
            turned_rad.push((2.0 * libm::acosf(real.rotation.dot(believed.rotation).abs().min(1.0))).powi(2));
        }
        assert!((2_900..3_100).contains(&dex), "{dex}");
        let per_axis = |squares: &[f32]| (squares.iter().sum::<f32>() / squares.len() as f32 / 3.0).sqrt();
        assert!((per_axis(&moved_m) / 0.002 - 1.0).abs() < 0.03, "{}", per_axis(&moved_m));
        assert!((per_axis(&turned_rad) / 0.004 - 1.0).abs() < 0.06, "{}", per_axis(&turned_rad));
    }

    #[test]
    fn without_noise_and_errors_an_image_is_what_is_there() {
        let params = SensorParams {
            noise: vec![NoiseKind::None],
            noise_weights: vec![1.0],
            position_error_m: 0.0,
            rotation_error_rad: 0.0,
            ..params()
        };
        let view = View { radius_m: 0.6, polar_rad: 1.0, azimuth_rad: 0.3 };
        let camera = camera_at(&view, &Grid::PAPER, Intrinsics::VGN);
        let image = DepthImage { width_px: 2, height_px: 1, depth_m: vec![0.4, 0.0] };
        let mut sensor = Sensor::draw(&params, 540.0, Stream::new(7, 1, Purpose::DepthNoise, 0));
        let seen = sensor.image(&camera, |real| {
            assert_eq!(*real, camera);
            image.clone()
        });
        assert_eq!(sensor.corrected(seen, &camera, &Grid::PAPER), image);
    }
}
