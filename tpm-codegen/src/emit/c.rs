//! C99 of an estimator: a header with types, documentation and declarations, and a source with straight-line functions.
//!
//! Invariants: the steps of every function are those that Rust is printed from; all memory is the
//! caller's; nothing of the C library is used but `math.h`. Every name that other translation units can see begins with the
//! prefix, and every field comes from the model through one namer.

mod dynamics;
mod expression;
mod filter;
mod layout;
mod pattern;
mod solve;

use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::plan::leaf::Leaf;

use super::code::{Expression, Place, Statement, Table};
use super::estimator::{EmitError, Estimator, Identified};
use super::filter::Filters;
use super::function::{Reads, Role};
use super::name::{Language, Namer, snake};
use super::names::{Names, Style, derivative_name};
use super::text;
pub use expression::Scalar;
use expression::Writer;
use layout::{comment, doc, signature, statement};

/// How C is emitted.
#[derive(Clone, Debug)]
pub struct Options<'a> {
    /// What the reader must run to get this code again; stands in the header.
    pub command: &'a str,
    /// What names and files begin with; the model's name in small letters when not given.
    pub prefix: Option<&'a str>,
    /// The scalar.
    pub scalar: Scalar,
    /// Identified values to be baked in.
    pub identified: Option<&'a Identified>,
    /// Low passes of the feed-forward.
    pub filters: Option<&'a Filters>,
}

/// Header and source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Files {
    /// Their name, without the extension.
    pub name: String,
    /// The header.
    pub header: String,
    /// The source.
    pub source: String,
}

/// What the functions and types of the dynamics are called behind the prefix: no name of a model may be one of them.
const DYNAMICS: [&str; 34] = [
    "common_feed_forward",
    "common_feed_forward_settle",
    "common_filters",
    "constants",
    "coordinate_labels",
    "constant_labels",
    "dependent_low_pass",
    "equation_labels",
    "estimate",
    "feed_forward",
    "feed_forward_dependent",
    "feed_forward_independent",
    "feed_forward_with_regressor",
    "forces",
    "identified",
    "independent_low_pass",
    "input_labels",
    "input_map",
    "inputs",
    "inverse_dynamics",
    "known",
    "label",
    "low_pass",
    "low_pass_settle",
    "lump",
    "motion",
    "parameter_labels",
    "parameters",
    "physical",
    "regressor",
    "split_feed_forward",
    "split_feed_forward_settle",
    "split_filters",
    "unlump",
];

/// The same of a pattern.
const PATTERN: [&str; 20] = [
    "accumulate",
    "accumulate_at",
    "accumulate_hann",
    "accumulated",
    "accumulator",
    "accumulator_clear",
    "estimator_matrix",
    "harmonics",
    "identify",
    "identify_direct",
    "known_harmonics",
    "pattern",
    "period",
    "reference",
    "reference_at",
    "reference_from",
    "solve",
    "status",
    "transform",
    "workspace",
];

/// What the writers of the parts share, and what they have written.
struct Context<'a> {
    estimator: &'a Estimator,
    scalar: Scalar,
    names: Names<String>,
    prefix: String,
    identified: Option<&'a Identified>,
    filters: Option<&'a Filters>,
    /// Types, declarations and their documentation.
    header: String,
    /// Definitions.
    source: String,
}

/// A parameter of a function.
#[derive(Clone, Debug)]
struct Parameter {
    /// Its declaration, such as `const double x`.
    declaration: String,
    /// Its name, when the body does not read it.
    unused: Option<&'static str>,
}

impl Parameter {
    fn new(declaration: impl Into<String>) -> Self {
        Self { declaration: declaration.into(), unused: None }
    }

    fn read(declaration: impl Into<String>, name: &'static str, read: bool) -> Self {
        Self { declaration: declaration.into(), unused: (!read).then_some(name) }
    }
}

