//! A simulated machine as whoever plays trials.

use crate::machine::simulated::rig::Rig;
use crate::machine::simulated::simulation::simulate;
use crate::run::{Bench, BenchError, Record, Trial};
use tpm_core::model::Model;

/// A plant that obeys a model, with the rig around it.
#[derive(Clone)]
pub struct SimulatedBench<'a> {
    plant: &'a dyn Model<f64>,
    rig: Rig,
}

impl std::fmt::Debug for SimulatedBench<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SimulatedBench").field("plant", &self.plant.name()).field("rig", &self.rig).finish()
    }
}

impl<'a> SimulatedBench<'a> {
    /// A plant that obeys `plant` with the parameters, sensors and drives of the rig.
    #[must_use]
    pub const fn new(plant: &'a dyn Model<f64>, rig: Rig) -> Self {
        SimulatedBench { plant, rig }
    }

    /// The rig, to change it between runs: parameters that drift, a sensor that fails.
    pub const fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }
}

impl Bench for SimulatedBench<'_> {
    /// # Errors
    /// [`EvalError`](tpm_core::model::EvalError) when plant, rig and trial do not fit together, or the plant's rows do not
    /// determine its motion.
    fn play(&mut self, trial: &Trial) -> Result<Record, BenchError> {
        Ok(simulate(self.plant, &self.rig, trial)?)
    }
}

#[cfg(test)]
mod tests {
    use super::SimulatedBench;
    use crate::campaign::Campaign;
    use crate::experiment::Experiment;
    use crate::machine::simulated::simulate;
    use crate::run::Bench;
    use crate::run::trajectory::tests::rest_to_rest_3;
    use crate::test_models::MassSpringDrag;
    use tpm_core::harmonics::Hold;

    #[test]
    fn a_bench_plays_what_the_simulation_gives() {
        let file = include_str!("../../../../models/mass_spring_drag.toml");
        let experiment = Experiment::parse(file).expect("the shipped file is right");
        let setup = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::Zoh).expect("fits");
        let campaign = Campaign::new(&MassSpringDrag, setup).expect("playable");
        let trial = campaign.next().expect("first");
        let rig = experiment.bench(&MassSpringDrag).expect("fits");
        let expected = simulate(&MassSpringDrag, &rig, trial).expect("regular");
        let mut simulated = SimulatedBench::new(&MassSpringDrag, rig);
        let bench: &mut dyn Bench = &mut simulated;
        assert_eq!(bench.play(trial).expect("regular"), expected);
        simulated.rig_mut().sensors.clear();
        assert!(simulated.play(trial).is_err());
    }
}
