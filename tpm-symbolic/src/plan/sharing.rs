//! Products with shared factors: `2 s a`, `2 s^2 a` and `2 s b^2` as multiples of `2 s`.
//!
//! The factors of every product are a multiset of atoms. The pair of atoms that occurs in the most products becomes a
//! new atom, and so on until no pair occurs in two products (a greedy search, as in Breuer's factoring of
//! multiplications). Invariant: an atom is an expression of the graph, the number two, or a pair of earlier atoms. The
//! product of a node's atoms is the node without its divisors and without the part of its coefficient that
//! [`SharedProducts::rest`] gives. Of coefficients only powers of two become atoms, since multiplying by them causes no
//! rounding. The result depends on the order of the roots alone.

use crate::expr::graph::{ExprId, Graph, Node};
use crate::number::rational::Rational;
use num_traits::{One, Signed};
use std::collections::{HashMap, HashSet};

/// Highest power whose base becomes a repeated factor; higher powers are computed by squaring.
const HIGHEST_POWER: i32 = 8;
/// Most factors of two that are taken out of a coefficient.
const MOST_TWOS: usize = 3;
/// Most products among which shared pairs are searched for; the search passes over all of them for every pair found.
const MOST_PRODUCTS: usize = 2000;

/// A factor of a product.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Atom {
    /// An expression.
    Expr(ExprId),
    /// The number two.
    Two,
    /// A product of two atoms.
    Pair(usize),
}

/// The products of a set of expressions.
#[derive(Debug, Default)]
pub(crate) struct SharedProducts {
    products: HashMap<ExprId, Vec<Atom>>,
    pairs: Vec<(Atom, Atom)>,
    /// For every pair, the number of its occurrences in products and in other pairs.
    places: Vec<usize>,
}

impl SharedProducts {
    pub(crate) fn of(graph: &Graph, roots: &[ExprId]) -> Self {
        let mut order = Vec::new();
        let mut seen = HashSet::new();
        let mut stack: Vec<ExprId> = roots.iter().rev().copied().collect();
        let mut products = HashMap::new();
        while let Some(id) = stack.pop() {
            if !seen.insert(id) {
                continue;
            }
            let operands: Vec<ExprId> = graph.operands(id).collect();
            stack.extend(operands.into_iter().rev());
            let atoms = atoms(graph, id);
            if atoms.len() > 1 {
                order.push(id);
                products.insert(id, atoms);
            }
        }
        let mut shared = SharedProducts { products, pairs: Vec::new(), places: Vec::new() };
        if order.len() <= MOST_PRODUCTS {
            shared.share(&order);
        }
        shared.count();
        shared
    }

    /// The atoms of a node, when it is a product of several.
    pub(crate) fn atoms(&self, id: ExprId) -> Option<&[Atom]> {
        self.products.get(&id).map(Vec::as_slice)
    }

    /// The atoms of a pair.
    pub(crate) fn pair(&self, index: usize) -> (Atom, Atom) {
        self.pairs[index]
    }

    /// The atom that a pair doubles, when several products contain the pair; in a single product the factor two is not
    /// paired.
    pub(crate) fn doubled(&self, index: usize) -> Option<Atom> {
        match self.pairs[index] {
            (Atom::Two, single) if self.places[index] > 1 => Some(single),
            _ => None,
        }
    }

    /// The remaining part of a positive coefficient after its factors of two have become atoms.
    pub(crate) fn rest(&self, value: &Rational) -> Rational {
        (0..twos(value)).fold(value.clone(), |value, _| value / Rational::from_integer(2.into()))
    }

    fn count(&mut self) {
        // Equal products are one operation, so they count once.
        let products: HashSet<&[Atom]> = self.products.values().map(Vec::as_slice).collect();
        let mut places = vec![0; self.pairs.len()];
        let inner = self.pairs.iter().flat_map(|&(a, b)| [a, b]);
        for atom in inner.chain(products.into_iter().flatten().copied()) {
            if let Atom::Pair(index) = atom {
                places[index] += 1;
            }
        }
        self.places = places;
    }