impl<'a> Context<'a> {
    fn new(estimator: &'a Estimator, options: &Options<'a>) -> Result<Self, EmitError> {
        let prefix = match options.prefix {
            Some(prefix) if is_prefix(prefix) => prefix.to_owned(),
            Some(prefix) => return Err(EmitError::Prefix(prefix.to_owned())),
            None => {
                let name = Namer::new(Language::C, &[]).name(&snake(&estimator.model.name));
                name.trim_end_matches('_').to_owned()
            }
        };
        let mut reserved: Vec<String> = DYNAMICS.iter().map(|&name| name.to_owned()).collect();
        let patterns = estimator.plan.patterns.iter().filter_map(|pattern| pattern.name.as_deref());
        for part in std::iter::once(String::new()).chain(patterns.map(|name| format!("{}_", snake(name)))) {
            reserved.extend(PATTERN.iter().map(|name| format!("{part}{name}")));
        }
        let reserved: Vec<&str> = reserved.iter().map(String::as_str).collect();
        let mut types = Namer::new(Language::C, &reserved);
        let mut style = Style {
            language: Language::C,
            type_name: &mut |wanted, suffix| types.name(&format!("{}_{}", snake(wanted), snake(suffix))),
            reserved: &[],
        };
        let mut names = Names::new(&mut style, &estimator.model, &estimator.form, &estimator.plan);
        // A pattern's name stands between others, so that no keyword can meet it.
        let mut taken: Vec<String> = Vec::new();
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
            header: String::new(),
            source: String::new(),
        })
    }

    /// A name with the prefix.
    fn global(&self, name: &str) -> String {
        format!("{}_{name}", self.prefix)
    }

    /// A macro with the prefix.
    fn constant(&self, name: &str) -> String {
        format!("{}_{name}", self.prefix.to_uppercase())
    }

    /// The name of something that belongs to a pattern, without the prefix.
    fn of_pattern(&self, pattern: usize, name: &str) -> String {
        match &self.names.patterns[pattern].module {
            Some(module) => format!("{module}_{name}"),
            None => name.to_owned(),
        }
    }

    /// How a function is called.
    fn function_name(&self, role: Role) -> String {
        self.global(&match role {
            Role::Regressor => "regressor".to_owned(),
            Role::Known => "known".to_owned(),
            Role::InputMap => "input_map".to_owned(),
            Role::InverseDynamics => "inverse_dynamics".to_owned(),
            Role::FeedForward => "feed_forward".to_owned(),
            Role::FeedForwardIndependent => "feed_forward_independent".to_owned(),
            Role::FeedForwardDependent => "feed_forward_dependent".to_owned(),
            Role::Lump => "lump".to_owned(),
            Role::Unlump => "unlump".to_owned(),
            Role::Reference(pattern) => self.of_pattern(pattern, "reference_from"),
            Role::EstimatorMatrix(pattern) => self.of_pattern(pattern, "estimator_matrix"),
            Role::Accumulate(pattern) => self.of_pattern(pattern, "accumulate_at"),
        })
    }

    /// A text with its links as names of this code; `pattern` is the one whose types are meant.
    fn linked(&self, text: &str, pattern: Option<usize>) -> String {
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

    fn has_constants(&self) -> bool {
        !self.names.constants.is_empty()
    }

    /// The parameters `constants`, where the model has any.
    fn constants_parameter(&self, read: bool) -> Option<Parameter> {
        let declaration = format!("const {} *constants", self.global("constants"));
        self.has_constants().then(|| Parameter::read(declaration, "constants", read))
    }

    fn constants_argument(&self) -> &'static str {
        if self.has_constants() { ", constants" } else { "" }
    }

    /// How a leaf is spelled; `owner` and `motion` say what stands before their fields, such as `pattern->`.
    fn leaf(&self, leaf: &Leaf, owner: &str, fields: &[(Symbol, String)], motion: &str) -> String {
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
            _ => unreachable!("invariant: harmonics are read by the pseudo-inverse alone, which spells them itself"),
        }
    }

    fn zero(&self) -> String {
        self.scalar.literal(0.0)
    }

    /// Steps; `store` says where a result goes.
    fn statements<L: Fn(&Leaf) -> String>(
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

    /// Assignments of zero to everything that no step stores into, one line for every row.
    fn zeros(&self, rows: usize, columns: Option<usize>, stored: &[Place], name: impl Fn(Place) -> String) -> String {
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
    fn record(&mut self, name: &str, about: &str, fields: &[(String, String)]) {
        let lines: String = fields
            .iter()
            .map(|(field, about)| format!("{}    {} {field};\n", doc(1, about), self.scalar.name()))
            .collect();
        self.structure(name, about, &lines);
    }

    /// A structure.
    fn structure(&mut self, name: &str, about: &str, fields: &str) {
        let name = self.global(name);
        self.header.push_str(&format!("\n{}typedef struct {name} {{\n{fields}}} {name};\n", doc(0, about)));
    }

    /// A function: its documentation and declaration in the header, its definition in the source.
    fn function(&mut self, name: &str, about: &str, result: &str, parameters: &[Parameter], body: &str) {
        let list: Vec<&str> = parameters.iter().map(|parameter| parameter.declaration.as_str()).collect();
        let signature = signature(result, name, &list);
        self.header.push_str(&format!("\n{}{signature};\n", doc(0, about)));
        let unused = parameters.iter().filter_map(|parameter| parameter.unused);
        let unused: String = unused.map(|name| statement(1, &format!("(void){name};"))).collect();
        self.source.push_str(&format!("\n{signature}\n{{\n{unused}{body}}}\n"));
    }

    /// The terms of a table and the loop that adds them up; `target` is what a term is added to.
    fn table(
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
        let writer = Writer::new(self.scalar, spell);
        let bases = table.bases.iter().map(|base| match base {
            super::code::Base::Pi => writer.expression(&Expression::Pi),
            super::code::Base::Symbol(symbol) => spell(&Leaf::Symbol(*symbol)),
            super::code::Base::Sign(symbol) => format!("sign_of({})", spell(&Leaf::Symbol(*symbol))),
        });
        let bases: Vec<String> = bases.collect();
        let bases = if bases.is_empty() { one.clone() } else { bases.join(", ") };
        text.push_str(&statement(1, &format!("const {scalar} bases[{width}] = {{{bases}}};")));
        text.push_str("    size_t i, j;\n\n");
        let zero = self.zero();
        match columns {
            Some(columns) => text.push_str(&format!(
                "    for (i = 0; i < {rows}; ++i) {{\n        for (j = 0; j < {columns}; ++j) {{\n            {matrix}[i][j] = {zero};\n        }}\n    }}\n"
            )),
            None => text.push_str(&format!("    for (i = 0; i < {rows}; ++i) {{\n        {matrix}[i] = {zero};\n    }}\n")),
        }
        let target = match columns {
            Some(_) => format!("{matrix}[terms[i].row][terms[i].column]"),
            None => format!("{matrix}[terms[i].row]"),
        };
        text.push_str(&format!(
            "    for (i = 0; i < sizeof terms / sizeof terms[0]; ++i) {{
        {scalar} above = terms[i].coefficient;
        {scalar} below = {one};
        for (j = 0; j < {width}; ++j) {{
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
fn is_prefix(prefix: &str) -> bool {
    prefix.starts_with(|first: char| first.is_ascii_alphabetic())
        && prefix.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
        && !prefix.ends_with('_')
}

/// Header and source of an estimator.
///
/// # Errors
/// When the prefix is none, a number is beyond the scalar's precision, or the model has nothing that a structure could hold.
pub fn files(estimator: &Estimator, options: &Options<'_>) -> Result<Files, EmitError> {
    let mut context = Context::new(estimator, options)?;
    if let Some(lost) = estimator.numbers().find(|value| context.scalar.loses(value)) {
        return Err(EmitError::OutOfScalar(Scalar::display(lost)));
    }
    if let Some(identified) = options.identified {
        let values = identified.in_order(estimator)?;
        if let Some(lost) = values.iter().find(|parameter| !context.scalar.holds(parameter.value)) {
            return Err(EmitError::OutOfScalar(format!("{} of `{}`", lost.value, lost.name)));
        }
    }
    let empty = [
        (context.names.coordinates.is_empty(), "no coordinate in its equations"),
        (context.names.columns.is_empty(), "no parameter that is estimated"),
    ];
    if let Some((_, what)) = empty.into_iter().find(|(empty, _)| *empty) {
        return Err(EmitError::Empty(what));
    }
    dynamics::write(&mut context);
    filter::write(&mut context);
    pattern::write(&mut context);
    let about = text::header(estimator, options.command, &|role| context.function_name(role));
    let guard = context.constant("H_INCLUDED");
    let sizes = dynamics::sizes(&context);
    let header = format!(
        "{}#ifndef {guard}\n#define {guard}\n\n#include <stddef.h>\n#include <stdint.h>\n\n#ifdef __cplusplus\nextern \"C\" {{\n#endif\n\n{sizes}{}\n#ifdef __cplusplus\n}}\n#endif\n\n#endif\n",
        doc(0, &about),
        context.header,
    );
    let helpers = helpers(&context);
    let name = &context.prefix;
    let about = format!(
        "`{}`: what `{name}.h` declares. Generated by\n`{}`; to change it, change the model.",
        estimator.model.name, options.command
    );
    let mut source = format!("{}#include \"{name}.h\"\n\n", doc(0, &about));
    if context.source.contains("_EPSILON") {
        source.push_str("#include <float.h>\n");
    }
    source.push_str(&format!("#include <math.h>\n{helpers}{}", context.source));
    Ok(Files { name: context.prefix, header, source })
}

/// Functions of the source that only some models need.
fn helpers(context: &Context<'_>) -> String {
    let scalar = context.scalar.name();
    let (zero, one) = (context.zero(), context.scalar.literal(1.0));
    let mut text = String::new();
    if context.source.contains("sign_of(") {
        text.push_str(&format!(
            "
/* -1, 0 or 1; not a number stays so. */
static {scalar} sign_of({scalar} x)
{{
    return x > {zero} ? {one} : x < {zero} ? -{one} : x + {zero};
}}
"
        ));
    }
    if context.source.contains("power_of(") {
        text.push_str(&format!(
            "
/* x to a whole power that is not negative, by repeated squaring. */
static {scalar} power_of({scalar} x, int power)
{{
    {scalar} result = {one};
    while (power > 0) {{
        if (power % 2 != 0) {{
            result *= x;
        }}
        x *= x;
        power /= 2;
    }}
    return result;
}}
"
        ));
    }
    text
}

/// What a function reads of constants, as a parameter.
fn push_constants(parameters: &mut Vec<Parameter>, context: &Context<'_>, reads: Reads) {
    parameters.extend(context.constants_parameter(reads.constants));
}
