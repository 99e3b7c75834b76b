//! What a macro call asks for beside its model: the options of `tpm generate`.
//!
//! Invariant: a fault is that of the word that asks for what cannot be, with the text of the command line.

use proc_macro2::{Span, TokenStream, TokenTree};
use std::collections::BTreeMap;

use crate::emit::estimator::{EstimatorSource, Identified, Part};
use crate::emit::filter::{Filters, LowPass};
use crate::emit::rust;
use tpm_symbolic::number::rational::{self, Rational};

/// A fault of a macro call: the token and the message.
pub(super) type Fault = (Span, String);

/// How a filter is written.
const FILTER: &str = "write `filter(W[:Q], sample_time = T[, independent = W[:Q]])` with rad/s, the quality, and seconds between samples";
/// How values are written.
const IDENTIFIED: &str = "write `identified(NAME = VALUE, ...)` with a value for every parameter";

/// Values by name, each with the word of its name.
type Values = BTreeMap<String, (Span, f64)>;

/// What a macro call asks for:
///
/// - `crate = path` for the runtime,
/// - `with(part, ...)` for parts, strokes and forgetting,
/// - `filter(W[:Q], sample_time = T[, independent = W[:Q]])` for the feed-forward behind low passes,
/// - `identified(NAME = VALUE, ...)` for values that the code contains as a constant.
pub(super) struct Request {
    runtime: Option<String>,
    /// The parts, each with the word that asks for it.
    parts: Vec<(Span, Part)>,
    /// The words that ask for strokes and for forgetting.
    strokes: Option<Span>,
    forgetting: Option<Span>,
    filters: Option<(Span, Filters)>,
    /// Values by name, with the word that begins them and those of the names.
    values: Option<(Span, Values)>,
}

impl Default for Request {
    fn default() -> Self {
        let (parts, filters, values) = (Vec::new(), None, None);
        Self { runtime: None, parts, strokes: None, forgetting: None, filters, values }
    }
}

impl Request {
    /// Whether an option begins with this token.
    pub(super) fn begins(token: &TokenTree) -> bool {
        ["crate", "with", "filter", "identified"].into_iter().any(|name| is_ident(token, name))
    }

    /// Takes in an option.
    pub(super) fn take(&mut self, tokens: &[TokenTree]) -> Result<(), Fault> {
        let Some((first, rest)) = tokens.split_first() else { return Ok(()) };
        let at = first.span();
        let group = match rest {
            [TokenTree::Group(group)] => Some(group.stream()),
            _ => None,
        };
        let once = |is_there: bool| match is_there {
            true => Err((at, format!("`{first}` stands twice; write it once"))),
            false => Ok(()),
        };
        match (first.to_string().as_str(), group) {
            ("crate", _) => {
                once(self.runtime.is_some())?;
                self.runtime = Some(crate_path(at, rest.iter().cloned().collect())?);
            }
            ("filter", Some(group)) => {
                once(self.filters.is_some())?;
                self.filters = Some((at, filters(at, group)?));
                self.parts.push((at, Part::Split));
            }
            ("identified", Some(group)) => {
                once(self.values.is_some())?;
                self.values = Some((at, values(at, group)?));
            }
            ("with", Some(group)) => group.into_iter().try_for_each(|token| self.word(&token))?,
            ("filter", None) => return Err((at, FILTER.to_owned())),
            ("identified", None) => return Err((at, IDENTIFIED.to_owned())),
            _ => return Err((at, format!("write `with({})`: parts between commas", words().join(", ")))),
        }
        Ok(())
    }

    /// Takes in a word between the brackets of `with`.
    fn word(&mut self, token: &TokenTree) -> Result<(), Fault> {
        if is_punct(token, ',') {
            return Ok(());
        }
        match token.to_string().as_str() {
            "strokes" => self.strokes = Some(token.span()),
            "forgetting" => self.forgetting = Some(token.span()),
            name => match Part::from_name(name) {
                Some(part) => self.parts.push((token.span(), part)),
                None => {
                    let known = words();
                    return Err((token.span(), format!("there is no part `{name}`; there are {}", known.join(", "))));
                }
            },
        }
        Ok(())
    }

    /// The model with its parts; what cannot be made is a fault of the word that asks for it.
    pub(super) fn parts_of(&self, estimator: EstimatorSource) -> Result<EstimatorSource, Fault> {
        let add = |estimator: EstimatorSource, (span, part): &(Span, Part)| {
            estimator.with(&[*part]).map_err(|error| (*span, error.to_string()))
        };
        let estimator = self.parts.iter().try_fold(estimator, add)?;
        if let Some(span) = self.strokes {
            estimator.check_strokes().map_err(|error| (span, error.to_string()))?;
        }
        if let Some(span) = self.forgetting {
            estimator.check_forgetting().map_err(|error| (span, error.to_string()))?;
        }
        if let Some((span, filters)) = &self.filters {
            estimator.check_filters(filters).map_err(|error| (*span, error.to_string()))?;
        }
        Ok(estimator)
    }

