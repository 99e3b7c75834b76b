//! Estimate of the size of a table before anything is multiplied out.

use crate::algebra::packed::Key;
use crate::algebra::spectrum::Base;
use crate::harmonic::error::ExpandError;
use crate::harmonic::expand::expansion::Expansion;
use crate::harmonic::options::ExpandOptions;
use crate::mechanics::model::TermId;

impl<K: Key> Expansion<'_, '_, K> {
    /// Estimates the size of the table from the bounds of its numerators and denominators, and refuses a table that is
    /// too large.
    pub(super) fn refuse_too_large(&mut self, options: &ExpandOptions<'_>) -> Result<(), ExpandError> {
        let (reserved, small) = self.size_at_most();
        if small {
            self.words.reserve(reserved);
            return Ok(());
        }
        let (mut entries, mut bytes) = (0.0, 0.0);
        let mut worst: Option<(f64, TermId)> = None;
        for contribution in &self.contributions {
            let (mut highest, mut bits, mut below) = (0.0, contribution.factor.bits() as f64, 0.0);
            let (mut mixed, mut both) = (false, false);
            contribution.shapes.exponents(self.shape_layout, |shape, exponent| {
                if exponent > 0 {
                    let (base, exponent) = (&self.bases[shape], exponent as f64);
                    highest += exponent * base.highest_harmonic() as f64;
                    bits += exponent * base.norm_bits() as f64;
                    below += exponent * base.denominator_bits() as f64;
                    mixed |= base.parity().is_none();
                    both |= base.functions() == (true, true);
                }
            });
            let group = &self.groups[contribution.group];
            if let Some(common) = group.common {
                below += self.factors.bits(&self.common[common as usize]) as f64;
            }
            // If all factors have harmonics of one parity, so has the product.
            let harmonics = if mixed { highest + 1.0 } else { highest * 0.5 + 1.0 };
            let count = if both { harmonics * 2.0 } else { harmonics };
            let words = (bits + below) / 64.0 + 2.0;
            // Exponents of primes are counted in 32 bits; a larger denominator exceeds every limit.
            let size = if below < f64::from(u32::MAX) { count * words * 8.0 } else { f64::INFINITY };
            entries += count;
            bytes += size;
            if worst.is_none_or(|(worst, _)| worst < size) {
                worst = Some((size, group.term));
            }
        }
        options.refuse_beyond(worst.map(|(_, term)| term), entries, bytes)?;
        // Memory that is not written is not occupied, so the whole estimate is reserved while it is moderate.
        self.words.reserve((bytes / 8.0).min(1e6) as usize);
        Ok(())
    }

    /// A quick bound of the table's words, from the largest base and the largest exponents, and whether it proves that
    /// the table is far below every limit.
    fn size_at_most(&self) -> (usize, bool) {
        let highest = self.bases.iter().map(Base::highest_harmonic).max().unwrap_or(0) as f64;
        let bits = self.bases.iter().map(|base| base.norm_bits() + base.denominator_bits()).max().unwrap_or(0);
        let degree = self.atoms.largest_exponent as f64;
        let words = (degree * bits as f64 + (self.factor_bits + self.common_bits) as f64) / 64.0 + 2.0;
        let entries = self.contributions.len() as f64 * 2.0 * (degree * highest + 1.0);
        // Half of the harmonics have the other parity, and usually either cosines or sines are missing.
        ((entries * words / 4.0) as usize, entries * words < 3e4)
    }
}
