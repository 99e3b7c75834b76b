//! Stated ranges of what functions read.
//!
//! Invariant: both ends of a range are finite, and the lower one is not above the other.

use std::collections::BTreeMap;
use thiserror::Error;

/// Ranges of what functions read, by the names of the model language, such as `dot(q)`; `*` stands for every coordinate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranges(BTreeMap<String, [f64; 2]>);

/// Why ranges cannot be taken.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum RangeError {
    /// The text is no range.
    #[error("`{0}` is no range: write NAME=LOW..HIGH, such as q=-3.14..3.14 or dot(q)=-2..2")]
    Form(String),
    /// An end is no finite number, or the ends are in the wrong order.
    #[error("the range {0}: both ends must be finite numbers, the lower one first")]
    Ends(String),
    /// A name is given twice.
    #[error("the range of `{0}` is given twice")]
    Twice(String),
    /// Nothing has this name.
    #[error("there is no `{name}` for a range; functions read {known}")]
    Unknown {
        /// The name.
        name: String,
        /// What there is.
        known: String,
    },
    /// No function has a bound.
    #[error("no function has a bound of its rounding errors: {0}")]
    Nothing(String),
}

impl Ranges {
    /// Ranges of the form NAME=LOW..HIGH, several in a text separated by commas.
    ///
    /// # Errors
    /// [`RangeError`] where a text has another form, an end is not finite, a range is empty, or a name is given twice.
    pub fn parse<T: AsRef<str>>(texts: &[T]) -> Result<Self, RangeError> {
        let mut ranges = BTreeMap::new();
        for text in texts.iter().flat_map(|text| apart(text.as_ref())) {
            let form = || RangeError::Form(text.to_owned());
            let (name, ends) = text.split_once('=').ok_or_else(form)?;
            let (low, high) = ends.split_once("..").ok_or_else(form)?;
            let number = |text: &str| text.trim().parse::<f64>().map_err(|_| form());
            let ends = [number(low)?, number(high)?];
            if !(ends[0].is_finite() && ends[1].is_finite() && ends[0] <= ends[1]) {
                return Err(RangeError::Ends(text.to_owned()));
            }
            let name = plain(name);
            if ranges.insert(name.clone(), ends).is_some() {
                return Err(RangeError::Twice(name));
            }
        }
        Ok(Self(ranges))
    }

    /// The names that have a range.
    pub(super) fn names(&self) -> impl Iterator<Item = &String> {
        self.0.keys()
    }

    /// The range of a name.
    pub(super) fn of(&self, name: &str) -> Option<[f64; 2]> {
        self.0.get(&plain(name)).copied()
    }
}

/// A text at its commas, but for those in parentheses.
fn apart(text: &str) -> Vec<&str> {
    let mut depth = 0_i32;
    let outside = move |letter: char| {
        depth += i32::from(letter == '(') - i32::from(letter == ')');
        letter == ',' && depth == 0
    };
    text.split(outside).collect()
}

/// A name without blanks.
pub(super) fn plain(name: &str) -> String {
    name.split_whitespace().collect()
}

#[cfg(test)]
mod tests {
    use super::{RangeError, Ranges};

    #[test]
    fn ranges_that_are_none_are_named() {
        let fault = |text: &str| Ranges::parse(&[text]).expect_err(text).to_string();
        assert!(fault("q").contains("`q` is no range"));
        assert!(fault("q=1..x").contains("`q=1..x` is no range"));
        assert!(fault("q=2..1").contains("q=2..1: both ends must be finite numbers, the lower one first"));
        assert!(fault("q=0..inf").contains("q=0..inf"));
        assert_eq!(Ranges::parse(&["q=0..1", "q=0..2"]), Err(RangeError::Twice("q".to_owned())));
        assert!(Ranges::parse(&["dot( q ) = -1e-3 .. 2"]).is_ok());
    }
}
