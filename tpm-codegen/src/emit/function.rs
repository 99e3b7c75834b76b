//! Steps, arguments and documentation of the functions of an estimator, independent of a language.
//!
//! Invariant: the emitters of all languages print these descriptions; none of them decides which steps a function takes.

use num_traits::Zero;
use std::collections::BTreeSet;
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::harmonic::table::Entry;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::lumping::Unlumping;
use tpm_symbolic::plan::operation::Op;
use tpm_symbolic::plan::pattern::{PatternPlan, PseudoInverse};
use tpm_symbolic::plan::straight_line::{Merger, Plan};
use tpm_symbolic::plan::table::{TablePlan, entry_formula, table_symbol};
use tpm_symbolic::regressor::form::canonical;

use super::code::{Base, Expression, Place, Reader, Statement, Table, Term};
use super::estimator::EstimatorSource;
use super::names::{harmonic_function, harmonic_name};
use super::number::Rounded;
use super::text;

/// Documentation of the function that reduces the weight of an accumulator's earlier samples.
pub(super) const FADE: &str = "Lets all samples so far count `share` times, from 0 to 1, and counts further ones anew. Called after every whole period, it makes earlier periods fade away by this share each, so that the harmonics follow a machine that changes.";

/// Largest number of entries of an estimator matrix that is written as straight-line code; a larger matrix is a table
/// and a loop.
pub(super) const STRAIGHT_LINE_ENTRIES: usize = 400;

/// A function that is generated from the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Regressor,
    Known,
    InputMap,
    InverseDynamics,
    FeedForward,
    FeedForwardIndependent,
    FeedForwardDependent,
    Gravity,
    MassMatrix,
    /// The mass matrix and the remaining forces, before the accelerations are solved for.
    ForwardDynamics,
    BaseRegressor,
    Lump,
    Unlump,
    /// The reference motion of a pattern.
    Reference(usize),
    /// The estimator matrix of a pattern.
    EstimatorMatrix(usize),
    /// The addition of one sample to the sums of a pattern's harmonics.
    Accumulate(usize),
}

/// The arguments that a function reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Reads {
    pub(super) motion: bool,
    pub(super) constants: bool,
    pub(super) parameters: bool,
    /// cos w t
    pub(super) cos: bool,
    /// sin w t
    pub(super) sin: bool,
    /// Fields of the structure to which the function belongs: amplitudes and frequency, or physical parameters.
    pub(super) own: bool,
}

impl Reads {
    pub(super) fn of(estimator: &EstimatorSource, plan: &Plan) -> Self {
        let mut reads = Self::default();
        for leaf in &plan.inputs {
            match *leaf {
                Leaf::Motion(..) => reads.motion = true,
                Leaf::Column(_) => reads.parameters = true,
                Leaf::Cos => reads.cos = true,
                Leaf::Sin => reads.sin = true,
                Leaf::Symbol(symbol) => reads.symbol(estimator, symbol),
                // Samples and harmonics are always arguments of the functions that use them.
                _ => {}
            }
        }
        reads
    }

    fn of_table(estimator: &EstimatorSource, table: &Table) -> Self {
        let mut reads = Self::default();
        for base in &table.bases {
            match base {
                Base::Symbol(symbol) | Base::Sign(symbol) => reads.symbol(estimator, *symbol),
                Base::Pi => {}
            }
        }
        reads
    }

    fn symbol(&mut self, estimator: &EstimatorSource, symbol: Symbol) {
        match estimator.plan.evaluation.constants.contains(&symbol) {
            true => self.constants = true,
            false => self.own = true,
        }
    }
}

/// The steps of a function.
#[derive(Clone, Debug)]
pub(super) enum Body {
    /// Intermediate results, then every scalar of the result in order.
    Values(Vec<Statement>, Vec<Expression>),
    /// Stores under their formulas; entries without a store are zero.
    Stores(Vec<Statement>),
    /// A table and a loop; entries that the table lacks are zero.
    Table(Table),
}

