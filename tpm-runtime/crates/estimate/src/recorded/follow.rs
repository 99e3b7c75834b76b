//! A record followed with given parameters: every stretch is simulated whole, from the state at its beginning that leaves least.

use crate::recorded::signals::SignalsAsRecorded;
use crate::recorded::starts::{Pace, Unmeasured, first_state};
use crate::recorded::steps::Point;
use crate::recorded::work::{READINGS_SETTLED, RecordedFault, Work, spread};
use crate::settings::Settings;
use tpm_controller::model::Model;

/// Steps in which the state at the beginning settles.
const MOST_STEPS: usize = 30;
/// Weight of a sensor's deviation against that of the others, as a share of its deviation: all sensors count alike.
const ALIKE: f64 = 1e-2;

/// What a sensor read beside what the simulation says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FollowedSensor {
    /// Coordinate that is read.
    pub coordinate: usize,
    /// Which derivative of it.
    pub derivative: usize,
    /// Stamps of the readings, s.
    pub time: Vec<f64>,
    /// Readings, unit of what is read.
    pub measured: Vec<f64>,
    /// Simulated values at the same stamps.
    pub simulated: Vec<f64>,
}

/// A record beside its simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct Followed {
    /// The sensors, each with the readings of all stretches that were followed.
    pub sensors: Vec<FollowedSensor>,
    /// Stretches that were simulated, each from a state of its own.
    pub stretches: usize,
    /// Stretches from whose beginning the motion leaves all bounds.
    pub left: usize,
    /// Duration of the longest stretch, s.
    pub duration: f64,
}

/// Simulates a record from its inputs alone with given parameters.
///
/// # Errors
/// [`RecordedFault`] where the rows do not determine the motion, or no stretch has readings enough for a state.
pub fn follow_recorded(
    model: &dyn Model<f64>,
    constants: &[f64],
    signals: &SignalsAsRecorded,
    parameters: &[f64],
) -> Result<Followed, RecordedFault> {
    let settings = Settings::default();
    let mut work = Work::new((model, constants), signals, (Pace::Crossings, Unmeasured::Alike), Vec::new(), &settings)?;
    // How late the sensors' stamps are is a matter of the record, as its initial state is.
    let steps: Vec<f64> = work.flow.clocks.iter().map(|clock| clock.step).collect();
    let behind = |of: &[f64]| -> Vec<f64> { parameters.iter().chain(of).copied().collect() };
    let (typical, theta) = (behind(&steps), behind(&vec![0.0; steps.len()]));
    let sizes: Vec<f64> = signals.sensors.iter().map(|own| ALIKE * spread(own.channel.spread().1)).collect();
    let all: Vec<_> = work.stretches.iter().map(|stretch| signals.block(stretch)).collect();
    work.refine_step(&all, parameters, &sizes);
    let mut found = Followed {
        sensors: (signals.sensors.iter())
            .map(|own| FollowedSensor {
                coordinate: own.coordinate,
                derivative: own.derivative,
                ..FollowedSensor::default()
            })
            .collect(),
        stretches: 0,
        left: 0,
        duration: 0.0,
    };
    let states = work.flow.states.len();
    for (block, stretch) in all.iter().zip(&work.stretches).filter(|(block, _)| block.readings.len() > states) {
        found.stretches += 1;
        found.duration = found.duration.max(block.instants.last().map_or(0.0, |last| last - block.start));
        let beginning = [signals.block(&stretch[..stretch.len().min(READINGS_SETTLED)])];
        let from = Point { theta: theta.clone(), states: vec![first_state(&work.flow, &work.scales, &beginning[0])] };
        let settled = work.course(&beginning, &typical).settle(from.clone(), &sizes, MOST_STEPS);
        let Point { theta, states: own } = settled.map_or(from, |settled| settled.point);
        let Ok(simulated) = work.flow.readings(block, &theta, &own[0]) else {
            found.left += 1;
            continue;
        };
        for (reading, value) in block.readings.iter().zip(simulated) {
            let own = &mut found.sensors[reading.sensor];
            own.time.push(reading.time);
            own.measured.push(reading.value);
            own.simulated.push(value);
        }
    }
    if found.stretches == 0 {
        let readings = work.longest();
        return Err(RecordedFault::TooFew { readings, unknowns: states });
    }
    Ok(found)
}
