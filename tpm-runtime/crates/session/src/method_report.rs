//! How the method came to its parameters: run by run the harmonics of error and inputs beside their prediction, the matrix behind it,
//! and the update; then one row per update (the form of Feng, Table 5.1).

use num_complex::Complex;
use serde::Serialize;
use tpm_campaign::{Campaign, Lines, RunHarmonics};
use tpm_estimate::{ErrorResponse, EstimateError, feed_forward_lines};

/// How a campaign came to its parameters.
///
/// The matrix is that of the estimator `error` (Feng, Eqn 4.29): it turns the difference between the parameters of the feed-forward and
/// those after the run into the tracking error, to first order. What it does not predict is noise, and what the linearisation leaves
/// out. The other estimators take the same harmonics.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodReport {
    /// Names of the parameters, in their order.
    pub parameters: Vec<String>,
    /// The runs that the estimator has taken in.
    pub runs: Vec<MethodRun>,
    /// The parameters before the first run and after every update.
    pub updates: Vec<MethodUpdate>,
}

/// One run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodRun {
    /// Number of the run, from 1.
    pub run: usize,
    /// Names and values of the amplitudes.
    pub amplitudes: Vec<(String, f64)>,
    /// Fundamental angular frequency, rad/s.
    pub frequency: f64,
    /// Tracking error of every coordinate, then every input.
    pub signals: Vec<MethodSignal>,
    /// `T B Lambda`: what a parameter that is one unit too large makes of the error of every coordinate.
    pub matrix: Vec<MethodEntry>,
    /// Every parameter of the feed-forward, and what it was after the run.
    pub update: Vec<ParameterUpdate>,
}

/// The harmonics of one signal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodSignal {
    /// The coordinate whose error it is, or the input.
    pub signal: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Whether it is the error of a coordinate.
    pub error: bool,
    /// Harmonics from the mean on.
    pub lines: Vec<MethodLine>,
}

/// One harmonic of a signal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MethodLine {
    /// Number of the harmonic; zero for the mean.
    pub harmonic: usize,
    /// What was measured.
    pub measured: Phasor,
    /// Root mean square of the noise in it, unit of the signal.
    pub noise: f64,
    /// What the update predicts; nothing where the loop is singular.
    pub predicted: Option<Phasor>,
}

/// The wave `size cos(k w t + phase)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Phasor {
    /// Amplitude, unit of the signal.
    pub size: f64,
    /// Phase, rad.
    pub phase: f64,
}

impl From<Complex<f64>> for Phasor {
    fn from(value: Complex<f64>) -> Self {
        let (size, phase) = value.to_polar();
        // The phase of nothing is zero, whatever rounding has left of signs.
        Phasor { size, phase: if size > 0.0 { phase } else { 0.0 } }
    }
}

/// A row of the matrix.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodEntry {
    /// Number of the harmonic; zero for the mean.
    pub harmonic: usize,
    /// The coordinate whose error it is.
    pub coordinate: String,
    /// Per parameter, in their order: error per unit of the parameter.
    pub entries: Vec<Phasor>,
}

/// A parameter before and after a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ParameterUpdate {
    /// The parameter of the feed-forward.
    pub before: f64,
    /// The parameter after the run.
    pub after: f64,
    /// Standard deviation after the run; nothing where the runs do not show the parameter.
    pub std: Option<f64>,
}

/// The parameters after an update.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodUpdate {
    /// Number of the run that made it; zero for the parameters before the first run.
    pub run: usize,
    /// Fundamental angular frequency of that run, rad/s; nothing before the first run.
    pub frequency: Option<f64>,
    /// Root mean square of the tracking error of that run, by coordinate.
    pub tracking_rms: Vec<f64>,
    /// The parameters, in their order.
    pub values: Vec<f64>,
}

/// How a campaign came to its parameters.
///
/// # Errors
/// [`EstimateError`] when the model refuses an evaluation along a reference.
pub(super) fn of_campaign(campaign: &Campaign<'_>) -> Result<MethodReport, EstimateError> {
    let model = campaign.model();
    let runs = campaign.harmonics();
    let parameters = (0..model.dims().parameters).map(|j| model.parameter(j).name.to_string()).collect();
    let shown: Result<Vec<MethodRun>, EstimateError> = runs.iter().map(|run| one_run(campaign, run)).collect();
    let mut updates: Vec<MethodUpdate> = runs
        .first()
        .map(|first| MethodUpdate {
            run: 0,
            frequency: None,
            tracking_rms: Vec::new(),
            values: first.trial.parameters.clone(),
        })
        .into_iter()
        .collect();
    updates.extend(runs.iter().filter_map(|run| {
        let report = campaign.runs().get(run.run).filter(|report| report.updated)?;
        Some(MethodUpdate {
            run: report.run,
            frequency: Some(report.frequency),
            tracking_rms: report.tracking_rms.clone(),
            values: run.after.clone(),
        })
    }));
    Ok(MethodReport { parameters, runs: shown?, updates })
}

