//! What a refinement by output error did with a log or a campaign.

use crate::excerpt::Excerpt;
use serde::{Serialize, Serializer};
use std::fmt;
use tpm_controller::model::Model;
use tpm_estimate::{Explained, Outcome, OutputErrorFault, RateFault, RateUse, Term, TermKind};
use tpm_report::number;

/// What the refinement did with a log or a campaign.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RefinementReport {
    /// Whether its values are those of the result.
    pub used: bool,
    /// Why they are not, or what else there is to say.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<NotRefined>,
    /// Samples that were simulated.
    pub samples: usize,
    /// Stretches of the log of which each simulated one is the mean.
    pub averaged: usize,
    /// Blocks of the log that were simulated while the rest was not; zero where all of it, means or its last periods were.
    #[serde(skip_serializing_if = "none")]
    pub blocks: usize,
    /// Runs of a campaign whose ends were simulated; zero for a log.
    #[serde(skip_serializing_if = "none")]
    pub runs: usize,
    /// Samples of the log, or of its whole periods, of which these are the mean or a part.
    pub of: usize,
    /// Gauss-Newton steps.
    pub steps: usize,
    /// Standard deviation of every sensor's noise, unit of the coordinate.
    pub sensor_noise: Vec<f64>,
    /// Standard deviation of every recorded input's noise, unit of the input; zero for an exact record.
    pub input_noise: Vec<f64>,
    /// The force that noise is taken to make in every row, root mean square as a share of the row's force; where one likelihood weighed it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub force_left: Vec<f64>,
    /// The ways in which that likelihood explained the log, and how much less likely each is than the one that is handed out.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ways: Vec<Explained>,
    /// What that likelihood came to; nothing where it weighed nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outcome: Option<Outcome>,
    /// Measured rates, where there are any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rates: Vec<RateReport>,
    /// Root mean square of measured less simulated motion, unit of the coordinate.
    pub residual: Vec<f64>,
    /// Values before the refinement, by parameter.
    pub before: Vec<f64>,
    /// Terms whose lack the residual shows.
    pub missing: Vec<MissingTerm>,
}

/// What a measured rate was to the refinement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RateReport {
    /// The coordinate.
    pub coordinate: String,
    /// Whether its readings were used: they are the rate of the motion but for white noise.
    pub used: bool,
    /// Standard deviation of their noise, unit of the coordinate per second; nothing where they were not compared with the motion.
    pub noise: Option<f64>,
    /// Why they were not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

impl RateReport {
    /// What a rate was to a fit.
    pub(super) fn of(model: &dyn Model<f64>, found: &RateUse) -> Self {
        let why = found.fault.map(|fault| match fault {
            RateFault::Gain(gain) => format!("it is {} times the rate of the measured position", number(gain)),
            RateFault::Late(late) if late < 0.0 => {
                format!("it comes {} ms before the motion", number(-1e3 * late))
            }
            RateFault::Late(late) => format!("it comes {} ms after the motion", number(1e3 * late)),
            RateFault::Offset(offset) => format!("it is off by {}", number(offset)),
            RateFault::Coloured(by) => {
                format!("its errors are correlated by {} from sample to sample", number(by))
            }
            _ => "the simulation found no motion with which it could be compared".into(),
        });
        RateReport {
            coordinate: model.coordinate(found.coordinate).name.into(),
            used: why.is_none(),
            noise: found.noise,
            why,
        }
    }
}

/// A term that would take what a model leaves unexplained.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MissingTerm {
    /// Which term it is, by the model's indices.
    #[serde(skip)]
    pub of: Term,
    /// The term, in the words of the model.
    pub term: String,
    /// The row on which it acts; nothing for one that acts on a reading.
    pub row: Option<String>,
    /// Its factor, in the units of row and term.
    pub value: f64,
    /// Standard deviation of the factor.
    pub std: f64,
    /// Share of the unexplained sum of squares that it takes.
    pub gain: f64,
    /// What the term would mean.
    pub meaning: String,
}

// What serde calls takes a reference.
#[allow(clippy::trivially_copy_pass_by_ref)]
const fn none(count: &usize) -> bool {
    *count == 0
}

/// A step of a simulation that would take longer than what is spent without being asked for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LongSimulation {
    /// Floating-point operations of one step.
    pub work: f64,
    /// The most that are spent without being asked for.
    pub most: f64,
}

