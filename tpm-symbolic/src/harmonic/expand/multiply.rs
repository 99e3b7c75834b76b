//! Products of shapes, each multiplied out once, and their coefficients in lowest terms.
//!
//! Invariant: contributions are visited in the order of their packed exponents, so that a product of shapes is computed
//! from a shorter one by one multiplication, and only the prefixes of the current product are kept.

use crate::algebra::packed::Key;
use crate::algebra::spectrum::Spectrum;
use crate::budget;
use crate::harmonic::error::ExpandError;
use crate::harmonic::expand::expansion::{Contribution, Expansion};
use crate::harmonic::options::ExpandOptions;
use crate::harmonic::table::CoefficientSeries;
use crate::mechanics::model::TermId;
use crate::number::denominator::{Denominator, Reduction};
use crate::number::numerator::Numerator;
use crate::number::scalar::Scalar;
use crate::number::values::for_width;
use smallvec::{SmallVec, smallvec};
use std::cell::Cell;

/// A prefix of the current product of shapes.
struct Level {
    spectrum: Spectrum,
    denominator: Denominator,
}

impl<K: Key> Expansion<'_, '_, K> {
    /// Multiplies out every product of shapes once. `present_term` is set to the current source term.
    pub(super) fn multiply_out(
        &mut self,
        options: &mut ExpandOptions<'_>,
        present_term: &Cell<Option<TermId>>,
    ) -> Result<(), ExpandError> {
        let mut contributions = std::mem::take(&mut self.contributions);
        contributions.sort_unstable_by(|a, b| (&a.shapes, a.group).cmp(&(&b.shapes, b.group)));
        let total = contributions.len();
        let count = self.shape_layout.variables;
        // The exponents of the current product. The first `depth + 1` levels are its prefixes, beginning with the empty
        // product.
        let mut present: SmallVec<[i64; 8]> = smallvec![0; count];
        let mut exponents = present.clone();
        let (present, exponents) = (present.as_mut_slice(), exponents.as_mut_slice());
        let mut levels: Vec<Level> = Vec::with_capacity(4);
        // The empty product comes first, when there is one.
        let constant = contributions.first().is_some_and(|first| first.shapes == K::one(self.shape_layout));
        let spectrum = if constant { Spectrum::one() } else { Spectrum::factor_one() };
        levels.push(Level { spectrum, denominator: Denominator::default() });
        let mut depth = 0;
        for (done, contribution) in contributions.iter().enumerate() {
            let same = done > 0 && contributions[done - 1].shapes == contribution.shapes;
            if !same {
                exponents.fill(0);
                contribution.shapes.exponents(self.shape_layout, |shape, exponent| exponents[shape] = exponent);
            }
            if !same && let Some(differs) = (0..count).rev().find(|&shape| present[shape] != exponents[shape]) {
                let above: i64 = exponents[differs + 1..].iter().sum();
                depth = (above + present[differs].min(exponents[differs])) as usize;
                for shape in (0..=differs).rev() {
                    let already = if shape == differs { present[differs].min(exponents[differs]) } else { 0 };
                    for _ in already..exponents[shape] {
                        let base = &self.bases[shape];
                        present_term.set(Some(self.groups[contribution.group].term));
                        let spectrum = levels[depth].spectrum.multiply(base, &mut self.rooms);
                        depth += 1;
                        if levels.len() == depth {
                            levels.push(Level { spectrum, denominator: Denominator::default() });
                        } else {
                            let before = std::mem::replace(&mut levels[depth].spectrum, spectrum);
                            self.rooms.recycle(before.into_values());
                        }
                        let (known, new) = levels.split_at_mut(depth);
                        new[0].denominator.set_product(&known[depth - 1].denominator, base.denominator());
                        options.report(done, total, self.groups[contribution.group].term)?;
                    }
                }
                present.copy_from_slice(exponents);
            }
            self.contribute(contribution, &levels[depth]);
        }
        Ok(())
    }

    fn contribute(&mut self, contribution: &Contribution<K>, product: &Level) {
        let index = contribution.group;
        let Some(sum) = self.groups[index].sum else {
            return self.finish(index, &product.spectrum, &product.denominator, &contribution.factor);
        };
        let sum = &mut self.sums[sum as usize];
        let scale = self.factors.quotient(&sum.denominator, &product.denominator).times(&contribution.factor);
        sum.spectrum.add_scaled(&product.spectrum, &scale, &mut self.rooms);
        sum.pending -= 1;
        if sum.pending == 0 {
            let spectrum = std::mem::replace(&mut sum.spectrum, Spectrum::zero());
            let denominator = std::mem::take(&mut sum.denominator);
            self.finish(index, &spectrum, &denominator, &Scalar::ONE);
            self.rooms.recycle(spectrum.into_values());
        }
    }

