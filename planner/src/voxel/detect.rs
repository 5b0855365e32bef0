//! From the network's volumes to detections: VGN's published procedure (`detection.py`: `process`, `select`). For
//! grasps in front of the surface, as in VGN, the result equals scipy's bit for bit; the paper's grasps lie behind it
//! ([`Side`]).
//!
//! The quality is smoothed and set to 0 away from the observed surface or on its other side, for widths outside the
//! limits, and below the threshold. The maximum of every small cube of the rest is a detection. scipy sums each pass in
//! double precision and stores it in single precision, and this module does the same with the same borders, because
//! ties matter.

use network::GraspOrigin;
use schema::Grid;

use crate::config::DetectionParams;
use crate::plan::RejectReason;

/// A voxel that was detected, or rejected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// x, y, z.
    pub voxel: [usize; 3],
    /// Smoothed quality.
    pub quality: f32,
}

/// The result for every voxel.
#[derive(Debug, Clone, PartialEq)]
pub struct Detected {
    /// The detections, in the order of their voxels, x slowest.
    pub found: Vec<Detection>,
    /// Voxels near the surface.
    pub near_surface: usize,
    /// Of those, with a width within the limits.
    pub width_within_limits: usize,
    /// Of those, with a quality of ε or more.
    pub quality_reached: usize,
    /// Highest smoothed quality of voxels near the surface with a width within the limits; 0 if there are none.
    pub quality_best: f32,
    /// The smoothed quality before any mask.
    pub smoothed: Vec<f32>,
    /// Why a voxel is rejected, before neighbours are compared.
    out: Vec<Option<RejectReason>>,
}

/// Candidates below the threshold are listed only from this share of ε.
const LISTED_SHARE_OF_QUALITY_MIN: f32 = 0.5;

/// A side of the seen surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// In front of it, whence the gripper comes.
    Front,
    /// Behind it.
    Behind,
    /// Either.
    Both,
}

impl Side {
    /// Where a network has the origins of grasps whose tips are 15 to 35 mm behind the surface (Appendix A: d_z).
    #[must_use]
    pub fn of(origin: GraspOrigin) -> Self {
        match origin.behind_tips_m {
            ..=0.015 => Self::Behind,
            0.035.. => Self::Front,
            _ => Self::Both,
        }
    }
}

/// Finds grasps: `tsdf`, `quality` and `width_voxels` have one value per voxel of `grid`, x slowest; grasps have their
/// origin on one side of the surface.
///
/// # Panics
/// If a length differs.
#[must_use]
pub fn detect(
    grid: &Grid,
    tsdf: &[f32],
    quality: &[f32],
    width_voxels: &[f32],
    side: Side,
    params: &DetectionParams,
) -> Detected {
    assert!([tsdf, quality, width_voxels].iter().all(|values| values.len() == grid.len()), "one value a voxel");
    let smoothed = smooth(quality, grid.resolution, params.gaussian_sigma_voxels);
    let near = near_surface(tsdf, grid, side, params.surface_steps_max);
    let mut detected = Detected {
        found: Vec::new(),
        near_surface: 0,
        width_within_limits: 0,
        quality_reached: 0,
        quality_best: 0.0,
        smoothed,
        out: Vec::with_capacity(grid.len()),
    };
    for flat in 0..grid.len() {
        let out = detected.judge(near[flat], width_voxels[flat], detected.smoothed[flat], params);
        detected.out.push(out);
    }
    for flat in (0..grid.len()).filter(|flat| detected.out[*flat].is_none()) {
        let voxel = unflat(grid, flat);
        if !detected.is_suppressed(grid, voxel, params) {
            detected.found.push(Detection { voxel, quality: detected.smoothed[flat] });
        }
    }
    detected
}

