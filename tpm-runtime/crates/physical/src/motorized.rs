//! A declared model with numerical values of its parameters: rows, the coordinates that every input drives, and a
//! pattern whose amplitudes and frequency remain free.
//!
//! Invariant: the model keeps all coordinates, since a motor may turn with any of them. A coordinate that the model
//! asks to eliminate moves as its reconstruction states, for example x1 = x2 + m2/k3 x2''. It is sampled finely enough
//! for every harmonic of a polynomial.

use std::collections::BTreeMap;
use tpm_controller::model::Model as _;
use tpm_interpret::Interpreted;
use tpm_motion::trajectory::{HarmonicSeries, Line, PatternError, ReferencePattern, Trajectory};
use tpm_numerics::fourier;
use tpm_plant::actuator::Demand;
use tpm_symbolic::expr::graph::{ExprId, Graph, Node, Symbol};
use tpm_symbolic::mechanics::model::Kind;
use tpm_symbolic::mechanics::pattern::{Motion, Pattern as Declared};
use tpm_symbolic::number::rational::to_f64;
use tpm_symbolic::plan::split::Split;
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::{PrepareError, prepare};

/// Samples of a period from which the Fourier series of a reconstructed coordinate is computed.
const SERIES_SAMPLES: usize = 1024;

/// Why a model has no numeric form.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MotorizedMachineError {
    /// The equations have no regressor form.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The pattern has no numerical form.
    #[error(transparent)]
    Pattern(#[from] PatternError),
    /// Quantities without a value.
    #[error("a value is missing for {}", .names.join(", "))]
    Missing {
        /// Names of the quantities.
        names: Vec<String>,
    },
}

/// A declared model with numerical values, to which motors can be attached.
#[derive(Debug)]
pub struct MotorizedMachine {
    model: Interpreted,
    parameters: Vec<f64>,
    constants: Vec<f64>,
    driven: Vec<Vec<usize>>,
    pattern: ReferencePattern,
    graph: Graph,
    /// Index of each reconstructed coordinate in the order of the rows, with its expression in the other coordinates.
    reconstructed: Vec<(usize, ExprId)>,
    /// Index in the model's declaration of every coordinate of the rows.
    declared: Vec<u32>,
    values: BTreeMap<Symbol, f64>,
}

impl MotorizedMachine {
    /// The model of a split, with one of its patterns; `value` gives the values of parameters and run-time constants.
    ///
    /// # Errors
    /// [`MotorizedMachineError`] when a value is missing, the equations have no regressor form, or the pattern leaves a
    /// coordinate open.
    pub fn new(
        split: &Split,
        pattern: &Declared,
        value: impl Fn(Symbol) -> Option<f64>,
    ) -> Result<Self, MotorizedMachineError> {
        let mut model = split.model.clone();
        // Every parameter and constant needs a value.
        let mut values = BTreeMap::new();
        let mut names = Vec::new();
        for symbol in model.parameters().chain(model.run_time_constants()) {
            match value(symbol) {
                Some(value) => {
                    values.insert(symbol, value);
                }
                None => names.push(model.quantity(symbol).name.as_str().into()),
            }
        }
        if !names.is_empty() {
            return Err(MotorizedMachineError::Missing { names });
        }
        for (index, quantity) in (0u32..).zip(&model.symbols) {
            if let Kind::Constant { value: Some(value) } = &quantity.kind {
                values.insert(Symbol(index), to_f64(value));
            }
        }
        // Eliminated coordinates are kept in the model, and reconstructed from the others.
        let mut pattern = pattern.clone();
        let mut solutions = Vec::new();
        if !model.eliminations.is_empty() {
            let eliminated = prepare(model.clone())?;
            for reconstruction in &eliminated.reconstructions {
                pattern.motions[reconstruction.coordinate.0 as usize] = Some(Motion::zero());
                solutions.push((reconstruction.coordinate.0, reconstruction.expr));
            }
            model = eliminated.model;
            model.eliminations.clear();
        }
        // Evaluate the exact forms with the values.
        let prepared = prepare(model)?;
        let of = |symbol: Symbol| values.get(&symbol).copied().unwrap_or(f64::NAN);
        let parameters = ParameterMap::new(&prepared).evaluate(of);
        let constant = |name: &str| prepared.model.find_symbol(name).map(of);
        let pattern = tpm_interpret::pattern::of_model(&pattern, &prepared.model, constant)?;
        let interpreted = Interpreted::new(&prepared.model, &prepared.form);
        let dims = interpreted.dims();
        // Relate the coordinates of the rows to those of the declaration.
        let declared: Vec<u32> = (0..dims.coordinates)
            .filter_map(|c| {
                let name = interpreted.coordinate(c).name;
                (0u32..).zip(&prepared.model.coordinates).find(|(_, info)| info.name == name).map(|(index, _)| index)
            })
            .collect();
        let place = |coordinate: u32| declared.iter().position(|own| *own == coordinate);
        let driven = (split.inputs.iter())
            .map(|input| input.motions.iter().filter_map(|coordinate| place(coordinate.0)).collect())
            .collect();
        let constants = (0..dims.constants)
            .map(|i| prepared.model.find_symbol(interpreted.constant(i).name).map_or(f64::NAN, of))
            .collect();
        let reconstructed = solutions.into_iter().filter_map(|(c, expr)| Some((place(c)?, expr))).collect();
        let graph = prepared.model.graph;
        Ok(MotorizedMachine {
            model: interpreted,
            parameters,
            constants,
            driven,
            pattern,
            graph,
            reconstructed,
            declared,
            values,
        })
    }