/// A function.
#[derive(Clone, Debug)]
pub(super) struct Function {
    pub(super) about: String,
    pub(super) reads: Reads,
    pub(super) body: Body,
}

impl Function {
    pub(super) fn values(estimator: &EstimatorSource, plan: &Plan, about: String) -> Self {
        let (statements, values) = Reader::new(plan).outputs();
        Self { about, reads: Reads::of(estimator, plan), body: Body::Values(statements, values) }
    }
}

/// Roles of the functions with their plans, in the order of a module.
pub(super) fn plans(estimator: &EstimatorSource) -> Vec<(Role, &Plan)> {
    let plan = &estimator.plan;
    let mut list = vec![
        (Role::Regressor, &plan.evaluation.regressor),
        (Role::Known, &plan.evaluation.known),
        (Role::InputMap, &plan.evaluation.input_map),
        (Role::InverseDynamics, &plan.inverse_dynamics),
    ];
    list.extend(plan.feed_forward.iter().map(|plan| (Role::FeedForward, plan)));
    if let Some([independent, dependent]) = &plan.feed_forward_parts {
        list.push((Role::FeedForwardIndependent, independent));
        list.push((Role::FeedForwardDependent, dependent));
    }
    let parts = &estimator.parts;
    list.extend(parts.gravity.iter().map(|plan| (Role::Gravity, plan)));
    list.extend(parts.mass_matrix.iter().map(|plan| (Role::MassMatrix, plan)));
    list.extend(parts.forward_dynamics.iter().map(|dynamics| (Role::ForwardDynamics, &dynamics.plan)));
    list.extend(parts.base.iter().map(|base| (Role::BaseRegressor, &base.regressor)));
    list.extend(plan.lumping.iter().map(|plan| (Role::Lump, plan)));
    list.extend(plan.unlumping.iter().flatten().map(|unlumping| (Role::Unlump, &unlumping.plan)));
    for (index, pattern) in plan.patterns.iter().enumerate() {
        list.extend(pattern.reference.iter().map(|plan| (Role::Reference(index), plan)));
        if let Ok(table) = &pattern.table {
            list.push((Role::EstimatorMatrix(index), &table.matrix));
            list.push((Role::Accumulate(index), &table.bank));
        }
    }
    list
}

/// Phi, rows times columns.
pub(super) fn regressor(estimator: &EstimatorSource) -> Function {
    let plan = &estimator.plan.evaluation.regressor;
    let mut about = String::from(
        "The regressor Phi, one row per equation and one column per parameter: Phi theta + known = B u.\n",
    );
    // Entries that were not multiplied out have their formulas as comments, so the documentation does not repeat them.
    let listed = estimator.form.is_expanded(&estimator.model.graph);
    for (r, row) in estimator.form.rows.iter().enumerate().filter(|_| listed) {
        about.push_str(&format!("\nEquation `{}`:\n\n```text\n", row.name));
        for (c, column) in estimator.form.columns.iter().enumerate() {
            if row.terms.iter().any(|term| term.column == Some(c)) {
                about.push_str(&format!("{}: {}\n", column.name, text::entry(estimator, r, Some(c))));
            }
        }
        about.push_str("```\n");
    }
    about.push_str(text::told(estimator, "regressor", plan).trim_start_matches('\n'));
    let statements = entries(plan, estimator.form.columns.len(), |row, column| {
        let name = &estimator.form.columns[column].name;
        format!("{}, {name}: {}", estimator.form.rows[row].name, text::entry(estimator, row, Some(column)))
    });
    Function { about, reads: Reads::of(estimator, plan), body: Body::Stores(statements) }
}

/// The steps of a matrix that is not zero everywhere: every entry under its formula.
pub(super) fn entries(plan: &Plan, columns: usize, formula: impl Fn(usize, usize) -> String) -> Vec<Statement> {
    let mut reader = Reader::new(plan);
    let mut statements = Vec::new();
    for output in 0..plan.outputs.len() {
        let zero = matches!(&plan.ops[plan.outputs[output].index()], Op::Constant(value) if value.is_zero());
        let (needed, value) = reader.output(output);
        if zero {
            statements.extend(needed);
            continue;
        }
        let (row, column) = (output / columns, output % columns);
        statements.push(Statement::Comment(formula(row, column)));
        statements.extend(needed);
        statements.push(Statement::Store(Place::Entry(row, column), value));
    }
    statements
}

