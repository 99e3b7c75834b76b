//! W5: a chain of carts with a cubic ground spring, all but the last cart eliminated.
//!
//! The equation of cart i, m_i x_i'' + g_{i-1} (x_i - x_{i-1}) + g_i (x_i - x_{i+1}) = 0, gives
//! x_{i-1} = x_i + (m_i x_i'' + ... + m_l x_l'')/g_{i-1} (Feng, Eqns 4.5-4.12).

use crate::workloads::{Builder, Workload, shape};
use tpm_symbolic::algebra::polynomial::{Monomial, Polynomial};
use tpm_symbolic::mechanics::model::{Elimination, Kind};
use tpm_symbolic::number::rational::integer;
use tpm_symbolic::regressor::prepare::prepare;

/// W5(a): k2 x1^3 multiplied out, with symbolic masses and stiffnesses.
pub struct Cube {
    carts: u32,
}

impl Cube {
    /// The cube for a chain of `carts` carts.
    #[must_use]
    pub fn new(carts: u32) -> Self {
        Self { carts }
    }

    /// The coefficient of x_l^(2k) in x_1 for every k. Variable i is m_i, variable l + i is g_i.
    fn first_cart(&self) -> Vec<Polynomial<u32>> {
        let l = self.carts;
        let term = |variable, exponent| Polynomial::term(Monomial::power_of(variable, exponent), integer(1));
        let mut x = vec![Polynomial::one()];
        let mut forces: Vec<Polynomial<u32>> = Vec::new();
        for cart in (2..=l).rev() {
            let (mass, flexibility) = (term(cart, 1), term(l + cart - 1, -1));
            forces.resize(x.len() + 1, Polynomial::zero());
            for (order, coefficient) in x.iter().enumerate() {
                forces[order + 1].add_assign(&coefficient.mul(&mass));
            }
            x.resize(forces.len(), Polynomial::zero());
            for (slot, force) in x.iter_mut().zip(&forces) {
                slot.add_assign(&force.mul(&flexibility));
            }
        }
        x
    }

    /// k2 x1^3. Variable 2 l + k is x_l^(2k), variable 0 is k2.
    #[must_use]
    pub fn expand(&self) -> Polynomial<u32> {
        let motion =
            |(k, coefficient): (u32, &Polynomial<u32>)| coefficient.mul(&Polynomial::variable(2 * self.carts + k));
        let x1 = (0..).zip(&self.first_cart()).map(motion).fold(Polynomial::zero(), |sum, part| sum.add(&part));
        Polynomial::product_of_powers(&[(&Polynomial::variable(0), 1), (&x1, 3)])
    }

    /// Every term as `coefficient symbol^power ...`, for comparison with other tools.
    #[must_use]
    pub fn listing(&self) -> Vec<String> {
        let l = self.carts;
        let name = |variable: u32| match variable {
            0 => "k2".to_owned(),
            v if v <= l => format!("m{v}"),
            v if v < 2 * l => format!("g{}", v - l),
            v => format!("x{}", 2 * (v - 2 * l)),
        };
        let line = |(monomial, coefficient): (&Monomial<u32>, _)| {
            let mut powers: Vec<String> = monomial.factors().map(|(&v, e)| format!(" {}^{e}", name(v))).collect();
            powers.sort();
            format!("{coefficient}{}", powers.concat())
        };
        self.expand().terms().map(line).collect()
    }
}

/// W5(b): the table of the chain's lumped parameters, on the pattern of order 2 l + 1.
#[must_use]
pub fn chain(carts: u32) -> Workload {
    let mut b = Builder::new("Chain");
    let names = |prefix: &str, last: u32| -> Vec<String> { (1..=last).map(|i| format!("{prefix}{i}")).collect() };
    let x: Vec<_> = names("x", carts).iter().map(|name| b.model.declare_coordinate(name, None)).collect();
    let m: Vec<_> = names("m", carts).iter().map(|name| b.quantity(name, Kind::Parameter)).collect();
    let [k1, k2] = b.parameters(["k1", "k2"]);
    let springs: Vec<_> = names("g", carts - 1).iter().map(|name| b.quantity(name, Kind::Parameter)).collect();
    for cart in 0..x.len() {
        let g = &mut b.model.graph;
        let (own, acceleration) = (g.derivative_of(x[cart], 0), g.derivative_of(x[cart], 2));
        let mut terms = vec![g.mul(m[cart], acceleration)];
        if cart == 0 {
            let cube = g.pow(own, 3);
            terms.extend([g.mul(k1, own), g.mul(k2, cube)]);
        }
        let before = cart.checked_sub(1).map(|before| (springs[before], x[before]));
        let after = springs.get(cart).map(|&spring| (spring, x[cart + 1]));
        for (spring, other) in before.into_iter().chain(after) {
            let other = g.derivative_of(other, 0);
            let stretch = g.sub(own, other);
            terms.push(g.mul(spring, stretch));
        }
        if cart == 0 {
            b.equation("F", terms);
        } else {
            b.free_equation(&format!("eq{}", cart + 1), terms);
        }
    }
    b.model.eliminations.push(Elimination { coordinates: x[..x.len() - 1].to_vec(), prefix: "c".to_owned() });
    let mut motions = vec![None; x.len() - 1];
    motions.push(Some(("lambda", None, shape(2 * carts + 1))));
    b.finish_with(motions, |model| {
        let prepared = prepare(model).expect("invariant: chains can be eliminated");
        (prepared.model, prepared.form)
    })
}