    /// The model with all its coordinates.
    #[must_use]
    pub fn model(&self) -> &Interpreted {
        &self.model
    }

    /// Values of the parameters in which the rows are linear.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// The coordinates that every input drives.
    #[must_use]
    pub fn driven(&self) -> &[Vec<usize>] {
        &self.driven
    }

    /// The map from motions to the inputs that they need.
    #[must_use]
    pub fn demand(&self) -> Demand<'_> {
        Demand::new(&self.model, &self.parameters, &self.constants, &self.driven)
    }

    /// The highest derivative of a coordinate that an input depends on. It equals the order of the rows where no
    /// coordinate is reconstructed from derivatives of others.
    #[must_use]
    pub fn highest_derivative(&self) -> usize {
        let leaves = self.reconstructed.iter().flat_map(|(_, expr)| self.graph.leaves(*expr));
        let orders = leaves.filter_map(|leaf| match self.graph.node(leaf) {
            Node::Derivative(_, order) => Some(*order as usize),
            _ => None,
        });
        self.model.dims().order + orders.max().unwrap_or(0)
    }

    /// The motion of all coordinates for amplitudes in the order of the pattern and a frequency (rad/s).
    #[must_use]
    pub fn trajectory(&self, amplitudes: &[f64], frequency: f64) -> Trajectory {
        let declared = self.pattern.trajectory(amplitudes, frequency);
        // The pattern lists the coordinates as declared; the rows list only those that they use.
        let coordinates =
            self.declared.iter().map(|&c| declared.coordinates.get(c as usize).cloned().unwrap_or_default()).collect();
        let mut trajectory = Trajectory { frequency, coordinates };
        for (place, expr) in &self.reconstructed {
            trajectory.coordinates[*place] = self.reconstruct(&declared, *expr);
        }
        trajectory
    }

    fn reconstruct(&self, motion: &Trajectory, expr: ExprId) -> HarmonicSeries {
        let mut wave: Vec<f64> = (0..SERIES_SAMPLES)
            .map(|k| {
                let phase = std::f64::consts::TAU * k as f64 / SERIES_SAMPLES as f64;
                self.graph.evaluate(expr, |leaf| match leaf {
                    Node::Derivative(c, order) => motion
                        .coordinates
                        .get(c.0 as usize)
                        .map_or(0.0, |series| series.derivative(phase, motion.frequency, *order as usize)),
                    Node::Symbol(symbol) => self.values.get(symbol).copied().unwrap_or(f64::NAN),
                    _ => 0.0,
                })
            })
            .collect();
        let forward = fourier::forward(SERIES_SAMPLES);
        let mut spectrum = vec![realfft::num_complex::Complex::default(); SERIES_SAMPLES / 2 + 1];
        forward.process(&mut wave, &mut spectrum).expect("invariant: buffers of this length");
        let largest = spectrum.iter().map(|line| line.norm()).fold(0.0, f64::max);
        let scale = 2.0 / SERIES_SAMPLES as f64;
        let lines = (1u32..)
            .zip(spectrum.iter().skip(1).take(SERIES_SAMPLES / 4))
            .filter(|(_, line)| line.norm() > 1e-13 * largest)
            .map(|(harmonic, line)| Line { harmonic, cos: scale * line.re, sin: -scale * line.im })
            .collect();
        HarmonicSeries { mean: spectrum[0].re / SERIES_SAMPLES as f64, lines }
    }
}