    /// Reduces a group's coefficients to lowest terms and stores them.
    fn finish(&mut self, index: usize, spectrum: &Spectrum, denominator: &Denominator, factor: &Scalar) {
        let with_common;
        let denominator = match self.groups[index].common {
            None => denominator,
            Some(common) => {
                let mut product = Denominator::default();
                product.set_product(denominator, &self.common[common as usize]);
                with_common = product;
                &with_common
            }
        };
        let reduction = self.factors.reduction(denominator);
        let bits = spectrum.bits() + if factor.is_one() { 0 } else { factor.bits() };
        let bits = bits + u64::from(!reduction.is_even());
        let series = &mut self.series[index];
        series.first = spectrum.first();
        series.stride = spectrum.stride();
        series.len = spectrum.len();
        series.cos = spectrum.has_cos();
        series.sin = spectrum.has_sin();
        series.numerator_words = (bits / 64 + 1) as usize;
        series.denominator_words = reduction.words();
        series.start = self.words.len();
        let wide;
        let needed = if matches!(factor, Scalar::Big(_)) { u64::MAX } else { bits };
        // Bringing a number into lowest terms requires divisions by factors of its denominator, which the budget
        // counts.
        let words = (series.numerator_words + series.denominator_words) as u64;
        budget::charge((2 * series.len as u64).saturating_mul(words.saturating_mul(words)));
        let values = if spectrum.values().capacity() < needed {
            wide = spectrum.values().widened(needed);
            &wide
        } else {
            spectrum.values()
        };
        let count = for_width!(values, list => store(list, series, factor, &reduction, &mut self.words));
        if count == 0 {
            self.words.truncate(series.start);
            series.len = 0;
        }
        self.entries += count;
    }
}

/// Appends the coefficients factor * values / denominator and counts those that are not zero.
///
/// The coefficient of cos(k theta) and sin(k theta), k >= 1, is twice that of e^{j k theta}: half the denominator when it
/// is even, otherwise twice the numerator.
fn store<T: Numerator>(
    values: &[T],
    series: &CoefficientSeries,
    factor: &Scalar,
    reduction: &Reduction<'_>,
    out: &mut Vec<u64>,
) -> usize {
    let size = series.numerator_words + series.denominator_words;
    let start = out.len();
    out.resize(start + values.len() * size, 0);
    let mut slots = &mut out[start..];
    let mut count = 0;
    let halvings = u32::from(reduction.is_even());
    // Beyond one word the numerators are big integers.
    let doubled = if halvings == 1 { None } else { Some(factor.times(&Scalar::Small(2))) };
    let of_rest = doubled.as_ref().unwrap_or(factor);
    let mut values = values;
    while !values.is_empty() {
        let (part, others) = values.split_at(series.len);
        values = others;
        let (constant, rest) = part.split_at(usize::from(series.first == 0));
        for (list, halvings, factor) in [(constant, 0, factor), (rest, halvings, of_rest)] {
            let (here, further) = slots.split_at_mut(list.len() * size);
            slots = further;
            count += match factor {
                Scalar::Small(1) => write_all(list, here, size, |value, slot| reduction.write(value, halvings, slot)),
                Scalar::Small(factor) => {
                    let scaled = |value: &T| value.times(*factor);
                    write_all(list, here, size, |value, slot| reduction.write(&scaled(value), halvings, slot))
                }
                Scalar::Big(factor) => {
                    let scaled = |value: &T| value.to_big() * factor.as_ref();
                    write_all(list, here, size, |value, slot| reduction.write(&scaled(value), halvings, slot))
                }
            };
        }
    }
    count
}

/// Writes the values that are not zero into their slots of `size` words, and counts them.
#[inline]
fn write_all<T: Numerator>(values: &[T], slots: &mut [u64], size: usize, write: impl Fn(&T, &mut [u64])) -> usize {
    let (mut count, mut slots) = (0, slots);
    for value in values {
        let (slot, further) = slots.split_at_mut(size);
        slots = further;
        if !value.is_zero() {
            count += 1;
            write(value, slot);
        }
    }
    count
}
