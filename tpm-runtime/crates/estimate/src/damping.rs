//! How far the parameters of the next run go towards an estimate (a trust region along the update).
//!
//! An update is linearised: it foresees a run without tracking error. The next run on the same reference shows whether that holds.
//! Invariant: where a run tracks worse than the best one on its reference, the next run goes on from the parameters of that best run with
//! half the step; every run that tracks better doubles the step, up to the whole update.

use tpm_motion::Trial;
use tpm_motion::trajectory::Trajectory;

/// The smallest share of an update that is played.
const LEAST_PLAYED_SHARE: f64 = 1.0 / 64.0;

/// What is known of the runs on the present reference.
pub(super) struct Damping {
    best: Option<Best>,
    /// Share of an update that the next run goes.
    share: f64,
}

/// The run that tracked best on the present reference.
struct Best {
    reference: Trajectory,
    /// Coordinates whose reference follows from the parameters.
    open: Vec<usize>,
    /// Parameters of its feed-forward.
    parameters: Vec<f64>,
    /// Sum of squares of its tracking error.
    size: f64,
}

impl Default for Damping {
    fn default() -> Self {
        Damping { best: None, share: 1.0 }
    }
}

impl Damping {
    /// Judges a run by the sum of squares of its tracking error, and says whether it is the best so far; errors up to `noise` are
    /// noise.
    pub(super) fn judge(&mut self, trial: &Trial, size: f64, noise: f64) -> bool {
        if let Some(best) = self.best.as_ref().filter(|best| best.is_of(trial)) {
            if size > best.size.max(noise) {
                self.take_back();
                return false;
            }
            self.share = (2.0 * self.share).min(1.0);
        }
        self.best = Some(Best {
            reference: trial.trajectory.clone(),
            open: trial.open.clone(),
            parameters: trial.parameters.clone(),
            size,
        });
        true
    }

    /// Halves the step; says whether there is a run to go back to and a step left.
    pub(super) fn take_back(&mut self) -> bool {
        let possible = self.best.is_some() && self.share > LEAST_PLAYED_SHARE;
        if possible {
            self.share *= 0.5;
        }
        possible
    }

    /// Whether the step cannot be halved again.
    pub(super) fn is_exhausted(&self) -> bool {
        self.share <= LEAST_PLAYED_SHARE
    }

    /// Whether the next run goes less than the whole update.
    pub(super) fn is_damped(&self) -> bool {
        self.share < 1.0
    }

    /// The parameters of the next run on the way to an estimate.
    pub(super) fn towards(&self, estimate: &[f64]) -> Vec<f64> {
        match &self.best {
            Some(best) if self.is_damped() => {
                let along = |(from, to): (&f64, &f64)| from + self.share * (to - from);
                best.parameters.iter().zip(estimate).map(along).collect()
            }
            _ => estimate.to_vec(),
        }
    }
}

impl Best {
    fn is_of(&self, trial: &Trial) -> bool {
        self.open == trial.open && self.reference.prescribes_as(&trial.trajectory, &self.open)
    }
}
