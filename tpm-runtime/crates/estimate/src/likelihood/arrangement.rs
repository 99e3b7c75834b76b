//! Columns of a record that stand for others: which exchange of columns, or which other sign, lets the model explain the forces.
//!
//! The motion is smoothed once, and anew where an input takes part in it. Every arrangement is a regression of its own, at a few hundred
//! instants away from reversals:
//!
//! ```text
//! min over theta of sum_j |Y_j(arranged motion) theta + known_j - (B u)_j|^2 / |(B u)_j|^2
//! ```

use crate::error::EstimateError;
use crate::likelihood::pass::{Look, without_held};
use crate::likelihood::path::{Entry, Paths, band, lost};
use crate::rows::Rows;
use crate::settings::Settings;
use crate::time_domain::motion::{Motion, TimeRecord};
use rayon::prelude::*;
use tpm_controller::model::{Model, moving};
use tpm_numerics::singular::unit_columns;
use tpm_numerics::{Cholesky, DMatrix, DVector, gram, root_mean_square};

/// Instants at which the rows are evaluated.
const INSTANTS: usize = 600;
/// What is added to the diagonal of scaled normal equations, so that columns that others span change nothing.
const RIDGE: f64 = 1e-10;

/// How columns of a record stand for others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrangement {
    /// The columns of a coordinate and of an input are exchanged.
    CoordinateAndInput(usize, usize),
    /// The columns of two coordinates are exchanged.
    Coordinates(usize, usize),
    /// The columns of two inputs are exchanged.
    Inputs(usize, usize),
    /// Two coordinates are exchanged, and the inputs of the same numbers.
    Both(usize, usize),
    /// A coordinate has the other sign.
    CoordinateSign(usize),
    /// An input has the other sign.
    InputSign(usize),
}

impl Arrangement {
    /// All arrangements of the columns of a model; `acts` says in which rows an input acts. A coordinate is exchanged for an input of its own
    /// row: both stand beside each other in a log. A sign of the only coordinate or input is one of the parameters.
    fn all(model: &dyn Model<f64>, acts: &dyn Fn(usize, usize) -> bool) -> Vec<Self> {
        let dims = model.dims();
        let (coordinates, inputs) = (moving(model), dims.inputs);
        let pairs = |n: usize| (0..n).flat_map(move |a| (0..a).map(move |b| (b, a)));
        let own = |(c, i): &(usize, usize)| coordinates != dims.rows || acts(*c, *i);
        let crossed = (0..coordinates).flat_map(|c| (0..inputs).map(move |i| (c, i))).filter(own);
        let mut all: Vec<Self> = crossed.map(|(c, i)| Arrangement::CoordinateAndInput(c, i)).collect();
        all.extend(pairs(coordinates).map(|(a, b)| Arrangement::Coordinates(a, b)));
        all.extend(pairs(inputs).map(|(a, b)| Arrangement::Inputs(a, b)));
        all.extend(pairs(coordinates.min(inputs)).map(|(a, b)| Arrangement::Both(a, b)));
        if coordinates > 1 {
            all.extend((0..coordinates).map(Arrangement::CoordinateSign));
            all.extend((0..inputs).map(Arrangement::InputSign));
        }
        all
    }

    /// Arranges what belongs to the coordinates and to the inputs; `negate` is the other sign of it.
    pub fn arrange<T>(self, coordinates: &mut [T], inputs: &mut [T], negate: impl FnOnce(&mut T)) {
        match self {
            Arrangement::CoordinateAndInput(c, i) => std::mem::swap(&mut coordinates[c], &mut inputs[i]),
            Arrangement::Coordinates(a, b) => coordinates.swap(a, b),
            Arrangement::Inputs(a, b) => inputs.swap(a, b),
            Arrangement::Both(a, b) => {
                coordinates.swap(a, b);
                inputs.swap(a, b);
            }
            Arrangement::CoordinateSign(c) => negate(&mut coordinates[c]),
            Arrangement::InputSign(i) => negate(&mut inputs[i]),
        }
    }
}

/// What arrangements of the columns leave of the forces.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Arranged {
    /// The arrangement that leaves least.
    pub arrangement: Arrangement,
    /// Share of the forces that it leaves.
    pub left: f64,
    /// Share of the forces that the columns leave as they are.
    pub as_recorded: f64,
}

