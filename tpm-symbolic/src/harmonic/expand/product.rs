//! Products of symbols and shapes with packed exponents.

use crate::algebra::packed::Key;
use crate::number::scalar::Scalar;

/// factor * symbols * shapes.
#[derive(Clone)]
pub(super) struct Product<K> {
    pub(super) symbols: K,
    pub(super) shapes: K,
    pub(super) factor: Scalar,
}

impl<K: Key> Product<K> {
    pub(super) fn times(&self, other: &Self) -> Self {
        let (mut symbols, mut shapes) = (self.symbols.clone(), self.shapes.clone());
        symbols.add(&other.symbols, 1);
        shapes.add(&other.shapes, 1);
        Self { symbols, shapes, factor: self.factor.times(&other.factor) }
    }
}

/// Sorts by symbols, then shapes, adds equal products and drops those that cancel.
pub(super) fn merge<K: Key>(products: &mut Vec<Product<K>>) {
    if products.len() > 1 {
        products.sort_unstable_by(|a, b| (&a.symbols, &a.shapes).cmp(&(&b.symbols, &b.shapes)));
        products.dedup_by(|next, kept| {
            let same = next.symbols == kept.symbols && next.shapes == kept.shapes;
            if same {
                kept.factor = kept.factor.plus(&next.factor);
            }
            same
        });
    }
    products.retain(|product| !product.factor.is_zero());
}
