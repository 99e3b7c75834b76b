//! What a campaign starts from: stages, schedule, limits, estimator.

use tpm_controller::harmonics::Hold;
use tpm_estimate::{Method, Settings};
use tpm_motion::Loop;
use tpm_motion::stroke::{Stroke, repeated};
use tpm_motion::trajectory::{ReferencePattern, Trajectory};
use tpm_plant::actuator::{Limited, Mounted};

/// Fewest whole periods that a run measures. The estimate of the noise between the harmonics needs several periods.
pub const LEAST_PERIODS: usize = 4;

/// One amplitude and frequency of the schedule.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// Pattern of the stage; nothing when the stage plays the campaign's pattern.
    pub pattern: Option<ReferencePattern>,
    /// Amplitudes, in the order of the pattern.
    pub amplitudes: Vec<f64>,
    /// Requested fundamental angular frequency, rad/s.
    pub frequency: f64,
    /// Multiple of the frequency at which each coordinate plays its pattern; one for all when empty.
    pub multiples: Vec<u32>,
    /// Factor on all gains of the feedback.
    pub gain: f64,
    /// Strokes that are played one after the other; the pattern itself, over and over, when empty.
    pub strokes: Vec<StageStroke>,
}

/// One stroke of a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct StageStroke {
    /// Pattern of the stroke with the amplitudes of the stage; the pattern of the stage where none is given.
    pub pattern: Option<ReferencePattern>,
    /// Phases of the pattern between which it is played, rad.
    pub phases: (f64, f64),
    /// Rest after the stroke, s.
    pub dwell: f64,
}

impl Stage {
    /// The stage's own pattern, or the pattern of the campaign where the stage has none.
    #[must_use]
    pub fn pattern<'p>(&'p self, campaign: &'p ReferencePattern) -> &'p ReferencePattern {
        self.pattern.as_ref().unwrap_or(campaign)
    }

    /// The reference of the stage with its amplitudes times `scale`. A stage without a pattern of its own plays the
    /// pattern of the campaign. The frequency is that of the repetition of the whole reference, rests included.
    #[must_use]
    pub fn trajectory(&self, campaign: &ReferencePattern, scale: f64) -> Trajectory {
        if self.strokes.is_empty() {
            return self.along(self.pattern(campaign), scale);
        }
        repeated(&self.played_strokes(campaign, scale))
    }

    /// The strokes of the stage with its amplitudes times `scale`.
    #[must_use]
    pub fn played_strokes(&self, campaign: &ReferencePattern, scale: f64) -> Vec<Stroke> {
        let stroke = |stroke: &StageStroke| {
            let pattern = stroke.pattern.as_ref().unwrap_or_else(|| self.pattern(campaign));
            Stroke { trajectory: self.along(pattern, scale), phases: stroke.phases, dwell: stroke.dwell }
        };
        self.strokes.iter().map(stroke).collect()
    }

    /// Whether the motion rests between strokes.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.strokes.iter().any(|stroke| stroke.dwell > 0.0)
    }

    /// The trajectory of a pattern with the amplitudes of the stage times `scale`, at the stage's frequency and
    /// multiples.
    fn along(&self, pattern: &ReferencePattern, scale: f64) -> Trajectory {
        let amplitudes: Vec<f64> = self.amplitudes.iter().map(|a| a * scale).collect();
        let mut trajectory = pattern.trajectory(&amplitudes, self.frequency);
        for (series, &multiple) in trajectory.coordinates.iter_mut().zip(&self.multiples) {
            for line in &mut series.lines {
                line.harmonic *= multiple;
            }
        }
        trajectory
    }
}

/// Schedule, limits and stopping rules of a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Procedure {
    /// The stages, in the order in which they are played, usually with growing amplitudes and frequencies.
    pub stages: Vec<Stage>,
    /// Fewest periods that are played before the measurement begins.
    pub settle_periods: usize,
    /// Time that is measured in every run, s; rounded up to whole periods, at least [`LEAST_PERIODS`].
    pub measure_time: f64,
    /// Most updates in one stage.
    pub updates_per_stage: usize,
    /// Most runs in the whole campaign.
    pub max_runs: usize,
    /// Relative change of every parameter below which a stage is finished. A change within the noise of the estimate
    /// also counts as no change.
    pub tolerance: f64,
    /// A stage is also finished when no harmonic of the tracking error exceeds the limit of its coordinate, unit of the
    /// coordinate; a limit of zero or less is not tested.
    pub error_limits: Vec<f64>,
    /// Largest tracking error per coordinate; a run that passes it is aborted.
    pub tracking_bounds: Vec<f64>,
    /// Largest magnitude of each input; infinite for an input without a limit.
    pub input_limits: Vec<f64>,
    /// Least and largest position per coordinate, beyond which a run is aborted; coordinates past the end of the list
    /// are unbounded.
    pub position_bounds: Vec<(f64, f64)>,
    /// Largest magnitude of the velocity per coordinate, beyond which a run is aborted; coordinates past the end of the
    /// list are unbounded.
    pub velocity_bounds: Vec<f64>,
    /// Largest magnitude of the acceleration per coordinate that a reference may have; coordinates past the end of the list are unbounded.
    pub acceleration_bounds: Vec<f64>,
    /// Motor of each input, whose limits are tested in addition to the limit of the input; empty when there is no
    /// motor.
    pub motors: Vec<Option<Mounted>>,
    /// Limits of the actuator of each input, of whatever kind it is; empty when there are none.
    pub limited: Vec<Option<Limited>>,
    /// Share of an input's limit at which the campaign ends.
    pub effort_share: f64,
    /// Factor on the amplitudes after an aborted run.
    pub back_off: f64,
    /// Most aborted runs in succession.
    pub max_aborts: usize,
    /// Behaviour of the recorded inputs between samples, such as a zero-order hold.
    pub hold: Hold,
    /// Whether a run with a harmonic near a natural mode of the estimated model is played at a lower frequency, down to
    /// three quarters of the stage's. When no lower frequency is free of modes, the stage is played at its own.
    pub avoid_modes: bool,
    /// Chooses every stage behind the first from what the runs before it showed; without it the stages are played as they are listed.
    pub plan: Option<Plan>,
}

/// Everything that a campaign starts from.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// Pattern of the reference.
    pub pattern: ReferencePattern,
    /// Constants of the model.
    pub constants: Vec<f64>,
    /// Estimates before the first run; zero for parameters without a stated prior.
    pub prior: Vec<f64>,
    /// Whether a prior of each parameter was stated; parameters beyond the end of the list count as stated.
    pub stated: Vec<bool>,
    /// Feedback and sampling.
    pub control: Loop,
    /// The schedule.
    pub procedure: Procedure,
    /// The estimator.
    pub method: Method,
    /// Settings of the estimator.
    pub estimation: Settings,
}

impl Setup {
    /// The stated priors by parameter; nothing for a parameter without one.
    #[must_use]
    pub fn stated_prior(&self) -> Vec<Option<f64>> {
        let stated = |(j, value): (usize, &f64)| self.stated.get(j).copied().unwrap_or(true).then_some(*value);
        self.prior.iter().enumerate().map(stated).collect()
    }
}

/// How a campaign chooses its stages by itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Time for which the machine may move, s.
    pub time: f64,
    /// Standard deviation that is wanted of each parameter, as a share of its value; nothing where none is, and past the end of the list.
    pub goals: Vec<Option<f64>>,
}
