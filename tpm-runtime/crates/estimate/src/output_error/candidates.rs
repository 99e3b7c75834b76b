//! Terms that a model may lack, each a column along the estimated motion.

use crate::output_error::error::OutputErrorFault;
use crate::output_error::problem::{Column, Place, Problem, Trajectory};
use crate::output_error::signals::Signals;
use tpm_controller::harmonics::Hold;
use tpm_numerics::root_mean_square;

/// Share of the root mean square velocity at which friction has turned.
const TURNED_VELOCITY: f64 = 0.02;
/// Share of the root mean square velocity up to which friction is larger at low speed.
const STRIBECK_VELOCITY: f64 = 0.2;

/// A term that a model may lack.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
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

/// A term in its place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Term {
    pub(super) kind: CandidateKind,
    pub(super) place: Place,
}

/// What candidates are formed of: the estimated motion, and the inputs as they are estimated to have been.
pub(super) struct Along<'a> {
    problem: &'a Problem<'a>,
    positions: Vec<Vec<f64>>,
    rates: Vec<Vec<f64>>,
    /// Root mean square of every rate.
    speeds: Vec<f64>,
    /// First and second rate of every input, unit of the input per s and s^2.
    input_rates: Vec<[Vec<f64>; 2]>,
    /// Regressor and input map of every sample, one behind the other.
    entries: Vec<f64>,
}

impl<'a> Along<'a> {
    /// Inputs that the trajectory takes to be noisy are replaced by what they are without noise: the rate of a noisy input would be that noise,
    /// which the innovations hold too. So are all inputs while friction may be anything: the force that is left free there passes noise
    /// of the last readings on to the innovations, and a loop has passed it on to the input.
    pub(super) fn new(
        problem: &'a Problem<'a>,
        signals: &Signals<'_>,
        trajectory: &Trajectory,
        theta: &[f64],
    ) -> Result<Self, OutputErrorFault> {
        let dims = problem.machine.model.dims();
        let (n, samples) = (problem.states.len(), problem.samples());
        let entries = problem.along(trajectory, theta)?;
        let series = |c: usize, d: usize| -> Vec<f64> {
            match problem.states.iter().position(|&of| of == (c, d)) {
                Some(s) => trajectory.states.iter().skip(s).step_by(n).copied().collect(),
                None => vec![0.0; samples],
            }
        };
        let rates: Vec<Vec<f64>> = (0..dims.coordinates).map(|c| series(c, 1)).collect();
        let exact = trajectory.disturbed.iter().all(|w| w.abs() <= 0.0);
        let switches = problem.machine.derivatives.switches();
        let loose = problem.loose(trajectory, theta)?;
        let free = |k: usize| loose.chunks_exact(switches.max(1)).nth(k).is_some_and(|of| of.iter().any(|s| *s > 0.0));
        let free: Vec<bool> = (0..samples).map(free).collect();
        let h = problem.sample_time;
        let replaced = !exact || free.contains(&true);
        let denoised_inputs = if replaced { signals.inputs_without_noise() } else { &[] };
        let input_rates = (0..dims.inputs).map(|i| {
            let at = |k: usize| if exact && !free[k] { signals.inputs[i] } else { &denoised_inputs[i] };
            let rate = |k: usize| (at(k)[k] - at(k)[k.saturating_sub(1)]) / h;
            let bend = |k: usize| {
                let u = at(k);
                (u[k] - 2.0 * u[k.saturating_sub(1)] + u[k.saturating_sub(2)]) / (h * h)
            };
            [(0..samples).map(rate).collect(), (0..samples).map(bend).collect()]
        });
        Ok(Along {
            problem,
            positions: (0..dims.coordinates).map(|c| series(c, 0)).collect(),
            speeds: rates.iter().map(|v| root_mean_square(v.iter().copied()).max(f64::MIN_POSITIVE)).collect(),
            rates,
            input_rates: input_rates.collect(),
            entries,
        })
    }

    fn samples(&self) -> usize {
        self.problem.samples()
    }

    /// Number `at` of the regressor and the input map at sample k.
    fn at(&self, k: usize, at: usize) -> f64 {
        let dims = self.problem.machine.model.dims();
        self.entries[k * (dims.regressor_len() + dims.input_map_len()) + at]
    }

    /// Factor of an input in a row at a sample.
    fn factor(&self, k: usize, row: usize, input: usize) -> f64 {
        let dims = self.problem.machine.model.dims();
        self.at(k, dims.regressor_len() + row * dims.inputs + input)
    }

    fn entry(&self, k: usize, row: usize, parameter: usize) -> f64 {
        self.at(k, row * self.problem.machine.model.dims().parameters + parameter)
    }

    /// The column of a term.
    pub(super) fn column(&self, term: Term) -> Column {
        let samples = self.samples();
        let r = match term.place {
            Place::Row(row) => row,
            Place::Reading(_) => 0,
        };
        let by_input = matches!(term.kind, CandidateKind::Delay { .. } | CandidateKind::Flexible { .. });
        let sign = |c: usize, v: f64| (v / (TURNED_VELOCITY * self.speeds[c])).tanh();
        let of =
            |values: &[f64], f: &dyn Fn(f64) -> f64| -> Vec<f64> { values.iter().map(|&value| f(value)).collect() };
        let values = match term.kind {
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
                let bend = STRIBECK_VELOCITY * self.speeds[coordinate];
                of(&self.rates[coordinate], &|v| sign(coordinate, v) * (-(v / bend).powi(2)).exp())
            }
            CandidateKind::Drift { parameter } => {
                let time = |k: usize| 2.0 * k as f64 / samples.max(1) as f64 - 1.0;
                (0..samples).map(|k| self.entry(k, r, parameter) * time(k)).collect()
            }
            CandidateKind::Delay { input } => {
                (0..samples).map(|k| self.factor(k, r, input) * self.input_rates[input][0][k]).collect()
            }
            CandidateKind::Flexible { input } => {
                (0..samples).map(|k| self.factor(k, r, input) * self.input_rates[input][1][k]).collect()
            }
            // A limit is no term of the model: it is looked for before the fit.
            CandidateKind::Limit { .. } => vec![0.0; samples],
        };
        Column { place: term.place, values, held: by_input && self.problem.hold == Hold::Zoh }
    }
}

/// The candidates of a record.
pub(super) fn candidates(along: &Along<'_>) -> Vec<Term> {
    let dims = along.problem.machine.model.dims();
    let some = |factor: &dyn Fn(usize) -> f64| (0..along.samples()).any(|k| factor(k).abs() > 0.0);
    let mut terms = Vec::new();
    for row in 0..dims.rows {
        let mut add = |kind: CandidateKind| terms.push(Term { kind, place: Place::Row(row) });
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
        for &parameter in &along.problem.free {
            let shown = |row: usize| some(&|k| along.entry(k, row, parameter));
            if shown(row) && !(0..row).any(shown) {
                add(CandidateKind::Drift { parameter });
            }
        }
        for input in (0..dims.inputs).filter(|&input| some(&|k| along.factor(k, row, input))) {
            add(CandidateKind::Delay { input });
            add(CandidateKind::Flexible { input });
        }
    }
    let backlash =
        |coordinate| Term { kind: CandidateKind::Backlash { coordinate }, place: Place::Reading(coordinate) };
    terms.extend((0..dims.coordinates).map(backlash));
    terms
}
