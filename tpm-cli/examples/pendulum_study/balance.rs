//! The step that the paper leaves as future work: a linear-quadratic regulator on the identified model, on the simulated
//! machine.

use super::failure::Failure;
use super::simulation::Simulation;

use super::Chapter;
use super::machine::Machine;
use super::markdown::{percent, table};
use super::patterns::Identified;
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, TAU};
use tpm_runtime::motion::Ending;
use tpm_runtime::plant::regulator::{Regulator, RegulatorWeights};
use tpm_runtime::plant::simulated::{Regulated, Regulation, Sensor, regulate};
use tpm_runtime::plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_runtime::report::number;

/// Sample time, s.
const SAMPLE_TIME: f64 = 1e-3;
/// Time constant of the filter behind the differences that give the rates, s.
const DERIVATIVE_FILTER: f64 = 0.02;
/// Length of a run, s.
const DURATION: f64 = 6.0;
/// Angle from the vertical at which the pendulum starts, degrees.
const START: f64 = 15.0;
/// Largest voltage before the amplifier, V: 24 V at the motor.
const LIMIT: f64 = 2.4;
/// Counts per turn of the encoders.
const COUNTS: f64 = 2000.0;
/// A run is balanced when the pendulum stays within this angle of the vertical over its last fifth, degrees.
const UPRIGHT: f64 = 2.0;

/// RegulatorWeights by which 1 V costs as much as 1 rad of the arm or 18 degrees of the pendulum.
fn weights() -> RegulatorWeights {
    RegulatorWeights { state: vec![1.0, 10.0, 0.1, 0.1], input: vec![1.0] }
}

fn balances(run: &Regulated) -> bool {
    run.record.ending == Ending::Complete && run.late[1] <= UPRIGHT.to_radians()
}

/// The chapter, and how many balances failed.
pub(super) fn chapter(
    upright: &Machine,
    simulation: &Simulation,
    identified: &Identified,
) -> Result<(Chapter, usize), Failure> {
    let weights = weights();
    let regulator = |values: &BTreeMap<String, f64>| {
        tpm_runtime::physical::linear_regulator(&upright.state_space(values), SAMPLE_TIME, &weights)
            .map_err(|error| Failure::Input(format!("regulator: {error}")))
    };
    let ideal = regulator(&BTreeMap::new())?;
    let noise = simulation.written.plant.sensors.values().map(|sensor| sensor.noise).fold(0.0, f64::max);
    let play = |regulator: &Regulator, seed: u64| {
        let sensors = vec![Sensor { noise, step: TAU / COUNTS, ..Sensor::default() }; 2];
        let regulation = Regulation {
            regulator,
            derivative_filter: DERIVATIVE_FILTER,
            start: vec![0.0, START.to_radians()],
            samples: (DURATION / SAMPLE_TIME).round() as usize,
            bounds: vec![TAU, FRAC_PI_2],
            weights: &weights,
        };
        regulate(&upright.interpreted, &upright.bench(sensors, LIMIT, seed), &regulation)
            .map_err(|error| Failure::Input(format!("balance: {error}")))
    };
    let (mut failed, mut costs, mut ideal_costs) = (0, Vec::new(), Vec::new());
    let (mut late, mut largest_gain) = (0.0_f64, 0.0_f64);
    let mut first = None;
    for (seed, values) in identified.machines() {
        let own = regulator(&values)?;
        let (run, beside) = (play(&own, seed)?, play(&ideal, seed)?);
        failed += usize::from(!balances(&run));
        costs.push(run.cost);
        ideal_costs.push(beside.cost);
        late = late.max(run.late[1]);
        for (found, truth) in own.gain().to_rows().concat().iter().zip(ideal.gain().to_rows().concat()) {
            largest_gain = largest_gain.max((found / truth - 1.0).abs());
        }
        first.get_or_insert((own, run));
    }
    let Some((own, run)) = first else { return Err(Failure::Input("nothing was identified".to_owned())) };
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let ratio = mean(&costs) / mean(&ideal_costs) - 1.0;
    let count = costs.len();
    let mut text = format!(
        "## 4. Balance\n\nThe model identified hanging down, linearised upright; discrete linear-quadratic regulator at 1 kHz, cost th1^2 + 10 th2^2 + \
         0.1 th1'^2 + 0.1 th2'^2 + e^2. It is played on the non-linear machine: {COUNTS} counts and {} rad of noise on both encoders, rates \
         from differences filtered with {} ms, |e| <= {LIMIT} V, from {START} degrees at rest, {DURATION} s, {count} seeds.\n\n",
        number(noise),
        1e3 * DERIVATIVE_FILTER
    );
    let gains = |regulator: &Regulator| regulator.gain().to_rows().concat().into_iter().map(number).collect::<Vec<_>>();
    let row = |what: &str, regulator: &Regulator, costs: &[f64]| {
        let mut row = vec![what.to_owned()];
        row.extend(gains(regulator));
        row.push(number(mean(costs)));
        row
    };
    text.push_str(&table(
        &["gains from", "th1", "th2", "th1'", "th2'", "mean cost"],
        &[row("identified model (first seed)", &own, &costs), row("true model", &ideal, &ideal_costs)],
    ));
    text.push_str(&format!(
        "\n{} of {count} balance; over the last fifth the pendulum stays within {:.2} degrees. The gains differ by {} at most, the mean cost by \
         {}. The least cost on the linear model, with the state known and no limit, is {}; the rest is the price of the derivative \
         filter, the encoders and the limit.\n\n![Balance](balance.svg)\n",
        count - failed,
        late.to_degrees(),
        percent(largest_gain),
        percent(ratio.abs()),
        number(ideal.cost_from(&[0.0, START.to_radians(), 0.0, 0.0]))
    ));
    let finding = format!(
        "The regulator that the paper announces balances the pendulum from {START} degrees in {} of {count} seeds with the identified model, at a \
         mean cost within {} of that with the true one.",
        count - failed,
        percent(ratio.abs())
    );
    Ok((Chapter { text, figures: vec![("balance", figure(&run))], findings: vec![finding] }, failed))
}

fn figure(run: &Regulated) -> Figure {
    let time = |n: usize| n as f64 * run.record.sample_time;
    let angle = |c: usize| {
        Curve::Line(run.record.coordinates[c].iter().enumerate().map(|(n, q)| (time(n), q.to_degrees())).collect())
    };
    let voltage = Curve::Line(run.record.inputs[0].iter().enumerate().map(|(n, e)| (time(n), *e)).collect());
    Figure::new(
        "Balance from 15 degrees with the identified model",
        vec![
            Panel {
                x: Axis::linear("Time [s]"),
                y: Axis::linear("Angle [deg]"),
                traces: vec![Trace::new("arm", 0, angle(0)), Trace::new("pendulum", 1, angle(1))],
            },
            Panel {
                x: Axis::linear("Time [s]"),
                y: Axis::linear("Voltage before the amplifier [V]").from_to(-1.1 * LIMIT, 1.1 * LIMIT),
                traces: vec![Trace::new("", 0, voltage)],
            },
        ],
    )
}
