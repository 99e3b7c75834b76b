//! The derivatives of a model's rows as one plan.
//!
//! With `r = Phi theta + known - B u`, the plan has every `dr/d(slot)`, where a slot is a coordinate or one of its time derivatives.
//! Solved for the highest derivatives (by the mass matrix), they give the sensitivities of the motion.
//!
//! A row with `sign(s)` jumps where s passes zero, so that its derivative does not exist there. A second plan has the
//! argument s of every such *switch* and half the height of the jump in every row, so that an integrator can locate
//! these points.

use crate::expr::graph::{Coordinate, ExprId, Function, Node};
use crate::mechanics::model::ExactModel;
use crate::plan::draft::Draft;
use crate::plan::entries::Entries;
use crate::plan::leaf::Leaf;
use crate::plan::straight_line::Plan;
use crate::regressor::form::RegressorForm;
use std::collections::{BTreeSet, HashMap};

/// Plans of a model's derivatives. Their leaves are derivatives of coordinates, run-time constants, inputs, and the parameters theta
/// as [`Leaf::Column`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Derivatives {
    /// Coordinate and order of differentiation of every slot, in order of the coordinates.
    pub slots: Vec<(Coordinate, u32)>,
    /// `dr/d(slot)`, rows times slots, row-major.
    pub rows: Plan,
    /// Number of different arguments of `sign` in the rows.
    pub switches: usize,
    /// Per switch: its argument, then per row the force at `sign = 1` less that at `sign = 0`.
    pub switching: Plan,
}

impl Derivatives {
    /// The derivatives of `form`, which belongs to `model`.
    #[must_use]
    pub fn new(model: &ExactModel, form: &RegressorForm) -> Self {
        Self::of_entries(Entries::new(model, form), form.columns.len())
    }

    /// The plan of `dr/dz`, rows times nonlinear parameters z, row-major; its leaves are those of a model's derivatives.
    #[must_use]
    pub fn by_nonlinear(model: &ExactModel, form: &RegressorForm) -> Plan {
        let (mut draft, forces) = forces(&Entries::new(model, form), form.columns.len());
        let mut slopes = Vec::with_capacity(forces.len() * model.nonlinear.len());
        for &force in &forces {
            for own in &model.nonlinear {
                let leaf = draft.graph.symbol(own.symbol);
                slopes.push(draft.graph.differentiate(force, leaf));
            }
        }
        draft.plan(&slopes)
    }

    pub(crate) fn of_entries(entries: Entries, columns: usize) -> Self {
        let (mut draft, forces) = forces(&entries, columns);
        let coordinates = entries.coordinates;
        let graph = &mut draft.graph;
        let slots: Vec<(Coordinate, u32)> =
            coordinates.iter().flat_map(|&(q, highest)| (0..=highest).map(move |order| (q, order))).collect();
        let leaves: Vec<ExprId> = slots.iter().map(|&(q, order)| graph.derivative_of(q, order)).collect();
        let mut rows = Vec::with_capacity(forces.len() * leaves.len());
        // The rows share subexpressions, whose derivatives are computed once for all rows.
        let mut slopes: Vec<HashMap<ExprId, ExprId>> = vec![HashMap::new(); leaves.len()];
        for &force in &forces {
            let of_row = leaves.iter().zip(&mut slopes);
            rows.extend(of_row.map(|(&leaf, known)| graph.differentiate_beside(force, leaf, known)));
        }
        let mut signs = BTreeSet::new();
        let mut waiting = forces.clone();
        let mut seen = BTreeSet::new();
        while let Some(id) = waiting.pop() {
            if seen.insert(id) {
                if matches!(graph.node(id), Node::Function(Function::Sign, _)) {
                    signs.insert(id);
                }
                waiting.extend(graph.operands(id));
            }
        }
        let (zero, one) = (graph.integer(0), graph.integer(1));
        let mut switching = Vec::new();
        for &sign in &signs {
            let Node::Function(_, argument) = *graph.node(sign) else { continue };
            switching.push(argument);
            for &force in &forces {
                let on = graph.substitute(force, &HashMap::from([(sign, one)]));
                let off = graph.substitute(force, &HashMap::from([(sign, zero)]));
                switching.push(graph.sub(on, off));
            }
        }
        Self { rows: draft.plan(&rows), switching: draft.plan(&switching), switches: signs.len(), slots }
    }
}

/// The rows `Phi theta + known - B u` in a new draft, with theta as [`Leaf::Column`].
fn forces(entries: &Entries, columns: usize) -> (Draft, Vec<ExprId>) {
    let Entries { graph, inputs, regressor, known, input_map, .. } = entries;
    let mut draft = Draft::new(graph.clone());
    let theta: Vec<ExprId> = (0..columns).map(|column| draft.leaf(Leaf::Column(column))).collect();
    let graph = &mut draft.graph;
    let mut forces = Vec::with_capacity(known.len());
    for (row, &constant) in known.iter().enumerate() {
        let entries = &regressor[row * columns..(row + 1) * columns];
        let mut terms: Vec<ExprId> =
            entries.iter().zip(&theta).map(|(&entry, &value)| graph.mul(value, entry)).collect();
        terms.push(constant);
        for (&factor, &input) in input_map[row * inputs.len()..].iter().zip(inputs) {
            let input = graph.symbol(input);
            let applied = graph.mul(factor, input);
            terms.push(graph.neg(applied));
        }
        forces.push(graph.sum(&terms));
    }
    (draft, forces)
}
