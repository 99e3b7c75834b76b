//! Plans derived from the row forces Phi theta + known: the forces at rest, and the dynamics solved for the
//! accelerations.
//!
//! For a mechanism, forces and mass matrix are computed by its recursions, to which the other terms of its equations
//! (friction, rotors, forces of the model) are added. The rows themselves give the same values by other operations; the
//! shorter plan is chosen.

use crate::expr::graph::{Coordinate, ExprId, Graph, Node};
use crate::mechanics::model::{ExactModel, Kind};
use crate::mechanics::tree::NAMES;
use crate::mechanics::tree::mechanism::{Mechanism, parameter_name};
use crate::plan::constants::substitute_values;
use crate::plan::draft::Draft;
use crate::plan::dynamics::{Degrees, Dynamics};
use crate::plan::entries::Entries;
use crate::plan::leaf::Leaf;
use crate::plan::straight_line::Plan;
use crate::plan::written::Written;
use crate::regressor::form::RegressorForm;
use std::collections::{BTreeMap, HashMap};

/// Phi theta + known by the recursion of a mechanism; `None` where the rows are not the mechanism's equations times numbers.
#[must_use]
pub fn by_recursion(model: &ExactModel, form: &RegressorForm, mechanism: &Mechanism) -> Option<Plan> {
    let recursion = Recursion::new(model, form, mechanism)?;
    Some(recursion.written.draft.plan(&recursion.forces))
}

/// The row forces at rest, one per row: Phi theta + known where all derivatives of coordinates are zero. For an arm
/// these are the torques that balance gravity.
#[must_use]
pub fn at_rest(model: &ExactModel, form: &RegressorForm, mechanism: Option<&Mechanism>) -> Plan {
    let entries = Entries::new(model, form);
    let columns = form.columns.len();
    let mut draft = Draft::new(entries.graph);
    let theta: Vec<ExprId> = (0..columns).map(|column| draft.leaf(Leaf::Column(column))).collect();
    let graph = &mut draft.graph;
    let mut still = rates_at_zero(graph, &entries.coordinates);
    let forces: Vec<ExprId> = (0..entries.known.len())
        .map(|row| {
            let entries_of_row = &entries.regressor[row * columns..(row + 1) * columns];
            let mut terms = Vec::with_capacity(columns + 1);
            for (&entry, &value) in entries_of_row.iter().zip(&theta) {
                let entry = graph.substitute_beside(entry, &mut still);
                terms.push(graph.mul(value, entry));
            }
            terms.push(graph.substitute_beside(entries.known[row], &mut still));
            graph.sum(&terms)
        })
        .collect();
    let of_rows = draft.plan(&forces);
    let by_recursion = mechanism.and_then(|mechanism| Recursion::new(model, form, mechanism)).map(|mut recursion| {
        let graph = &mut recursion.written.draft.graph;
        let mut still = rates_at_zero(graph, &entries.coordinates);
        let forces: Vec<ExprId> =
            recursion.forces.iter().map(|&force| graph.substitute_beside(force, &mut still)).collect();
        recursion.written.draft.plan(&forces)
    });
    shorter(Some(of_rows), by_recursion).expect("invariant: the rows have a plan")
}

/// The dynamics solved for the highest derivatives; `None` where the numbers of rows and coordinates differ, or the
/// rows are not written as affine in these derivatives.
#[must_use]
pub fn dynamics(model: &ExactModel, form: &RegressorForm, mechanism: Option<&Mechanism>) -> Option<Dynamics> {
    let by_recursion = mechanism.and_then(|mechanism| Recursion::new(model, form, mechanism)?.dynamics(model, form));
    if let Some(found) = by_recursion.as_ref().filter(|_| !form.is_expanded(&model.graph)) {
        return Some(found.clone());
    }
    let of_rows = Dynamics::new(Entries::new(model, form));
    let plan = shorter(of_rows.map(|dynamics| dynamics.plan), by_recursion.map(|dynamics| dynamics.plan))?;
    Some(Dynamics { plan })
}

fn operations(plan: &Plan) -> usize {
    let counts = plan.counts();
    counts.additions + counts.multiplications + counts.divisions + counts.functions
}

/// The plan with fewer operations; the first one when they are equal.
pub(crate) fn shorter(first: Option<Plan>, second: Option<Plan>) -> Option<Plan> {
    match (first, second) {
        (Some(first), Some(second)) if operations(&second) < operations(&first) => Some(second),
        (first, second) => first.or(second),
    }
}

/// Zeros for all derivatives of the coordinates.
fn rates_at_zero(graph: &mut Graph, coordinates: &[(Coordinate, u32)]) -> HashMap<ExprId, ExprId> {
    let zero = graph.integer(0);
    let rates =
        coordinates.iter().flat_map(|&(coordinate, highest)| (1..=highest).map(move |order| (coordinate, order)));
    rates.map(|(coordinate, order)| (graph.derivative_of(coordinate, order), zero)).collect()
}

