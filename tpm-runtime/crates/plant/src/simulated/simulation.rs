//! A trial on a simulated machine, sample by sample.
//!
//! Invariant: a run depends on the trial, the rig and its seed alone. All memory is reserved before the first sample; the
//! loop itself allocates nothing.

use crate::simulated::rig::Rig;
use crate::simulated::sensor::{Measurement, Sensor, apply};
use crate::simulated::transmission::Transmission;
use tpm_controller::model::{Buffer, EvalError, Model, require_len};
use tpm_motion::{Controller, Ending, Plant, Record, Trial};

/// One run on a simulated machine.
#[derive(Debug)]
pub struct SimulatedRun<'a> {
    trial: &'a Trial,
    rig: &'a Rig,
    plant: Plant<'a>,
    measurement: Measurement,
    transmission: Transmission,
    controller: Controller<'a>,
    measured: Vec<f64>,
    wanted: Vec<f64>,
    coordinates: Vec<Vec<f64>>,
    inputs: Vec<Vec<f64>>,
    rated: Vec<f64>,
    rate_columns: Vec<Option<Vec<f64>>>,
    sample: usize,
    saturated: usize,
}

impl<'a> SimulatedRun<'a> {
    /// Puts the plant to rest at the start of the reference and reserves all memory.
    ///
    /// # Errors
    /// [`EvalError`] when rig or trial do not fit the model.
    pub fn new(model: &'a dyn Model<f64>, rig: &'a Rig, trial: &'a Trial) -> Result<Self, EvalError> {
        let dims = model.dims();
        let (n, period) = (dims.coordinates, trial.samples_per_period);
        require_len(Buffer::Motion, rig.sensors.len(), n)?;
        require_len(Buffer::Inputs, rig.actuators.len(), dims.inputs)?;
        require_len(Buffer::Motion, trial.reference.len(), period * dims.motion_len())?;
        require_len(Buffer::Motion, trial.tracking_bounds.len(), n)?;
        require_len(Buffer::Inputs, trial.feed_forward.len(), period * dims.inputs)?;
        let mut plant = Plant::new(model, &rig.parameters, &rig.constants)?;
        let mut start = vec![0.0; dims.motion_len()];
        if let Some(first) = trial.reference.get(..n) {
            start[..n].copy_from_slice(first);
        }
        plant.reset(&start)?;
        let reserve = |count: usize| (0..count).map(|_| Vec::with_capacity(trial.samples())).collect();
        Ok(SimulatedRun {
            trial,
            rig,
            plant,
            measurement: Measurement::new(&rig.sensors, rig.seed, trial.run),
            transmission: Transmission::new(&rig.actuators, trial.control.sample_time, rig.sub_steps),
            controller: Controller::new(dims, trial),
            measured: vec![0.0; n],
            wanted: vec![0.0; dims.inputs],
            coordinates: reserve(n),
            inputs: reserve(dims.inputs),
            rated: vec![0.0; n],
            rate_columns: if rig.sensors.iter().any(|sensor| sensor.rate_noise.is_some()) {
                let column = |sensor: &Sensor| sensor.rate_noise.map(|_| Vec::with_capacity(trial.samples()));
                rig.sensors.iter().map(column).collect()
            } else {
                Vec::new()
            },
            sample: 0,
            saturated: 0,
        })
    }

    /// The machine's motion at the sample that is played next, without the noise of the sensors.
    #[must_use]
    pub fn motion(&self) -> &[f64] {
        self.plant.motion()
    }

    /// Plays one sample; the ending when the run ended with it.
    ///
    /// # Errors
    /// [`EvalError`] when the plant's rows cannot be evaluated although its motion is finite (a zero mass).
    pub fn step(&mut self) -> Result<Option<Ending>, EvalError> {
        if self.sample >= self.trial.samples() {
            return Ok(Some(Ending::Complete));
        }
        let n = self.measured.len();
        self.measurement.sample(self.plant.motion(), &mut self.measured);
        self.measurement.rates(self.plant.motion(), &mut self.rated);
        for (column, &value) in self.rate_columns.iter_mut().zip(&self.rated) {
            if let Some(column) = column {
                column.push(value);
            }
        }
        let (motion, rated, sensors) = (self.plant.motion(), &self.rated, &self.rig.sensors);
        let rate = |c: usize| match sensors.get(c).and_then(|sensor| sensor.rate_noise) {
            Some(_) => rated.get(c).copied(),
            None => motion.get(n + c).copied(),
        };
        self.controller.step(&self.measured, rate, &mut self.wanted)?;
        self.saturated +=
            usize::from(apply(&self.rig.actuators, (self.plant.motion(), n), &mut self.wanted, &mut self.inputs));
        for (&value, column) in self.measured.iter().zip(&mut self.coordinates) {
            column.push(value);
        }
        let sample = self.sample;
        self.sample += 1;
        let motion = self.plant.motion();
        if let Some(ending) = self.controller.ending(&self.measured, |c| motion.get(n + c).copied()) {
            return Ok(Some(ending));
        }
        let diverged = self.transmission.advance(&mut self.plant, &self.wanted)?;
        Ok(diverged.then_some(Ending::Diverged { sample }))
    }

    /// Plays the whole run.
    ///
    /// # Errors
    /// [`EvalError`] when the plant's rows cannot be evaluated although its motion is finite (a zero mass).
    pub fn play(&mut self) -> Result<Ending, EvalError> {
        loop {
            if let Some(ending) = self.step()? {
                return Ok(ending);
            }
        }
    }

    /// The record of the run, with the ending that [`play`](Self::play) returned.
    #[must_use]
    pub fn record(self, ending: Ending) -> Record {
        Record {
            sample_time: self.trial.control.sample_time,
            coordinates: self.coordinates,
            inputs: self.inputs,
            rates: self.rate_columns,
            ending,
            saturated: self.saturated,
        }
    }
}

/// Plays a trial on a simulated machine.
///
/// # Errors
/// [`EvalError`] when model, rig and trial do not fit together, or the plant's rows do not determine its motion.
pub fn simulate(model: &dyn Model<f64>, rig: &Rig, trial: &Trial) -> Result<Record, EvalError> {
    let mut run = SimulatedRun::new(model, rig, trial)?;
    let ending = run.play()?;
    Ok(run.record(ending))
}