impl Detected {
    /// Why a voxel is rejected, if it is; counts the stages that it passed.
    fn judge(
        &mut self,
        is_near: bool,
        width_voxels: f32,
        quality: f32,
        params: &DetectionParams,
    ) -> Option<RejectReason> {
        if !is_near {
            return Some(RejectReason::FarFromSurface);
        }
        self.near_surface += 1;
        // VGN's comparisons, except that a width that is NaN passes both there and neither here.
        if !(params.width_voxels_min..=params.width_voxels_max).contains(&width_voxels) {
            return Some(RejectReason::Width { width_voxels });
        }
        self.width_within_limits += 1;
        self.quality_best = self.quality_best.max(quality);
        if quality < params.quality_min || quality.is_nan() {
            return Some(RejectReason::Quality { likeliest: None });
        }
        self.quality_reached += 1;
        None
    }

    /// Whether the cube around a voxel contains a better voxel that is not rejected. A cube with an even side reaches
    /// one voxel further down than up (scipy: `maximum_filter`). Of equal voxels both remain.
    fn is_suppressed(&self, grid: &Grid, voxel: [usize; 3], params: &DetectionParams) -> bool {
        let quality = self.smoothed[grid.flat(voxel)];
        window(grid, voxel, params).any(|other| self.out[other].is_none() && self.smoothed[other] > quality)
    }

    /// The rejected candidates in the order of their voxels: those above the threshold with a better neighbour, and
    /// local maxima of the smoothed quality that were rejected before.
    #[must_use]
    pub fn misses(&self, grid: &Grid, params: &DetectionParams) -> Vec<(Detection, RejectReason)> {
        let miss = |flat: usize| {
            let (voxel, quality) = (unflat(grid, flat), self.smoothed[flat]);
            let reason = match self.out[flat] {
                None => self.is_suppressed(grid, voxel, params).then_some(RejectReason::Suppressed),
                Some(reason) => self.is_peak(grid, voxel, params).then_some(reason),
            };
            reason.map(|reason| (Detection { voxel, quality }, reason))
        };
        (0..grid.len()).filter_map(miss).collect()
    }

    fn is_peak(&self, grid: &Grid, voxel: [usize; 3], params: &DetectionParams) -> bool {
        let quality = self.smoothed[grid.flat(voxel)];
        quality >= LISTED_SHARE_OF_QUALITY_MIN * params.quality_min
            && window(grid, voxel, params).all(|other| self.smoothed[other] <= quality)
    }
}

fn unflat(grid: &Grid, flat: usize) -> [usize; 3] {
    let n = grid.resolution;
    [flat / (n * n), flat / n % n, flat % n]
}

/// Flat indices of the voxels in the suppression window around a voxel.
fn window<'a>(grid: &'a Grid, voxel: [usize; 3], params: &DetectionParams) -> impl Iterator<Item = usize> + 'a {
    let side = params.suppression_window_voxels;
    let [is, js, ks] = voxel.map(|at| at.saturating_sub(side / 2)..(at + side - side / 2).min(grid.resolution));
    is.flat_map(move |i| {
        let ks = ks.clone();
        js.clone().flat_map(move |j| ks.clone().map(move |k| grid.flat([i, j, k])))
    })
}

/// The voxels that may contain the origin of a grasp: observed voxels on the required side of the surface (above ½ in
/// front of it, between 0.001 and ½ behind), and voxels within `steps` axis-parallel steps of them without crossing the
/// surface.
fn near_surface(tsdf: &[f32], grid: &Grid, side: Side, steps: usize) -> Vec<bool> {
    let n = grid.resolution;
    let is_front = |value: f32| value > 0.5;
    let is_behind = |value: f32| value > 1e-3 && value < 0.5;
    let (is_right, is_wrong): (&dyn Fn(f32) -> bool, &dyn Fn(f32) -> bool) = match side {
        Side::Front => (&is_front, &is_behind),
        Side::Behind => (&is_behind, &is_front),
        Side::Both => (&|value| value > 1e-3, &|_| false),
    };
    let mut near: Vec<bool> = tsdf.iter().map(|value| is_right(*value)).collect();
    let may_grow: Vec<bool> = tsdf.iter().map(|value| !is_wrong(*value)).collect();
    for _ in 0..steps {
        let before = near.clone();
        for (flat, slot) in near.iter_mut().enumerate() {
            if *slot || !may_grow[flat] {
                continue;
            }
            let [i, j, k] = unflat(grid, flat);
            *slot = [(i, n * n), (j, n), (k, 1)]
                .into_iter()
                .any(|(at, stride)| (at > 0 && before[flat - stride]) || (at + 1 < n && before[flat + stride]));
        }
    }
    near
}