/// The terms without an unknown parameter.
pub(super) fn known(estimator: &EstimatorSource) -> Function {
    let plan = &estimator.plan.evaluation.known;
    let about = format!(
        "The terms without an unknown parameter, on the left-hand side.{}",
        text::told(estimator, "known", plan)
    );
    Function::values(estimator, plan, about)
}

/// B, rows times inputs.
pub(super) fn input_map(estimator: &EstimatorSource) -> Function {
    let plan = &estimator.plan.evaluation.input_map;
    let about = format!(
        "The input map B, one row per equation and one column per input.{}",
        text::told(estimator, "input_map", plan)
    );
    let statements = entries(plan, estimator.plan.evaluation.inputs.len(), |row, input| {
        let name = &estimator.model.quantity(estimator.plan.evaluation.inputs[input]).name;
        format!("{}, {name}: {}", estimator.form.rows[row].name, text::input_factor(estimator, row, input))
    });
    Function { about, reads: Reads::of(estimator, plan), body: Body::Stores(statements) }
}

/// Phi theta + known.
pub(super) fn inverse_dynamics(estimator: &EstimatorSource) -> Function {
    let plan = &estimator.plan.inverse_dynamics;
    let about = format!(
        "Phi theta + known: the generalised force of every equation that the motion needs.{}",
        text::told(estimator, "inverse_dynamics", plan)
    );
    Function::values(estimator, plan, about)
}

/// The inputs, where every input follows from one equation.
pub(super) fn feed_forward(estimator: &EstimatorSource) -> Option<Function> {
    let plan = estimator.plan.feed_forward.as_ref()?;
    let free = estimator.form.rows.iter().filter(|row| row.inputs.is_empty()).map(|row| format!("`{}`", row.name));
    let free: Vec<String> = free.collect();
    let free = match free.as_slice() {
        [] => String::new(),
        names => format!(" The motion must satisfy {} by itself.", names.join(", ")),
    };
    let about = format!(
        "Feed-forward: the inputs that the reference motion needs.{free}{}",
        text::told(estimator, "feed_forward", plan)
    );
    Some(Function::values(estimator, plan, about))
}

/// Inputs (as values) and regressor (as entries) together, each shared operation once, equation by equation. With all inputs at the end C
/// compilers pack those of several equations into vectors, which takes more shuffling than it saves (`DESIGN.md`, "Why straight-line
/// plans?").
pub(super) fn feed_forward_with_regressor(estimator: &EstimatorSource) -> Option<Function> {
    let (feed_forward, phi) = (estimator.plan.feed_forward.as_ref()?, &estimator.plan.evaluation.regressor);
    let inputs = &estimator.plan.evaluation.inputs;
    let columns = estimator.form.columns.len();
    let mut merger = Merger::default();
    let (entries, forces) = (merger.append(phi), merger.append(feed_forward));
    let mut places = Vec::new();
    for (r, row) in estimator.form.rows.iter().enumerate() {
        places.extend((0..columns).map(|column| (Place::Entry(r, column), entries[r * columns + column])));
        let own = |input: &usize| row.inputs.iter().any(|(symbol, _)| *symbol == inputs[*input]);
        places.extend((0..inputs.len()).filter(own).map(|input| (Place::Value(input), forces[input])));
    }
    let plan = merger.finish(places.iter().map(|(_, slot)| *slot).collect()).scheduled();
    let mut reader = Reader::new(&plan);
    let mut statements = Vec::new();
    for (output, &(place, _)) in places.iter().enumerate() {
        let zero = matches!(&plan.ops[plan.outputs[output].index()], Op::Constant(value) if value.is_zero());
        let (needed, value) = reader.output(output);
        let what = match place {
            Place::Value(input) => estimator.model.quantity(inputs[input]).name.to_string(),
            Place::Entry(..) if zero => {
                statements.extend(needed);
                continue;
            }
            Place::Entry(row, column) => {
                format!("{}, {}", estimator.form.rows[row].name, estimator.form.columns[column].name)
            }
        };
        statements.push(Statement::Comment(what));
        statements.extend(needed);
        statements.push(Statement::Store(place, value));
    }
    let about = format!(
        "[`feed_forward`] and [`regressor`] in one go: what they share is computed once.{}",
        text::told(estimator, "feed_forward_with_regressor", &plan)
    );
    Some(Function { about, reads: Reads::of(estimator, &plan), body: Body::Stores(statements) })
}

