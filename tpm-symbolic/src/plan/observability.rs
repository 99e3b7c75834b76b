//! What sensors can show of a model's parameters at all, while the states that nobody measures are unknown.
//!
//! The motion is a power series in time: from initial states, parameters and inputs drawn at random the rows `M a = f` give one coefficient
//! of the highest derivatives after the other, and with them those of everything that a sensor reads. Carried along with its derivative by
//! one unknown, such a series is a column of the readings' sensitivities; their rank says what the readings determine (A. Sedoglavic, 2002).
//! It is computed modulo a prime, which is certain as a lower bound and fails as an upper one with a probability of about 1e-17 a number.
//!
//! A parameter counts as shown where the readings of some motion determine it, the states at the beginning of each being unknown. Signs
//! are drawn as 1 or -1, so that all motions together turn both ways; other functions have values drawn like those of leaves.

use crate::algebra::field::{Field, Residues};
use crate::expr::graph::{Coordinate, Function};
use crate::expr::point::Draws;
use crate::mechanics::model::{ExactModel, Kind};
use crate::plan::dynamics::Dynamics;
use crate::plan::entries::Entries;
use crate::plan::leaf::Leaf;
use crate::plan::operation::Op;
use crate::plan::straight_line::Plan;
use crate::regressor::form::RegressorForm;
use std::collections::BTreeSet;

/// Motions, each with initial states, inputs and signs of its own.
const MOTIONS: u64 = 6;
/// Most unknowns; the work grows with their fourth power.
const MOST_UNKNOWNS: usize = 48;

/// What sensors show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shown {
    /// Independent combinations of the columns that are not held which the readings determine.
    pub rank: usize,
    /// Columns of which the readings determine only a combination, as many lists as there are directions that they do not show.
    pub together: Vec<Vec<usize>>,
    /// Coordinates that no reading depends on.
    pub unfelt: Vec<Coordinate>,
}

/// What sensors of these coordinates and derivatives show of a model, whose columns `held` are known; nothing where the rows do not determine
/// the motion, are not affine in its highest derivatives, or have too many unknowns.
#[must_use]
pub fn shown(model: &ExactModel, form: &RegressorForm, sensors: &[(Coordinate, u32)], held: &[usize]) -> Option<Shown> {
    let entries = Entries::new(model, form);
    let coordinates = entries.coordinates.clone();
    let plan = Dynamics::new(entries)?.plan;
    let states: Vec<(usize, usize)> = (coordinates.iter().enumerate())
        .flat_map(|(c, &(_, order))| (0..order as usize).map(move |d| (c, d)))
        .collect();
    let free: Vec<usize> = (0..form.columns.len()).filter(|column| !held.contains(column)).collect();
    let unknowns = states.len() + free.len();
    if unknowns > MOST_UNKNOWNS || states.is_empty() {
        return None;
    }
    let read = |&(coordinate, derivative): &(Coordinate, u32)| {
        let c = coordinates.iter().position(|(own, _)| *own == coordinate)?;
        (derivative <= coordinates[c].1).then_some((c, derivative as usize))
    };
    let sensors: Vec<(usize, usize)> = sensors.iter().filter_map(read).collect();
    let field = Residues::new(Residues::PRIMES[0]);
    let mut rows: Vec<Vec<u64>> = Vec::new();
    let mut felt: BTreeSet<usize> = BTreeSet::new();
    for motion in 0..MOTIONS {
        let machine = Machine { field: &field, model, plan: &plan, coordinates: &coordinates, motion };
        let length = unknowns + 1;
        let mut columns: Vec<Vec<u64>> = Vec::with_capacity(unknowns);
        for &state in &states {
            let column = machine.sensitivity(Unknown::State(state), &sensors, length)?;
            if column.iter().any(|value| *value != 0) {
                felt.insert(state.0);
            }
            columns.push(column);
        }
        for &column in &free {
            columns.push(machine.sensitivity(Unknown::Column(column), &sensors, length)?);
        }
        let readings = columns.first().map_or(0, Vec::len);
        let mut own: Vec<Vec<u64>> =
            (0..readings).map(|row| columns.iter().map(|column| column[row]).collect()).collect();
        let order: Vec<usize> = (0..unknowns).collect();
        let pivots = field.reduce(&mut own, &order);
        // Rows without an initial state in them are what the readings say of the parameters whatever these states were.
        let of_parameters = own.into_iter().zip(pivots).filter(|(_, pivot)| *pivot >= states.len());
        rows.extend(of_parameters.map(|(row, _)| row[states.len()..].to_vec()));
    }
    let order: Vec<usize> = (0..free.len()).collect();
    let pivots = field.reduce(&mut rows, &order);
    let hidden = (0..free.len()).filter(|column| !pivots.contains(column));
    let direction = |column: usize| {
        let moved = pivots.iter().zip(&rows).filter(|(_, row)| row[column] != 0).map(|(pivot, _)| free[*pivot]);
        let mut own: Vec<usize> = moved.chain([free[column]]).collect();
        own.sort_unstable();
        own
    };
    Some(Shown {
        rank: pivots.len(),
        together: hidden.map(direction).collect(),
        unfelt: (0..coordinates.len()).filter(|c| !felt.contains(c)).map(|c| coordinates[c].0).collect(),
    })
}

