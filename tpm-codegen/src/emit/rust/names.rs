//! Every name of an emitted module, decided before anything is written.
//!
//! Invariant: the order of requests is that of the model's declarations, so that equal models get equal names.

use proc_macro2::Ident;
use tpm_symbolic::estimator::{EstimatorPlan, PatternPlan};
use tpm_symbolic::expr::{Coordinate, Symbol};
use tpm_symbolic::fourier::Trig;
use tpm_symbolic::model::Model;
use tpm_symbolic::regressor::RegressorForm;

use super::super::name::{Language, Namer, is_snake, snake};

/// Types of emitted modules and what they import: no name of a model may hide them.
const TYPES: [&str; 27] = [
    "Accumulator",
    "AccumulatorError",
    "Buffer",
    "Clone",
    "Constants",
    "Copy",
    "Debug",
    "Default",
    "Dims",
    "Err",
    "EvalError",
    "Forces",
    "Harmonics",
    "Inputs",
    "Label",
    "Model",
    "Motion",
    "Ok",
    "Option",
    "Parameters",
    "PartialEq",
    "Pattern",
    "Physical",
    "Real",
    "Result",
    "SolveError",
    "T",
];

/// An identifier, raw where it must be.
pub(super) fn ident(name: &str) -> Ident {
    let span = proc_macro2::Span::call_site();
    match name.strip_prefix("r#") {
        Some(plain) => Ident::new_raw(plain, span),
        None => Ident::new(name, span),
    }
}

/// A coordinate's names.
pub(super) struct CoordinateNames {
    pub(super) coordinate: Coordinate,
    pub(super) order: u32,
    pub(super) field: Ident,
    pub(super) motion_type: Ident,
}

/// The names of one equation.
pub(super) struct RowNames {
    pub(super) field: Ident,
    pub(super) harmonics_type: Ident,
}

/// The names of one pattern.
pub(super) struct PatternNames {
    /// The module of its own, when the model has several patterns.
    pub(super) module: Option<Ident>,
    /// Amplitudes in order, then the frequency.
    pub(super) fields: Vec<(Symbol, Ident)>,
}

/// The names of an emitted module.
pub(super) struct Names {
    pub(super) model_type: Ident,
    pub(super) module: Ident,
    pub(super) coordinates: Vec<CoordinateNames>,
    pub(super) columns: Vec<Ident>,
    pub(super) constants: Vec<(Symbol, Ident)>,
    pub(super) inputs: Vec<(Symbol, Ident)>,
    pub(super) physical: Vec<(Symbol, Ident)>,
    pub(super) rows: Vec<RowNames>,
    pub(super) patterns: Vec<PatternNames>,
    /// Whether a field is spelled in a way that the style lint refuses.
    pub(super) unusual: bool,
}

impl Names {
    pub(super) fn new(model: &Model, form: &RegressorForm, plan: &EstimatorPlan) -> Self {
        let mut types = Namer::new(Language::Rust, &TYPES);
        let mut unusual = false;
        let mut fields = |names: &mut dyn Iterator<Item = &str>| -> Vec<Ident> {
            let mut namer = Namer::new(Language::Rust, &[]);
            let mut list = Vec::new();
            for name in names {
                let name = namer.name(name);
                unusual |= !is_snake(&name);
                list.push(ident(&name));
            }
            list
        };
        let symbol_fields = |fields: &mut dyn FnMut(&mut dyn Iterator<Item = &str>) -> Vec<Ident>,
                             symbols: &[Symbol]| {
            let idents = fields(&mut symbols.iter().map(|symbol| model.quantity(*symbol).name.as_str()));
            symbols.iter().copied().zip(idents).collect::<Vec<(Symbol, Ident)>>()
        };
        let model_type = ident(&types.type_name(&model.name, ""));
        let coordinate_name = |coordinate: Coordinate| model.coordinates[coordinate.0 as usize].name.as_str();
        let coordinate_fields =
            fields(&mut plan.evaluation.coordinates.iter().map(|(coordinate, _)| coordinate_name(*coordinate)));
        let coordinates =
            plan.evaluation.coordinates.iter().zip(coordinate_fields).map(|(&(coordinate, order), field)| {
                let motion_type = ident(&types.type_name(coordinate_name(coordinate), "Motion"));
                CoordinateNames { coordinate, order, field, motion_type }
            });
        let coordinates = coordinates.collect();
        let row_fields = fields(&mut form.rows.iter().map(|row| row.name.as_str()));
        let rows = form
            .rows
            .iter()
            .zip(row_fields)
            .map(|(row, field)| RowNames { field, harmonics_type: ident(&types.type_name(&row.name, "Harmonics")) });
        let rows = rows.collect();
        let several = model.patterns.len() > 1;
        let mut modules = Namer::new(Language::Rust, &["core", "std"]);
        let patterns = plan.patterns.iter().enumerate().map(|(i, pattern)| {
            let name = pattern.name.clone().unwrap_or_else(|| format!("pattern{}", i + 1));
            PatternNames {
                module: several.then(|| ident(&modules.name(&snake(&name)))),
                fields: symbol_fields(&mut fields, &pattern_symbols(pattern)),
            }
        });
        let patterns = patterns.collect();
        let constants = symbol_fields(&mut fields, &plan.evaluation.constants);
        let inputs = symbol_fields(&mut fields, &plan.evaluation.inputs);
        let physical = match plan.lumping {
            Some(_) => symbol_fields(&mut fields, &model.parameters().collect::<Vec<Symbol>>()),
            None => Vec::new(),
        };
        let columns = fields(&mut form.columns.iter().map(|column| column.name.as_str()));
        Self {
            model_type,
            module: ident(&Namer::new(Language::Rust, &["core", "std"]).name(&snake(&model.name))),
            coordinates,
            columns,
            constants,
            inputs,
            physical,
            rows,
            patterns,
            unusual,
        }
    }
}

/// Amplitudes in order, then the frequency.
pub(super) fn pattern_symbols(pattern: &PatternPlan) -> Vec<Symbol> {
    pattern.amplitudes.iter().copied().chain([pattern.frequency]).collect()
}

/// The field of a derivative: `value`, `dot`, `ddot`, `der3`, ...
pub(super) fn derivative_field(order: u32) -> Ident {
    match order {
        0 => ident("value"),
        1 => ident("dot"),
        2 => ident("ddot"),
        _ => ident(&format!("der{order}")),
    }
}

/// The derivative as the model language writes it.
pub(super) fn derivative_text(name: &str, order: u32) -> String {
    match order {
        0 => name.to_owned(),
        1 => format!("dot({name})"),
        2 => format!("ddot({name})"),
        _ => format!("der({name}, {order})"),
    }
}

/// The field of a harmonic: `cos0`, `sin3`, ...
pub(super) fn harmonic_field(harmonic: usize, function: Trig) -> Ident {
    ident(&format!("{}{harmonic}", harmonic_function(function)))
}

/// `cos` or `sin`.
pub(super) fn harmonic_function(function: Trig) -> &'static str {
    match function {
        Trig::Cos => "cos",
        Trig::Sin => "sin",
    }
}
