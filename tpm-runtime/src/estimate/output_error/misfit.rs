//! What a model leaves of a record, and which single term would take most of it.
//!
//! Every candidate term is one more column of the linearised record. One pass gives, for each, the value that it would have, by how
//! much it lowers the sum of squares, and how far it would move the parameters. Under a right model a candidate's gain, over the
//! variance that is left, follows chi-squared with one degree of freedom, so that the rate of false alarms is known. Candidates are
//! taken in one after the other while the best one is significant.
//!
//! Deviations grow with what is found: by the distance that the parameters move when the significant candidates are part of the
//! model, since nobody knows whether they should be, and by the power that is left at the harmonics of the motion, where noise has no
//! reason to be stronger than elsewhere.

use crate::estimate::output_error::error::OutputErrorFault;
use crate::estimate::output_error::problem::{Column, Place, Problem};
use crate::estimate::output_error::signals::Signals;
use crate::estimate::output_error::smoother::Smoothed;
use crate::estimate::output_error::solution::Solution;
use crate::numerics::DVector;
use crate::numerics::fourier::forward;
use num_complex::Complex;
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;

/// Rate of false alarms of all candidates together.
const FALSE_ALARMS: f64 = 0.01;
/// Most candidates that are taken in.
const MOST_TERMS: usize = 3;
/// A first candidate whose column is explained by the parameters but for this share of its power says nothing of its own.
const OWN: f64 = 1e-9;
/// The same for a further candidate, beside the parameters and those before it.
const DISTINCT: f64 = 1e-4;
/// Harmonics at which the residual is compared with its neighbours.
const HARMONICS: usize = 24;
/// Standard deviations beyond which the power at the harmonics, or the correlation of neighbouring residuals, is no chance.
const CHANCE: f64 = 4.5;
/// Share of the root mean square velocity at which friction has turned.
const SLOW: f64 = 0.02;
/// Share of the root mean square velocity up to which friction is larger at low speed.
const STRIBECK: f64 = 0.2;
/// Chance of a false alarm about a vibration.
const VIBRATION: f64 = 0.002;
/// A vibration of the machine lies above this multiple of the highest harmonic of its motion.
const BEYOND_MOTION: f64 = 2.0;
/// Samples that a vibration must have in one of its periods.
const NEAR_SAMPLING: usize = 5;
/// Bins on either side over which the power of the innovations is averaged.
const SMOOTHED: usize = 10;

/// A term that a model may lack.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum CandidateKind {
    /// A constant force, or an offset of a sensor or of an input.
    Offset,
    /// A power of a coordinate.
    Power {
        /// The coordinate.
        coordinate: usize,
        /// The exponent.
        exponent: u32,
    },
    /// A product of two coordinates.
    Product {
        /// One coordinate.
        coordinate: usize,
        /// The other one.
        other: usize,
    },
    /// A power of a velocity.
    RatePower {
        /// The coordinate.
        coordinate: usize,
        /// The exponent.
        exponent: u32,
    },
    /// Drag, `v |v|`.
    Drag {
        /// The coordinate.
        coordinate: usize,
    },
    /// Dry friction, `sign(v)`.
    Friction {
        /// The coordinate.
        coordinate: usize,
    },
    /// More friction at low speed than at high speed.
    Stribeck {
        /// The coordinate.
        coordinate: usize,
    },
    /// A parameter that changes over the record.
    Drift {
        /// The parameter.
        parameter: usize,
    },
    /// An input, or a sensor, that is late: the value is the delay, s.
    Delay {
        /// The input.
        input: usize,
    },
    /// Dynamics between an input and the sensors: a flexible mode, or a lag of the second order.
    Flexible {
        /// The input.
        input: usize,
    },
    /// An input that does not go beyond a limit; the value is one where it is cut off sharply.
    Limit {
        /// The input.
        input: usize,
        /// The limit, unit of the input.
        limit: f64,
    },
    /// A reading that depends on the direction of the motion: backlash, or hysteresis.
    Backlash {
        /// The coordinate.
        coordinate: usize,
    },
}

