//! Everything that an emitted estimator computes, as straight-line plans.
//!
//! Invariants of [`EstimatorPlan`]: the leaves of its plans are derivatives of the evaluation's coordinates, symbols of the
//! model, and the virtual symbols of [`Leaves`] (one per column, cosine and sine of the pattern's phase, and one signal per
//! equation), which stand behind the model's own; no plan has an operation that no output needs. Emitters print these plans
//! and decide no mathematics.

use crate::algebra::fourier::{Fourier, Trig};
use crate::algebra::fraction::Fraction;
use crate::algebra::polynomial::Polynomial;
use crate::expr::graph::{Coordinate, ExprId, Function, Graph, Node, Symbol};
use crate::harmonic::expand::{ExpandError, expand};
use crate::harmonic::table::{Entry, HarmonicTable};
use crate::mechanics::model::{Kind, Model};
use crate::mechanics::pattern::{Motion, Pattern};
use crate::number::rational;
use crate::plan::evaluation::Evaluation;
use crate::plan::split::split_form;
use crate::plan::straight_line::{Merger, Op, Plan, Slot};
use crate::regressor::form::RegressorForm;
use crate::regressor::inverse::{Inverse, Variable};
use crate::regressor::parameter_map::ParameterMap;
use num_traits::{One, Zero};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use thiserror::Error;

/// The virtual symbols of a model's plans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leaves {
    symbols: u32,
    columns: u32,
}

/// What a leaf of a plan stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leaf {
    /// A time derivative of a coordinate.
    Motion(Coordinate, u32),
    /// A symbol of the model.
    Symbol(Symbol),
    /// The estimated parameter of a column.
    Column(usize),
    /// cos w t
    Cos,
    /// sin w t
    Sin,
    /// A sample of an equation's signal.
    Signal(usize),
}

impl Leaves {
    /// The virtual symbols of a model with these columns.
    #[must_use]
    pub fn new(model: &Model, form: &RegressorForm) -> Self {
        let count = |len: usize| u32::try_from(len).expect("invariant: fewer than 2^31 names");
        Self { symbols: count(model.symbols.len()), columns: count(form.columns.len()) }
    }

    fn column(self, index: usize) -> Symbol {
        Symbol(self.symbols + u32::try_from(index).expect("invariant: fewer than 2^31 columns"))
    }

    fn cos(self) -> Symbol {
        Symbol(self.symbols + self.columns)
    }

    fn sin(self) -> Symbol {
        Symbol(self.symbols + self.columns + 1)
    }

    fn signal(self, equation: usize) -> Symbol {
        Symbol(self.sin().0 + 1 + u32::try_from(equation).expect("invariant: fewer than 2^31 equations"))
    }

    /// What a leaf of one of this model's plans is.
    #[must_use]
    pub fn leaf(self, node: &Node) -> Leaf {
        match *node {
            Node::Derivative(coordinate, order) => Leaf::Motion(coordinate, order),
            Node::Symbol(symbol) if symbol.0 < self.symbols => Leaf::Symbol(symbol),
            Node::Symbol(symbol) if symbol == self.cos() => Leaf::Cos,
            Node::Symbol(symbol) if symbol == self.sin() => Leaf::Sin,
            Node::Symbol(symbol) if symbol > self.sin() => Leaf::Signal((symbol.0 - self.signal(0).0) as usize),
            Node::Symbol(Symbol(index)) => Leaf::Column((index - self.symbols) as usize),
            _ => unreachable!("invariant: a plan loads leaves only"),
        }
    }
}

/// Why a part that depends on the pattern cannot be had.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PatternGap {
    /// A coordinate of the equations does not move by the pattern.
    #[error("the pattern gives the coordinate `{0}` no motion")]
    NoMotion(String),
    /// The table does not exist.
    #[error(transparent)]
    Expand(#[from] ExpandError),
    /// The declared Taylor polynomials lump the parameters otherwise than the equations do.
    #[error("with the declared Taylor polynomials the parameters are {table}, not {exact}")]
    Columns {
        /// Those of the equations.
        exact: String,
        /// Those of the table.
        table: String,
    },
}

/// Why the physical parameters do not follow from the columns.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum UnlumpGap {
    /// Different physical parameters have the same columns.
    #[error("the estimated parameters do not determine {}", quoted(.0))]
    NotDetermined(Vec<String>),
    /// The columns determine the parameters, at least locally, but not by a rational function that was found.
    #[error("no rational function of the estimated parameters was found that gives {}", quoted(.0))]
    NoClosedForm(Vec<String>),
}

fn quoted(names: &[String]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<String>>().join(", ")
}

/// The exact inverse of the lumping.
#[derive(Clone, Debug)]
pub struct Unlumping {
    /// The lumping.
    pub map: ParameterMap,
    /// Its inverse, complete: every parameter of the model is solved.
    pub inverse: Inverse,
    /// The intermediate quantities of the inverse that a parameter needs.
    pub intermediates: Vec<usize>,
    /// The outputs are those intermediates, then the model's parameters; leaves are columns and constants.
    pub plan: Plan,
}

