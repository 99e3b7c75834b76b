//! What a user should know beside the numbers of a result.

use crate::log_report::{Calibration, HoldResiduals, UnseenFaultReport};
use crate::refinement_report::{LongSimulation, MissingTerm, NotRefined};
use serde::Serialize;
use std::fmt;
use tpm_campaign::{NearMode, Outcome};
use tpm_controller::harmonics::Hold;
use tpm_estimate::{CommonFactor, PhysicalRemark, ResidualOf};
use tpm_log::Repeated;
use tpm_motion::RunEnding;
use tpm_plant::actuator::LimitUse;
use tpm_report::{Remedy, digits, displayed, listed, number, plus_minus};

/// Significant digits of a term that a model lacks, which a few logs hardly show better.
const TERM_DIGITS: usize = 3;
/// The other hold explains a log clearly better when it leaves less than this share of the residual.
const CLEARLY_BETTER: f64 = 0.7;

/// Which data a statement is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Data {
    /// One log.
    Log,
    /// Several logs.
    Logs,
    /// The runs of a campaign.
    Runs,
}

impl fmt::Display for Data {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Data::Log => "this log",
            Data::Logs => "these logs",
            Data::Runs => "these runs",
        })
    }
}

/// Readings that stand for others.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "of", rename_all = "snake_case")]
pub enum Exchange {
    /// Those of two signals: a coordinate and an input, two coordinates, or two inputs.
    Columns {
        /// Their names.
        signals: Vec<String>,
    },
    /// Those of two joints, of the coordinates and of the inputs.
    Joints {
        /// Names of the coordinates.
        coordinates: [String; 2],
        /// Names of the inputs.
        inputs: [String; 2],
    },
    /// Those of one signal have the other sign.
    Sign {
        /// Its name.
        signal: String,
    },
}