/// The motion-independent and the motion-dependent part of the feed-forward.
pub(super) fn feed_forward_parts(estimator: &EstimatorSource) -> Option<[Function; 2]> {
    let [independent, dependent] = estimator.plan.feed_forward_parts.as_ref()?;
    let part = |name: &str, plan: &Plan, about: &str| {
        Function::values(estimator, plan, format!("{about}{}", text::told(estimator, name, plan)))
    };
    Some([
        part(
            "feed_forward_independent",
            independent,
            "The motion-independent part of the feed-forward: of every input the reaction that holds its own coordinate\n\
             still while the others move. An actuator gives it as fast as its amplifier is, so that it needs no low pass.",
        ),
        part(
            "feed_forward_dependent",
            dependent,
            "The motion-dependent part of the feed-forward: what moves the coordinates that the inputs drive. With\n\
             [`feed_forward_independent`] it adds up to [`feed_forward`].",
        ),
    ])
}

/// The estimated parameters from the physical ones, when they differ.
pub(super) fn lump(estimator: &EstimatorSource) -> Option<Function> {
    let plan = estimator.plan.lumping.as_ref()?;
    let mut reader = Reader::new(plan);
    let mut statements = Vec::new();
    for (i, column) in estimator.form.columns.iter().enumerate() {
        let definition = canonical(&estimator.model, &column.definition);
        statements.push(Statement::Comment(format!("{} = {definition}", column.name)));
        let (needed, value) = reader.output(i);
        statements.extend(needed);
        statements.push(Statement::Store(Place::Value(i), value));
    }
    let about =
        format!("The estimated parameters that belong to these physical ones.{}", text::told(estimator, "lump", plan));
    Some(Function { about, reads: Reads::of(estimator, plan), body: Body::Stores(statements) })
}

/// The physical parameters from the estimated ones, where they follow by a rational function.
pub(super) fn unlump(estimator: &EstimatorSource) -> Option<Function> {
    let Unlumping { map, inverse, intermediates, plan } = estimator.plan.unlumping.as_ref()?.as_ref().ok()?;
    let mut reader = Reader::new(plan);
    let mut statements = Vec::new();
    for (output, &index) in intermediates.iter().enumerate() {
        let intermediate = &inverse.intermediates[index];
        let product = inverse.display_product(map, intermediate);
        let formula = format!("{product} = {}", inverse.display(map, &intermediate.value));
        statements.push(Statement::Comment(formula));
        // Intermediate results that later outputs use again are named in these statements.
        statements.extend(reader.output(output).0);
    }
    for (place, parameter) in estimator.model.parameters().enumerate() {
        let name = &estimator.model.quantity(parameter).name;
        let solved = inverse.solved.iter().find(|(solved, _)| *solved == parameter);
        let formula = solved.map_or_else(String::new, |(_, value)| inverse.display(map, value));
        if formula != **name {
            statements.push(Statement::Comment(format!("{name} = {formula}")));
        }
        let (needed, value) = reader.output(intermediates.len() + place);
        statements.extend(needed);
        statements.push(Statement::Store(Place::Value(place), value));
    }
    let mut about = "The physical parameters that belong to these estimated ones, in closed form.".to_owned();
    let relations = inverse.constraints.iter().map(|constraint| {
        let left = constraint.column.map_or("0", |column| map.columns()[column].as_str());
        format!("{left} = {}\n", inverse.display(map, &constraint.value))
    });
    let relations: String = relations.collect();
    if !relations.is_empty() {
        about.push_str(&format!(
            "\n\nA machine of this structure has more estimated parameters than physical ones, and they satisfy what follows. It\n\
             is not checked here, and what stands on the left of it is not used.\n\n```text\n{relations}```"
        ));
    }
    about.push_str(&text::told(estimator, "unlump", plan));
    Some(Function { about, reads: Reads::of(estimator, plan), body: Body::Stores(statements) })
}

