//! Network, loss, gradients and ten steps of Adam against PyTorch, by the goldens of `lab/golden_torch.py`.

use std::sync::Arc;

use crate::formula::{grid, noise, parameters, relative_error, sample};
use network::head::Head;
use network::layers::parameter_slots;
use network::upsampling::Upsampling;
use network::{DenseGrids, DenseNetwork, VoxelParams};
use safetensors::SafeTensors;
use schema::Quat;
use trainer::adam;
use trainer::batch::Batch;
use trainer::device::Device::Host;
use trainer::results::SampleResult;
use trainer::voxel::VoxelSample;
use trainer::voxel::loss::Target;
use trainer::voxel::step::step;

const TOLERANCE: f64 = 1e-4;
const GRIDS: u32 = 3;

struct Golden(Vec<u8>);

impl Golden {
    fn read(mode: Upsampling) -> Self {
        let path = format!("{}/tests/golden/{}.safetensors", env!("CARGO_MANIFEST_DIR"), mode.name());
        Self(std::fs::read(path).unwrap())
    }

    fn bytes<const N: usize>(&self, name: &str) -> Vec<[u8; N]> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        file.tensor(name).unwrap().data().chunks_exact(N).map(|chunk| chunk.try_into().unwrap()).collect()
    }

    fn floats(&self, name: &str) -> Vec<f32> {
        self.bytes(name).into_iter().map(f32::from_le_bytes).collect()
    }

    fn indices(&self, name: &str) -> Vec<usize> {
        self.bytes(name).into_iter().map(|bytes| i64::from_le_bytes(bytes) as usize).collect()
    }

    fn batch(&self) -> Batch<VoxelSample> {
        let (grids, voxels) = (self.indices("targets.grid"), self.indices("targets.voxel"));
        let (labels, rotations) = (self.indices("targets.label"), self.floats("targets.rotation"));
        let widths = self.floats("targets.width");
        let samples = (0..labels.len()).map(|at| {
            let target = Target {
                label: labels[at] as u8,
                rotation: Quat::from_slice(&rotations[4 * at..]),
                width_voxels: widths[at],
                tips_voxels: [0.0; 3],
                quality_weight: 1.0,
            };
            sample(grids[at], voxels[3 * at..][..3].try_into().unwrap(), target)
        });
        Batch { grids: (0..GRIDS).map(|number| Arc::from(grid(number))).collect(), samples: samples.collect() }
    }

    /// Compares the entries that the script sampled, and the norm of the whole.
    fn check(&self, name: &str, values: &[f32], seed: u32) -> f64 {
        let entries: Vec<f32> =
            noise(64, seed).into_iter().map(|draw| values[(draw * values.len() as f64) as usize]).collect();
        let norm = values.iter().map(|v| f64::from(*v) * f64::from(*v)).sum::<f64>().sqrt() as f32;
        let error = relative_error(&entries, &self.floats(name))
            .max(relative_error(&[norm], &self.floats(&format!("{name}.norm"))));
        assert!(error <= TOLERANCE, "{name}: relative error {error:e}");
        error
    }

    fn check_parameters(&self, kind: &str, values: &[f32], seed: u32) -> f64 {
        let errors = parameter_slots().into_iter().enumerate().map(|(number, slot)| {
            let part = &values[slot.start..slot.start + slot.len];
            self.check(&format!("{kind}.{}", slot.name), part, seed + number as u32)
        });
        errors.fold(0.0, f64::max)
    }
}

#[test]
fn the_dense_forward_is_pytorchs() {
    for mode in Upsampling::ALL {
        let (golden, network) = (Golden::read(mode), DenseNetwork::new(&parameters(), mode, Head::Quaternion));
        let outputs: Vec<_> = (0..GRIDS).map(|number| network.infer(&grid(number))).collect();
        let quality = outputs.iter().flat_map(|o| &o.quality_logit).map(|logit| 1.0 / (1.0 + libm::expf(-logit)));
        let all = |of: fn(&DenseGrids) -> &Vec<f32>| outputs.iter().flat_map(of).copied().collect::<Vec<f32>>();
        let error = golden
            .check("forward.quality", &quality.collect::<Vec<f32>>(), 400)
            .max(golden.check("forward.rotation", &all(|o| &o.rotation), 401))
            .max(golden.check("forward.width", &all(|o| &o.width_voxels), 402));
        println!("{mode:?}: worst relative error of the forward {error:e}");
    }
}

#[test]
fn losses_gradients_and_ten_adam_steps_are_pytorchs() {
    for mode in Upsampling::ALL {
        let golden = Golden::read(mode);
        let (mut vector, batch) = (parameters(), golden.batch());
        let mut moments = None;
        for (number, expected) in golden.floats("adam.losses").into_iter().enumerate() {
            let result = step(&vector, &batch, &VoxelParams::at_tips(mode), &Host);
            let loss = result.samples.iter().map(|sample| sample.total).sum::<f32>() / batch.samples.len() as f32;
            let error = relative_error(&[loss], &[expected]);
            assert!(error <= TOLERANCE, "{mode:?}, step {number}: loss {loss} against {expected}");
            if number == 0 {
                let losses = |of: fn(&SampleResult) -> f32| result.samples.iter().map(of).collect();
                for (name, losses) in [
                    ("total", losses(|s| s.total)),
                    ("quality", losses(|s| s.quality)),
                    ("rotation", losses(|s| s.rotation)),
                    ("width", losses(|s| s.width)),
                ] {
                    let losses: Vec<f32> = losses;
                    let error = relative_error(&losses, &golden.floats(&format!("loss.{name}")));
                    assert!(error <= TOLERANCE, "{mode:?}: {name} losses off by {error:e}");
                    println!("{mode:?}: {name} losses: relative error {error:e}");
                }
                let error = golden.check_parameters("gradient", &result.gradient, 500);
                println!("{mode:?}: worst relative error of a gradient {error:e}");
            }
            adam::step(&mut moments, 3e-4, &mut vector, &result.gradient);
        }
        let error = golden.check_parameters("adam", &vector, 600);
        println!("{mode:?}: worst relative error of a parameter after ten steps {error:e}");
    }
}
