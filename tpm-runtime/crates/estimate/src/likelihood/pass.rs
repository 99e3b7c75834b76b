//! A record as lines of its rows, looked at in one way.

use crate::error::EstimateError;
use crate::likelihood::library::{Scales, Term, TermKind};
use crate::likelihood::lines::{Remembered, RowLines, Signals, View, row_lines, row_lines_beside};
use crate::likelihood::path::{Acting, Along, Columns, Entry, Felt, Paths, band, lost};
use crate::rows::Rows;
use crate::settings::Settings;
use crate::time_domain::motion::{Motion, TimeRecord};
use std::cell::{OnceCell, RefCell};
use std::rc::Rc;
use tpm_controller::model::Model;

/// Smallest factor by which the gain of an input is changed in a step: the column of a gain is the force at values that a wrong gain has moved.
const LEAST_STEP: f64 = 0.1;

/// How a record is looked at, as far as it is found on the way.
#[derive(Clone, Debug)]
pub(super) struct Look {
    /// What the inputs do.
    pub(super) inputs: Vec<Acting>,
    /// Terms of the inputs that were found and applied; they are parameters from then on.
    pub(super) applied: Vec<Term>,
    /// Inputs whose delays are asked for: they are parameters from the beginning.
    pub(super) fitted: Vec<usize>,
    /// Gains of inputs that are no candidates: the record that they correct asks for ever more of them.
    pub(super) refused: Vec<Term>,
    /// Frequency up to which every coordinate is taken, Hz; zero where it is taken as far as it stands out of its noise.
    pub(super) taken: Vec<f64>,
}

impl Look {
    pub(super) fn first(model: &dyn Model<f64>, settings: &Settings) -> Self {
        let dims = model.dims();
        let inputs = vec![Acting { delay: 0.0, gain: 1.0 }; dims.inputs];
        let fitted: Vec<usize> = settings.fitted_delays.iter().copied().filter(|&input| input < dims.inputs).collect();
        let delay = |&of: &usize| Term { kind: TermKind::Delay, row: None, of, other: None };
        Look {
            inputs,
            applied: fitted.iter().map(delay).collect(),
            fitted,
            refused: Vec::new(),
            taken: vec![0.0; dims.coordinates],
        }
    }

    /// Whether a term is a delay that is asked for.
    pub(super) fn is_fitted(&self, term: Term) -> bool {
        term.kind == TermKind::Delay && self.fitted.contains(&term.of)
    }

    /// Applies what was found of an input beside what was applied before.
    pub(super) fn apply(&mut self, term: Term, value: f64) {
        let own = &mut self.inputs[term.of];
        match term.kind {
            TermKind::InputGain => own.gain /= (1.0 + value).clamp(LEAST_STEP, 1.0 / LEAST_STEP),
            _ => own.delay += value,
        }
        if !self.applied.contains(&term) {
            self.applied.push(term);
        }
    }
}

/// What a record shows whatever its inputs do. It is the same in every pass in which the motion is taken as far.
pub(super) struct Ground {
    /// Frequencies up to which the coordinates are taken.
    taken: Vec<f64>,
    /// The rows along the motion, stretch by stretch, under the inputs of the first pass.
    pub(super) along: Vec<Along>,
    /// What noise of the sensors makes of the columns of the parameters: lines of all rows before anything is known.
    pub(super) noise: OnceCell<Vec<RowLines>>,
    /// Lines of the columns of the parameters of every row.
    lines: RefCell<Vec<Remembered>>,
}

/// What was found of a record whatever its inputs do, for every motion that was taken.
#[derive(Default)]
pub(super) struct Memory {
    grounds: RefCell<Vec<Rc<Ground>>>,
}

impl Memory {
    /// What is known of the motion that a look takes; the first time it is found along these paths.
    pub(super) fn of(&self, look: &Look, paths: &Paths<'_>) -> Result<Rc<Ground>, EstimateError> {
        let known = self.grounds.borrow().iter().find(|own| own.taken == look.taken).cloned();
        if let Some(known) = known {
            return Ok(known);
        }
        let rows = paths.rows;
        let ground = Rc::new(Ground {
            taken: look.taken.clone(),
            along: paths.paths.iter().map(|path| rows.along(path)).collect::<Result<_, _>>()?,
            noise: OnceCell::new(),
            lines: RefCell::new((0..rows.model.dims().rows).map(|_| Remembered::default()).collect()),
        });
        self.grounds.borrow_mut().push(Rc::clone(&ground));
        Ok(ground)
    }
}