/// The documentation of the reference motion at a phase.
pub(super) fn reference_at(estimator: &EstimatorSource, pattern: &PatternPlan) -> String {
    let w = &estimator.model.quantity(pattern.frequency).name;
    format!("The reference motion at a phase `{w}*t` in radians: one sine and one cosine.")
}

/// One stroke of a pattern.
pub(super) fn stroke(estimator: &EstimatorSource, pattern: &PatternPlan) -> String {
    let w = &estimator.model.quantity(pattern.frequency).name;
    format!(
        "The reference of one stroke: rest at the phase `from` until the time 0, the motion from there to the phase `to`, and rest \
         there afterwards. Phases are those of `{w}*t` in radians, and the pattern must be at rest at both; `from` is the lower one. \
         A sequence of strokes and rests is one call after the other, each with the time since its stroke began."
    )
}

/// The reference motion where cosine and sine of the phase are known.
pub(super) fn reference(estimator: &EstimatorSource, pattern: &PatternPlan, plan: &Plan) -> Function {
    let about = format!(
        "The reference motion where cosine and sine of the phase `{}*t` are known, with every derivative that the equations \
         read.{}",
        estimator.model.quantity(pattern.frequency).name,
        text::operations(plan)
    );
    Function::values(estimator, plan, about)
}

/// The estimator matrix B Lambda.
pub(super) fn estimator_matrix(estimator: &EstimatorSource, table: &TablePlan) -> Function {
    let entries = table.places.iter().filter(|(_, column)| column.is_some()).count();
    let about = "The estimator matrix B Lambda: the exact harmonic coefficients of every parameter's regressor.\n\n\
                 Rows are in the order of [`Harmonics`], columns in the order of [`Parameters`].";
    if entries > STRAIGHT_LINE_ENTRIES {
        let about = format!(
            "{about}\n\nIts {entries} entries are a table and a loop; as straight-line code they would be long."
        );
        let table = looped(table, |row, entry| entry.column.map(|column| Place::Entry(row, column)));
        return Function { about, reads: Reads::of_table(estimator, &table), body: Body::Table(table) };
    }
    let of_parameters: Vec<(usize, usize, usize)> =
        (table.places.iter().enumerate()).filter_map(|(output, &(row, column))| Some((output, row, column?))).collect();
    let plan = restricted(table, of_parameters.iter().map(|&(output, ..)| output));
    let mut reader = Reader::new(&plan);
    let mut statements = Vec::new();
    for (output, &(_, row, column)) in of_parameters.iter().enumerate() {
        let (needed, value) = reader.output(output);
        let name = &estimator.form.columns[column].name;
        let formula = format!("{}, {name}: {}", row_text(table, row), formula(table, row, Some(column)));
        statements.push(Statement::Comment(formula));
        statements.extend(needed);
        statements.push(Statement::Store(Place::Entry(row, column), value));
    }
    let about = format!("{about}{}", text::operations(&plan));
    Function { about, reads: Reads::of(estimator, &plan), body: Body::Stores(statements) }
}

/// The plan of some entries of the matrix, without the operations that only other entries need.
fn restricted(table: &TablePlan, outputs: impl Iterator<Item = usize>) -> Plan {
    let mut merger = Merger::default();
    let slots = merger.append(&table.matrix);
    merger.finish(outputs.map(|output| slots[output]).collect())
}