/// A row of the table: equation, harmonic, cosine or sine.
pub type TableRow = (usize, usize, Trig);

/// The harmonic table and the plans that follow from it.
#[derive(Clone, Debug)]
pub struct TablePlan {
    /// The table itself.
    pub table: HarmonicTable,
    /// Its rows.
    pub rows: Vec<TableRow>,
    /// Row and column (`None`: the terms without unknown parameters) of every output of `matrix`.
    pub places: Vec<(usize, Option<usize>)>,
    /// The entries at `places`; leaves are amplitudes, frequency and constants.
    pub matrix: Plan,
    /// What a sample of the equations' signals adds to the sum of every row, the signal times cos or sin of `harmonic * w t`;
    /// leaves are the signals, cos w t and sin w t.
    pub bank: Plan,
}

/// The plans of one pattern.
#[derive(Clone, Debug)]
pub struct PatternPlan {
    /// The pattern's name, when it has one.
    pub name: Option<String>,
    /// The amplitudes.
    pub amplitudes: Vec<Symbol>,
    /// The fundamental frequency.
    pub frequency: Symbol,
    /// Every coordinate of the evaluation with its derivatives 0, 1, ... up to its own order, one coordinate after the
    /// other; leaves are amplitudes, frequency, constants, cos w t and sin w t.
    pub reference: Result<Plan, PatternGap>,
    /// The harmonic table.
    pub table: Result<TablePlan, PatternGap>,
}

/// The plans of a model.
#[derive(Clone, Debug)]
pub struct EstimatorPlan {
    /// The virtual symbols.
    pub leaves: Leaves,
    /// Phi, known terms and input map.
    pub evaluation: Evaluation,
    /// Phi theta + known, one output per row.
    pub inverse_dynamics: Plan,
    /// The inputs, when every input stands in exactly one equation and alone there.
    pub feed_forward: Option<Plan>,
    /// The same in two parts that add up, the motion-independent one first ([`crate::plan::split`]); `None` where there is no
    /// feed-forward, or its terms cannot be shared out.
    pub feed_forward_parts: Option<[Plan; 2]>,
    /// The columns from the physical parameters; `None` when every column is one of them.
    pub lumping: Option<Plan>,
    /// The physical parameters from the columns, when `lumping` is some.
    pub unlumping: Option<Result<Unlumping, UnlumpGap>>,
    /// One per pattern of the model.
    pub patterns: Vec<PatternPlan>,
}

impl EstimatorPlan {
    /// The plans of `form`, which belongs to `model`.
    #[must_use]
    pub fn new(model: &Model, form: &RegressorForm) -> Self {
        let table = |pattern| expand(model, form, pattern).map_err(PatternGap::from);
        Self::with_tables(model, form, model.patterns.iter().map(table))
    }

    /// The same with tables that were made elsewhere, one per pattern of the model: of declared Taylor polynomials, or with
    /// a declared number of harmonics. Their symbols and columns are the model's and the form's.
    #[must_use]
    pub fn with_tables(
        model: &Model,
        form: &RegressorForm,
        tables: impl IntoIterator<Item = Result<HarmonicTable, PatternGap>>,
    ) -> Self {
        let leaves = Leaves::new(model, form);
        let evaluation = Evaluation::new(model, form);
        let mut merger = Merger::default();
        let forces = inverse_dynamics(&mut merger, leaves, &evaluation, form);
        let inverse_dynamics = merger.clone().finish(forces.clone());
        Self {
            feed_forward: feed_forward(merger, &forces, &evaluation, form),
            feed_forward_parts: feed_forward_parts(model, leaves, form),
            inverse_dynamics,
            lumping: lumping(model, form),
            unlumping: unlumping(model, leaves, form),
            patterns: model
                .patterns
                .iter()
                .zip(tables)
                .map(|(pattern, table)| pattern_plan(model, leaves, &evaluation, pattern, table))
                .collect(),
            leaves,
            evaluation,
        }
    }
}

/// Row forces as products of the regressor's own results, so that a program that needs both computes each once.
fn inverse_dynamics(merger: &mut Merger, leaves: Leaves, evaluation: &Evaluation, form: &RegressorForm) -> Vec<Slot> {
    let phi = merger.append(&evaluation.regressor);
    let known = merger.append(&evaluation.known);
    let columns = form.columns.len();
    let row = |(r, &known): (usize, &Slot)| {
        let mut total = if merger.is_number(known, Zero::is_zero) { None } else { Some(known) };
        for c in 0..columns {
            let entry = phi[r * columns + c];
            if merger.is_number(entry, Zero::is_zero) {
                continue;
            }
            let theta = merger.load(&Node::Symbol(leaves.column(c)));
            // Subtracted where something stands before it; a first term takes the entry as it is, which the regressor has.
            let (factor, negative) = match *merger.op(entry) {
                Op::Neg(positive) if total.is_some() || merger.is_number(positive, One::is_one) => (positive, true),
                _ => (entry, false),
            };
            let product =
                if merger.is_number(factor, One::is_one) { theta } else { merger.emit(Op::Mul(factor, theta)) };
            total = Some(match (total, negative) {
                (None, false) => product,
                (None, true) => merger.emit(Op::Neg(product)),
                (Some(sum), false) => merger.emit(Op::Add(sum, product)),
                (Some(sum), true) => merger.emit(Op::Sub(sum, product)),
            });
        }
        total.unwrap_or(known)
    };
    known.iter().enumerate().map(row).collect()
}

