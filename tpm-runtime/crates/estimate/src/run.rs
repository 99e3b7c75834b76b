//! A run of a campaign as estimators see it: what was played, and the harmonics of what was recorded.

use crate::result::Estimate;
use crate::settings::Settings;
use num_complex::Complex;
use std::borrow::Cow;
use std::fmt::Debug;
use tpm_controller::harmonics::Hold;
use tpm_motion::trajectory::{HarmonicSeries, Trajectory};
use tpm_motion::{Spectra, Trial};
use tpm_numerics::alarm;

/// One run as an estimator sees it.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// What was played.
    pub trial: &'a Trial,
    /// Spectra of the coordinates, then the inputs, over whole periods that start at phase zero.
    pub spectra: &'a Spectra,
    /// Spectra in which every measured rate, integrated, stands in place of its coordinate, whose mean a rate does not show;
    /// nothing when no rate was measured.
    pub rates: Option<&'a Spectra>,
    /// How the recorded inputs became forces.
    pub hold: Hold,
    /// What the samples of the run say, where they say more than its harmonics.
    pub alone: Option<&'a dyn Alone>,
}

/// A run by itself, in all its samples.
///
/// The harmonics of a force that jumps are biased where noise moves the instants of the jumps, by more than the noise model of the
/// harmonics tells. Estimates of single runs would then contradict each other although the machine is one.
pub trait Alone: Debug {
    /// What the run says by itself, beginning with the estimate of its harmonics; nothing where its samples say no more than that.
    fn refined(&self, estimate: &Estimate) -> Option<OwnEstimate>;
}

/// What one run says by itself.
#[derive(Clone, Debug)]
pub struct OwnEstimate {
    /// The estimate.
    pub estimate: Estimate,
    /// Number of residuals that the run has beyond its parameters.
    pub residuals: usize,
}

impl Run<'_> {
    /// The motion that tells which parameters the run can show: the reference, in which errors of the tracking show nothing.
    ///
    /// Estimates of zero leave open coordinates at rest in the reference, while the machine moves them. The measured motion of all
    /// coordinates is then taken: rows without an input hold along a motion as a whole, not along a mixture of two.
    pub(super) fn judged_motion(&self) -> Cow<'_, Trajectory> {
        let reference = &self.trial.trajectory;
        let rests = |&c: &usize| reference.coordinates[c].highest_harmonic() == 0;
        let measured = self.spectra.lines.len() >= reference.coordinates.len();
        if !(measured && self.trial.open.iter().any(rests)) {
            return Cow::Borrowed(reference);
        }
        let reach = reach(reference).max(1);
        let series = |c: usize| {
            let certain = |k: usize, z: &Complex<f64>| {
                k <= reach && z.norm_sqr() > alarm::MEASURED_LINE * self.spectra.noise[k][(c, c)].re
            };
            HarmonicSeries::from_phasors(&self.spectra.lines[c], certain)
        };
        let coordinates = (0..reference.coordinates.len()).map(series).collect();
        Cow::Owned(Trajectory { frequency: self.spectra.fundamental, coordinates })
    }

    /// The highest harmonic to use: as asked, or that of the experiment, as far as the record resolves it.
    pub(super) fn highest_harmonic(&self, settings: &Settings) -> usize {
        settings.harmonics.unwrap_or(reach(&self.trial.trajectory)).min(self.spectra.highest()).max(1)
    }
}

/// The highest harmonic that belongs to an experiment with this motion: four times that of the motion.
pub(super) fn reach(motion: &Trajectory) -> usize {
    4 * motion.highest_harmonic() as usize
}

/// Phasors 0 to `highest` of the tracking error of every coordinate: measured minus reference.
pub fn error_lines(trial: &Trial, spectra: &Spectra, coordinates: usize, highest: usize) -> Vec<Vec<Complex<f64>>> {
    (0..coordinates)
        .map(|c| {
            let mut lines: Vec<Complex<f64>> = spectra.lines[c].iter().take(highest + 1).copied().collect();
            if let Some(series) = trial.trajectory.coordinates.get(c) {
                if let Some(mean) = lines.first_mut() {
                    *mean -= series.mean;
                }
                for line in &series.lines {
                    if let Some(present) = lines.get_mut(line.harmonic as usize) {
                        *present -= Complex::new(line.cos, -line.sin);
                    }
                }
            }
            lines
        })
        .collect()
}
