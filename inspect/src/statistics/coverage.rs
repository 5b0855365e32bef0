//! Coverage of approach directions, in patches of equal area on the sphere.

use schema::{AttemptRecord, Vec3};
use serde::Serialize;
use shards::Tally;

use super::bins::bin;

/// Patches around the vertical.
pub(crate) const AZIMUTHS: usize = 24;
/// Patches from straight down to straight up, evenly in the cosine.
pub(crate) const HEIGHTS: usize = 12;

/// Approaches by direction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coverage {
    /// 12 rows, starting at straight down, of 24 patches each, from the workspace's +x towards +y.
    pub patches: Vec<Tally>,
}

impl Default for Coverage {
    fn default() -> Self {
        Self { patches: vec![Tally::default(); AZIMUTHS * HEIGHTS] }
    }
}

impl Coverage {
    pub(crate) fn count(&mut self, attempt: &AttemptRecord) {
        let towards = attempt.workspace_from_grasp.rotation * Vec3::Z;
        let height = 0.5 * f64::from(1.0 + towards.z.clamp(-1.0, 1.0));
        let turn = libm::atan2(f64::from(towards.y), f64::from(towards.x)) / core::f64::consts::TAU;
        let azimuth = bin(turn.rem_euclid(1.0) * AZIMUTHS as f64, AZIMUTHS);
        self.patches[bin(height * HEIGHTS as f64, HEIGHTS) * AZIMUTHS + azimuth].count(attempt);
    }

    /// Share of the sphere with attempts.
    pub(crate) fn tried(&self) -> f64 {
        self.share(|patch| patch.attempts > 0)
    }

    /// Share of the sphere with held attempts.
    pub(crate) fn held(&self) -> f64 {
        self.share(|patch| patch.positives > 0)
    }

    fn share(&self, counts: impl Fn(&Tally) -> bool) -> f64 {
        self.patches.iter().filter(|patch| counts(patch)).count() as f64 / self.patches.len() as f64
    }
}