fn one_run(campaign: &Campaign<'_>, run: &RunHarmonics) -> Result<MethodRun, EstimateError> {
    let model = campaign.model();
    let dims = model.dims();
    let report = &campaign.runs()[run.run];
    let trial = &run.trial;
    let highest = run.error.first().map_or(0, |lines| lines.values.len().saturating_sub(1));
    let response = ErrorResponse::new(model, trial, &run.after, campaign.setup().procedure.hold, highest)?;
    let off: Vec<f64> = trial.parameters.iter().zip(&run.after).map(|(played, after)| played - after).collect();
    let errors: Vec<Option<Vec<Complex<f64>>>> = (0..=highest).map(|k| response.error(k, &off)).collect();
    let feed_forward = feed_forward_lines(trial, dims.inputs, highest);
    let line = |k: usize, lines: &Lines, predicted: Option<Complex<f64>>| MethodLine {
        harmonic: k,
        measured: lines.values[k].into(),
        noise: lines.noise[k],
        predicted: predicted.map(Phasor::from),
    };
    let error = |(c, lines): (usize, &Lines)| MethodSignal {
        signal: model.coordinate(c).name.to_string(),
        unit: model.coordinate(c).unit.map(ToString::to_string),
        error: true,
        lines: (0..=highest).map(|k| line(k, lines, errors[k].as_ref().map(|error| error[c]))).collect(),
    };
    let input = |(i, lines): (usize, &Lines)| MethodSignal {
        signal: model.input(i).name.to_string(),
        unit: model.input(i).unit.map(ToString::to_string),
        error: false,
        lines: (0..=highest)
            .map(|k| {
                // The recorded inputs stand behind their actuators.
                let actuator = trial.control.actuator(i).response(k as f64 * trial.trajectory.frequency);
                let with = |error: &Vec<Complex<f64>>| actuator * (feed_forward[i][k] + response.effort(k, i, error));
                line(k, lines, errors[k].as_ref().map(with))
            })
            .collect(),
    };
    let matrix = (0..=highest).filter_map(|k| Some((k, response.matrix(k)?))).flat_map(|(k, matrix)| {
        (0..dims.coordinates).map(move |c| MethodEntry {
            harmonic: k,
            coordinate: model.coordinate(c).name.to_string(),
            entries: matrix.row(c).iter().map(|entry| Phasor::from(*entry)).collect(),
        })
    });
    let update = trial.parameters.iter().zip(&run.after).enumerate().map(|(j, (before, after))| ParameterUpdate {
        before: *before,
        after: *after,
        std: report.parameters.get(j).and_then(|parameter| parameter.std),
    });
    Ok(MethodRun {
        run: report.run,
        amplitudes: report.amplitudes.clone(),
        frequency: report.frequency,
        signals: run.error.iter().enumerate().map(error).chain(run.inputs.iter().enumerate().map(input)).collect(),
        matrix: matrix.collect(),
        update: update.collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::MethodReport;
    use crate::{DeclaredModel, Session};
    use num_complex::Complex;
    use std::collections::BTreeMap;
    use tpm_experiment::Experiment;

    const MODEL: &str = include_str!("../../../../models/mass_spring_drag.tpm");
    const EXPERIMENT: &str = include_str!("../../../../models/mass_spring_drag.toml");

    /// The method on a machine without noise, whose parameters are known within a few percent.
    fn shown(estimator: &str) -> MethodReport {
        let model = DeclaredModel::parse("mass_spring_drag", MODEL).expect("the shipped model is right");
        let mut experiment = Experiment::parse(EXPERIMENT).expect("the shipped file is right");
        let known = [("m", 2.0, 1.02), ("k1", 40.0, 0.98), ("k2", 1.5, 1.03)];
        for (name, truth, factor) in known {
            experiment.plant.parameters.insert(name.into(), truth);
            experiment.prior.insert(name.into(), truth * factor);
        }
        experiment.plant.sensors.clear();
        for (key, value) in [("estimator", estimator), ("schedule.max_runs", "6"), ("schedule.measure_time", "8")] {
            experiment.apply_override(key, value).expect("a key of the file");
        }
        let session = Session::new(model, experiment, None, BTreeMap::new()).expect("a session").showing_method();
        session.identify(None, &mut |_, _, _| true).expect("runs").method.expect("asked for")
    }

    #[test]
    fn the_update_predicts_the_error_that_was_measured() {
        let report = shown("error");
        assert_eq!(report.parameters, ["m", "k1", "k2"]);
        let first = &report.runs[0];
        assert!(first.signals.len() == 2 && first.signals[0].error && !first.signals[1].error);
        for signal in &first.signals {
            let measured: Vec<_> =
                signal.lines.iter().map(|l| Complex::from_polar(l.measured.size, l.measured.phase)).collect();
            let peak = measured.iter().map(|z| z.norm()).fold(0.0, f64::max);
            for (line, measured) in signal.lines.iter().zip(&measured) {
                let predicted = line.predicted.expect("a regular loop");
                let apart = (Complex::from_polar(predicted.size, predicted.phase) - measured).norm();
                assert!(apart < 0.05 * peak, "{} {line:?}: {apart} of {peak}", signal.signal);
            }
        }
        // H = 1 / (Kp + k1 - m W^2 + j Kd W), times lambda for k1 and -lambda W^2 for m on the fundamental: opposite phases.
        let row = first.matrix.iter().find(|row| row.harmonic == 1).expect("a fundamental");
        let [m, k1] = [row.entries[0], row.entries[1]].map(|entry| Complex::from_polar(entry.size, entry.phase));
        let ratio = m / k1 / first.frequency.powi(2);
        assert!((ratio + 1.0).norm() < 1e-9, "{ratio}");
        assert!(row.entries[1].phase.abs() > 0.01, "the loop turns the phase: {row:?}");
    }

    #[test]
    fn there_is_one_row_for_every_update() {
        for estimator in ["error", "numerical", "measured-motion"] {
            let report = shown(estimator);
            assert_eq!(report.updates[0].run, 0, "{estimator}");
            assert!(report.updates.len() >= 2, "{estimator}");
            if estimator == "numerical" {
                assert!(report.runs.len() > report.updates.len(), "perturbed runs are no updates");
            }
            let last = report.updates.last().expect("at least two");
            assert!((last.values[0] / 2.0 - 1.0).abs() < 1e-2, "{estimator}: {last:?}");
        }
    }
}