    /// The values that the code contains.
    pub(super) fn values_of(&self, estimator: &EstimatorSource) -> Result<Option<Identified>, Fault> {
        let Some((at, values)) = &self.values else { return Ok(None) };
        let names = || estimator.form.columns.iter().map(|column| column.name.as_str());
        if let Some((name, (span, _))) = values.iter().find(|(name, _)| !names().any(|known| known == name.as_str())) {
            let known = names().collect::<Vec<&str>>().join(", ");
            return Err((*span, format!("there is no parameter `{name}`; there are {known}")));
        }
        let values = values.iter().map(|(name, (_, value))| (name.clone(), *value)).collect();
        let identified = Identified::of_values(&estimator.model.name, &values);
        match identified.in_order(&estimator.model, &estimator.form) {
            Ok(_) => Ok(Some(identified)),
            Err(error) => Err((*at, error.to_string())),
        }
    }

    pub(super) fn options(&self) -> rust::Options<'_> {
        rust::Options {
            runtime: self.runtime.as_deref().unwrap_or("::tpm_runtime"),
            strokes: self.strokes.is_some(),
            forgetting: self.forgetting.is_some(),
            filters: self.filters.as_ref().map(|(_, filters)| filters),
            ..rust::Options::default()
        }
    }
}

/// The words that `with` takes.
fn words() -> Vec<&'static str> {
    Part::ALL.into_iter().map(Part::name).chain(["strokes", "forgetting"]).collect()
}

/// The filters between brackets.
fn filters(at: Span, group: TokenStream) -> Result<Filters, Fault> {
    let (mut dependent, mut independent, mut sample_time) = (None, None, None);
    let low_pass = |tokens: &[TokenTree]| {
        LowPass::parse(&text_of(tokens))
            .map_err(|error| (tokens.first().map_or(at, TokenTree::span), error.to_string()))
    };
    for argument in arguments(group) {
        let wrong = || (argument.first().map_or(at, TokenTree::span), FILTER.to_owned());
        match argument.as_slice() {
            [name, sign, value @ ..] if is_punct(sign, '=') && !value.is_empty() => {
                if is_ident(name, "sample_time") && sample_time.is_none() {
                    sample_time = Some(number(value)?);
                } else if is_ident(name, "independent") && independent.is_none() {
                    independent = Some(low_pass(value)?);
                } else {
                    return Err(wrong());
                }
            }
            value if dependent.is_none() => dependent = Some(low_pass(value)?),
            _ => return Err(wrong()),
        }
    }
    match (dependent, sample_time) {
        (Some(dependent), Some(sample_time)) => Ok(Filters { sample_time, dependent, independent }),
        _ => Err((at, FILTER.to_owned())),
    }
}

/// The values between brackets.
fn values(at: Span, group: TokenStream) -> Result<Values, Fault> {
    let mut values = Values::new();
    for argument in arguments(group) {
        let [name @ TokenTree::Ident(_), sign, value @ ..] = argument.as_slice() else {
            return Err((argument.first().map_or(at, TokenTree::span), IDENTIFIED.to_owned()));
        };
        if !is_punct(sign, '=') || value.is_empty() {
            return Err((name.span(), IDENTIFIED.to_owned()));
        }
        let value = rational::to_f64(&number(value)?);
        if values.insert(name.to_string(), (name.span(), value)).is_some() {
            return Err((name.span(), format!("`{name}` has two values; keep one")));
        }
    }
    Ok(values)
}

/// What stands between commas.
fn arguments(group: TokenStream) -> Vec<Vec<TokenTree>> {
    let tokens: Vec<TokenTree> = group.into_iter().collect();
    tokens.split(|token| is_punct(token, ',')).filter(|part| !part.is_empty()).map(<[TokenTree]>::to_vec).collect()
}

/// A number, exactly as it is written.
fn number(tokens: &[TokenTree]) -> Result<Rational, Fault> {
    let (text, at) = (text_of(tokens), tokens.first().map_or_else(Span::call_site, TokenTree::span));
    rational::parse(&text).ok_or_else(|| (at, format!("`{text}` is not a number such as 100 or 0.001")))
}

/// The tokens without blanks.
fn text_of(tokens: &[TokenTree]) -> String {
    tokens.iter().map(ToString::to_string).collect()
}

pub(super) fn is_ident(token: &TokenTree, name: &str) -> bool {
    matches!(token, TokenTree::Ident(ident) if ident == name)
}

pub(super) fn is_punct(token: &TokenTree, mark: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == mark)
}

/// The path in `= a::b`, the tokens behind `crate`, whose span is `at`.
fn crate_path(at: Span, tokens: TokenStream) -> Result<String, Fault> {
    let mut tokens = tokens.into_iter();
    let sign = tokens.next();
    let rest: TokenStream = tokens.collect();
    let is_path = |token: TokenTree| match token {
        TokenTree::Ident(_) => true,
        TokenTree::Punct(punct) => punct.as_char() == ':',
        _ => false,
    };
    if !sign.is_some_and(|token| is_punct(&token, '=')) || rest.is_empty() || !rest.clone().into_iter().all(is_path) {
        return Err((at, "write `crate = path::to::tpm_runtime` to say where the runtime is".to_owned()));
    }
    // Blanks between the parts of a path are removed.
    Ok(rest.to_string().replace(' ', ""))
}