/// A term that would explain what a model leaves.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Candidate {
    /// The term.
    pub term: CandidateKind,
    /// The row on which it acts; nothing for one that acts on a reading.
    pub row: Option<usize>,
    /// Its factor, in the units of row and term.
    pub value: f64,
    /// Standard deviation of the factor.
    pub std: f64,
    /// Share of the unexplained sum of squares that it takes.
    pub gain: f64,
}

/// What a model leaves of a record.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Misfit {
    /// Variance of the innovations, in units of what the noise model states.
    pub scale: f64,
    /// Correlation of neighbouring innovations.
    pub correlation: f64,
    /// Mean power of the innovations at the harmonics of the motion, in units of their power elsewhere.
    pub periodic: f64,
    /// Whether that power is beyond chance.
    pub repeats: bool,
    /// Significant candidates, the strongest first.
    pub terms: Vec<Candidate>,
    /// Whether the first of them is a limit of an input that is part of the fit: without it the record makes no sense.
    pub limited: bool,
    /// How far every free parameter moves when these terms are part of the model.
    pub shift: Vec<f64>,
    /// How far every free parameter moves when the strongest of them alone is part of the model.
    pub by_first: Vec<f64>,
    /// Half of the range over which every free parameter drifts during the record.
    pub range: Vec<f64>,
    /// Frequency of a vibration that the model does not have, Hz.
    pub vibration: Option<f64>,
    /// How far every free parameter moves with the static part of such a vibration.
    pub bent: Vec<f64>,
    /// Factor on variances for what no candidate explains.
    pub inflation: f64,
    /// How far every free parameter moves from the first half of the record to the second; empty where the halves do not show them.
    pub halves: Vec<Half>,
}

/// How far a parameter moves from the first half of a record to the second.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct Half {
    /// Second half less first half, unit of the parameter.
    pub moved: f64,
    /// Variance of that difference by the stated noise.
    pub variance: f64,
}

/// A candidate with its column.
pub(super) struct Proposed {
    term: CandidateKind,
    pub(super) column: Column,
}

/// What candidates are formed of: the estimated motion, and the inputs as they are estimated to have been.
pub(super) struct Along<'a> {
    problem: &'a Problem<'a>,
    positions: Vec<Vec<f64>>,
    rates: Vec<Vec<f64>>,
    /// Root mean square of every rate.
    speeds: Vec<f64>,
    /// The inputs without their noise.
    inputs: Vec<Vec<f64>>,
    regressors: Vec<f64>,
    maps: Vec<f64>,
}

impl<'a> Along<'a> {
    pub(super) fn new(
        problem: &'a Problem<'a>,
        signals: &Signals<'_>,
        motion: &[f64],
        theta: &[f64],
    ) -> Result<Self, OutputErrorFault> {
        let dims = problem.machine.model.dims();
        let (n, samples) = (problem.states.len(), problem.samples());
        let (regressors, maps) = problem.along(motion, theta)?;
        let series = |c: usize, d: usize| -> Vec<f64> {
            match problem.states.iter().position(|&of| of == (c, d)) {
                Some(s) => motion.iter().skip(s).step_by(n).copied().collect(),
                None => vec![0.0; samples],
            }
        };
        let rates: Vec<Vec<f64>> = (0..dims.coordinates).map(|c| series(c, 1)).collect();
        let rms = |v: &Vec<f64>| (v.iter().map(|v| v * v).sum::<f64>() / samples.max(1) as f64).sqrt();
        // A rate of a noisy input would be that noise, which the innovations hold too.
        let exact = problem.disturbed.iter().all(|w| w.abs() <= 0.0);
        let inputs = (signals.inputs.iter().enumerate())
            .map(|(i, input)| if exact { input.to_vec() } else { signals.periodic_input(i) });
        Ok(Along {
            problem,
            positions: (0..dims.coordinates).map(|c| series(c, 0)).collect(),
            speeds: rates.iter().map(|v| rms(v).max(f64::MIN_POSITIVE)).collect(),
            rates,
            inputs: inputs.collect(),
            regressors,
            maps,
        })
    }

    fn samples(&self) -> usize {
        self.problem.samples()
    }

