//! From a record to parameters, their deviations, and the terms that the model lacks.

use crate::error::EstimateError;
use crate::free::Free;
use crate::information::{beside, beside_known, set_apart};
use crate::likelihood::components::{Components, Products};
use crate::likelihood::library::{Columns, Scales, Term, TermKind};
use crate::likelihood::lines::{RowLines, Signals, View, is_enough, row_lines, weights};
use crate::likelihood::noise::{Noise, triangle};
use crate::likelihood::path::{Along, Entry, Felt, Paths, Rows, band, lost};
use crate::result::{Estimate, ResidualOf};
use crate::settings::Settings;
use crate::time_domain::motion::{Motion, Stretch, TimeRecord};
use crate::verdict::Verdict;
use serde::Serialize;
use tpm_core::model::Model;
use tpm_numerics::singular::{Singular, unit_columns};
use tpm_numerics::{Cholesky, DMatrix, DVector, Matrix, alarm, root_mean_square};

/// A direction of scaled parameters whose singular value is below this share of the largest is not shown.
const RANK: f64 = 1e-8;
/// Passes in which noise and components are found in turn; more where a row without an input is linearised anew.
const PASSES: usize = 3;
const MORE_PASSES: usize = 3;
/// Largest change of the logarithm of a variance after which they end.
const SETTLED: f64 = 0.05;
/// Steps of the noise in a pass.
const NOISE_STEPS: usize = 6;
/// A candidate of which the parameters leave less than this share is spanned by them: noise of the sensors would decide on it.
const SPANNED: f64 = 0.1;
/// Highest frequency up to which a motion may be taken, over the one at which it stands out of its noise: beyond, its forces have next to
/// nothing. Below it frequencies are tried in steps of this ratio.
const WIDEST: f64 = 4.0;
const FINER: f64 = 1.1;
/// A motion is taken up to where its sensor's noise makes this share of the noise of the forces.
const HIDDEN: f64 = 0.05;
/// Highest frequency of a motion that is taken, in units of the sampling rate: eight points an oscillation.
const HIGHEST: f64 = 0.125;
/// What is left around reversals counts as no larger than elsewhere up to so many standard deviations of its mean square.
const ALIKE: f64 = 1.0;
/// A named term makes at least this share of the force of its row.
const LEAST_SHARE: f64 = 0.003;
/// Fewest independent equations for every column from which the noise is told with all candidates.
const LEAST_EQUATIONS: f64 = 2.0;
/// Largest leverage of a line in the covariance from residuals.
const MOST_LEVERAGE: f64 = 0.9;
/// A delay is applied to the input when the square of its standardised size is larger, and at most so many times, until it moves by less
/// than `DELAY_SETTLED` seconds.
const DELAY_SHOWN: f64 = 30.0;
const DELAY_PASSES: usize = 4;
const DELAY_SETTLED: f64 = 2e-5;
/// Longest delay that is looked for, s.
const LONGEST_DELAY: f64 = 0.05;
/// Largest share of the force of a row without an input, in which no force is recorded with noise, that may be left when the terms that the
/// model lacks are there: beyond it the structure is another one, or the ratios of the row were not found.
const MOST_LEFT_FREE: f64 = 0.01;
/// Known terms above this share of a row's force fix the scale of a row without an input.
const KNOWN_SHARE: f64 = 1e-3;

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

    /// Share of the information that noise of the sensors limits, of the row where it is largest.
    #[must_use]
    pub fn sensor_share(&self) -> f64 {
        self.report.sensor_share.iter().copied().fold(0.0, f64::max)
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
    let motion = Motion::new(record)?;
    let rows = Rows { model, constants };
    let known = (record, &motion, circular);
    let mut look = Look::first(model);
    let mut moved: f64 = f64::INFINITY;
    for _ in 0..DELAY_PASSES {
        let mut pass = Pass::new(rows, known, &look, &free, settings)?;
        if let Some(taken) = pass.wider()? {
            look.taken = taken;
            pass = Pass::new(rows, known, &look, &free, settings)?;
        }
        let fitted = pass.fit(&free, &look.late)?;
        let beyond = |(term, value): &(Term, f64)| (look.delays[term.of] + value).abs() > LONGEST_DELAY;
        if fitted.delays.is_empty() || moved < DELAY_SETTLED || fitted.delays.iter().any(beyond) {
            return Ok(fitted.result);
        }
        moved = fitted.delays.iter().map(|(_, value)| value.abs()).fold(0.0, f64::max);
        for (term, value) in &fitted.delays {
            look.delays[term.of] += value;
            look.late[term.of] = true;
        }
    }
    Ok(Pass::new(rows, known, &look, &free, settings)?.fit(&free, &look.late)?.result)
}

/// How a record is looked at, as far as it is found on the way.
struct Look {
    /// Delay of every input beyond the known ones, s.
    delays: Vec<f64>,
    /// Whether it is a parameter.
    late: Vec<bool>,
    /// Frequency up to which every coordinate is taken, Hz; zero where it is taken as far as it stands out of its noise.
    taken: Vec<f64>,
}

