//! All names of the emitted code, assigned before anything is written.
//!
//! Invariant: names are requested in the order of the model's declarations, so that equal models get equal names.

use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::expr::graph::{Coordinate, Symbol};
use tpm_symbolic::mechanics::model::ExactModel;
use tpm_symbolic::plan::estimator::EstimatorPlan;
use tpm_symbolic::plan::pattern::PatternPlan;
use tpm_symbolic::regressor::form::RegressorForm;

use super::name::{Language, Namer, is_snake, snake};

/// A coordinate's names.
pub(super) struct CoordinateNames<N> {
    pub(super) coordinate: Coordinate,
    pub(super) order: u32,
    pub(super) field: N,
    pub(super) motion_type: N,
}

/// The names of one equation.
pub(super) struct RowNames<N> {
    pub(super) field: N,
    pub(super) harmonics_type: N,
}

/// The names of one pattern.
pub(super) struct PatternNames<N> {
    /// The name of the pattern's own module or part, when the model has several patterns.
    pub(super) module: Option<N>,
    /// Amplitudes in order, then the frequency.
    pub(super) fields: Vec<(Symbol, N)>,
}

/// The names of the emitted code, in the form that its language uses.
pub(super) struct Names<N> {
    pub(super) model_type: N,
    pub(super) module: N,
    pub(super) coordinates: Vec<CoordinateNames<N>>,
    pub(super) columns: Vec<N>,
    pub(super) constants: Vec<(Symbol, N)>,
    pub(super) inputs: Vec<(Symbol, N)>,
    pub(super) physical: Vec<(Symbol, N)>,
    pub(super) rows: Vec<RowNames<N>>,
    pub(super) patterns: Vec<PatternNames<N>>,
    /// Whether Rust's lint on naming style refuses the name of a field.
    pub(super) unusual: bool,
}

/// Those parts of naming in which languages differ.
pub(super) struct Style<'a> {
    pub(super) language: Language,
    /// Makes the name of a new type from a name in the model and a suffix.
    pub(super) type_name: &'a mut dyn FnMut(&str, &str) -> String,
    /// Names that are not given to a pattern's module or part.
    pub(super) reserved: &'a [&'a str],
}

impl Names<String> {
    pub(super) fn new(style: &mut Style<'_>, model: &ExactModel, form: &RegressorForm, plan: &EstimatorPlan) -> Self {
        let language = style.language;
        let mut unusual = false;
        let mut fields = |names: &mut dyn Iterator<Item = &str>| -> Vec<String> {
            let mut namer = Namer::new(language, &[]);
            let mut list = Vec::new();
            for name in names {
                let name = namer.name(name);
                unusual |= !is_snake(&name);
                list.push(name);
            }
            list
        };
        let symbol_fields = |fields: &mut dyn FnMut(&mut dyn Iterator<Item = &str>) -> Vec<String>,
                             symbols: &[Symbol]| {
            let names = fields(&mut symbols.iter().map(|symbol| model.quantity(*symbol).name.as_str()));
            symbols.iter().copied().zip(names).collect::<Vec<(Symbol, String)>>()
        };
        let model_type = (style.type_name)(&model.name, "");
        let coordinate_name = |coordinate: Coordinate| model.coordinates[coordinate.0 as usize].name.as_str();
        let coordinate_fields =
            fields(&mut plan.evaluation.coordinates.iter().map(|(coordinate, _)| coordinate_name(*coordinate)));
        let coordinates =
            plan.evaluation.coordinates.iter().zip(coordinate_fields).map(|(&(coordinate, order), field)| {
                let motion_type = (style.type_name)(coordinate_name(coordinate), "Motion");
                CoordinateNames { coordinate, order, field, motion_type }
            });
        let coordinates = coordinates.collect();
        let row_fields = fields(&mut form.rows.iter().map(|row| row.name.as_str()));
        let rows = form
            .rows
            .iter()
            .zip(row_fields)
            .map(|(row, field)| RowNames { field, harmonics_type: (style.type_name)(&row.name, "Harmonics") });
        let rows = rows.collect();
        let several = model.patterns.len() > 1;
        let mut modules = Namer::new(language, style.reserved);
        let patterns = plan.patterns.iter().enumerate().map(|(i, pattern)| {
            let name = pattern.name.clone().unwrap_or_else(|| format!("pattern{}", i + 1));
            PatternNames {
                module: several.then(|| modules.name(&snake(&name))),
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
        let module = Namer::new(language, style.reserved).name(&snake(&model.name));
        Self { model_type, module, coordinates, columns, constants, inputs, physical, rows, patterns, unusual }
    }

    /// All names, each converted by `form`.
    pub(super) fn map<N>(&self, form: impl Fn(&str) -> N) -> Names<N> {
        let pairs = |list: &[(Symbol, String)]| list.iter().map(|(symbol, name)| (*symbol, form(name))).collect();
        Names {
            model_type: form(&self.model_type),
            module: form(&self.module),
            coordinates: self
                .coordinates
                .iter()
                .map(|names| CoordinateNames {
                    coordinate: names.coordinate,
                    order: names.order,
                    field: form(&names.field),
                    motion_type: form(&names.motion_type),
                })
                .collect(),
            columns: self.columns.iter().map(|name| form(name)).collect(),
            constants: pairs(&self.constants),
            inputs: pairs(&self.inputs),
            physical: pairs(&self.physical),
            rows: self
                .rows
                .iter()
                .map(|names| RowNames { field: form(&names.field), harmonics_type: form(&names.harmonics_type) })
                .collect(),
            patterns: self
                .patterns
                .iter()
                .map(|names| PatternNames { module: names.module.as_deref().map(&form), fields: pairs(&names.fields) })
                .collect(),
            unusual: self.unusual,
        }
    }
}

impl<N> PatternNames<N> {
    /// The field of the pattern's frequency.
    pub(super) fn frequency(&self, pattern: &PatternPlan) -> &N {
        let found = self.fields.iter().find(|(symbol, _)| *symbol == pattern.frequency);
        &found.expect("invariant: a pattern has its frequency").1
    }
}

/// Amplitudes in order, then the frequency.
fn pattern_symbols(pattern: &PatternPlan) -> Vec<Symbol> {
    pattern.amplitudes.iter().copied().chain([pattern.frequency]).collect()
}

/// The field of a derivative: `value`, `dot`, `ddot`, `der3`, ...
pub(super) fn derivative_name(order: u32) -> String {
    match order {
        0 => "value".to_owned(),
        1 => "dot".to_owned(),
        2 => "ddot".to_owned(),
        _ => format!("der{order}"),
    }
}

/// The derivative in the spelling of the model language.
pub(super) fn derivative_text(name: &str, order: u32) -> String {
    match order {
        0 => name.to_owned(),
        1 => format!("dot({name})"),
        2 => format!("ddot({name})"),
        _ => format!("der({name}, {order})"),
    }
}

/// The field of a harmonic: `cos0`, `sin3`, ...
pub(super) fn harmonic_name(harmonic: usize, function: Trig) -> String {
    format!("{}{harmonic}", harmonic_function(function))
}

/// `cos` or `sin`.
pub(super) fn harmonic_function(function: Trig) -> &'static str {
    match function {
        Trig::Cos => "cos",
        Trig::Sin => "sin",
    }
}