    /// Factor of an input in a row at a sample.
    fn factor(&self, k: usize, row: usize, input: usize) -> f64 {
        let dims = self.problem.machine.model.dims();
        self.maps[k * dims.input_map_len() + row * dims.inputs + input]
    }

    fn acts(&self, row: usize, input: usize) -> bool {
        (0..self.samples()).any(|k| self.factor(k, row, input).abs() > 0.0)
    }

    fn entry(&self, k: usize, row: usize, parameter: usize) -> f64 {
        let dims = self.problem.machine.model.dims();
        self.regressors[k * dims.regressor_len() + row * dims.parameters + parameter]
    }

    /// The column of a term on a row, or on a reading where there is no row.
    pub(super) fn column(&self, term: CandidateKind, row: Option<usize>) -> Column {
        let samples = self.samples();
        let r = row.unwrap_or_default();
        let by_input = matches!(term, CandidateKind::Delay { .. } | CandidateKind::Flexible { .. });
        let sign = |c: usize, v: f64| (v / (SLOW * self.speeds[c])).tanh();
        let of =
            |values: &[f64], f: &dyn Fn(f64) -> f64| -> Vec<f64> { values.iter().map(|&value| f(value)).collect() };
        let h = self.problem.sample_time;
        let values = match term {
            CandidateKind::Offset => vec![1.0; samples],
            CandidateKind::Power { coordinate, exponent } => {
                of(&self.positions[coordinate], &|x| x.powi(exponent as i32))
            }
            CandidateKind::Product { coordinate, other } => {
                self.positions[coordinate].iter().zip(&self.positions[other]).map(|(a, b)| a * b).collect()
            }
            CandidateKind::RatePower { coordinate, exponent } => {
                of(&self.rates[coordinate], &|v| v.powi(exponent as i32))
            }
            CandidateKind::Drag { coordinate } => of(&self.rates[coordinate], &|v| v * v.abs()),
            CandidateKind::Friction { coordinate } | CandidateKind::Backlash { coordinate } => {
                of(&self.rates[coordinate], &|v| sign(coordinate, v))
            }
            CandidateKind::Stribeck { coordinate } => {
                let bend = STRIBECK * self.speeds[coordinate];
                of(&self.rates[coordinate], &|v| sign(coordinate, v) * (-(v / bend).powi(2)).exp())
            }
            CandidateKind::Drift { parameter } => {
                let time = |k: usize| 2.0 * k as f64 / samples.max(1) as f64 - 1.0;
                (0..samples).map(|k| self.entry(k, r, parameter) * time(k)).collect()
            }
            CandidateKind::Delay { input } => {
                let u = &self.inputs[input];
                (0..samples).map(|k| self.factor(k, r, input) * (u[k] - u[k.saturating_sub(1)]) / h).collect()
            }
            CandidateKind::Flexible { input } => {
                let u = &self.inputs[input];
                let bend = |k: usize| (u[k] - 2.0 * u[k.saturating_sub(1)] + u[k.saturating_sub(2)]) / (h * h);
                (0..samples).map(|k| self.factor(k, r, input) * bend(k)).collect()
            }
            // A limit is no term of the model: it is looked for before the fit.
            CandidateKind::Limit { .. } => vec![0.0; samples],
        };
        Column {
            place: row.map_or_else(
                || match term {
                    CandidateKind::Backlash { coordinate } => Place::Reading(coordinate),
                    _ => Place::Reading(0),
                },
                Place::Row,
            ),
            values,
            held: by_input && self.problem.hold == Hold::Zoh,
        }
    }
}

