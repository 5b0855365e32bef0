//! Adam over the flat parameter vector (Kingma and Ba, 2015), with Burn's arithmetic and rounding.

use network::checkpoint::Moments;

/// β₁, β₂ and ε, PyTorch's defaults.
const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// Most that a step counts in the mean of the first steps, of which each counts alike: `(1 + n) / (10 + n)` of the mean
/// stays, as long as that is less than the decay.
const AVERAGED_FROM: f64 = 10.0;

/// As [`step`], for parameters that are the running mean of those that the steps give: of them `decay` stays in a step.
/// Means of the last steps are better than the last of them, as a step size that falls to 0 is (Polyak and Juditsky,
/// 1992).
pub fn averaged_step(
    moments: &mut Option<Moments>,
    learning_rate: f64,
    decay: f64,
    mean: &mut [f32],
    gradient: &[f32],
) {
    let mut point = moments.as_mut().and_then(|moments| moments.point.take()).unwrap_or_else(|| mean.to_vec());
    step(moments, learning_rate, &mut point, gradient);
    if let Some(moments) = moments {
        let steps = moments.steps as f64;
        let own = (1.0 - decay.min((1.0 + steps) / (AVERAGED_FROM + steps))) as f32;
        mean.iter_mut().zip(&point).for_each(|(mean, point)| *mean += own * (point - *mean));
        moments.point = Some(point);
    }
}

/// Updates the parameters with a gradient. `moments` are `None` before the first step.
pub fn step(moments: &mut Option<Moments>, learning_rate: f64, vector: &mut [f32], gradient: &[f32]) {
    let zeros = || vec![-0.0; vector.len()]; // adding −0 changes no bit of a number
    let moments = moments.get_or_insert_with(|| Moments { steps: 0, first: zeros(), second: zeros(), point: None });
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
    use schema::{Purpose, Stream};

    use super::*;

    /// Against the sum of all points with their weights, in f64.
    #[test]
    fn a_running_mean_goes_beside_the_same_steps() {
        let mut draw = Stream::new(8, 0, Purpose::Weights, 0);
        let mut draws = || -> Vec<f32> { (0..99).map(|_| draw.uniform(-1.0, 1.0)).collect() };
        let first = draws();
        let (mut plain, mut mean, mut moments, mut of_mean) = (first.clone(), first.clone(), None, None);
        let mut slow: Vec<f64> = first.iter().map(|value| f64::from(*value)).collect();
        for number in 1..=40 {
            let gradient = draws();
            step(&mut moments, 3e-2, &mut plain, &gradient);
            averaged_step(&mut of_mean, 3e-2, 0.7, &mut mean, &gradient);
            let kept = if number < 20 { f64::from(1 + number) / f64::from(10 + number) } else { 0.7 };
            let kept = kept.min(0.7);
            slow.iter_mut()
                .zip(&plain)
                .for_each(|(slow, point)| *slow = kept * *slow + (1.0 - kept) * f64::from(*point));
        }
        assert_eq!(of_mean.as_ref().unwrap().point.as_ref(), Some(&plain));
        assert_eq!(of_mean.unwrap().second, moments.unwrap().second);
        assert!(mean.iter().zip(slow).all(|(mean, slow)| (f64::from(*mean) - slow).abs() < 1e-5));
    }

    #[cfg(feature = "flex")]
    #[test]
    fn steps_are_burns_to_the_bit() {
        use burn::optim::{AdamConfig, Optimizer};
        use burn::tensor::{Device, Tensor};

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