    fn share(&mut self, order: &[ExprId]) {
        loop {
            let Some((a, b)) = self.most_frequent(order) else { return };
            let pair = Atom::Pair(self.pairs.len());
            // A number precedes the factor that it multiplies.
            self.pairs.push(if b == Atom::Two { (b, a) } else { (a, b) });
            for id in order {
                let Some(atoms) = self.products.get_mut(id) else { continue };
                while let Some((i, j)) = places_of(atoms, a, b) {
                    atoms[i] = pair;
                    atoms.remove(j);
                }
            }
        }
    }
}

impl SharedProducts {
    /// The pair that occurs in the most products, in at least two; the first one of several.
    fn most_frequent(&self, order: &[ExprId]) -> Option<(Atom, Atom)> {
        // Equal products are one operation, so they count once.
        let mut distinct: HashSet<&[Atom]> = HashSet::new();
        let mut places: HashMap<(Atom, Atom), usize> = HashMap::new();
        let mut found: Vec<((Atom, Atom), usize)> = Vec::new();
        for atoms in order.iter().filter_map(|id| self.atoms(*id)).filter(|atoms| atoms.len() > 1) {
            if !distinct.insert(atoms) {
                continue;
            }
            let mut counted: Vec<usize> = Vec::new();
            for (i, &a) in atoms.iter().enumerate() {
                for &b in &atoms[i + 1..] {
                    let place = places.get(&(a, b)).or_else(|| places.get(&(b, a))).copied().unwrap_or(found.len());
                    if place == found.len() {
                        places.insert((a, b), place);
                        found.push(((a, b), 0));
                    }
                    // A pair counts once per product, however often a power repeats it.
                    if !counted.contains(&place) {
                        counted.push(place);
                        found[place].1 += 1;
                    }
                }
            }
        }
        let best = found.into_iter().reduce(|best, next| if next.1 > best.1 { next } else { best });
        best.filter(|(_, count)| *count > 1).map(|(pair, _)| pair)
    }
}

/// The first positions at which a pair occurs, the smaller one first.
fn places_of(atoms: &[Atom], a: Atom, b: Atom) -> Option<(usize, usize)> {
    let first = atoms.iter().position(|&atom| atom == a)?;
    let second = atoms.iter().enumerate().position(|(place, &atom)| place != first && atom == b)?;
    Some((first.min(second), first.max(second)))
}

/// The exponent of a coefficient that is a small power of two; zero for every other coefficient.
fn twos(value: &Rational) -> usize {
    let mut left = value.abs();
    for count in 0..=MOST_TWOS {
        if left.is_one() {
            return count;
        }
        left /= Rational::from_integer(2.into());
    }
    0
}

/// The factors of a product or of a positive whole power; nothing for any other node.
fn atoms(graph: &Graph, id: ExprId) -> Vec<Atom> {
    let power = |id: ExprId, atoms: &mut Vec<Atom>| match graph.node(id) {
        Node::Power(_, exponent) if *exponent < 0 => {}
        Node::Power(base, exponent) if *exponent <= HIGHEST_POWER => {
            atoms.extend((0..*exponent).map(|_| Atom::Expr(*base)));
        }
        _ => atoms.push(Atom::Expr(id)),
    };
    let mut atoms = Vec::new();
    match graph.node(id) {
        Node::Product(factors) => {
            let value = factors.first().and_then(|first| graph.as_number(*first));
            if let Some(value) = value {
                atoms.extend((0..twos(value)).map(|_| Atom::Two));
            }
            factors[usize::from(value.is_some())..].iter().for_each(|&factor| power(factor, &mut atoms));
        }
        Node::Power(..) => power(id, &mut atoms),
        _ => {}
    }
    atoms
}