/// A warning of a result. Its text names no front end's options; [`remedy`](Self::remedy) says which setting would help.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Warning {
    /// Another assumption about the inputs between samples leaves a clearly smaller residual.
    OtherHold {
        /// The hold that was assumed.
        #[serde(serialize_with = "displayed")]
        stated: Hold,
        /// Share that it leaves unexplained.
        left: f64,
        /// The hold that explains the log better.
        #[serde(serialize_with = "displayed")]
        better: Hold,
        /// Share that the better hold leaves unexplained.
        left_by_better: f64,
        /// What they are shares of.
        #[serde(skip_serializing_if = "ResidualOf::is_force")]
        of: ResidualOf,
    },
    /// An input seems late by about half a sample, and is not with another assumption about the inputs between samples.
    LateByHold {
        /// The input.
        input: String,
        /// By how much it seems late, s.
        late: f64,
        /// The hold with which it is not.
        #[serde(serialize_with = "displayed")]
        better: Hold,
    },
    /// The model explains the log with other columns, or with other signs, and not as they are.
    Exchanged {
        /// What is exchanged.
        exchange: Exchange,
        /// Share of the force that is left unexplained as the readings are.
        left: f64,
        /// Share of the force that is left unexplained when this is undone.
        left_by_exchange: f64,
    },
    /// One sample ahead the model with the values that were found misses a coordinate by more than the last reading does.
    Astray {
        /// The coordinate.
        coordinate: String,
        /// Its unit.
        unit: Option<String>,
        /// Root mean square of what the model misses one sample ahead, unit of the coordinate.
        missed: f64,
        /// Root mean square of a reading less the one before, unit of the coordinate.
        last_reading: f64,
    },
    /// What a simulation between the stamps leaves is far more than the noise that the readings show by themselves.
    BeyondNoise {
        /// What is read.
        signal: String,
        /// Deviation of what is left, unit of the signal.
        left: f64,
        /// Deviation of the noise that the readings show, unit of the signal.
        noise: f64,
    },
    /// Inputs are multiples of what is recorded, and nothing says which of them are right.
    ScaleUnknown {
        /// The inputs of the model.
        inputs: Vec<String>,
    },
    /// Faults of sensors that would move parameters, and that the log would not show for certain.
    UnseenFaults {
        /// The faults.
        faults: Vec<UnseenFaultReport>,
    },
    /// The estimates are not refined by a simulation, because that would take long.
    LongSimulation(LongSimulation),
    /// The log holds one whole period only.
    OnePeriod,
    /// A period was stated, and the record is used in the time domain, where it does not count.
    PeriodNotUsed {
        /// The stated period, s.
        period: f64,
        /// Stretches of the record.
        stretches: usize,
    },
    /// Coordinates that the model eliminates stand in the log, and were used.
    AllCoordinates {
        /// Their names.
        coordinates: Vec<String>,
    },
    /// Readings of a coordinate repeat the one before, and were replaced by what the fresh ones around them say.
    RepeatedReadings {
        /// The coordinate, and how many.
        #[serde(flatten)]
        repeated: Repeated,
    },
    /// Single readings of a coordinate were far from their neighbours, and were replaced by what these say.
    LoneReadings {
        /// The coordinate.
        coordinate: String,
        /// How many.
        count: usize,
        /// Line of the first, from 1.
        line: u64,
        /// Largest distance of a reading from what its neighbours say, unit of the coordinate.
        farthest: f64,
        /// Unit of the coordinate.
        unit: Option<String>,
    },
    /// The sensors of a log show only a combination of parameters, whatever the motion is.
    OnlyTogether {
        /// The parameters.
        parameters: Vec<String>,
    },
    /// A measured rate is not the rate of the measured position.
    RateDiffers {
        /// The coordinate.
        coordinate: String,
        /// Measured rate over the rate of the measured position.
        gain: f64,
    },
    /// Something about one of several logs.
    InLog {
        /// The log.
        path: String,
        /// What is to be said of it.
        warning: Box<Warning>,
    },
    /// A log contradicts the other logs.
    LogsDisagree {
        /// The log.
        path: String,
        /// The parameter that differs most.
        parameter: String,
        /// By how many deviations of the difference it differs from the other logs together.
        deviations: f64,
    },
    /// A log contradicts a majority of logs that agree with each other, and is left out of the result.
    OddLog {
        /// The log.
        path: String,
        /// The parameter that differs most.
        parameter: String,
        /// By how many deviations of the difference it differs from the logs that agree.
        deviations: f64,
        /// The one factor between all that the log tells and what the others tell, where one factor explains the whole difference.
        factor: Option<CommonFactor>,
    },
    /// The last two periods of a log differ.
    Unsteady {
        /// Root mean square of their difference, as a share of the motion.
        mismatch: f64,
    },
    /// More than half of a log does not repeat with the period of its end.
    MostlyLeftOut {
        /// Samples at the start that are left out.
        left_out: usize,
        /// Samples of the log.
        samples: usize,
    },
    /// Harmonics are excited that the model does not explain as it does the lower ones; they are not used.
    HarmonicsLeftOut {
        /// The lowest of them.
        from: usize,
        /// The highest of them.
        to: usize,
    },
    /// The model leaves a large part of the force unexplained.
    Unexplained {
        /// Root mean square of the residual, as a share.
        residual: f64,
        /// What it is a share of.
        #[serde(skip_serializing_if = "ResidualOf::is_force")]
        of: ResidualOf,
    },
    /// A parameter takes no part in what the data show.
    NotVisible {
        /// The parameter.
        parameter: String,
        /// The data.
        data: Data,
    },
    /// A parameter's standard deviation is of the size of its value.
    PoorlyDetermined {
        /// The parameter.
        parameter: String,
        /// Its value, in its unit.
        value: f64,
        /// Its standard deviation, in its unit.
        std: f64,
    },
    /// The data show these parameters only in combinations with each other.
    OnlyInCombinations {
        /// The parameters.
        parameters: Vec<String>,
        /// The data.
        data: Data,
    },
    /// A mass or a moment of inertia came out negative.
    NegativeInertia {
        /// The parameter.
        parameter: String,
        /// Its value, in its unit.
        value: f64,
    },
    /// Masses and moments of the bodies of a mechanism are all the same multiple of their priors: another unit of the inputs.
    CommonFactor {
        /// The inputs of the model.
        inputs: Vec<String>,
        /// Identified values over priors.
        factor: f64,
        /// Its standard deviation, where every prior is off by a fifth.
        std: f64,
        /// Values that tell it.
        count: usize,
    },
    /// The gain of an input came out negative, so that the machine goes against it.
    GoesAgainst {
        /// The parameter.
        parameter: String,
        /// Its value, in its unit.
        value: f64,
        /// Its standard deviation.
        std: f64,
    },
    /// A parameter of damping or dry friction came out negative, so that its term gives energy to the machine.
    GivesEnergy {
        /// The parameter.
        parameter: String,
        /// Its value, in its unit.
        value: f64,
        /// Its standard deviation.
        std: f64,
    },
    /// A run ended before all of its samples were used, or had to be played again.
    Run {
        /// Number of the run, from 1.
        run: usize,
        /// How it ended.
        ending: RunEnding,
        /// Whether the campaign goes on after the run.
        goes_on: bool,
    },
    /// A run differs from the runs that are pooled by more than chance, and is left out of the result.
    Contradicts {
        /// Number of the run, from 1.
        run: usize,
        /// The parameter that differs most.
        parameter: String,
        /// Its difference, in standard deviations of the difference.
        deviations: f64,
        /// Numbers of the runs that are pooled.
        pooled: Vec<usize>,
        /// Whether the runs that are pooled are more than those that are not.
        majority: bool,
    },
    /// A harmonic that was played lies near a natural frequency of the machine.
    NearMode {
        /// Number of the run, from 1.
        run: usize,
        /// Fundamental frequency of the run, rad/s.
        fundamental: f64,
        /// The harmonic and the mode.
        mode: NearMode,
    },
    /// The campaign ended before it had done what its schedule asks.
    EndedEarly {
        /// Why.
        outcome: Outcome,
        /// The limit that ended it, when one did.
        limit: Option<LimitUse>,
    },
    /// An identified inertia contains that of a motor's rotor.
    RotorIncluded {
        /// The coordinate whose inertia it is.
        coordinate: String,
        /// The input that the motor drives.
        input: String,
        /// The rotor's inertia, seen from the coordinate, in the unit of the coordinate's inertia.
        inertia: f64,
    },
    /// No run of a campaign could be used.
    NothingAccepted,
    /// The residual shows that the model lacks a term.
    MissingTerm {
        /// The term, its size and what it would mean.
        #[serde(flatten)]
        term: MissingTerm,
    },
    /// The halves of a log contradict each other.
    Halves {
        /// The parameter.
        parameter: String,
        /// By how much its value in the second half is larger, in its unit.
        moved: f64,
        /// Widened standard deviation of that difference.
        deviation: f64,
    },
    /// No parameters of the model make it follow the record sample by sample.
    Unsettled {
        /// How the simulation went.
        #[serde(rename = "message")]
        reason: NotRefined,
    },
    /// The updates of a linearised estimator ended further from where it was linearised than their deviations allow.
    FarFromLinear {
        /// The estimator.
        estimator: &'static str,
    },
    /// An input was cut off at a limit behind the place where it was recorded.
    Limited {
        /// The limit.
        #[serde(flatten)]
        term: MissingTerm,
    },
    /// What the model leaves unexplained, beside terms that are named, repeats with the motion.
    Repeats {
        /// Power at the harmonics of the motion, in units of that of the noise.
        power: f64,
        /// Whether terms are named beside which it is left.
        beside_terms: bool,
    },
    /// The machine vibrates at a frequency at which the model does not.
    Vibration {
        /// The frequency, Hz.
        frequency: f64,
    },
    /// The data ask for a value of a nonlinear parameter beyond an end of its interval, at which it is held.
    EndOfInterval {
        /// The parameter.
        parameter: String,
        /// That end, in its unit.
        end: f64,
        /// Its interval.
        interval: [f64; 2],
    },
    /// Several values of the nonlinear parameters explain the data nearly alike.
    SeveralMinima {
        /// A parameter in which they differ.
        parameter: String,
        /// The value that explains the data best, in its unit.
        value: f64,
        /// Another value, in its unit.
        other: f64,
        /// What the other value leaves unexplained, in units of what the best one does.
        left: f64,
    },
    /// Runs do not identify a nonlinear parameter: its value is that of the experiment.
    TakenAsKnown {
        /// The parameter.
        parameter: String,
        /// Its value, in its unit.
        value: f64,
    },
    /// The values are not those of a refinement.
    NotRefined {
        /// Why.
        #[serde(rename = "message")]
        reason: NotRefined,
    },
    /// A refinement was asked for, and the values are not those of one.
    AskedInVain {
        /// Why.
        #[serde(rename = "message")]
        reason: NotRefined,
    },
    /// What the map from lumped to physical parameters shows.
    Physical {
        /// What it shows.
        #[serde(rename = "message", serialize_with = "displayed")]
        remark: PhysicalRemark,
    },
}

