//! Models with eliminated coordinates: lumped parameters from the motion of what remains, physical ones from both.
//!
//! A chain whose free cart is the output has the one row `B(x_l) c = u` (Feng, Eqns 4.12, 4.34), linear in lumped parameters c
//! of which there are more than physical ones p. Under noise some of the c cannot be determined (two carts: c3 to c5), while all
//! of the p can. Invariant: p minimises the weighted squares of the harmonic equations of `B c(p) = u` themselves, over all
//! runs, with weights that belong to c(p). The c are also estimated without their relations, and reported as poorly
//! determined where they are.

use crate::physical::{Physical, PhysicalError, PhysicalFit, PhysicalSettings};
use std::sync::Arc;
use tpm_core::model::Model;
use tpm_estimate::Estimate;
use tpm_estimate::EstimateError;
use tpm_estimate::Estimator;
use tpm_estimate::Information;
use tpm_estimate::Run;
use tpm_estimate::Settings;
use tpm_estimate::{Evidence, POOR, Status};
use tpm_estimate::{Fitted, MeasuredMotion, Structure, estimate_structured, refine_last};
use tpm_interpret::Interpreted;
use tpm_numerics::{DMatrix, Matrix};
use tpm_symbolic::regressor::prepare::Prepared;

/// Why the eliminated form of a model cannot be used with its machine.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EliminatedError {
    /// A signal or a constant of the eliminated form is not the machine's.
    #[error("the machine has no {kind} `{name}`")]
    Missing {
        /// coordinate, input, constant or parameter.
        kind: &'static str,
        /// Name of the signal, constant or parameter.
        name: String,
    },
    /// The equations before the elimination are not linear in the physical parameters.
    #[error(
        "the equations are linear in `{name}`, not in physical parameters, even before coordinates are eliminated; leave out `eliminate` to identify it"
    )]
    Lumped {
        /// The lumped parameter.
        name: String,
    },
    /// The settings of the physical parameters have a fault.
    #[error(transparent)]
    Physical(#[from] PhysicalError),
}

/// A model with coordinates eliminated, beside the machine that it came from.
#[derive(Clone, Debug)]
pub struct Eliminated {
    model: Interpreted,
    fit: PhysicalFit,
    /// Channels of the machine's record: coordinates, then inputs.
    channels: Vec<usize>,
    constants: Vec<usize>,
    /// Index of each of the machine's parameters among the physical ones.
    parameters: Vec<usize>,
}

impl Eliminated {
    /// The eliminated form of a model whose own equations are `machine`.
    ///
    /// # Errors
    /// [`EliminatedError`] when a name of the eliminated form is not the machine's, the machine's own parameters are lumped, or
    /// the settings have a fault.
    pub fn new(
        prepared: &Prepared,
        machine: &dyn Model<f64>,
        settings: &PhysicalSettings,
    ) -> Result<Self, EliminatedError> {
        let model = Interpreted::new(&prepared.model, &prepared.form);
        let fit = PhysicalFit::new(prepared, settings)?;
        let (own, whole) = (model.dims(), machine.dims());
        let missing = |kind, name: &str| EliminatedError::Missing { kind, name: name.to_string() };
        let mut channels = Vec::with_capacity(own.coordinates + own.inputs);
        for i in 0..own.coordinates {
            let name = model.coordinate(i).name;
            let at = (0..whole.coordinates).find(|&c| machine.coordinate(c).name == name);
            channels.push(at.ok_or_else(|| missing("coordinate", name))?);
        }
        for i in 0..own.inputs {
            let name = model.input(i).name;
            let at = (0..whole.inputs).find(|&c| machine.input(c).name == name);
            channels.push(whole.coordinates + at.ok_or_else(|| missing("input", name))?);
        }
        let mut constants = Vec::with_capacity(own.constants);
        for i in 0..own.constants {
            let name = model.constant(i).name;
            let at = (0..whole.constants).find(|&c| machine.constant(c).name == name);
            constants.push(at.ok_or_else(|| missing("constant", name))?);
        }
        let mut parameters = Vec::with_capacity(whole.parameters);
        for j in 0..whole.parameters {
            let name = machine.parameter(j).name;
            let at = fit.names().position(|physical| physical == name);
            parameters.push(at.ok_or_else(|| EliminatedError::Lumped { name: name.to_string() })?);
        }
        if let Some(name) = fit.names().find(|name| (0..whole.parameters).all(|j| machine.parameter(j).name != *name)) {
            return Err(missing("parameter", name));
        }
        Ok(Eliminated { model, fit, channels, constants, parameters })
    }

    /// The eliminated form.
    #[must_use]
    pub const fn model(&self) -> &Interpreted {
        &self.model
    }

    /// The estimator of the machine's own, physical parameters.
    #[must_use]
    pub fn estimator(self: &Arc<Self>, settings: &Settings) -> Box<dyn Estimator> {
        Box::new(EliminatedMotion {
            form: Arc::clone(self),
            settings: Settings { prior: Vec::new(), frozen: Vec::new(), ..settings.clone() },
            records: Vec::new(),
            start: Vec::new(),
            lumped: None,
            warnings: Vec::new(),
        })
    }
}

