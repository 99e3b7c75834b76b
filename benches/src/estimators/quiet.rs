//! Updates on exact machines.

use crate::estimators::cell::Cell;
use crate::honesty::machines::Shipped;
use rayon::prelude::*;
use std::error::Error;
use tpm_runtime::estimate::Method;
use tpm_runtime::study::{Convergence, convergence};

/// Most updates that are played.
const MOST: usize = 12;
/// Samples, and integration steps, in a period.
const STEPS: usize = 4096;

/// The updates of every estimator to 1e-6, at the first stage.
///
/// # Errors
/// Whatever keeps the machine from being simulated.
pub fn updates(machine: &Shipped) -> Result<Vec<Cell>, Box<dyn Error>> {
    let session = machine.session(machine.experiment())?;
    let (plant, pattern, experiment) = (session.machine().plant(), session.machine().pattern(), session.experiment());
    let one = |method: &Method| {
        convergence(plant, pattern, experiment, *method, 0, MOST, STEPS).map_err(|error| error.to_string())
    };
    let found: Vec<Convergence> = Method::ALL.par_iter().map(one).collect::<Result<_, _>>()?;
    Ok(found.iter().map(cell).collect())
}

/// The updates of one estimator at the first stage, from estimates of which every other one is as much too large, by this share of the
/// true values, as the others are too small.
///
/// # Errors
/// Whatever keeps the machine from being simulated.
pub fn from_priors(machine: &Shipped, method: Method, off: f64, most: usize) -> Result<Convergence, Box<dyn Error>> {
    let mut experiment = machine.experiment();
    for (i, (name, value)) in experiment.plant.parameters.iter().enumerate() {
        let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
        experiment.prior.insert(name.clone(), value * (1.0 + off * sign));
    }
    let session = machine.session(experiment)?;
    let (plant, pattern, experiment) = (session.machine().plant(), session.machine().pattern(), session.experiment());
    Ok(convergence(plant, pattern, experiment, method, 0, most, STEPS / 4)?)
}

fn cell(found: &Convergence) -> Cell {
    let each = if found.runs_per_update > 1 { format!(" [{}]", found.runs_per_update) } else { String::new() };
    match (found.updates[1], found.errors.last(), &found.reason) {
        (Some(updates), ..) => Cell { text: format!("{updates}{each}"), note: None },
        (None, None, Some(reason)) => Cell { text: "-".into(), note: Some(reason.clone()) },
        (None, Some(last), Some(reason)) => {
            Cell { text: format!("{last:.0e} after {}{each}", found.errors.len()), note: Some(reason.clone()) }
        }
        (None, Some(last), None) => {
            let least = found.errors.iter().copied().fold(f64::INFINITY, f64::min);
            let early = "the other runs contradict those before them, or took updates back, and are no updates";
            Cell {
                text: format!("{last:.0e} (least {least:.0e}) after {}{each}", found.errors.len()),
                note: (found.errors.len() < MOST).then(|| early.into()),
            }
        }
        (None, None, None) => Cell { text: "no update".into(), note: None },
    }
}