/// The candidates of a record, along the estimated motion.
pub(super) fn columns(
    problem: &Problem<'_>,
    signals: &Signals<'_>,
    motion: &[f64],
    theta: &[f64],
) -> Result<Vec<Proposed>, OutputErrorFault> {
    let dims = problem.machine.model.dims();
    let along = Along::new(problem, signals, motion, theta)?;
    let mut terms: Vec<(CandidateKind, Option<usize>)> = Vec::new();
    for row in 0..dims.rows {
        let mut add = |term: CandidateKind| terms.push((term, Some(row)));
        add(CandidateKind::Offset);
        // In a large machine a row is asked for terms in its own coordinate.
        for coordinate in (0..dims.coordinates).filter(|&c| dims.coordinates <= 2 || c == row) {
            for exponent in [2, 3] {
                add(CandidateKind::Power { coordinate, exponent });
                add(CandidateKind::RatePower { coordinate, exponent });
            }
            add(CandidateKind::Drag { coordinate });
            add(CandidateKind::Friction { coordinate });
            add(CandidateKind::Stribeck { coordinate });
        }
        if dims.coordinates == 2 {
            add(CandidateKind::Product { coordinate: 0, other: 1 });
        }
        for &parameter in &problem.free {
            let shown = |r: usize| (0..along.samples()).any(|k| along.entry(k, r, parameter).abs() > 0.0);
            if shown(row) && !(0..row).any(shown) {
                add(CandidateKind::Drift { parameter });
            }
        }
        for input in 0..dims.inputs {
            if !along.acts(row, input) {
                continue;
            }
            add(CandidateKind::Delay { input });
            add(CandidateKind::Flexible { input });
        }
    }
    terms.extend((0..dims.coordinates).map(|coordinate| (CandidateKind::Backlash { coordinate }, None)));
    Ok(terms.into_iter().map(|(term, row)| Proposed { term, column: along.column(term, row) }).collect())
}

