//! Identifiability of the parameters of a model without an exact harmonic table under given patterns: rank,
//! unobservable directions and base parameters in floating point, from the rows along the pattern.
//!
//! The harmonics of the regressors are computed at several settings of amplitudes, frequency and constants; values that
//! are not stated are drawn at random. The largest rank counts, as for exact tables
//! ([`tpm_symbolic::harmonic::identifiability`]). A coordinate without a prescribed motion is computed from its rows
//! without an input, for stated or drawn values of the parameters.
//!
//! Invariant: a direction counts as unobservable when the scaled harmonics along it are no larger than the numerical
//! error. The error is measured by computing the harmonics from half of the samples as well. A coefficient is written
//! as a rational number only when it has the same value at every setting.

use crate::content::{EntryContent, entries_along, showing};
use crate::report::{Means, Report, ReportedBase, ReportedParameter, ReportedRow, SCHEMA};
use num_complex::Complex;
use std::collections::BTreeMap;
use tpm_controller::model::{EvalError, Model};
use tpm_interpret::Interpreted;
use tpm_motion::trajectory::{PatternError, Trajectory};
use tpm_motion::{CompletionError, OpenReason, complete};
use tpm_numerics::fourier::analyse;
use tpm_numerics::singular::{Singular, unit_columns};
use tpm_numerics::{DMatrix, DVector, tolerance};
use tpm_report::number;
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::algebra::generic_point;
use tpm_symbolic::budget;
use tpm_symbolic::harmonic::identifiability::PhysicalIdentifiability;
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::number::rational::to_f64;
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::Prepared;

/// Number of samples in a period.
const SAMPLES: usize = 1 << 13;
/// Number of samples that show the harmonics of smooth rows, whose coefficients fall faster than any power.
const FEW: usize = 1 << 10;
/// The highest harmonic that every second sample shows.
const MOST_HARMONICS: usize = SAMPLES / 4 - 1;
/// Number of samples that are averaged over the interval around a sample at which an entry jumps.
const INNER: usize = 64;
/// Smallest change of an entry within one interval (a thousandth of a radian) that counts as a jump, as a share of the
/// entry's root mean square.
const JUMP: f64 = 0.05;
/// Number of settings that are compared.
const SETTINGS: usize = 3;
/// Factors on the drawn amplitudes, tried in this order: a square root or an inverse sine may not exist at large
/// amplitudes.
const SHARES: [f64; 2] = [1.0, 0.1];
/// Safety factor on the measured error.
const SAFETY: f64 = 4.0;
/// Smallest leverage (diagonal entry of the hat matrix) at which a row may lack redundancy; it is one for a row without
/// any.
const LEVERAGE: f64 = 0.9;
/// Largest denominator of a coefficient that is written as a rational number.
const LARGEST_DENOMINATOR: u32 = 60;

/// A pattern to be played, with the values that are stated.
#[derive(Clone, Debug)]
pub struct PlayedPattern<'a> {
    /// A name for reports.
    pub name: String,
    /// The pattern.
    pub pattern: &'a Pattern,
    /// Stated values of amplitudes, frequency, run-time constants and physical parameters; the others are drawn.
    pub values: BTreeMap<String, f64>,
    /// The highest harmonic that is used.
    pub harmonics: usize,
}

/// Why a pattern cannot be analysed in floating point.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NumericalError {
    /// The pattern cannot be played.
    #[error(transparent)]
    Pattern(#[from] PatternError),
    /// The model refused an evaluation.
    #[error("the model cannot be evaluated: {0}")]
    Model(#[from] EvalError),
    /// A value is stated for a symbol that neither the pattern nor the model has.
    #[error(
        "experiment `{experiment}` gives a value for `{symbol}`, which is not an amplitude, a frequency or a constant of the model"
    )]
    UnknownSymbol {
        /// The experiment.
        experiment: String,
        /// The symbol.
        symbol: String,
    },
    /// Harmonics are asked for that the samples of a period do not show.
    #[error(
        "without a table, the harmonics are found from samples that show them up to {most}, and {asked} are asked for; lower `harmonics` of the pattern, or the highest harmonic that is asked for, to {most} or less"
    )]
    Harmonics {
        /// The harmonics that are asked for.
        asked: usize,
        /// The highest that the samples show.
        most: usize,
    },
    /// A term is not finite along the pattern at any setting.
    #[error("the rows are not finite along the pattern; state amplitudes at which they are")]
    NotFinite,
    /// The motion of a coordinate without a pattern was not found at any setting.
    #[error("the pattern leaves `{coordinate}` open: {reason}")]
    Open {
        /// The coordinate.
        coordinate: String,
        /// Why its motion was not found at the last setting.
        reason: OpenReason,
    },
}

