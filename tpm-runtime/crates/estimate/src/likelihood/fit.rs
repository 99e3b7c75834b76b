//! From a record to parameters, their deviations, and the terms that the model lacks.

use crate::error::EstimateError;
use crate::free::Free;
use crate::likelihood::components::{Components, Products};
use crate::likelihood::library::{LEAST_SHARE, Term, TermKind};
use crate::likelihood::lines::{RowLines, Signals, row_lines, weights};
use crate::likelihood::nearest::{Nearby, Nearest};
use crate::likelihood::noise::{Noise, triangle};
use crate::likelihood::pass::{Known, Look, Memory, Pass};
use crate::likelihood::path::{Along, Entry};
use crate::likelihood::split::{Solved, Split};
use crate::likelihood::start::{KNOWN_SHARE, RANK};
use crate::result::{Estimate, LeastSquares};
use crate::rows::Rows;
use crate::scale::Scale;
use crate::settings::{Settings, Weights};
use crate::time_domain::motion::{Motion, Stretch, TimeRecord};
use crate::verdict::LARGE_RESIDUAL;
use serde::Serialize;
use tpm_controller::model::Model;
use tpm_numerics::singular::unit_columns;
use tpm_numerics::tail::chi_squared_upper;
use tpm_numerics::{Cholesky, DMatrix, DVector, Matrix, alarm, gram as products, root_mean_square, tolerance};

/// Passes in which noise and components are found in turn; more where a row without an input is linearised anew.
const PASSES: usize = 3;
const MORE_PASSES: usize = 3;
/// Largest change of the logarithm of a variance after which they end.
const SETTLED: f64 = 0.05;
/// Steps of the noise in a pass.
const NOISE_STEPS: usize = 6;
/// A candidate counts when the parameters leave more of its column than this many times the error that noise of the sensors makes in it. The
/// share that they must leave is never below the first number and never above the second.
const OWN_ERRORS: f64 = 30.0;
const SPANNED: [f64; 2] = [0.02, 0.1];
/// Fewest independent equations for every column from which the noise is told with all candidates.
const LEAST_EQUATIONS: f64 = 2.0;
/// Largest leverage of a line in the covariance from residuals.
const MOST_LEVERAGE: f64 = 0.9;
/// A delay or a gain is applied to the input when the square of its standardised size is larger, and at most so many times, until it moves by
/// less than this share of its deviation.
const APPLIED_SHOWN: f64 = 30.0;
const APPLIED_PASSES: usize = 4;
/// As many times where a delay is asked for, which may be many samples.
const FITTED_PASSES: usize = 12;
const APPLIED_SETTLED: f64 = 0.1;
/// A gain of which the last pass still asks for more than this share does not settle: of one that is there a few percent are left by then,
/// be it a factor of a thousand.
const UNSETTLED_GAIN: f64 = 0.5;
/// Faults that are asked for whether the record would show them: a gain that is by this share off, a dead zone of this share of the force, a
/// zero that is off by its share of the range of its coordinate, and an inertia between two coordinates of its share of theirs.
pub(super) const GAIN_FAULT: f64 = 0.05;
const ZERO_FAULT: f64 = 0.01;
const INERTIA_FAULT: f64 = 0.1;
/// One that moves no parameter by so many deviations does no harm.
pub(super) const HARMFUL: f64 = 2.0;
/// A record shows a fault when it does so 95 times in 100: what is told of it lies by so many of its deviations below the fault once in twenty.
const SURELY: f64 = 1.645;
/// Longest delay that is looked for, s.
const LONGEST_DELAY: f64 = 0.05;
/// Largest share of the force of a row without an input, in which no force is recorded with noise, that may be left when the terms that the
/// model lacks are there: beyond it the structure is another one, or the ratios of the row were not found.
const MOST_LEFT_FREE: f64 = 0.01;

/// A term that the record shows the model to lack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lacking {
    /// The term.
    pub term: Term,
    /// Its factor, in the units of row and term; a delay in s.
    pub value: f64,
    /// Standard deviation of the factor.
    pub std: f64,
    /// Share that it takes of the sum of squares that the row, in which it makes most, would leave without it.
    pub gain: f64,
}

impl Lacking {
    /// A term whose factor counts as exact.
    #[must_use]
    pub const fn known(term: Term, value: f64) -> Self {
        Self { term, value, std: 0.0, gain: 0.0 }
    }
}

/// The delay of an input, found with the parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedDelay {
    /// The input.
    pub input: usize,
    /// By how much later it acts than is recorded, beyond what is known, s.
    pub value: f64,
    /// Standard deviation, s.
    pub std: f64,
    /// Whether it moves no more by a share of its deviation.
    pub settled: bool,
}

/// What a fault of a sensor's calibration would do, or something else of which many records say nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationFault {
    /// The gain of an input, the zero of a coordinate, a dead zone, or an inertia between coordinates.
    pub term: Term,
    /// Standard deviation with which the record tells it: a share of the gain, of the force or of the inertia, or a distance in the unit of the
    /// coordinate. Nothing where no record tells it.
    pub std: Option<f64>,
    /// Change of every parameter by a fault of one of these units that the model knows nothing of.
    pub change: Vec<f64>,
    /// One that the record would not show for certain, though it would move parameters.
    pub unseen: Option<UnseenFault>,
}

