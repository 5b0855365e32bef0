//! The judge: a network that is asked about one grasp in a scene and answers how the attempt would end.
//!
//! One quality and one orientation a voxel cannot say that one grasp holds and another at the same voxel does not. So
//! the TSDF is resampled around the gripper, in the grasp's frame ([`Crop`]), and convolved there: what matters lies at
//! the same place for every grasp. What arithmetic knows for certain, that the gripper would hit the table, is not
//! asked.

mod crop;
mod screen;

use std::sync::LazyLock;

use program::{ExitCode, Failure};
use schema::{Grid, Gripper, Outcome, Pose, Purpose, Stream};
use serde::{Deserialize, Serialize};

use crate::kernels::conv::{Conv, Extent, from_lanes, output_of, to_lanes};
use crate::kernels::parameters::{Layout, Parameters};
use crate::kernels::tile::LANES;
use crate::layers::{LayerShape, count_of, layer};
use crate::voxel::TransposedWeights;

pub use crop::{BOX, CHANNELS, Crop, FACTS, PaddedGrid, WIDE_BOX, WIDE_CHANNELS};
pub use screen::Screen;

/// Number of outcomes.
pub const OUTCOMES: usize = Outcome::ALL.len();
/// The network's outputs: a logit for each outcome, then that of the robustness.
pub const OUTPUTS: usize = OUTCOMES + 1;

/// All layers, in the order of their parameters in the flat vector. The first four see the crop, the next two the
/// surroundings. From `head1` on, positions are one: its inputs are what `reduce` and `wide2` give, x slowest and
/// channels fastest, then the facts. The last is beside `head3`; judges that learned from attempts without repeats lack
/// it.
pub const LAYERS: [LayerShape; 10] = [
    layer("conv1", CHANNELS, 16, 3, 2),
    layer("conv2", 16, 32, 3, 2),
    layer("conv3", 32, 32, 3, 1),
    layer("reduce", 32, REDUCED, 1, 1),
    layer("wide1", WIDE_CHANNELS, 16, 3, 2),
    layer("wide2", 16, REDUCED, 3, 2),
    layer("head1", ROW, 128, 1, 1),
    layer("head2", 128, 64, 1, 1),
    layer("head3", 64, OUTCOMES, 1, 1),
    layer("robustness", 64, 1, 1, 1),
];

/// Channels of a position before the head.
const REDUCED: usize = 16;
/// Values before the head, of 2 · 5 · 7 positions of the crop …
const SEEN: usize = REDUCED * 70;
/// … and of 3 · 2 · 2 of the surroundings.
const SEEN_WIDE: usize = REDUCED * 12;
/// Inputs of the head.
const ROW: usize = SEEN + SEEN_WIDE + FACTS;
/// Number of layers before the head.
const CONVS: usize = 6;
/// Whether the outputs of the layers before the head have padding, and are cut off at zero.
const PADDED: [bool; CONVS] = [true, true, false, false, true, false];
const CUT_OFF: [bool; CONVS] = [true, true, true, false, true, false];

static LAYOUT: LazyLock<Layout> = LazyLock::new(|| Layout::new(&LAYERS, LAYERS.len() - 2));

/// What a judge was trained for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scope {
    /// The gripper, or the first of several.
    pub gripper: Gripper,
    /// Of several grippers the smallest and the largest value of each number, in the order of [`Gripper::numbers`].
    #[serde(rename = "hands", default, skip_serializing_if = "Option::is_none")]
    pub grippers: Option<[[f32; 2]; 12]>,
    /// How far behind the grasp, along its approach, the gripper starts.
    pub pregrasp_distance_m: f32,
    /// The grid of the TSDF, and the table's height in it.
    pub grid: Grid,
    /// Whether it says how robust a grasp is: whether it learned from attempts that were repeated.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub robustness: bool,
}

/// Voxels whose sides differ by less are the same.
const VOXEL_OFF_M_MAX: f32 = 1e-6;
/// A gripper may lie outside of those of training by this share of their range.
const EDGE_SHARE: f32 = 0.03;

