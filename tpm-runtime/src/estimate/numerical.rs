//! `numerical`: the matrix of the tracking error's harmonics from runs with one parameter changed at a time (Feng, Eqn 3.28).
//!
//! To first order `E = M (theta' - theta)`, theta' being the parameters of the feed-forward. A base run and one run per parameter give M
//! by differences. On request M is used as in Feng's chapters 3 and 5: entries that are zero in the exact table are
//! cleared, only as many equations as parameters are kept (Eqn 3.29), and once M is known every run is an update, and M is
//! corrected by the change of the error since the run before (secant). Invariant: M belongs to one reference; another
//! reference begins anew.

use crate::estimate::along::Along;
use crate::estimate::designs::Designs;
use crate::estimate::equations::Equations;
use crate::estimate::error::EstimateError;
use crate::estimate::estimator::Estimator;
use crate::estimate::noise::ROUNDING;
use crate::estimate::pool::{Pools, pool_run};
use crate::estimate::result::Estimate;
use crate::estimate::run::{Run, error_lines};
use crate::estimate::settings::{NumericalSettings, Settings};
use crate::estimate::table::LineTable;
use crate::run::trajectory::Trajectory;
use num_complex::Complex;
use std::sync::Arc;
use std::vec::Vec;
use tpm_core::model::Model;

/// Change of a parameter in a perturbed run, as a share of its value, or of the value at which it makes the whole force.
const PERTURBATION: f64 = 0.5;
/// An entry of B Lambda below this share of its column's largest is rounding of zero.
const ZERO: f64 = 1e-9;

/// Phasors per coordinate and harmonic.
type Lines = Vec<Vec<Complex<f64>>>;

/// The estimator `numerical`.
pub(super) struct Numerical {
    /// Nothing moves along the directions that are hidden here, those that no reference shows so far.
    settings: Settings,
    designs: Designs,
    table: Option<Arc<dyn LineTable>>,
    pools: Pools,
    /// The equations of the last update, when the last run made one, and the parameters behind them.
    ready: Option<(Equations, Vec<f64>)>,
    base: Option<Base>,
    /// Per parameter so far: change of every coordinate's error lines per change of the parameter.
    columns: Vec<Lines>,
    /// Whether M is whole, so that every further run corrects it.
    known: bool,
    harmonics: usize,
}

/// The run with which perturbed runs are compared.
struct Base {
    reference: Trajectory,
    parameters: Vec<f64>,
    error: Lines,
    variance: Vec<Vec<f64>>,
    steps: Vec<f64>,
    /// Entries that are zero in the exact table, per parameter and harmonic.
    zero: Vec<Vec<bool>>,
}

impl Base {
    fn new(
        model: &dyn Model<f64>,
        run: &Run<'_>,
        error: Lines,
        highest: usize,
        table: Option<&dyn LineTable>,
    ) -> Result<Self, EstimateError> {
        let dims = model.dims();
        let along = Along::of_trial(model, run.trial, highest, table)?;
        let power = |lines: &[Complex<f64>]| lines.iter().map(|z| z.norm_sqr()).sum::<f64>();
        let force =
            run.spectra.lines.iter().skip(dims.coordinates).map(|lines| power(lines)).fold(0.0, f64::max).sqrt();
        // Half of the value, or what makes half of the applied force when the value is nearly nothing.
        let step = |j: usize| {
            let felt = (0..dims.rows).map(|r| power(along.regressor(r, j))).fold(0.0, f64::max).sqrt();
            let whole = if felt > 0.0 { force / felt } else { 1.0 };
            let value = run.trial.parameters[j].abs();
            PERTURBATION * if value > 0.1 * whole { value } else { whole }
        };
        let zero = |j: usize| {
            let largest = (0..dims.rows).flat_map(|r| along.regressor(r, j)).map(|z| z.norm()).fold(0.0, f64::max);
            let line = |k: usize| (0..dims.rows).all(|r| along.regressor(r, j)[k].norm() <= ZERO * largest);
            (0..=highest).map(line).collect()
        };
        Ok(Base {
            reference: run.trial.trajectory.clone(),
            parameters: run.trial.parameters.clone(),
            variance: variances(run, dims.coordinates, highest),
            steps: (0..dims.parameters).map(step).collect(),
            zero: (0..dims.parameters).map(zero).collect(),
            error,
        })
    }