/// The inputs from the row forces, when B has one entry in every row and column that matters.
fn feed_forward(mut merger: Merger, forces: &[Slot], evaluation: &Evaluation, form: &RegressorForm) -> Option<Plan> {
    let factors = merger.append(&evaluation.input_map);
    let inputs = evaluation.inputs.len();
    let mut outputs = Vec::with_capacity(inputs);
    for (i, input) in evaluation.inputs.iter().enumerate() {
        let mut rows = form.rows.iter().enumerate().filter(|(_, row)| row.inputs.iter().any(|(s, _)| s == input));
        let ((r, row), None) = (rows.next()?, rows.next()) else { return None };
        if row.inputs.len() != 1 {
            return None;
        }
        let factor = factors[r * inputs + i];
        outputs.push(if merger.is_number(factor, One::is_one) {
            forces[r]
        } else {
            merger.emit(Op::Div(forces[r], factor))
        });
    }
    Some(merger.finish(outputs))
}

/// The feed-forward of each part of the rows.
fn feed_forward_parts(model: &Model, leaves: Leaves, form: &RegressorForm) -> Option<[Plan; 2]> {
    let [resting, moving] = split_form(model, form)?;
    let plan = |part: &RegressorForm| {
        let evaluation = Evaluation::new(model, part);
        let mut merger = Merger::default();
        let forces = inverse_dynamics(&mut merger, leaves, &evaluation, part);
        feed_forward(merger, &forces, &evaluation, part)
    };
    Some([plan(&resting)?, plan(&moving)?])
}

fn lumping(model: &Model, form: &RegressorForm) -> Option<Plan> {
    if form.columns.iter().all(|column| column.parameter.is_some()) {
        return None;
    }
    let mut graph = model.graph.clone();
    let roots: Vec<ExprId> = form
        .columns
        .iter()
        .map(|column| {
            let expr = graph.from_polynomial(&column.definition);
            crate::plan::evaluation::substitute_values(model, &mut graph, expr)
        })
        .collect();
    Some(Plan::new(&graph, &roots))
}

fn unlumping(model: &Model, leaves: Leaves, form: &RegressorForm) -> Option<Result<Unlumping, UnlumpGap>> {
    if form.columns.iter().all(|column| column.parameter.is_some()) {
        return None;
    }
    let map = ParameterMap::of(model, form);
    let inverse = map.inverse();
    let value = |parameter: Symbol| inverse.solved.iter().find(|(solved, _)| *solved == parameter).map(|(_, v)| v);
    let parameters: Vec<Symbol> = model.parameters().collect();
    let names = |chosen: &dyn Fn(Symbol) -> bool| -> Vec<String> {
        let chosen = parameters.iter().filter(|parameter| chosen(**parameter));
        chosen.map(|parameter| model.quantity(*parameter).name.to_string()).collect()
    };
    let missing = names(&|parameter| value(parameter).is_none());
    if !missing.is_empty() {
        let determined = map.local_identifiability().map(|local| local.determined).unwrap_or_default();
        let is_open = |parameter: Symbol| match map.parameters().iter().position(|own| *own == parameter) {
            Some(position) => determined.get(position) == Some(&false),
            None => true,
        };
        let open = names(&is_open);
        return Some(Err(match open.is_empty() {
            true => UnlumpGap::NoClosedForm(missing),
            false => UnlumpGap::NotDetermined(open),
        }));
    }
    // An intermediate is made of those before it.
    let mut needed = vec![false; inverse.intermediates.len()];
    let mark = |needed: &mut Vec<bool>, value: &Fraction<Variable>| {
        let factors = value.denominator().map(|(factor, _)| factor);
        for variable in std::iter::once(value.numerator())
            .chain(factors)
            .flat_map(Polynomial::terms)
            .flat_map(|(monomial, _)| monomial.factors().map(|(&variable, _)| variable).collect::<Vec<Variable>>())
        {
            if let Some(place) = variable.checked_sub(inverse.given()) {
                needed[place] = true;
            }
        }
    };
    inverse.solved.iter().for_each(|(_, value)| mark(&mut needed, value));
    for index in (0..inverse.intermediates.len()).rev() {
        if needed[index] {
            mark(&mut needed, &inverse.intermediates[index].value);
        }
    }
    let intermediates: Vec<usize> = (0..needed.len()).filter(|&index| needed[index]).collect();
    // An intermediate is a symbol of its own, so that what follows from it is computed from it, as the formulas say.
    let own =
        |index: usize| Symbol(leaves.sin().0 + 1 + u32::try_from(index).expect("invariant: intermediates are few"));
    let given = (0..form.columns.len()).map(|index| leaves.column(index)).chain(inverse.constants.iter().copied());
    let variables: Vec<Symbol> = given.chain((0..inverse.intermediates.len()).map(own)).collect();
    let values = intermediates.iter().map(|&index| &inverse.intermediates[index].value);
    let solved = parameters.iter().map(|&parameter| value(parameter).expect("invariant: no parameter is missing"));
    let mut graph = Graph::new();
    let roots: Vec<ExprId> = values.chain(solved).map(|value| fraction_expr(&mut graph, value, &variables)).collect();
    let open = Plan::new(&graph, &roots);
    let mut merger = Merger::default();
    let mut slots: Vec<Slot> = Vec::with_capacity(open.ops.len());
    for op in &open.ops {
        let at = |slot: Slot| slots[slot.index()];
        let slot = match op {
            Op::Load(input) => {
                let leaf = &open.inputs[*input as usize];
                // Its own value stands before every use.
                match intermediates.iter().position(|&index| *leaf == Node::Symbol(own(index))) {
                    Some(output) => at(open.outputs[output]),
                    None => merger.load(leaf),
                }
            }
            op => merger.emit(op.map(at)),
        };
        slots.push(slot);
    }
    let plan = merger.finish(open.outputs.iter().map(|slot| slots[slot.index()]).collect());
    Some(Ok(Unlumping { map, inverse, intermediates, plan }))
}