impl Look {
    fn first(model: &dyn Model<f64>) -> Self {
        let dims = model.dims();
        let inputs = dims.inputs;
        Look { delays: vec![0.0; inputs], late: vec![false; inputs], taken: vec![0.0; dims.coordinates] }
    }
}

/// A record as lines, before the noise is found.
struct Pass<'a> {
    rows: Rows<'a>,
    record: &'a TimeRecord<'a>,
    motion: &'a Motion,
    delays: Vec<f64>,
    taken: Vec<f64>,
    paths: Paths<'a>,
    along: Vec<Along>,
    scales: Scales,
    terms: Vec<Term>,
    /// Columns of every term, scaled to a root mean square of one, stretch by stretch.
    columns: Vec<Vec<Columns>>,
    /// What the columns of a term were divided by.
    sizes: Vec<f64>,
    /// Values of all parameters from which the rows are linear.
    theta: Vec<f64>,
    /// Parameters that are estimated: all but those that are held and one for every direction that is not shown.
    kept: Vec<usize>,
    hidden: Vec<Vec<f64>>,
    views: Vec<View>,
    /// The coordinate whose acceleration leads a row without an input; nothing for other rows, and before the row is linearised.
    leading: Vec<Option<usize>>,
    lines: Vec<RowLines>,
    /// How the rows feel the motion; nothing before first values are known.
    felt: Option<Felt>,
}

/// Columns that are asked for.
struct Asked {
    /// Parameters that are estimated, and delays that were applied.
    fixed: Vec<usize>,
    /// Terms that the model may lack.
    terms: Vec<usize>,
    /// Both.
    all: Vec<usize>,
    /// Square of a standardised coefficient from which a term enters.
    threshold: f64,
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

/// Sums over the times of a row.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// Squares of what is left.
    squares: f64,
    /// Squares that the uncertainty of the parameters makes of it.
    spread: f64,
    points: f64,
    /// Independent equations.
    equations: f64,
}

impl Sums {
    fn and(self, other: Self) -> Self {
        Sums {
            squares: self.squares + other.squares,
            spread: self.spread + other.spread,
            points: self.points + other.points,
            equations: self.equations + other.equations,
        }
    }
}

/// What a fit gives.
struct Outcome {
    result: OfAnyMotion,
    /// Delays that were found beside those that were applied, s.
    delays: Vec<(Term, f64)>,
}

