//! Friction of a row along a record: what acts in it beside all else that the model explains, over the rate of its coordinate.

use tpm_controller::model::{EvalError, Model};

/// Friction of a row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrictionCourse {
    /// The coordinate.
    pub coordinate: String,
    /// Its unit.
    pub unit: Option<String>,
    /// The unit of the force.
    pub force_unit: Option<String>,
    /// Rate, and the force of the row that the other terms of the model leave.
    pub points: Vec<(f64, f64)>,
    /// Rate, and what the terms of friction make of it.
    pub law: Vec<(f64, f64)>,
}

/// The parameters of which a row has nothing but functions of the rate of its own coordinate.
pub(super) struct OwnFriction<'a> {
    model: &'a dyn Model<f64>,
    constants: &'a [f64],
    row: usize,
    /// Values of these parameters, zero for all others.
    pub(super) values: Vec<f64>,
    /// Weights under which the terms of the row are its rate.
    pub(super) rate: Vec<f64>,
    force_unit: Option<String>,
}

/// Rates that are tried, in units of the coordinate's.
const RATES: [f64; 4] = [-1.0, -0.3, 0.4, 1.1];
/// States that are tried: all else differs between them.
const STATES: usize = 3;
/// Terms that differ by less than this share of the largest are equal.
const EQUAL: f64 = 1e-12;
/// Points at which the terms of friction are drawn.
const DRAWN: usize = 201;

impl<'a> OwnFriction<'a> {
    /// The friction of a row; nothing where no parameter is one, none makes a force in proportion to the rate, from which this is told, or
    /// one takes part in an `open` direction: how much of the row is friction is not known then.
    pub(super) fn of(
        model: &'a dyn Model<f64>,
        constants: &'a [f64],
        row: usize,
        parameters: &[f64],
        open: &[Vec<f64>],
    ) -> Result<Option<Self>, EvalError> {
        let dims = model.dims();
        if row >= dims.coordinates || dims.order < 2 || model.needs_inputs() {
            return Ok(None);
        }
        let mut own = Self {
            model,
            constants,
            row,
            values: vec![0.0; dims.parameters],
            rate: vec![0.0; dims.parameters],
            force_unit: model.row(row).unit.map(Into::into),
        };
        let columns: Vec<Vec<Vec<f64>>> = (RATES.iter())
            .map(|&rate| (0..STATES).map(|state| own.terms(rate, state)).collect::<Result<_, _>>())
            .collect::<Result<_, _>>()?;
        for j in 0..dims.parameters {
            let at = |rate: usize, state: usize| columns[rate][state][j];
            let largest = (0..RATES.len()).map(|rate| at(rate, 0).abs()).fold(0.0, f64::max);
            let alike = |a: f64, b: f64| (a - b).abs() <= EQUAL * largest;
            let own_alone = (0..RATES.len()).all(|rate| (1..STATES).all(|state| alike(at(rate, 0), at(rate, state))));
            if largest <= 0.0 || !own_alone {
                continue;
            }
            if open.iter().any(|direction| direction[j] != 0.0) {
                return Ok(None);
            }
            own.values[j] = parameters[j];
            // Rows with several inputs do not state a unit. What stands beside a sign or alone is the force itself.
            if own.force_unit.is_none() && (0..RATES.len()).all(|rate| alike(at(rate, 0).abs(), largest)) {
                own.force_unit = model.parameter(j).unit.map(Into::into);
            }
            let slope = at(0, 0) / RATES[0];
            if RATES.iter().enumerate().all(|(rate, value)| alike(at(rate, 0), slope * value)) {
                own.rate = vec![0.0; dims.parameters];
                own.rate[j] = 1.0 / slope;
            }
        }
        Ok(own.rate.iter().any(|weight| *weight != 0.0).then_some(own))
    }

    /// The terms of the row, parameter by parameter, at a rate of its coordinate in one of the states.
    fn terms(&self, rate: f64, state: usize) -> Result<Vec<f64>, EvalError> {
        let dims = self.model.dims();
        // Numbers that have nothing to do with each other.
        let mut motion: Vec<f64> =
            (0..dims.motion_len()).map(|slot| (1.0 + 7.3 * state as f64 + 2.1 * slot as f64).sin()).collect();
        motion[dims.coordinates + self.row] = rate;
        let (mut work, mut phi) = (vec![0.0; self.model.workspace_len()], vec![0.0; dims.regressor_len()]);
        self.model.regressor(&motion, self.constants, &mut work, &mut phi)?;
        Ok(phi[self.row * dims.parameters..(self.row + 1) * dims.parameters].to_vec())
    }

    /// The friction of points: rate, what the model leaves, and what it makes of friction.
    pub(super) fn course(&self, rates: &[f64], left: &[f64], made: &[f64]) -> Result<FrictionCourse, EvalError> {
        let points: Vec<(f64, f64)> = (rates.iter().zip(left).zip(made))
            .map(|((rate, left), made)| (*rate, left + made))
            .filter(|(rate, force)| rate.is_finite() && force.is_finite())
            .collect();
        let (low, high) =
            points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (v, _)| (low.min(*v), high.max(*v)));
        let mut law = Vec::with_capacity(DRAWN);
        for k in 0..DRAWN {
            let rate = low + (high - low) * k as f64 / (DRAWN - 1) as f64;
            let terms = self.terms(rate, 0)?;
            law.push((rate, terms.iter().zip(&self.values).map(|(term, value)| term * value).sum()));
        }
        let label = self.model.coordinate(self.row);
        Ok(FrictionCourse {
            coordinate: label.name.into(),
            unit: label.unit.map(Into::into),
            force_unit: self.force_unit.clone(),
            points,
            law,
        })
    }
}
