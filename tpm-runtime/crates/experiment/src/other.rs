//! A simulated machine that obeys another model than the one that is identified.
//!
//! Invariant: its signals are those of the model that is identified, by name and order, so that records of it are records of the model.

use crate::error::ExperimentError;
use crate::file::{Experiment, Named, OtherMachine, PlantModelSection};
use std::sync::Arc;
use tpm_controller::model::Model;
use tpm_plant::simulated::ClosedLoopArm;

impl Experiment {
    /// The path of the file with the simulated machine's model, when the experiment names one.
    #[must_use]
    pub fn plant_file(&self) -> Option<&str> {
        match &self.plant.model {
            Some(PlantModelSection::File(path)) => Some(path),
            _ => None,
        }
    }

    /// The text of the simulated machine's model, where it obeys another one than that which is identified.
    ///
    /// # Errors
    /// [`ExperimentError::PlantModel`] when the file that the experiment names was not read.
    pub fn plant_text(&self) -> Result<Option<&str>, ExperimentError> {
        match &self.plant.model {
            None => Ok(None),
            Some(PlantModelSection::Text { text }) => Ok(Some(text)),
            Some(PlantModelSection::File(path)) => Err(ExperimentError::PlantModel {
                message: format!("the file {path} was not read; put its text in its place, plant.model.text"),
            }),
        }
    }

    /// Puts the evaluated model of the simulated machine beside its text, with the true values by the names of its own parameters.
    pub fn set_machine(&mut self, model: Arc<dyn Model<f64>>, parameters: Named) {
        self.plant.machine = Some(OtherMachine { model, parameters });
    }

    /// The simulated machine of an experiment whose machine does not obey the model; `None` where it does.
    ///
    /// # Errors
    /// [`ExperimentError::Machine`] and [`ExperimentError::PlantModel`] when its signals are not those of the model,
    /// [`ExperimentError::Invalid`] for a value that makes no sense.
    pub fn other_plant(&self, model: &dyn Model<f64>) -> Result<Option<Arc<dyn Model<f64>>>, ExperimentError> {
        if let Some(arm) = self.closed_loop_arm(model)? {
            if self.plant.model.is_some() {
                let message = "plant.closed_loop_arm is another machine: leave one of the two out".into();
                return Err(ExperimentError::PlantModel { message });
            }
            return Ok(Some(Arc::new(arm)));
        }
        let Some(text) = self.plant_text()? else { return Ok(None) };
        let Some(OtherMachine { model: other, .. }) = &self.plant.machine else {
            let begin = text.lines().next().unwrap_or_default();
            let message =
                format!("the text that begins with `{begin}` was not read as a model (Session::new reads it)");
            return Err(ExperimentError::PlantModel { message });
        };
        let (own, wanted) = (signals(other.as_ref()), signals(model));
        if own == wanted {
            return Ok(Some(other.clone()));
        }
        Err(ExperimentError::PlantModel {
            message: format!(
                "{} has {}, and the model that is identified has {}: give both the same, in the same order",
                other.name(),
                shown(&own),
                shown(&wanted)
            ),
        })
    }

    /// The closed-loop arm, where that is the machine.
    ///
    /// # Errors
    /// See [`Self::other_plant`].
    pub fn closed_loop_arm(&self, model: &dyn Model<f64>) -> Result<Option<ClosedLoopArm>, ExperimentError> {
        let Some(arm) = self.arm()? else { return Ok(None) };
        let (own, wanted) = (arm.dims(), model.dims());
        let fits = (own.coordinates, own.inputs, own.order) == (wanted.coordinates, wanted.inputs, wanted.order);
        if fits { Ok(Some(arm)) } else { Err(ExperimentError::Machine) }
    }
}

/// Names of coordinates and inputs, and the order of the equations.
type Signals<'m> = (Vec<&'m str>, Vec<&'m str>, usize);

fn signals(model: &dyn Model<f64>) -> Signals<'_> {
    let dims = model.dims();
    let coordinates = (0..dims.coordinates).map(|c| model.coordinate(c)).map(|label| label.name);
    (coordinates.collect(), (0..dims.inputs).map(|i| model.input(i).name).collect(), dims.order)
}

fn shown((coordinates, inputs, order): &Signals<'_>) -> String {
    format!("coordinates {} and inputs {} of order {order}", coordinates.join(", "), inputs.join(", "))
}
