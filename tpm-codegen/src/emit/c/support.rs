//! The controller's own code in the C of a model: names, and where it is written.

use std::collections::HashMap;
use std::rc::Rc;

use super::super::name::snake;
use super::context::Context;
use super::translate::{Library, Target, Translator, Untranslated};

/// The sizes of the controller's code, by the name of the constant generic, with their macros: those of the samples' estimator and monitor.
pub(super) const BASE: [(&str, &str); 2] = [("C", "BASE_PARAMETERS"), ("R", "EQUATIONS")];

/// The sizes of the estimator of a run.
pub(super) const RUN: [(&str, &str); 10] = [
    ("C", "RUN_CHANNELS"),
    ("E", "RUN_ALL_EQUATIONS"),
    ("K", "RUN_COVARIANCES"),
    ("L", "RUN_LINES"),
    ("N", "RUN_PHYSICAL"),
    ("P", "RUN_PARAMETERS"),
    ("Q", "RUN_COORDINATES"),
    ("R", "RUN_EQUATIONS"),
    ("S", "RUN_ENTRIES"),
    ("U", "RUN_INPUTS"),
];

/// The sizes of a campaign: those of its runs, and of the motion that it plays.
pub(super) const CAMPAIGN: [(&str, &str); 11] = {
    let [c, e, k, l, n, p, q, r, s, u] = RUN;
    [c, e, k, l, n, p, q, r, s, u, ("M", "RUN_MOTION")]
};

/// Writes what is asked for of the controller's code, with all that it needs and that is not there yet.
///
/// # Panics
/// Never: a test translates everything that is asked for anywhere.
pub(super) fn write<R>(
    context: &mut Context<'_>,
    sizes: &[(&'static str, &str)],
    ask: impl FnOnce(&mut Translator<'_>) -> Result<R, Untranslated>,
) -> R {
    let library = match &context.library {
        Some(library) => Ok(Rc::clone(library)),
        None => Library::read().map(Rc::new),
    };
    let written = library.and_then(|library| {
        let sizes = sizes.iter().map(|(name, size)| (*name, context.constant(size)));
        let structure = |name: &str, sizes: &[String]| structure(context, name, sizes);
        let variant = |name: &str, variant: &str| self::variant(context, name, variant);
        let model = |name: &str| model(context, name);
        let target = Target {
            scalar: context.scalar,
            sizes: sizes.collect::<HashMap<_, _>>(),
            structure: &structure,
            variant: &variant,
            model: &model,
            constants: context.constants_parameter(true).map(|parameter| parameter.declaration),
        };
        let mut translator = Translator::new(&library, &target, context.translated.clone());
        let found = ask(&mut translator)?;
        Ok((found, translator.types, translator.functions, translator.done, Rc::clone(&library)))
    });
    let (found, types, functions, done, library) = written.expect("invariant: what is asked for is of the subset");
    context.header.push_str(&types);
    context.source.push_str(&functions);
    context.translated = done;
    context.library = Some(library);
    found
}

/// The name of a structure or enumeration, and how the names of its functions begin.
fn structure(context: &Context<'_>, name: &str, sizes: &[String]) -> [String; 2] {
    let of = |size: &str| sizes.first().is_some_and(|own| *own == context.constant(size));
    let (ty, functions) = match name {
        "SquareRoot" if of("BASE_PARAMETERS") => ("base_estimator", "base_rows"),
        "Solution" if of("BASE_PARAMETERS") => ("base_workspace", "base_solution"),
        "SquareRoot" if of("RUN_PHYSICAL") => ("run_physical_factor", "run_physical_factor"),
        "Solution" if of("RUN_PHYSICAL") => ("run_physical_solution", "run_physical_solution"),
        "SquareRoot" => ("run_factor", "run_factor"),
        "Solution" => ("run_solution", "run_solution"),
        "Fit" => ("least_squares", "least_squares"),
        "Phasor" => ("run_phasor", "run_phasor"),
        "RunFault" => ("run_status", "run_status"),
        "Evidence" => ("monitor_evidence", "monitor_evidence"),
        "Watched" => ("monitor_watched", "monitor_watched"),
        "Monitoring" => ("monitor", "monitor"),
        "MonitorRules" => ("monitor_order", "monitor_order"),
        "MonitorPhase" => ("monitor_state", "monitor_state"),
        "CampaignOrder" => ("run_order", "campaign_order"),
        "CampaignRules" => ("run_order_rules", "campaign_rules"),
        "CampaignState" => ("run_phase", "run_phase"),
        "CampaignReason" => ("run_end", "run_end"),
        "Play" => ("run_play", "campaign_play"),
        "RunIteration" => ("run_physical_workspace", "run_physical_workspace"),
        _ => return [context.global(&snake(name)), snake(name)],
    };
    [context.global(ty), functions.to_owned()]
}

/// The name of a variant: that of its enumeration's kind and its own.
fn variant(context: &Context<'_>, name: &str, variant: &str) -> String {
    let kind = match name {
        "RunFault" | "RunLinearisation" | "CampaignState" => "run".to_owned(),
        "CampaignReason" => "run_end".to_owned(),
        "MonitorPhase" => "monitor".to_owned(),
        _ => snake(name),
    };
    let variant = if (name, variant) == ("RunFault", "Equations") { "not_evaluated" } else { variant };
    context.constant(&format!("{kind}_{}", snake(variant)).to_uppercase())
}

/// The names of a structure's sizes in a file.
pub(super) fn sizes(context: &Context<'_>, names: &[&str]) -> Vec<String> {
    names.iter().map(|name| context.constant(name)).collect()
}

/// The sizes of the workspace of a run's estimator.
pub(super) fn workspace(context: &Context<'_>) -> Vec<String> {
    let names =
        ["INPUTS", "COORDINATES", "EQUATIONS", "PARAMETERS", "ENTRIES", "LINES", "ALL_EQUATIONS", "COVARIANCES"];
    names.iter().map(|name| context.constant(&format!("RUN_{name}"))).collect()
}

/// The name of what the model gives.
fn model(context: &Context<'_>, name: &str) -> String {
    match name {
        "COORDINATES" => "run_coordinate".to_owned(),
        "ORDERS" => "run_order".to_owned(),
        "POINTS" => context.constant("RUN_POINTS"),
        _ => format!("run_{name}"),
    }
}