/// Harmonics of the terms without an unknown parameter, when there are any.
pub(super) fn known_harmonics(estimator: &EstimatorSource, table: &TablePlan) -> Option<Function> {
    let about = "Harmonics of the terms without an unknown parameter, on the left-hand side.".to_owned();
    let known = table.places.iter().enumerate().filter(|(_, (_, column))| column.is_none());
    let known: Vec<(usize, usize)> = known.map(|(output, &(row, _))| (output, row)).collect();
    if known.is_empty() {
        return None;
    }
    if known.len() > STRAIGHT_LINE_ENTRIES {
        let table = looped(table, |row, entry| entry.column.is_none().then_some(Place::Value(row)));
        return Some(Function { about, reads: Reads::of_table(estimator, &table), body: Body::Table(table) });
    }
    let plan = restricted(table, known.iter().map(|&(output, _)| output));
    let mut reader = Reader::new(&plan);
    let mut statements = Vec::new();
    for (output, &(_, row)) in known.iter().enumerate() {
        let (needed, value) = reader.output(output);
        statements.push(Statement::Comment(format!("{}: {}", row_text(table, row), formula(table, row, None))));
        statements.extend(needed);
        statements.push(Statement::Store(Place::Value(row), value));
    }
    Some(Function { about, reads: Reads::of(estimator, &plan), body: Body::Stores(statements) })
}

/// The parameters from harmonics by the exact pseudo-inverse; `None` where there is none, or where its numbers exceed
/// single precision.
pub(super) fn direct(estimator: &EstimatorSource, pattern: &PatternPlan, table: &TablePlan) -> Option<Function> {
    let inverse = pattern.pseudo_inverse.as_ref()?;
    let fits = |op: &Op| match op {
        Op::Constant(value) => {
            let single = Rounded::new(value).single;
            single.is_finite() && (single.is_normal() || value.is_zero())
        }
        _ => true,
    };
    if !inverse.plan.ops.iter().all(fits) {
        return None;
    }
    let mut reader = Reader::new(&inverse.plan);
    let mut statements = Vec::new();
    for index in 0..inverse.numbers.len() {
        let (needed, value) = reader.output(index);
        statements.push(Statement::Comment(direct_formula(estimator, table, inverse, index)));
        statements.extend(needed);
        statements.push(Statement::Store(Place::Value(index), value));
    }
    let about = format!(
        "The parameters for which the harmonics of the pattern's own forces are `effort`, in the sense of least squares: the\n\
         exact pseudo-inverse of the numbers in the estimator matrix, each rounded once, over the scales of its columns. No\n\
         amplitude or frequency may be zero.{}",
        text::operations(&inverse.plan)
    );
    Some(Function { about, reads: Reads::of(estimator, &inverse.plan), body: Body::Stores(statements) })
}

/// The formula of a parameter in the pseudo-inverse, such as `m = (-2*u.cos1 - ...)/(lambda*w^2)`.
fn direct_formula(estimator: &EstimatorSource, table: &TablePlan, inverse: &PseudoInverse, column: usize) -> String {
    let (factors, scale) = (&inverse.numbers[column], &inverse.scales[column]);
    let mut terms = Vec::new();
    for (row, factor) in factors.iter().enumerate().filter(|(_, factor)| !factor.is_zero()) {
        let (equation, harmonic, function) = table.rows[row];
        let name = harmonic_name(harmonic, function);
        terms.push(format!("{}*{}.{name}", rational::display(factor), table.table.equations[equation]));
    }
    let name_of = |symbol: Symbol| &estimator.model.quantity(symbol).name;
    let mut divisors = Vec::new();
    for &(symbol, power) in &scale.powers {
        let name = name_of(symbol);
        divisors.push(if power == 1 { name.to_string() } else { format!("{name}^{power}") });
    }
    divisors.extend(scale.signs.iter().map(|&symbol| format!("sign({})", name_of(symbol))));
    if scale.pi != 0 {
        divisors.push(format!("pi^{}", scale.pi));
    }
    let name = &estimator.form.columns[column].name;
    let sum = terms.join(" + ").replace("+ -", "- ");
    let sum = if sum.len() > 240 { "the exact sum".to_owned() } else { format!("({sum})") };
    let divisors = divisors.join("*");
    if divisors.is_empty() { format!("{name} = {sum}") } else { format!("{name} = {sum}/({divisors})") }
}

