//! Chains of masses, built by hand (Feng, Eqns 4.1-4.4 with the coupling to both neighbours, and 4.30-4.31).

use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{Coordinate, ExprId};
use tpm_symbolic::mechanics::model::{Elimination, Equation, ExactModel, Kind, SourceTerm, TermId};
use tpm_symbolic::mechanics::pattern::{Motion, Pattern, rest_to_rest};

/// What to build.
#[derive(Clone, Copy)]
pub(crate) struct Chain {
    /// Number of masses; the force acts on the first, the last is the output.
    pub(crate) masses: u32,
    /// Whether the ground spring has a cubic part k2 x1^3.
    pub(crate) cubic: bool,
    /// Dampers d_i between the masses.
    pub(crate) dampers: bool,
}

/// The chain with all coordinates but the last to be eliminated, under the rest-to-rest pattern of the last.
pub(crate) fn chain(shape: Chain) -> ExactModel {
    let Chain { masses: l, cubic, dampers } = shape;
    let mut model = ExactModel { name: "Chain".to_owned(), ..ExactModel::default() };
    let x: Vec<Coordinate> = (1..=l).map(|i| model.declare_coordinate(&format!("x{i}"), None)).collect();
    let input = model.declare("F", None, Kind::Input);
    let input = model.graph.symbol(input);
    let parameter = |model: &mut ExactModel, name: String| -> ExprId {
        let symbol = model.declare(&name, None, Kind::Parameter);
        model.graph.symbol(symbol)
    };
    let m: Vec<ExprId> = (1..=l).map(|i| parameter(&mut model, format!("m{i}"))).collect();
    let k1 = parameter(&mut model, "k1".to_owned());
    let k2 = cubic.then(|| parameter(&mut model, "k2".to_owned()));
    let g: Vec<ExprId> = (1..l).map(|i| parameter(&mut model, format!("g{i}"))).collect();
    let d: Vec<ExprId> = (1..l).filter(|_| dampers).map(|i| parameter(&mut model, format!("d{i}"))).collect();
    let mut next = 0;
    for (i, &mass) in m.iter().enumerate() {
        let graph = &mut model.graph;
        let at = |graph: &mut tpm_symbolic::expr::graph::Graph, j: usize, n: u32| graph.derivative_of(x[j], n);
        let acceleration = at(graph, i, 2);
        let mut terms = vec![graph.mul(mass, acceleration)];
        for (spring, j) in [(i.wrapping_sub(1), i.wrapping_sub(1)), (i, i + 1)] {
            if j >= l as usize {
                continue;
            }
            let (own, other) = (at(graph, i, 0), at(graph, j, 0));
            let stretch = graph.sub(own, other);
            terms.push(graph.mul(g[spring], stretch));
            if dampers {
                let (own, other) = (at(graph, i, 1), at(graph, j, 1));
                let rate = graph.sub(own, other);
                terms.push(graph.mul(d[spring], rate));
            }
        }
        if i == 0 {
            let x1 = at(graph, 0, 0);
            terms.push(graph.mul(k1, x1));
            if let Some(k2) = k2 {
                let cube = graph.pow(x1, 3);
                terms.push(graph.mul(k2, cube));
            }
            terms.push(graph.neg(input));
        }
        let name = if i == 0 { "F".to_owned() } else { format!("eq{}", i + 1) };
        let terms = terms.into_iter().map(|expr| {
            next += 1;
            SourceTerm { id: TermId(next), expr }
        });
        let terms = terms.collect();
        model.equations.push(Equation { name, terms });
    }
    if l > 1 {
        let coordinates = x[..x.len() - 1].to_vec();
        model.eliminations.push(Elimination { coordinates, prefix: "c".to_owned() });
    }
    let amplitude = model.declare("lambda", None, Kind::Amplitude);
    let frequency = model.declare("w", None, Kind::Frequency);
    let rest = rest_to_rest(2 * l + 1).expect("odd order");
    let mut motions = vec![None; x.len()];
    motions[x.len() - 1] = Some(Motion::term(Monomial::power_of(amplitude, 1), rest));
    model.patterns.push(Pattern { name: None, amplitudes: vec![amplitude], frequency, motions });
    model
}

/// Two carts or more with a cubic ground spring and no dampers.
pub(crate) fn cubic(masses: u32) -> ExactModel {
    chain(Chain { masses, cubic: true, dampers: false })
}