/// A record, its motion, whether that goes over into its beginning, and what was found of it whatever the inputs do.
pub(super) type Known<'a> = (&'a TimeRecord<'a>, &'a Motion, bool, &'a Memory);

/// A record as lines, before the noise is found.
pub(super) struct Pass<'a> {
    pub(super) rows: Rows<'a>,
    pub(super) record: &'a TimeRecord<'a>,
    pub(super) motion: &'a Motion,
    pub(super) look: Look,
    pub(super) ground: Rc<Ground>,
    pub(super) paths: Paths<'a>,
    pub(super) along: Vec<Along>,
    pub(super) scales: Scales,
    pub(super) terms: Vec<Term>,
    /// Columns of every term, scaled to a root mean square of one, stretch by stretch.
    pub(super) columns: Vec<Vec<Columns>>,
    /// What the columns of a term were divided by.
    pub(super) sizes: Vec<f64>,
    /// Values of all parameters from which the rows are linear.
    pub(super) theta: Vec<f64>,
    /// Parameters that are estimated: all but those that are held and one for every direction that is not shown.
    pub(super) kept: Vec<usize>,
    pub(super) hidden: Vec<Vec<f64>>,
    /// How many of these, the last ones, are scales of parameters that show in ratios alone.
    pub(super) scale_directions: usize,
    pub(super) views: Vec<View>,
    /// The coordinate whose acceleration leads a row without an input; nothing for other rows, and before the row is linearised.
    pub(super) leading: Vec<Option<usize>>,
    /// Mean coefficients of the accelerations: row by row and coordinate by coordinate, one for every parameter.
    pub(super) coefficients: Vec<Vec<Vec<f64>>>,
    /// Lines of all rows with the terms; none before these are asked for.
    pub(super) lines: Vec<RowLines>,
    /// How the rows feel the motion; nothing before first values are known.
    pub(super) felt: Option<Felt>,
}

/// Columns of parameters that are estimated; what the others make with their values is taken from the right-hand side.
pub(super) fn without_held(columns: Signals, target: &mut [f64], (estimated, values): (&[usize], &[f64])) -> Signals {
    let (kept, held): (Signals, Signals) = columns.into_iter().partition(|(j, _)| estimated.contains(j));
    for (j, column) in held.iter().filter(|(j, _)| values[*j] != 0.0) {
        target.iter_mut().zip(column).for_each(|(sum, x)| *sum -= values[*j] * x);
    }
    kept
}