/// By what a reading is differentiated.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Unknown {
    /// The initial value of a derivative of a coordinate.
    State((usize, usize)),
    /// The parameter of a column.
    Column(usize),
}

/// A number and its derivative by the unknown.
type Dual = (u64, u64);

/// A model with what is drawn for one motion.
struct Machine<'a> {
    field: &'a Residues,
    model: &'a ExactModel,
    plan: &'a Plan,
    coordinates: &'a [(Coordinate, u32)],
    motion: u64,
}

/// The use of a random number. Equal uses draw equal numbers.
#[derive(Clone, Copy)]
enum Purpose {
    Column = 1,
    Constant,
    State,
    Input,
    Function,
    Sign,
}

impl Machine<'_> {
    fn drawn(&self, purpose: Purpose, motion: u64, index: usize, order: usize) -> u64 {
        let mut draws = Draws::new(((motion * 8 + purpose as u64) << 40) + ((index as u64) << 16) + order as u64);
        // Denominators are small powers: a zero is drawn as rarely as a rank is wrong.
        self.field.element(draws.word())
    }

    /// Derivatives of all coefficients of the readings by an unknown; nothing where a denominator vanishes.
    fn sensitivity(&self, by: Unknown, sensors: &[(usize, usize)], length: usize) -> Option<Vec<u64>> {
        let n = self.coordinates.len();
        let field = self.field;
        // Coefficients of every derivative of every coordinate.
        let mut series: Vec<Vec<Vec<Dual>>> =
            self.coordinates.iter().map(|&(_, order)| vec![Vec::new(); order as usize + 1]).collect();
        for (c, own) in series.iter_mut().enumerate() {
            let order = own.len() - 1;
            for (d, own) in own.iter_mut().enumerate().take(order) {
                let value = self.drawn(Purpose::State, self.motion, c * 8 + d, 0);
                own.push((value, u64::from(by == Unknown::State((c, d)))));
            }
        }
        let mut slots: Vec<Values> = self.plan.ops.iter().map(|_| Values::default()).collect();
        for k in 0..length {
            self.advance(by, k, &series, &mut slots)?;
            let output = |i: usize, k: usize| slots[self.plan.outputs[i].index()].own[k];
            let mut matrix: Vec<Dual> = (0..n * n).map(|i| output(i, 0)).collect();
            let mut right: Vec<Dual> = Vec::with_capacity(n);
            for row in 0..n {
                let mut value = output(n * n + row, k);
                for i in 1..=k {
                    for (c, own) in series.iter().enumerate() {
                        let product = mul(field, output(row * n + c, i), own[own.len() - 1][k - i]);
                        value = sub(field, value, product);
                    }
                }
                right.push(value);
            }
            solve(field, &mut matrix, &mut right)?;
            let next = field.inverse(&(k as u64 + 1))?;
            for (own, value) in series.iter_mut().zip(right) {
                let order = own.len() - 1;
                own[order].push(value);
                for d in 0..order {
                    let (a, b) = own[d + 1][k];
                    own[d].push((field.mul(&a, &next), field.mul(&b, &next)));
                }
            }
        }
        Some(sensors.iter().flat_map(|&(c, d)| series[c][d].iter().map(|(_, by)| *by)).collect())
    }

    /// The coefficients of order k of all results of the plan.
    fn advance(&self, by: Unknown, k: usize, series: &[Vec<Vec<Dual>>], slots: &mut [Values]) -> Option<()> {
        let field = self.field;
        for (at, op) in self.plan.ops.iter().enumerate() {
            let (before, rest) = slots.split_at_mut(at);
            let of = |slot: &crate::plan::operation::Slot| before[slot.index()].own.as_slice();
            let constant = |value: u64| if k == 0 { (value, 0) } else { (0, 0) };
            let slot = &mut rest[0];
            let value = match op {
                Op::Constant(value) => constant(if k == 0 { field.number(value)? } else { 0 }),
                Op::Pi => constant(self.drawn(Purpose::Function, 0, 0xffff, 0)),
                Op::Load(index) => match self.plan.inputs[*index as usize] {
                    Leaf::Motion(coordinate, order) => {
                        let c = self.coordinates.iter().position(|(own, _)| *own == coordinate)?;
                        series[c][order as usize][k]
                    }
                    Leaf::Column(column) => {
                        let (value, _) = constant(self.drawn(Purpose::Column, 0, column, 0));
                        (value, u64::from(k == 0 && by == Unknown::Column(column)))
                    }
                    Leaf::Symbol(symbol) if self.model.quantity(symbol).kind == Kind::Input => {
                        (self.drawn(Purpose::Input, self.motion, symbol.0 as usize, k), 0)
                    }
                    Leaf::Symbol(symbol) => constant(self.drawn(Purpose::Constant, 0, symbol.0 as usize, 0)),
                    _ => return None,
                },
                Op::Add(a, b) => add(field, of(a)[k], of(b)[k]),
                Op::Sub(a, b) => sub(field, of(a)[k], of(b)[k]),
                Op::Neg(a) => sub(field, (0, 0), of(a)[k]),
                Op::Mul(a, b) => convolved(field, of(a), of(b), 0, k),
                Op::Div(a, b) => {
                    let left = sub(field, of(a)[k], convolved(field, of(b), &slot.own, 1, k));
                    div(field, left, of(b)[0])?
                }
                Op::Function(function, a) => self.function(*function, (at, a.index()), of(a), k, slot)?,
                Op::Atan2(y, x) => self.angle(at, of(y), of(x), k)?,
            };
            slot.own.push(value);
        }
        Some(())
    }

    /// Coefficient k of a function of a series u, of which it has the lower ones: from `c' = g u'`, with the value drawn where c has none in
    /// the field.
    fn function(
        &self,
        function: Function,
        (at, argument): (usize, usize),
        u: &[Dual],
        k: usize,
        slot: &mut Values,
    ) -> Option<Dual> {
        let field = self.field;
        let drawn = |place: usize| self.drawn(Purpose::Function, self.motion, place, 0);
        let sign = || if self.drawn(Purpose::Sign, self.motion, argument, 0) & 1 == 0 { 1 } else { field.sub(&0, &1) };
        match function {
            Function::Sign => return Some(if k == 0 { (sign(), 0) } else { (0, 0) }),
            Function::Abs => return Some(mul(field, (sign(), 0), u[k])),
            _ => {}
        }
        if k == 0 {
            let value = match function {
                Function::Sin | Function::Cos => {
                    // A point of the unit circle, the same for the sine and the cosine of one argument.
                    let half = drawn(argument);
                    let square = field.mul(&half, &half);
                    let below = field.inverse(&field.add(&1, &square))?;
                    let sine = field.mul(&field.add(&half, &half), &below);
                    let cosine = field.mul(&field.sub(&1, &square), &below);
                    let (own, other) = if function == Function::Sin { (sine, cosine) } else { (cosine, sine) };
                    slot.beside.push((other, 0));
                    own
                }
                _ => drawn(at),
            };
            slot.own.push((value, 0));
            if matches!(function, Function::Asin | Function::Acos) {
                slot.beside.push((drawn(at + self.plan.ops.len()), 0));
            }
            // The derivative at the beginning, by the same rule.
            let g = self.slope(function, u, slot, 1)?;
            slot.own.clear();
            let partner = match function {
                Function::Sin => Some(sub(field, (0, 0), (value, 0))),
                Function::Cos => Some((value, 0)),
                Function::Asin | Function::Acos => Some(div(field, sub(field, (0, 0), u[0]), slot.beside[0])?),
                _ => None,
            };
            if let (Some(partner), Some(beside)) = (partner, slot.beside.first_mut()) {
                beside.1 = field.mul(&partner.0, &u[0].1);
            }
            return Some((value, field.mul(&g[0].0, &u[0].1)));
        }
        let g = self.slope(function, u, slot, k)?;
        let value = integrated(field, u, &g, k)?;
        let partner: Option<Vec<Dual>> = match function {
            Function::Sin => Some(slot.own.iter().map(|x| sub(field, (0, 0), *x)).collect()),
            Function::Cos => Some(slot.own.clone()),
            Function::Asin | Function::Acos => {
                let negative: Vec<Dual> = u.iter().map(|x| sub(field, (0, 0), *x)).collect();
                Some(product(field, &negative, &reciprocal(field, &slot.beside[..k])?, k))
            }
            _ => None,
        };
        if let Some(partner) = partner {
            let other = integrated(field, u, &partner, k)?;
            slot.beside.push(other);
        }
        Some(value)
    }

    /// The first `count` coefficients of the slope of a function.
    fn slope(&self, function: Function, u: &[Dual], slot: &Values, count: usize) -> Option<Vec<Dual>> {
        let field = self.field;
        let own = &slot.own[..count.min(slot.own.len())];
        let with_one = |mut series: Vec<Dual>| {
            series[0] = add(field, series[0], (1, 0));
            series
        };
        let negative = |series: Vec<Dual>| series.into_iter().map(|x| sub(field, (0, 0), x)).collect::<Vec<Dual>>();
        Some(match function {
            Function::Sin => slot.beside[..count].to_vec(),
            Function::Cos => negative(slot.beside[..count].to_vec()),
            Function::Tan => with_one(product(field, own, own, count)),
            Function::Tanh => with_one(negative(product(field, own, own, count))),
            Function::Exp => own.to_vec(),
            Function::Log => reciprocal(field, &u[..count])?,
            Function::Sqrt => {
                let twice: Vec<Dual> = own.iter().map(|x| add(field, *x, *x)).collect();
                reciprocal(field, &twice)?
            }
            Function::Atan => reciprocal(field, &with_one(product(field, &u[..count], &u[..count], count)))?,
            Function::Asin => reciprocal(field, &slot.beside[..count])?,
            Function::Acos => negative(reciprocal(field, &slot.beside[..count])?),
            Function::Abs | Function::Sign => return None,
        })
    }

    /// Coefficient k of the angle of a point.
    fn angle(&self, at: usize, y: &[Dual], x: &[Dual], k: usize) -> Option<Dual> {
        let field = self.field;
        let count = k.max(1);
        let (y2, x2) = (product(field, y, y, count), product(field, x, x, count));
        let square: Vec<Dual> = y2.into_iter().zip(x2).map(|(a, b)| add(field, a, b)).collect();
        let below = reciprocal(field, &square)?;
        let (p, q) = (product(field, x, &below, count), product(field, y, &below, count));
        if k == 0 {
            let slope = field.sub(&field.mul(&p[0].0, &y[0].1), &field.mul(&q[0].0, &x[0].1));
            return Some((self.drawn(Purpose::Function, self.motion, at, 0), slope));
        }
        Some(sub(field, integrated(field, y, &p, k)?, integrated(field, x, &q, k)?))
    }
}

