//! Adam over the flat parameter vector (Kingma and Ba, 2015), with Burn's arithmetic and rounding.

use network::checkpoint::Moments;

/// β₁, β₂ and ε, PyTorch's defaults.
const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// Updates the parameters with a gradient. `moments` are `None` before the first step.
pub fn step(moments: &mut Option<Moments>, learning_rate: f64, vector: &mut [f32], gradient: &[f32]) {
    let zeros = || vec![-0.0; vector.len()]; // adding −0 changes no bit of a number
    let moments = moments.get_or_insert_with(|| Moments { steps: 0, first: zeros(), second: zeros() });
    moments.steps += 1;
    let steps = moments.steps as i32;
    let correction_2 = (1.0 - BETA_2.powi(steps)).sqrt();
    let factor = correction_2 / (1.0 - BETA_1.powi(steps));
    let (epsilon, learning_rate) = (EPSILON * correction_2, learning_rate as f32);
    let moments = moments.first.iter_mut().zip(&mut moments.second);
    for ((value, gradient), (first, second)) in vector.iter_mut().zip(gradient).zip(moments) {
        *first = *first * BETA_1 + gradient * (1.0 - BETA_1);
        *second = *second * BETA_2 + gradient * gradient * (1.0 - BETA_2);
        *value -= *first * factor / (second.sqrt() + epsilon) * learning_rate;
    }
}

#[cfg(test)]
mod tests {
    use burn::optim::{AdamConfig, Optimizer};
    use burn::tensor::{Device, Tensor};
    use schema::{Purpose, Stream};

    use super::*;

    #[test]
    fn steps_are_burns_to_the_bit() {
        let rule = AdamConfig::new().with_beta_1(0.9).with_beta_2(0.999).with_epsilon(1e-8).build();
        let mut draw = Stream::new(9, 0, Purpose::Weights, 0);
        let mut draws = || -> Vec<f32> { (0..999).map(|_| draw.uniform(-1.0, 1.0)).collect() };
        let mut vector = draws();
        let (mut theirs, mut state) = (Tensor::<1>::from_data(vector.as_slice(), &Device::flex()), None);
        let mut moments = None;
        for number in 0..20 {
            let gradient = draws();
            let there = Tensor::from_data(gradient.as_slice(), &Device::flex());
            (theirs, state) = rule.step(3e-4 / f64::from(number + 1), theirs, there, state);
            step(&mut moments, 3e-4 / f64::from(number + 1), &mut vector, &gradient);
            assert_eq!(theirs.to_data().iter::<f32>().collect::<Vec<_>>(), vector, "step {number}");
        }
        let (state, moments) = (state.unwrap().momentum, moments.unwrap());
        assert_eq!(state.time, moments.steps);
        assert_eq!(state.moment_2.into_data().iter::<f32>().collect::<Vec<_>>(), moments.second);
    }
}
