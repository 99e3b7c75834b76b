//! The addends of one sample to the Fourier sums of the equations' signals.

use crate::algebra::fourier::Trig;
use crate::number::rational;
use crate::plan::leaf::Leaf;
use crate::plan::operation::{Op, Slot};
use crate::plan::straight_line::{Merger, Plan};
use std::collections::{BTreeMap, BTreeSet};

/// A row of the table: equation, harmonic, cosine or sine.
pub type TableRow = (usize, usize, Trig);

/// The plan of every row's signal times cos or sin of its harmonic. Each equation's signal is multiplied either into
/// every harmonic, or into the first ones, from which the others then follow, whichever takes fewer operations.
pub(crate) fn bank(rows: &[TableRow]) -> Plan {
    let mut carried = BTreeSet::new();
    let mut best = Bank::plan(rows, &carried);
    // Equations that were refused for the current set of carried equations; they are not tried again before the set
    // changes.
    let mut refused = BTreeSet::new();
    for &(equation, ..) in rows {
        if refused.contains(&equation) || !carried.insert(equation) {
            continue;
        }
        let plan = Bank::plan(rows, &carried);
        if plan.ops.len() < best.ops.len() {
            best = plan;
            refused.clear();
        } else {
            carried.remove(&equation);
            refused.insert(equation);
        }
    }
    best
}

/// Highest harmonic whose phasor is computed from those of its halves. Higher ones are computed from the phasors
/// `FIRST` and `2 FIRST` harmonics below.
const FIRST: usize = 4;

/// Phasors of harmonics, alone or times a signal, operation by operation. Consecutive harmonics take the same
/// operations on earlier ones, so that compilers can vectorise them; special algebra for single harmonics would prevent
/// that.
struct Bank {
    merger: Merger,
    known: BTreeMap<(Option<usize>, usize), (Slot, Slot)>,
}

impl Bank {
    fn plan(rows: &[TableRow], carried: &BTreeSet<usize>) -> Plan {
        let mut bank = Self { merger: Merger::default(), known: BTreeMap::new() };
        let add = |&(equation, harmonic, function): &TableRow| {
            // The row of a mean needs no phasor, since its addend is the signal itself.
            let through = (harmonic == 0 || carried.contains(&equation)).then_some(equation);
            let (cos, sin) = bank.at(through, harmonic);
            let base = if function == Trig::Cos { cos } else { sin };
            if through.is_some() {
                return base;
            }
            let signal = bank.signal(equation);
            bank.merger.emit(Op::Mul(signal, base))
        };
        let outputs = rows.iter().map(add).collect();
        bank.merger.finish(outputs)
    }

    fn signal(&mut self, equation: usize) -> Slot {
        self.merger.load(Leaf::Signal(equation))
    }

    /// The order of the operands does not matter, since a product is one operation in either order.
    fn mul(&mut self, a: Slot, b: Slot) -> Slot {
        self.merger.emit(Op::Mul(a.min(b), a.max(b)))
    }

    /// cos and sin of k w t, times an equation's signal if one is given.
    fn at(&mut self, signal: Option<usize>, harmonic: usize) -> (Slot, Slot) {
        if let Some(&pair) = self.known.get(&(signal, harmonic)) {
            return pair;
        }
        let known = |k: usize| self.known.get(&(signal, k)).copied();
        let pair = match (signal, harmonic) {
            (None, 1) => [Leaf::Cos, Leaf::Sin].map(|leaf| self.merger.load(leaf)).into(),
            (Some(equation), 0) => {
                let zero = self.merger.emit(Op::Constant(rational::integer(0)));
                (self.signal(equation), zero)
            }
            (Some(equation), 1..=FIRST) => {
                let (signal, (cos, sin)) = (self.signal(equation), self.at(None, harmonic));
                (self.merger.emit(Op::Mul(signal, cos)), self.merger.emit(Op::Mul(signal, sin)))
            }
            _ => match (harmonic.checked_sub(FIRST).and_then(known), harmonic.checked_sub(2 * FIRST).and_then(known)) {
                // The three-term recurrence doubles the rounding errors over two steps and amplifies them as k^2 over
                // many, so it is used over two steps at most.
                (Some(near), Some(far)) if (2 * FIRST + 1..=4 * FIRST).contains(&harmonic) => {
                    let (cos, _) = self.at(None, FIRST);
                    let twice = self.merger.emit(Op::Add(cos, cos));
                    let [cos, sin] = [(near.0, far.0), (near.1, far.1)].map(|(near, far)| {
                        let turned = self.mul(twice, near);
                        self.merger.emit(Op::Sub(turned, far))
                    });
                    (cos, sin)
                }
                _ => self.sum(signal, harmonic),
            },
        };
        self.known.insert((signal, harmonic), pair);
        pair
    }

    /// cos and sin of k w t by angle addition: from a power of two and the remainder where both are known, otherwise
    /// from halves.
    fn sum(&mut self, signal: Option<usize>, harmonic: usize) -> (Slot, Slot) {
        let power = 1 << (harmonic - 1).ilog2();
        let both = self.known.contains_key(&(None, power)) && self.known.contains_key(&(signal, harmonic - power));
        let part = if both { harmonic - power } else { harmonic / 2 };
        let ((ca, sa), (cb, sb)) = (self.at(signal, part), self.at(None, harmonic - part));
        let [cc, ss, sc, cs] = [(ca, cb), (sa, sb), (sa, cb), (ca, sb)].map(|(a, b)| self.mul(a, b));
        (self.merger.emit(Op::Sub(cc, ss)), self.merger.emit(Op::Add(sc, cs)))
    }
}
