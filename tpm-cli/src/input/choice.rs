//! Values that a library lists, as the values of an option.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// A parser of one of several values, each with its name and its help.
pub(crate) fn one_of<T: Clone + Send + Sync + 'static, const N: usize>(
    choices: [(T, &'static str, &'static str); N],
) -> impl TypedValueParser<Value = T> {
    let names = choices.each_ref().map(|(_, name, help)| PossibleValue::new(*name).help(*help));
    PossibleValuesParser::new(names).try_map(move |given| {
        let chosen = choices.iter().find(|(_, name, _)| *name == given);
        chosen.map(|(value, ..)| value.clone()).ok_or("it is none of the possible values")
    })
}
