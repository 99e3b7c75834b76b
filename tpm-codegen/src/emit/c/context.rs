//! State shared by the emitters of C: options, names, the spelling of leaves and steps, and the text so far.
//!
//! Invariant: every name that other translation units can see begins with the prefix; every field comes from the model through
//! one namer.

use std::collections::HashSet;
use std::rc::Rc;

use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::plan::leaf::Leaf;

use super::super::code::{Base, Expression, Place, Statement, Table};
use super::super::estimator::{EmitError, EstimatorSource, Identified};
use super::super::filter::Filters;
use super::super::function::{Reads, Role};
use super::super::name::{Language, Namer, snake};
use super::super::names::{Names, Style, derivative_name};
use super::expression::{Scalar, Writer};
use super::layout::{comment, doc, signature, statement};
use super::translate::Library;

/// Options of the C code.
#[derive(Clone, Debug)]
pub struct Options<'a> {
    /// The command that generates this code again; it stands in the header.
    pub command: &'a str,
    /// The prefix of names and files; the model's name in small letters when not given.
    pub prefix: Option<&'a str>,
    /// The scalar.
    pub scalar: Scalar,
    /// Identified values that the code contains as constants.
    pub identified: Option<&'a Identified>,
    /// Low passes of the feed-forward.
    pub filters: Option<&'a Filters>,
    /// Whether accumulators get a function that reduces the weight of earlier samples.
    pub forgetting: bool,
    /// Whether every pattern has a function for single strokes.
    pub strokes: bool,
}

/// The names of the functions and types of the dynamics, without the prefix. They are reserved: no name of a model may
/// equal one of them.
const DYNAMICS: &str = "accelerations base base_accumulate base_estimate base_estimator base_estimator_clear base_estimator_fade \
    base_jumps base_parameter_labels base_parameters base_regressor base_solve base_workspace common_feed_forward \
    common_feed_forward_settle common_filters constant_labels constants coordinate_labels dependent_low_pass \
    equation_labels estimate feed_forward feed_forward_dependent feed_forward_independent \
    feed_forward_with_regressor forces forward_dynamics gravity identified identified_spread independent_low_pass \
    input_labels input_map inputs inverse_dynamics known label least_squares low_pass low_pass_settle lump \
    mass_matrix monitor monitor_again monitor_begin monitor_evidence monitor_fault monitor_order monitor_push \
    monitor_rest monitor_rules monitor_state monitor_watched motion parameter_labels parameters physical regressor \
    representative run run_applied run_begin run_campaign run_campaign_begin run_campaign_push run_campaign_stop \
    run_campaign_update run_command run_end run_estimate run_factor run_identify run_identify_about \
    run_identify_physical run_is_whole run_limits run_linearisation run_lines run_means run_measured run_numerical \
    run_numerical_begin run_numerical_change run_numerical_identify run_order run_order_rules run_parameter_names \
    run_parameters run_passed run_phase run_phasor run_physical run_physical_estimate run_physical_factor \
    run_physical_solution run_physical_workspace run_play run_pool run_push run_reference run_reference_begin \
    run_reference_push run_rules run_sample run_sampling run_shown run_solution run_stage run_status run_stop \
    run_workspace split_feed_forward split_feed_forward_settle split_filters status unlump";

/// The names of the functions and types of a pattern, without the prefix and the pattern's own name. They are reserved
/// too.
const PATTERN: &str = "accumulate accumulate_at accumulate_hann accumulated accumulator accumulator_clear accumulator_fade \
    estimator_matrix harmonics identify identify_direct known_harmonics pattern period reference reference_at \
    reference_from solve status stroke transform workspace";

/// State shared by the emitters of the parts: their options, and the text that they have written.
pub(super) struct Context<'a> {
    pub(super) estimator: &'a EstimatorSource,
    pub(super) scalar: Scalar,
    pub(super) names: Names<String>,
    pub(super) prefix: String,
    pub(super) identified: Option<&'a Identified>,
    pub(super) filters: Option<&'a Filters>,
    pub(super) forgetting: bool,
    pub(super) strokes: bool,
    /// Types, declarations and their documentation.
    pub(super) header: String,
    /// Definitions.
    pub(super) source: String,
    /// The types and functions of the controller's own code that are written.
    pub(super) translated: HashSet<String>,
    /// The controller's own code, once a part has asked for it.
    pub(super) library: Option<Rc<Library>>,
}

/// A parameter of a function.
#[derive(Clone, Debug)]
pub(super) struct Parameter {
    /// Its declaration, such as `const double x`.
    pub(super) declaration: String,
    /// Its name, when the body does not use it.
    pub(super) unused: Option<&'static str>,
}

