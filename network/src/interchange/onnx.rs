//! A network as an ONNX model, node by node: the dense network and the sigmoid, or the judge and the softmax.
//!
//! Operators of opset 13 (onnx/docs/Operators.md), messages and field numbers from onnx/onnx.proto, IR version 7:
//! readable by any runtime for ONNX 1.8 (November 2020) or later.

use super::protobuf::Message;
use crate::checkpoint::{Checkpoint, JUDGE, name_of};
use crate::head::{Head, TURNS};
use crate::judge::{self, BOX, CHANNELS, FACTS, OUTCOMES, WIDE_BOX, WIDE_CHANNELS};
use crate::layers::{LayerShape, NORM_SQUARED_MIN};
use crate::upsampling::Upsampling;
use crate::{Architecture, VoxelParams};

const IR_VERSION: i64 = 7;
const OPSET: i64 = 13;
/// `TensorProto.DataType`.
const FLOAT: i64 = 1;
const INT64: i64 = 7;
/// Voxels along an axis.
const SIDE: i64 = 40;

const INPUT: &str = "tsdf";
/// Names and channels.
const OUTPUTS: [(&str, i64); 3] = [("quality", 1), ("rotation", 4), ("width", 1)];
const OUTPUTS_BY_CLOSING: [(&str, i64); 5] =
    [("quality_logit", 3), ("approach", 3), ("turns", TURNS as i64), ("width", 3), ("tips", 3)];
/// The scale of `Resize` along each axis.
const SCALES: &str = "doubling.scales";
const NORM_MIN: &str = "norm_squared_min";

const DOC: &str = "Volumetric grasp network. In: tsdf [batch, 1, 40, 40, 40], truncated signed distances in VGN's values \
                   ((d + 1) / 2 in [0, 1], 0 where nothing was seen), axes x, y, z of the workspace. Out, for every \
                   voxel: quality [batch, 1, ...], the chance that a grasp there holds; rotation [batch, 4, ...], the \
                   hand's orientation in the workspace as a unit quaternion x, y, z, w; width [batch, 1, ...], the \
                   opening in voxels.";

const DOC_BY_CLOSING: &str = "Volumetric grasp network with a head by closing direction. In: tsdf as of the paper's network. \
                              Out, for every voxel: approach [batch, 3, ...], the hand's direction as a unit vector; \
                              turns [batch, 15, ...], how likely it holds closed along each of 15 directions over half a \
                              turn about the approach; quality_logit and width (voxels), each [batch, 3, ...] as a, b, c \
                              of a + b cos 2t + c sin 2t at turn t; tips [batch, 3, ...], the point between the finger \
                              tips from the middle of the voxel, in voxels. graspmill.torch has the decoder.";

/// The judge's inputs and outputs.
const CROP: &str = "crop";
const WIDE: &str = "surroundings";
const KNOWN: &str = "facts";
const ANSWER: &str = "outcomes";
const ROBUSTNESS: &str = "robustness";
/// The shape of the head's inputs, as products of matrices over one position.
const ROW: &str = "row.shape";

const JUDGE_DOC: &str = "A judge of hands. In: crop [batch, 4, 8, 20, 28] and surroundings [batch, 3, 12, 8, 8], the \
                         TSDF in the hand's frame, and facts [batch, 16], as scripts/judge_onnx.py computes them. Out: \
                         outcomes [batch, 6], the probabilities of pregrasp_collision, approach_collision, \
                         empty, slipped, hit_other and held; and where it learned from repeated attempts \
                         robustness [batch, 1], the share of a held grasp's repeats that hold.";

/// The ONNX file of a checkpoint's network.
pub(super) fn model(checkpoint: &Checkpoint) -> Vec<u8> {
    let (name, doc, own) = match &checkpoint.architecture {
        Architecture::Voxel(VoxelParams { head, upsampling, origin }) => (
            name_of(*head),
            match head {
                Head::Quaternion => DOC,
                Head::Closings => DOC_BY_CLOSING,
            },
            vec![
                ("upsampling", upsampling.name().to_owned()),
                ("origin_behind_tips_m", origin.behind_tips_m.to_string()),
                ("voxel_offset", origin.voxel_offset.to_string()),
            ],
        ),
        // Numbers and a name under fixed keys always have a JSON form.
        Architecture::Judge(scope) => {
            (JUDGE, JUDGE_DOC, vec![("trained_for", serde_json::to_string(scope).unwrap_or_default())])
        }
    };
    let mut properties = vec![
        ("architecture", name.to_owned()),
        ("dataset_id", checkpoint.dataset_id.clone()),
        ("config", checkpoint.config.clone()),
        ("epoch", checkpoint.progress.epoch.to_string()),
        ("step", checkpoint.progress.step.to_string()),
    ];
    properties.extend(own);
    properties.sort();
    let properties: Vec<Message> =
        properties.iter().map(|(key, value)| Message::new().text(1, key).text(2, value)).collect();
    // ModelProto
    Message::new()
        .integer(1, IR_VERSION)
        .text(2, "graspmill trainer")
        .text(3, env!("CARGO_PKG_VERSION"))
        .text(6, doc)
        .message(7, &graph(checkpoint, name))
        .message(8, &Message::new().text(1, "").integer(2, OPSET)) // OperatorSetIdProto
        .messages(14, &properties) // StringStringEntryProto
        .into_bytes()
}