impl Scope {
    /// The scope of a judge that is trained with these grippers, at least one, and with repeated attempts or without.
    #[must_use]
    pub fn of(grippers: &[Gripper], pregrasp_distance_m: f32, grid: Grid, robustness: bool) -> Self {
        let span = |number: usize| {
            let values = grippers.iter().map(|gripper| gripper.numbers()[number].1);
            values.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
        };
        let spans = grippers.iter().any(|gripper| gripper.numbers() != grippers[0].numbers());
        let spans = spans.then(|| std::array::from_fn(span));
        // Where a gripper is mounted decides no label, and judges see grippers of three boxes.
        let first = grippers[0].clone();
        let gripper = Gripper { flange_from_grasp: None, joint: None, finger_tip: None, jaws: Vec::new(), ..first };
        Self { gripper, grippers: spans, pregrasp_distance_m, grid, robustness }
    }

    /// The gripper or the number of different grippers in words.
    fn gripper_in_words(&self) -> String {
        match &self.grippers {
            None => format!("the gripper {}", self.gripper.name),
            Some(spans) => format!("grippers that open {} m", shown(spans[0])),
        }
    }

    /// The judge's layers.
    #[must_use]
    pub fn layers(&self) -> &'static [LayerShape] {
        &LAYERS[..LAYERS.len() - usize::from(!self.robustness)]
    }

    /// Whether it was trained on grids of such voxels, of whatever number.
    #[must_use]
    pub fn is_on(&self, grid: &Grid) -> bool {
        (self.grid.voxel_size_m() - grid.voxel_size_m()).abs() < VOXEL_OFF_M_MAX
            && self.grid.table_z_m == grid.table_z_m
    }

    /// Whether a judge of this scope may be asked about this gripper in this grid: about the gripper that it was
    /// trained with, or one between those that it was trained with, whatever its name is.
    ///
    /// # Errors
    /// If the gripper or the grid is another one; names what differs.
    pub fn must_match(&self, gripper: &Gripper, grid: &Grid) -> Result<(), Failure> {
        let refused = |what: String| Err(Failure::new(ExitCode::Config, format!("the judge was trained {what}")));
        if !self.is_on(grid) {
            let shown = |grid: &Grid| format!("voxels of {} m, table at {} m", grid.voxel_size_m(), grid.table_z_m);
            return refused(format!("on {}, not on {}", shown(&self.grid), shown(grid)));
        }
        let spans = self.grippers.unwrap_or_else(|| self.gripper.numbers().map(|(_, value)| [value; 2]));
        // Of some hundred grippers that are drawn none lies at the very ends.
        let is_outside = |(got, [low, high]): (f32, [f32; 2])| {
            let slack = EDGE_SHARE * (high - low);
            got < low - slack || got > high + slack
        };
        let outside = gripper.numbers().into_iter().zip(spans).find(|((_, got), span)| is_outside((*got, *span)));
        let Some(((key, got), [low, high])) = outside else { return Ok(()) };
        let expected = shown([low, high]);
        let (trained, given) = (self.gripper_in_words(), &gripper.name);
        refused(format!("for {trained}, not for {given} as it is given: {key} must be {expected}, got {got}"))
    }
}

/// A number, or a range to at most three decimals.
fn shown([low, high]: [f32; 2]) -> String {
    let [from, to] = [low, high].map(|end| (1e3 * end).round() / 1e3);
    if low == high { low.to_string() } else { format!("{from} to {to}") }
}

/// The judge, prepared for evaluation.
#[derive(Debug, Clone)]
pub struct JudgeNetwork {
    parameters: Parameters,
    convs: [Conv; CONVS],
    /// Length of the flat vector.
    len: usize,
}

/// Grasps as the judge sees them, added by [`JudgeInputs::push`].
#[derive(Debug, Clone, Default)]
pub struct JudgeInputs {
    /// `[grasps, 10, 22, 30, CHANNELS]`: the crops with the zeros that the first convolution pads with.
    pub crops: Vec<f32>,
    /// `[grasps, 14, 10, 10, WIDE_CHANNELS]`: the surroundings, likewise.
    pub wide: Vec<f32>,
    /// What is known of each grasp and its scene besides.
    pub facts: Vec<[f32; FACTS]>,
}