impl Parameter {
    pub(super) fn new(declaration: impl Into<String>) -> Self {
        Self { declaration: declaration.into(), unused: None }
    }

    pub(super) fn read(declaration: impl Into<String>, name: &'static str, read: bool) -> Self {
        Self { declaration: declaration.into(), unused: (!read).then_some(name) }
    }
}

impl<'a> Context<'a> {
    pub(super) fn new(estimator: &'a EstimatorSource, options: &Options<'a>) -> Result<Self, EmitError> {
        let prefix = match options.prefix {
            Some(prefix) if is_prefix(prefix) => prefix.to_owned(),
            Some(prefix) => return Err(EmitError::Prefix(prefix.to_owned())),
            None => {
                let name = Namer::new(Language::C, &[]).name(&snake(&estimator.model.name));
                name.trim_end_matches('_').to_owned()
            }
        };
        let mut reserved: Vec<String> = DYNAMICS.split(' ').map(str::to_owned).collect();
        let patterns = estimator.plan.patterns.iter().filter_map(|pattern| pattern.name.as_deref());
        for part in std::iter::once(String::new()).chain(patterns.map(|name| format!("{}_", snake(name)))) {
            reserved.extend(PATTERN.split(' ').map(|name| format!("{part}{name}")));
        }
        let reserved: Vec<&str> = reserved.iter().map(String::as_str).collect();
        let mut types = Namer::new(Language::C, &reserved);
        let mut style = Style {
            language: Language::C,
            type_name: &mut |wanted, suffix| types.name(&format!("{}_{}", snake(wanted), snake(suffix))),
            reserved: &[],
        };
        let mut names = Names::new(&mut style, &estimator.model, &estimator.form, &estimator.plan);
        // The name of a pattern stands between other words, so that it never forms a keyword.
        // Names that begin with `run` are those of the estimator of a run.
        let mut taken: Vec<String> = vec!["run".to_owned()];
        for (index, (pattern, names)) in estimator.plan.patterns.iter().zip(&mut names.patterns).enumerate() {
            if let Some(module) = &mut names.module {
                let name = pattern.name.as_deref().map_or_else(|| format!("pattern{}", index + 1), snake);
                let name = name.trim_matches('_');
                let tries = std::iter::once(name.to_owned()).chain((2..).map(|number| format!("{name}{number}")));
                *module = tries.into_iter().find(|name| !taken.contains(name)).unwrap_or_default();
                taken.push(module.clone());
            }
        }
        let scalar = options.scalar;
        Ok(Self {
            estimator,
            scalar,
            names,
            prefix,
            identified: options.identified,
            filters: options.filters,
            forgetting: options.forgetting,
            strokes: options.strokes,
            header: String::new(),
            source: String::new(),
            translated: HashSet::new(),
            library: None,
        })
    }

    /// A name with the prefix.
    pub(super) fn global(&self, name: &str) -> String {
        format!("{}_{name}", self.prefix)
    }

    /// The name of a macro with the prefix.
    pub(super) fn constant(&self, name: &str) -> String {
        format!("{}_{name}", self.prefix.to_uppercase())
    }

    /// The name of an item that belongs to a pattern, without the prefix.
    pub(super) fn of_pattern(&self, pattern: usize, name: &str) -> String {
        match &self.names.patterns[pattern].module {
            Some(module) => format!("{module}_{name}"),
            None => name.to_owned(),
        }
    }

    /// The name of a function in C.
    pub(super) fn function_name(&self, role: Role) -> String {
        self.global(&match role {
            Role::Regressor => "regressor".to_owned(),
            Role::Known => "known".to_owned(),
            Role::InputMap => "input_map".to_owned(),
            Role::InverseDynamics => "inverse_dynamics".to_owned(),
            Role::FeedForward => "feed_forward".to_owned(),
            Role::FeedForwardIndependent => "feed_forward_independent".to_owned(),
            Role::FeedForwardDependent => "feed_forward_dependent".to_owned(),
            Role::Gravity => "gravity".to_owned(),
            Role::MassMatrix => "mass_matrix".to_owned(),
            Role::ForwardDynamics => "forward_dynamics".to_owned(),
            Role::BaseRegressor => "base_regressor".to_owned(),
            Role::Lump => "lump".to_owned(),
            Role::Unlump => "unlump".to_owned(),
            Role::Reference(pattern) => self.of_pattern(pattern, "reference_from"),
            Role::EstimatorMatrix(pattern) => self.of_pattern(pattern, "estimator_matrix"),
            Role::Accumulate(pattern) => self.of_pattern(pattern, "accumulate_at"),
        })
    }

