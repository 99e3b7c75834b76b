//! How near the errors of logs and of campaigns come to the Cramer-Rao bound.

use crate::honesty::bound::{Accelerations, Held};
use crate::honesty::correct::Errors;
use crate::honesty::identify::{Outcome, identify_file, parse, write_csv};
use crate::honesty::machines::{SYSTEM_A, SYSTEM_B, Shipped, start_at_truth, white_sensors};
use crate::honesty::table::{Table, met, percent};
use rayon::prelude::*;
use std::error::Error;
use std::f64::consts::PI;
use tpm_runtime::experiment::{Equations, Experiment};
use tpm_runtime::harmonics::Hold;
use tpm_runtime::model::Model as _;
use tpm_runtime::session::play_simulated;
use tpm_runtime::study::study_session;

/// Samples of a block in which a machine that is unstable along its motion departs little.
const BLOCK: usize = 500;

/// Logs of a machine at one setting, with the machine in the bound's own words.
struct Logs {
    machine: Shipped,
    what: &'static str,
    /// Amplitude and frequency; those of the experiment when not given.
    setting: Option<(f64, f64)>,
    /// Standard deviation of the sensors' noise.
    noise: f64,
    logs: u32,
    accelerations: Accelerations,
    /// Names of the parameters in the order in which `accelerations` takes them.
    names: &'static [&'static str],
    /// Largest ratio of root mean square error to bound.
    most: f64,
}

fn mass_spring_drag(theta: &[f64], x: &[f64], v: &[f64], u: f64) -> Vec<f64> {
    vec![(u - theta[1] * x[0] - theta[2] * v[0] * v[0]) / theta[0]]
}

fn two_carts(theta: &[f64], x: &[f64], _: &[f64], force: f64) -> Vec<f64> {
    let stretch = theta[4] * (x[0] - x[1]);
    vec![(force - theta[2] * x[0] - theta[3] * x[0].powi(3) - stretch) / theta[0], stretch / theta[1]]
}

fn all() -> [Logs; 3] {
    let a = |what, setting| Logs {
        machine: SYSTEM_A,
        what,
        setting: Some(setting),
        noise: 1e-3,
        logs: 200,
        accelerations: mass_spring_drag,
        names: &["m", "k1", "k2"],
        most: 1.15,
    };
    [
        a("A, lambda 0.3 m, w pi rad/s", (0.3, PI)),
        a("A, lambda 0.6 m, w 2 pi rad/s", (0.6, 2.0 * PI)),
        Logs {
            machine: SYSTEM_B,
            what: "B, two carts, both measured",
            setting: None,
            noise: 1e-4,
            logs: 100,
            accelerations: two_carts,
            names: &["m1", "m2", "k1", "k2", "k3"],
            most: 1.25,
        },
    ]
}

impl Logs {
    /// One run from the true parameters, without encoders.
    fn experiment(&self) -> Experiment {
        let mut experiment = self.machine.experiment();
        white_sensors(&mut experiment, |_| self.noise);
        start_at_truth(&mut experiment);
        experiment.equations = Equations::Own;
        experiment.schedule.stages.truncate(1);
        experiment.schedule.max_runs = 1;
        if let Some((amplitude, frequency)) = self.setting {
            let values = &mut experiment.schedule.stages[0].values;
            values.insert("lambda".into(), amplitude);
            values.insert("w".into(), frequency);
        }
        experiment
    }