impl JudgeInputs {
    /// No grasps, with room for `grasps`.
    #[must_use]
    pub fn with_capacity(grasps: usize) -> Self {
        Self {
            crops: Vec::with_capacity(grasps * Crop::LEN),
            wide: Vec::with_capacity(grasps * Crop::WIDE_LEN),
            facts: Vec::with_capacity(grasps),
        }
    }

    /// Adds a grasp in a scene seen from `views`. Gripper and scene may be mirrored in the grasp's x and y: a mirrored
    /// gripper is the same gripper, so the attempt ends alike; but one with a fixed jaw is not mirrored in y.
    pub fn push(
        &mut self,
        crop: &Crop,
        grid: &PaddedGrid,
        workspace_from_grasp: &Pose,
        views: usize,
        mirrored: [bool; 2],
    ) {
        let mirrored = [mirrored[0], mirrored[1] && !crop.is_one_sided];
        crop.see(grid, workspace_from_grasp, mirrored, &mut self.crops);
        crop.see_wide(grid, workspace_from_grasp, mirrored, &mut self.wide);
        self.facts.push(crop.facts(workspace_from_grasp, views, mirrored));
    }

    /// For other programs, without padding: crops `[grasps, 8, 20, 28, CHANNELS]`, surroundings
    /// `[grasps, 12, 8, 8, WIDE_CHANNELS]` and facts `[grasps, FACTS]`.
    #[must_use]
    pub fn without_padding(&self) -> [Vec<f32>; 3] {
        let facts = self.facts.as_flattened().to_vec();
        [
            crop::bare::<CHANNELS>(crop::PADDED, &self.crops),
            crop::bare::<WIDE_CHANNELS>(crop::WIDE_PADDED, &self.wide),
            facts,
        ]
    }
}

/// The results of the forward pass that the backward pass needs.
#[derive(Debug)]
pub struct JudgeActivations {
    /// Outputs of the first three convolutions, each with the next one's padding.
    convs: [Vec<f32>; 3],
    /// Output of the first convolution of the surroundings, likewise.
    wide: Vec<f32>,
    /// Inputs of the head, `[grasps, ROW]`.
    rows: Vec<f32>,
    hidden: [Vec<f32>; 2],
    /// `[grasps, LANES]`.
    logits: Vec<f32>,
}

impl JudgeActivations {
    /// The outputs for each grasp: the logits of the outcomes, in the order of [`Outcome::ALL`], then that of the
    /// robustness, which is 0 for judges without it.
    pub fn logits(&self) -> impl Iterator<Item = [f32; OUTPUTS]> {
        from_lanes(&self.logits, OUTPUTS).map(|row| std::array::from_fn(|at| row[at]))
    }
}

impl JudgeNetwork {
    /// `vector` as [`crate::layers::slots_of`] lays out [`Scope::layers`].
    ///
    /// # Panics
    /// If it has another length.
    #[must_use]
    pub fn new(vector: &[f32]) -> Self {
        let mut extent = Extent { n: BOX, padding: 1 };
        let convs = std::array::from_fn(|number| {
            if LAYERS[number].name == "wide1" {
                extent = Extent { n: WIDE_BOX, padding: 1 };
            }
            let (layer, padding) = (LAYERS[number], usize::from(PADDED[number]));
            let conv = Conv::new(layer, extent, padding);
            extent = output_of(layer, extent, padding);
            conv
        });
        let mut whole = vector.to_vec();
        if vector.len() == count_of(&LAYERS[..LAYERS.len() - 1]) {
            whole.resize(count_of(&LAYERS), 0.0);
        }
        Self { parameters: Parameters::from_vector(&LAYOUT, &whole), convs, len: vector.len() }
    }

    /// Whether it says how robust a grasp is.
    #[must_use]
    pub fn has_robustness(&self) -> bool {
        self.len == count_of(&LAYERS)
    }

    /// The weights for [`Self::gradient`].
    #[must_use]
    pub fn transposed(&self) -> TransposedWeights {
        TransposedWeights(self.parameters.all_transposed())
    }