/// A fault that a record would not show for certain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnseenFault {
    /// How far it would be off, in the unit of [`CalibrationFault::std`].
    pub size: f64,
    /// Largest change of a parameter, in its standard deviations.
    pub moves: f64,
}

/// What was found on the way to an estimate.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct LineReport {
    /// Highest frequency at which every coordinate stands out of its noise, Hz.
    pub followed: Vec<f64>,
    /// Highest frequency of the lines of every row, Hz.
    pub used: Vec<f64>,
    /// Lines of every row.
    pub lines: Vec<usize>,
    /// Share of the record that is used in every row; the rest is its ends and the times around reversals.
    pub kept: Vec<f64>,
    /// Standard deviation of every sensor's noise, unit of the coordinate.
    pub noise: Vec<f64>,
    /// Share of the information that noise of the sensors limits, by row.
    pub sensor_share: Vec<f64>,
    /// What the model leaves of every row, as a share of its force.
    #[serde(skip)]
    pub row_residuals: Vec<f64>,
    /// What the model leaves of every row when the terms that it lacks are there, as a share of its force.
    pub with_terms: Vec<f64>,
    /// Largest of these shares in a row without an input that is too large for one: the structure of the model is another one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free_row_left: Option<f64>,
    /// Samples that were used.
    pub samples: usize,
    /// Measured rate over the rate of the measured position, by coordinate; nothing where the rate was not measured.
    pub rate_gains: Vec<Option<f64>>,
}

/// An estimate from any motion.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OfAnyMotion {
    /// The estimate.
    pub estimate: Estimate,
    /// What was found on the way.
    pub report: LineReport,
    /// Terms that the model lacks, the clearest first.
    pub lacking: Vec<Lacking>,
    /// Delays of inputs that were asked for; values and covariance of the parameters are those beside them.
    pub delays: Vec<FittedDelay>,
    /// How well the model can predict the forces, as it stands and with what it lacks; nothing where it lacks nothing.
    pub nearby: Option<Nearby>,
    /// What faults of the sensors' calibration would do.
    pub calibration: Vec<CalibrationFault>,
    /// Whether inputs are multiples of what is recorded and no majority of them, nor anything that is known, says which: then all parameters
    /// are known up to a factor.
    pub scale_unknown: bool,
    /// What the rows leave of the forces, as a share, when the inputs do the other thing between samples.
    pub other_hold: Option<f64>,
    /// Samples in which the motion goes to and fro once, on the average.
    pub typical_period: f64,
    /// Samples on either side of a sample over which a polynomial follows the motion.
    pub reach: usize,
    /// Step of every sensor; zero where its values lie on no grid.
    pub steps: Vec<f64>,
    /// Largest share of a row's force that one unit of a parameter makes, by parameter.
    felt: Vec<f64>,
}

impl OfAnyMotion {
    /// The estimate with other values and covariance, both of all parameters; `settings` say which are held.
    #[must_use]
    pub fn restated(&self, values: Vec<f64>, covariance: Matrix, settings: &Settings) -> Estimate {
        self.estimate.with_values(values, covariance, settings, |j, std| self.felt[j] * std)
    }

    /// The values with which the model is nearest to the forces in place of those that noise and missing terms allow it.
    fn with_nearest(self, nearest: Nearest, settings: &Settings) -> Self {
        let estimate = Estimate {
            residual: root_mean_square(nearest.left.iter().copied()),
            ..self.restated(nearest.values, nearest.covariance, settings)
        };
        let nearby = self.nearby.map(|own| Nearby { left: nearest.left.clone(), ..own });
        let report = LineReport { row_residuals: nearest.left, ..self.report };
        OfAnyMotion { estimate, report, nearby, ..self }
    }

    /// The model as it is, beside what was found with terms that it may lack. Such terms and parameters were exchanged for each other: with
    /// the values beside the terms the model alone explains little. What is nearest to the forces is the result, since it is the model that is
    /// used; the deviations contain how far the terms would move the values.
    fn beside(self, nearest: Nearest, settings: &Settings) -> Self {
        let moved: Vec<f64> =
            nearest.values.iter().zip(&self.estimate.values).map(|(own, other)| other - own).collect();
        let both = Matrix::of(nearest.covariance.dense() + self.estimate.covariance.dense());
        self.with_nearest(Nearest { covariance: both.moved_by(&moved), ..nearest }, settings)
    }
}

/// Estimates the parameters in which a model is linear from any motion. `circular` says that the record is whole periods of a motion that
/// repeats.
///
/// # Errors
/// [`EstimateError::NoSignal`] when the stretches are too short, or show nothing; [`EstimateError::Model`] and
/// [`EstimateError::NotFinite`] when the rows cannot be evaluated on the motion; [`EstimateError::Frozen`] and
/// [`EstimateError::AllFrozen`] when parameters are held that do not exist, or all.
pub fn estimate_any_motion(
    model: &dyn Model<f64>,
    constants: &[f64],
    record: &TimeRecord<'_>,
    circular: bool,
    settings: &Settings,
) -> Result<OfAnyMotion, EstimateError> {
    let free = settings.free(model.dims().parameters)?;
    let motion = Motion::new(record, circular)?;
    let rows = Rows { model, constants };
    let memory = Memory::default();
    let known = (record, &motion, circular, &memory);
    let mut look = Look::first(model, settings);
    // Every round but the last refuses one gain at least.
    let found = loop {
        match applied(rows, known, &mut look, (&free, settings))? {
            Ok(result) => break result,
            Err(refused) => {
                look.refused.extend(refused);
                look = Look { refused: look.refused, ..Look::first(model, settings) };
            }
        }
    };
    let nearest = found.nearby.as_ref().map(|nearby| nearby.stated.clone());
    Ok(match nearest {
        Some(nearest) if settings.weights == Weights::Equal => found.with_nearest(nearest, settings),
        Some(nearest) if found.estimate.residual > LARGE_RESIDUAL => found.beside(nearest, settings),
        _ => found,
    })
}

