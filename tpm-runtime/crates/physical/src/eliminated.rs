//! Models with eliminated coordinates: lumped parameters from the motion of the remaining coordinates, and physical
//! parameters from the lumped ones and the harmonic equations.
//!
//! A chain whose free cart is the output has the single row `B(x_l) c = u` (Feng, Eqns 4.12, 4.34). It is linear in
//! lumped parameters c, of which there are more than physical parameters p. Under noise some of the c cannot be
//! determined (two carts: c3 to c5), while all of the p can. Invariant: p minimises the weighted sum of squares of the
//! harmonic equations `B c(p) = u` over all runs, with weights that belong to c(p). The c are also estimated without
//! their relations to p, and are reported as poorly determined where they are.

use crate::physical::{Physical, PhysicalError, PhysicalFit, PhysicalSettings};
use std::sync::Arc;
use tpm_controller::model::Model;
use tpm_estimate::{
    Estimate, EstimateError, Estimator, Evidence, Fitted, Information, MeasuredMotion, POOR_DEVIATION, PhysicalRemark,
    ResidualOf, Run, Settings, Status, Structure, estimate_structured, refine_last,
};
use tpm_interpret::Interpreted;
use tpm_numerics::{DMatrix, Matrix};
use tpm_symbolic::regressor::prepare::Prepared;

/// Why the eliminated form of a model cannot be used with its machine.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EliminatedError {
    /// A signal or constant of the eliminated form does not exist in the machine's own model.
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
    /// Prepares the eliminated form of a model; `machine` is the model before the elimination.
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

    /// The estimator of the physical parameters, which are the parameters of the machine's own model.
    #[must_use]
    pub fn estimator(self: &Arc<Self>, settings: &Settings) -> Box<dyn Estimator> {
        Box::new(EliminatedMotion {
            form: Arc::clone(self),
            settings: Settings { prior: Vec::new(), frozen: Vec::new(), ..settings.clone() },
            records: Vec::new(),
            start: Vec::new(),
            lumped: None,
            remarks: Vec::new(),
        })
    }
}

/// The estimator `measured-motion` on the remaining coordinates, over all runs.
struct EliminatedMotion {
    form: Arc<Eliminated>,
    settings: Settings,
    records: Vec<MeasuredMotion>,
    /// Physical parameters to start from.
    start: Vec<f64>,
    lumped: Option<Estimate>,
    remarks: Vec<PhysicalRemark>,
}

/// The search for the physical parameters.
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
        // The next search, which uses the refined noise, starts where this one ended.
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
                self.remarks.clone_from(&physical.remarks);
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

    fn remarks(&self) -> &[PhysicalRemark] {
        &self.remarks
    }
}

impl Eliminated {
    /// The estimate of the physical parameters in the machine's order. Residuals of the lumped parameters' equations
    /// beyond their noise widen the standard deviations of the physical parameters too.
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
                // Wider standard deviations change no status other than "identified".
                Status::Identified => {
                    Status::of(Evidence::Shown { value: values[j], std: std[j], felt: f64::INFINITY }, POOR_DEVIATION)
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
            scales: Vec::new(),
            condition: physical.condition,
            residual: lumped.residual,
            residual_of: ResidualOf::Force,
            chi_squared: lumped.chi_squared,
            model_error: lumped.model_error.clone(),
        }
    }
}