    /// The network on some grasps.
    #[must_use]
    pub fn forward(&self, inputs: &JudgeInputs) -> JudgeActivations {
        let product = |number: usize, conv: &Conv, relu: bool, inputs: &[f32]| {
            let (weights, bias) = self.parameters.stage(number);
            conv.forward(weights, bias, relu, inputs)
        };
        let conv = |number: usize, inputs: &[f32]| product(number, &self.convs[number], CUT_OFF[number], inputs);
        let first = conv(0, &inputs.crops);
        let second = conv(1, &first);
        let third = conv(2, &second);
        let reduced = conv(3, &third);
        let wide = conv(4, &inputs.wide);
        let reduced_wide = conv(5, &wide);
        let mut rows = Vec::with_capacity(inputs.facts.len() * ROW);
        let seen = reduced.chunks_exact(SEEN).zip(reduced_wide.chunks_exact(SEEN_WIDE));
        for ((narrow, wide), facts) in seen.zip(&inputs.facts) {
            rows.extend_from_slice(narrow);
            rows.extend_from_slice(wide);
            rows.extend_from_slice(facts);
        }
        let [head1, head2, head3] = heads(inputs.facts.len());
        let hidden1 = product(CONVS, &head1, true, &rows);
        let hidden2 = product(CONVS + 1, &head2, true, &hidden1);
        let logits = product(CONVS + 2, &head3, false, &hidden2);
        JudgeActivations { convs: [first, second, third], wide, rows, hidden: [hidden1, hidden2], logits }
    }

    /// The gradient of every parameter, as the flat vector. `d_logits` is the gradient of each grasp's logits.
    #[must_use]
    pub fn gradient(
        &self,
        TransposedWeights(transposed): &TransposedWeights,
        inputs: &JudgeInputs,
        seen: &JudgeActivations,
        d_logits: &[[f32; OUTPUTS]],
    ) -> Vec<f32> {
        let mut sum = Parameters::zeros(&LAYOUT);
        let mut through = |number: usize, conv: &Conv, inputs: &[f32], gradients: &[f32]| {
            let (d_weights, d_bias) = sum.stage_mut(number);
            conv.add_parameters(inputs, gradients, d_weights, d_bias);
            if matches!(LAYERS[number].name, "conv1" | "wide1") {
                Vec::new()
            } else {
                conv.d_inputs(&transposed[number], gradients)
            }
        };
        let [head1, head2, head3] = heads(d_logits.len());
        let d = through(CONVS + 2, &head3, &seen.hidden[1], &to_lanes(d_logits.as_flattened(), OUTPUTS));
        let d = through(CONVS + 1, &head2, &seen.hidden[0], &head2.through_relu(&seen.hidden[1], &d));
        let d_rows = through(CONVS, &head1, &seen.rows, &head1.through_relu(&seen.hidden[0], &d));
        let part = |from: usize, len: usize| -> Vec<f32> {
            d_rows.chunks_exact(ROW).flat_map(|row| &row[from..][..len]).copied().collect()
        };
        let [first, second, third] = &seen.convs;
        let [conv1, conv2, conv3, reduce, wide1, wide2] = &self.convs;
        let d = through(3, reduce, third, &part(0, SEEN));
        let d = through(2, conv3, second, &conv3.through_relu(third, &d));
        let d = through(1, conv2, first, &conv2.through_relu(second, &d));
        through(0, conv1, &inputs.crops, &conv1.through_relu(first, &d));
        let d = through(5, wide2, &seen.wide, &part(SEEN, SEEN_WIDE));
        through(4, wide1, &inputs.wide, &wide1.through_relu(&seen.wide, &d));
        let mut gradient = sum.to_vector();
        gradient.truncate(self.len);
        gradient
    }
}

/// Initial parameters (He et al., 2015): weights U(−√(6/fan_in), √(6/fan_in)), so that signals keep their size through
/// layers with ReLU; biases 0. Each layer has its own stream of `seed`.
#[must_use]
pub fn initial_vector(seed: u64) -> Vec<f32> {
    let mut values = Vec::with_capacity(count_of(&LAYERS));
    for (number, layer) in LAYERS.iter().enumerate() {
        let mut stream = Stream::new(seed, number as u64, Purpose::Weights, 1);
        let bound = (6.0 / layer.fan_in() as f32).sqrt();
        values.extend((0..layer.weight_count()).map(|_| stream.uniform(-bound, bound)));
        values.extend((0..layer.channels_out).map(|_| 0.0));
    }
    values
}

