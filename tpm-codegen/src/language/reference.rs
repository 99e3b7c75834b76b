//! The reference of the language: every word and function with its use, its meaning, and a model that shows it.
//!
//! Invariant: every word of [`KEYWORDS`] and every function stands in the code of an example, and every example is a model that passes.

use crate::language::function::Function;
use crate::language::keywords::KEYWORDS;

/// A model that shows a part of the language.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Example {
    /// What it shows.
    pub title: &'static str,
    /// Its text.
    pub text: &'static str,
}

/// All examples, in the order in which the language is told.
pub const EXAMPLES: [Example; 12] = [
    Example { title: "Equations of motion", text: include_str!("examples/equations.tpm") },
    Example { title: "Energies", text: include_str!("examples/energies.tpm") },
    Example { title: "Friction", text: include_str!("examples/friction.tpm") },
    Example { title: "Friction that builds up", text: include_str!("examples/presliding.tpm") },
    Example { title: "Mechanisms", text: include_str!("examples/mechanism.tpm") },
    Example { title: "Patterns", text: include_str!("examples/patterns.tpm") },
    Example { title: "Unknown functions", text: include_str!("examples/series.tpm") },
    Example { title: "Coordinates without a sensor", text: include_str!("examples/elimination.tpm") },
    Example { title: "Coordinates that logs identify", text: include_str!("examples/unmeasured.tpm") },
    Example { title: "Functions of inputs", text: include_str!("examples/inputs.tpm") },
    Example { title: "Motions that nothing drives", text: include_str!("examples/free.tpm") },
    Example { title: "Functions of the motion", text: include_str!("examples/functions.tpm") },
];

/// A word or function of the language, explained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Explained {
    /// How it is written.
    pub usage: &'static str,
    /// What it means.
    pub meaning: &'static str,
    /// A model that shows it.
    pub example: &'static Example,
}

impl Example {
    /// Whether a word stands in the code, not in the comments alone.
    #[must_use]
    pub fn shows(&self, word: &str) -> bool {
        let code = self.text.lines().map(|line| line.split("//").next().unwrap_or_default());
        let mut words = code.flat_map(|line| line.split(|c: char| !c.is_ascii_alphanumeric() && c != '_'));
        words.any(|own| own == word)
    }
}

/// What a word or a function means; nothing for a name that is none.
#[must_use]
pub fn explained(word: &str) -> Option<Explained> {
    let keyword = KEYWORDS.iter().find(|(own, ..)| *own == word).map(|(_, usage, meaning)| (*usage, *meaning));
    let function = || Function::from_name(word).map(|function| (function.usage(), function.meaning()));
    let (usage, meaning) = keyword.or_else(function)?;
    let example = EXAMPLES.iter().find(|example| example.shows(word))?;
    Some(Explained { usage, meaning, example })
}

#[cfg(test)]
mod tests {
    use super::{EXAMPLES, explained};
    use crate::language::function::Function;
    use crate::language::keywords::KEYWORDS;
    use crate::{Source, parse_model};
    use tpm_symbolic::regressor::prepare::prepare_any;

    #[test]
    fn every_word_and_function_is_explained_by_a_model_that_passes() {
        let words = KEYWORDS.iter().map(|(word, ..)| *word).chain(Function::ALL.iter().map(|own| own.name()));
        let unexplained: Vec<&str> = words.filter(|word| explained(word).is_none()).collect();
        assert!(unexplained.is_empty(), "no example shows {unexplained:?}");
        for example in &EXAMPLES {
            let source = Source::new(example.title, example.text);
            let parsed = parse_model(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
            assert!(parsed.warnings.is_empty(), "{}", parsed.warnings.render(&source));
            let prepared = prepare_any(parsed.model).unwrap_or_else(|fault| panic!("{}: {fault}", example.title));
            assert!(!prepared.form.columns.is_empty(), "{}", example.title);
            let formatted =
                crate::language::format(&source).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
            assert_eq!(formatted, example.text, "{}: as `tpm fmt` lays it out", example.title);
        }
        assert!(explained("joint").is_none() && explained("lambda").is_none());
    }
}