/// A record looked at as far as the noise of the forces allows.
fn first_pass<'a>(
    rows: Rows<'a>,
    known: Known<'a>,
    look: &mut Look,
    (free, settings): (&Free, &Settings),
) -> Result<Pass<'a>, EstimateError> {
    let pass = Pass::new(rows, known, look, free, settings)?;
    let Some(taken) = pass.wider()? else { return Ok(pass) };
    look.taken = taken;
    Pass::new(rows, known, look, free, settings)
}

/// The estimate with the delays and gains of inputs that are found applied, until nothing is left of them. A gain of which the corrected
/// record asks for as much as before is none: parameters of its row and a misfit of another kind are exchanged for each other, without end.
/// Such gains are handed back instead of an estimate.
fn applied<'a>(
    rows: Rows<'a>,
    known: Known<'a>,
    look: &mut Look,
    (free, settings): (&Free, &Settings),
) -> Result<Result<OfAnyMotion, Vec<Term>>, EstimateError> {
    let mut settled = false;
    let mut before: Vec<Applied> = Vec::new();
    let passes = if look.fitted.is_empty() { APPLIED_PASSES } else { FITTED_PASSES };
    for _ in 0..passes {
        let mut fitted =
            first_pass(rows, known, look, (free, settings))?.with_terms(&settings.load)?.fit(free, settings)?;
        let beyond = |found: &Applied| {
            let late = look.inputs[found.term.of].delay + found.value;
            found.term.kind == TermKind::Delay && !look.is_fitted(found.term) && late.abs() > LONGEST_DELAY
        };
        if !fitted.erring.is_empty() {
            look.applied.append(&mut fitted.erring);
            continue;
        }
        if fitted.applied.is_empty() || settled || fitted.applied.iter().any(beyond) {
            fitted.result.delays.iter_mut().for_each(|delay| delay.settled = settled);
            return fitted.with_prediction(settings).map(Ok);
        }
        let grows = |found: &&Applied| {
            let as_much = |own: &Applied| own.term == found.term && own.value.abs() <= found.value.abs();
            found.term.kind == TermKind::InputGain && before.iter().any(as_much)
        };
        let growing: Vec<Term> = fitted.applied.iter().filter(grows).map(|found| found.term).collect();
        if !growing.is_empty() {
            return Ok(Err(growing));
        }
        settled = fitted.applied.iter().all(|found| found.value.abs() < APPLIED_SETTLED * found.std);
        fitted.applied.iter().for_each(|found| look.apply(found.term, found.value));
        before = fitted.applied;
    }
    let fitted = Pass::new(rows, known, look, free, settings)?.with_terms(&settings.load)?.fit(free, settings)?;
    let grows = |found: &&Applied| {
        found.term.kind == TermKind::InputGain && found.value.abs() > UNSETTLED_GAIN.max(APPLIED_SETTLED * found.std)
    };
    let growing: Vec<Term> = fitted.applied.iter().filter(grows).map(|found| found.term).collect();
    if growing.is_empty() { fitted.with_prediction(settings).map(Ok) } else { Ok(Err(growing)) }
}

/// Columns that are asked for.
struct Asked {
    /// Parameters that are estimated, and delays that were applied.
    fixed: Vec<usize>,
    /// Terms that the model may lack.
    terms: Vec<usize>,
    /// Both.
    all: Vec<usize>,
    /// Share of every term that the parameters must leave, for it to count.
    spanned: Vec<f64>,
    /// Square of a standardised coefficient from which a term enters.
    threshold: f64,
}

impl Asked {
    fn split(&self, factor: &DMatrix<f64>) -> Split {
        Split::new(factor, self.fixed.len(), &self.spanned)
    }
}

/// What noise and components leave of them.
struct Weighed {
    noise: Noise,
    /// Variance of the coefficient of every term.
    variance: Vec<f64>,
    /// Terms that take part.
    active: Vec<usize>,
    solved: Solved,
    split: Split,
}

/// What a fit gives.
struct Outcome<'a> {
    result: OfAnyMotion,
    /// Delays and gains of inputs that were found beside what was applied.
    applied: Vec<Applied>,
    /// Errors of readings that were found, which are parameters from then on.
    erring: Vec<Term>,
    pass: Pass<'a>,
    noise: Noise,
    /// Columns that are estimated, and those of missing terms that a model which predicts forces can have.
    columns: (Vec<usize>, Vec<usize>),
    /// Coefficients of all terms.
    missing: Vec<f64>,
}

impl Outcome<'_> {
    /// The result, with how well the model can predict the forces where it lacks any, an input was found to act later than it is recorded, or
    /// its values are to be the nearest to them.
    fn with_prediction(mut self, settings: &Settings) -> Result<OfAnyMotion, EstimateError> {
        let is_asked = settings.weights == Weights::Equal
            || self.result.estimate.residual > LARGE_RESIDUAL
            || self.result.lacking.iter().any(|own| own.term.kind.is_force() || own.term.kind == TermKind::Delay);
        if is_asked {
            let (values, (fixed, lasting)) = (&self.result.estimate.values, &self.columns);
            self.result.nearby =
                self.pass.nearest((fixed, lasting), (values, &self.missing), (&self.noise, &settings.load))?;
        }
        Ok(self.result)
    }
}