/// Coefficients of a result, and of what is carried along with it: the cosine of a sine, the root below an arc sine.
#[derive(Clone, Default)]
struct Values {
    own: Vec<Dual>,
    beside: Vec<Dual>,
}

fn add(field: &Residues, a: Dual, b: Dual) -> Dual {
    (field.add(&a.0, &b.0), field.add(&a.1, &b.1))
}

fn sub(field: &Residues, a: Dual, b: Dual) -> Dual {
    (field.sub(&a.0, &b.0), field.sub(&a.1, &b.1))
}

fn mul(field: &Residues, a: Dual, b: Dual) -> Dual {
    (field.mul(&a.0, &b.0), field.add(&field.mul(&a.0, &b.1), &field.mul(&a.1, &b.0)))
}

fn div(field: &Residues, a: Dual, b: Dual) -> Option<Dual> {
    let inverse = field.inverse(&b.0)?;
    let value = field.mul(&a.0, &inverse);
    Some((value, field.mul(&field.sub(&a.1, &field.mul(&value, &b.1)), &inverse)))
}

/// `sum_{i >= from} a_i b_{k - i}`.
fn convolved(field: &Residues, a: &[Dual], b: &[Dual], from: usize, k: usize) -> Dual {
    (from..=k).fold((0, 0), |sum, i| add(field, sum, mul(field, a[i], b[k - i])))
}