/// Identifiability of the parameters, and of the physical parameters behind them, from several patterns together.
///
/// # Errors
/// [`NumericalError`] when a pattern cannot be played, a stated value has no symbol, or no setting gives finite rows.
pub fn numerical_identifiability(
    prepared: &Prepared,
    patterns: &[PlayedPattern<'_>],
) -> Result<(Report, PhysicalIdentifiability), NumericalError> {
    if let Some(asked) = patterns.iter().map(|played| played.harmonics).max().filter(|&most| most > MOST_HARMONICS) {
        return Err(NumericalError::Harmonics { asked, most: MOST_HARMONICS });
    }
    let model = Interpreted::new(&prepared.model, &prepared.form);
    let map = ParameterMap::new(prepared);
    let mut settings: Vec<Setting> = Vec::new();
    let mut fault = NumericalError::NotFinite;
    for number in 0..SETTINGS {
        for share in SHARES {
            let symbols = Symbols::new(prepared, &map, patterns, number, share)?;
            match Harmonics::new(prepared, &map, &model, patterns, &symbols) {
                Ok(harmonics) => {
                    settings.push(Setting::new(&map, symbols, harmonics));
                    break;
                }
                // The rows may be finite at another setting.
                Err(reason @ (NumericalError::NotFinite | NumericalError::Open { .. })) => fault = reason,
                Err(other) => return Err(other),
            }
        }
        // A motion whose harmonics do not fade out hardly fades with other values; where two settings find none at any share for another
        // reason, further ones hardly do. Each takes as long.
        let is_hopeless = match &fault {
            NumericalError::Open { reason: OpenReason::Harmonics { .. }, .. } => true,
            NumericalError::Open { .. } => number > 0,
            _ => false,
        };
        if settings.is_empty() && is_hopeless {
            break;
        }
    }
    // Of the settings with the largest rank, the first is reported.
    let best = settings.iter().rev().max_by_key(|setting| setting.rank()).ok_or(fault)?;
    let alike: Vec<&Setting> = settings.iter().filter(|other| other.free() == best.free()).collect();
    let contents = contents(prepared, &model, &best.harmonics, &best.symbols);
    Ok((best.report(&model, patterns, &alike, &contents), best.physical.clone()))
}

/// Harmonics of the regressor's entries with bounds of their errors, by pattern.
fn contents(
    prepared: &Prepared,
    model: &Interpreted,
    harmonics: &Harmonics,
    symbols: &Symbols,
) -> Vec<Vec<EntryContent>> {
    let of = |(trajectory, values): (&Trajectory, &BTreeMap<String, f64>)| {
        entries_along(prepared, model, trajectory, |name| values.get(name).copied())
    };
    harmonics.trajectories.iter().zip(&symbols.values).map(of).collect()
}

/// The values of all symbols at one setting.
struct Symbols {
    /// Names and values of the drawn symbols.
    drawn: Vec<(String, f64)>,
    /// Values of all symbols by name, for every pattern.
    values: Vec<BTreeMap<String, f64>>,
    /// Values of the physical parameters by name.
    physical: BTreeMap<String, f64>,
}

/// A random value between 0.5 and 1.5 with few digits, so that a user can state it again.
fn drawn_value(setting: usize, index: usize) -> f64 {
    let random = to_f64(&generic_point::value(setting as u64, index)) / f64::from(1_u32 << 31);
    ((0.5 + random) * 1000.0).round() / 1000.0
}

impl Symbols {
    fn new(
        prepared: &Prepared,
        map: &ParameterMap,
        patterns: &[PlayedPattern<'_>],
        setting: usize,
        share: f64,
    ) -> Result<Self, NumericalError> {
        let model = &prepared.model;
        let name = |symbol| model.quantity(symbol).name.to_string();
        let mut drawn: Vec<(String, f64)> = Vec::new();
        let mut values = Vec::with_capacity(patterns.len());
        for (at, played) in patterns.iter().enumerate() {
            let amplitudes: Vec<String> = played.pattern.amplitudes.iter().map(|&symbol| name(symbol)).collect();
            let constants: Vec<String> = model.run_time_constants().map(name).collect();
            let frequency = [name(played.pattern.frequency)];
            let mut own = BTreeMap::new();
            for symbol in amplitudes.iter().chain(&frequency).chain(&constants) {
                let shared = at == 0 || constants.contains(symbol);
                let label = if shared { symbol.clone() } else { format!("{symbol}[{}]", at + 1) };
                let value = match (played.values.get(symbol), drawn.iter().find(|(known, _)| *known == label)) {
                    (Some(value), _) | (None, Some((_, value))) => *value,
                    (None, None) => {
                        let value = drawn_value(setting, drawn.len());
                        let value = if amplitudes.contains(symbol) { share * value } else { value };
                        drawn.push((label, value));
                        value
                    }
                };
                own.insert(symbol.clone(), value);
            }
            let is_parameter = |symbol: &str| map.parameters().iter().any(|p| map.name(*p) == symbol);
            if let Some(symbol) =
                played.values.keys().find(|symbol| !own.contains_key(*symbol) && !is_parameter(symbol))
            {
                let (experiment, symbol) = (played.name.clone(), symbol.clone());
                return Err(NumericalError::UnknownSymbol { experiment, symbol });
            }
            values.push(own);
        }
        let physical = map.parameters().iter().enumerate().map(|(index, &parameter)| {
            let name = map.name(parameter);
            let stated = patterns.iter().find_map(|played| played.values.get(name).copied());
            // The indices differ from those of the symbols, so that the random values differ too.
            (name.to_string(), stated.unwrap_or_else(|| drawn_value(setting, 1000 + index)))
        });
        Ok(Symbols { drawn, values, physical: physical.collect() })
    }

    /// The value of a physical parameter or a constant.
    fn value(&self, name: &str) -> f64 {
        let constant = || self.values.first().and_then(|values| values.get(name));
        self.physical.get(name).or_else(constant).copied().unwrap_or(1.0)
    }
}

/// The harmonics of the regressors at one setting: one row per harmonic, one column per parameter.
struct Harmonics {
    rows: Vec<HarmonicRow>,
    /// From all samples (`fine`), and from every second one (`coarse`).
    fine: DMatrix<f64>,
    coarse: DMatrix<f64>,
    /// Root mean square of the samples of the entry to which each harmonic belongs.
    sizes: DMatrix<f64>,
    /// Whether the motion depends on the values of the parameters, since a coordinate was open.
    completed: bool,
    /// The motion of every pattern.
    trajectories: Vec<Trajectory>,
}

/// Identity of a row: pattern, equation, harmonic, and cosine or sine.
#[derive(Clone, Copy, Debug)]
struct HarmonicRow {
    pattern: usize,
    equation: usize,
    harmonic: usize,
    function: Trig,
}

impl Harmonics {
    fn new(
        prepared: &Prepared,
        map: &ParameterMap,
        model: &Interpreted,
        patterns: &[PlayedPattern<'_>],
        symbols: &Symbols,
    ) -> Result<Self, NumericalError> {
        let dims = Model::<f64>::dims(model);
        let mut rows = Vec::new();
        for (pattern, played) in patterns.iter().enumerate() {
            for equation in 0..dims.rows {
                for harmonic in 0..=played.harmonics {
                    let functions: &[Trig] = if harmonic == 0 { &[Trig::Cos] } else { &[Trig::Cos, Trig::Sin] };
                    rows.extend(functions.iter().map(|&function| HarmonicRow {
                        pattern,
                        equation,
                        harmonic,
                        function,
                    }));
                }
            }
        }
        let empty = || DMatrix::zeros(rows.len(), dims.parameters);
        let (mut fine, mut coarse, mut sizes) = (empty(), empty(), empty());
        let (mut at, mut completed) = (0, false);
        let mut trajectories = Vec::with_capacity(patterns.len());
        for (played, values) in patterns.iter().zip(&symbols.values) {
            let value = |name: &str| values.get(name).copied();
            let reference = tpm_interpret::pattern::of_rows(played.pattern, &prepared.model, &prepared.form, value)?;
            let of = |name: &str| value(name).unwrap_or(0.0);
            let amplitudes: Vec<f64> = reference.amplitudes.iter().map(|name| of(name)).collect();
            let constants: Vec<f64> = (0..dims.constants).map(|i| of(Model::<f64>::constant(model, i).name)).collect();
            let mut trajectory = reference.trajectory(&amplitudes, of(&reference.frequency));
            let open = reference.open();
            if let Some(&first) = open.first() {
                completed = true;
                let parameters = map.evaluate(|symbol| symbols.value(map.name(symbol)));
                complete(model, &mut trajectory, &open, &parameters, &constants).map_err(|fault| match fault {
                    CompletionError::Evaluation(source) => NumericalError::Model(source),
                    CompletionError::Open(reason) => {
                        let coordinate = Model::<f64>::coordinate(model, first).name.to_string();
                        NumericalError::Open { coordinate, reason }
                    }
                })?;
            }
            let size = dims.regressor_len();
            let found = |samples: Samples| -> Result<Vec<EntryHarmonics>, NumericalError> {
                if samples.values.iter().any(|value| !value.is_finite()) {
                    return Err(NumericalError::NotFinite);
                }
                Ok((0..size).map(|entry| EntryHarmonics::new(&samples, entry, size, played.harmonics)).collect())
            };
            let mut entries = Vec::new();
            if played.harmonics < FEW / 4 {
                entries = found(Samples::smooth(model, &constants, &trajectory)?)?;
            }
            if entries.is_empty() || !entries.iter().all(EntryHarmonics::is_settled) {
                entries = found(Samples::new(model, &constants, &trajectory)?)?;
            }
            for (entry, EntryHarmonics { whole, half, size }) in entries.into_iter().enumerate() {
                let (equation, column) = (entry / dims.parameters, entry % dims.parameters);
                let first = at + equation * (2 * played.harmonics + 1);
                for (k, (whole, half)) in whole.iter().zip(&half).enumerate() {
                    for (part, fine_part, coarse_part) in [(0, whole.re, half.re), (1, whole.im, half.im)] {
                        if k == 0 && part == 1 {
                            continue;
                        }
                        let row = if k == 0 { first } else { first + 2 * k - 1 + part };
                        // The imaginary part of a phasor is minus the coefficient of the sine.
                        let sign = if part == 0 { 1.0 } else { -1.0 };
                        fine[(row, column)] = sign * fine_part;
                        coarse[(row, column)] = sign * coarse_part;
                        sizes[(row, column)] = size;
                    }
                }
            }
            at += dims.rows * (2 * played.harmonics + 1);
            trajectories.push(trajectory);
        }
        Ok(Harmonics { rows, fine, coarse, sizes, completed, trajectories })
    }
}

/// The entries of the regressor matrix at the samples of a period. Where an entry jumps, a sample is the mean over its
/// interval, so that harmonics do not depend on the place of the jump within the interval.
struct Samples {
    values: Vec<f64>,
    /// Every second sample, from which the error of the harmonics is computed.
    every_second: Vec<f64>,
}

/// The harmonics of one entry from all samples and from half of them, and the root mean square of its samples.
struct EntryHarmonics {
    whole: Vec<Complex<f64>>,
    half: Vec<Complex<f64>>,
    size: f64,
}

impl EntryHarmonics {
    fn new(samples: &Samples, entry: usize, size: usize, harmonics: usize) -> Self {
        let square: f64 = samples.values.iter().skip(entry).step_by(size).map(|value| value * value).sum();
        Self {
            whole: analyse(&samples.values, entry, size, harmonics),
            half: analyse(&samples.every_second, entry, size, harmonics),
            size: (square / (samples.values.len() / size) as f64).sqrt(),
        }
    }

    /// Whether half of the samples say the same.
    fn is_settled(&self) -> bool {
        let mut both = self.whole.iter().zip(&self.half);
        both.all(|(whole, half)| (whole - half).norm() <= tolerance::FORCE * self.size)
    }
}

impl Samples {
    /// Few samples, for rows without jumps.
    fn smooth(model: &Interpreted, constants: &[f64], trajectory: &Trajectory) -> Result<Self, EvalError> {
        let dims = Model::<f64>::dims(model);
        let size = dims.regressor_len();
        charge(model, FEW);
        let mut scratch = vec![0.0; Model::<f64>::workspace_len(model)];
        let mut motion = vec![0.0; dims.motion_len()];
        let mut values = vec![0.0; FEW * size];
        for (n, out) in values.chunks_exact_mut(size.max(1)).enumerate() {
            trajectory.motion_at(n, FEW, 0.0, &mut motion);
            model.regressor(&motion, constants, &mut scratch, out)?;
        }
        let every_second = values.chunks_exact(size.max(1)).step_by(2).flatten().copied().collect();
        Ok(Self { values, every_second })
    }

    fn new(model: &Interpreted, constants: &[f64], trajectory: &Trajectory) -> Result<Self, EvalError> {
        charge(model, 2 * SAMPLES);
        let dims = Model::<f64>::dims(model);
        let size = dims.regressor_len();
        let mut scratch = vec![0.0; Model::<f64>::workspace_len(model)];
        let mut motion = vec![0.0; dims.motion_len()];
        let mut evaluate = |n: usize, advance: f64, out: &mut [f64]| {
            trajectory.motion_at(n, SAMPLES, advance, &mut motion);
            model.regressor(&motion, constants, &mut scratch, out)
        };
        let mut values = vec![0.0; SAMPLES * size];
        for (n, out) in values.chunks_exact_mut(size.max(1)).enumerate() {
            evaluate(n, 0.0, out)?;
        }
        let mut square = vec![0.0; size];
        for out in values.chunks_exact(size.max(1)) {
            for (square, value) in square.iter_mut().zip(out) {
                *square += value * value / SAMPLES as f64;
            }
        }
        let mut jumps = vec![false; SAMPLES];
        let (mut before, mut after, mut inner) = (vec![0.0; size], vec![0.0; size], vec![0.0; size]);
        evaluate(0, -0.5, &mut before)?;
        for (n, out) in values.chunks_exact_mut(size.max(1)).enumerate() {
            evaluate(n, 0.5, &mut after)?;
            let changes = before.iter().zip(&after).zip(&square);
            if changes.into_iter().any(|((before, after), square)| (after - before).abs() > JUMP * square.sqrt()) {
                jumps[n] = true;
                charge(model, INNER);
                out.fill(0.0);
                for part in 0..INNER {
                    evaluate(n, (part as f64 + 0.5) / INNER as f64 - 0.5, &mut inner)?;
                    for (sum, value) in out.iter_mut().zip(&inner) {
                        *sum += value / INNER as f64;
                    }
                }
            }
            before.copy_from_slice(&after);
        }
        let mut every_second = Vec::with_capacity(SAMPLES / 2 * size);
        for n in (0..SAMPLES).step_by(2) {
            let around = [(n + SAMPLES - 1) % SAMPLES, n, (n + 1) % SAMPLES];
            let at = |n: usize, entry: usize| values[n * size + entry];
            let near_jump = around.iter().any(|&n| jumps[n]);
            every_second.extend((0..size).map(|entry| {
                let [before, here, after] = around.map(|n| at(n, entry));
                // The mean over an interval of twice the length, which is that of a grid with half as many samples.
                if near_jump { 0.25 * before + 0.5 * here + 0.25 * after } else { here }
            }));
        }
        Ok(Samples { values, every_second })
    }
}

/// Charges the budget for evaluations of the rows.
fn charge(model: &Interpreted, evaluations: usize) {
    let each = Model::<f64>::workspace_len(model) as u64;
    budget::within(
        || format!("the rows along the pattern, {evaluations} times {each} operations"),
        || budget::charge(each.saturating_mul(evaluations as u64)),
    );
}

/// The results at one setting.
struct Setting {
    symbols: Symbols,
    harmonics: Harmonics,
    scaled: Scaled,
    /// The unobservable directions in echelon form, each with its free column: one in this column, zero in the free
    /// columns of the others.
    directions: Vec<(usize, Vec<f64>)>,
    physical: PhysicalIdentifiability,
}

/// The matrix of harmonics after scaling of rows and columns.
struct Scaled {
    matrix: DMatrix<f64>,
    /// Divisors of the columns.
    columns: Vec<f64>,
    /// Singular values below this share of the largest are zero.
    tolerance: f64,
}

impl Scaled {
    fn new(harmonics: &Harmonics, jacobian: Option<&DMatrix<f64>>) -> Self {
        // Entries within the rounding of their samples are set to zero, so that a column of them is not scaled up.
        let clean = |matrix: &DMatrix<f64>| {
            DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |r, c| {
                let value = matrix[(r, c)];
                if value.abs() <= tolerance::FORCE * harmonics.sizes[(r, c)] { 0.0 } else { value }
            })
        };
        let (mut fine, mut error) = (clean(&harmonics.fine), clean(&harmonics.fine) - clean(&harmonics.coarse));
        if let Some(jacobian) = jacobian {
            (fine, error) = (fine * jacobian, error * jacobian);
        }
        let mut columns = vec![1.0; fine.ncols()];
        // Equations may have different units, so the rows of each equation are divided by their common norm.
        for _ in 0..3 {
            let (scaled, lengths) = unit_columns(fine);
            fine = scaled;
            for ((mut column, length), total) in error.column_iter_mut().zip(&lengths).zip(&mut columns) {
                column /= *length;
                *total *= length;
            }
            let mut at = 0;
            for block in harmonics.rows.chunk_by(|a, b| (a.pattern, a.equation) == (b.pattern, b.equation)) {
                let norm = fine.rows(at, block.len()).norm();
                if norm > 0.0 {
                    fine.rows_mut(at, block.len()).unscale_mut(norm);
                    error.rows_mut(at, block.len()).unscale_mut(norm);
                }
                at += block.len();
            }
        }
        let largest = fine.norm();
        let measured = if largest > 0.0 { SAFETY * error.norm() / largest } else { 0.0 };
        Scaled { matrix: fine, columns, tolerance: measured.max(tolerance::FORCE) }
    }

    /// Orthonormal basis, by columns, of the null space of the rows that `keep` accepts.
    fn null(&self, keep: impl Fn(usize) -> bool) -> DMatrix<f64> {
        let rows: Vec<usize> = (0..self.matrix.nrows()).filter(|&row| keep(row)).collect();
        Singular::new(&self.matrix.select_rows(&rows), self.tolerance).null()
    }
}

/// Whether a combination is orthogonal to the null space.
fn is_shown(weights: &DVector<f64>, null: &DMatrix<f64>) -> bool {
    null.tr_mul(weights).iter().all(|part| part.abs() <= tolerance::HIDDEN_COMPONENT)
}

/// For every column, whether all directions of the null space have the component zero in it.
fn determined(null: &DMatrix<f64>) -> Vec<bool> {
    null.row_iter().map(|row| row.iter().all(|part| part.abs() <= tolerance::HIDDEN_COMPONENT)).collect()
}

impl Setting {
    fn new(map: &ParameterMap, symbols: Symbols, harmonics: Harmonics) -> Self {
        let scaled = Scaled::new(&harmonics, None);
        let mut directions = echelon(&scaled.null(|_| true));
        for (free, direction) in &mut directions {
            let own = scaled.columns[*free];
            for (value, scale) in direction.iter_mut().zip(&scaled.columns) {
                *value *= own / scale;
            }
        }
        let count = map.parameters().len();
        let rates = map.jacobian_at(|symbol| symbols.value(map.name(symbol)));
        let jacobian = DMatrix::from_fn(rates.len(), count, |row, column| rates[row][column]);
        let null = Scaled::new(&harmonics, Some(&jacobian)).null(|_| true);
        let physical = PhysicalIdentifiability {
            parameters: map.parameters().iter().map(|p| map.name(*p).to_string()).collect(),
            rank: count - null.ncols(),
            determined: determined(&null),
        };
        Setting { symbols, harmonics, scaled, directions, physical }
    }

    fn rank(&self) -> usize {
        self.scaled.matrix.ncols() - self.directions.len()
    }

    fn free(&self) -> Vec<usize> {
        self.directions.iter().map(|(free, _)| *free).collect()
    }

    fn report(
        &self,
        model: &Interpreted,
        patterns: &[PlayedPattern<'_>],
        alike: &[&Setting],
        contents: &[Vec<EntryContent>],
    ) -> Report {
        let dims = Model::<f64>::dims(model);
        let names: Vec<String> =
            (0..dims.parameters).map(|j| Model::<f64>::parameter(model, j).name.to_string()).collect();
        let columns = names.len();
        // Unobservable directions, with rational coefficients where these are the same at every setting.
        let coefficient = |which: usize, column: usize| {
            let value = self.directions[which].1[column];
            let same = |other: &&Setting| {
                (other.directions[which].1[column] - value).abs() <= tolerance::HIDDEN_COMPONENT * value.abs()
            };
            Coefficient { value, exact: if alike.iter().all(same) { rational(value) } else { None } }
        };
        let has = |which: usize, column: usize| self.directions[which].1[column].abs() > 0.0;
        let unobservable = (0..self.directions.len()).map(|which| {
            let columns: Vec<usize> = (0..columns).filter(|&column| has(which, column)).collect();
            let parts: Vec<Coefficient> = columns.iter().map(|&column| coefficient(which, column)).collect();
            let exact: Option<Vec<(i64, u32)>> = parts.iter().map(|part| part.exact).collect();
            let texts: Vec<String> = match exact {
                Some(exact) => whole(&exact).iter().map(ToString::to_string).collect(),
                None => parts.iter().map(Coefficient::text).collect(),
            };
            columns.iter().map(|&column| names[column].clone()).zip(texts).collect::<BTreeMap<String, String>>()
        });
        // Base parameters, with the harmonics that show them.
        let free = self.free();
        let rows = &self.harmonics.rows;
        let reported = |row: usize| {
            let HarmonicRow { pattern, equation, harmonic, function } = rows[row];
            ReportedRow {
                experiment: patterns[pattern].name.clone(),
                equation: Model::<f64>::row(model, equation).name.to_string(),
                harmonic,
                function,
            }
        };
        let (bands, unchecked) = (self.bands(), self.unchecked());
        let base = (0..columns).filter(|column| !free.contains(column)).map(|column| ReportedBase {
            parameter: names[column].clone(),
            plus: (0..free.len())
                .filter(|&which| has(which, column))
                .map(|which| (names[free[which]].clone(), coefficient(which, column).negated().text()))
                .collect(),
            harmonics_up_to: bands[column],
            shown_by: patterns
                .iter()
                .zip(contents)
                .flat_map(|(played, entries)| showing(model, entries, column, played.harmonics, &played.name))
                .collect(),
            unchecked_in: unchecked[column].iter().map(|&row| reported(row)).collect(),
        });
        // Observable parameters, and the lowest harmonic up to which the harmonics determine each.
        let observable = determined(&self.scaled.null(|_| true));
        let highest = rows.iter().map(|row| row.harmonic).max().unwrap_or(0);
        let mut band = vec![None; columns];
        for harmonic in 0..=highest {
            let known = determined(&self.scaled.null(|row| rows[row].harmonic <= harmonic));
            for (slot, _) in band.iter_mut().zip(known).filter(|(slot, known)| *known && slot.is_none()) {
                *slot = Some(harmonic);
            }
            if band.iter().zip(&observable).all(|(band, observable)| band.is_some() || !observable) {
                break;
            }
        }
        // Parameters that a single pattern determines.
        let alone: Vec<Vec<bool>> =
            (0..patterns.len()).map(|p| determined(&self.scaled.null(|row| rows[row].pattern == p))).collect();
        let parameters = (0..columns).map(|column| ReportedParameter {
            name: names[column].clone(),
            observable: observable[column],
            harmonics_up_to: band[column].filter(|_| observable[column]),
            by_itself_in: (0..patterns.len()).filter(|&p| alone[p][column]).map(|p| patterns[p].name.clone()).collect(),
            visible_in: (0..rows.len()).filter(|&row| self.visible(row, column)).map(reported).collect(),
            unchecked_in: unchecked[column].iter().filter(|_| observable[column]).map(|&row| reported(row)).collect(),
        });
        Report {
            schema: SCHEMA.to_string(),
            method: Means::Numerical,
            rank: self.rank(),
            columns,
            rows: (0..rows.len()).filter(|&row| (0..columns).any(|column| self.visible(row, column))).count(),
            proven: false,
            indeterminates: self.symbols.drawn.iter().map(|(name, _)| name.clone()).collect(),
            at: self.at(patterns),
            unobservable: Some(unobservable.collect()),
            base: Some(base.collect()),
            common_factors: Vec::new(),
            parameters: parameters.collect(),
        }
    }

    /// The base parameters: the leading column, and the combination in scaled parameters, normalised to length one.
    fn combinations(&self) -> Vec<(usize, DVector<f64>)> {
        let columns = self.scaled.matrix.ncols();
        let combination = |lead: usize| {
            let mut weights = DVector::zeros(columns);
            weights[lead] = 1.0;
            for (own, direction) in &self.directions {
                weights[*own] = -direction[lead];
            }
            for (weight, scale) in weights.iter_mut().zip(&self.scaled.columns) {
                *weight /= scale;
            }
            (lead, weights.normalize())
        };
        let free = self.free();
        (0..columns).filter(|column| !free.contains(column)).map(combination).collect()
    }

    /// Lowest harmonic up to which the harmonics determine each base parameter, by leading column.
    fn bands(&self) -> Vec<Option<usize>> {
        let combinations = self.combinations();
        let rows = &self.harmonics.rows;
        let mut bands = vec![None; self.scaled.matrix.ncols()];
        for harmonic in 0..=rows.iter().map(|row| row.harmonic).max().unwrap_or(0) {
            let null = self.scaled.null(|row| rows[row].harmonic <= harmonic);
            for (lead, weights) in &combinations {
                if bands[*lead].is_none() && is_shown(weights, &null) {
                    bands[*lead] = Some(harmonic);
                }
            }
            if combinations.iter().all(|(lead, _)| bands[*lead].is_some()) {
                break;
            }
        }
        bands
    }

    /// The rows without redundancy that determine each base parameter, by leading column.
    fn unchecked(&self) -> Vec<Vec<usize>> {
        let combinations = self.combinations();
        let mut unchecked = vec![Vec::new(); self.scaled.matrix.ncols()];
        let left = Singular::new(&self.scaled.matrix, self.scaled.tolerance).left;
        for row in (0..left.nrows()).filter(|&row| left.row(row).norm_squared() > LEVERAGE) {
            let null = self.scaled.null(|other| other != row);
            for (lead, _) in combinations.iter().filter(|(_, weights)| !is_shown(weights, &null)) {
                unchecked[*lead].push(row);
            }
        }
        unchecked
    }

    /// Names and values of the drawn symbols, as text.
    fn at(&self, patterns: &[PlayedPattern<'_>]) -> BTreeMap<String, String> {
        let stated = |name: &str| patterns.iter().any(|played| played.values.contains_key(name));
        let parameters = self.symbols.physical.iter().filter(|(name, _)| self.harmonics.completed && !stated(name));
        let symbols = self.symbols.drawn.iter().map(|(name, value)| (name, value));
        symbols.chain(parameters).map(|(name, value)| (name.clone(), number(*value))).collect()
    }

    /// Whether a harmonic of a regressor is above its numerical error.
    fn visible(&self, row: usize, column: usize) -> bool {
        let Harmonics { fine, coarse, sizes, .. } = &self.harmonics;
        let error = SAFETY * (fine[(row, column)] - coarse[(row, column)]).abs();
        fine[(row, column)].abs() > error.max(tolerance::FORCE * sizes[(row, column)])
    }
}

/// A component of an unobservable direction.
#[derive(Clone, Copy)]
struct Coefficient {
    value: f64,
    /// The component as numerator and denominator, when it is the same rational number at every setting.
    exact: Option<(i64, u32)>,
}

impl Coefficient {
    fn negated(self) -> Self {
        Coefficient { value: -self.value, exact: self.exact.map(|(numerator, denominator)| (-numerator, denominator)) }
    }

    fn text(&self) -> String {
        match self.exact {
            None => number(self.value),
            Some((numerator, 1)) => numerator.to_string(),
            Some((numerator, denominator)) => format!("{numerator}/{denominator}"),
        }
    }
}

/// The reduced echelon form of directions given by columns, eliminated from the last component on: as many directions,
/// each with a component of one at which all others are zero, in ascending order of these components.
fn echelon(null: &DMatrix<f64>) -> Vec<(usize, Vec<f64>)> {
    let mut left: Vec<Vec<f64>> = null.column_iter().map(|column| column.iter().copied().collect()).collect();
    let mut done: Vec<(usize, Vec<f64>)> = Vec::new();
    for column in (0..null.nrows()).rev() {
        let Some(at) = (0..left.len()).max_by(|&a, &b| left[a][column].abs().total_cmp(&left[b][column].abs())) else {
            break;
        };
        if left[at][column].abs() <= tolerance::HIDDEN_COMPONENT {
            continue;
        }
        let mut pivot = left.swap_remove(at);
        let divisor = pivot[column];
        pivot.iter_mut().for_each(|value| *value /= divisor);
        for other in left.iter_mut().chain(done.iter_mut().map(|(_, direction)| direction)) {
            let factor = other[column];
            other.iter_mut().zip(&pivot).for_each(|(value, part)| *value -= factor * part);
        }
        done.push((column, pivot));
    }
    for (_, direction) in &mut done {
        let largest = direction.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        direction
            .iter_mut()
            .filter(|value| value.abs() <= tolerance::HIDDEN_COMPONENT * largest)
            .for_each(|value| *value = 0.0);
    }
    done.reverse();
    done
}

/// The rational number of small denominator that equals a value within its error; nothing when there is none.
fn rational(value: f64) -> Option<(i64, u32)> {
    (1..=LARGEST_DENOMINATOR).find_map(|denominator| {
        let numerator = (value * f64::from(denominator)).round();
        let near = (value * f64::from(denominator) - numerator).abs() <= tolerance::HIDDEN_COMPONENT * numerator.abs();
        (near && numerator.abs() < 1e4).then_some((numerator as i64, denominator))
    })
}

/// Multiplies rational numbers by the least common multiple of their denominators, and removes their common divisor.
fn whole(parts: &[(i64, u32)]) -> Vec<i64> {
    let gcd = |mut a: i64, mut b: i64| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a.abs().max(1)
    };
    let multiple = parts.iter().fold(1_i64, |multiple, (_, d)| multiple / gcd(multiple, i64::from(*d)) * i64::from(*d));
    let scaled: Vec<i64> = parts.iter().map(|(n, d)| n * (multiple / i64::from(*d))).collect();
    let divisor = scaled.iter().fold(0, |divisor, value| gcd(divisor, *value));
    scaled.iter().map(|value| value / divisor.max(1)).collect()
}

#[cfg(test)]
mod tests {
    use super::{Harmonics, PlayedPattern, Symbols, contents, numerical_identifiability, rational, whole};
    use crate::report::{Means, Report, ReportedRow};
    use std::collections::BTreeMap;
    use tpm_interpret::Interpreted;
    use tpm_session::DeclaredModel;
    use tpm_symbolic::algebra::fourier::Trig;
    use tpm_symbolic::harmonic::expand::expand;
    use tpm_symbolic::harmonic::identifiability::{Experiment, PhysicalIdentifiability, identifiability};
    use tpm_symbolic::regressor::parameter_map::ParameterMap;

    fn numerical(model: &DeclaredModel, harmonics: usize) -> (Report, PhysicalIdentifiability) {
        let pattern = model.pattern(None).expect("a pattern");
        let played = PlayedPattern { name: "it".to_string(), pattern, values: BTreeMap::new(), harmonics };
        numerical_identifiability(model.prepared(), &[played]).expect("finite")
    }

    fn parsed(text: &str) -> DeclaredModel {
        DeclaredModel::parse("test.tpm", text).expect("a model")
    }

    #[test]
    fn numerical_and_exact_answers_agree_where_there_are_both() {
        let models = [
            include_str!("../../../../models/mass_spring_drag.tpm"),
            include_str!("../../../../models/two_carts.tpm"),
            include_str!("../../../../models/three_carts.tpm"),
            include_str!("../../../../models/closed_loop_arm.tpm"),
            include_str!("../../../../models/silverbox.tpm"),
            include_str!("../../../../models/brushless_motor.tpm"),
            include_str!("../../../../models/emps.tpm"),
        ];
        for text in models {
            let model = parsed(text);
            let prepared = model.prepared();
            let Ok(pattern) = model.pattern(None) else { continue };
            let table = expand(&prepared.model, &prepared.form, pattern).expect("finite");
            let highest = table.entries().map(|entry| entry.harmonic).max().unwrap_or(0);
            let exact = identifiability(&[Experiment::of("it", &prepared.model, &table)]).expect("decided");
            let exact = Report::of(&exact);
            let (found, _) = numerical(&model, highest);
            let name = &prepared.model.name;
            assert_eq!((found.rank, found.columns), (exact.rank, exact.columns), "{name}");
            assert_eq!((found.method, exact.method), (Means::Numerical, Means::Exact));
            let rows = |report: &[ReportedRow]| -> Vec<String> {
                let row = |row: &ReportedRow| format!("{} {} {:?}", row.equation, row.harmonic, row.function);
                let mut rows: Vec<String> = report.iter().map(row).collect();
                rows.sort();
                rows
            };
            for (found, exact) in found.parameters.iter().zip(&exact.parameters) {
                assert_eq!(found.observable, exact.observable, "{name}: {}", exact.name);
                assert_eq!(found.harmonics_up_to, exact.harmonics_up_to, "{name}: {}", exact.name);
                assert_eq!(rows(&found.visible_in), rows(&exact.visible_in), "{name}: {}", exact.name);
                assert_eq!(rows(&found.unchecked_in), rows(&exact.unchecked_in), "{name}: {}", exact.name);
            }
            for (found, exact) in found.base.iter().flatten().zip(exact.base.iter().flatten()) {
                assert_eq!(found.parameter, exact.parameter, "{name}");
                assert_eq!(rows(&found.unchecked_in), rows(&exact.unchecked_in), "{name}: {}", exact.parameter);
            }
            let free = |report: &Report| -> Vec<Vec<String>> {
                let directions = report.unobservable.as_ref().expect("short");
                directions.iter().map(|direction| direction.keys().cloned().collect()).collect()
            };
            assert_eq!(free(&found), free(&exact), "{name}");
        }
    }

    #[test]
    fn an_exact_report_says_what_is_lumped_into_a_base_parameter() {
        let model = parsed(include_str!("../../../../models/closed_loop_arm.tpm"));
        let (prepared, pattern) = (model.prepared(), model.pattern(None).expect("a pattern"));
        let table = expand(&prepared.model, &prepared.form, pattern).expect("finite");
        let found = identifiability(&[Experiment::new("one", &table)]).expect("decided");
        let report = Report::of(&found);
        let named = |pairs: &[(&str, &str)]| -> BTreeMap<String, String> {
            pairs.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
        };
        let base = report.base.expect("short");
        assert_eq!((base.len(), base[0].parameter.as_str()), (6, "a10"));
        assert_eq!(base[0].plus, named(&[("a30", "lambda2/2/lambda1")]));
        let hidden = named(&[("a10", "lambda2^2"), ("a20", "lambda1^2"), ("a30", "-2*lambda1*lambda2")]);
        assert!(report.unobservable.expect("short").contains(&hidden));
    }

    /// The pendulum of the logs, with the exact sine instead of its Taylor polynomial.
    const PENDULUM: &str = "model MotorPendulum {
        coordinate q [rad];
        input u [V];
        parameter J [kg*m^2], d [N*m*s/rad], fc [N*m], mgl [N*m];
        constant Kt = 0.05 [N*m/A];
        constant R = 1.2 [ohm];
        J*ddot(q) + (d + Kt^2/R)*dot(q) + fc*sign(dot(q)) + mgl*sin(q) = Kt/R*u;
        pattern { amplitude A [rad]; frequency w [rad/s]; q = rest_to_rest(A, w, 3); }
    }";

    #[test]
    fn models_with_sines_and_signs_are_answered() {
        let (found, physical) = numerical(&parsed(PENDULUM), 31);
        assert_eq!((found.rank, found.columns, physical.rank), (4, 4, 4));
        assert!(found.parameters.iter().all(|parameter| parameter.observable));
        // Along a motion with the first harmonic alone d and fc cannot be told apart, nor J and mgl.
        let (found, _) = numerical(&parsed(PENDULUM), 1);
        assert_eq!(found.rank, 2);
        assert!(found.parameters.iter().all(|parameter| !parameter.observable));
        assert!(found.parameters.iter().all(|parameter| parameter.visible_in.iter().all(|row| row.harmonic == 1)));
    }

    #[test]
    fn an_arm_in_the_vertical_plane_is_answered_with_its_base_parameters() {
        // The squares of sine and cosine add up to one, which is also the regressor of the torque's offset.
        let arm = parsed(
            "model Arm {
                coordinate q1 [rad], q2 [rad];
                input t1 [N*m], t2 [N*m];
                parameter a [kg*m^2], c [kg*m^2], e [kg*m^2], g1 [N*m], g2 [N*m], f1 [N*m], f2 [N*m];
                parameter s1 [N*m], s2 [N*m], o [N*m];
                (a + e + 2*c*cos(q2))*ddot(q1) + (e + c*cos(q2))*ddot(q2)
                    - c*sin(q2)*(2*dot(q1)*dot(q2) + dot(q2)^2) + g1*cos(q1) + g2*cos(q1 + q2) + f1*sign(dot(q1))
                    + s1*sin(q1)^2 + s2*cos(q1)^2 + 1/2*o = t1;
                (e + c*cos(q2))*ddot(q1) + e*ddot(q2) + c*sin(q2)*dot(q1)^2 + g2*cos(q1 + q2) + f2*sign(dot(q2)) = t2;
                pattern {
                    amplitude A1 [rad], A2 [rad];
                    frequency w [rad/s];
                    q1 = rest_to_rest(A1, w, 3);
                    q2 = rest_to_rest(A2, 2*w, 3);
                }
            }",
        );
        let (found, physical) = numerical(&arm, 31);
        assert_eq!((found.rank, found.columns, physical.rank), (9, 10, 9));
        let direction: Vec<(String, String)> = found.unobservable.expect("short").into_iter().flatten().collect();
        let written = |name: &str, value: &str| (name.to_string(), value.to_string());
        assert_eq!(direction, [written("o", "2"), written("s1", "-1"), written("s2", "-1")]);
        let base = found.base.expect("short");
        let plus = |name: &str| &base.iter().find(|base| base.parameter == name).expect("in the base").plus;
        assert_eq!(plus("s1")["o"], "1/2");
        assert!(plus("g1").is_empty());
    }

    #[test]
    fn harmonics_by_series_are_those_of_the_samples_within_their_bounds() {
        let arm = parsed(
            "model Arm {
                coordinate q1 [rad], q2 [rad], q3 [rad];
                input t1 [N*m], t2 [N*m], t3 [N*m];
                mechanism {
                    gravity (0, 0, -9.81);
                    body a { revolute q1 about z; inertia parameters; }
                    body b on a { revolute q2 about y at (0, 0.1, 0.2); inertia parameters; }
                    body c on b { revolute q3 about y at (0.1, 0, 0.4) turned (2*atan2(3, 20), 0, 0); inertia parameters; }
                    drive q1 by t1;
                    drive q2 by t2;
                    drive q3 by t3;
                }
                pattern {
                    amplitude A1 [rad], A2 [rad], A3 [rad];
                    frequency w [rad/s];
                    q1 = A1*sin(w*t);
                    q2 = A2*cos(2*w*t) + 1/5*A1*sin(w*t);
                    q3 = A3*cos(3*w*t) + 1/2;
                }
            }",
        );
        let prepared = arm.prepared();
        let values = [("A1", 1.1), ("A2", 0.7), ("A3", 0.9), ("w", 1.5)].map(|(name, value)| (name.to_string(), value));
        let pattern = arm.pattern(None).expect("a pattern");
        let played = [PlayedPattern { name: "it".to_string(), pattern, values: BTreeMap::from(values), harmonics: 60 }];
        let model = Interpreted::new(&prepared.model, &prepared.form);
        let map = ParameterMap::new(prepared);
        let symbols = Symbols::new(prepared, &map, &played, 0, 1.0).expect("values");
        let sampled = Harmonics::new(prepared, &map, &model, &played, &symbols).expect("finite");
        let series = contents(prepared, &model, &sampled, &symbols);
        assert!(series[0].len() >= 20, "{}", series[0].len());
        let mut compared = 0;
        for entry in &series[0] {
            assert!(entry.error < 1e-9, "{}", entry.error);
            for (row, label) in sampled.rows.iter().enumerate().filter(|(_, label)| label.equation == entry.row) {
                let part = if label.function == Trig::Cos { &entry.wave.cos } else { &entry.wave.sin };
                let value = part.get(label.harmonic).copied().unwrap_or(0.0);
                let off = (value - sampled.fine[(row, entry.column)]).abs();
                let rounding = 1e-13 * (1.0 + sampled.sizes[(row, entry.column)]);
                assert!(off <= entry.error + rounding, "{} {label:?} {off} {}", entry.column, entry.error);
                compared += 1;
            }
        }
        assert!(compared > 1000);
        // Harmonics that are certain by the series are those above the rounding of the samples.
        let (report, _) = numerical_identifiability(prepared, &played).expect("finite");
        let base = report.base.expect("short");
        assert!(base.iter().all(|own| !own.shown_by.is_empty()));
        assert!(base.iter().flat_map(|own| &own.shown_by).all(|shown| shown.amplitude > shown.error));
    }

    #[test]
    fn a_free_coordinate_moves_as_its_row_asks() {
        let (found, _) = numerical(&parsed(include_str!("../../../../models/rotary_pendulum_down.tpm")), 31);
        assert!(found.rank > 0 && found.rank <= found.columns);
        assert!(found.at.contains_key("J1") && found.at.contains_key("lambda"), "{:?}", found.at);
    }

    #[test]
    fn rational_numbers_of_small_denominator_are_recognised() {
        assert_eq!(rational(-0.75 + 1e-9), Some((-3, 4)));
        assert_eq!(rational(std::f64::consts::PI), None);
        assert_eq!(whole(&[(1, 2), (-2, 3), (5, 1)]), [3, -4, 30]);
        assert_eq!(whole(&[(2, 1), (-4, 1)]), [1, -2]);
    }
}