fn fraction_expr(graph: &mut Graph, value: &Fraction<Variable>, variables: &[Symbol]) -> ExprId {
    let power = |graph: &mut Graph, (&variable, exponent): (&Variable, i32)| {
        let base = graph.symbol(variables[variable]);
        graph.pow(base, exponent)
    };
    let sum = |graph: &mut Graph, polynomial: &Polynomial<Variable>| {
        let mut terms = Vec::with_capacity(polynomial.len());
        for (monomial, coefficient) in polynomial.terms() {
            let factors: Vec<ExprId> = monomial.factors().map(|factor| power(graph, factor)).collect();
            let product = graph.product(&factors);
            terms.push(graph.scale(product, coefficient.clone()));
        }
        graph.sum(&terms)
    };
    let (numerator, below) = value.cleared();
    let mut factors = vec![sum(graph, &numerator)];
    factors.extend(below.factors().map(|(variable, exponent)| power(graph, (variable, -exponent))));
    for (factor, exponent) in value.denominator() {
        let base = sum(graph, factor);
        factors.push(graph.pow(base, -i32::try_from(exponent).expect("invariant: exponents are small")));
    }
    graph.product(&factors)
}

fn pattern_plan(
    model: &Model,
    leaves: Leaves,
    evaluation: &Evaluation,
    pattern: &Pattern,
    table: Result<HarmonicTable, PatternGap>,
) -> PatternPlan {
    PatternPlan {
        name: pattern.name.clone(),
        amplitudes: pattern.amplitudes.clone(),
        frequency: pattern.frequency,
        reference: reference(model, leaves, evaluation, pattern),
        table: table.map(|table| table_plan(model, leaves, table)),
    }
}

/// cos k theta and sin k theta by halving and angle addition. Every step adds a few roundings whatever the angle is, whereas
/// the three-term recurrence loses digits as k^2 near the rest points, where a reference must be smooth.
struct Phasors<'g> {
    graph: &'g mut Graph,
    known: HashMap<usize, (ExprId, ExprId)>,
}

impl<'g> Phasors<'g> {
    fn new(graph: &'g mut Graph, leaves: Leaves) -> Self {
        let (one, zero) = (graph.integer(1), graph.integer(0));
        let first = (graph.symbol(leaves.cos()), graph.symbol(leaves.sin()));
        Self { graph, known: HashMap::from([(0, (one, zero)), (1, first)]) }
    }

    fn at(&mut self, harmonic: usize) -> (ExprId, ExprId) {
        if let Some(&pair) = self.known.get(&harmonic) {
            return pair;
        }
        let (ca, sa) = self.at(harmonic / 2);
        let (cb, sb) = self.at(harmonic - harmonic / 2);
        let graph = &mut *self.graph;
        let (cc, ss, sc, cs) = (graph.mul(ca, cb), graph.mul(sa, sb), graph.mul(sa, cb), graph.mul(ca, sb));
        let pair = (graph.sub(cc, ss), graph.add(sc, cs));
        self.known.insert(harmonic, pair);
        pair
    }

    fn of(&mut self, harmonic: usize, function: Trig) -> ExprId {
        let (cos, sin) = self.at(harmonic);
        match function {
            Trig::Cos => cos,
            Trig::Sin => sin,
        }
    }