/// The estimator: measured motion of the coordinates that remain, over all runs.
struct EliminatedMotion {
    form: Arc<Eliminated>,
    settings: Settings,
    records: Vec<MeasuredMotion>,
    /// Physical parameters to start from.
    start: Vec<f64>,
    lumped: Option<Estimate>,
    warnings: Vec<String>,
}

/// The search for physical parameters.
struct Search<'a> {
    form: &'a Eliminated,
    found: Option<Physical>,
    start: &'a [f64],
}

impl Structure for Search<'_> {
    fn explain(&mut self, information: &Information, gradient: &[f64]) -> Option<Vec<f64>> {
        let start = self.found.as_ref().map_or(self.start, |found| &found.values);
        let found = self.form.fit.of_information(information, Some(gradient), start);
        Some(self.found.insert(found).lumped.clone())
    }
}

impl Estimator for EliminatedMotion {
    fn name(&self) -> &'static str {
        "measured-motion"
    }

    fn reduce(&mut self, machine: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError> {
        let form = Arc::clone(&self.form);
        let dims = machine.dims();
        if run.spectra.lines.len() != dims.coordinates + dims.inputs {
            return Err(EstimateError::Channels {
                needed: dims.coordinates + dims.inputs,
                given: run.spectra.lines.len(),
            });
        }
        let spectra = run.spectra.select(&form.channels);
        let constants: Vec<f64> = form.constants.iter().map(|&c| run.trial.constants[c]).collect();
        let record = MeasuredMotion::new(&form.model, &constants, &spectra, run.hold, &self.settings)?;
        self.records.push(record);
        self.start = vec![1.0; dims.parameters];
        for (&at, &value) in form.parameters.iter().zip(&run.trial.parameters) {
            self.start[at] = value;
        }
        let mut search = Search { form: &form, found: None, start: &self.start };
        let settings = &self.settings;
        let mut first = |records: &mut [MeasuredMotion]| Ok(estimate_structured(records, settings, &mut search)?.theta);
        let refined = refine_last(&mut self.records, &form.model, &constants, &spectra, run.hold, &mut first);
        // The next search, with the refined noise, starts where this one ended.
        if let Some(found) = search.found {
            self.start = found.values;
        }
        if refined.is_err() {
            self.records.pop();
        }
        refined
    }

    fn update(&mut self) -> Result<Option<Estimate>, EstimateError> {
        let form = Arc::clone(&self.form);
        let mut search = Search { form: &form, found: None, start: &self.start };
        let fitted = estimate_structured(&mut self.records, &self.settings, &mut search);
        match (fitted, search.found) {
            (Ok(Fitted { estimate, .. }), Some(physical)) => {
                let found = form.estimate(&physical, &estimate);
                self.warnings.clone_from(&physical.warnings);
                self.lumped = Some(estimate);
                Ok(Some(found))
            }
            (fitted, _) => {
                self.records.pop();
                fitted.map(|_| None)
            }
        }
    }

    fn harmonics(&self) -> usize {
        self.records.last().map_or(0, MeasuredMotion::harmonics)
    }

    fn lumped(&self) -> Option<(&dyn Model<f64>, &Estimate)> {
        self.lumped.as_ref().map(|estimate| (&self.form.model as &dyn Model<f64>, estimate))
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

impl Eliminated {
    /// The physical parameters in the machine's order. Residuals beyond the noise of the lumped parameters' equations widen
    /// their deviations too.
    fn estimate(&self, physical: &Physical, lumped: &Estimate) -> Estimate {
        let count = self.parameters.len();
        let inflation = lumped.chi_squared.max(1.0);
        let order = &self.parameters;
        let values: Vec<f64> = order.iter().map(|&i| physical.values[i]).collect();
        let covariance = DMatrix::from_fn(count, count, |r, c| inflation * physical.covariance[(order[r], order[c])]);
        let mut std = vec![0.0; count];
        let mut status = vec![Status::Identified; count];
        for (j, &i) in order.iter().enumerate() {
            std[j] = covariance[(j, j)].max(0.0_f64).sqrt();
            status[j] = match physical.status[i] {
                // Wider deviations change nothing of what is already doubtful, or not estimated.
                Status::Identified => {
                    Status::of(Evidence::Shown { value: values[j], std: std[j], felt: f64::INFINITY }, POOR)
                }
                settled => settled,
            };
            if status[j] == Status::Unobservable {
                std[j] = f64::INFINITY;
            }
        }
        let unobservable =
            physical.unobservable.iter().map(|direction| order.iter().map(|&i| direction[i]).collect()).collect();
        Estimate {
            values,
            std,
            covariance: Matrix::of(covariance),
            status,
            rank: physical.rank,
            unobservable,
            condition: physical.condition,
            residual: lumped.residual,
            chi_squared: lumped.chi_squared,
            model_error: lumped.model_error.clone(),
        }
    }
}
