//! Adam over the flat parameter vector. The arithmetic is Burn's; the vector makes the state two tensors that a
//! checkpoint can cut by name.

use burn::optim::{AdamConfig, AdamState, AdaptiveMomentumState, Optimizer};
use burn::tensor::Tensor;

/// Adam with PyTorch's defaults: β = 0.9 and 0.999, ε = 1e-8 (Burn's own default is 1e-5).
#[derive(Clone)]
pub struct Adam {
    rule: burn::optim::Adam,
    learning_rate: f64,
    state: Option<AdamState<1>>,
}

/// What Adam remembers between steps, each in the order of the flat parameter vector.
#[derive(Debug, Clone)]
pub struct Moments {
    /// Steps taken.
    pub steps: usize,
    /// Running mean of the gradient.
    pub first: Tensor<1>,
    /// Running mean of its square.
    pub second: Tensor<1>,
}

impl std::fmt::Debug for Adam {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Adam").field("learning_rate", &self.learning_rate).finish_non_exhaustive()
    }
}

impl Adam {
    /// Before the first step.
    #[must_use]
    pub fn new(learning_rate: f64) -> Self {
        let rule = AdamConfig::new().with_beta_1(0.9).with_beta_2(0.999).with_epsilon(1e-8).build();
        Self { rule, learning_rate, state: None }
    }

    /// After the steps that a checkpoint remembers.
    #[must_use]
    pub fn resume(learning_rate: f64, moments: Moments) -> Self {
        let momentum = AdaptiveMomentumState::new(moments.steps, moments.first, moments.second);
        Self { state: Some(AdamState::new(momentum)), ..Self::new(learning_rate) }
    }

    /// Changes the size of the steps to come.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.learning_rate = learning_rate;
    }

    /// Moves the parameters against the gradient.
    #[must_use]
    pub fn step(&mut self, vector: Tensor<1>, gradient: Tensor<1>) -> Tensor<1> {
        let (vector, state) = self.rule.step(self.learning_rate, vector, gradient, self.state.take());
        self.state = state;
        vector
    }

    /// What is to be remembered; `None` before the first step.
    #[must_use]
    pub fn moments(&self) -> Option<Moments> {
        let momentum = &self.state.as_ref()?.momentum;
        Some(Moments { steps: momentum.time, first: momentum.moment_1.clone(), second: momentum.moment_2.clone() })
    }
}