impl fmt::Display for LongSimulation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let LongSimulation { work, most } = self;
        write!(
            f,
            "the estimates are not refined by simulating the model sample by sample: a step of that takes {work:.1e} operations, more than the {most:.1e} that are spent without being asked for"
        )
    }
}

/// Why the values of a result are not those of a refinement; serialises as its text.
#[derive(Clone, Debug, PartialEq)]
pub enum NotRefined {
    /// A step of the simulation would take long.
    LongSimulation(LongSimulation),
    /// The simulation was begun, and came to nothing.
    Fault(OutputErrorFault),
    /// The simulation settles only with a term that the model lacks.
    WithoutTerm,
    /// The machine is one that is simulated only where that is asked for.
    NotAsked,
    /// The simulation needs forces that the model lacks.
    Lacks,
    /// A delay or an error of a reading is found with the parameters, which the simulation takes as known.
    OfChannel,
    /// A nonlinear parameter goes on moving.
    Moving {
        /// The nonlinear parameter.
        parameter: String,
    },
}

impl NotRefined {
    /// Whether the simulation was begun, and its time was over.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        *self == NotRefined::Fault(OutputErrorFault::Ended)
    }
}

impl fmt::Display for NotRefined {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NotRefined::LongSimulation(long) => long.fmt(f),
            NotRefined::Fault(fault) => write!(f, "not refined by a simulation: {fault}"),
            NotRefined::WithoutTerm => f.write_str(
                "the simulation does not settle on parameters without the term that is missing; those of the harmonics are widened by how far it moves them",
            ),
            NotRefined::NotAsked => f.write_str(
                "not refined by a simulation: a machine of more than two coordinates with an input in every row, or of more than four, is simulated where that is asked for",
            ),
            NotRefined::Lacks => f.write_str(
                "not refined by a simulation: it needs forces that the model lacks, and says no more of the parameters than the lines of the rows beside the terms that they name",
            ),
            NotRefined::OfChannel => f.write_str(
                "not refined by a simulation: it takes delays and errors of readings as known, and one is found with the parameters",
            ),
            NotRefined::Moving { parameter } => write!(f, "{parameter} does not settle on a value"),
        }
    }
}

impl Serialize for NotRefined {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl RefinementReport {
    /// Whether a limit of an input is known to it, which stands before all other terms.
    pub(super) fn is_limited(&self) -> bool {
        self.missing.first().is_some_and(|term| term.of.kind == TermKind::Limit)
    }

    /// Whether no parameters were found with which the model follows the record.
    pub(super) const fn is_unsettled(&self) -> bool {
        matches!(self.note, Some(NotRefined::Fault(OutputErrorFault::NotConverged { .. })))
    }

    /// Whether whoever waits for the result did not wait for the simulation.
    pub(super) fn was_ended(&self) -> bool {
        self.note.as_ref().is_some_and(NotRefined::is_cut)
    }

    /// A refinement from given values by an excerpt of a record, before anything is known of it.
    pub(super) fn of(values: &[f64], excerpt: &Excerpt<'_>) -> Self {
        RefinementReport {
            used: true,
            samples: excerpt.samples(),
            averaged: excerpt.averaged,
            blocks: excerpt.blocks,
            of: excerpt.of,
            ..Self::refused(values, &OutputErrorFault::NotSimulable)
        }
    }

    /// A refinement that was not begun.
    pub(super) fn left_out(values: &[f64], why: NotRefined) -> Self {
        RefinementReport { note: Some(why), ..Self::refused(values, &OutputErrorFault::NotSimulable) }
    }

    /// A refinement that came to nothing.
    pub(super) fn refused(values: &[f64], fault: &OutputErrorFault) -> Self {
        let note = match fault {
            OutputErrorFault::NotSimulable => None,
            fault => Some(NotRefined::Fault(fault.clone())),
        };
        RefinementReport {
            used: false,
            note,
            samples: 0,
            averaged: 1,
            blocks: 0,
            runs: 0,
            of: 0,
            steps: 0,
            sensor_noise: Vec::new(),
            input_noise: Vec::new(),
            force_left: Vec::new(),
            ways: Vec::new(),
            outcome: None,
            rates: Vec::new(),
            residual: Vec::new(),
            before: values.to_vec(),
            missing: Vec::new(),
        }
    }
}
