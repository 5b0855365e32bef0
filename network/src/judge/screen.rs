//! A quick look at many grasp candidates, so that the judge is asked about the likeliest alone.
//!
//! Most candidates do not hold, and a small network knows that from a few points of what the judge sees: it
//! multiplies a hundredth as often. It only chooses; what a plan says of a grasp is the judge's answer.

use std::sync::LazyLock;

use safetensors::SafeTensors;
use schema::Pose;

use super::crop::{Crop, FACTS, PaddedGrid};
use crate::kernels::conv::Conv;
use crate::kernels::parameters::{Layout, Parameters};
use crate::kernels::tile::LANES;
use crate::layers::{LayerShape, layer, slots_of, vector_of};

/// Values of a point: distance and observed share.
const VALUES: usize = 2;
/// Inputs: the values of the few points, then the facts.
const ROW: usize = VALUES * Crop::FEW + FACTS;

/// Its layers; the only output is the logit of the probability that a grasp holds.
const LAYERS: [LayerShape; 3] =
    [layer("screen1", ROW, 64, 1, 1), layer("screen2", 64, 32, 1, 1), layer("screen3", 32, 1, 1, 1)];

static LAYOUT: LazyLock<Layout> = LazyLock::new(|| Layout::new(&LAYERS, LAYERS.len() - 1));
static BUILT_IN: LazyLock<Option<Screen>> =
    LazyLock::new(|| Screen::from_bytes(include_bytes!("../../../models/screen.safetensors")).ok());

/// The network.
#[derive(Debug, Clone)]
pub struct Screen {
    parameters: Parameters,
}

impl Screen {
    /// The one that comes with the program, which knows all grippers of `any_jaw`.
    #[must_use]
    pub fn built_in() -> Option<&'static Self> {
        BUILT_IN.as_ref()
    }

    /// Of a safetensors file with its layers' parameters.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Vec<String>> {
        let file = SafeTensors::deserialize(bytes).map_err(|error| vec![error.to_string()])?;
        let vector = vector_of(&file, &slots_of(&LAYERS), "")?;
        Ok(Self { parameters: Parameters::from_vector(&LAYOUT, &vector) })
    }

    /// The logit of the probability that each of some grasps holds.
    #[must_use]
    pub fn logits(&self, crop: &Crop, grid: &PaddedGrid, views: usize, workspace_from_grasps: &[Pose]) -> Vec<f32> {
        let grasps = workspace_from_grasps.len();
        if grasps == 0 {
            return Vec::new();
        }
        let mut values = Vec::with_capacity(grasps * ROW);
        for pose in workspace_from_grasps {
            crop.see_few(grid, pose, &mut values);
            values.extend_from_slice(&crop.facts(pose, views, [false; 2]));
        }
        for (number, LayerShape { channels_in, channels_out, .. }) in LAYERS.into_iter().enumerate() {
            let product = Conv::of_rows(grasps, channels_in, channels_out.next_multiple_of(LANES));
            let (weights, bias) = self.parameters.stage(number);
            values = product.forward(weights, bias, number + 1 < LAYERS.len(), &values);
        }
        values.chunks_exact(LANES).map(|lanes| lanes[0]).collect()
    }
}

#[cfg(test)]
mod tests {
    use schema::{Grid, Gripper, Procedure, Purpose, Stream, Vec3, VoxelGrid};

    use super::*;

    /// The product of a layer, from the file.
    fn product(file: &SafeTensors<'_>, layer: &LayerShape, inputs: &[f64]) -> Vec<f64> {
        let [weights, bias] = ["weight", "bias"].map(|part| -> Vec<f64> {
            let tensor = file.tensor(&format!("{}.{part}", layer.name)).unwrap();
            tensor.data().as_chunks::<4>().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes))).collect()
        });
        let rows = weights.chunks_exact(layer.channels_in).zip(bias);
        rows.map(|(row, bias)| bias + row.iter().zip(inputs).map(|(weight, input)| weight * input).sum::<f64>())
            .collect()
    }

    #[test]
    fn logits_are_those_of_the_definition() {
        let bytes = include_bytes!("../../../models/screen.safetensors");
        let (screen, file) = (Screen::built_in().unwrap(), SafeTensors::deserialize(bytes).unwrap());
        let gripper = Gripper::from_toml(Gripper::BUILT_IN[0].1).unwrap();
        let crop = Crop::new(&gripper, Procedure::PAPER.pregrasp_distance_m, &Grid::PAPER);
        let value = |at: Vec3| 0.5 + 0.4 * (at - Vec3::splat(0.15)).dot(Vec3::new(0.6, -1.0, 0.8)) / 0.15;
        let values = (0..64_000).map(|at| value(Grid::PAPER.centre_m([at / 1600, at / 40 % 40, at % 40])).max(0.0));
        let grid = PaddedGrid::from(&VoxelGrid::new(Grid::PAPER, values.collect()).unwrap());
        let mut stream = Stream::new(3, 0, Purpose::Views, 0);
        let poses: Vec<Pose> = (0..40)
            .map(|_| Pose::from_parts(stream.point(Vec3::splat(0.05), Vec3::splat(0.25)), stream.rotation()))
            .collect();
        let logits = screen.logits(&crop, &grid, 1, &poses);
        assert_eq!(logits.len(), poses.len());
        for (pose, logit) in poses.iter().zip(&logits) {
            let mut row = Vec::new();
            crop.see_few(&grid, pose, &mut row);
            row.extend(crop.facts(pose, 1, [false; 2]));
            let mut x: Vec<f64> = row.into_iter().map(f64::from).collect();
            for layer in &LAYERS {
                x.iter_mut().filter(|_| layer.name != "screen1").for_each(|value| *value = value.max(0.0));
                x = product(&file, layer, &x);
            }
            assert!((f64::from(*logit) - x[0]).abs() < 1e-3, "{logit} against {}", x[0]);
        }
        let [low, high] = logits.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], x| [a.min(*x), b.max(*x)]);
        assert!(high - low > 1.0, "{low} to {high}");
        assert!(screen.logits(&crop, &grid, 1, &[]).is_empty());
    }

    #[test]
    fn another_file_is_refused() {
        assert!(Screen::from_bytes(b"no weights").is_err());
        let judge = include_bytes!("../../../models/judge.safetensors");
        assert_eq!(Screen::from_bytes(judge).unwrap_err().len(), 6);
    }
}
