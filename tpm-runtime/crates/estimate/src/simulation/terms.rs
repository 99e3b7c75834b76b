//! Terms that the model may lack, along the motion of a record: the library of the lines.

use crate::likelihood::{Columns, Scales, Seen, Structure, Term, TermKind};
use crate::output_error::OutputErrorFault;
use crate::simulation::problem::{Along, Column, Point, Problem};
use tpm_numerics::root_mean_square;

/// Instants at which it is asked how large the forces of a row are, and which coordinates it feels.
const PROBES: usize = 200;
/// A reading that moves by less than so many standard deviations over [`STANDING`] readings stands still.
const MOVES: f64 = 6.0;
const STANDING: usize = 8;
/// Share of the largest size of an input beyond which it is asked whether it acts.
const BEYOND: f64 = 0.75;

/// The motion of a point, as terms see it.
struct Motion<'a> {
    problem: &'a Problem<'a>,
    point: &'a Point,
    along: &'a Along,
    from: f64,
}

impl Seen for Motion<'_> {
    fn points(&self) -> usize {
        self.problem.instants.len()
    }

    fn time(&self, point: usize) -> f64 {
        self.problem.instants.time[point] - self.from
    }

    fn apart(&self) -> f64 {
        self.problem.instants.usual_step
    }

    fn series(&self, coordinate: usize, d: usize) -> Vec<f64> {
        match self.problem.states.iter().position(|state| *state == (coordinate, d)) {
            Some(at) => self.point.states.iter().skip(at).step_by(self.problem.states.len()).copied().collect(),
            None if d == self.problem.machine.model.coordinate_order(coordinate) => {
                self.along.accelerations(coordinate)
            }
            None => vec![0.0; self.points()],
        }
    }

    fn right(&self, row: usize) -> Option<Vec<f64>> {
        Some(self.along.right(row))
    }

    fn rate_of(&self, _: usize) -> Columns {
        Vec::new()
    }
}

/// The terms that are asked for, and what they are measured by.
pub(super) struct Library {
    pub(super) terms: Vec<Term>,
    scales: Scales,
    /// Root mean square of the largest force of every row.
    pub(super) forces: Vec<f64>,
}