/// The first coefficients of a product.
fn product(field: &Residues, a: &[Dual], b: &[Dual], count: usize) -> Vec<Dual> {
    (0..count).map(|k| convolved(field, a, b, 0, k)).collect()
}

/// The coefficients of `1 / a`.
fn reciprocal(field: &Residues, a: &[Dual]) -> Option<Vec<Dual>> {
    let mut found: Vec<Dual> = Vec::with_capacity(a.len());
    for k in 0..a.len() {
        let one = if k == 0 { (1, 0) } else { (0, 0) };
        let left = if k == 0 { one } else { sub(field, one, convolved(field, a, &found, 1, k)) };
        found.push(div(field, left, a[0])?);
    }
    Some(found)
}

/// Coefficient k of the integral of `g u'`.
fn integrated(field: &Residues, u: &[Dual], g: &[Dual], k: usize) -> Option<Dual> {
    let sum = (1..=k).fold((0, 0), |sum, i| {
        let term = mul(field, u[i], g[k - i]);
        add(field, sum, (field.mul(&term.0, &(i as u64)), field.mul(&term.1, &(i as u64))))
    });
    let below = field.inverse(&(k as u64))?;
    Some((field.mul(&sum.0, &below), field.mul(&sum.1, &below)))
}

/// Solves a system by elimination; nothing where it is singular.
fn solve(field: &Residues, matrix: &mut [Dual], right: &mut [Dual]) -> Option<()> {
    let n = right.len();
    for column in 0..n {
        let pivot = (column..n).find(|&row| matrix[row * n + column].0 != 0)?;
        for c in 0..n {
            matrix.swap(pivot * n + c, column * n + c);
        }
        right.swap(pivot, column);
        for row in (0..n).filter(|&row| row != column) {
            let factor = div(field, matrix[row * n + column], matrix[column * n + column])?;
            for c in column..n {
                matrix[row * n + c] = sub(field, matrix[row * n + c], mul(field, factor, matrix[column * n + c]));
            }
            right[row] = sub(field, right[row], mul(field, factor, right[column]));
        }
    }
    for row in 0..n {
        right[row] = div(field, right[row], matrix[row * n + row])?;
    }
    Some(())
}
