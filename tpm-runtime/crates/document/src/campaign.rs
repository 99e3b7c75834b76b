//! Figures of the runs of a campaign: the tracking error of the first and the last run, and the inputs compared with
//! their feed-forward (Feng, Figures 5.5, 5.6).

use crate::identification::RMS;
use crate::page::Document;
use tpm_campaign::RunReport;
use tpm_controller::model::Model;
use tpm_motion::{Record, Trial};
use tpm_plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_report::number;

/// Most points of a curve.
const POINTS: usize = 1000;

/// A trial with its record and report.
#[derive(Clone, Debug)]
pub struct PlayedRun {
    trial: Trial,
    record: Record,
    report: RunReport,
    from: usize,
}

impl PlayedRun {
    /// The run with its samples; nothing when it did not settle.
    #[must_use]
    pub fn of(trial: &Trial, record: &Record, report: &RunReport) -> Option<Self> {
        let from = report.settled_after? * trial.samples_per_period;
        Some(PlayedRun { trial: trial.clone(), record: record.clone(), report: report.clone(), from })
    }

    /// The recorded samples.
    #[must_use]
    pub const fn record(&self) -> &Record {
        &self.record
    }

    /// The report of the run.
    #[must_use]
    pub const fn report(&self) -> &RunReport {
        &self.report
    }

    /// Mean over the measured periods of a channel minus `less`, against the phase as a share of the period.
    fn mean(&self, channel: &[f64], less: &dyn Fn(usize) -> f64) -> Vec<(f64, f64)> {
        let period = self.trial.samples_per_period;
        let used = &channel[self.from.min(channel.len())..];
        let periods = used.len() / period.max(1);
        (0..period)
            .step_by((period / POINTS).max(1))
            .map(|n| {
                let sum: f64 = (0..periods).map(|k| used[k * period + n]).sum();
                (n as f64 / period as f64, sum / periods.max(1) as f64 - less(n))
            })
            .collect()
    }

    fn error(&self, coordinate: usize) -> Vec<(f64, f64)> {
        let width = self.trial.reference.len() / self.trial.samples_per_period.max(1);
        self.mean(&self.record.coordinates[coordinate], &|n| self.trial.reference[n * width + coordinate])
    }

    fn input(&self, input: usize) -> Vec<(f64, f64)> {
        self.mean(&self.record.inputs[input], &|_| 0.0)
    }

    fn feed_forward(&self, input: usize) -> Vec<(f64, f64)> {
        let inputs = self.record.inputs.len();
        let period = self.trial.samples_per_period;
        let at = |n: usize| (n as f64 / period as f64, self.trial.feed_forward[n * inputs + input]);
        (0..period).step_by((period / POINTS).max(1)).map(at).collect()
    }

    fn name(&self, which: &str) -> String {
        format!("{which} run, {} rad/s", number(self.trial.trajectory.frequency))
    }
}

impl Document {
    /// Adds figures of the tracking error of the first and the last run of a campaign, and of the inputs of the last
    /// run, to the section of the runs.
    pub fn add_runs(&mut self, plant: &dyn Model<f64>, first: &PlayedRun, last: &PlayedRun) {
        let dims = plant.dims();
        let panel = |label: String, traces: Vec<Trace>| Panel {
            x: Axis::linear("share of the period").from_to(0.0, 1.0),
            y: Axis::linear(&label),
            traces,
        };
        let errors = (0..dims.coordinates).map(|c| {
            let traces = vec![
                Trace::new(&first.name("first"), 1, Curve::Line(first.error(c))),
                Trace::new(&last.name("last"), 0, Curve::Line(last.error(c))),
            ];
            panel(format!("error of {}", plant.coordinate(c)), traces)
        });
        let errors = Figure::new("Tracking error, mean over the measured periods", errors.collect());
        let inputs = (0..dims.inputs).map(|i| {
            let traces = vec![
                Trace::new("applied", 0, Curve::Line(last.input(i))),
                Trace::new("feed-forward", 1, Curve::Dashed(last.feed_forward(i))),
            ];
            panel(plant.input(i).to_string(), traces)
        });
        let inputs = Figure::new(&format!("Inputs of the {}", last.name("last")), inputs.collect());
        let error = self.figure(
            "error",
            errors,
            "Tracking error of the first and of the last run, mean over the measured periods",
        );
        let input = self.figure(
            "input",
            inputs,
            "Inputs of the last run beside their feed-forward, mean over the measured periods",
        );
        if let Some(runs) = self.sections.iter_mut().find(|section| section.id == "runs") {
            let coordinates: Vec<String> = (0..dims.coordinates).map(|c| plant.coordinate(c).to_string()).collect();
            for block in &mut runs.blocks {
                block.rename(RMS, &format!("rms error of {}", coordinates.join(", ")));
            }
            runs.blocks.extend([error, input]);
        }
    }
}
