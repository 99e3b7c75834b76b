//! A model with its values, ready for every step of the study.

use super::failure::Failure;
use super::input::Input;
use std::collections::BTreeMap;
use tpm_codegen::diagnostic;
use tpm_runtime::experiment::Named;
use tpm_runtime::frequency::TransferFunction;
use tpm_runtime::interpret::Interpreted;
use tpm_runtime::model::Model as _;
use tpm_runtime::plant::simulated::{Actuator, Rig, Sensor};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::linear::linearize::{Linearization, OperatingPoint, StateSpace, linearize};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::mechanics::pattern::Pattern;
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::{Prepared, prepare};

/// A model of two coordinates and one input with its values, linearised at rest in zero.
pub(super) struct Machine {
    /// The model sorted into the parameters in which it is linear.
    pub(super) prepared: Prepared,
    /// The sorted model, evaluated without compiling.
    pub(super) interpreted: Interpreted,
    linear_model: ExactModel,
    linear: Linearization,
    values: BTreeMap<Symbol, Rational>,
}

impl Machine {
    /// The model of a file with the values of another.
    ///
    /// # Errors
    ///
    /// A file is faulty, a value is missing, or the model is not one of two coordinates and one input.
    pub(super) fn load(file: &Input, values: &Input) -> Result<Self, Failure> {
        let (source, parsed) = file.model()?;
        let prepared = prepare(parsed.model.clone())
            .map_err(|error| Failure::Model(diagnostic::render(&source, &parsed.locate(&error))))?;
        let mut linear_model = parsed.model;
        let values = values.values(&linear_model)?;
        let symbols = linear_model.parameters().chain(linear_model.run_time_constants());
        let missing: Vec<&str> = symbols
            .filter(|symbol| !values.contains_key(symbol))
            .map(|symbol| linear_model.quantity(symbol).name.as_str())
            .collect();
        if !missing.is_empty() {
            return Err(file.fault(format!("the parameter file gives no value of {}", missing.join(", "))));
        }
        let interpreted = Interpreted::new(&prepared.model, &prepared.form);
        let dims = interpreted.dims();
        if dims.coordinates != 2 || dims.inputs != 1 {
            return Err(file.fault("the study is of two coordinates, arm and pendulum, and one input"));
        }
        let linear = linearize(&mut linear_model, &OperatingPoint::default()).map_err(|error| file.fault(error))?;
        Ok(Machine { prepared, interpreted, linear_model, linear, values })
    }

    fn value(&self, symbol: Symbol) -> f64 {
        self.values.get(&symbol).map_or(f64::NAN, rational::to_f64)
    }

    /// The pattern of this name, the model's first when there is no name.
    pub(super) fn pattern(&self, name: Option<&str>) -> Option<&Pattern> {
        self.linear_model.pattern(name)
    }

    /// Values of parameters and constants, by name.
    pub(super) fn values(&self, symbols: &[Symbol]) -> Named {
        symbols
            .iter()
            .map(|&symbol| (self.prepared.model.quantity(symbol).name.to_string(), self.value(symbol)))
            .collect()
    }

    /// Value of a parameter or constant by name.
    pub(super) fn named(&self, name: &str) -> f64 {
        self.prepared.model.find_symbol(name).map_or(f64::NAN, |symbol| self.value(symbol))
    }

    /// Values of the parameters in which the model is linear, by name.
    pub(super) fn lumped(&self) -> BTreeMap<String, f64> {
        let map = ParameterMap::new(&self.prepared);
        map.columns().iter().cloned().zip(map.evaluate(|symbol| self.value(symbol))).collect()
    }

    /// A and B, with some values replaced.
    pub(super) fn state_space(&self, replaced: &BTreeMap<String, f64>) -> StateSpace<f64> {
        self.linear.evaluate(&self.linear_model, |symbol| {
            let name = &self.linear_model.quantity(symbol).name;
            replaced.get(name.as_str()).copied().unwrap_or_else(|| self.value(symbol))
        })
    }

    /// The transfer function of the pendulum's angle over the input, exact until it is written in doubles, and the poles that
    /// cancelled.
    pub(super) fn transfer_function(
        &self,
    ) -> Result<(TransferFunction, Vec<tpm_runtime::frequency::Complex>), Failure> {
        let fault = |what: &str| Failure::Input(format!("{}: {what}", self.linear_model.name));
        let space = self.linear.evaluate_exact(&self.linear_model, |symbol| self.values.get(&symbol).cloned());
        let space = space.ok_or_else(|| fault("an entry of the linear model is not rational"))?;
        let output: Vec<_> = (0..space.a.len()).map(|state| rational::integer(i64::from(state == 1))).collect();
        let exact = space.transfer_function(&output, 0).ok_or_else(|| fault("there is no transfer function"))?;
        let float = |polynomial: &[Rational]| -> Vec<f64> { polynomial.iter().map(rational::to_f64).collect() };
        let made = |numerator: &[f64], denominator: &[f64]| {
            TransferFunction::new(numerator, denominator).map_err(|error| fault(&error.to_string()))
        };
        let function = made(&float(&exact.numerator), &float(&exact.denominator))?;
        Ok((function, made(&[1.0], &float(&exact.cancelled))?.poles()))
    }

    /// The linearised model with its symbols, for a fit.
    pub(super) const fn linearized(&self) -> (&ExactModel, &Linearization) {
        (&self.linear_model, &self.linear)
    }

    /// The simulated machine.
    pub(super) fn bench(&self, sensors: Vec<Sensor>, limit: f64, seed: u64) -> Rig {
        let lumped = self.lumped();
        let dims = self.interpreted.dims();
        Rig {
            parameters: (0..dims.parameters).map(|j| lumped[self.interpreted.parameter(j).name]).collect(),
            constants: (0..dims.constants).map(|j| self.named(self.interpreted.constant(j).name)).collect(),
            sensors,
            actuators: vec![Actuator { limit, ..Actuator::default() }],
            sub_steps: 1,
            seed,
        }
    }
}
