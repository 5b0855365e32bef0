//! The dense network for inference against the plain one.

use burn::tensor::{Device, Tensor, TensorData};
use network::DenseNetwork;
use network::head::Head;
use network::upsampling::Upsampling;
use trainer::voxel::graph;

use crate::formula::{grid, parameters};
use crate::plain;

/// Differences in units of the largest value, ascending.
fn apart(ours: &[f32], plain: Tensor<5>) -> Vec<f32> {
    let plain = plain.into_data().try_to_vec::<f32>().unwrap();
    assert_eq!(ours.len(), plain.len());
    let largest = plain.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
    let mut apart: Vec<f32> = ours.iter().zip(&plain).map(|(a, b)| (a - b).abs() / largest).collect();
    apart.sort_by(f32::total_cmp);
    apart
}

#[test]
fn inference_is_the_plain_network_everywhere() {
    let device = Device::flex();
    let vector = parameters();
    for mode in Upsampling::ALL {
        let (parameters, dense) =
            (graph::to_device(&vector, &device), DenseNetwork::new(&vector, mode, Head::Quaternion));
        for number in 0..2 {
            let grid = grid(number);
            let ours = dense.infer(&grid);
            let tsdf = TensorData::new(grid, [1, 1, 40, 40, 40]);
            let expected = plain::dense(&parameters, Tensor::from_data(tsdf, &device), mode);
            let logit = apart(&ours.quality_logit, expected.quality_logit);
            let rotation = apart(&ours.rotation, expected.rotation);
            let width = apart(&ours.width_voxels, expected.width_voxels);
            let worst = [&logit, &rotation, &width].map(|apart| apart[apart.len() - 1]);
            println!("{mode:?}, grid {number}: logit, rotation, width apart by at most {worst:?}");
            assert!(worst[0] < 1e-5 && worst[2] < 1e-5, "{mode:?}, grid {number}: {worst:?}");
            // Where the four outputs nearly vanish, dividing by their norm makes more of their rounding.
            let nearly_all = rotation[rotation.len() * 999 / 1000];
            assert!(nearly_all < 1e-5 && worst[1] < 1e-3, "{mode:?}, grid {number}: {nearly_all}, {}", worst[1]);
        }
    }
}
