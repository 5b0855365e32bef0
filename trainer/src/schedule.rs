//! How Adam's step size changes over a run: a pure function of the step, so that nothing is to be remembered.

use core::f64::consts::PI;

use settings::words;

words! {
    /// A way from the first step's size to the last one's.
    pub enum Schedule {
        /// The same for every step: the paper's.
        Constant = "constant",
        /// Half a cosine from the full size at the first step towards 0 after the last (Loshchilov and Hutter, *SGDR*,
        /// 2017, Eq. 5, without restarts). The size of every step depends on the number of steps in all.
        Cosine = "cosine",
    }
}

impl Schedule {
    /// The size of step `step`, counted from 0, of `steps` in all.
    #[must_use]
    pub fn learning_rate(self, full: f64, step: u64, steps: u64) -> f64 {
        match self {
            Self::Constant => full,
            Self::Cosine => full * 0.5 * (1.0 + libm::cos(PI * step as f64 / steps.max(1) as f64)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cosine_falls_from_all_to_nothing_by_half_on_half_the_way() {
        let at = |step| Schedule::Cosine.learning_rate(3e-4, step, 1200);
        let root = 0.5_f64.sqrt();
        for (step, share) in [(0, 1.0), (300, 0.5 + 0.5 * root), (400, 0.75), (600, 0.5), (800, 0.25), (1200, 0.0)] {
            assert!((at(step) - 3e-4 * share).abs() < 1e-16, "step {step}: {}", at(step));
        }
        assert!((0..1200).all(|step| at(step + 1) < at(step)));
    }

    #[test]
    fn a_constant_stays() {
        assert!([0, 7, 1200].iter().all(|step| Schedule::Constant.learning_rate(3e-4, *step, 1200) == 3e-4));
    }
}