impl Library {
    /// The library of a record, whose motion is known at a point; `rate_deviation` is how well every rate is known there.
    ///
    /// # Errors
    /// [`OutputErrorFault`] when the model cannot be evaluated.
    pub(super) fn of(problem: &Problem<'_>, point: &Point, rate_deviation: Vec<f64>) -> Result<Self, OutputErrorFault> {
        let model = problem.machine.model;
        let dims = model.dims();
        let along = problem.along(point)?;
        let motion = Motion { problem, point, along: &along, from: problem.instants.time[0] };
        let driven = |row: usize| (0..dims.inputs).any(|i| along.acts(row, i));
        let scales = Scales::of((dims.coordinates, (0..dims.rows).map(driven).collect()), &[&motion], rate_deviation);
        let stride = (problem.instants.len() / PROBES).max(1);
        let mut scratch = vec![0.0; model.workspace_len()];
        let mut work = vec![0.0; problem.machine.derivatives.workspace_len()];
        let (mut phi, mut slopes) = (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows * dims.motion_len()]);
        let mut made = vec![0.0_f64; dims.regressor_len()];
        let mut feels = vec![false; dims.rows * dims.motion_len()];
        let series: Vec<Vec<f64>> = (0..dims.motion_len())
            .map(|slot| motion.series(slot % dims.coordinates, slot / dims.coordinates))
            .collect();
        let inputs = vec![0.0; dims.inputs];
        for k in (0..problem.instants.len()).step_by(stride) {
            let instant: Vec<f64> = series.iter().map(|own| own[k]).collect();
            model.sensitivity(&instant, &point.theta, problem.constants, &mut scratch, &mut phi)?;
            made.iter_mut().zip(&phi).for_each(|(sum, phi)| *sum += phi * phi);
            let derivatives = problem.machine.derivatives;
            derivatives.rows(&instant, &point.theta, problem.constants, &inputs, &mut work, &mut slopes)?;
            feels.iter_mut().zip(&slopes).for_each(|(feels, slope)| *feels |= *slope != 0.0);
        }
        let probes = problem.instants.len().div_ceil(stride) as f64;
        let force = |row: usize| {
            let of = |j: usize| (made[row * dims.parameters + j] / probes).sqrt() * point.theta[j].abs();
            (0..dims.parameters).map(of).fold(root_mean_square(along.right(row)), f64::max)
        };
        let felt = |row: usize, slot: usize| feels[row * dims.motion_len() + slot];
        let coupled = |row: usize, c: usize| felt(row, model.coordinate_order(c) * dims.coordinates + c);
        let moved = |row: usize, c: usize| (0..model.coordinate_order(c)).any(|d| felt(row, d * dims.coordinates + c));
        // A coupling beside the model's own is asked of the lines alone.
        let structure = Structure { coupled: &coupled, by_position: &felt, feels: &moved, has_own_inertia: &|_| false };
        let mut terms = scales.terms(model, &structure);
        terms.retain(|term| !matches!(term.kind, TermKind::InputGain | TermKind::PositionOffset));
        terms.retain(|term| !term.kind.is_of_reading() || problem.sensor(term.of).is_some());
        let read = (0..dims.coordinates).filter(|&c| model.coordinate_order(c) > 1 && problem.sensor(c).is_some());
        terms.extend(read.map(|of| Term { kind: TermKind::Backlash, row: None, of, other: None }));
        terms.extend((0..dims.inputs).map(|of| Term { kind: TermKind::Limit, row: None, of, other: None }));
        Ok(Library { terms, scales, forces: (0..dims.rows).map(force).collect() })
    }

    /// The columns of some terms along a point.
    ///
    /// # Errors
    /// [`OutputErrorFault`] when the model cannot be evaluated.
    pub(super) fn columns(
        &self,
        problem: &Problem<'_>,
        point: &Point,
        terms: &[Term],
    ) -> Result<Vec<Column>, OutputErrorFault> {
        if terms.is_empty() {
            return Ok(Vec::new());
        }
        let along = problem.along(point)?;
        let motion = Motion { problem, point, along: &along, from: problem.instants.time[0] };
        let of = |term: &Term| match term.kind {
            TermKind::Delay => Column::Delay(term.of),
            TermKind::Backlash => {
                Column::Reading(problem.sensor(term.of).unwrap_or(0), direction(&motion.series(term.of, 1)))
            }
            TermKind::Reading { multiple, even } => {
                let of = if even { f64::cos } else { f64::sin };
                let values = motion.series(term.of, 0).into_iter().map(|q| of(f64::from(multiple) * q)).collect();
                Column::Reading(problem.sensor(term.of).unwrap_or(0), values)
            }
            TermKind::Limit => Column::Force(along.beyond(term.of, BEYOND)),
            _ => Column::Force(self.scales.columns(*term, &motion)),
        };
        Ok(terms.iter().map(of).collect())
    }

    /// Root mean square of what a column makes, as a share of the force of the row where it makes most.
    pub(super) fn share(&self, column: &Column, value: f64) -> f64 {
        match column {
            Column::Force(own) => own
                .iter()
                .map(|(row, values)| {
                    value.abs() * root_mean_square(values.iter().copied()) / self.forces[*row].max(f64::MIN_POSITIVE)
                })
                .fold(0.0, f64::max),
            _ => 1.0,
        }
    }
}

/// The direction of a motion, smoothly through rest.
fn direction(rate: &[f64]) -> Vec<f64> {
    let width = 1e-2 * root_mean_square(rate.iter().copied());
    rate.iter().map(|v| (v / width.max(f64::MIN_POSITIVE)).tanh()).collect()
}

/// Of readings behind play: the direction of the last motion of every one, and whether it stands after a reversal, so that it only says that
/// the truth is within the play. `deviation` is the noise of a reading.
pub(super) fn behind_play(readings: &[f64], deviation: f64) -> (Vec<f64>, Vec<bool>) {
    let half = STANDING / 2;
    let n = readings.len();
    let step = |k: usize| match (k.checked_sub(half), readings.get(k + half)) {
        (Some(before), Some(after)) => after - readings[before],
        _ => 0.0,
    };
    let mut directions = Vec::with_capacity(n);
    let mut last = 0.0;
    for k in 0..n {
        if step(k).abs() > MOVES * deviation {
            last = step(k).signum();
        }
        directions.push(last);
    }
    let mut stands: Vec<bool> = (0..n).map(|k| step(k).abs() <= MOVES * deviation).collect();
    for k in 1..n {
        if directions[k] != directions[k - 1] {
            stands[k.saturating_sub(half)..(k + STANDING).min(n)].fill(true);
        }
    }
    (directions, stands)
}