    /// A text in which links are replaced by the names of this code; `pattern` is the one to whose types they refer.
    pub(super) fn linked(&self, text: &str, pattern: Option<usize>) -> String {
        let mut linked = String::new();
        let mut rest = text;
        while let Some((before, after)) = rest.split_once("[`") {
            let Some((name, tail)) = after.split_once("`]") else { break };
            let of = |name: &str| pattern.map_or_else(|| name.to_owned(), |pattern| self.of_pattern(pattern, name));
            let name = match name {
                "Harmonics" => of("harmonics"),
                other => snake(other),
            };
            linked.push_str(&format!("{before}`{}`", self.global(&name)));
            rest = tail;
        }
        linked.push_str(rest);
        linked
    }

    pub(super) fn has_constants(&self) -> bool {
        !self.names.constants.is_empty()
    }

    /// The parameters `constants`, where the model has any.
    pub(super) fn constants_parameter(&self, read: bool) -> Option<Parameter> {
        let declaration = format!("const {} *constants", self.global("constants"));
        self.has_constants().then(|| Parameter::read(declaration, "constants", read))
    }

    pub(super) fn constants_argument(&self) -> &'static str {
        if self.has_constants() { ", constants" } else { "" }
    }

    /// The spelling of a leaf; `owner` and `motion` are the prefixes of fields, such as `pattern->`.
    pub(super) fn leaf(&self, leaf: &Leaf, owner: &str, fields: &[(Symbol, String)], motion: &str) -> String {
        match *leaf {
            Leaf::Motion(coordinate, order) => {
                let found = self.names.coordinates.iter().find(|names| names.coordinate == coordinate);
                let coordinate = &found.expect("invariant: the evaluation lists its coordinates").field;
                format!("{motion}{coordinate}.{}", derivative_name(order))
            }
            Leaf::Column(index) => format!("parameters->{}", self.names.columns[index]),
            Leaf::Cos => "cosine".to_owned(),
            Leaf::Sin => "sine".to_owned(),
            Leaf::Signal(equation) => format!("now.{}", self.names.rows[equation].field),
            Leaf::Symbol(symbol) => {
                if let Some((_, field)) = self.names.constants.iter().find(|(present, _)| *present == symbol) {
                    return format!("constants->{field}");
                }
                let found = fields.iter().find(|(present, _)| *present == symbol);
                format!("{owner}{}", found.expect("invariant: the owner has the plan's symbols").1)
            }
            Leaf::Harmonic(_) => {
                unreachable!("invariant: harmonics are read by the pseudo-inverse alone, which spells them itself")
            }
        }
    }

    pub(super) fn zero(&self) -> String {
        self.scalar.literal(0.0)
    }

    /// The text of some steps; `store` gives the target of a result.
    pub(super) fn statements<L: Fn(&Leaf) -> String>(
        &self,
        statements: &[Statement],
        writer: &Writer<L>,
        store: impl Fn(Place) -> String,
    ) -> String {
        let write = |step: &Statement| match step {
            Statement::Comment(text) => comment(1, text),
            Statement::Let(index, value) => {
                statement(1, &format!("const {} t{index} = {};", self.scalar.name(), writer.expression(value)))
            }
            Statement::Store(place, value) => {
                statement(1, &format!("{} = {};", store(*place), writer.expression(value)))
            }
        };
        statements.iter().map(write).collect()
    }

    /// Assignments of zero to all entries that no step stores into, one line for every row.
    pub(super) fn zeros(
        &self,
        rows: usize,
        columns: Option<usize>,
        stored: &[Place],
        name: impl Fn(Place) -> String,
    ) -> String {
        let mut text = String::new();
        let lines: Vec<Vec<Place>> = match columns {
            Some(columns) => {
                (0..rows).map(|row| (0..columns).map(|column| Place::Entry(row, column)).collect()).collect()
            }
            None => vec![(0..rows).map(Place::Value).collect()],
        };
        for line in lines {
            let missing = line.into_iter().filter(|place| !stored.contains(place)).map(&name);
            let missing: Vec<String> = missing.collect();
            if !missing.is_empty() {
                text.push_str(&statement(1, &format!("{} = {};", missing.join(" = "), self.zero())));
            }
        }
        text
    }

    /// A structure of scalars with documented fields.
    pub(super) fn record(&mut self, name: &str, about: &str, fields: &[(String, String)]) {
        let lines: String = fields
            .iter()
            .map(|(field, about)| format!("{}    {} {field};\n", doc(1, about), self.scalar.name()))
            .collect();
        self.structure(name, about, &lines);
    }

    /// A structure.
    pub(super) fn structure(&mut self, name: &str, about: &str, fields: &str) {
        let name = self.global(name);
        self.header.push_str(&format!("\n{}typedef struct {name} {{\n{fields}}} {name};\n", doc(0, about)));
    }

    /// A function: its documentation and declaration go to the header, its definition to the source.
    pub(super) fn function(&mut self, name: &str, about: &str, result: &str, parameters: &[Parameter], body: &str) {
        let list: Vec<&str> = parameters.iter().map(|parameter| parameter.declaration.as_str()).collect();
        let signature = signature(result, name, &list);
        self.header.push_str(&format!("\n{}{signature};\n", doc(0, about)));
        let unused = parameters.iter().filter_map(|parameter| parameter.unused);
        let unused: String = unused.map(|name| statement(1, &format!("(void){name};"))).collect();
        self.source.push_str(&format!("\n{signature}\n{{\n{unused}{body}}}\n"));
    }

    /// The terms of a table and the loop that adds them up; `matrix` is the array to which a term is added.
    pub(super) fn table(
        &self,
        table: &Table,
        spell: &dyn Fn(&Leaf) -> String,
        matrix: &str,
        rows: usize,
        columns: Option<usize>,
    ) -> String {
        let scalar = self.scalar.name();
        let one = self.scalar.literal(1.0);
        let mut text = comment(1, &format!("Row, column, coefficient, powers of {}.", table.order));
        let width = table.bases.len().max(1);
        text.push_str(&format!(
            "    static const struct {{\n        unsigned short row, column;\n        {scalar} coefficient;\n        short powers[{width}];\n    }} terms[] = {{\n"
        ));
        // One line per term.
        for term in &table.terms {
            let (row, column) = match term.place {
                Place::Entry(row, column) => (row, column),
                Place::Value(row) => (row, 0),
            };
            let powers: Vec<String> = term.powers.iter().map(ToString::to_string).collect();
            let powers = if powers.is_empty() { "0".to_owned() } else { powers.join(", ") };
            let coefficient = self.scalar.number(&term.coefficient);
            text.push_str(&format!("        {{{row}, {column}, {coefficient}, {{{powers}}}}},\n"));
        }
        text.push_str("    };\n");
        // The values of the bases.
        let writer = Writer::new(self.scalar, spell);
        let bases = table.bases.iter().map(|base| match base {
            Base::Pi => writer.expression(&Expression::Pi),
            Base::Symbol(symbol) => spell(&Leaf::Symbol(*symbol)),
            Base::Sign(symbol) => format!("sign_of({})", spell(&Leaf::Symbol(*symbol))),
        });
        let bases: Vec<String> = bases.collect();
        let bases = if bases.is_empty() { one.clone() } else { bases.join(", ") };
        text.push_str(&statement(1, &format!("const {scalar} bases[{width}] = {{{bases}}};")));
        text.push_str("    size_t i;\n    size_t j;\n\n");
        // All entries are zero before the terms are added.
        let zero = self.zero();
        match columns {
            Some(columns) => text.push_str(&format!(
                "    for (i = 0; i < (size_t){rows}; ++i) {{\n        for (j = 0; j < (size_t){columns}; ++j) {{\n            {matrix}[i][j] = {zero};\n        }}\n    }}\n"
            )),
            None => text.push_str(&format!("    for (i = 0; i < (size_t){rows}; ++i) {{\n        {matrix}[i] = {zero};\n    }}\n")),
        }
        let target = match columns {
            Some(_) => format!("{matrix}[terms[i].row][terms[i].column]"),
            None => format!("{matrix}[terms[i].row]"),
        };
        text.push_str(&format!(
            "    for (i = 0; i < sizeof terms / sizeof terms[0]; ++i) {{
        {scalar} above = terms[i].coefficient;
        {scalar} below = {one};
        for (j = 0; j < {width}u; ++j) {{
            const int power = terms[i].powers[j];
            if (power < 0) {{
                below *= power_of(bases[j], -power);
            }} else {{
                above *= power_of(bases[j], power);
            }}
        }}
        {target} += above / below;
    }}
"
        ));
        text
    }
}

/// Whether a prefix may begin names and files: ASCII letters, digits and underscores, a letter first.
pub(super) fn is_prefix(prefix: &str) -> bool {
    prefix.starts_with(|first: char| first.is_ascii_alphabetic())
        && prefix.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
        && !prefix.ends_with('_')
}

/// Adds the parameter `constants`, where the model has any; `reads` states whether the function uses it.
pub(super) fn push_constants(parameters: &mut Vec<Parameter>, context: &Context<'_>, reads: Reads) {
    parameters.extend(context.constants_parameter(reads.constants));
}
