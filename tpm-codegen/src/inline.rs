//! The expansions of the macros `model!` and `model_file!`.
//!
//! Invariant: every fault becomes a `compile_error!`, several at once; nothing panics, and no fault hides the place of
//! another.

mod request;

use proc_macro2::{Literal, Span, TokenStream, TokenTree};
use quote::{quote, quote_spanned};
use request::{Fault, Request, is_punct};
use std::path::Path;

use crate::diagnostic::{Diagnostics, Severity};
use crate::emit::estimator::EstimatorSource;
use crate::emit::rust;
use crate::language::{parse_model, parse_tokens};
use crate::source::Source;
use tpm_symbolic::budget::{self, Budget};

fn errors(faults: impl IntoIterator<Item = Fault>) -> TokenStream {
    let items = faults.into_iter().map(|(span, message)| {
        let message = Literal::string(&message);
        quote_spanned!(span => ::core::compile_error! { #message })
    });
    items.collect()
}

/// The expansion of `model! { [option;] ... model Name { ... } }`, with its options.
#[must_use]
pub fn model(input: TokenStream) -> TokenStream {
    within_budget(|| of_model(input))
}

/// Limit of a macro call, as a multiple of the command line's budget. A macro call has no option for a larger limit.
const BUDGETS: u64 = 30;

/// The expansion, or an error where it exceeds its budget, since a compiler that does not end gives no message.
fn within_budget(expansion: impl FnOnce() -> TokenStream) -> TokenStream {
    let mut budget = Budget::default();
    budget.operations *= BUDGETS;
    budget::run(budget, expansion).unwrap_or_else(|halted| errors([(Span::call_site(), halted.to_string())]))
}

fn of_model(input: TokenStream) -> TokenStream {
    let mut tokens = input.into_iter().peekable();
    let mut request = Request::default();
    while tokens.peek().is_some_and(Request::begins) {
        let head = tokens.by_ref().take_while(|token| !is_punct(token, ';')).collect::<Vec<TokenTree>>();
        if let Err(fault) = request.take(&head) {
            return errors([fault]);
        }
    }
    let (parsed, tokens) = match parse_tokens("model!", tokens.collect()) {
        Ok(parsed) => parsed,
        Err(errors) => return errors,
    };
    let text = parsed.ast.to_string();
    match EstimatorSource::of(&parsed) {
        Ok(estimator) => {
            let estimator = match request.parts_of(estimator) {
                Ok(estimator) => estimator,
                Err(fault) => return errors([fault]),
            };
            let values = match request.values_of(&estimator) {
                Ok(values) => values,
                Err(fault) => return errors([fault]),
            };
            let options = rust::Options {
                command: "tpm_runtime::model!",
                source: Some(&text),
                identified: values.as_ref(),
                ..request.options()
            };
            rust::items(&estimator, &options, &TokenStream::new())
        }
        Err(diagnostic) => tokens.compile_errors(&Diagnostics::from_iter([diagnostic])),
    }
}

/// The expansion of `model_file!("path/to/x.tpm" [, option] ...)`; `folder` is the root of the package that calls it.
#[must_use]
pub fn model_file(input: TokenStream, folder: Option<&Path>) -> TokenStream {
    within_budget(|| of_model_file(input, folder))
}

fn of_model_file(input: TokenStream, folder: Option<&Path>) -> TokenStream {
    let (literal, path, request) = match file_arguments(input) {
        Ok(arguments) => arguments,
        Err(fault) => return errors([fault]),
    };
    let Some(folder) = folder else {
        let message =
            "CARGO_MANIFEST_DIR is not set, so that a relative path leads nowhere; build with cargo".to_owned();
        return errors([(literal, message)]);
    };
    let bytes = match std::fs::read(folder.join(&path)) {
        Ok(bytes) => bytes,
        Err(error) => {
            let message = format!(
                "cannot read `{}`: {error}; the path is relative to the folder of the package's Cargo.toml, {}",
                path,
                folder.display()
            );
            return errors([(literal, message)]);
        }
    };
    let source = Source::from_bytes(path.as_str(), bytes);
    let parsed = match parse_model(&source) {
        Ok(parsed) => parsed,
        Err(diagnostics) => return errors(at_places(&source, &diagnostics, literal)),
    };
    match EstimatorSource::of(&parsed) {
        Ok(estimator) => {
            let estimator = match request.parts_of(estimator) {
                Ok(estimator) => estimator,
                Err(fault) => return errors([fault]),
            };
            let values = match request.values_of(&estimator) {
                Ok(values) => values,
                Err(fault) => return errors([fault]),
            };
            let options = rust::Options {
                command: "tpm_runtime::model_file!",
                source: Some(source.text()),
                identified: values.as_ref(),
                ..request.options()
            };
            // The compiler tracks included files, so that a change of the model file rebuilds the crate.
            let watch = quote! {
                const _: &[u8] = ::core::include_bytes!(::core::concat!(::core::env!("CARGO_MANIFEST_DIR"), "/", #path));
            };
            rust::items(&estimator, &options, &watch)
        }
        Err(diagnostic) => errors(at_places(&source, &Diagnostics::from_iter([diagnostic]), literal)),
    }
}

/// The errors of a model file, each with file, line and column, reported at the macro's token `span`.
fn at_places(source: &Source, diagnostics: &Diagnostics, span: Span) -> Vec<Fault> {
    let errors = diagnostics.iter().filter(|diagnostic| diagnostic.severity == Severity::Error);
    let mut faults: Vec<Fault> = errors
        .map(|diagnostic| {
            let place = source.position(diagnostic.span.start);
            (span, format!("{}:{}:{}: {}", source.name(), place.line, place.column, diagnostic.headline()))
        })
        .collect();
    if diagnostics.omitted() > 0 {
        faults.push((span, format!("and {} more", diagnostics.omitted())));
    }
    faults
}

/// The arguments of `model_file!`: the span of the path's literal, the path, and what is asked for beside the model.
fn file_arguments(input: TokenStream) -> Result<(Span, String, Request), Fault> {
    let usage = "write model_file!(\"path/to/model.tpm\"), the path relative to the folder of the package's Cargo.toml";
    let mut tokens = input.into_iter();
    let first = tokens.next().ok_or_else(|| (Span::call_site(), usage.to_owned()))?;
    let span = first.span();
    let path = string_of(&first).ok_or_else(|| (span, usage.to_owned()))?;
    if let Some(comma) = tokens.next().filter(|token| !is_punct(token, ',')) {
        return Err((comma.span(), usage.to_owned()));
    }
    let mut request = Request::default();
    let rest: Vec<TokenTree> = tokens.collect();
    for argument in rest.split(|token| is_punct(token, ',')) {
        match argument.first() {
            Some(word) if !Request::begins(word) => {
                return Err((word.span(), usage.to_owned()));
            }
            _ => request.take(argument)?,
        }
    }
    Ok((span, path, request))
}

/// The text of a string literal, also inside the invisible group in which a `macro_rules` fragment passes it on.
fn string_of(token: &TokenTree) -> Option<String> {
    match token {
        TokenTree::Group(group) => {
            let mut inner = group.stream().into_iter();
            let (Some(only), None) = (inner.next(), inner.next()) else { return None };
            string_of(&only)
        }
        TokenTree::Literal(literal) => {
            let text = literal.to_string();
            let raw = text.strip_prefix('r').map(|rest| rest.trim_matches('#'));
            if let Some(inner) = raw.and_then(|rest| rest.strip_prefix('"')).and_then(|rest| rest.strip_suffix('"')) {
                return Some(inner.to_owned());
            }
            let inner = text.strip_prefix('"')?.strip_suffix('"')?;
            // Paths need no other escapes; a stray backslash would be an unreadable path and is reported as one.
            Some(inner.replace("\\\\", "\\").replace("\\\"", "\""))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::{model, model_file};
    use proc_macro2::TokenStream;
    use std::path::Path;

    fn expand_file(arguments: &str, folder: Option<&Path>) -> String {
        model_file(arguments.parse::<TokenStream>().expect("tokens"), folder).to_string()
    }

    #[test]
    fn wrong_arguments_say_what_to_write() {
        for arguments in ["", "x", "1", "\"a.tpm\" b", "\"a.tpm\", b = c", "\"a.tpm\", crate = a, b"] {
            let expansion = expand_file(arguments, Some(Path::new(".")));
            assert!(
                expansion.contains("compile_error") && expansion.contains("model_file!"),
                "{arguments}: {expansion}"
            );
        }
        assert!(expand_file("\"a.tpm\", crate = 1", Some(Path::new("."))).contains("crate = path"));
        assert!(expand_file("\"absent.tpm\"", Some(Path::new("."))).contains("cannot read `absent.tpm`"));
        assert!(expand_file("\"absent.tpm\"", None).contains("CARGO_MANIFEST_DIR"));
        let expansion = model("crate = ; model A {}".parse().expect("tokens")).to_string();
        assert!(expansion.contains("crate = path"), "{expansion}");
    }

    #[test]
    fn faults_of_a_file_have_their_lines() {
        let folder = tempfile::tempdir().expect("a folder");
        let text = "model A {\n  coordinate x;\n  input u;\n  parameter m;\n  m*ddot(y) = u;\n  m*ddot(z) = u;\n}\n";
        std::fs::write(folder.path().join("a.tpm"), text).expect("written");
        let expansion = expand_file("r\"a.tpm\"", Some(folder.path()));
        assert!(expansion.contains("a.tpm:5:") && expansion.contains("a.tpm:6:"), "{expansion}");
    }

    #[test]
    fn parts_are_made_on_request_and_faults_are_those_of_their_words() {
        let model_of = |head: &str| {
            let text = format!(
                "{head} model A {{ coordinate x; input u; parameter m, d; m*ddot(x) + d*dot(x) = u; pattern {{ amplitude a; frequency w; x = rest_to_rest(a, w, 3); }} }}"
            );
            model(text.parse().expect("tokens")).to_string()
        };
        let plain = model_of("");
        assert!(!plain.contains("mod run") && !plain.contains("fn mass_matrix") && !plain.contains("fn stroke"));
        let all = model_of(
            "crate = my::rt; with(run, campaign, mass_matrix, forward_dynamics, estimator, monitor, strokes, forgetting);",
        );
        for word in [
            "mod run",
            "struct Campaign",
            "fn mass_matrix",
            "fn forward_dynamics",
            "BaseEstimator",
            "fn stroke",
            "fn fade",
        ] {
            assert!(all.contains(word), "{word}");
        }
        assert!(all.contains("my :: rt :: support ::") && syn::parse_str::<syn::File>(&all).is_ok());
        let filtered =
            model_of("filter(100:0.7, sample_time = 1e-3, independent = 50); identified(m = 2.5, d = 1e-1);");
        assert!(!plain.contains("IDENTIFIED") && !plain.contains("rad/s, quality"));
        for word in ["IDENTIFIED : Parameters < f64 > = Parameters", "50 rad/s, quality"] {
            assert!(filtered.contains(word), "{word}: {filtered}");
        }
        for (head, wanted) in [
            ("filter(100);", "write `filter("),
            ("filter(-1, sample_time = 1e-3);", "natural frequency of a low pass must be positive"),
            ("filter(100:x, sample_time = 1e-3);", "`x` is not a number"),
            ("filter(4e3, sample_time = 1e-3);", "needs more than two samples per turn"),
            ("filter(100, sample_time = 1e-3, other = 1);", "write `filter("),
            ("identified(m = 2);", "d"),
            ("identified(m = 2, e = 1);", "there is no parameter `e`; there are m, d"),
            ("identified(m = 2, m = 1, d = 1);", "`m` has two values"),
            ("identified(m);", "write `identified("),
            ("with(run); with(strokes); crate = a; crate = b;", "`crate` stands twice"),
            ("filter(100, sample_time = 1e-3); filter(50, sample_time = 1e-3);", "`filter` stands twice"),
        ] {
            let expansion = model_of(head);
            assert!(expansion.contains("compile_error") && expansion.contains(wanted), "{head}: {expansion}");
        }
        let unknown = model_of("with(runn);");
        assert!(
            unknown.contains("there is no part `runn`") && unknown.contains("campaign, monitor, strokes"),
            "{unknown}"
        );
        assert!(model_of("with run;").contains("write `with("));
        let none = "with(campaign); model A { coordinate x; input u; parameter m; m*ddot(x) = u; }";
        let none = model(none.parse().expect("tokens")).to_string();
        assert!(none.contains("there is no campaign: the model has no pattern"), "{none}");
    }

    #[test]
    fn the_runtime_can_be_elsewhere() {
        let text = "crate = my::rt; model A { coordinate x; input u; parameter m; m*ddot(x) = u; }";
        let expansion = model(text.parse().expect("tokens")).to_string();
        assert!(expansion.contains("use my :: rt ::") && !expansion.contains("tpm_runtime ::"), "{expansion}");
    }
}
