//! Rust source of an estimator: a documented module of straight-line functions, `no_std`, without allocation or panics.
//!
//! Invariants: the numbers come from the plans of [`EstimatorPlan`](tpm_symbolic::plan::estimator::EstimatorPlan), operation by
//! operation; names come from the model through one namer; every array has a length fixed by the model, and every index is a
//! literal, so that no path can panic. The same items serve the macro and the file; only the file has comments and is laid out
//! for reading.

mod dynamics;
mod expression;
mod filter;
mod names;
mod pattern;
mod record;
#[cfg(feature = "generate")]
mod support;

use proc_macro2::{Ident, TokenStream};
use quote::quote;
use std::cell::RefCell;
use std::str::FromStr;
use tpm_symbolic::plan::leaf::Leaf;

use super::estimator::{Estimator, Identified};
use super::filter::Filters;
use super::function::{Reads, Role};
use super::text;
use names::Names;
use record::doc;

/// How a module is emitted.
#[derive(Clone, Debug)]
pub struct Options<'a> {
    /// What the reader must run to get this code again; stands in the header.
    pub command: &'a str,
    /// Path of the runtime crate in the emitted code.
    pub runtime: &'a str,
    /// Identified values to be baked in.
    pub identified: Option<&'a Identified>,
    /// Low passes of the feed-forward.
    pub filters: Option<&'a Filters>,
    /// The text of the model, for the trait of evaluated models to give back; nothing where it need not be carried along.
    pub source: Option<&'a str>,
    /// Whether a file brings what it needs of the runtime along instead of naming it, and does without the runtime's trait.
    pub standalone: bool,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self {
            command: "tpm generate",
            runtime: "::tpm_runtime",
            identified: None,
            filters: None,
            source: None,
            standalone: false,
        }
    }
}

/// What the writers of the parts share.
struct Context<'a> {
    estimator: &'a Estimator,
    options: &'a Options<'a>,
    names: Names,
    runtime: TokenStream,
    /// Comment texts, by number; `None` where comments would be lost anyway.
    comments: Option<RefCell<Vec<String>>>,
}

impl<'a> Context<'a> {
    fn new(estimator: &'a Estimator, options: &'a Options<'a>, comments: bool) -> Self {
        let names = names::names(estimator);
        let runtime = match options.standalone {
            true => quote!(self::support),
            false => TokenStream::from_str(options.runtime).unwrap_or_else(|_| quote!(::tpm_runtime)),
        };
        let comments = comments.then(RefCell::default);
        Self { estimator, options, names, runtime, comments }
    }

    /// The path of the runtime, or of what stands for it, in a module inside the module.
    fn runtime_inside(&self) -> TokenStream {
        match self.options.standalone {
            true => quote!(super::support),
            false => self.runtime.clone(),
        }
    }