impl<'a> Pass<'a> {
    fn new(
        rows: Rows<'a>,
        (record, motion, circular): (&'a TimeRecord<'a>, &'a Motion, bool),
        look: &Look,
        free: &Free,
        settings: &Settings,
    ) -> Result<Self, EstimateError> {
        let dims = rows.model.dims();
        let paths = Paths::new(rows, record, motion, circular, (&look.delays, &look.taken));
        let along: Vec<Along> = paths.paths.iter().map(|path| rows.along(path)).collect::<Result<_, _>>()?;
        let deviations = paths.measured.iter().map(|own| own.rate_deviation).collect();
        let scales = Scales::of(rows, &paths.paths, &along, deviations);
        let mut theta = settings.prior.clone();
        theta.resize(dims.parameters, 0.0);
        settings.hold(&mut theta);
        let mut pass = Pass {
            rows,
            record,
            motion,
            delays: look.delays.clone(),
            taken: look.taken.clone(),
            paths,
            along,
            scales,
            terms: Vec::new(),
            columns: Vec::new(),
            sizes: Vec::new(),
            theta,
            kept: free.indices.clone(),
            hidden: Vec::new(),
            views: Vec::new(),
            leading: vec![None; dims.rows],
            lines: Vec::new(),
            felt: None,
        };
        pass.first(free, settings)?;
        Ok(pass)
    }

    fn right(&self) -> usize {
        self.rows.model.dims().parameters + self.terms.len()
    }

    /// Whether no input acts in a row.
    fn homogeneous(&self, row: usize) -> bool {
        !self.scales.driven(row)
    }

    /// How the rows are looked at, given the coordinates that each of them feels.
    fn views(&self, coordinates: &dyn Fn(usize) -> Vec<usize>) -> Vec<View> {
        let dims = self.rows.model.dims();
        (0..dims.rows)
            .map(|row| {
                let (low_pass, used) = band(&coordinates(row), &self.paths.measured);
                let own = (row < dims.coordinates).then_some(row);
                let of = own.unwrap_or(0);
                View {
                    low_pass,
                    used,
                    lost: lost(low_pass, self.paths.fastest()),
                    coordinate: own,
                    rate_deviation: self.paths.measured[of].rate_deviation,
                    followed: self.paths.measured[of].spectrum.followed,
                    notch: 1.0,
                }
            })
            .collect()
    }

    /// The signals of one row, stretch by stretch, about the present values where it has a leading acceleration, and the force of this
    /// acceleration; `missing` are the coefficients of the terms.
    fn signals(&self, row: usize, missing: &[f64]) -> Result<(Vec<Signals>, Vec<Signals>), EstimateError> {
        let dims = self.rows.model.dims();
        let right = self.right();
        let mut signals: Vec<Signals> = Vec::with_capacity(self.paths.paths.len());
        let mut forces: Vec<Signals> = Vec::new();
        for (stretch, (path, along)) in self.paths.paths.iter().zip(&self.along).enumerate() {
            let of_terms = || {
                let own = self.columns.get(stretch).into_iter().flatten().enumerate();
                own.flat_map(|(i, columns)| {
                    columns.iter().filter(|(at, _)| *at == row).map(move |(_, values)| (i, values))
                })
            };
            let predicted = match self.leading[row] {
                Some(c) => {
                    let mut others = vec![0.0; path.points];
                    for (i, values) in of_terms() {
                        let value = missing.get(i).copied().unwrap_or(0.0);
                        if value != 0.0 {
                            others.iter_mut().zip(values).for_each(|(sum, x)| *sum += value * x);
                        }
                    }
                    self.rows.predicted(path, (row, c), &self.theta, &others)?
                }
                None => None,
            };
            let (columns, mut target, factor) = match predicted {
                Some(found) => {
                    forces.push(vec![(0, found.leading)]);
                    let present = |(_, column): &(usize, Vec<f64>)| column.iter().any(|x| *x != 0.0);
                    let columns = found.columns.into_iter().enumerate().filter(present).collect();
                    (columns, found.right, Some(found.factor))
                }
                None => {
                    let target = along.place(row, Entry::Right).map(|at| along.column(at));
                    (along.parameters(row), target.unwrap_or_else(|| vec![0.0; path.points]), None)
                }
            };
            let mut own: Signals = self.without_held(columns, &mut target);
            for (i, values) in of_terms() {
                let values = match &factor {
                    Some(factor) => values.iter().zip(factor).map(|(x, f)| x * f).collect(),
                    None => values.clone(),
                };
                own.push((dims.parameters + i, values));
            }
            own.push((right, target));
            signals.push(own);
        }
        Ok((signals, forces))
    }

    /// The lines of one row.
    fn row(&self, row: usize, missing: &[f64]) -> Result<Option<RowLines>, EstimateError> {
        let (right, view) = (self.right(), self.views[row]);
        let (signals, forces) = self.signals(row, missing)?;
        let Some(mut lines) = row_lines(&self.paths.paths, view, &signals) else { return Ok(None) };
        // What the noise may be in proportion to: the forces of the inputs, or the force of the leading acceleration.
        let leading = if forces.len() == signals.len() { row_lines(&self.paths.paths, view, &forces) } else { None };
        let power = leading.map_or_else(|| lines.column(right), |leading| leading.column(0));
        lines.take_power(power);
        Ok(Some(lines))
    }

    /// The columns of the parameters that are estimated; what the others make is taken from the right-hand side.
    fn without_held(&self, columns: Signals, target: &mut [f64]) -> Signals {
        let (kept, held): (Signals, Signals) = columns.into_iter().partition(|(j, _)| self.kept.contains(j));
        for (j, column) in held.iter().filter(|(j, _)| self.theta[*j] != 0.0) {
            target.iter_mut().zip(column).for_each(|(sum, x)| *sum -= self.theta[*j] * x);
        }
        kept
    }

    /// The lines of all rows.
    ///
    /// # Errors
    /// [`EstimateError::NoSignal`] when the stretches are too short for a row.
    fn all_rows(&self, missing: &[f64]) -> Result<Vec<RowLines>, EstimateError> {
        let rows = self.rows.model.dims().rows;
        (0..rows).map(|row| self.row(row, missing)?.ok_or(EstimateError::NoSignal)).collect()
    }

    /// First values, what is not shown, which coordinates a row feels, and the floors; then the lines with all terms.
    fn first(&mut self, free: &Free, settings: &Settings) -> Result<(), EstimateError> {
        let dims = self.rows.model.dims();
        self.views = self.views(&|row| if row < dims.coordinates { vec![row] } else { Vec::new() });
        // A row without an input as it stands: nothing on the other side.
        let mut lines = self.all_rows(&[])?;
        self.rank(&lines, free, settings)?;
        for row in &mut lines {
            self.hold(row);
        }
        let coefficients = self.rows.leading_coefficients(&self.paths)?;
        self.start(&lines, &coefficients)?;
        let felt = Felt::of(&self.paths, &self.theta)?;
        self.views = self.views(&|row| felt.coordinates(row));
        let leads = |row: usize| if self.homogeneous(row) { leading(row, &coefficients[row]) } else { None };
        self.leading = (0..dims.rows).map(leads).collect();
        if self.leading.iter().any(Option::is_some) {
            self.scale_free(free)?;
        }
        let coupled = |row: usize, c: usize| coefficients[row][c].iter().any(|a| *a != 0.0);
        self.terms = self.scales.terms(self.rows.model, &coupled);
        let mut from = 0.0;
        for (path, along) in self.paths.paths.iter().zip(&self.along) {
            self.columns.push(self.terms.iter().map(|term| self.scales.columns(*term, path, along, from)).collect());
            from += path.points as f64 * path.apart;
        }
        self.scale_terms();
        self.lines = self.all_rows(&[])?;
        self.set_floors(&felt);
        self.felt = Some(felt);
        Ok(())
    }

    /// Takes what parameters that are no longer estimated make from the right-hand side of a row.
    fn hold(&self, row: &mut RowLines) {
        let right = self.right();
        let made = row.columns.iter().copied().filter(|column| *column != right && !self.kept.contains(column));
        let held: Vec<usize> = made.filter(|&j| self.theta[j] != 0.0).collect();
        let mut target = row.column(right);
        for &j in &held {
            target.axpy(-self.theta[j], &row.column(j), 1.0);
        }
        if let Some(at) = row.place(right).filter(|_| !held.is_empty()) {
            row.entries.set_column(at, &target);
            row.take_power(target);
        }
    }

    /// What the lines do not show, and which parameters are estimated.
    fn rank(&mut self, lines: &[RowLines], free: &Free, settings: &Settings) -> Result<(), EstimateError> {
        let noise = Noise::first(lines, false);
        let factor = triangle(lines, &noise.variance, &free.indices, self.right());
        let n = free.indices.len();
        let (factor, scale) = unit_columns(factor.view((0, 0), (n, n)).into_owned());
        let known: Vec<Vec<f64>> = settings.hidden.iter().map(|direction| free.of(direction)).collect();
        let shown_by_some = beside(&known, &scale);
        let known = if shown_by_some.is_some() { known } else { Vec::new() };
        let (narrow, whole) = match &shown_by_some {
            Some(basis) => (&factor * basis, Some(basis)),
            None => (factor, None),
        };
        let singular = Singular::new(&narrow, RANK);
        if singular.rank() == 0 {
            return Err(EstimateError::NoSignal);
        }
        let null = singular.null();
        let null = whole.map_or_else(|| null.clone(), |basis| basis * &null);
        let lost = null.column_iter().map(|column| column.iter().copied().collect()).collect();
        let lost = beside_known(&known, lost, &scale);
        self.hidden = known.into_iter().chain(lost).collect();
        let apart = set_apart(self.hidden.clone());
        self.kept = (0..n).filter(|at| apart.iter().all(|(own, _)| own != at)).map(|at| free.indices[at]).collect();
        Ok(())
    }

    /// Scales that nothing shows: parameters of rows without an input that no other row shares show in ratios alone.
    fn scale_free(&mut self, free: &Free) -> Result<(), EstimateError> {
        let lines = self.all_rows(&[])?;
        let noise = Noise::first(&lines, false);
        let n = self.kept.len();
        let factor = triangle(&lines, &noise.variance, &self.kept, self.right());
        let (factor, scale) = unit_columns(factor.view((0, 0), (n, n)).into_owned());
        let null = Singular::new(&factor, RANK).null();
        let lost = null.column_iter().map(|column| column.iter().copied().collect()).collect();
        let lost = beside_known(&[], lost, &scale);
        let apart: Vec<usize> = set_apart(lost.clone()).iter().map(|(own, _)| self.kept[*own]).collect();
        for direction in lost {
            let place = |j: &usize| self.kept.iter().position(|kept| kept == j);
            let of = |j: &usize| place(j).map_or(0.0, |at| direction[at]);
            self.hidden.push(free.indices.iter().map(of).collect());
        }
        self.kept.retain(|j| !apart.contains(j));
        if self.kept.is_empty() { Err(EstimateError::NoSignal) } else { Ok(()) }
    }

    /// First values: by the lines far above the noise; in rows without an input ratios first, which the other rows give a scale.
    fn start(&mut self, lines: &[RowLines], coefficients: &[Vec<Vec<f64>>]) -> Result<(), EstimateError> {
        let right = self.right();
        let highest: Vec<f64> = self.views.iter().map(|view| view.used).collect();
        let of = |rows: &[RowLines], columns: &[usize], highest: &[f64]| {
            let noise = Noise::first(rows, false);
            noise.found(rows, columns, right, None, Some(highest)).1
        };
        let known = |row: &RowLines| row.size(right) > 0.5 * KNOWN_SHARE * KNOWN_SHARE * row.force();
        let ratios: Vec<usize> = (0..lines.len()).filter(|&row| self.homogeneous(row) && !known(&lines[row])).collect();
        if ratios.is_empty() {
            let values = of(lines, &self.kept, &highest);
            self.kept.iter().for_each(|&j| self.theta[j] = values[j]);
            return Ok(());
        }
        let mut groups: Vec<Vec<f64>> = Vec::new();
        for &row in &ratios {
            groups.extend(
                leading(row, &coefficients[row]).and_then(|c| self.ratios(row, &lines[row], &coefficients[row][c])),
            );
        }
        let grouped = |j: usize| groups.iter().any(|group| group[j] != 0.0);
        let alone: Vec<usize> = self.kept.iter().copied().filter(|&j| !grouped(j)).collect();
        // The rows with inputs in terms of the scales of the groups and of the parameters that stand alone.
        let driven: Vec<usize> = (0..lines.len()).filter(|row| !ratios.contains(row)).collect();
        let condensed: Vec<RowLines> = driven
            .iter()
            .map(|&row| {
                let own = &lines[row];
                let mut columns = alone.clone();
                let mut entries: Vec<DVector<f64>> = alone.iter().map(|&j| own.column(j)).collect();
                for (g, group) in groups.iter().enumerate() {
                    let mut sum = DVector::zeros(2 * own.lines());
                    for (j, ratio) in group.iter().enumerate().filter(|(_, ratio)| **ratio != 0.0) {
                        sum.axpy(*ratio, &own.column(j), 1.0);
                    }
                    columns.push(right + g);
                    entries.push(sum);
                }
                columns.push(right + groups.len());
                entries.push(own.column(right));
                RowLines { columns, entries: DMatrix::from_columns(&entries), ..own.clone() }
            })
            .collect();
        for &j in &self.kept {
            self.theta[j] = 0.0;
        }
        let mut scales = vec![1.0; groups.len()];
        if !condensed.is_empty() {
            let columns: Vec<usize> = alone.iter().copied().chain((0..groups.len()).map(|g| right + g)).collect();
            let own: Vec<f64> = driven.iter().map(|&row| highest[row]).collect();
            let noise = Noise::first(&condensed, false);
            let values = noise.found(&condensed, &columns, right + groups.len(), None, Some(&own)).1;
            alone.iter().for_each(|&j| self.theta[j] = values[j]);
            let shared = |g: usize| condensed.iter().any(|row| row.size(right + g) > 0.0);
            for (g, scale) in scales.iter_mut().enumerate() {
                if shared(g) && values[right + g] != 0.0 {
                    *scale = values[right + g];
                }
            }
        }
        for (group, scale) in groups.iter().zip(&scales) {
            for (j, ratio) in group.iter().enumerate().filter(|(_, ratio)| **ratio != 0.0) {
                self.theta[j] += scale * ratio;
            }
        }
        Ok(())
    }

    /// The ratios that a row without an input shows, such that the mean coefficient of its leading acceleration is one.
    /// `coefficients` are those of that acceleration, one for every parameter.
    fn ratios(&self, row: usize, lines: &RowLines, coefficients: &[f64]) -> Option<Vec<f64>> {
        let present: Vec<usize> = self.kept.iter().copied().filter(|&j| lines.size(j) > 0.0).collect();
        let lead = present.iter().copied().max_by(|&a, &b| coefficients[a].abs().total_cmp(&coefficients[b].abs()));
        let lead = lead.filter(|&lead| coefficients[lead] != 0.0)?;
        let leading = lines.column(lead) / coefficients[lead];
        let others: Vec<usize> = present.iter().copied().filter(|&j| j != lead).collect();
        let mut entries: Vec<DVector<f64>> =
            others.iter().map(|&j| lines.column(j) - &leading * coefficients[j]).collect();
        entries.push(-&leading);
        let right = self.right();
        let mut columns = others.clone();
        columns.push(right);
        let row_of = RowLines { columns, entries: DMatrix::from_columns(&entries), ..lines.clone() };
        let rows = [row_of];
        let values = Noise::first(&rows, false).found(&rows, &others, right, None, Some(&[self.views[row].used])).1;
        let mut ratios = vec![0.0; coefficients.len()];
        others.iter().for_each(|&j| ratios[j] = values[j]);
        ratios[lead] = (1.0 - others.iter().map(|&j| coefficients[j] * values[j]).sum::<f64>()) / coefficients[lead];
        Some(ratios)
    }

    /// Divides the columns of every term by the largest of its root mean squares.
    fn scale_terms(&mut self) {
        self.sizes = (0..self.terms.len())
            .map(|i| {
                let mut sums = vec![(0.0, 0usize); self.rows.model.dims().rows];
                for (row, values) in self.columns.iter().flat_map(|columns| &columns[i]) {
                    sums[*row].0 += values.iter().map(|x| x * x).sum::<f64>();
                    sums[*row].1 += values.len();
                }
                let largest = sums.iter().map(|(sum, count)| sum / (*count).max(1) as f64).fold(0.0, f64::max).sqrt();
                if largest > 0.0 && largest.is_finite() { largest } else { 1.0 }
            })
            .collect();
        for columns in &mut self.columns {
            for (own, size) in columns.iter_mut().zip(&self.sizes) {
                own.iter_mut().flat_map(|(_, values)| values).for_each(|x| *x /= size);
            }
        }
    }

    /// The noise that the sensors add to every line.
    fn set_floors(&mut self, felt: &Felt) {
        let h = self.paths.sample_time;
        for (j, row) in self.lines.iter_mut().enumerate() {
            let view = self.views[j];
            for (floor, f) in row.floor.iter_mut().zip(&row.frequency) {
                let w = 2.0 * std::f64::consts::PI * f;
                *floor = felt.noise(j, &self.paths.measured, w, h) * view.low_pass.response(w).powi(2);
            }
        }
    }

    /// Frequencies up to which the coordinates are taken, Hz, where the noise of the forces allows more than their own noise, and zero for
    /// others: nothing where it does so for none, or where more is taken already.
    fn wider(&self) -> Result<Option<Vec<f64>>, EstimateError> {
        let Some(felt) = self.felt.as_ref().filter(|_| self.taken.iter().all(|taken| *taken <= 0.0)) else {
            return Ok(None);
        };
        let noise = Noise::first(&self.lines, true).found(&self.lines, &self.kept, self.right(), None, None).0;
        let of_forces: Vec<f64> = (self.lines.iter().zip(&noise.variance))
            .map(|(row, variance)| {
                let last = row.bands().saturating_sub(1);
                let own =
                    row.band.iter().zip(variance).filter(|(band, _)| **band == last).map(|(_, variance)| *variance);
                own.fold(f64::INFINITY, f64::min)
            })
            .collect();
        let (h, measured) = (self.paths.sample_time, &self.paths.measured);
        let of = |c: usize| {
            let own = &measured[c].spectrum;
            let rows: Vec<usize> = (0..of_forces.len()).filter(|&row| felt.feels(row, c)).collect();
            let hidden = |f: &f64| {
                let w = 2.0 * std::f64::consts::PI * f;
                rows.iter().all(|&row| felt.noise_of(row, c, measured, w, h) < HIDDEN * of_forces[row])
            };
            let most = (WIDEST * own.followed).min(HIGHEST / h);
            let tried = std::iter::successors(Some(most), |f| Some(f / FINER)).take_while(|f| *f > own.used);
            tried.into_iter().find(hidden).unwrap_or(0.0)
        };
        let taken: Vec<f64> = (0..measured.len()).map(of).collect();
        Ok(taken.iter().any(|taken| *taken > 0.0).then_some(taken))
    }

    /// Largest share of the full width that the notches of a row need: what is left of the row in the times that a narrower one would
    /// leave, besides, is no larger there than elsewhere. `columns` are those of the covariance.
    fn needed_notch(
        &self,
        row: usize,
        (values, missing): (&[f64], &[f64]),
        (columns, covariance): (&[usize], &DMatrix<f64>),
    ) -> Result<f64, EstimateError> {
        let view = self.views[row];
        let (p, right) = (self.rows.model.dims().parameters, self.right());
        let signals = self.signals(row, missing)?.0;
        let Some(factor) = Cholesky::new(covariance.clone()) else { return Ok(view.notch) };
        let lower = factor.l();
        // Of every share: squares in the times that it adds to those of the full width, what parameters make of them, and their number.
        let mut added: Vec<(f64, Sums)> = Vec::new();
        let mut kept = Sums::default();
        for (path, signals) in self.paths.paths.iter().zip(&signals) {
            let Some((valid, masks)) = view.left_by_notches(path) else { return Ok(view.notch) };
            let Some(widest) = masks.iter().rev().map(|(_, mask)| mask).find(|mask| is_enough(mask)) else { continue };
            let mut left = vec![0.0; path.points];
            let mut spread = DMatrix::<f64>::zeros(columns.len(), path.points);
            for (number, signal) in signals {
                let passed = view.passed(path, signal);
                let factor = match *number {
                    j if j == right => 1.0,
                    j if j < p => -values[j],
                    j => -missing[j - p],
                };
                left.iter_mut().zip(&passed).for_each(|(sum, x)| *sum += factor * x);
                if let Some(at) = columns.iter().position(|column| column == number) {
                    spread.row_mut(at).copy_from_slice(&passed);
                }
            }
            let spread = lower.tr_mul(&spread);
            let rate = 2.0 * path.apart * view.low_pass.cut_off / (2.0 * std::f64::consts::PI);
            let at = |i: usize| {
                let k = valid.start + i;
                Sums { squares: left[k].powi(2), spread: spread.column(k).norm_squared(), points: 1.0, equations: rate }
            };
            let chosen = |mask: &dyn Fn(usize) -> bool| {
                (0..valid.len()).filter(|&i| mask(i)).map(at).fold(Sums::default(), Sums::and)
            };
            kept = kept.and(chosen(&|i| widest[i]));
            for (place, (share, mask)) in masks.iter().enumerate() {
                let own = chosen(&|i| mask[i] && !widest[i]);
                match added.get_mut(place) {
                    Some((_, sums)) => *sums = sums.and(own),
                    None => added.push((*share, own)),
                }
            }
        }
        let noise = (kept.squares + kept.spread) / kept.points.max(1.0);
        let alike = |(_, own): &&(f64, Sums)| {
            let expected = own.points * noise + own.spread;
            let chance = (2.0 / own.equations.max(1.0) + 2.0 / kept.equations.max(1.0)).sqrt();
            own.squares <= (1.0 + ALIKE * chance) * expected
        };
        Ok(added.iter().find(alike).map_or(view.notch, |(share, _)| *share))
    }

    /// Noise and components in turn, from a noise on.
    fn weigh(&mut self, asked: &Asked, mut noise: Noise) -> Result<Weighed, EstimateError> {
        let (p, right) = (self.rows.model.dims().parameters, self.right());
        let ratios = self.leading.iter().any(Option::is_some);
        let passes = PASSES + if ratios { MORE_PASSES } else { 0 };
        for _ in 0..passes {
            let split = Split::new(&triangle(&self.lines, &noise.variance, &asked.all, right), asked.fixed.len());
            let products = Products::of(&split.candidates, &split.target);
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
        let split = Split::new(&triangle(&self.lines, &noise.variance, &asked.all, right), asked.fixed.len());
        let products = Products::of(&split.candidates, &split.target);
        let found = Components::found(&products, asked.threshold);
        let common = found.common(&split.candidates, &split.target, &split.counts);
        let whole = |(own, counts): (&f64, &bool)| own + if *counts { common } else { 0.0 };
        let variance: Vec<f64> = found.variance.iter().zip(&split.counts).map(whole).collect();
        let solved = split.solve(&variance).ok_or(EstimateError::NoSignal)?;
        let active = found.active().collect();
        Ok(Weighed { noise, variance, active, solved, split })
    }

    /// The lines of some rows, which keep their floors.
    fn rows_anew(&mut self, rows: &[usize], missing: &[f64]) -> Result<(), EstimateError> {
        for &row in rows {
            if let Some(lines) = self.row(row, missing)? {
                self.lines[row] = RowLines { floor: self.lines[row].floor.clone(), ..lines };
            }
        }
        Ok(())
    }

    /// Values of all parameters, and of all terms.
    fn values(&self, asked: &Asked, solved: &Solved) -> (Vec<f64>, Vec<f64>) {
        let (p, kept) = (self.rows.model.dims().parameters, self.kept.len());
        let mut values = self.theta.clone();
        self.kept.iter().zip(solved.values.iter()).for_each(|(&j, value)| values[j] = *value);
        let mut missing = vec![0.0; self.terms.len()];
        asked.terms.iter().zip(solved.missing.iter()).for_each(|(&column, value)| missing[column - p] = *value);
        let late = asked.fixed.iter().zip(solved.values.iter()).skip(kept);
        late.for_each(|(&column, value)| missing[column - p] = *value);
        (values, missing)
    }

    /// What is asked of the lines; a delay that was applied is a parameter.
    fn asked(&self, late: &[bool]) -> Asked {
        let p = self.rows.model.dims().parameters;
        let is_late = |i: usize| self.terms[i].kind == TermKind::Delay && late[self.terms[i].of];
        let own = (0..self.terms.len()).filter(|&i| is_late(i)).map(|i| p + i);
        let fixed: Vec<usize> = self.kept.iter().copied().chain(own).collect();
        let terms: Vec<usize> = (0..self.terms.len()).filter(|&i| !is_late(i)).map(|i| p + i).collect();
        let all = fixed.iter().chain(&terms).copied().collect();
        let threshold = alarm::squared_normal(alarm::MISSING_COMPONENT_RATE, terms.len());
        Asked { fixed, terms, all, threshold }
    }

    /// Values, deviations and missing terms.
    fn fit(mut self, free: &Free, late: &[bool]) -> Result<Outcome, EstimateError> {
        let dims = self.rows.model.dims();
        let (p, right) = (dims.parameters, self.right());
        let asked = self.asked(late);
        // With all candidates a misfit is not taken for noise at first; where they are too many for the record, the model alone tells.
        let independent: f64 = self.lines.iter().map(|row| 2.0 * row.lines() as f64 / row.correlation).sum();
        let many = independent < LEAST_EQUATIONS * asked.all.len() as f64;
        let first = if many { &asked.fixed } else { &asked.all };
        let noise = Noise::first(&self.lines, true).found(&self.lines, first, right, None, None).0;
        let mut weighed = self.weigh(&asked, noise)?;
        let (values, missing) = self.values(&asked, &weighed.solved);
        let of_parameters = (asked.fixed.as_slice(), &weighed.solved.covariance);
        let narrower: Vec<usize> = (0..dims.rows)
            .map(|row| Ok((row, self.needed_notch(row, (&values, &missing), of_parameters)?)))
            .collect::<Result<Vec<_>, EstimateError>>()?
            .into_iter()
            .filter_map(|(row, notch)| {
                (notch < self.views[row].notch).then(|| {
                    self.views[row].notch = notch;
                    row
                })
            })
            .collect();
        if !narrower.is_empty() {
            self.rows_anew(&narrower, &missing)?;
            weighed = self.weigh(&asked, weighed.noise)?;
        }
        let (values, missing) = self.values(&asked, &weighed.solved);
        let Weighed { noise, variance, active, solved, split } = weighed;
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
            let (term, size) = (self.terms[column - p], self.sizes[column - p]);
            let gain = self.gain(column, value, (&values, &missing));
            Lacking { term, value: value / size, std: std / size, gain }
        };
        let mut lacking: Vec<(f64, Lacking)> = Vec::new();
        for (a, &i) in active.iter().enumerate() {
            let spread = (solved.of_terms[i]).max(by_lines[fixed.len() + a]);
            let value = solved.missing[i];
            let shown = value * value / spread.max(f64::MIN_POSITIVE);
            if shown > threshold && self.share(terms[i], value) > LEAST_SHARE {
                lacking.push((shown, named(terms[i], (value, spread.sqrt()))));
            }
        }
        let mut delays: Vec<(Term, f64)> = lacking
            .iter()
            .filter(|(shown, own)| own.term.kind == TermKind::Delay && *shown > DELAY_SHOWN)
            .map(|(_, own)| (own.term, own.value))
            .collect();
        for (a, &column) in fixed.iter().enumerate().skip(kept) {
            let (term, size) = (self.terms[column - p], self.sizes[column - p]);
            delays.push((term, solved.values[a] / size));
            let whole = self.delays[term.of] * size + solved.values[a];
            lacking.push((f64::INFINITY, named(column, (whole, covariance[(a, a)].max(0.0).sqrt()))));
        }
        lacking.sort_by(|a, b| b.0.total_cmp(&a.0));
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
        let verdict = Verdict::new(free, &touched, &values, &whole, |j, std| felt[j] * std);
        let mut condition = split.parameters.view((0, 0), (kept, kept)).into_owned();
        condition = unit_columns(condition).0;
        let condition = tpm_numerics::singular::condition(&condition, RANK);
        let estimate = Estimate {
            values,
            std: verdict.std,
            covariance: Matrix::of(whole),
            status: verdict.status,
            rank: kept,
            unobservable: self.hidden.iter().map(|direction| free.spread(direction)).collect(),
            condition,
            residual: root_mean_square(row_residuals.iter().copied()),
            residual_of: ResidualOf::Force,
            chi_squared: 1.0,
            model_error: vec![0.0; dims.rows],
        };
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
            result: OfAnyMotion {
                estimate,
                other_hold,
                typical_period: self.motion.typical_period / self.paths.sample_time,
                reach: crate::time_domain::band::reach(followed, self.paths.sample_time),
                steps: self.motion.steps.clone(),
                lacking: lacking.into_iter().map(|(_, own)| own).collect(),
                report,
                felt,
            },
            delays,
        })
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
        let mut gram = matrix.tr_mul(&matrix);
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
        let inputs = self.paths.held_otherwise(self.record, self.motion, other, &self.delays);
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

/// The coordinate whose acceleration leads a row, given the coefficients of all of them: the row's own, or the one of the largest.
fn leading(row: usize, coefficients: &[Vec<f64>]) -> Option<usize> {
    let size = |c: usize| coefficients[c].iter().map(|a| a.abs()).fold(0.0, f64::max);
    let own = (row < coefficients.len() && size(row) > 0.0).then_some(row);
    let largest = || (0..coefficients.len()).filter(|&c| size(c) > 0.0).max_by(|&a, &b| size(a).total_cmp(&size(b)));
    own.or_else(largest)
}

/// The triangle of the weighted equations, parameters first and candidates behind them.
struct Split {
    /// R_Y.
    parameters: DMatrix<f64>,
    /// R_F.
    mixed: DMatrix<f64>,
    /// R2, with columns that others span set to zero.
    candidates: DMatrix<f64>,
    /// z1.
    of_parameters: DVector<f64>,
    /// z2.
    target: DVector<f64>,
    /// Which candidates say something of their own.
    counts: Vec<bool>,
}

/// Values and covariance given the variances of the candidates.
struct Solved {
    values: DVector<f64>,
    covariance: DMatrix<f64>,
    missing: DVector<f64>,
    /// Variance of every candidate's coefficient given the record.
    of_terms: Vec<f64>,
}

impl Split {
    fn new(factor: &DMatrix<f64>, p: usize) -> Self {
        let last = factor.ncols() - 1;
        let terms = last - p;
        let mixed = factor.view((0, p), (p, terms)).into_owned();
        let mut candidates = factor.view((p, p), (terms, terms)).into_owned();
        let counts: Vec<bool> = (0..terms)
            .map(|i| {
                let own = candidates.column(i).norm();
                let whole = own.hypot(mixed.column(i).norm());
                own > SPANNED * whole && own > 0.0
            })
            .collect();
        for (mut column, counts) in candidates.column_iter_mut().zip(&counts) {
            if !counts {
                column.fill(0.0);
            }
        }
        Split {
            parameters: factor.view((0, 0), (p, p)).into_owned(),
            mixed,
            candidates,
            of_parameters: factor.view((0, last), (p, 1)).column(0).into_owned(),
            target: factor.view((p, last), (terms, 1)).column(0).into_owned(),
            counts,
        }
    }