/// Index of the sum of every row: cosines first, then sines, so that neighbouring sums have the same form.
pub(super) fn storage(table: &TablePlan) -> Vec<usize> {
    let mut order: Vec<usize> = (0..table.rows.len()).collect();
    order.sort_by_key(|&row| table.rows[row].2 == Trig::Sin);
    let mut places = vec![0; order.len()];
    order.into_iter().enumerate().for_each(|(place, row)| places[row] = place);
    places
}

/// The values that a sample adds to the sums, in the order of [`storage`].
pub(super) fn bank(estimator: &EstimatorSource, table: &TablePlan) -> (Reads, Vec<Statement>, Vec<Expression>) {
    let (statements, addends) = Reader::new(&table.bank).outputs();
    let mut placed: Vec<(usize, Expression)> = storage(table).into_iter().zip(addends).collect();
    placed.sort_by_key(|(place, _)| *place);
    let addends = placed.into_iter().map(|(_, addend)| addend).collect();
    (Reads::of(estimator, &table.bank), statements, addends)
}

/// The terms of a table for which `place` gives a target, with the bases of their powers.
fn looped(table: &TablePlan, place: impl Fn(usize, &Entry) -> Option<Place>) -> Table {
    let entries = table.table.entries().filter_map(|entry| Some((place(table.row_of(&entry), &entry)?, entry)));
    let entries: Vec<(Place, Entry)> = entries.collect();
    let mut bases: BTreeSet<(bool, Option<usize>)> = BTreeSet::new();
    for (_, entry) in &entries {
        bases.extend(entry.powers.factors().map(|(&symbol, _)| (false, Some(symbol))));
        bases.extend(entry.sign.factors().map(|(&symbol, _)| (true, Some(symbol))));
        if entry.pi != 0 {
            bases.insert((false, None));
        }
    }
    let terms = entries.iter().map(|(place, entry)| {
        let powers = bases.iter().map(|&(sign, symbol)| match (sign, symbol) {
            (false, None) => entry.pi,
            (false, Some(symbol)) => entry.powers.exponent(&symbol),
            (true, symbol) => symbol.map_or(0, |symbol| entry.sign.exponent(&symbol) % 2),
        });
        Term { place: *place, coefficient: entry.coefficient.clone(), powers: powers.collect() }
    });
    let terms = terms.collect();
    let order = bases.iter().map(|&(sign, symbol)| match symbol {
        None => "pi".to_owned(),
        Some(symbol) if sign => format!("sign({})", table.table.symbols[symbol]),
        Some(symbol) => table.table.symbols[symbol].to_string(),
    });
    let order = order.collect::<Vec<String>>().join(", ");
    let bases = bases.iter().map(|&(sign, index)| match index {
        None => Base::Pi,
        Some(index) if sign => Base::Sign(table_symbol(index)),
        Some(index) => Base::Symbol(table_symbol(index)),
    });
    Table { bases: bases.collect(), terms, order }
}

/// A table row as text: `u, cos 3`.
fn row_text(table: &TablePlan, row: usize) -> String {
    let (equation, harmonic, function) = table.rows[row];
    format!("{}, {} {harmonic}", table.table.equations[equation], harmonic_function(function))
}

/// The exact formula of an entry of the table.
fn formula(table: &TablePlan, row: usize, column: Option<usize>) -> String {
    let (equation, harmonic, function) = table.rows[row];
    let mut text = String::new();
    for entry in table.table.at(equation, harmonic, function, column) {
        let term = entry_formula(&table.table, &entry);
        match term.strip_prefix('-') {
            _ if text.is_empty() => text.push_str(&term),
            Some(positive) => text.push_str(&format!(" - {positive}")),
            None => text.push_str(&format!(" + {term}")),
        }
    }
    text
}
