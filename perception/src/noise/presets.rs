//! Sensors that people have. Where a value was fitted, `scripts/sensor_statistics.py` of 0.3.0 measured it on real
//! captures: 15 of a Kinect and one of a D435 (docs/results/sensors.md).

use super::edges::EdgeNoise;
use super::loss::Loss;
use super::stereo::StereoNoise;

impl StereoNoise {
    /// Intel RealSense D435 behind the lens of VGN's simulated camera, by its data sheet. Datasets have this one, so it
    /// keeps its pixels behind any lens. [`StereoNoise::D435_REAL`] is fitted.
    ///
    /// - 540 px: [`schema::Intrinsics::VGN`]. The D435 itself has 424 px at 848 × 480 (90° across), where the same
    ///   disparity error is 1.27 times as large in depth.
    /// - 50 mm: the D400 series' datasheet.
    /// - 0.08 px: the advice of an author of Intel's tuning guide for the formula above; 0.03 px at best, in a highly
    ///   textured scene (librealsense, issue 3904).
    /// - 3.5 px: our choice. The D435's matching window is not published; its predecessor R200 sums over 7 × 7 px
    ///   (Keselman et al. 2017), which correlates errors less than 7 px apart, as two cells of 3.5 px do.
    /// - 1/32 px: "Subpixel linearity improvement for Intel RealSense depth cameras D400 series".
    pub const D435: Self = Self {
        focal_px: 540.0,
        baseline_m: 0.05,
        seen_from_m: [0.05, 0.0],
        has_band: true,
        subpixel_std_px: 0.08,
        smooth_cell_px: [3.5, 3.5],
        disparity_step_px: 1.0 / 32.0,
        depth_step_m: 0.0,
        edges: EdgeNoise::NONE,
        loss: Loss::NONE,
    };

    /// A D435 as it was found: depth in the colour camera's place, 1280 × 720.
    ///
    /// - 927 px: the capture's lens; 50 mm: the D400 series' datasheet.
    /// - Seen from 65 mm to the right: the colour camera is 15 mm left of the left imager (datasheet). The fit says 53
    ///   to 65 mm. No shadow right of things, and no band, as in the capture.
    /// - 0.26 px: the fit, 0.0043 1/m on blocks of 32 px, of which the cells' smooth part is not in the block.
    /// - Cells of 12 × 8 px: the fit; correlation 0.70 and 0.56 at 4 px, 0.38 and 0.04 at 8 px.
    /// - 1/32 px: as [`StereoNoise::D435`], at 640 px of the depth image. 1 mm: the capture's unit.
    /// - Fattening of 4.5 px along u and 1 px along v, which the statistics show as 4 and 1.5 px: the outlines in
    ///   colour (5.5 px right, 2.5 left, 1.5 above and below). Holes 3 px wider than what is hidden, 2 px ragged: the
    ///   fit.
    /// - Loss: the fit; 0.1 % straight, 0.4 % at 60°, 2 % at 72°, 7 % at 77°. Holes are 3 px long in a row.
    pub const D435_REAL: Self = Self {
        focal_px: 927.0,
        baseline_m: 0.05,
        seen_from_m: [0.065, 0.0],
        has_band: false,
        subpixel_std_px: 0.26,
        smooth_cell_px: [12.0, 8.0],
        disparity_step_px: 927.0 / 640.0 / 32.0,
        depth_step_m: 0.001,
        edges: EdgeNoise { fattening_px: [4.5, 1.0], hole_px: 3.0, ragged_px: 2.0 },
        loss: Loss { share: 0.001, per_secant: 1.22, patch_px: 5.0 },
    };

    /// Microsoft Kinect of 2010, as OpenNI gives it: depth in the colour camera's place.
    ///
    /// - 525 px: `OpenNI`'s lens, that of the captures; 75 mm from projector to imager.
    /// - Seen from 50 mm to the right and 25 mm to the left: the fit says 49.4 and 25.9 mm. Together they are the
    ///   baseline.
    /// - 0.075 px: the fit, 0.0020 1/m with the rounding (1.1 mm at 0.74 m).
    /// - Cells of 5 × 2.3 px: the fit; correlation 0.57 and 0.31 at 2 px, 0.35 and 0 at 4 px.
    /// - 1/8 px of 580 px, the imager's lens: levels are 0.00290 1/m apart in the captures, 1/(8 · 580 px · 0.075 m) is
    ///   0.00287. 1 mm: `OpenNI`'s unit.
    /// - Fattening of 1 px: the outlines in colour. Shadows are 2.6 px narrower left than the geometry says and 1.4 px
    ///   right: 1 px is that, and of the rest holes lose 0.5 px, between what both sides and the wider ones need.
    /// - Loss: the fit, 0.01 % up to 70°. Beyond is unknown, and so are dark and shiny things: the captures show
    ///   cartons and rolls of card.
    pub const KINECT: Self = Self {
        focal_px: 525.0,
        baseline_m: 0.075,
        seen_from_m: [0.05, 0.025],
        has_band: false,
        subpixel_std_px: 0.075,
        smooth_cell_px: [5.0, 2.3],
        disparity_step_px: 525.0 / 580.0 / 8.0,
        depth_step_m: 0.001,
        edges: EdgeNoise { fattening_px: [1.0, 1.0], hole_px: -0.5, ragged_px: 0.7 },
        loss: Loss { share: 0.0001, per_secant: 0.0, patch_px: 5.0 },
    };
}