/// What the innovations show, given the first `base` columns for the parameters and whatever else is part of the model, and the others
/// for the candidates.
pub(super) fn judge(
    smoothed: &Smoothed,
    (free, base): (&[usize], usize),
    proposed: &[Proposed],
    bare: &Solution,
    signals: &Signals<'_>,
    exact: bool,
) -> Misfit {
    // Behind the parameters stand the columns that are part of the model for this record.
    let p = base;
    let width = smoothed.width();
    let m = width - 1 - p;
    let root = |r: usize, c: usize| if c >= r { smoothed.root[r * width + c] } else { 0.0 };
    let freedom = (smoothed.places.len() as f64 - p as f64).max(1.0);
    let rest = root(width - 1, width - 1).powi(2);
    let target = DVector::from_fn(m, |i, _| root(p + i, width - 1));
    let column = |j: usize| DVector::from_fn(m, |i, _| root(p + i, p + j));
    let whole: Vec<f64> = (0..m).map(|j| (0..width - 1).map(|r| root(r, p + j).powi(2)).sum::<f64>()).collect();
    // With quantised readings the noise is stated, and never less than that.
    let least = if signals.counted() { 1.0 } else { 0.0 };
    let significant = 2.0 * (m.max(1) as f64 / FALSE_ALARMS).ln();
    let mut left = target.clone();
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let mut chosen: Vec<(usize, f64)> = Vec::new();
    let own = |j: usize, basis: &[DVector<f64>]| -> Option<DVector<f64>> {
        let mut column = column(j);
        for direction in basis {
            let share = direction.dot(&column);
            column -= direction * share;
        }
        // One term may be all but explained by the parameters, as a cubic spring is where the motion has few harmonics. A further one
        // that is would only trade with the first.
        let least = if basis.is_empty() { OWN } else { DISTINCT };
        (column.norm_squared() > least * whole[j].max(f64::MIN_POSITIVE)).then_some(column)
    };
    while chosen.len() < MOST_TERMS {
        let gain = |j: usize| own(j, &basis).map(|own| (j, own.dot(&left).powi(2) / own.norm_squared()));
        let best =
            (0..m).filter(|j| chosen.iter().all(|(i, _)| i != j)).filter_map(gain).max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((j, gain)) = best else { break };
        let after = ((rest + left.norm_squared() - gain) / freedom).max(least);
        if gain <= significant * after {
            break;
        }
        let Some(own) = own(j, &basis) else { break };
        let direction = own.normalize();
        let share = direction.dot(&left);
        left -= &direction * share;
        basis.push(direction);
        chosen.push((j, gain));
    }
    let scale = ((rest + left.norm_squared()) / freedom).max(least);
    // The chosen candidates together: values, and how far they move the parameters.
    let q = chosen.len();
    let mut terms = Vec::new();
    let (mut shift, mut by_first) = (vec![0.0; p], vec![0.0; p]);
    if q > 0 {
        let matrix = crate::numerics::DMatrix::from_fn(m, q, |i, c| root(p + i, p + chosen[c].0));
        let gram = matrix.tr_mul(&matrix);
        if let Some(cholesky) = gram.cholesky() {
            let values = cholesky.solve(&matrix.tr_mul(&target));
            let covariance = cholesky.inverse();
            let excess: f64 = (rest + target.norm_squared() - scale * freedom).max(f64::MIN_POSITIVE);
            for (c, &(j, gain)) in chosen.iter().enumerate() {
                terms.push(Candidate {
                    term: proposed[j].term,
                    row: match proposed[j].column.place {
                        Place::Row(row) => Some(row),
                        Place::Reading(_) => None,
                    },
                    value: values[c],
                    std: (scale * covariance[(c, c)]).sqrt(),
                    gain: (gain / excess).min(1.0),
                });
            }
            let felt = DVector::from_fn(p, |r, _| (0..q).map(|c| root(r, p + chosen[c].0) * values[c]).sum::<f64>());
            if let Some(moved) = bare.root.solve_upper_triangular(&felt) {
                shift = moved.iter().copied().collect();
            }
            let (first, alone) = (chosen[0].0, matrix.column(0));
            let value = alone.dot(&target) / alone.norm_squared();
            let felt = DVector::from_fn(p, |r, _| root(r, p + first) * value);
            if let Some(moved) = bare.root.solve_upper_triangular(&felt) {
                by_first = moved.iter().copied().collect();
            }
        }
    }
    let innovations = smoothed.remaining(
        p,
        &bare.step,
        &chosen.iter().map(|c| c.0).zip(terms.iter().map(|t| t.value)).collect::<Vec<_>>(),
    );
    let correlation = neighbours(&innovations, signals.coordinates.len());
    let (periodic, repeats) = at_harmonics(&innovations, smoothed, signals);
    let repeats = repeats && !signals.counted();
    let correlated = correlation * (innovations.len() as f64).sqrt() > CHANCE && !signals.counted();
    let mut inflation: f64 = if repeats { periodic.max(1.0) } else { 1.0 };
    if correlated {
        inflation = inflation.max((1.0 + correlation) / (1.0 - correlation).max(0.01));
    }
    let mut range = vec![0.0; p];
    for term in &terms {
        if let CandidateKind::Drift { parameter } = term.term
            && let Some(at) = free.iter().position(|&j| j == parameter)
        {
            range[at] = term.value.abs();
        }
    }
    // What noise of inputs does at a mode of the model looks like a vibration where its level is not known well.
    let vibration =
        if signals.counted() || repeats || !exact { None } else { vibration(&innovations, smoothed, signals) };
    let mut bent = vec![0.0; p];
    if let Some(frequency) = vibration {
        // Below its resonance a flexible machine moves as a stiff one under an input that leads by its second rate over the square
        // of the resonance.
        let size = (2.0 * std::f64::consts::PI * frequency).powi(-2);
        let flexible = proposed.iter().enumerate().filter(|(_, of)| matches!(of.term, CandidateKind::Flexible { .. }));
        for (j, _) in flexible {
            let felt = DVector::from_fn(p, |r, _| root(r, p + j) * size);
            if let Some(moved) = bare.root.solve_upper_triangular(&felt) {
                bent.iter_mut().zip(moved.iter()).for_each(|(bent, moved)| *bent += moved.abs());
            }
        }
    }
    Misfit {
        scale,
        correlation,
        periodic,
        repeats,
        terms,
        limited: false,
        shift,
        by_first,
        range,
        vibration,
        bent,
        inflation,
        halves: Vec::new(),
    }
}

/// Correlation of successive innovations of the same sensor.
fn neighbours(innovations: &[f64], outputs: usize) -> f64 {
    let power: f64 = innovations.iter().map(|e| e * e).sum();
    let product: f64 = innovations.iter().zip(innovations.iter().skip(outputs)).map(|(a, b)| a * b).sum();
    if power > 0.0 { product / power } else { 0.0 }
}