impl Warning {
    /// Says that the other hold than the stated one explains a log clearly better; `of` is what the residuals are shares of.
    pub(super) fn other_hold(stated: Hold, residuals: HoldResiduals, of: ResidualOf) -> Option<Self> {
        let better = stated.other();
        let (left, left_by_better) = (residuals.with(stated)?, residuals.with(better)?);
        let clearly = left_by_better < CLEARLY_BETTER * left;
        clearly.then_some(Warning::OtherHold { stated, left, better, left_by_better, of })
    }

    /// The setting that would remove the warning, when there is one.
    #[must_use]
    pub fn remedy(&self) -> Option<Remedy> {
        match self {
            Warning::InLog { warning, .. } => warning.remedy(),
            Warning::OtherHold { better, .. } | Warning::LateByHold { better, .. } => {
                Some(Remedy::Hold { hold: *better })
            }
            Warning::Exchanged { exchange: Exchange::Columns { signals }, .. } => {
                Some(Remedy::MapColumns { signals: signals.clone() })
            }
            Warning::PeriodNotUsed { .. } => Some(Remedy::HarmonicsOfOneStretch),
            Warning::MostlyLeftOut { .. } => Some(Remedy::FromSample),
            Warning::LongSimulation(_) => Some(Remedy::Simulation),
            Warning::NotRefined { reason } if reason.is_cut() => Some(Remedy::Simulation),
            Warning::HarmonicsLeftOut { to, .. } => Some(Remedy::Harmonics { highest: *to }),
            Warning::CommonFactor { inputs, .. } => Some(Remedy::Scales { signals: inputs.clone() }),
            Warning::UnseenFaults { faults } => {
                let of_sensor =
                    |own: &&UnseenFaultReport| matches!(own.quantity, Calibration::Gain | Calibration::Zero);
                let signals: Vec<String> = faults.iter().filter(of_sensor).map(|own| own.signal.clone()).collect();
                (!signals.is_empty()).then_some(Remedy::Calibration { signals })
            }
            _ => None,
        }
    }
}