/// The arrangement of the columns of a record by which a model explains the forces best; nothing where none can be evaluated.
///
/// # Errors
/// [`EstimateError::NoSignal`] when the record has no samples, or too few; [`EstimateError::Frozen`] and [`EstimateError::AllFrozen`] when
/// parameters are held that do not exist, or all; [`EstimateError::Model`] and [`EstimateError::NotFinite`] when the rows cannot be
/// evaluated on the motion as it is recorded.
pub fn best_arrangement(
    model: &dyn Model<f64>,
    constants: &[f64],
    record: &TimeRecord<'_>,
    settings: &Settings,
) -> Result<Option<Arranged>, EstimateError> {
    let free = settings.free(model.dims().parameters)?.indices;
    let motion = Motion::new(record, false)?;
    let rows = Rows { model, constants };
    let look = Look::first(model, settings);
    let paths = Paths::new(rows, record, &motion, false, (&look.inputs, &look.taken));
    let held = settings.start(model.dims().parameters);
    let regression = Regression { rows, free: &free, held: &held };
    let as_recorded = regression.left(&paths)?.ok_or(EstimateError::NoSignal)?;
    let of = |arrangement: &Arrangement| {
        // A motion on which the rows have no value is none of the machine.
        let left = match *arrangement {
            Arrangement::CoordinateAndInput(c, i) => {
                let record = crossed(record, c, i);
                let motion = Motion::new(&record, false).ok()?;
                regression.left(&Paths::new(rows, &record, &motion, false, (&look.inputs, &look.taken)))
            }
            other => regression.left(&arranged(&paths, other)),
        };
        let left = left.ok().flatten()?;
        left.is_finite().then_some(Arranged { arrangement: *arrangement, left, as_recorded })
    };
    let sides = paths
        .paths
        .first()
        .map(|path| rows.along(&path.excerpt(0..path.points, path.points.div_ceil(INSTANTS))))
        .transpose()?;
    let acts = |row: usize, i: usize| sides.as_ref().is_none_or(|along| along.place(row, Entry::Force(i)).is_some());
    Ok(Arrangement::all(model, &acts).par_iter().filter_map(of).min_by(|a, b| a.left.total_cmp(&b.left)))
}

/// A record with the columns of a coordinate and of an input exchanged.
fn crossed<'a>(record: &TimeRecord<'a>, c: usize, i: usize) -> TimeRecord<'a> {
    let mut record = record.clone();
    for stretch in &mut record.stretches {
        std::mem::swap(&mut stretch.coordinates[c], &mut stretch.inputs[i]);
        if let Some(rate) = stretch.rates.get_mut(c) {
            *rate = None;
        }
    }
    record
}

/// A record, smoothed, with its columns arranged in another way, in which coordinates stay coordinates.
fn arranged<'a>(paths: &Paths<'a>, arrangement: Arrangement) -> Paths<'a> {
    let model = paths.rows.model;
    paths.with(|path| {
        let derivatives = |c: usize| (0..=model.coordinate_order(c)).map(|order| path.series(c, order)).collect();
        let mut coordinates: Vec<Vec<Vec<f64>>> = (0..model.dims().coordinates).map(derivatives).collect();
        let mut inputs: Vec<Vec<Vec<f64>>> = path.inputs.iter().map(|input| vec![input.clone()]).collect();
        arrangement
            .arrange(&mut coordinates, &mut inputs, |signals| signals.iter_mut().flatten().for_each(|x| *x = -*x));
        (coordinates, inputs.into_iter().flatten().collect())
    })
}

struct Regression<'a> {
    rows: Rows<'a>,
    /// The parameters that are estimated.
    free: &'a [usize],
    /// Values of all parameters, of which those of the others count.
    held: &'a [f64],
}

impl Regression<'_> {
    /// Share of the forces that the best values leave, the root mean square over the rows; nothing where there are no instants or forces.
    fn left(&self, paths: &Paths<'_>) -> Result<Option<f64>, EstimateError> {
        let dims = self.rows.model.dims();
        let (low_pass, _) = band(&[], &paths.measured);
        let lost = lost(low_pass, paths.fastest());
        let points: usize = paths.paths.iter().map(|path| path.valid(lost).len()).sum();
        let step = (points / INSTANTS).max(1);
        let mut equations: Vec<(Vec<f64>, Vec<f64>)> = vec![(Vec::new(), Vec::new()); dims.rows];
        for path in &paths.paths {
            let few = path.excerpt(path.valid(lost), step);
            if few.points == 0 {
                continue;
            }
            let along = self.rows.along(&few)?;
            for (row, (entries, targets)) in equations.iter_mut().enumerate() {
                let target = along.place(row, Entry::Right).map(|at| along.column(at));
                let mut target = target.unwrap_or_else(|| vec![0.0; few.points]);
                let columns = without_held(along.parameters(row), &mut target, (self.free, self.held));
                let of = |j: &usize| columns.iter().find(|(own, _)| own == j).map(|(_, column)| column);
                let columns: Vec<Option<&Vec<f64>>> = self.free.iter().map(of).collect();
                for k in 0..few.points {
                    entries.extend(columns.iter().map(|column| column.map_or(0.0, |column| column[k])));
                }
                targets.extend(target);
            }
        }
        // Every row counts by the share of its own force.
        let (mut entries, mut target) = (Vec::new(), Vec::new());
        for (own, targets) in &equations {
            let force = root_mean_square(targets.iter().copied());
            if force > 0.0 {
                entries.extend(own.iter().map(|x| x / force));
                target.extend(targets.iter().map(|x| x / force));
            }
        }
        if target.is_empty() {
            return Ok(None);
        }
        let n = self.free.len();
        let stacked = DMatrix::from_row_slice(target.len(), n, &entries);
        let target = DVector::from_vec(target);
        let (stacked, _) = unit_columns(stacked);
        let gram = gram(&stacked) + DMatrix::identity(n, n) * RIDGE;
        let Some(factor) = Cholesky::new(gram) else { return Ok(None) };
        let left = &target - &stacked * factor.solve(&stacked.tr_mul(&target));
        Ok(Some(left.norm() / target.norm()))
    }
}