impl Pass<'_> {
    pub(super) fn right(&self) -> usize {
        self.rows.model.dims().parameters + self.terms.len()
    }

    /// Whether the acceleration of a coordinate stands in a row.
    pub(super) fn coupled(&self, row: usize, c: usize) -> bool {
        self.coefficients[row][c].iter().any(|own| *own != 0.0)
    }

    /// The parameter that makes the acceleration of a coordinate in its own row, and no other.
    pub(super) fn own_inertia(&self, c: usize) -> Option<usize> {
        let makes = |row: usize, other: usize, j: usize| self.coefficients[row][other][j] != 0.0;
        let alone = |j: usize| {
            let all = self.coefficients.iter().enumerate().flat_map(|(row, own)| (0..own.len()).map(move |o| (row, o)));
            all.filter(|(row, other)| makes(*row, *other, j)).all(|at| at == (c, c))
        };
        let of_row = self.coefficients.get(c)?;
        self.kept.iter().copied().find(|&j| of_row[c][j] != 0.0 && alone(j))
    }

    /// Whether no input acts in a row.
    pub(super) fn homogeneous(&self, row: usize) -> bool {
        !self.scales.driven(row)
    }

    /// How the rows are looked at, given the coordinates that each of them feels.
    pub(super) fn views(&self, coordinates: &dyn Fn(usize) -> Vec<usize>) -> Vec<View> {
        let dims = self.rows.model.dims();
        (0..dims.rows)
            .map(|row| {
                let (low_pass, used) = band(&coordinates(row), &self.paths.measured);
                let own = (row < dims.coordinates).then_some(row);
                let of = own.unwrap_or(0);
                View {
                    low_pass,
                    used,
                    lost: lost(low_pass, self.paths.fastest()),
                    coordinate: own,
                    rate_deviation: self.paths.measured[of].rate_deviation,
                    followed: self.paths.measured[of].spectrum.followed,
                    notch: 1.0,
                }
            })
            .collect()
    }

    /// The signals of one row, stretch by stretch, about the present values where it has a leading acceleration, and the force of this
    /// acceleration; `missing` are the coefficients of the terms.
    pub(super) fn signals(&self, row: usize, missing: &[f64]) -> Result<(Vec<Signals>, Vec<Signals>), EstimateError> {
        let dims = self.rows.model.dims();
        let right = self.right();
        let mut signals: Vec<Signals> = Vec::with_capacity(self.paths.paths.len());
        let mut forces: Vec<Signals> = Vec::new();
        for (stretch, (path, along)) in self.paths.paths.iter().zip(&self.along).enumerate() {
            let of_terms = || {
                let own = self.columns.get(stretch).into_iter().flatten().enumerate();
                own.flat_map(|(i, columns)| {
                    columns.iter().filter(|(at, _)| *at == row).map(move |(_, values)| (i, values))
                })
            };
            let predicted = match self.leading[row] {
                Some(c) => {
                    let mut others = vec![0.0; path.points];
                    for (i, values) in of_terms() {
                        let value = missing.get(i).copied().unwrap_or(0.0);
                        if value != 0.0 {
                            others.iter_mut().zip(values).for_each(|(sum, x)| *sum += value * x);
                        }
                    }
                    self.rows.predicted(path, (row, c), &self.theta, &others)?
                }
                None => None,
            };
            let (columns, mut target, factor) = match predicted {
                Some(found) => {
                    forces.push(vec![(0, found.leading)]);
                    let present = |(_, column): &(usize, Vec<f64>)| column.iter().any(|x| *x != 0.0);
                    let columns = found.columns.into_iter().enumerate().filter(present).collect();
                    (columns, found.right, Some(found.factor))
                }
                None => {
                    let target = along.place(row, Entry::Right).map(|at| along.column(at));
                    (along.parameters(row), target.unwrap_or_else(|| vec![0.0; path.points]), None)
                }
            };
            let mut own: Signals = self.without_held(columns, &mut target);
            for (i, values) in of_terms() {
                let values = match &factor {
                    Some(factor) => values.iter().zip(factor).map(|(x, f)| x * f).collect(),
                    None => values.clone(),
                };
                own.push((dims.parameters + i, values));
            }
            own.push((right, target));
            signals.push(own);
        }
        Ok((signals, forces))
    }

    /// The lines of one row.
    pub(super) fn row(&self, row: usize, missing: &[f64]) -> Result<Option<RowLines>, EstimateError> {
        let (right, view) = (self.right(), self.views[row]);
        let (signals, forces) = self.signals(row, missing)?;
        let mut remembered = self.ground.lines.borrow_mut();
        let found = match self.leading[row] {
            // Its columns follow the present values.
            Some(_) => row_lines(&self.paths.paths, view, &signals),
            None => {
                let beside = (&mut remembered[row], self.rows.model.dims().parameters);
                row_lines_beside(&self.paths.paths, view, &signals, beside)
            }
        };
        let Some(mut lines) = found else { return Ok(None) };
        // What the noise may be in proportion to: the forces of the inputs, or the force of the leading acceleration.
        let leading = if forces.len() == signals.len() { row_lines(&self.paths.paths, view, &forces) } else { None };
        let power = leading.map_or_else(|| lines.column(right), |leading| leading.column(0));
        lines.take_power(power);
        Ok(Some(lines))
    }

    /// The columns of the parameters that are estimated; what the others make is taken from the right-hand side.
    pub(super) fn without_held(&self, columns: Signals, target: &mut [f64]) -> Signals {
        without_held(columns, target, (&self.kept, &self.theta))
    }

    /// The lines of all rows.
    ///
    /// # Errors
    /// [`EstimateError::NoSignal`] when the stretches are too short for a row.
    pub(super) fn all_rows(&self, missing: &[f64]) -> Result<Vec<RowLines>, EstimateError> {
        let rows = self.rows.model.dims().rows;
        (0..rows).map(|row| self.row(row, missing)?.ok_or(EstimateError::NoSignal)).collect()
    }

    /// The lines of some rows, which keep their floors.
    pub(super) fn rows_anew(&mut self, rows: &[usize], missing: &[f64]) -> Result<(), EstimateError> {
        for &row in rows {
            if let Some(lines) = self.row(row, missing)? {
                self.lines[row] = RowLines { floor: self.lines[row].floor.clone(), ..lines };
            }
        }
        Ok(())
    }
}
