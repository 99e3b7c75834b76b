//! The controller's own code in the C of a model: names, and where it is written.

use std::collections::HashMap;

use super::super::name::snake;
use super::context::Context;
use super::translate::{Library, Target, Translator, Untranslated};

/// The sizes of the controller's code, by the name of the constant generic, with their macros: those of the samples' estimator and monitor.
pub(super) const BASE: [(&str, &str); 2] = [("C", "BASE_PARAMETERS"), ("R", "EQUATIONS")];

/// Writes what is asked for of the controller's code, with all that it needs and that is not there yet.
///
/// # Panics
/// Never: a test translates everything that is asked for anywhere.
pub(super) fn write<R>(
    context: &mut Context<'_>,
    sizes: &[(&'static str, &str)],
    ask: impl FnOnce(&mut Translator<'_>) -> Result<R, Untranslated>,
) -> R {
    let written = Library::read().and_then(|library| {
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
        Ok((found, translator.types, translator.functions, translator.done))
    });
    let (found, types, functions, done) = written.expect("invariant: what is asked for is of the subset");
    context.header.push_str(&types);
    context.source.push_str(&functions);
    context.translated = done;
    found
}

/// The name of a structure or enumeration, and how the names of its functions begin.
fn structure(context: &Context<'_>, name: &str, sizes: &[String]) -> [String; 2] {
    let of = |size: &str| sizes.first().is_some_and(|own| *own == context.constant(size));
    let (ty, functions) = match name {
        "SquareRoot" if of("BASE_PARAMETERS") => ("base_estimator", "base_rows"),
        "Solution" if of("BASE_PARAMETERS") => ("base_workspace", "base_solution"),
        _ => return [context.global(&snake(name)), snake(name)],
    };
    [context.global(ty), functions.to_owned()]
}

/// The name of a variant: that of its enumeration's kind and its own.
fn variant(context: &Context<'_>, name: &str, variant: &str) -> String {
    let kind = match name {
        "RunFault" | "RunLinearisation" => "RUN",
        _ => name,
    };
    context.constant(&format!("{kind}_{}", snake(variant)).to_uppercase())
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