/// Mean power at the lowest harmonics in units of the mean power, and whether that is beyond chance.
fn at_harmonics(innovations: &[f64], smoothed: &Smoothed, signals: &Signals<'_>) -> (f64, bool) {
    let outputs = signals.coordinates.len();
    let period = signals.samples_per_period;
    let mut power = 0.0;
    let mut count = 0.0;
    for c in 0..outputs {
        let of = || {
            let own = |((_, place), _): &((&f64, &(u32, u32)), ())| place.1 as usize == c;
            innovations.iter().zip(&smoothed.places).zip(std::iter::repeat(())).filter(own)
        };
        let (sum, number) = of().fold((0.0, 0.0), |(sum, number), ((e, _), ())| (sum + e * e, number + 1.0));
        let variance = sum / f64::max(number, 1.0);
        if variance <= 0.0 {
            continue;
        }
        let highest = HARMONICS.min((period / 4.0) as usize);
        for k in 1..=highest {
            let angle = -2.0 * std::f64::consts::PI * k as f64 / period;
            let mut line = Complex::new(0.0, 0.0);
            for ((e, &(sample, _)), ()) in of() {
                let (sine, cosine) = (angle * f64::from(sample)).sin_cos();
                line += Complex::new(e * cosine, e * sine);
            }
            power += line.norm_sqr() / number / variance;
            count += 1.0;
        }
    }
    if count > 0.0 {
        let mean = power / count;
        // |line|^2 over its mean is exponential: mean one, variance one.
        (mean, (mean - 1.0) * f64::sqrt(count) > CHANCE)
    } else {
        (1.0, false)
    }
}

/// Frequency, in Hz, at which the innovations have more power than chance allows beside the harmonics of the motion.
fn vibration(innovations: &[f64], smoothed: &Smoothed, signals: &Signals<'_>) -> Option<f64> {
    let outputs = signals.coordinates.len();
    let mut worst: Option<(f64, f64)> = None;
    for c in 0..outputs {
        let own = innovations.iter().zip(&smoothed.places).filter(|(_, place)| place.1 as usize == c);
        let mut series: Vec<f64> = own.map(|(e, _)| *e).collect();
        let samples = series.len();
        if samples < 16 * SMOOTHED {
            continue;
        }
        let transform = forward(samples);
        let mut spectrum = transform.make_output_vec();
        transform.process(&mut series, &mut spectrum).ok()?;
        let period = samples as f64 / signals.samples_per_period;
        let above = BEYOND_MOTION * signals.highest(c) as f64 * period;
        // Bins at the harmonics tell of terms, not of vibrations.
        let powers: Vec<(usize, f64)> = spectrum
            .iter()
            .enumerate()
            .skip(1)
            .filter(|(bin, _)| {
                let beyond = (*bin as f64 / period).fract();
                beyond.min(1.0 - beyond) * period > 0.75 || period < 2.0
            })
            .map(|(bin, z)| (bin, z.norm_sqr()))
            .collect();
        let mean = powers.iter().map(|p| p.1).sum::<f64>() / powers.len().max(1) as f64;
        let count = 2 * SMOOTHED + 1;
        if mean <= 0.0 || powers.len() < 4 * count {
            continue;
        }
        for window in powers.windows(count) {
            let level = window.iter().map(|p| p.1).sum::<f64>() / count as f64 / mean;
            // Chernoff's bound on the mean of exponential variables.
            let unlikely = count as f64 * (level - 1.0 - level.ln());
            if level > 1.0
                && unlikely > (powers.len() as f64 / VIBRATION).ln()
                && worst.is_none_or(|(most, _)| level > most)
            {
                let strongest = window.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
                // Nearer to the sampling frequency it is how the record was sampled that shows.
                if strongest.0 * NEAR_SAMPLING < samples && strongest.0 as f64 > above {
                    worst = Some((level, strongest.0 as f64 / (samples as f64 * signals.sample_time)));
                }
            }
        }
    }
    worst.map(|(_, frequency)| frequency)
}