    fn solve(&self, variance: &[f64]) -> Option<Solved> {
        let (p, n) = (self.parameters.ncols(), self.target.len());
        let scaled = DMatrix::from_fn(n, n, |r, c| self.candidates[(r, c)] * variance[c].sqrt());
        let whole = DMatrix::identity(n, n) + &scaled * scaled.transpose();
        let factor = Cholesky::new(whole)?;
        // R2 Gamma.
        let through = DMatrix::from_fn(n, n, |r, c| self.candidates[(r, c)] * variance[c]);
        let missing = through.tr_mul(&factor.solve(&self.target));
        let of_terms =
            DMatrix::from_diagonal(&DVector::from_column_slice(variance)) - through.tr_mul(&factor.solve(&through));
        let mut values = &self.of_parameters - &self.mixed * &missing;
        let mut inverse = DMatrix::identity(p, p);
        let mut moved = self.mixed.clone();
        let regular = self.parameters.solve_upper_triangular_mut(&mut values)
            && self.parameters.solve_upper_triangular_mut(&mut inverse)
            && self.parameters.solve_upper_triangular_mut(&mut moved);
        let covariance = &inverse * inverse.transpose() + &moved * &of_terms * moved.transpose();
        let finite = values.iter().chain(covariance.iter()).all(|x| x.is_finite());
        (regular && finite).then(|| Solved {
            values,
            covariance,
            missing,
            of_terms: of_terms.diagonal().iter().map(|v| v.max(0.0)).collect(),
        })
    }
}