/// A term of an input that was found beside what was applied of it.
struct Applied {
    term: Term,
    value: f64,
    std: f64,
}

impl<'a> Pass<'a> {
    /// Noise and components in turn, from a noise on.
    fn weigh(&mut self, asked: &Asked, mut noise: Noise) -> Result<Weighed, EstimateError> {
        let (p, right) = (self.rows.model.dims().parameters, self.right());
        let ratios = self.leading.iter().any(Option::is_some);
        let passes = PASSES + if ratios { MORE_PASSES } else { 0 };
        for _ in 0..passes {
            let split = asked.split(&triangle(&self.lines, &noise.variance, &asked.all, right));
            let products = Products::of(&split.candidates, &split.target, &asked.spanned);
            let found = Components::found(&products, asked.threshold);
            let columns: Vec<usize> =
                asked.fixed.iter().copied().chain(found.active().map(|i| asked.terms[i])).collect();
            let (next, values) = noise.found(&self.lines, &columns, right, Some(NOISE_STEPS), None);
            let change = next.variance.iter().flatten().zip(noise.variance.iter().flatten());
            let change = change.map(|(a, b)| (a / b).ln().abs()).fold(0.0, f64::max);
            noise = next;
            if ratios {
                self.kept.iter().for_each(|&j| self.theta[j] = values[j]);
                let missing: Vec<f64> = (0..self.terms.len()).map(|i| values[p + i]).collect();
                let linearised: Vec<usize> =
                    (0..self.leading.len()).filter(|&row| self.leading[row].is_some()).collect();
                self.rows_anew(&linearised, &missing)?;
            }
            if change < SETTLED {
                break;
            }
        }
        let split = asked.split(&triangle(&self.lines, &noise.variance, &asked.all, right));
        let products = Products::of(&split.candidates, &split.target, &asked.spanned);
        let found = Components::found(&products, asked.threshold);
        let common = found.common(&split.candidates, &split.target, &split.counts);
        let whole = |(own, counts): (&f64, &bool)| own + if *counts { common } else { 0.0 };
        let variance: Vec<f64> = found.variance.iter().zip(&split.counts).map(whole).collect();
        let solved = split.solve(&variance).ok_or(EstimateError::NoSignal)?;
        let active = found.active().collect();
        Ok(Weighed { noise, variance, active, solved, split })
    }

    /// Values of all parameters, and of all terms.
    fn values(&self, asked: &Asked, solved: &Solved) -> (Vec<f64>, Vec<f64>) {
        let (p, kept) = (self.rows.model.dims().parameters, self.kept.len());
        let mut values = self.theta.clone();
        self.kept.iter().zip(solved.values.iter()).for_each(|(&j, value)| values[j] = *value);
        let mut missing = vec![0.0; self.terms.len()];
        asked.terms.iter().zip(solved.missing.iter()).for_each(|(&column, value)| missing[column - p] = *value);
        let applied = asked.fixed.iter().zip(solved.values.iter()).skip(kept);
        applied.for_each(|(&column, value)| missing[column - p] = *value);
        (values, missing)
    }

    /// What is asked of the lines; what was applied to an input is a parameter.
    fn asked(&self) -> Asked {
        let p = self.rows.model.dims().parameters;
        let is_applied = |i: usize| self.look.applied.contains(&self.terms[i]);
        let own = (0..self.terms.len()).filter(|&i| is_applied(i)).map(|i| p + i);
        let fixed: Vec<usize> = self.kept.iter().copied().chain(own).collect();
        let terms: Vec<usize> = (0..self.terms.len()).filter(|&i| !is_applied(i)).map(|i| p + i).collect();
        let all = fixed.iter().chain(&terms).copied().collect();
        let threshold = alarm::squared_normal(alarm::MISSING_COMPONENT_RATE, terms.len());
        let of = |column: &usize| {
            (OWN_ERRORS * self.scales.relative_error(self.terms[column - p])).clamp(SPANNED[0], SPANNED[1])
        };
        let spanned = terms.iter().map(of).collect();
        Asked { fixed, terms, all, spanned, threshold }
    }