/// `GraphProto`.
fn graph(checkpoint: &Checkpoint, name: &str) -> Message {
    let (nodes, constants, inputs, outputs) = match &checkpoint.architecture {
        Architecture::Voxel(params) => (
            nodes(params),
            vec![constant(SCALES, &[5], &[1.0, 1.0, 2.0, 2.0, 2.0]), constant(NORM_MIN, &[1], &[NORM_SQUARED_MIN])],
            vec![volume(INPUT, 1)],
            match params.head {
                Head::Quaternion => OUTPUTS.map(|(name, channels)| volume(name, channels)).to_vec(),
                Head::Closings => OUTPUTS_BY_CLOSING.map(|(name, channels)| volume(name, channels)).to_vec(),
            },
        ),
        Architecture::Judge(scope) => {
            let volume = |name: &str, channels: usize, [x, y, z]: [usize; 3]| {
                tensor(name, &[channels as i64, x as i64, y as i64, z as i64])
            };
            let row = Message::new().integers(1, &[5]).integer(2, INT64).text(8, ROW);
            let row = row.bytes(9, &[0, -1, 1, 1, 1].map(i64::to_le_bytes).concat());
            (
                judge_nodes(scope.robustness),
                vec![row],
                vec![
                    volume(CROP, CHANNELS, BOX),
                    volume(WIDE, WIDE_CHANNELS, WIDE_BOX),
                    tensor(KNOWN, &[FACTS as i64]),
                ],
                judge_outputs(scope.robustness),
            )
        }
    };
    Message::new()
        .messages(1, &nodes)
        .text(2, name)
        .messages(5, parameters(checkpoint).iter().chain(&constants))
        .messages(11, &inputs)
        .messages(12, &outputs)
}

/// The probabilities of the outcomes, and the robustness of judges that say it.
fn judge_outputs(has_robustness: bool) -> Vec<Message> {
    let robustness = has_robustness.then(|| tensor(ROBUSTNESS, &[1]));
    [tensor(ANSWER, &[OUTCOMES as i64])].into_iter().chain(robustness).collect()
}

fn judge_nodes(has_robustness: bool) -> Vec<Message> {
    let [conv1, conv2, conv3, reduce, wide1, wide2, head1, head2, head3, robustness] = judge::LAYERS;
    let mut nodes = Vec::new();
    for (input, activations, last) in [(CROP, &[conv1, conv2, conv3][..], reduce), (WIDE, &[wide1], wide2)] {
        let mut x = input.to_owned();
        for layer in activations {
            x = activated(&mut nodes, *layer, &x);
        }
        let [seen, turned, row] = ["seen", "last", "row"].map(|what| format!("{input}.{what}"));
        nodes.extend([
            convolution(last, &x, &seen),
            node("Transpose", &[&seen], &turned, &[integers("perm", &[0, 2, 3, 4, 1])]),
            node("Flatten", &[&turned], &row, &[integer("axis", 1)]),
        ]);
    }
    let [crop, wide] = [CROP, WIDE].map(|input| format!("{input}.row"));
    nodes.extend([
        node("Concat", &[&crop, &wide, KNOWN], "row", &[integer("axis", 1)]),
        node("Reshape", &["row", ROW], "row.shaped", &[]),
    ]);
    let mut x = "row.shaped".to_owned();
    for layer in [head1, head2] {
        x = activated(&mut nodes, layer, &x);
    }
    nodes.extend([
        convolution(head3, &x, "logits.shaped"),
        node("Flatten", &["logits.shaped"], "logits", &[integer("axis", 1)]),
        node("Softmax", &["logits"], ANSWER, &[integer("axis", 1)]),
    ]);
    if has_robustness {
        nodes.extend([
            convolution(robustness, &x, "robustness.shaped"),
            node("Flatten", &["robustness.shaped"], "robustness.logit", &[integer("axis", 1)]),
            node("Sigmoid", &["robustness.logit"], ROBUSTNESS, &[]),
        ]);
    }
    nodes
}

fn nodes(params: &VoxelParams) -> Vec<Message> {
    let (trunk, heads) = params.head.layers().split_at(6);
    let (mut nodes, mut x) = (Vec::new(), INPUT.to_owned());
    for (number, layer) in trunk.iter().enumerate() {
        x = activated(&mut nodes, *layer, &x);
        if number >= 3 {
            let doubled = format!("{}.doubled", layer.name);
            nodes.push(doubling(params.upsampling, &x, &doubled));
            x = doubled;
        }
    }
    match (params.head, heads) {
        (Head::Quaternion, [qual, rot, width]) => {
            nodes.extend([
                convolution(*qual, &x, "quality.logit"),
                node("Sigmoid", &["quality.logit"], "quality", &[]),
                convolution(*rot, &x, "rotation.raw"),
                convolution(*width, &x, "width"),
            ]);
            nodes.extend(normalised("rotation"));
        }
        (_, heads) => {
            let outputs = ["quality_logit", "approach.raw", "turns.logit", "width", "tips"];
            nodes.extend(heads.iter().zip(outputs).map(|(layer, output)| convolution(*layer, &x, output)));
            nodes.extend(normalised("approach"));
            nodes.push(node("Softmax", &["turns.logit"], "turns", &[integer("axis", 1)]));
        }
    }
    nodes
}