/// The head's layers as products with one row a grasp.
fn heads(grasps: usize) -> [Conv; 3] {
    [0, 1, 2].map(|number| {
        // The last is `head3` with the robustness beside it, which fits into the same lanes.
        let LayerShape { channels_in, channels_out, .. } = LAYERS[CONVS + number];
        Conv::of_rows(grasps, channels_in, channels_out.next_multiple_of(LANES))
    })
}

/// The logit of the probability that a grasp holds, from the logits of the outcomes.
#[must_use]
pub fn quality_logit(logits: &[f32; OUTPUTS]) -> f32 {
    let held = Outcome::Held as usize;
    let others =
        || logits[..OUTCOMES].iter().enumerate().filter(|(outcome, _)| *outcome != held).map(|(_, logit)| *logit);
    let most = others().fold(f32::NEG_INFINITY, f32::max);
    logits[held] - (most + libm::logf(others().map(|logit| libm::expf(logit - most)).sum()))
}

/// The probabilities of the outcomes.
#[must_use]
pub fn probabilities(logits: &[f32; OUTPUTS]) -> [f32; OUTCOMES] {
    let logits: [f32; OUTCOMES] = std::array::from_fn(|outcome| logits[outcome]);
    let most = logits.iter().fold(f32::NEG_INFINITY, |most, logit| most.max(*logit));
    let parts = logits.map(|logit| libm::expf(logit - most));
    let sum: f32 = parts.iter().sum();
    parts.map(|part| part / sum)
}