    /// Values, deviations and missing terms.
    fn fit(mut self, free: &Free, settings: &Settings) -> Result<Outcome<'a>, EstimateError> {
        let dims = self.rows.model.dims();
        let (p, right) = (dims.parameters, self.right());
        let asked = self.asked();
        // With all candidates a misfit is not taken for noise at first; where they are too many for the record, the model alone tells.
        let independent: f64 = self.lines.iter().map(|row| 2.0 * row.lines() as f64 / row.correlation).sum();
        let many = independent < LEAST_EQUATIONS * asked.all.len() as f64;
        let first = if many { &asked.fixed } else { &asked.all };
        let noise = Noise::first(&self.lines, true).found(&self.lines, first, right, None, None).0;
        let mut weighed = self.weigh(&asked, noise)?;
        let (values, missing) = self.values(&asked, &weighed.solved);
        let of_parameters = (asked.fixed.as_slice(), &weighed.solved.covariance);
        let mut narrower = Vec::new();
        for row in 0..dims.rows {
            let notch = self.needed_notch(row, (&values, &missing), of_parameters)?;
            if notch < self.views[row].notch {
                narrower.push(row);
                self.views[row].notch = notch;
            }
        }
        if !narrower.is_empty() {
            self.rows_anew(&narrower, &missing)?;
            weighed = self.weigh(&asked, weighed.noise)?;
        }
        let (values, missing) = self.values(&asked, &weighed.solved);
        let Weighed { noise, variance, active, solved, split } = weighed;
        let calibration = self.calibration(&asked, &split, &solved.covariance);
        let erring = self.erring(&asked, &split, &variance);
        let Asked { fixed, terms, threshold, .. } = asked;
        let by_lines =
            self.by_lines(&noise, &fixed, &active.iter().map(|&i| (terms[i], variance[i])).collect::<Vec<_>>());
        // The larger of what the noise says and what the residuals line by line say, parameter by parameter.
        let factor_of: Vec<f64> = (0..fixed.len())
            .map(|a| (by_lines[a] / solved.covariance[(a, a)].max(f64::MIN_POSITIVE)).max(1.0).sqrt())
            .collect();
        let covariance =
            DMatrix::from_fn(fixed.len(), fixed.len(), |a, b| solved.covariance[(a, b)] * factor_of[a] * factor_of[b]);
        let kept = self.kept.len();
        let mut whole = DMatrix::zeros(p, p);
        for (a, &i) in self.kept.iter().enumerate() {
            for (b, &j) in self.kept.iter().enumerate() {
                whole[(i, j)] = covariance[(a, b)];
            }
        }
        let named = |column: usize, (value, std): (f64, f64)| {
            let term = self.terms[column - p];
            let size = match (term.kind, term.row) {
                // What a reading errs by is the acceleration that no force makes, over the inertia.
                (kind, Some(row)) if kind.is_of_reading() => {
                    let inertia = self.coefficients[row][term.of].iter().zip(&values).map(|(own, value)| own * value);
                    -self.sizes[column - p] * inertia.sum::<f64>()
                }
                _ => self.sizes[column - p],
            };
            let gain = self.gain(column, value, (&values, &missing));
            Lacking { term, value: value / size, std: (std / size).abs(), gain }
        };
        let mut lacking: Vec<(f64, Lacking)> = Vec::new();
        let mut lasting = Vec::new();
        for (a, &i) in active.iter().enumerate() {
            let spread = (solved.of_terms[i]).max(by_lines[fixed.len() + a]);
            let value = solved.missing[i];
            let shown = value * value / spread.max(f64::MIN_POSITIVE);
            if shown > threshold && self.share(terms[i], value) > LEAST_SHARE {
                lacking.push((shown, named(terms[i], (value, spread.sqrt()))));
                let kind = self.terms[terms[i] - p].kind;
                let has_load = kind == TermKind::LoadFriction && !settings.load.is_empty();
                lasting.extend((kind.predicts() || has_load).then_some(terms[i]));
            }
        }
        let of_input = |kind: TermKind| matches!(kind, TermKind::Delay | TermKind::InputGain);
        let mut applied: Vec<Applied> = lacking
            .iter()
            .filter(|(shown, own)| of_input(own.term.kind) && *shown > APPLIED_SHOWN)
            .map(|(_, own)| Applied { term: own.term, value: own.value, std: own.std })
            .collect();
        let mut delays = Vec::new();
        for (a, &column) in fixed.iter().enumerate().skip(kept) {
            let (term, size) = (self.terms[column - p], self.sizes[column - p]);
            let (value, std) = (solved.values[a] / size, covariance[(a, a)].max(0.0).sqrt() / size);
            if term.kind.is_of_reading() {
                lacking.push((f64::INFINITY, named(column, (value * size, std * size))));
                continue;
            }
            let own = self.look.inputs[term.of];
            let whole = if term.kind == TermKind::Delay { own.delay + value } else { (1.0 + value) / own.gain - 1.0 };
            applied.push(Applied { term, value, std });
            if self.look.is_fitted(term) {
                delays.push(FittedDelay { input: term.of, value: whole, std, settled: false });
                // Nothing acts before it is commanded.
                let known = self.record.actuators.get(term.of).map_or(0.0, |known| known.delay);
                let early = whole + known < 0.0 && (whole + known).powi(2) > threshold * std * std;
                if !early {
                    continue;
                }
            }
            lacking.push((f64::INFINITY, named(column, (whole * size, std * size))));
        }
        // The column of a gain is what acts, so that its coefficient says by which share more is recorded.
        for (_, own) in lacking.iter_mut().filter(|(_, own)| own.term.kind == TermKind::InputGain) {
            let factor = 1.0 / (1.0 + own.value);
            own.std *= factor * factor / self.look.inputs[own.term.of].gain;
            own.value = factor;
        }
        let mut lacking = with_amplitudes(lacking);
        lacking.sort_by(|a, b| b.0.total_cmp(&a.0));
        // Torque constants are known no better than this, so that such a gain does not put the scale of all parameters in doubt.
        let of_gain =
            |own: &&(f64, Lacking)| own.1.term.kind == TermKind::InputGain && (own.1.value - 1.0).abs() > GAIN_FAULT;
        let scale_unknown = match lacking.iter().filter(of_gain).count() {
            0 => false,
            // An input whose gain the record does not tell says nothing of the others' gains either.
            wrong => {
                let untold = (calibration.iter())
                    .filter(|own| own.term.kind == TermKind::InputGain && own.unseen.is_some())
                    .count();
                2 * wrong + untold >= dims.inputs && !self.has_scale(free)
            }
        };
        let none = vec![0.0; missing.len()];
        let row_residuals: Vec<f64> = self.lines.iter().map(|row| left(row, (p, right), &values, &none)).collect();
        let with_terms: Vec<f64> = self.lines.iter().map(|row| left(row, (p, right), &values, &missing)).collect();
        let of_free_rows =
            with_terms.iter().enumerate().filter(|(row, _)| self.leading[*row].is_some()).map(|(_, left)| *left);
        let free_row_left = of_free_rows.filter(|left| *left > MOST_LEFT_FREE).max_by(f64::total_cmp);
        let felt: Vec<f64> = (0..p)
            .map(|j| {
                let of = |row: &RowLines| (row.size(j) / row.force().max(f64::MIN_POSITIVE)).sqrt();
                self.lines.iter().map(of).fold(0.0, f64::max)
            })
            .collect();
        let touched: Vec<bool> = {
            let scale: Vec<f64> =
                free.indices.iter().map(|&j| self.lines.iter().map(|row| row.size(j)).sum::<f64>().sqrt()).collect();
            let scale: Vec<f64> = scale.iter().map(|s| if *s > 0.0 { *s } else { 1.0 }).collect();
            crate::information::touched(&self.hidden, &scale)
        };
        let mut condition = split.parameters.view((0, 0), (kept, kept)).into_owned();
        condition = unit_columns(condition).0;
        let condition = tpm_numerics::singular::condition(&condition, RANK);
        let mut estimate = Estimate::of_rows(
            free,
            LeastSquares {
                values,
                covariance: whole,
                hidden: &self.hidden,
                touched: &touched,
                rank: kept,
                condition,
                row_residuals: &row_residuals,
                felt: &felt,
            },
        );
        // Rows without anything known in them hold for every multiple of their parameters.
        let homogeneous = |direction: usize| {
            let takes_part = |part: &f64| f64::from(u8::from(part.abs() > tolerance::COMPONENT));
            Scale { direction, powers: estimate.unobservable[direction].iter().map(takes_part).collect() }
        };
        let first = self.hidden.len() - self.scale_directions;
        estimate.scales = (first..self.hidden.len()).map(homogeneous).collect();
        let report = LineReport {
            followed: self.paths.measured.iter().map(|own| own.spectrum.followed).collect(),
            used: self.views.iter().map(|view| view.used).collect(),
            lines: self.lines.iter().map(RowLines::lines).collect(),
            kept: self.lines.iter().map(|row| row.kept).collect(),
            noise: self.paths.measured.iter().map(|own| own.spectrum.noise).collect(),
            sensor_share: self.sensor_shares(&noise, &fixed, &split.parameters),
            row_residuals,
            with_terms,
            free_row_left,
            samples: self.record.stretches.iter().map(Stretch::samples).sum(),
            rate_gains: self.motion.rate_gains.clone(),
        };
        let other_hold = self.other_hold(&estimate.values)?.map(|ratio| ratio * estimate.residual);
        let followed = self.paths.fastest();
        Ok(Outcome {
            erring,
            result: OfAnyMotion {
                estimate,
                other_hold,
                typical_period: self.motion.typical_period / self.paths.sample_time,
                reach: crate::time_domain::band::reach(followed, self.paths.sample_time),
                steps: self.motion.steps.clone(),
                lacking: lacking.into_iter().map(|(_, own)| own).collect(),
                delays,
                nearby: None,
                calibration,
                scale_unknown,
                report,
                felt,
            },
            applied,
            noise,
            columns: (fixed, lasting),
            missing,
            pass: self,
        })
    }

    /// The errors of readings that the record shows, those of a coordinate together: a wheel that is not centred errs once and twice a turn, and
    /// while half of that is left out the inertia that makes up for it hides the other half.
    fn erring(&self, asked: &Asked, split: &Split, variance: &[f64]) -> Vec<Term> {
        let term = |at: usize| self.terms[asked.terms[at] - self.rows.model.dims().parameters];
        let Some(noise) = split.spread(variance) else { return Vec::new() };
        let coordinates = 0..self.rows.model.dims().coordinates;
        let shown = coordinates.filter_map(|c| {
            let of = |at: &usize| term(*at).kind.is_of_reading() && term(*at).of == c && split.counts[*at];
            let own: Vec<usize> = (0..asked.terms.len()).filter(of).collect();
            let columns = split.candidates.select_columns(&own);
            let weighted = noise.solve(&columns);
            let right = weighted.tr_mul(&split.target);
            let gain = right.dot(&Cholesky::new(columns.tr_mul(&weighted))?.solve(&right));
            (chi_squared_upper(gain, own.len()) < alarm::MISSING_TERM_RATE).then_some(own)
        });
        shown.flatten().map(term).collect()
    }

    /// What faults of gains and zeros, dead zones and inertias between coordinates would do to the parameters, whose covariance is given. One
    /// is unseen where its term takes no part, since the parameters make up for nearly all of it, or where noise can leave it below what
    /// makes a term enter.
    fn calibration(&self, asked: &Asked, split: &Split, covariance: &DMatrix<f64>) -> Vec<CalibrationFault> {
        let p = self.rows.model.dims().parameters;
        let of = |(at, &column): (usize, &usize)| {
            let (term, size) = (self.terms[column - p], self.sizes[column - p]);
            let own_inertia = |c: usize| self.own_inertia(c).map_or(0.0, |j| self.theta[j].abs());
            let (size, scale) = match term.kind {
                TermKind::InputGain => (GAIN_FAULT, size),
                TermKind::PositionOffset => (ZERO_FAULT * self.scales.span(term.of), size),
                TermKind::DeadZone => (GAIN_FAULT, size * self.scales.force(term.row?)),
                TermKind::RelativeInertia => (INERTIA_FAULT, size * own_inertia(term.of).min(own_inertia(term.other?))),
                _ => return None,
            };
            let told = split.told[at] * scale;
            let mut moved = split.mixed.column(at) * scale;
            if !split.parameters.solve_upper_triangular_mut(&mut moved) {
                return None;
            }
            let deviations = (0..self.kept.len()).map(|a| size * moved[a].abs() / covariance[(a, a)].sqrt());
            let moves = deviations.filter(|share| share.is_finite()).fold(0.0, f64::max);
            let below = !split.counts[at] || size * told < asked.threshold.sqrt() + SURELY;
            let mut change = vec![0.0; p];
            self.kept.iter().zip(moved.iter()).for_each(|(&j, own)| change[j] = *own);
            let unseen = (below && moves > HARMFUL).then_some(UnseenFault { size, moves });
            Some(CalibrationFault { term, std: Some(1.0 / told), change, unseen })
        };
        asked.terms.iter().enumerate().filter_map(of).collect()
    }

    /// Whether something that is known fixes the scale of the forces: a known term, or a parameter that is held.
    fn has_scale(&self, free: &Free) -> bool {
        let held = |j: usize| !free.indices.contains(&j) && self.theta[j] != 0.0;
        let any_held = |own: &Along| (0..self.theta.len()).any(|j| held(j) && own.has(Entry::Parameter(j)));
        self.along.iter().any(|own| any_held(own) || own.known_share() > KNOWN_SHARE)
    }

    /// Root mean square of what a column makes, as a share of the force of the row where it makes most.
    fn share(&self, column: usize, value: f64) -> f64 {
        let of = |row: &RowLines| value.abs() * (row.size(column) / row.force().max(f64::MIN_POSITIVE)).sqrt();
        self.lines.iter().map(of).fold(0.0, f64::max)
    }

    /// Share that a column takes of the sum of squares that the row, in which it makes most, would leave without it.
    fn gain(&self, column: usize, value: f64, (values, missing): (&[f64], &[f64])) -> f64 {
        let (p, right) = (self.rows.model.dims().parameters, self.right());
        let of = |row: &RowLines| row.size(column) / row.force().max(f64::MIN_POSITIVE);
        let Some(row) = self.lines.iter().max_by(|a, b| of(a).total_cmp(&of(b))) else { return 0.0 };
        let (Some(with), Some(at)) = (unexplained(row, (p, right), values, missing), row.place(column)) else {
            return 0.0;
        };
        let without = &with + row.entries.column(at) * value;
        (1.0 - with.norm_squared() / without.norm_squared().max(f64::MIN_POSITIVE)).max(0.0)
    }

    /// Share of the information that the noise of the sensors limits, row by row: floors over variances, by leverages.
    /// `factor` is the triangle of these columns.
    fn sensor_shares(&self, noise: &Noise, columns: &[usize], factor: &DMatrix<f64>) -> Vec<f64> {
        let n = columns.len();
        let mut inverse = DMatrix::identity(n, n);
        if !factor.solve_upper_triangular_mut(&mut inverse) {
            return vec![0.0; self.lines.len()];
        }
        let of = |(row, variance): (&RowLines, &Vec<f64>)| {
            let (at, matrix) = row.weighted(columns, &weights(variance));
            let through = matrix * inverse.select_rows(&at);
            let floors = row.floor.iter().zip(variance).map(|(floor, variance)| floor / variance).collect::<Vec<f64>>();
            let leverages = through.row_iter().map(|row| row.norm_squared());
            let (whole, own) = leverages
                .enumerate()
                .fold((0.0, 0.0), |(whole, own), (part, h)| (whole + h, own + h * floors[part % floors.len()]));
            if whole > 0.0 { own / whole } else { 0.0 }
        };
        self.lines.iter().zip(&noise.variance).map(of).collect()
    }

    /// Variances from what is left of every line (a sandwich with leverages, of which real and imaginary part share one), of the fixed
    /// columns and then of the active ones, which are given with their own variances.
    fn by_lines(&self, noise: &Noise, fixed: &[usize], active: &[(usize, f64)]) -> Vec<f64> {
        let columns: Vec<usize> = fixed.iter().copied().chain(active.iter().map(|(column, _)| *column)).collect();
        let n = columns.len();
        let right = self.right();
        let parts: usize = self.lines.iter().map(|row| 2 * row.lines()).sum();
        let mut matrix = DMatrix::<f64>::zeros(parts, n);
        let mut target = DVector::<f64>::zeros(parts);
        let mut from = 0;
        for (row, variance) in self.lines.iter().zip(&noise.variance) {
            let weights = weights(variance);
            let (at, own) = row.weighted(&columns, &weights);
            for (from_own, to) in at.into_iter().enumerate() {
                matrix.view_mut((from, to), (weights.len(), 1)).copy_from(&own.column(from_own));
            }
            target
                .rows_mut(from, weights.len())
                .copy_from(&row.column(right).component_mul(&DVector::from_vec(weights)));
            from += 2 * row.lines();
        }
        let (matrix, scale) = unit_columns(matrix);
        let mut gram = products(&matrix);
        for a in 0..n {
            gram[(a, a)] += 1e-12;
            if a >= fixed.len() {
                gram[(a, a)] += 1.0 / (active[a - fixed.len()].1 * scale[a] * scale[a]);
            }
        }
        let Some(factor) = Cholesky::new(gram) else { return vec![0.0; n] };
        let inverse = factor.inverse();
        let values = &inverse * matrix.tr_mul(&target);
        let left = &target - &matrix * values;
        let through = &matrix * &inverse;
        let mut squares: Vec<f64> = (0..parts)
            .map(|part| {
                let leverage: f64 = through.row(part).iter().zip(matrix.row(part).iter()).map(|(a, b)| a * b).sum();
                (left[part] / (1.0 - leverage.min(MOST_LEVERAGE))).powi(2)
            })
            .collect();
        let mut from = 0;
        for row in &self.lines {
            let lines = row.lines();
            for l in 0..lines {
                let both = 0.5 * row.correlation * (squares[from + l] + squares[from + lines + l]);
                squares[from + l] = both;
                squares[from + lines + l] = both;
            }
            from += 2 * lines;
        }
        (0..n)
            .map(|a| {
                let sum: f64 = through.column(a).iter().zip(&squares).map(|(x, square)| x * x * square).sum();
                sum / (scale[a] * scale[a])
            })
            .collect()
    }

    /// What the rows leave of the forces when the inputs do the other thing between samples, in units of what they leave.
    fn other_hold(&self, values: &[f64]) -> Result<Option<f64>, EstimateError> {
        let dims = self.rows.model.dims();
        let other = self.record.hold.other();
        let inputs = self.paths.held_otherwise(self.record, self.motion, other, &self.look.inputs);
        let mut lines: Vec<RowLines> = self.lines.clone();
        let rights: Vec<Vec<Vec<f64>>> = (self.paths.paths.iter().zip(&inputs))
            .map(|(path, inputs)| self.rows.right(path, inputs))
            .collect::<Result<_, _>>()?;
        for (row, own) in lines.iter_mut().enumerate().filter(|(row, _)| !self.homogeneous(*row)) {
            let signals: Vec<Signals> = (rights.iter().zip(&self.along))
                .map(|(rights, along)| {
                    let mut target = rights[row].clone();
                    self.without_held(along.parameters(row), &mut target);
                    vec![(0, target)]
                })
                .collect();
            if let (Some(found), Some(at)) =
                (row_lines(&self.paths.paths, self.views[row], &signals), own.place(self.right()))
            {
                own.entries.set_column(at, &found.entries.column(0));
            }
        }
        // Both holds are judged by the model alone, fitted anew, whatever it lacks.
        let by = |lines: &[RowLines]| {
            let found = Noise::first(lines, true).found(lines, &self.kept, self.right(), None, None).1;
            let mut whole = values.to_vec();
            self.kept.iter().for_each(|&j| whole[j] = found[j]);
            root_mean_square(lines.iter().map(|row| left(row, (dims.parameters, self.right()), &whole, &[])))
        };
        let own = by(&self.lines);
        Ok((own > 0.0).then(|| by(&lines) / own))
    }
}

