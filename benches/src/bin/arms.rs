//! Numbers of operations of a mechanism's recursions: `arms MODEL.tpm ...`.
//!
//! One line per model: multiplications, additions and function calls of the inverse dynamics with all parameters, of the inverse dynamics
//! with base parameters alone, and of the regressor's columns of the base parameters. Parameters are known at run time. With `--columns`
//! the leading columns of the base parameters are printed instead, for other tools that are to do the same work.

use std::collections::BTreeSet;
use std::error::Error;
use std::io::Write as _;
use tpm_codegen::parse_model;
use tpm_codegen::source::Source;
use tpm_symbolic::expr::graph::{ExprId, Node, Symbol};
use tpm_symbolic::mechanics::tree::NAMES;
use tpm_symbolic::mechanics::tree::mechanism::parameter_name;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::regressor::base_parameters::{Motions, base_parameters};
use tpm_symbolic::regressor::prepare::prepare;

/// Symbols from this one on stand for inertia parameters, whether the model has them or not.
const FIRST: u32 = 1_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let columns = arguments.iter().any(|argument| argument == "--columns");
    arguments.retain(|argument| argument != "--columns");
    for path in arguments {
        let source = Source::from_bytes(path.clone(), std::fs::read(&path)?);
        let parsed = parse_model(&source).map_err(|faults| faults.render(&source))?;
        let mechanism = parsed.mechanism.clone().ok_or_else(|| format!("{path}: no mechanism"))?;
        let prepared = prepare(parsed.model.clone())?;
        let found = base_parameters(&prepared.model, &prepared.form, &Motions::default())?;
        let base = found.base.ok_or_else(|| format!("{path}: the base parameters depend on constants"))?;
        // A column that several parameters share has the regressor of its first one.
        let first = |column: usize| {
            let atoms = prepared.form.columns[column].definition.terms().next().into_iter();
            let symbols = atoms.flat_map(|(monomial, _)| monomial.factors()).filter_map(|(&atom, _)| {
                match prepared.model.graph.node(atom) {
                    Node::Symbol(symbol) => Some(prepared.model.quantity(*symbol).name.to_string()),
                    _ => None,
                }
            });
            symbols.collect::<Vec<String>>()
        };
        let leading: BTreeSet<String> = base.iter().flat_map(|own| first(own.column)).collect();
        let mut out = std::io::stdout().lock();
        if columns {
            writeln!(out, "{}", leading.iter().cloned().collect::<Vec<_>>().join(" "))?;
            continue;
        }
        let mut graph = prepared.model.graph.clone();
        let name = |body: usize, k: usize| parameter_name(NAMES[k], &mechanism.labels[body].name);
        let zero = graph.integer(0);
        let counts = |plan: Plan<Leaf>| {
            let counts = plan.counts();
            format!("{}/{}/{}", counts.multiplications + counts.divisions, counts.additions, counts.functions)
        };
        let mut torques = |base_alone: bool| {
            let parameters: Vec<[ExprId; 10]> = (0..mechanism.labels.len())
                .map(|body| {
                    std::array::from_fn(|k| match base_alone && !leading.contains(&name(body, k)) {
                        true => zero,
                        false => graph.symbol(Symbol(FIRST + (10 * body + k) as u32)),
                    })
                })
                .collect();
            let torques = mechanism.tree.torques(&mut graph, |body| parameters[body]);
            let roots: Vec<ExprId> = torques.into_iter().map(|(_, torque)| torque).collect();
            counts(Plan::new(&graph, &roots))
        };
        let (all, alone) = (torques(false), torques(true));
        let rows = mechanism.tree.regressor(&mut graph);
        let entries = rows.iter().flat_map(|row| &row.entries);
        let kept = entries.filter(|entry| leading.contains(&name(entry.body, entry.parameter)));
        let roots: Vec<ExprId> = kept.map(|entry| entry.expr).collect();
        let regressor = counts(Plan::new(&graph, &roots));
        writeln!(out, "{} {} {all} {alone} {regressor}", prepared.model.name, found.rank)?;
    }
    Ok(())
}