/// The forces of a mechanism's rows by its recursion.
struct Recursion<'a> {
    mechanism: &'a Mechanism,
    written: Written,
    /// Phi theta + known, by row.
    forces: Vec<ExprId>,
    /// Terms of the rows other than those of the inertias.
    rest: Vec<ExprId>,
    /// The mass matrix of the inertias.
    masses: HashMap<(usize, usize), ExprId>,
}

impl<'a> Recursion<'a> {
    fn new(model: &ExactModel, form: &RegressorForm, mechanism: &'a Mechanism) -> Option<Self> {
        let mut graph = model.graph.clone();
        let names: HashMap<&str, ExprId> = model
            .symbols_where(|kind| *kind == Kind::Parameter)
            .map(|symbol| (model.quantity(symbol).name.as_str(), graph.symbol(symbol)))
            .collect();
        let zero = graph.integer(0);
        // A parameter that occurs in no equation was not declared.
        let parameters = |body: usize| {
            let label = &mechanism.labels[body].name;
            NAMES.map(|name| names.get(parameter_name(name, label).as_str()).copied().unwrap_or(zero))
        };
        let mut torques = mechanism.tree.torques(&mut graph, parameters);
        torques.sort_by_key(|(coordinate, _)| *coordinate);
        let place = |wanted: Coordinate| torques.iter().position(|(coordinate, _)| *coordinate == wanted);
        let masses = mechanism.tree.mass_matrix(&mut graph, parameters);
        if torques.len() != model.equations.len() {
            return None;
        }
        let mut written = Written::new(model, form, graph)?;
        let mut entries = HashMap::new();
        for (row, column, expr) in masses {
            let (row, column) = (place(row)?, place(column)?);
            let expr = written.put_in(expr);
            entries.insert((row, column), expr);
            entries.insert((column, row), expr);
        }
        let (mut forces, mut rest) = (Vec::new(), Vec::new());
        for (row, (equation, &(_, torque))) in model.equations.iter().zip(&torques).enumerate() {
            let of_body = |id| mechanism.labels.iter().any(|label| label.term == id);
            let beside: Vec<ExprId> =
                equation.terms.iter().filter(|term| !of_body(term.id)).map(|term| written.put_in(term.expr)).collect();
            let beside = written.draft.graph.sum(&beside);
            let torque = written.put_in(torque);
            let force = written.draft.graph.sum_of_wholes(&[torque, beside]);
            forces.push(written.scaled(row, force));
            rest.push(beside);
        }
        Some(Self { mechanism, written, forces, rest, masses: entries })
    }

    /// The plan of M and the right-hand side.
    fn dynamics(mut self, model: &ExactModel, form: &RegressorForm) -> Option<Dynamics> {
        let mut coordinates: Vec<Coordinate> =
            self.mechanism.tree.bodies().iter().filter_map(|body| body.joint.coordinate()).collect();
        coordinates.sort_unstable();
        coordinates.dedup();
        // Forces of the model may depend on further coordinates, which no joint moves.
        let mut orders: BTreeMap<Coordinate, u32> = BTreeMap::new();
        for leaf in form.leaves(&model.graph) {
            if let Node::Derivative(coordinate, order) = *model.graph.node(leaf) {
                let highest = orders.entry(coordinate).or_default();
                *highest = order.max(*highest);
            }
        }
        if !orders.into_iter().eq(coordinates.iter().map(|&coordinate| (coordinate, 2))) {
            return None;
        }
        let graph = &mut self.written.draft.graph;
        let zero = graph.integer(0);
        let accelerations: Vec<ExprId> =
            coordinates.iter().map(|&coordinate| graph.derivative_of(coordinate, 2)).collect();
        let degrees = Degrees::new(graph, &accelerations);
        if self.rest.iter().any(|&rest| degrees.of(rest).is_none_or(|degree| degree > 1)) {
            return None;
        }
        let mut roots = Vec::new();
        let mut slopes: Vec<HashMap<ExprId, ExprId>> = vec![HashMap::new(); accelerations.len()];
        for row in 0..self.forces.len() {
            for (column, (&leaf, known)) in accelerations.iter().zip(&mut slopes).enumerate() {
                let graph = &mut self.written.draft.graph;
                let inertia = self.masses.get(&(row, column)).copied().unwrap_or(zero);
                let slope = graph.differentiate_beside(self.rest[row], leaf, known);
                let entry = graph.sum_of_wholes(&[inertia, slope]);
                roots.push(self.written.scaled(row, entry));
            }
        }
        let mut still: HashMap<ExprId, ExprId> = accelerations.iter().map(|&leaf| (leaf, zero)).collect();
        for (row, &force) in form.rows.iter().zip(&self.forces) {
            let bias = self.written.draft.graph.substitute_beside(force, &mut still);
            let mut terms = vec![self.written.draft.graph.neg(bias)];
            for (input, factor) in &row.inputs {
                let graph = &mut self.written.draft.graph;
                let factor = graph.from_polynomial(factor);
                let factor = substitute_values(model, graph, factor);
                let input = graph.symbol(*input);
                terms.push(graph.mul(factor, input));
            }
            roots.push(self.written.draft.graph.sum_of_wholes(&terms));
        }
        Some(Dynamics { plan: self.written.draft.plan(&roots) })
    }
}