/// Sines and cosines of the error of a reading as one sine, whose size is that of the error.
fn with_amplitudes(lacking: Vec<(f64, Lacking)>) -> Vec<(f64, Lacking)> {
    let mut found: Vec<(f64, Lacking)> = Vec::with_capacity(lacking.len());
    for (shown, own) in lacking {
        let kind = match own.term.kind {
            TermKind::Reading { multiple, .. } => TermKind::Reading { multiple, even: false },
            kind => kind,
        };
        let term = Term { kind, ..own.term };
        match found.iter_mut().find(|(_, other)| kind.is_of_reading() && other.term == term) {
            Some((_, other)) => {
                let value = own.value.hypot(other.value);
                other.std = (own.value * own.std).hypot(other.value * other.std) / value.max(f64::MIN_POSITIVE);
                (other.value, other.gain) = (value, other.gain + own.gain);
            }
            None => found.push((shown, Lacking { term, ..own })),
        }
    }
    found
}

/// What values of `p` parameters, and of the terms behind them, leave of the lines of a row; nothing without a right-hand side.
fn unexplained(row: &RowLines, (p, right): (usize, usize), values: &[f64], missing: &[f64]) -> Option<DVector<f64>> {
    let mut left = row.entries.column(row.place(right)?).into_owned();
    for (at, &column) in row.columns.iter().enumerate().filter(|(_, column)| **column != right) {
        let value = if column < p { values[column] } else { missing.get(column - p).copied().unwrap_or(0.0) };
        if value != 0.0 {
            left.axpy(-value, &row.entries.column(at), 1.0);
        }
    }
    Some(left)
}

/// What they leave of a row, as a share of its force.
fn left(row: &RowLines, of: (usize, usize), values: &[f64], missing: &[f64]) -> f64 {
    let left = unexplained(row, of, values, missing).map_or(0.0, |left| left.norm_squared());
    let force = row.force() * row.lines() as f64;
    if force > 0.0 { (left / force).sqrt() } else { 0.0 }
}