    /// A comment that [`file`] puts in; nothing in a macro, whose tokens cannot carry it.
    fn comment(&self, text: String) -> TokenStream {
        match &self.comments {
            Some(comments) => {
                let mut comments = comments.borrow_mut();
                let number = proc_macro2::Literal::usize_unsuffixed(comments.len());
                comments.push(text);
                quote!(__comment!(#number);)
            }
            None => TokenStream::new(),
        }
    }

    fn has_constants(&self) -> bool {
        !self.names.constants.is_empty()
    }

    /// How a leaf is spelled; `owner` holds the symbols that are not constants.
    fn leaf(&self, leaf: &Leaf, owner: &Ident, fields: &[(tpm_symbolic::expr::graph::Symbol, Ident)]) -> TokenStream {
        match *leaf {
            Leaf::Motion(coordinate, order) => {
                let found = self.names.coordinates.iter().find(|names| names.coordinate == coordinate);
                let coordinate = &found.expect("invariant: the evaluation lists its coordinates").field;
                let derivative = names::derivative_field(order);
                quote!(motion.#coordinate.#derivative)
            }
            Leaf::Column(index) => {
                let column = &self.names.columns[index];
                quote!(parameters.#column)
            }
            Leaf::Cos => quote!(cos),
            Leaf::Sin => quote!(sin),
            Leaf::Signal(equation) => {
                let field = &self.names.rows[equation].field;
                quote!(sample.#field)
            }
            Leaf::Symbol(symbol) => {
                if let Some((_, field)) = self.names.constants.iter().find(|(present, _)| *present == symbol) {
                    return quote!(constants.#field);
                }
                let found = fields.iter().find(|(present, _)| *present == symbol);
                let field = &found.expect("invariant: the owner has the plan's symbols").1;
                quote!(#owner.#field)
            }
            _ => unreachable!("invariant: harmonics are read by the pseudo-inverse alone, which spells them itself"),
        }
    }

    /// `constants: &Constants<T>,` where the model has any.
    fn constants_parameter(&self, reads: Reads) -> TokenStream {
        match (self.has_constants(), reads.constants) {
            (false, _) => quote!(),
            (true, true) => quote!(constants: &Constants<T>,),
            (true, false) => quote!(_constants: &Constants<T>,),
        }
    }

    /// The same where they are handed on.
    fn constants_handed_on(&self) -> TokenStream {
        self.constants_parameter(Reads { constants: true, ..Reads::default() })
    }

    /// How a function is called in documentation.
    fn function_name(&self, role: Role) -> String {
        let of = |pattern: usize, name: &str| match &self.names.patterns[pattern].module {
            Some(module) => format!("{module}::{name}"),
            None => name.to_owned(),
        };
        match role {
            Role::Regressor => "regressor".to_owned(),
            Role::Known => "known".to_owned(),
            Role::InputMap => "input_map".to_owned(),
            Role::InverseDynamics => "inverse_dynamics".to_owned(),
            Role::FeedForward => "feed_forward".to_owned(),
            Role::FeedForwardIndependent => "feed_forward_independent".to_owned(),
            Role::FeedForwardDependent => "feed_forward_dependent".to_owned(),
            Role::Lump => "Physical::lump".to_owned(),
            Role::Unlump => "Parameters::unlump".to_owned(),
            Role::Reference(pattern) => of(pattern, "Pattern::reference_from"),
            Role::EstimatorMatrix(pattern) => of(pattern, "Pattern::estimator_matrix"),
            Role::Accumulate(pattern) => of(pattern, "Accumulator::push_at"),
        }
    }

    fn constants_argument(&self) -> TokenStream {
        if self.has_constants() { quote!(constants,) } else { quote!() }
    }
}

/// A module: its own documentation, and its items.
struct Module {
    docs: String,
    attributes: TokenStream,
    items: TokenStream,
}

fn module(context: &Context<'_>) -> Module {
    let imports = dynamics::imports(context);
    let dynamics = dynamics::items(context);
    let filtered = filter::items(context);
    let patterns = pattern::items(context);
    let mut attributes = TokenStream::new();
    if context.names.unusual {
        let reason = "fields are named as in the model";
        attributes.extend(quote!(#[allow(non_snake_case, reason = #reason)]));
    }
    if context.estimator.resembles_constant() {
        let reason = "an exact rational that only looks like a known constant";
        attributes.extend(quote!(#[allow(clippy::approx_constant, reason = #reason)]));
    }
    let docs = text::header(context.estimator, context.options.command, &|role| context.function_name(role));
    Module { docs, attributes, items: quote!(#imports #dynamics #filtered #patterns) }
}

/// The module `model_name` and the model's type, as items for a macro to expand to. `extra` goes into the module.
#[must_use]
pub fn items(estimator: &Estimator, options: &Options<'_>, extra: &TokenStream) -> TokenStream {
    let context = Context::new(estimator, options, false);
    let Module { docs, attributes, items } = module(&context);
    let (name, model_type, docs) = (&context.names.module, &context.names.model_type, doc(&docs));
    quote! {
        #docs
        #attributes
        pub mod #name {
            #items
            #extra
        }
        pub use #name::#model_type;
    }
}

/// The name of the module, raw where it is a keyword; without `r#` that of the file.
#[must_use]
pub fn module_name(estimator: &Estimator) -> String {
    names::names(estimator).module.to_string()
}

/// A whole source file.
///
/// # Errors
/// Never for a model that came through the language; the error of the formatter otherwise.
#[cfg(feature = "generate")]
pub fn file(estimator: &Estimator, options: &Options<'_>) -> Result<String, syn::Error> {
    let context = Context::new(estimator, options, true);
    let Module { docs, attributes, items } = module(&context);
    let parsed: syn::File = syn::parse2(items)?;
    let mut text = String::new();
    let docs = if options.standalone { docs + ALONE } else { docs };
    for line in text::filled(&docs, record::WIDTH) {
        let line = line.as_str();
        text.push_str(if line.is_empty() { "//!" } else { "//! " });
        text.push_str(line);
        text.push('\n');
    }
    text.push('\n');
    // Laid out by the generator; a formatter would make committed output differ from generated output.
    text.push_str("#![cfg_attr(rustfmt, rustfmt_skip)]\n");
    let inner = attributes.to_string().replace("# [", "#! [");
    for attribute in syn::parse_str::<syn::File>(&inner)?.attrs {
        let bare = syn::File { shebang: None, attrs: vec![attribute], items: Vec::new() };
        text.push_str(&prettyplease::unparse(&bare));
    }
    text.push('\n');
    let comments = context.comments.map(RefCell::into_inner).unwrap_or_default();
    let mut previous = "";
    for line in prettyplease::unparse(&parsed).lines() {
        if is_apart(previous, line) {
            text.push('\n');
        }
        previous = line;
        match line.trim_start().strip_prefix("__comment!(").and_then(|rest| rest.strip_suffix(");")) {
            Some(number) => {
                let indent = &line[..line.len() - line.trim_start().len()];
                let comment = number.parse().ok().and_then(|number: usize| comments.get(number));
                for part in text::filled(comment.map_or("", String::as_str), record::WIDTH) {
                    text.push_str(indent);
                    text.push_str("// ");
                    text.push_str(&part);
                    text.push('\n');
                }
            }
            None => {
                text.push_str(line);
                text.push('\n');
            }
        }
    }
    if options.standalone {
        text.push_str(&support::text(estimator.plan.patterns.iter().any(|pattern| pattern.table.is_ok())));
    }
    Ok(text)
}

/// What the header of a file says that stands alone.
#[cfg(feature = "generate")]
const ALONE: &str = "\nBeside `core` it needs the crate `libm`, and nothing else.\n";

/// Whether a blank line belongs between two lines: after what closes or ends an item or a method, before the next one.
#[cfg(feature = "generate")]
fn is_apart(previous: &str, line: &str) -> bool {
    let indent = line.len() - line.trim_start().len();
    let begins =
        ["///", "#[", "pub ", "fn ", "impl", "use ", "const "].iter().any(|start| line[indent..].starts_with(start));
    let ended = previous.get(indent..).is_some_and(|end| {
        previous[..indent].trim().is_empty() && ["}", "};", "];"].contains(&end)
            || (end.ends_with(';') && ["use ", "pub const ", "pub struct "].iter().any(|start| end.starts_with(start)))
    });
    let both_import = previous.trim_start().starts_with("use ") && line[indent..].starts_with("use ");
    begins && ended && !both_import
}