impl fmt::Display for Exchange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Exchange::Columns { signals } => {
                write!(f, "the readings of {} seem to be exchanged", signals.join(" and "))
            }
            Exchange::Joints { coordinates, inputs } => write!(
                f,
                "the readings of {} and {}, and of {} and {}, seem to be exchanged",
                coordinates[0], coordinates[1], inputs[0], inputs[1]
            ),
            Exchange::Sign { signal } => write!(f, "the readings of {signal} seem to have the other sign"),
        }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Warning::OtherHold { stated, left, better, left_by_better, of } => write!(
                f,
                "hold {better} explains the log clearly better: it leaves {:.3} % of {of}, hold {stated} leaves {:.3} %",
                100.0 * left_by_better,
                100.0 * left
            ),
            Warning::LateByHold { input, late, better } => write!(
                f,
                "with hold {better} {input} is not late: {:.3} ms are about half a sample, by which a value that is held acts later than one that is not",
                1e3 * late
            ),
            Warning::Exchanged { exchange, left, left_by_exchange } => write!(
                f,
                "{exchange}: as they are the model leaves {:.3} % of the force unexplained, and {:.3} % otherwise",
                100.0 * left,
                100.0 * left_by_exchange
            ),
            Warning::Astray { coordinate, unit, missed, last_reading } => {
                let unit = unit.as_ref().map(|unit| format!(" {unit}")).unwrap_or_default();
                write!(
                    f,
                    "one sample ahead the model misses {coordinate} by {}{unit}, where the reading before misses it by {}{unit}: what moves \
                     this machine is not in the model, such as a load that comes and goes",
                    number(*missed),
                    number(*last_reading)
                )
            }
            Warning::BeyondNoise { signal, left, noise } => write!(
                f,
                "the simulation leaves {} of {signal}, {} times the noise that its readings show: another minimum, which a prior near the \
                 values avoids, or something that is not in the model",
                number(*left),
                number(left / noise)
            ),
            Warning::ScaleUnknown { inputs } => write!(
                f,
                "of {} some are multiples of what is recorded, and the log does not say which of them are right: \
                 the parameters are known up to a common factor; state the gain of an input, or hold a parameter that is known",
                inputs.join(", ")
            ),
            Warning::UnseenFaults { faults } => {
                let list = |of: Calibration, name: &dyn Fn(&UnseenFaultReport) -> String| {
                    let own = faults.iter().filter(|fault| fault.quantity == of).map(name);
                    own.collect::<Vec<_>>().join(", ")
                };
                let share = |of: &'static str| {
                    move |own: &UnseenFaultReport| format!("{} ({} %{of})", own.signal, number(100.0 * own.size))
                };
                let zero = list(Calibration::Zero, &|own| {
                    let unit = own.unit.as_ref().map(|unit| format!(" {unit}")).unwrap_or_default();
                    format!("{} ({:.2}{unit})", own.signal, own.size)
                });
                let named = [
                    ("a wrong gain of ", list(Calibration::Gain, &share(""))),
                    ("a wrong zero of ", zero),
                    ("a dead zone of ", list(Calibration::DeadZone, &share(" of the force"))),
                    ("an inertia between ", list(Calibration::Inertia, &share(" of theirs"))),
                ];
                let named = named.iter().filter(|(_, own)| !own.is_empty()).map(|(what, own)| format!("{what}{own}"));
                let most = faults.iter().map(|fault| fault.deviations).fold(0.0, f64::max);
                write!(
                    f,
                    "this log may not show {}; such a fault moves a parameter by up to {most:.0} of its deviations: make sure of it before \
                     the numbers are relied on",
                    named.collect::<Vec<_>>().join(", nor ")
                )
            }
            Warning::LongSimulation(long) => long.fmt(f),
            Warning::OnePeriod => f.write_str(
                "one period only: it cannot be tested whether the motion had settled, and noise is read from the highest harmonics; record at least four",
            ),
            Warning::PeriodNotUsed { period, stretches: 1 } => {
                write!(f, "the stated period of {} s does not count in the time domain", number(*period))
            }
            Warning::PeriodNotUsed { period, stretches } => write!(
                f,
                "the stated period of {} s is not used: the record has {stretches} stretches, which need not share it and are used together in the time domain",
                number(*period)
            ),
            Warning::AllCoordinates { coordinates } => write!(
                f,
                "{} is eliminated in the model and recorded all the same: the equations before the elimination were used, which show more; without the column, those after it are",
                coordinates.join(", ")
            ),
            Warning::RepeatedReadings { repeated } => repeated.fmt(f),
            Warning::LoneReadings { coordinate, count, line, farthest, unit } => {
                let unit = unit.as_ref().map(|unit| format!(" {unit}")).unwrap_or_default();
                write!(
                    f,
                    "{count} single readings of {coordinate}, the first in line {line}, stand up to {farthest:.3e}{unit} away from their neighbours: faults of the sensor or of its recording; \
                     what these say was used instead"
                )
            }
            Warning::OnlyTogether { parameters } => match parameters.as_slice() {
                [alone] => write!(f, "no motion shows {alone} to the sensors of this log"),
                _ => write!(
                    f,
                    "whatever the motion is, the sensors of this log show {} only together: hold one of them, or measure more",
                    parameters.join(", ")
                ),
            },
            Warning::InLog { path, warning } => write!(f, "{path}: {warning}"),
            Warning::LogsDisagree { path, parameter, deviations } => write!(
                f,
                "{path} contradicts the other logs: {parameter} differs most, by {deviations:.1} deviations; the machine was another one, or a load, a setting, a scale of a column, or the model lacks a force that grows with the frequency, as that of a flexible part does; identify each log by itself"
            ),
            Warning::OddLog { path, parameter, deviations, factor } => {
                write!(
                    f,
                    "{path} contradicts the logs that agree, and is left out: {parameter} differs most, by {deviations:.1} deviations; "
                )?;
                match factor {
                    Some(CommonFactor { value, std }) => write!(
                        f,
                        "all that it tells is {} times what they tell: a gain, a unit or a scale of an input in it is another one",
                        plus_minus(*value, *std)
                    ),
                    None => f.write_str("the machine was another one there, or a load, a setting or a scale of a column"),
                }
            }
            Warning::RateDiffers { coordinate, gain } => write!(
                f,
                "the measured rate of {coordinate} is {gain:.3} times the rate of its measured position: a scale or a unit of one of them is wrong, or a lag"
            ),
            Warning::Unsteady { mismatch } => write!(
                f,
                "the last two periods differ by {:.1} % of the motion: noise, or a motion that has not settled",
                100.0 * mismatch
            ),
            Warning::MostlyLeftOut { left_out, samples } => write!(
                f,
                "more than half of the log is left out: samples 0 to {} of {samples} do not repeat with the period of the last ones; \
                 the end of a motion whose frequency changes passes for periodic, and its parameters are not to be trusted; \
                 say from which sample on the motion repeats",
                left_out - 1
            ),
            Warning::HarmonicsLeftOut { from, to } => write!(
                f,
                "harmonics {from} to {to} are excited but left out: the model does not explain them as it does the lower ones"
            ),
            Warning::Unexplained { residual, of } => write!(
                f,
                "{:.1} % of {of} is not explained by the model; terms may be missing, or a scale, a sign or a column may be wrong",
                100.0 * residual
            ),
            Warning::NotVisible { parameter, data } => write!(f, "{parameter} is not visible in {data}"),
            Warning::PoorlyDetermined { parameter, value, std } => {
                write!(f, "{parameter} is poorly determined: {}", plus_minus(*value, *std))
            }
            Warning::OnlyInCombinations { parameters, data } => {
                write!(f, "visible in {data} only in combinations with each other: {}", listed(parameters))
            }
            Warning::NegativeInertia { parameter, value } => write!(
                f,
                "{parameter} = {value:.4e} is negative, which no machine has: a term may be missing, or a scale, a sign or a column may be wrong"
            ),
            Warning::GivesEnergy { parameter, value, std } => write!(
                f,
                "{parameter} = {} is negative, so that its term gives energy to the machine, which damping and friction do not: a term may be missing, or a scale, a sign or a column may be wrong",
                plus_minus(*value, *std)
            ),
            Warning::CommonFactor { factor, std, count, .. } => write!(
                f,
                "{count} masses and moments are one multiple of their priors, {}: the inputs may be recorded in another unit, such as amperes \
                 in place of newton metres, or behind a gear; state the factor, or no priors if they are those of \
                 another machine",
                plus_minus(*factor, *std)
            ),
            Warning::GoesAgainst { parameter, value, std } => write!(
                f,
                "{parameter} = {} is negative, so that the machine goes against its input: the column of the input or of a coordinate has the wrong sign, unless the drive is meant to turn the other way; state a negative prior if it is",
                plus_minus(*value, *std)
            ),
            Warning::Run { run, ending, goes_on } => match (ending, goes_on) {
                (RunEnding::Unsettled, true) => {
                    write!(f, "run {run}: the motion had not settled; it was played again for longer")
                }
                (RunEnding::Unfollowed, _) => write!(
                    f,
                    "run {run}: the machine hardly moved as it was to (friction or a load holds it); the next run is larger"
                ),
                (RunEnding::Unsettled, false) => write!(f, "run {run}: the motion had not settled"),
                (RunEnding::SensorLost, _) => write!(f, "run {run}: a sensor gave no value; the run is not used"),
                (ending, true) => write!(f, "run {run}: aborted ({ending}), amplitudes reduced"),
                (ending, false) => write!(f, "run {run}: aborted ({ending})"),
            },
            Warning::Contradicts { run, parameter, deviations, pooled, majority } => {
                let (runs, which) = if pooled.len() == 1 { ("run", "that run") } else { ("runs", "those runs") };
                let list: Vec<String> = pooled.iter().map(ToString::to_string).collect();
                write!(
                    f,
                    "run {run} contradicts {runs} {}: {parameter} differs most, by {deviations:.1} standard deviations; run {run} is kept but not pooled; ",
                    list.join(", ")
                )?;
                if *majority {
                    f.write_str(
                        "something was different in that run: a load, a setting, a sensor, friction after a pause, an input that did not act as recorded",
                    )
                } else {
                    write!(
                        f,
                        "it may be right and {which} wrong: play the run again, and the larger number of runs that agree is pooled"
                    )
                }
            }
            Warning::NearMode { run, fundamental, mode } => write!(
                f,
                "run {run}: harmonic {} of {} ({:.4} rad/s) lies near a natural mode of the machine ({:.4} rad/s): choose another frequency, or its vibration is measured",
                mode.harmonic,
                mode.signal,
                f64::from(mode.harmonic) * fundamental,
                mode.frequency
            ),
            Warning::EndedEarly { outcome, limit } => {
                write!(f, "the campaign ended early: {}", outcome.describe())?;
                limit.as_ref().map_or(Ok(()), |limit| write!(f, ": {limit}"))
            }
            Warning::RotorIncluded { coordinate, input, inertia } => write!(
                f,
                "what is identified of {coordinate}'s inertia contains the rotor on {input}, {inertia:.4e} in its unit: leave rotor_inertia out where these values meet this motor"
            ),
            Warning::MissingTerm { term } => write!(
                f,
                "the model leaves something unexplained, of which a term {} * {}{} can take {}: {}; deviations contain how far the parameters would move with it",
                digits(term.value, TERM_DIGITS),
                term.term,
                term.row.as_ref().map(|row| format!(" in row {row}")).unwrap_or_default(),
                if term.gain < 0.005 { "less than 1 %".to_owned() } else { format!("{:.0} %", 100.0 * term.gain) },
                term.meaning
            ),
            Warning::Halves { parameter, moved, deviation } => write!(
                f,
                "the halves of the record contradict each other: {parameter} is {moved:+.3e} larger in the second half, {:.1} deviations: the machine changed, or the recording did",
                moved.abs() / deviation
            ),
            Warning::Limited { term } => write!(
                f,
                "the recorded {} was not applied (clipping, saturation behind the recording): the values are those with this limit, without which the record makes no sense",
                term.term
            ),
            Warning::Repeats { power, beside_terms } => {
                let (left, so) = if *beside_terms {
                    (
                        "what is left beside the terms that the model lacks",
                        "they have another form, more is missing, or it is a sensor that is not linear",
                    )
                } else {
                    (
                        "what the model leaves unexplained",
                        "no single term explains it: a term of the model, friction, a sensor that is not linear",
                    )
                };
                write!(
                    f,
                    "{left} repeats with the motion ({power:.1} times the noise at its harmonics): {so}; deviations are widened"
                )
            }
            Warning::Vibration { frequency } => write!(
                f,
                "the residual vibrates at about {frequency:.1} Hz, where the model has no mode: a flexible mode between input and sensor; deviations contain how far its static part would move the parameters"
            ),
            Warning::NothingAccepted => f.write_str("no run was accepted; nothing is identified"),
            Warning::Unsettled { reason } => write!(
                f,
                "{reason}: no values were found with which the model follows the record; the model may lack something large, or a channel may not be what it is taken for"
            ),
            Warning::FarFromLinear { estimator } => write!(
                f,
                "the updates of {estimator} ended before they settled: an estimate is further from where its equations were linearised than its deviations allow, so that the linearisation does not hold: no value is to be trusted; begin nearer, or with a slower and smaller stage, allow more runs, or take measured-motion"
            ),
            Warning::EndOfInterval { parameter, end, interval: [from, to] } => write!(
                f,
                "{parameter} is held at {end:.4e}, an end of its interval from {from:.4e} to {to:.4e}, beyond which the data ask for it: no value is to be trusted; declare a wider interval, or look for what the model lacks"
            ),
            Warning::TakenAsKnown { parameter, value } => write!(
                f,
                "{parameter} was taken as known, {value:.4e}: runs identify only parameters in which the model is linear; deviations do not contain that of {parameter}; identify it from a log"
            ),
            Warning::SeveralMinima { parameter, value, other, left } => write!(
                f,
                "{parameter} = {other:.4e} explains the data nearly as well as {value:.4e}, it leaves {left:.3} times as much: declare a narrower interval if one of them is impossible, or record a motion that tells them apart"
            ),
            Warning::NotRefined { reason } => reason.fmt(f),
            Warning::AskedInVain { reason } => {
                write!(f, "a refinement by simulation was asked for, and the values are not those of one: {reason}")
            }
            Warning::Physical { remark } => remark.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Warning;
    use crate::refinement_report::{LongSimulation, NotRefined};

    #[test]
    fn a_long_simulation_is_numbers_in_a_warning_and_a_text_in_a_note() {
        let long = LongSimulation { work: 2.5, most: 1.5 };
        let written = serde_json::to_string(&Warning::LongSimulation(long)).expect("a warning is written");
        assert_eq!(written, r#"{"kind":"long_simulation","work":2.5,"most":1.5}"#);
        let note = serde_json::to_string(&NotRefined::LongSimulation(long)).expect("a note is written");
        assert_eq!(note, format!("\"{}\"", Warning::LongSimulation(long)));
    }
}