    /// Whether a run has the reference of the base run. Open coordinates are not compared: their reference follows from the
    /// parameters.
    fn is_of(&self, run: &Run<'_>) -> bool {
        let (own, other) = (&self.reference, &run.trial.trajectory);
        own.frequency.to_bits() == other.frequency.to_bits()
            && (0..own.coordinates.len())
                .all(|c| run.trial.open.contains(&c) || own.coordinates[c] == other.coordinates[c])
    }
}

fn variances(run: &Run<'_>, coordinates: usize, highest: usize) -> Vec<Vec<f64>> {
    (0..coordinates).map(|c| (0..=highest).map(|k| run.spectra.variance(c, k)).collect()).collect()
}

impl Numerical {
    /// The estimator before any run.
    pub(super) fn new(settings: &Settings, table: Option<Arc<dyn LineTable>>) -> Self {
        Numerical {
            settings: settings.clone(),
            designs: Designs::default(),
            table,
            pools: Pools::default(),
            ready: None,
            base: None,
            columns: Vec::new(),
            known: false,
            harmonics: 0,
        }
    }

    /// Corrects M by the change of the error from the base run to this one (Broyden's update, every parameter scaled by its
    /// step), and makes this run the base.
    fn correct(&mut self, run: &Run<'_>, error: Lines) {
        let Some(base) = self.base.as_mut() else { return };
        let step: Vec<f64> =
            run.trial.parameters.iter().zip(&base.parameters).map(|(now, before)| now - before).collect();
        let size: f64 = step.iter().zip(&base.steps).map(|(step, scale)| (step / scale).powi(2)).sum();
        if size > 0.0 {
            for (c, lines) in error.iter().enumerate() {
                for (k, line) in lines.iter().enumerate() {
                    let foreseen: Complex<f64> = self.columns.iter().zip(&step).map(|(m, s)| m[c][k] * *s).sum();
                    let missed = line - base.error[c][k] - foreseen;
                    for ((column, step), scale) in self.columns.iter_mut().zip(&step).zip(&base.steps) {
                        column[c][k] += missed * (step / (scale * scale) / size);
                    }
                }
            }
        }
        base.variance = variances(run, error.len(), self.harmonics);
        base.parameters.clone_from(&run.trial.parameters);
        base.error = error;
    }

    /// `E = M (theta' - theta)` of the base run.
    fn equations(&self) -> Option<Equations> {
        let base = self.base.as_ref()?;
        let peak = base.error.iter().flatten().map(|line| line.norm()).fold(0.0, f64::max);
        let NumericalSettings { cleared, reduced, .. } = self.settings.numerical;
        let mut equations = Equations::new(self.columns.len());
        for (c, error) in base.error.iter().enumerate() {
            for (k, line) in error.iter().enumerate() {
                let entry = |(column, zero): (&Lines, &Vec<bool>)| {
                    if cleared && zero[k] { Complex::new(0.0, 0.0) } else { column[c][k] }
                };
                let phi: Vec<Complex<f64>> = self.columns.iter().zip(&base.zero).map(entry).collect();
                if cleared && base.zero.iter().all(|zero| zero[k]) {
                    continue;
                }
                let at: Complex<f64> = phi.iter().zip(&base.parameters).map(|(m, value)| m * *value).sum();
                let variance = base.variance[c][k] + (ROUNDING * peak).powi(2) + f64::MIN_POSITIVE;
                equations.push(c, k, &phi, at - line, variance);
            }
        }
        Some(if reduced { equations.reduced() } else { equations })
    }
}

