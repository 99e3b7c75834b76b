//! Rust source of an estimator: a documented module of straight-line functions, `no_std`, without allocation or panics.
//!
//! Invariants: the numbers come from the plans of [`EstimatorPlan`](tpm_symbolic::plan::estimator::EstimatorPlan), operation by
//! operation; names come from the model through one namer; every array has a length fixed by the model, and every index is a
//! literal, so that no path can panic. The same items serve the macro and the file; only the file has comments and is laid out
//! for reading.

mod campaign;
mod context;
mod dynamics;
mod expression;
mod filter;
mod names;
mod pattern;
mod record;
/// Rust of a regulator.
#[cfg(feature = "generate")]
pub mod regulator;
mod requested;
mod run;
mod run_physical;
mod run_sizes;
mod run_tracking;
mod shapes;
#[cfg(feature = "generate")]
mod support;

use proc_macro2::TokenStream;
use quote::quote;
#[cfg(feature = "generate")]
use std::cell::RefCell;
#[cfg(feature = "generate")]
use tpm_symbolic::expr::graph::Function;

use super::estimator::EstimatorSource;
use super::header;
#[cfg(feature = "generate")]
use super::text;
use context::Context;
pub use context::Options;
use record::doc;

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
    let run = run::items(context);
    let mut attributes = TokenStream::new();
    if context.names.unusual {
        let reason = "fields are named as in the model";
        attributes.extend(quote!(#[allow(non_snake_case, reason = #reason)]));
    }
    if context.estimator.resembles_constant() {
        let reason = "an exact rational that only looks like a known constant";
        attributes.extend(quote!(#[allow(clippy::approx_constant, reason = #reason)]));
    }
    let docs = header::header(context.estimator, context.options.command, &|role| context.function_name(role));
    Module { docs, attributes, items: quote!(#imports #dynamics #filtered #patterns #run) }
}

/// The module `model_name` and the model's type, as the items to which a macro expands. `extra` is added to the module.
#[must_use]
pub fn items(estimator: &EstimatorSource, options: &Options<'_>, extra: &TokenStream) -> TokenStream {
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

/// The name of the module, raw where it is a keyword. The file has the same name without `r#`.
#[must_use]
pub fn module_name(estimator: &EstimatorSource) -> String {
    names::names(estimator).module.to_string()
}

/// A whole source file.
///
/// # Errors
/// When the formatter cannot read the items, which never happens for a model that was parsed from the language.
#[cfg(feature = "generate")]
pub fn file(estimator: &EstimatorSource, options: &Options<'_>) -> Result<String, syn::Error> {
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
    // The generator lays out the text itself. A formatter would make committed files differ from generated ones.
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
        text.push_str(&support::text(support::Needs {
            solves: estimator.plan.patterns.iter().any(|pattern| pattern.table.is_ok()),
            hyperbolic: estimator.calls(Function::Tanh),
            accelerations: estimator.parts.forward_dynamics.is_some(),
            square_root: estimator.parts.estimator,
            monitor: estimator.parts.monitor,
            run: estimator.run.is_some(),
            campaign: estimator.campaign.is_some(),
        }));
    }
    Ok(text)
}

/// The sentence that only the header of a standalone file contains.
#[cfg(feature = "generate")]
const ALONE: &str = "\nBeside `core` it needs the crate `libm`, and nothing else.\n";

/// Whether a blank line belongs between two lines: between the end of an item or a method and the next one.
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