    fn series(&mut self, fourier: &Fourier) -> ExprId {
        let terms: Vec<ExprId> = fourier
            .terms()
            .map(|(harmonic, function, coefficient)| {
                let base = self.of(harmonic, function);
                self.graph.scale(base, coefficient.clone())
            })
            .collect();
        self.graph.sum(&terms)
    }
}

fn reference(model: &Model, leaves: Leaves, evaluation: &Evaluation, pattern: &Pattern) -> Result<Plan, PatternGap> {
    let mut graph = Graph::new();
    let w = graph.symbol(pattern.frequency);
    let mut roots = Vec::new();
    for &(coordinate, order) in &evaluation.coordinates {
        let index = coordinate.0 as usize;
        let motion = pattern.motions.get(index).and_then(Option::as_ref);
        let motion = motion.ok_or_else(|| PatternGap::NoMotion(model.coordinates[index].name.clone()))?;
        for n in 0..=order {
            let value = motion_expr(model, &mut graph, leaves, &motion.derivative(n));
            let power = graph.pow(w, i32::try_from(n).expect("invariant: derivative orders are small"));
            roots.push(graph.mul(power, value));
        }
    }
    Ok(Plan::new(&graph, &roots))
}

/// A symbol, or its value when the model states one.
fn symbol_expr(model: &Model, graph: &mut Graph, symbol: Symbol) -> ExprId {
    match &model.quantity(symbol).kind {
        Kind::Constant { value: Some(value) } => graph.number(value.clone()),
        _ => graph.symbol(symbol),
    }
}

fn motion_expr(model: &Model, graph: &mut Graph, leaves: Leaves, motion: &Motion) -> ExprId {
    let mut terms = Vec::with_capacity(motion.terms().len());
    for (monomial, fourier) in motion.terms() {
        let mut factors = vec![Phasors::new(graph, leaves).series(fourier)];
        for (&symbol, exponent) in monomial.factors() {
            let symbol = symbol_expr(model, graph, symbol);
            factors.push(graph.pow(symbol, exponent));
        }
        terms.push(graph.product(&factors));
    }
    graph.sum(&terms)
}

fn table_plan(model: &Model, leaves: Leaves, table: HarmonicTable) -> TablePlan {
    let rows = table.rows();
    let mut graph = Graph::new();
    let mut places: Vec<(usize, Option<usize>)> = Vec::new();
    let mut sums: Vec<Vec<ExprId>> = Vec::new();
    let mut row = 0;
    for entry in table.entries() {
        // Rows and entries are sorted alike, so one walk finds every entry's row.
        while rows[row] != (entry.equation, entry.harmonic, entry.function) {
            row += 1;
        }
        let place = (row, entry.column);
        if places.last() != Some(&place) {
            places.push(place);
            sums.push(Vec::new());
        }
        let value = entry_expr(model, &mut graph, &entry);
        if let Some(terms) = sums.last_mut() {
            terms.push(value);
        }
    }
    let roots: Vec<ExprId> = sums.iter().map(|terms| graph.sum(terms)).collect();
    let matrix = Plan::new(&graph, &roots);
    let bank = bank(leaves, &rows);
    TablePlan { table, rows, places, matrix, bank }
}

/// Every row's signal times cos or sin of its harmonic. Each equation's signal is multiplied either into every harmonic, or into
/// the first ones, from which the others then follow, whichever is less work.
fn bank(leaves: Leaves, rows: &[TableRow]) -> Plan {
    let mut carried = BTreeSet::new();
    let mut best = Bank::plan(leaves, rows, &carried);
    for &(equation, ..) in rows {
        if carried.insert(equation) {
            let plan = Bank::plan(leaves, rows, &carried);
            if plan.ops.len() < best.ops.len() {
                best = plan;
            } else {
                carried.remove(&equation);
            }
        }
    }
    best
}

/// Harmonics that follow from the fundamental; those behind them from these.
const FIRST: usize = 4;

/// Phasors of harmonics, alone or times a signal, operation by operation: harmonics in a row are made alike from those before
/// them, and compilers put them into vectors unless the algebra has made each of them shorter in its own way.
struct Bank {
    merger: Merger,
    leaves: Leaves,
    known: BTreeMap<(Option<usize>, usize), (Slot, Slot)>,
}

impl Bank {
    fn plan(leaves: Leaves, rows: &[TableRow], carried: &BTreeSet<usize>) -> Plan {
        let mut bank = Self { merger: Merger::default(), leaves, known: BTreeMap::new() };
        let add = |&(equation, harmonic, function): &TableRow| {
            // A mean is the signal itself.
            let through = (harmonic == 0 || carried.contains(&equation)).then_some(equation);
            let (cos, sin) = bank.at(through, harmonic);
            let base = if function == Trig::Cos { cos } else { sin };
            if through.is_some() {
                return base;
            }
            let signal = bank.signal(equation);
            bank.merger.emit(Op::Mul(signal, base))
        };
        let outputs = rows.iter().map(add).collect();
        bank.merger.finish(outputs)
    }