impl Estimator for Numerical {
    fn name(&self) -> &'static str {
        "numerical"
    }

    fn play(&self, current: &[f64]) -> Vec<f64> {
        let Some(base) = self.base.as_ref().filter(|_| !self.known) else { return current.to_vec() };
        let mut changed = base.parameters.clone();
        if let (Some(value), Some(step)) = (changed.get_mut(self.columns.len()), base.steps.get(self.columns.len())) {
            *value += step;
        }
        changed
    }

    fn reduce(&mut self, model: &dyn Model<f64>, run: &Run<'_>) -> Result<(), EstimateError> {
        self.pools.close();
        self.ready = None;
        let dims = model.dims();
        if run.spectra.lines.len() < dims.coordinates {
            return Err(EstimateError::Channels {
                needed: dims.coordinates + dims.inputs,
                given: run.spectra.lines.len(),
            });
        }
        let highest = run.highest_harmonic(&self.settings);
        let error = error_lines(run.trial, run.spectra, dims.coordinates, highest);
        self.harmonics = highest;
        let same = |base: &&Base| base.error[0].len() == highest + 1 && base.is_of(run);
        let Some(base) = self.base.as_ref().filter(same) else {
            self.columns.clear();
            self.known = false;
            self.base = Some(Base::new(model, run, error, highest, self.table.as_deref())?);
            self.designs.push(model, &run.trial.constants, &run.trial.trajectory, &self.settings)?;
            self.settings = self.designs.hidden(&self.settings, |_| true)?;
            return Ok(());
        };
        if self.known {
            self.correct(run, error);
        } else {
            let step = base.steps[self.columns.len()];
            let column = error
                .iter()
                .zip(&base.error)
                .map(|(changed, before)| changed.iter().zip(before).map(|(a, b)| (a - b) / step).collect())
                .collect();
            self.columns.push(column);
            if self.columns.len() < dims.parameters {
                return Ok(());
            }
        }
        let prior = self.base.as_ref().map_or_else(Vec::new, |base| base.parameters.clone());
        let equations = self.equations().unwrap_or_else(|| Equations::new(dims.parameters));
        if self.settings.numerical.secant {
            self.known = true;
        } else {
            self.base = None;
            self.columns.clear();
        }
        self.ready = Some((equations, prior));
        Ok(())
    }

    fn update(&mut self) -> Result<Option<Estimate>, EstimateError> {
        let Some((equations, prior)) = &self.ready else { return Ok(None) };
        let (estimate, pool) = pool_run(self.pools.before.as_ref(), equations, &self.settings, prior)?;
        self.pools.after = Some(pool);
        Ok(Some(estimate))
    }

    fn harmonics(&self) -> usize {
        self.harmonics
    }
}

#[cfg(test)]
mod tests {
    use crate::campaign::Campaign;
    use crate::experiment::Experiment;
    use crate::machine::simulated::simulate;
    use crate::run::trajectory::tests::rest_to_rest_3;
    use crate::test_models::MassSpringDrag;
    use std::vec::Vec;
    use tpm_core::harmonics::Hold;

    /// Largest relative error after every update, and the runs that it took, on an exact machine.
    fn errors(settings: &str) -> Vec<(usize, f64)> {
        let mut experiment = Experiment::parse(include_str!("../../../models/mass_spring_drag.toml")).expect("shipped");
        for (key, value) in [("noise", "0"), ("counts", "0"), ("measure_time", "0"), ("max_runs", "14")] {
            experiment.apply_override(key, value).expect("known");
        }
        experiment.apply_override("estimator", "numerical").expect("known");
        experiment.apply_override("numerical", settings).expect("known");
        experiment.schedule.stages.truncate(1);
        experiment.schedule.updates_per_stage = 14;
        experiment.schedule.tolerance = 0.0;
        experiment.limits.inputs.clear();
        experiment.limits.tracking.clear();
        experiment.control.sample_time = 2.0 / 8192.0;
        experiment.control.derivative_filter = None;
        let setup = experiment.setup(&MassSpringDrag, &rest_to_rest_3(), Hold::Zoh).expect("fits");
        let bench = experiment.bench(&MassSpringDrag).expect("fits");
        let mut campaign = Campaign::new(&MassSpringDrag, setup).expect("playable");
        let mut errors = Vec::new();
        while let Some(trial) = campaign.next().cloned() {
            let record = simulate(&MassSpringDrag, &bench, &trial).expect("regular");
            if campaign.submit(&record).expect("accepted").updated {
                let relative = campaign.current().iter().zip([2.0, 40.0, 1.5]).map(|(v, t)| (v / t - 1.0).abs());
                errors.push((campaign.runs().len(), relative.fold(0.0, f64::max)));
            }
        }
        errors
    }

    #[test]
    fn the_matrix_is_used_as_it_is_asked_for() {
        let runs_to = |errors: &[(usize, f64)], limit: f64| errors.iter().find(|e| e.1 <= limit).map(|e| e.0);
        let plain = errors("{}");
        assert_eq!((plain[0].0, plain[1].0), (4, 8), "four runs to an update");
        let secant = errors("{ secant = true }");
        assert_eq!((secant[0].0, secant[1].0), (4, 5), "one run to an update after the first");
        // Plain updates converge quadratically at four runs each, the secant's superlinearly at one.
        let (plain, secant) = (runs_to(&plain, 1e-6), runs_to(&secant, 1e-6));
        assert!(secant.is_some() && secant <= plain, "{secant:?} {plain:?}");
        for settings in
            ["{ cleared = true }", "{ reduced = true }", "{ cleared = true, reduced = true, secant = true }"]
        {
            let errors = errors(settings);
            assert!(errors.iter().any(|e| e.1 <= 1e-3), "{settings}: {errors:?}");
        }
    }
}
