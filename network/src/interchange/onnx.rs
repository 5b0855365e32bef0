//! The network as an ONNX model: the dense network and the sigmoid, node by node.
//!
//! Operators of opset 13 (onnx/docs/Operators.md), messages and field numbers from onnx/onnx.proto, IR version 7:
//! readable by any runtime for ONNX 1.8 (November 2020) or later.

use super::protobuf::Message;
use crate::checkpoint::{Checkpoint, VOXEL};
use crate::layers::{LAYERS, LayerShape, NORM_SQUARED_MIN, parameter_slots};
use crate::upsampling::Upsampling;

const IR_VERSION: i64 = 7;
const OPSET: i64 = 13;
/// `TensorProto.DataType.FLOAT`.
const FLOAT: i64 = 1;
/// Voxels along an axis.
const SIDE: i64 = 40;

const INPUT: &str = "tsdf";
/// Names and channels.
const OUTPUTS: [(&str, i64); 3] = [("quality", 1), ("rotation", 4), ("width", 1)];
/// The scale of `Resize` along each axis.
const SCALES: &str = "doubling.scales";
const NORM_MIN: &str = "rotation.norm_squared_min";

const DOC: &str = "Volumetric grasp network. In: tsdf [batch, 1, 40, 40, 40], truncated signed distances in VGN's values \
                   ((d + 1) / 2 in [0, 1], 0 where nothing was seen), axes x, y, z of the workspace. Out, for every \
                   voxel: quality [batch, 1, ...], the chance that a grasp there holds; rotation [batch, 4, ...], the \
                   hand's orientation in the workspace as a unit quaternion x, y, z, w; width [batch, 1, ...], the \
                   opening in voxels.";

/// The ONNX file of a checkpoint's network.
pub(super) fn model(checkpoint: &Checkpoint, upsampling: Upsampling) -> Vec<u8> {
    let mut properties = [
        ("architecture", VOXEL.to_owned()),
        ("upsampling", upsampling.name().to_owned()),
        ("dataset_id", checkpoint.dataset_id.clone()),
        ("config", checkpoint.config.clone()),
        ("epoch", checkpoint.progress.epoch.to_string()),
        ("step", checkpoint.progress.step.to_string()),
    ];
    properties.sort();
    let properties: Vec<Message> =
        properties.iter().map(|(key, value)| Message::new().text(1, key).text(2, value)).collect();
    // ModelProto
    Message::new()
        .integer(1, IR_VERSION)
        .text(2, "graspmill trainer")
        .text(3, env!("CARGO_PKG_VERSION"))
        .text(6, DOC)
        .message(7, &graph(checkpoint, upsampling))
        .message(8, &Message::new().text(1, "").integer(2, OPSET)) // OperatorSetIdProto
        .messages(14, &properties) // StringStringEntryProto
        .into_bytes()
}

/// `GraphProto`.
fn graph(checkpoint: &Checkpoint, upsampling: Upsampling) -> Message {
    let outputs = OUTPUTS.map(|(name, channels)| volume(name, channels));
    Message::new()
        .messages(1, &nodes(upsampling))
        .text(2, VOXEL)
        .messages(5, &initializers(checkpoint))
        .message(11, &volume(INPUT, 1))
        .messages(12, &outputs)
}

fn nodes(upsampling: Upsampling) -> Vec<Message> {
    let [enc1, enc2, enc3, dec1, dec2, dec3, qual, rot, width] = LAYERS;
    let (mut nodes, mut x) = (Vec::new(), INPUT.to_owned());
    for layer in [enc1, enc2, enc3, dec1, dec2, dec3] {
        let [convolved, activated] = ["conv", "relu"].map(|part| format!("{}.{part}", layer.name));
        nodes.push(convolution(layer, &x, &convolved));
        nodes.push(node("Relu", &[&convolved], &activated, &[]));
        x = activated;
        if [dec1, dec2, dec3].contains(&layer) {
            let doubled = format!("{}.doubled", layer.name);
            nodes.push(doubling(upsampling, &x, &doubled));
            x = doubled;
        }
    }
    let axes = [integers("axes", &[1]), integer("keepdims", 1)];
    nodes.extend([
        convolution(qual, &x, "quality.logit"),
        node("Sigmoid", &["quality.logit"], "quality", &[]),
        convolution(rot, &x, "rotation.raw"),
        node("ReduceSumSquare", &["rotation.raw"], "rotation.norm_squared", &axes),
        node("Max", &["rotation.norm_squared", NORM_MIN], "rotation.norm_squared_held", &[]),
        node("Sqrt", &["rotation.norm_squared_held"], "rotation.norm", &[]),
        node("Div", &["rotation.raw", "rotation.norm"], "rotation", &[]),
        convolution(width, &x, "width"),
    ]);
    nodes
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

/// `ValueInfoProto` of `[batch, channels, 40, 40, 40]`, the batch of any length.
fn volume(name: &str, channels: i64) -> Message {
    let batch = Message::new().text(2, "batch");
    let [channels, side] = [channels, SIDE].map(|len| Message::new().integer(1, len));
    let shape = Message::new().messages(1, [&batch, &channels, &side, &side, &side]);
    let tensor = Message::new().integer(1, FLOAT).message(2, &shape);
    Message::new().text(1, name).message(2, &Message::new().message(1, &tensor))
}

/// The parameters under VGN's names, and two constants.
fn initializers(checkpoint: &Checkpoint) -> Vec<Message> {
    let values = &checkpoint.vector;
    let slots = parameter_slots();
    let parameters = slots.iter().map(|slot| {
        let shape: Vec<i64> = slot.shape.iter().map(|len| *len as i64).collect();
        constant(&slot.name, &shape, &values[slot.start..slot.start + slot.len])
    });
    parameters
        .chain([constant(SCALES, &[5], &[1.0, 1.0, 2.0, 2.0, 2.0]), constant(NORM_MIN, &[1], &[NORM_SQUARED_MIN])])
        .collect()
}

/// `TensorProto`.
fn constant(name: &str, shape: &[i64], values: &[f32]) -> Message {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    Message::new().integers(1, shape).integer(2, FLOAT).text(8, name).bytes(9, &bytes)
}
