//! `tpm check`: the properties of a model, and what stands in the way of its uses; and whether a machine is still the one that was
//! identified.

mod against;

use crate::failure::Outcome;
use crate::input::load::Loaded;
use crate::output::file;
use crate::verbs::check::against::MachineArgs;
use std::fmt::Write as _;
use std::path::PathBuf;
use tpm_symbolic::harmonic::expand::{ExpandOptions, expand_with};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::number::rational;
use tpm_symbolic::regressor::form::{RegressorForm, canonical};

/// Options of `tpm check`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    #[command(flatten)]
    machine: MachineArgs,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    if let Some(done) = against::run(&args.file, &args.machine) {
        return done;
    }
    let loaded = Loaded::from_file(&args.file)?;
    let prepared = loaded.prepared()?;
    let (model, form) = (&prepared.model, &prepared.form);
    let mut text = describe(model, form);
    for reconstruction in &prepared.reconstructions {
        let name = &model.coordinates[reconstruction.coordinate.0 as usize].name;
        let _ = writeln!(text, "eliminated: {name} = {}", model.display(reconstruction.expr));
    }
    // A model that does not expand can still be identified from logs, so the obstacle is a remark and not an error.
    if model.patterns.is_empty() {
        text.push_str("remark: no pattern, so `expand` has nothing to expand under; logs need none\n");
    }
    if let Err(fault) = prepared.require_inputs_alone() {
        text.push_str("remark: logs identify and validate this model by simulation, and nothing else uses it:\n");
        text.push_str(&loaded.remark(&fault));
        return file::print(&text);
    }
    let (tables, _) = loaded.for_tables()?;
    for pattern in &model.patterns {
        let name = pattern.name.as_ref().map_or_else(|| "the pattern".to_owned(), |name| format!("pattern {name}"));
        let harmonics = loaded.harmonics(pattern);
        let mut options = ExpandOptions { harmonics, ..ExpandOptions::default() };
        match expand_with(&tables.model, &tables.form, pattern, &mut options) {
            Ok(table) => {
                for (equation, row) in table.equations.iter().enumerate() {
                    let infinite = table.tails.iter().any(|tail| tail.equation == equation);
                    let note = if infinite { "; it has infinitely many, of which these are kept" } else { "" };
                    let highest = table.highest_harmonic(equation);
                    let _ = writeln!(text, "{name}: highest harmonic of {row} is {highest}{note}");
                }
            }
            Err(error) => {
                let _ = writeln!(text, "remark: {name} has no finite table, and `expand` will refuse it:");
                text.push_str(&loaded.remark(&error));
            }
        }
    }
    file::print(&text)
}

fn describe(model: &ExactModel, form: &RegressorForm) -> String {
    let mut text = format!("model {}\n", model.name);
    let list = |names: Vec<String>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    let with_unit =
        |name: &str, unit: Option<String>| unit.map_or_else(|| name.to_owned(), |unit| format!("{name} [{unit}]"));
    let quantity = |symbol| {
        let quantity = model.quantity(symbol);
        with_unit(&quantity.name, quantity.unit.as_ref().map(ToString::to_string))
    };
    let coordinates = model.coordinates.iter().map(|c| with_unit(&c.name, c.unit.as_ref().map(ToString::to_string)));
    let _ = writeln!(text, "coordinates: {}", list(coordinates.collect()));
    let _ = writeln!(text, "inputs: {}", list(model.inputs().map(quantity).collect()));
    let _ = writeln!(text, "physical parameters: {}", list(model.parameters().map(quantity).collect()));
    let _ = writeln!(text, "constants known at run time: {}", list(model.known_constants().map(quantity).collect()));
    for own in &model.nonlinear {
        let [from, to] = [&own.from, &own.to].map(rational::display);
        let _ = writeln!(text, "nonlinear parameter: {}, from {from} to {to}", quantity(own.symbol));
    }
    let _ = writeln!(text, "equations: {}", list(form.rows.iter().map(|row| row.name.to_string()).collect()));
    let _ = writeln!(text, "linear in {} parameters:", form.columns.len());
    for column in &form.columns {
        let name = with_unit(&column.name, column.unit.as_ref().map(ToString::to_string));
        match column.parameter {
            Some(_) => {
                let _ = writeln!(text, "  {name}");
            }
            None => {
                let _ = writeln!(text, "  {name} = {}", canonical(model, &column.definition));
            }
        }
    }
    text
}
