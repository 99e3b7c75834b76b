//! The reference motion of a pattern, computed from cosine and sine of its phase.

use crate::algebra::fourier::{Fourier, Trig};
use crate::expr::graph::{Coordinate, ExprId, Graph};
use crate::mechanics::model::ExactModel;
use crate::mechanics::pattern::{Motion, Pattern};
use crate::plan::constants;
use crate::plan::draft::Draft;
use crate::plan::leaf::Leaf;
use crate::plan::straight_line::Plan;
use std::collections::HashMap;

/// cos k theta and sin k theta by halving and angle addition. Every step adds a few roundings at any angle, whereas the
/// three-term recurrence loses digits as k^2 near the rest points, where a reference must be smooth.
struct Phasors<'d> {
    draft: &'d mut Draft,
    known: HashMap<usize, (ExprId, ExprId)>,
}

impl<'d> Phasors<'d> {
    fn new(draft: &'d mut Draft) -> Self {
        let (one, zero) = (draft.graph.integer(1), draft.graph.integer(0));
        let first = (draft.leaf(Leaf::Cos), draft.leaf(Leaf::Sin));
        Self { draft, known: HashMap::from([(0, (one, zero)), (1, first)]) }
    }

    fn at(&mut self, harmonic: usize) -> (ExprId, ExprId) {
        if let Some(&pair) = self.known.get(&harmonic) {
            return pair;
        }
        let (ca, sa) = self.at(harmonic / 2);
        let (cb, sb) = self.at(harmonic - harmonic / 2);
        let graph = &mut self.draft.graph;
        let (cc, ss, sc, cs) = (graph.mul(ca, cb), graph.mul(sa, sb), graph.mul(sa, cb), graph.mul(ca, sb));
        let pair = (graph.sub(cc, ss), graph.add(sc, cs));
        self.known.insert(harmonic, pair);
        pair
    }

    fn of(&mut self, harmonic: usize, function: Trig) -> ExprId {
        let (cos, sin) = self.at(harmonic);
        match function {
            Trig::Cos => cos,
            Trig::Sin => sin,
        }
    }

    fn series(&mut self, fourier: &Fourier) -> ExprId {
        let terms: Vec<ExprId> = fourier
            .terms()
            .map(|(harmonic, function, coefficient)| {
                let base = self.of(harmonic, function);
                self.draft.graph.scale(base, coefficient.clone())
            })
            .collect();
        self.draft.graph.sum(&terms)
    }
}

/// The plan of every coordinate of `coordinates` with its derivatives 0, 1, ... up to its own order, one coordinate
/// after the other; an error with the first coordinate that the pattern does not prescribe.
pub(crate) fn reference(
    model: &ExactModel,
    coordinates: &[(Coordinate, u32)],
    pattern: &Pattern,
) -> Result<Plan, Coordinate> {
    let mut draft = Draft::new(Graph::new());
    let w = draft.leaf(Leaf::Symbol(pattern.frequency));
    let mut roots = Vec::new();
    for &(coordinate, order) in coordinates {
        let motion = pattern.motions.get(coordinate.0 as usize).and_then(Option::as_ref);
        let motion = motion.ok_or(coordinate)?;
        for n in 0..=order {
            let value = motion_expr(model, &mut draft, &motion.derivative(n));
            let power = draft.graph.pow(w, i32::try_from(n).expect("invariant: derivative orders are small"));
            roots.push(draft.graph.mul(power, value));
        }
    }
    Ok(draft.plan(&roots))
}

fn motion_expr(model: &ExactModel, draft: &mut Draft, motion: &Motion) -> ExprId {
    let mut terms = Vec::with_capacity(motion.terms().len());
    for (monomial, fourier) in motion.terms() {
        let mut factors = vec![Phasors::new(draft).series(fourier)];
        for (&symbol, exponent) in monomial.factors() {
            let symbol = constants::quantity(model, draft, symbol);
            factors.push(draft.graph.pow(symbol, exponent));
        }
        terms.push(draft.graph.product(&factors));
    }
    draft.graph.sum(&terms)
}