/// The expected share of a held grasp's repeats that hold.
#[must_use]
pub fn robustness(logits: &[f32; OUTPUTS]) -> f32 {
    1.0 / (1.0 + libm::expf(-logits[OUTCOMES]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::{positions, slots_of};

    fn parameter<'a>(vector: &'a [f32], name: &str) -> &'a [f32] {
        let slot = slots_of(&LAYERS).into_iter().find(|slot| slot.name == name).unwrap();
        &vector[slot.start..][..slot.len]
    }

    settings::settings! {
        struct Held {
            gripper: schema::Grippers,
        }
    }

    #[test]
    fn a_judge_answers_for_its_gripper_or_for_those_between_its_grippers() {
        let read = |name: &str| {
            let text = format!("gripper = \"{name}\"");
            let document = settings::Document::parse(&text, std::path::Path::new("test.toml")).unwrap();
            document.read::<Held>().unwrap().gripper
        };
        let many = Scope::of(read("any_jaw").all(), 0.05, Grid::PAPER, false);
        for (name, _) in Gripper::BUILT_IN {
            many.must_match(&read(name).all()[0], &Grid::PAPER).unwrap();
        }
        let own = read("wsg_50").all()[0].clone();
        let wide = Gripper { opening_m_max: 0.2, ..own.clone() };
        let told = many.must_match(&wide, &Grid::PAPER).unwrap_err().to_string();
        assert!(told.contains("opening_m_max must be 0.0") && told.ends_with("got 0.2"), "{told}");
        let one = Scope::of(std::slice::from_ref(&own), 0.05, Grid::PAPER, false);
        assert_eq!(one.grippers, None);
        one.must_match(&Gripper { name: "mine".to_owned(), ..own.clone() }, &Grid::PAPER).unwrap();
        let told = one.must_match(&Gripper { friction: 0.81, ..own }, &Grid::PAPER).unwrap_err().to_string();
        let expected = "the judge was trained for the gripper wsg_50, not for wsg_50 as it is given: friction must be \
            0.8, got 0.81";
        assert_eq!(told, expected);
    }

    /// A convolution from its definition, in double precision: `[channels, x, y, z]` to the same, padded by one zero.
    fn convolved(vector: &[f32], layer: &LayerShape, n: [usize; 3], inputs: &[f64]) -> ([usize; 3], Vec<f64>) {
        let [weights, bias] = ["weight", "bias"].map(|part| parameter(vector, &format!("{}.{part}", layer.name)));
        let out = n.map(|n| (n + 2 * layer.padding() - layer.kernel) / layer.stride + 1);
        let mut outputs = Vec::new();
        for column in 0..layer.channels_out {
            for at in (Extent { n: out, padding: 0 }).positions() {
                let mut sum = f64::from(bias[column]);
                for channel in 0..layer.channels_in {
                    for (tap, place) in positions(layer.kernel).enumerate() {
                        let from: [usize; 3] = std::array::from_fn(|axis| at[axis] * layer.stride + place[axis]);
                        if (0..3).all(|axis| (layer.padding()..n[axis] + layer.padding()).contains(&from[axis])) {
                            let [x, y, z] = from.map(|from| from - layer.padding());
                            let weight = weights[(column * layer.channels_in + channel) * layer.kernel.pow(3) + tap];
                            sum += f64::from(weight) * inputs[((channel * n[0] + x) * n[1] + y) * n[2] + z];
                        }
                    }
                }
                outputs.push(sum);
            }
        }
        (out, outputs)
    }

    /// Layers on a box from their definition; what they give, x slowest and channels fastest.
    fn convolved_by<const VALUES: usize>(
        vector: &[f32],
        layers: &[LayerShape],
        mut n: [usize; 3],
        box_: &[f32],
    ) -> Vec<f64> {
        let padded = Extent { n, padding: 1 };
        let mut x: Vec<f64> = (0..VALUES)
            .flat_map(|channel| padded.positions().map(move |at| (channel, at)))
            .map(|(channel, at)| f64::from(box_[padded.place(at) * VALUES + channel]))
            .collect();
        for (number, layer) in layers.iter().enumerate() {
            (n, x) = convolved(vector, layer, n, &x);
            if number + 1 < layers.len() {
                x.iter_mut().for_each(|value| *value = value.max(0.0));
            }
        }
        let positions: usize = n.iter().product();
        (0..positions).flat_map(|at| x.iter().copied().skip(at).step_by(positions)).collect()
    }

    /// The network from its definition.
    fn slow(vector: &[f32], grasp: usize, inputs: &JudgeInputs) -> Vec<f64> {
        let crop = &inputs.crops[grasp * Crop::LEN..][..Crop::LEN];
        let wide = &inputs.wide[grasp * Crop::WIDE_LEN..][..Crop::WIDE_LEN];
        let mut x = convolved_by::<CHANNELS>(vector, &LAYERS[..4], BOX, crop);
        x.extend(convolved_by::<WIDE_CHANNELS>(vector, &LAYERS[4..CONVS], WIDE_BOX, wide));
        x.extend(inputs.facts[grasp].iter().map(|fact| f64::from(*fact)));
        assert_eq!(x.len(), ROW);
        let dense = |layer: &LayerShape, x: &[f64]| convolved(vector, layer, [1, 1, 1], x).1;
        for layer in &LAYERS[CONVS..CONVS + 2] {
            x = dense(layer, &x).into_iter().map(|value| value.max(0.0)).collect();
        }
        LAYERS[CONVS + 2..].iter().flat_map(|layer| dense(layer, &x)).collect()
    }

    /// Boxes of random values with zeros around them.
    fn boxes(grasps: usize, n: [usize; 3], values: usize, stream: &mut Stream) -> Vec<f32> {
        let padded = Extent { n, padding: 1 };
        let mut boxes = vec![0.0; grasps * padded.len() * values];
        for one in boxes.chunks_exact_mut(padded.len() * values) {
            for at in padded.positions() {
                one[padded.place(at) * values..][..values].fill_with(|| stream.uniform(-1.0, 1.0));
            }
        }
        boxes
    }

    fn inputs(grasps: usize) -> JudgeInputs {
        let mut stream = Stream::new(5, 0, Purpose::Views, 0);
        let crops = boxes(grasps, BOX, CHANNELS, &mut stream);
        let wide = boxes(grasps, WIDE_BOX, WIDE_CHANNELS, &mut stream);
        let facts = (0..grasps).map(|_| std::array::from_fn(|_| stream.uniform(-1.0, 1.0))).collect();
        JudgeInputs { crops, wide, facts }
    }

    /// A judge without the last layer answers as one with it, and does not train it.
    #[test]
    fn judges_without_robustness_are_judges() {
        let (vector, inputs) = (initial_vector(3), inputs(2));
        let without = &vector[..count_of(&LAYERS[..LAYERS.len() - 1])];
        let [whole, part] = [&vector[..], without].map(JudgeNetwork::new);
        assert!(whole.has_robustness() && !part.has_robustness());
        for (whole, part) in whole.forward(&inputs).logits().zip(part.forward(&inputs).logits()) {
            assert_eq!((whole[..OUTCOMES].to_vec(), part[OUTCOMES]), (part[..OUTCOMES].to_vec(), 0.0));
            assert!(whole[OUTCOMES] != 0.0);
        }
        let gradient = part.gradient(&part.transposed(), &inputs, &part.forward(&inputs), &[[0.5; OUTPUTS]; 2]);
        assert_eq!(gradient.len(), without.len());
    }

    #[test]
    fn logits_are_those_of_the_definition() {
        let (vector, inputs) = (initial_vector(3), inputs(3));
        let seen = JudgeNetwork::new(&vector).forward(&inputs);
        for (grasp, ours) in seen.logits().enumerate() {
            let theirs = slow(&vector, grasp, &inputs);
            assert!(theirs.iter().any(|logit| logit.abs() > 0.05), "{theirs:?}");
            for (ours, theirs) in ours.iter().zip(theirs) {
                assert!((f64::from(*ours) - theirs).abs() < 1e-4, "{ours} against {theirs}");
            }
        }
    }

    /// Along random directions and along single parameters of every layer, the loss changes as the gradient says.
    #[test]
    fn gradients_are_slopes_of_the_definition() {
        let (vector, inputs) = (initial_vector(4), inputs(2));
        let network = JudgeNetwork::new(&vector);
        let mut stream = Stream::new(6, 0, Purpose::Views, 0);
        let d_logits: Vec<[f32; OUTPUTS]> =
            (0..2).map(|_| std::array::from_fn(|_| stream.uniform(-1.0, 1.0))).collect();
        let gradient = network.gradient(&network.transposed(), &inputs, &network.forward(&inputs), &d_logits);
        assert_eq!(gradient.len(), count_of(&LAYERS));
        let value = |vector: &[f32]| -> f64 {
            let logits = (0..2).map(|grasp| slow(vector, grasp, &inputs));
            let products = logits
                .zip(&d_logits)
                .map(|(logits, d)| logits.iter().zip(d).map(|(logit, d)| logit * f64::from(*d)).sum::<f64>());
            products.sum()
        };
        for slot in slots_of(&LAYERS) {
            let direction: Vec<f32> = (0..slot.len).map(|_| stream.uniform(-1.0, 1.0)).collect();
            let moved = |by: f32| {
                let mut moved = vector.clone();
                for (value, along) in moved[slot.start..][..slot.len].iter_mut().zip(&direction) {
                    *value += by * along;
                }
                value(&moved)
            };
            // Small, so that few values cross zero, where ReLU bends.
            let step = 3e-4 / (slot.len as f32).sqrt();
            let slope = (moved(step) - moved(-step)) / (2.0 * f64::from(step));
            let ours: f64 = gradient[slot.start..][..slot.len]
                .iter()
                .zip(&direction)
                .map(|(slope, along)| f64::from(*slope) * f64::from(*along))
                .sum();
            assert!((ours - slope).abs() < 1e-2 * (slope.abs() + 1.0), "{}: {ours} against {slope}", slot.name);
            assert!(gradient[slot.start..][..slot.len].iter().any(|slope| *slope != 0.0), "{}", slot.name);
        }
    }

    #[test]
    fn quality_is_the_share_of_held() {
        let logits = [0.3, -1.0, 2.0, 0.0, -3.0, 1.5, 0.7];
        let held = f64::from(probabilities(&logits)[Outcome::Held as usize]);
        let quality = 1.0 / (1.0 + libm::exp(-f64::from(quality_logit(&logits))));
        assert!((held - quality).abs() < 1e-6, "{held} {quality}");
        let sum: f32 = probabilities(&logits).iter().sum();
        assert!((sum - 1.0).abs() < 1e-6);
    }
}