/// Smooths a cube of `n`³ values by a Gaussian; the outermost values are repeated outside (scipy: `gaussian_filter`
/// with mode "nearest", truncated at four standard deviations).
fn smooth(values: &[f32], n: usize, sigma: f32) -> Vec<f32> {
    let kernel = gaussian(f64::from(sigma));
    if kernel.len() == 1 {
        return values.to_vec();
    }
    let mut smoothed = values.to_vec();
    for stride in [n * n, n, 1] {
        smoothed = smooth_along(&smoothed, n, stride, &kernel);
    }
    smoothed
}

/// The right half of the kernel, starting at its centre.
fn gaussian(sigma: f64) -> Vec<f64> {
    let radius = (4.0 * sigma + 0.5) as usize;
    let raw: Vec<f64> = (0..=radius).map(|x| libm::exp(-0.5 / (sigma * sigma) * (x * x) as f64)).collect();
    let sum = raw[0] + 2.0 * raw[1..].iter().sum::<f64>();
    if radius == 0 { vec![1.0] } else { raw.into_iter().map(|x| x / sum).collect() }
}

/// One pass along the axis in which neighbours are `stride` apart; runs of `stride` values are processed together.
fn smooth_along(values: &[f32], n: usize, stride: usize, kernel: &[f64]) -> Vec<f32> {
    let mut smoothed = vec![0.0; values.len()];
    let mut sums = vec![0.0_f64; stride];
    for (block, target) in values.chunks_exact(n * stride).zip(smoothed.chunks_exact_mut(n * stride)) {
        let run = |at: usize| &block[at * stride..][..stride];
        for at in 0..n {
            for (sum, value) in sums.iter_mut().zip(run(at)) {
                *sum = f64::from(*value) * kernel[0];
            }
            // The farthest first, as in scipy.
            for reach in (1..kernel.len()).rev() {
                let (low, high) = (run(at.saturating_sub(reach)), run((at + reach).min(n - 1)));
                for ((sum, low), high) in sums.iter_mut().zip(low).zip(high) {
                    *sum += (f64::from(*low) + f64::from(*high)) * kernel[reach];
                }
            }
            for (slot, sum) in target[at * stride..][..stride].iter_mut().zip(&sums) {
                *slot = *sum as f32;
            }
        }
    }
    smoothed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BuiltIn;

    const GRID: Grid = Grid::PAPER;

    fn params() -> DetectionParams {
        BuiltIn::Paper.config().unwrap().detection
    }

    fn ball(middle: [usize; 3], radius: f32, value: f32) -> Vec<f32> {
        let distance = |voxel: [usize; 3]| {
            let square: f32 = (0..3).map(|axis| (voxel[axis] as f32 - middle[axis] as f32).powi(2)).sum();
            square.sqrt()
        };
        (0..GRID.len()).map(|flat| if distance(unflat(&GRID, flat)) <= radius { value } else { 0.0 }).collect()
    }

    #[test]
    fn smoothing_keeps_what_is_even_and_the_sum_of_what_is_not() {
        let even = smooth(&vec![0.7; GRID.len()], 40, 1.0);
        assert!(even.iter().all(|value| (value - 0.7).abs() < 1e-6));
        let mut spike = vec![0.0; GRID.len()];
        spike[GRID.flat([20, 12, 27])] = 1.0;
        let smoothed = smooth(&spike, 40, 1.0);
        let sum: f64 = smoothed.iter().map(|value| f64::from(*value)).sum();
        assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        let along = |x: f64| libm::exp(-0.5 * x * x);
        let total: f64 = (-4..=4).map(|x| along(f64::from(x))).sum();
        let expected = along(1.0) * along(2.0) / total.powi(3);
        assert!((f64::from(smoothed[GRID.flat([21, 12, 29])]) - expected).abs() < 1e-8);
    }

    #[test]
    fn a_wide_hill_near_the_surface_is_one_detection_at_its_top() {
        let mut quality = ball([20, 20, 12], 6.0, 0.95);
        quality[GRID.flat([21, 20, 12])] = 1.0;
        let tsdf = ball([20, 20, 12], 8.0, 0.6);
        let width = vec![4.0; GRID.len()];
        let detected = detect(&GRID, &tsdf, &quality, &width, Side::Front, &params());
        let voxels: Vec<[usize; 3]> = detected.found.iter().map(|found| found.voxel).collect();
        assert!(voxels.contains(&[21, 20, 12]), "{voxels:?}");
        assert!(detected.quality_reached > 100 && detected.quality_best > 0.94);
    }

    #[test]
    fn each_mask_takes_out_what_it_should() {
        let quality = ball([20, 20, 12], 6.0, 0.95);
        let near = ball([20, 20, 12], 8.0, 0.6);
        let width = vec![4.0; GRID.len()];
        let count = |tsdf: &[f32], quality: &[f32], width: &[f32]| {
            detect(&GRID, tsdf, quality, width, Side::Front, &params()).found.len()
        };
        assert!(count(&near, &quality, &width) > 0);
        assert_eq!(count(&vec![0.0; GRID.len()], &quality, &width), 0);
        assert_eq!(count(&vec![0.3; GRID.len()], &quality, &width), 0);
        assert_eq!(count(&near, &ball([20, 20, 12], 6.0, 0.85), &width), 0);
        for wrong in [1.2, 9.5, f32::NAN] {
            assert_eq!(count(&near, &quality, &vec![wrong; GRID.len()]), 0);
        }
        assert_eq!(count(&near, &vec![f32::NAN; GRID.len()], &width), 0);
    }

    #[test]
    fn the_mask_grows_two_steps_into_the_unknown_and_none_into_the_inside() {
        let mut tsdf = vec![0.0; GRID.len()];
        tsdf[GRID.flat([20, 20, 20])] = 0.6;
        tsdf[GRID.flat([20, 20, 19])] = 0.4;
        let near = near_surface(&tsdf, &GRID, Side::Front, 2);
        let is = |voxel: [usize; 3]| near[GRID.flat(voxel)];
        assert!(is([20, 20, 22]) && is([21, 21, 20]) && is([20, 18, 20]));
        assert!(!is([20, 20, 23]) && !is([21, 21, 21]) && !is([20, 20, 19]) && !is([20, 20, 18]));
        // Around the inside voxel it takes three steps.
        assert_eq!(near.iter().filter(|n| **n).count(), 25 - 2);
    }

    #[test]
    fn the_other_sides_masks_are_what_they_say() {
        let mut tsdf = vec![0.0; GRID.len()];
        tsdf[GRID.flat([20, 20, 20])] = 0.6;
        tsdf[GRID.flat([20, 20, 19])] = 0.4;
        let count = |side: Side, steps: usize| near_surface(&tsdf, &GRID, side, steps).iter().filter(|n| **n).count();
        assert_eq!([Side::Front, Side::Behind, Side::Both].map(|side| count(side, 0)), [1, 1, 2]);
        assert!(near_surface(&tsdf, &GRID, Side::Behind, 2)[GRID.flat([20, 20, 17])]);
        assert!(!near_surface(&tsdf, &GRID, Side::Behind, 2)[GRID.flat([20, 20, 20])]);
        assert_eq!(count(Side::Behind, 2), count(Side::Front, 2));
        assert!(near_surface(&tsdf, &GRID, Side::Both, 1)[GRID.flat([20, 20, 21])]);
    }

    #[test]
    fn what_is_dropped_is_listed_with_its_reason() {
        let quality = ball([20, 20, 12], 6.0, 0.95);
        let width = vec![12.0; GRID.len()];
        let detected = detect(&GRID, &ball([20, 20, 12], 8.0, 0.6), &quality, &width, Side::Front, &params());
        assert!(detected.found.is_empty());
        let misses = detected.misses(&GRID, &params());
        assert!(!misses.is_empty());
        assert!(misses.iter().all(|(_, reason)| *reason == RejectReason::Width { width_voxels: 12.0 }), "{misses:?}");
    }
}