/// From `NAME.raw` to vectors of length 1, along the channels.
fn normalised(name: &str) -> [Message; 4] {
    let axes = [integers("axes", &[1]), integer("keepdims", 1)];
    let [raw, squared, held, norm] =
        ["raw", "norm_squared", "norm_squared_held", "norm"].map(|part| format!("{name}.{part}"));
    [
        node("ReduceSumSquare", &[&raw], &squared, &axes),
        node("Max", &[&squared, NORM_MIN], &held, &[]),
        node("Sqrt", &[&held], &norm, &[]),
        node("Div", &[&raw, &norm], name, &[]),
    ]
}

/// Adds a layer and its ReLU; gives the name of their output.
fn activated(nodes: &mut Vec<Message>, layer: LayerShape, input: &str) -> String {
    let [convolved, activated] = ["conv", "relu"].map(|part| format!("{}.{part}", layer.name));
    nodes.push(convolution(layer, input, &convolved));
    nodes.push(node("Relu", &[&convolved], &activated, &[]));
    activated
}

fn convolution(layer: LayerShape, input: &str, output: &str) -> Message {
    let [weight, bias] = ["weight", "bias"].map(|part| format!("{}.{part}", layer.name));
    let attributes = [
        integers("kernel_shape", &[layer.kernel as i64; 3]),
        integers("pads", &[layer.padding() as i64; 6]),
        integers("strides", &[layer.stride as i64; 3]),
    ];
    node("Conv", &[input, &weight, &bias], output, &attributes)
}

/// A doubling: half-pixel centres clamped at the ends, or each value eight times.
fn doubling(upsampling: Upsampling, input: &str, output: &str) -> Message {
    let attributes = match upsampling {
        Upsampling::Linear => vec![text("mode", "linear"), text("coordinate_transformation_mode", "half_pixel")],
        Upsampling::Nearest => vec![
            text("mode", "nearest"),
            text("coordinate_transformation_mode", "asymmetric"),
            text("nearest_mode", "floor"),
        ],
    };
    node("Resize", &[input, "", SCALES], output, &attributes) // the omitted input is a region for cropping
}

/// `NodeProto`, named as its output.
fn node(operator: &str, inputs: &[&str], output: &str, attributes: &[Message]) -> Message {
    let inputs = inputs.iter().fold(Message::new(), |message, input| message.text(1, input));
    inputs.text(2, output).text(3, output).text(4, operator).messages(5, attributes)
}

/// `AttributeProto` of type INTS.
fn integers(name: &str, values: &[i64]) -> Message {
    Message::new().text(1, name).integers(8, values).integer(20, 7)
}

/// `AttributeProto` of type INT.
fn integer(name: &str, value: i64) -> Message {
    Message::new().text(1, name).integer(3, value).integer(20, 2)
}

/// `AttributeProto` of type STRING.
fn text(name: &str, value: &str) -> Message {
    Message::new().text(1, name).text(4, value).integer(20, 3)
}

/// `ValueInfoProto` of `[batch, channels, 40, 40, 40]`.
fn volume(name: &str, channels: i64) -> Message {
    tensor(name, &[channels, SIDE, SIDE, SIDE])
}

/// `ValueInfoProto` of `[batch, …]`, the batch of any length.
fn tensor(name: &str, shape: &[i64]) -> Message {
    let batch = Message::new().text(2, "batch");
    let lengths: Vec<Message> = shape.iter().map(|len| Message::new().integer(1, *len)).collect();
    let shape = Message::new().messages(1, [batch].iter().chain(&lengths));
    let tensor = Message::new().integer(1, FLOAT).message(2, &shape);
    Message::new().text(1, name).message(2, &Message::new().message(1, &tensor))
}

/// The parameters under their names.
fn parameters(checkpoint: &Checkpoint) -> Vec<Message> {
    let values = &checkpoint.vector;
    let parameters = checkpoint.architecture.slots().into_iter().map(|slot| {
        let shape: Vec<i64> = slot.shape.iter().map(|len| *len as i64).collect();
        constant(&slot.name, &shape, &values[slot.start..slot.start + slot.len])
    });
    parameters.collect()
}

/// `TensorProto`.
fn constant(name: &str, shape: &[i64], values: &[f32]) -> Message {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    Message::new().integers(1, shape).integer(2, FLOAT).text(8, name).bytes(9, &bytes)
}