    /// Adds one row a parameter.
    fn report(&self, logs: Option<u32>, table: &mut Table) -> Result<(), Box<dyn Error>> {
        let experiment = self.experiment();
        let session = self.machine.session(experiment.clone())?;
        let plant = session.machine().plant();
        let (campaign, _) = session.campaign()?;
        let trial = campaign.next().ok_or("invariant: a campaign begins with a run")?.clone();
        let from = experiment.schedule.settle_periods * trial.samples_per_period;
        let coordinates = plant.dims().coordinates;
        let names: Vec<&str> = ["t_s"]
            .into_iter()
            .chain((0..coordinates).map(|c| plant.coordinate(c).name))
            .chain((0..plant.dims().inputs).map(|i| plant.input(i).name))
            .collect();
        // A log has a column for every coordinate: all equations are rows.
        let model = parse(&self.machine.model.replace("eliminate x1 as c;", ""))?;
        let one = |seed: u64| -> Result<Outcome, String> {
            let own = Experiment { seed, ..experiment.clone() };
            let record = play_simulated(plant, &own, &trial).map_err(|error| error.to_string())?;
            let time: Vec<f64> = (0..record.len() - from).map(|i| i as f64 * record.sample_time).collect();
            let measured = record.coordinates.iter().chain(&record.inputs).map(|column| &column[from..]);
            let columns: Vec<&[f64]> = [time.as_slice()].into_iter().chain(measured).collect();
            let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
            let path = folder.path().join("log.csv");
            write_csv(&path, &names, &columns).map_err(|error| error.to_string())?;
            Ok(identify_file(&model, &path, Hold::Zoh))
        };
        let seeds = 1..=u64::from(logs.unwrap_or(self.logs));
        let outcomes = seeds.into_par_iter().map(one).collect::<Result<Vec<Outcome>, _>>()?;
        let mut exact = experiment.clone();
        white_sensors(&mut exact, |_| 0.0);
        let quiet = play_simulated(plant, &exact, &trial)?;
        let truth: Vec<f64> = self.names.iter().map(|&name| experiment.plant.parameters[name]).collect();
        // Without noise the machine stays on its reference.
        let width = trial.reference.len() / trial.samples_per_period;
        let state = |at: usize| {
            let first = (from + at) % trial.samples_per_period * width;
            trial.reference[first..first + 2 * coordinates].to_vec()
        };
        let states: Vec<Vec<f64>> = (0..quiet.len() - from).step_by(BLOCK).map(state).collect();
        let held = Held {
            accelerations: self.accelerations,
            states: &states,
            block: BLOCK,
            input: &quiet.inputs[0][from..],
            sample_time: quiet.sample_time,
            noise: self.noise,
        };
        let bounds = held.bounds(&truth).ok_or("the record does not determine the parameters")?;
        let predicted = study_session(&session, 1, &|_| true)?.parameters;
        for (row, ((&name, &truth), &bound)) in self.names.iter().zip(&truth).zip(&bounds).enumerate() {
            let errors = Errors::of(&outcomes, name, truth);
            let efficiency = errors.rms() / bound;
            let predicted = predicted.iter().find(|own| own.name == name).and_then(|own| own.bound);
            table.push(vec![
                if row == 0 { self.what.into() } else { String::new() },
                if row == 0 { outcomes.len().to_string() } else { String::new() },
                name.into(),
                format!("{:.3e}", bound / truth),
                predicted.map_or_else(String::new, |predicted| format!("{:.3}", predicted / bound)),
                format!("{:.2}", errors.stated() / bound),
                format!("{efficiency:.2}"),
                format!("{:.2}", self.most),
                met(efficiency <= self.most && errors.found.len() == outcomes.len()),
            ]);
        }
        Ok(())
    }
}

/// Logs of systems A and B under white noise of the sensors: the errors beside the Cramer-Rao bound of the record.
///
/// # Errors
/// Any error of the file system, and whatever keeps a machine from being played.
pub fn logs(words: &str, logs: Option<u32>, progress: &dyn Fn(&str)) -> Result<String, Box<dyn Error>> {
    let mut table = Table::new(&[
        "logs of",
        "logs",
        "parameter",
        "bound / truth",
        "predicted / bound",
        "stated / bound",
        "rms error / bound",
        "at most",
        "met",
    ]);
    for own in all().iter().filter(|own| own.what.contains(words)) {
        progress(own.what);
        own.report(logs, &mut table)?;
    }
    Ok(table.to_string())
}

/// Errors of campaigns may be this many bounds.
const CAMPAIGN_MOST: f64 = 1.5;

/// Changes an experiment of a campaign.
type Change = fn(&mut Experiment);

/// Whole campaigns of systems A and B without encoders: the errors beside the bound of all runs that were played, every coordinate of
/// which is measured.
///
/// # Errors
/// Whatever keeps a machine from being played.
pub fn campaigns(words: &str, seeds: Option<u32>, progress: &dyn Fn(&str)) -> Result<String, Box<dyn Error>> {
    let mut table = Table::new(&[
        "campaigns of",
        "seeds",
        "parameter",
        "bound / truth",
        "bias / spread",
        "stated / spread",
        "95 % interval holds",
        "rms error / bound",
        "at most",
        "met",
    ]);
    let asked: [(&str, Shipped, Change); 4] = [
        ("A from nothing", SYSTEM_A, |_| {}),
        ("A from the truth", SYSTEM_A, start_at_truth),
        ("B, the far cart's motion", SYSTEM_B, |_| {}),
        ("B, both carts' equations", SYSTEM_B, |experiment| experiment.equations = Equations::Own),
    ];
    for (name, machine, change) in asked.into_iter().filter(|(name, ..)| name.contains(words)) {
        progress(name);
        let mut experiment = machine.experiment();
        white_sensors(&mut experiment, |noise| noise);
        change(&mut experiment);
        let session = machine.session(experiment)?;
        let study = study_session(&session, seeds.unwrap_or(100) as usize, &|_| true)?;
        for (row, own) in study.parameters.iter().enumerate() {
            let (Some(bias), Some(spread), Some(stated), Some(bound)) = (own.bias, own.spread, own.stated, own.bound)
            else {
                return Err(format!("{name}: {} has no bound, or no spread", own.name).into());
            };
            let efficiency = spread.hypot(bias) / bound;
            let covered = own.coverage.unwrap_or_default() * own.values as f64;
            table.push(vec![
                if row == 0 { name.into() } else { String::new() },
                if row == 0 { study.campaigns.to_string() } else { String::new() },
                own.name.clone(),
                format!("{:.3e}", bound / own.truth),
                format!("{:+.2}", bias / spread),
                format!("{:.2}", stated / spread),
                percent(covered.round() as usize, own.values),
                format!("{efficiency:.2}"),
                format!("{CAMPAIGN_MOST:.2}"),
                met(efficiency <= CAMPAIGN_MOST && own.values == study.campaigns),
            ]);
        }
    }
    Ok(table.to_string())
}