    fn signal(&mut self, equation: usize) -> Slot {
        self.merger.load(&Node::Symbol(self.leaves.signal(equation)))
    }

    /// The order of the operands does not matter: a product is one operation either way.
    fn mul(&mut self, a: Slot, b: Slot) -> Slot {
        self.merger.emit(Op::Mul(a.min(b), a.max(b)))
    }

    /// cos and sin of k w t, times an equation's signal if one is given.
    fn at(&mut self, signal: Option<usize>, harmonic: usize) -> (Slot, Slot) {
        if let Some(&pair) = self.known.get(&(signal, harmonic)) {
            return pair;
        }
        let known = |k: usize| self.known.get(&(signal, k)).copied();
        let pair = match (signal, harmonic) {
            (None, 1) => {
                [self.leaves.cos(), self.leaves.sin()].map(|leaf| self.merger.load(&Node::Symbol(leaf))).into()
            }
            (Some(equation), 0) => {
                let zero = self.merger.emit(Op::Constant(rational::integer(0)));
                (self.signal(equation), zero)
            }
            (Some(equation), 1..=FIRST) => {
                let (signal, (cos, sin)) = (self.signal(equation), self.at(None, harmonic));
                (self.merger.emit(Op::Mul(signal, cos)), self.merger.emit(Op::Mul(signal, sin)))
            }
            _ => match (harmonic.checked_sub(FIRST).and_then(known), harmonic.checked_sub(2 * FIRST).and_then(known)) {
                // The three-term recurrence doubles the rounding errors over two steps, and grows them as k^2 over many: two it is.
                (Some(near), Some(far)) if (2 * FIRST + 1..=4 * FIRST).contains(&harmonic) => {
                    let (cos, _) = self.at(None, FIRST);
                    let twice = self.merger.emit(Op::Add(cos, cos));
                    let [cos, sin] = [(near.0, far.0), (near.1, far.1)].map(|(near, far)| {
                        let turned = self.mul(twice, near);
                        self.merger.emit(Op::Sub(turned, far))
                    });
                    (cos, sin)
                }
                _ => self.sum(signal, harmonic),
            },
        };
        self.known.insert((signal, harmonic), pair);
        pair
    }

    /// The same by angle addition: from a power of two and the rest where both are known, else by halves.
    fn sum(&mut self, signal: Option<usize>, harmonic: usize) -> (Slot, Slot) {
        let power = 1 << (harmonic - 1).ilog2();
        let both = self.known.contains_key(&(None, power)) && self.known.contains_key(&(signal, harmonic - power));
        let part = if both { harmonic - power } else { harmonic / 2 };
        let ((ca, sa), (cb, sb)) = (self.at(signal, part), self.at(None, harmonic - part));
        let [cc, ss, sc, cs] = [(ca, cb), (sa, sb), (sa, cb), (ca, sb)].map(|(a, b)| self.mul(a, b));
        (self.merger.emit(Op::Sub(cc, ss)), self.merger.emit(Op::Add(sc, cs)))
    }
}

fn entry_expr(model: &Model, graph: &mut Graph, entry: &Entry) -> ExprId {
    let mut factors = vec![graph.number(entry.coefficient.clone())];
    if entry.pi != 0 {
        let pi = graph.pi();
        factors.push(graph.pow(pi, entry.pi));
    }
    for (&symbol, exponent) in entry.powers.factors() {
        let symbol = symbol_expr(model, graph, table_symbol(symbol));
        factors.push(graph.pow(symbol, exponent));
    }
    for (&symbol, exponent) in entry.sign.factors() {
        if exponent % 2 != 0 {
            let symbol = symbol_expr(model, graph, table_symbol(symbol));
            factors.push(graph.function(Function::Sign, symbol));
        }
    }
    graph.product(&factors)
}

/// A table that came from [`expand`] lists the model's symbols in the model's order.
fn table_symbol(index: usize) -> Symbol {
    Symbol(u32::try_from(index).expect("invariant: fewer than 2^32 symbols"))
}

