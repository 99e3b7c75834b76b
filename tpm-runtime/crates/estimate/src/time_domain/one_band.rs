//! A record in one band, in which several models are compared.

use crate::error::EstimateError;
use crate::result::Estimate;
use crate::settings::Settings;
use crate::time_domain::band::cut_off;
use crate::time_domain::equations::{Equations, Machine};
use crate::time_domain::fit::fit;
use crate::time_domain::low_pass::LowPass;
use crate::time_domain::motion::{Motion, TimeRecord};
use tpm_controller::derivatives::RowDerivatives;
use tpm_controller::model::Model;

/// A record in one band.
pub struct OneBand<'a> {
    record: &'a TimeRecord<'a>,
    motion: Motion,
    low_pass: LowPass,
}

impl std::fmt::Debug for OneBand<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OneBand").field("cut_off", &self.low_pass.cut_off).finish_non_exhaustive()
    }
}

impl<'a> OneBand<'a> {
    /// A record in the band that suits its motion.
    ///
    /// # Errors
    /// [`EstimateError::NoSignal`] when the stretches are too short for any band.
    pub fn new(record: &'a TimeRecord<'a>) -> Result<Self, EstimateError> {
        let motion = Motion::new(record, false)?;
        let cut_off = cut_off(&motion, record.sample_time).ok_or(EstimateError::NoSignal)?;
        Ok(Self { record, motion, low_pass: LowPass { cut_off } })
    }

    /// Estimates the parameters of a model; `derivatives` tell where signs jump.
    ///
    /// # Errors
    /// [`EstimateError::NoSignal`] when the record shows no more than noise; [`EstimateError::Model`] and [`EstimateError::NotFinite`] when
    /// the rows cannot be evaluated on the motion; [`EstimateError::Frozen`] and [`EstimateError::AllFrozen`] when parameters are held that
    /// do not exist, or all.
    pub fn estimate(
        &self,
        model: &dyn Model<f64>,
        derivatives: Option<&dyn RowDerivatives<f64>>,
        constants: &[f64],
        settings: &Settings,
    ) -> Result<Estimate, EstimateError> {
        let dims = model.dims();
        let free = settings.free(dims.parameters)?;
        let machine = Machine { model, derivatives, constants };
        let equations = Equations::of(machine, self.record, &self.motion, self.low_pass)?;
        fit(&equations, dims, &free, settings).map(|fitted| fitted.estimate).ok_or(EstimateError::NoSignal)
    }
}
