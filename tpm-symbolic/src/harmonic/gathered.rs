//! A table with one constant in place of every sum of products of constants.
//!
//! Under a pattern a Taylor coefficient such as `s1*s4 + s2*s5 l4/l5` stands in every harmonic of its term, multiplied by
//! a number and by amplitudes. Written out, every entry of the table would repeat the sum. Entries that differ in
//! constants alone are therefore one entry, whose sum, scaled so that its first coefficient is 1, is a constant of its own:
//!
//! ```text
//! 1/2 l s1 s4 + 1/2 l s2 s5  ->  1/2 l s6 ,      s6 = s1*s4 + s2*s5 .
//! ```
//!
//! Invariant: the value of every harmonic is unchanged.

use crate::algebra::fourier::Trig;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::harmonic::table::{Entry, HarmonicTable};
use crate::mechanics::derived::Derived;
use crate::number::rational::{self, Rational};
use ecow::EcoString;
use num_traits::{One, Signed};
use std::collections::BTreeMap;

/// What entries have in common that differ in constants alone: equation, harmonic, function, column, power of pi, powers
/// of amplitudes and frequency, signs.
type Common = (usize, usize, Trig, Option<usize>, i32, Monomial<usize>, Monomial<usize>);

impl HarmonicTable {
    /// The table with the definitions of its derived constants, and one constant in place of every sum of products of
    /// constants. `is_constant` says which symbols are constants, by index. Without derived constants the table stays as
    /// it is.
    #[must_use]
    pub fn gathered(self, constants: Vec<Derived>, is_constant: impl Fn(usize) -> bool) -> Self {
        if constants.is_empty() {
            return self;
        }
        let mut groups: BTreeMap<Common, Polynomial<usize>> = BTreeMap::new();
        for entry in self.entries() {
            let (own, powers) = entry.powers.partition(|&symbol| is_constant(symbol));
            let common =
                (entry.equation, entry.harmonic, entry.function, entry.column, entry.pi, powers, entry.sign.clone());
            groups.entry(common).or_insert_with(Polynomial::zero).add_assign(&Polynomial::term(own, entry.coefficient));
        }
        let (mut symbols, mut constants) = (self.symbols.clone(), constants);
        let mut known: Vec<(Polynomial<usize>, usize)> = Vec::new();
        let mut entries = Vec::with_capacity(groups.len());
        for ((equation, harmonic, function, column, pi, powers, sign), sum) in groups {
            let Some((first, factor)) = sum.terms().next() else { continue };
            let (coefficient, own) = if sum.len() == 1 {
                (factor.clone(), first.clone())
            } else {
                let factor = factor.clone();
                let scaled = sum.scale(&(Rational::one() / &factor));
                let index = known.iter().find(|(other, _)| *other == scaled).map(|(_, index)| *index);
                let index = index.unwrap_or_else(|| {
                    let name = free_name(&symbols, constants.len() + 1);
                    constants.push(Derived { name: name.clone(), definition: written(&scaled, &symbols) });
                    symbols.push(name);
                    known.push((scaled, symbols.len() - 1));
                    symbols.len() - 1
                });
                (factor, Monomial::power_of(index, 1))
            };
            let powers = powers.mul(&own);
            entries.push(Entry { equation, harmonic, function, column, coefficient, pi, powers, sign });
        }
        let mut table = Self::new(self.model, self.equations, self.parameters, symbols, entries);
        (table.tails, table.constants) = (self.tails, constants);
        table
    }
}

/// The next name after those of the derived constants, which no symbol has.
fn free_name(symbols: &[EcoString], number: usize) -> EcoString {
    let mut name = format!("s{number}");
    while symbols.iter().any(|symbol| *symbol == name) {
        name.push('_');
    }
    name.into()
}

/// A sum of products of powers in the model language.
fn written(sum: &Polynomial<usize>, symbols: &[EcoString]) -> String {
    let mut text = String::new();
    for (monomial, coefficient) in sum.terms() {
        let size = rational::abs(coefficient);
        text.push_str(match (text.is_empty(), coefficient.is_negative()) {
            (true, true) => "-",
            (true, false) => "",
            (false, true) => " - ",
            (false, false) => " + ",
        });
        let (mut above, mut below): (Vec<String>, Vec<String>) = (Vec::new(), Vec::new());
        if !size.is_one() {
            above.push(size.to_string());
        }
        for (&symbol, power) in monomial.factors() {
            let name = &symbols[symbol];
            let side = if power > 0 { &mut above } else { &mut below };
            side.push(match power.unsigned_abs() {
                1 => name.to_string(),
                size => format!("{name}^{size}"),
            });
        }
        text.push_str(&if above.is_empty() { "1".to_owned() } else { above.join("*") });
        for divisor in below {
            text.push('/');
            text.push_str(&divisor);
        }
    }
    text
}