/// The exact formula of one table entry, such as `-55/27*lambda1*lambda2^2*w^2`.
#[must_use]
pub fn entry_formula(table: &HarmonicTable, entry: &Entry) -> String {
    let mut above = vec![rational::display(&entry.coefficient)];
    let mut below = Vec::new();
    let powers = entry.powers.factors().map(|(&symbol, exponent)| (table.symbols[symbol].as_str(), exponent));
    for (name, exponent) in std::iter::once(("pi", entry.pi)).chain(powers) {
        match exponent {
            0 => {}
            1 => above.push(name.to_owned()),
            -1 => below.push(name.to_owned()),
            2.. => above.push(format!("{name}^{exponent}")),
            _ => below.push(format!("{name}^{}", -exponent)),
        }
    }
    for (&symbol, exponent) in entry.sign.factors() {
        if exponent % 2 != 0 {
            above.push(format!("sign({})", table.symbols[symbol]));
        }
    }
    // A factor 1 is left out where something else stands.
    if above.len() > 1 && (above[0] == "1" || above[0] == "-1") {
        let minus = if above.remove(0) == "-1" { "-" } else { "" };
        above[0].insert_str(0, minus);
    }
    let mut text = above.join("*");
    for factor in below {
        text.push('/');
        text.push_str(&factor);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::{EstimatorPlan, Leaf, entry_formula};
    use crate::algebra::fourier::{Fourier, Trig};
    use crate::algebra::polynomial::Monomial;
    use crate::expr::graph::{ExprId, Node};
    use crate::mechanics::model::{Equation, Kind, Model, SourceTerm, TermId};
    use crate::mechanics::pattern::{Motion, Pattern, rest_to_rest};
    use crate::number::rational::{Rational, integer, ratio};
    use crate::regressor::form::regressor_form;

    /// m x'' - k x^2 - 3 g = G u with x on the pattern of order 5 about the constant x0.
    fn model() -> Model {
        let mut model = Model { name: "Test".to_owned(), ..Model::default() };
        let x = model.declare_coordinate("x", None);
        let mut quantity = |name: &str, kind: Kind| model.declare(name, None, kind);
        let constant = || Kind::Constant { value: None };
        let symbols = [
            quantity("u", Kind::Input),
            quantity("m", Kind::Parameter),
            quantity("k", Kind::Parameter),
            quantity("g", constant()),
            quantity("G", constant()),
        ];
        let [x0, lambda, w] =
            [("x0", constant()), ("lambda", Kind::Amplitude), ("w", Kind::Frequency)].map(|(n, k)| quantity(n, k));
        let graph = &mut model.graph;
        let [u, m, k, g, big] = symbols.map(|symbol| graph.symbol(symbol));
        let (position, acceleration) = (graph.derivative_of(x, 0), graph.derivative_of(x, 2));
        let (square, minus_three, minus_one) = (graph.pow(position, 2), graph.integer(-3), graph.integer(-1));
        let terms: Vec<ExprId> = vec![
            graph.mul(m, acceleration),
            graph.product(&[minus_one, k, square]),
            graph.mul(minus_three, g),
            graph.product(&[minus_one, big, u]),
        ];
        let terms = (0..).zip(terms).map(|(id, expr)| SourceTerm { id: TermId(id), expr }).collect();
        model.equations.push(Equation { name: "u".to_owned(), terms });
        let motion = Motion::term(Monomial::power_of(x0, 1), Fourier::constant(integer(1)))
            .add(&Motion::term(Monomial::power_of(lambda, 1), rest_to_rest(5).expect("odd order")));
        let pattern = Pattern { name: None, amplitudes: vec![lambda], frequency: w, motions: vec![Some(motion)] };
        model.patterns.push(pattern);
        model
    }

    fn value(model: &Model, name: &str) -> Rational {
        let position = model.symbols.iter().position(|quantity| quantity.name == name).expect("declared");
        ratio(i64::try_from(position).expect("small") + 2, 7)
    }

    /// Leaves at fixed rational values; the phase is the one with tan(theta/2) = 1/2.
    fn leaf(model: &Model, plan: &EstimatorPlan, node: &Node) -> Option<Rational> {
        Some(match plan.leaves.leaf(node) {
            Leaf::Motion(_, order) => ratio(i64::from(order) + 3, 5),
            Leaf::Symbol(symbol) => value(model, &model.quantity(symbol).name),
            Leaf::Column(index) => ratio(i64::try_from(index).expect("small") + 1, 11),
            Leaf::Cos => ratio(3, 5),
            Leaf::Sin => ratio(4, 5),
            Leaf::Signal(_) => integer(7),
        })
    }

    #[test]
    fn feed_forward_is_the_row_divided_by_the_input_factor() {
        let model = model();
        let plan = EstimatorPlan::new(&model, &regressor_form(&model).expect("linear"));
        let (m, k) = (ratio(1, 11), ratio(2, 11));
        let (x, a) = (ratio(3, 5), ratio(5, 5));
        // G multiplies the input, so that it divides the feed-forward but not the table.
        let (g, big) = (value(&model, "g"), value(&model, "G"));
        let row = m * a - k * &x * &x - integer(3) * g;
        let outputs = plan.feed_forward.as_ref().and_then(|p| p.evaluate_exact(|node| leaf(&model, &plan, node)));
        assert_eq!(outputs, Some(vec![row / big]));
    }

    #[test]
    fn reference_and_bank_are_exact_at_a_rational_phase() {
        let model = model();
        let plan = EstimatorPlan::new(&model, &regressor_form(&model).expect("linear"));
        let pattern = &plan.patterns[0];
        // (3/5 + 4/5 j)^k by repeated multiplication.
        let mut powers = vec![(integer(1), integer(0))];
        for k in 0..12 {
            let (c, s) = powers[k].clone();
            powers.push((&c * ratio(3, 5) - &s * ratio(4, 5), &s * ratio(3, 5) + &c * ratio(4, 5)));
        }
        let (x0, lambda, w) = (value(&model, "x0"), value(&model, "lambda"), value(&model, "w"));
        let c = |k: usize| powers[k].0.clone();
        let shape = c(1) - ratio(1, 6) * c(3) + ratio(1, 50) * c(5);
        let second = -c(1) + ratio(9, 6) * c(3) - ratio(25, 50) * c(5);
        let s = |k: usize| powers[k].1.clone();
        let first = -s(1) + ratio(3, 6) * s(3) - ratio(5, 50) * s(5);
        let expected = vec![&x0 + &lambda * shape, &lambda * &w * first, &lambda * &w * &w * second];
        let reference = pattern.reference.as_ref().expect("every coordinate moves");
        assert_eq!(reference.evaluate_exact(|node| leaf(&model, &plan, node)), Some(expected));
        let table = pattern.table.as_ref().expect("finite");
        let bank = table.bank.evaluate_exact(|node| leaf(&model, &plan, node)).expect("rational");
        assert_eq!(bank.len(), table.rows.len());
        for (found, &(_, harmonic, function)) in bank.iter().zip(&table.rows) {
            let (cos, sin) = &powers[harmonic];
            assert_eq!(*found, integer(7) * if function == Trig::Cos { cos } else { sin });
        }
    }

    #[test]
    fn the_matrix_holds_every_entry_of_the_table_once() {
        let model = model();
        let plan = EstimatorPlan::new(&model, &regressor_form(&model).expect("linear"));
        let table = plan.patterns[0].table.as_ref().expect("finite");
        let values = table.matrix.evaluate_exact(|node| leaf(&model, &plan, node)).expect("rational");
        for (&(row, column), found) in table.places.iter().zip(&values) {
            let (equation, harmonic, function) = table.rows[row];
            let expected: Rational = table
                .table
                .at(equation, harmonic, function, column)
                .map(|entry| {
                    let powers = entry.powers.factors().map(|(&symbol, exponent)| {
                        crate::number::rational::power(&value(&model, &table.table.symbols[symbol]), exponent)
                    });
                    powers.product::<Rational>() * &entry.coefficient
                })
                .sum();
            assert_eq!(*found, expected);
        }
        assert!(table.places.iter().any(|(_, column)| column.is_none()), "the known term is in the table");
        let formulas: Vec<String> = table.table.entries().map(|entry| entry_formula(&table.table, &entry)).collect();
        assert!(formulas.contains(&"-lambda*w^2".to_owned()), "{formulas:?}");
    }

    #[test]
    fn a_power_of_a_difference_stays_one() {
        // k (x - x0)^2 x'' - 2 c (x - x0)^3 = u
        let mut model = Model { name: "Test".to_owned(), ..Model::default() };
        let x = model.declare_coordinate("x", None);
        let u = model.declare("u", None, Kind::Input);
        let k = model.declare("k", None, Kind::Parameter);
        let [x0, c] = ["x0", "c"].map(|name| model.declare(name, None, Kind::Constant { value: None }));
        let graph = &mut model.graph;
        let [u, k, x0, c] = [u, k, x0, c].map(|symbol| graph.symbol(symbol));
        let (position, acceleration) = (graph.derivative_of(x, 0), graph.derivative_of(x, 2));
        let distance = graph.sub(position, x0);
        let (square, cube, minus_two) = (graph.pow(distance, 2), graph.pow(distance, 3), graph.integer(-2));
        let terms = [graph.product(&[k, square, acceleration]), graph.product(&[minus_two, c, cube]), graph.neg(u)];
        let terms = (0..).zip(terms).map(|(id, expr)| SourceTerm { id: TermId(id), expr }).collect();
        model.equations.push(Equation { name: "u".to_owned(), terms });
        let form = regressor_form(&model).expect("linear");
        assert_eq!(form.rows[0].terms.len(), 7, "the form itself is multiplied out");
        let plan = EstimatorPlan::new(&model, &form);
        let counts = [&plan.evaluation.regressor, &plan.evaluation.known].map(|plan| {
            let counts = plan.counts();
            (counts.additions, counts.multiplications)
        });
        // x - x0, its square, times x''; x - x0, its cube, times c, times 2, negated.
        assert_eq!(counts, [(1, 2), (2, 4)]);
        let leaf = |node: &Node| leaf(&model, &plan, node);
        let (distance, acceleration) = (ratio(3, 5) - value(&model, "x0"), ratio(1, 1));
        let square = &distance * &distance;
        assert_eq!(plan.evaluation.regressor.evaluate_exact(leaf), Some(vec![&square * acceleration]));
        let known = -integer(2) * value(&model, "c") * square * distance;
        assert_eq!(plan.evaluation.known.evaluate_exact(leaf), Some(vec![known]));
    }
}
