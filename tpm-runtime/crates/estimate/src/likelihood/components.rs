//! Terms that a model lacks as variance components: random coefficients whose variances the marginal likelihood tells.
//!
//! Of the triangle `[R_Y R_F z1; 0 R2 z2]` of the weighted equations the lower part `R2 c + e = z2`, e of unit variance, holds exactly the
//! restricted likelihood of the coefficients c, whatever the parameters are. With `c_i ~ N(0, gamma_i)`,
//!
//! ```text
//! -2 log p(z2) = log |V| + z2' V^-1 z2,   V = I + R2 Gamma R2'.
//! ```
//!
//! For a candidate beside the others, s = f' V^-1 f and q = f' V^-1 z2, the best gamma is (T - 1)/s with T = q^2/s, which gains
//! T - 1 - log T (Tipping and Faul 2003). Of a right model all variances are zero and nothing is widened.

use tpm_numerics::singular::unit_columns;
use tpm_numerics::{Cholesky, DMatrix, DVector, Dyn, gram};

/// An active candidate leaves below this share of the threshold at which it enters.
const LEAVE: f64 = 0.7;
/// An active candidate gives way to another that gains so much more: a factor of twenty in evidence.
const SWAP: f64 = 6.0;
/// Change of the logarithm of a variance after which it is left as it is.
const SETTLED: f64 = 1e-2;
/// Most steps of a climb, and most exchanges.
const STEPS: usize = 300;
const SWAPS: usize = 12;
/// The common variance is looked for on a grid of its logarithm, in these steps.
const GRID: f64 = 0.5;

/// The variances of all candidates. All products of columns are formed once, with columns of length one.
pub(crate) struct Components<'a> {
    products: &'a Products,
    threshold: f64,
    /// Variance of every candidate's coefficient; zero for one that takes no part.
    pub(crate) variance: Vec<f64>,
}

/// Products of the columns with each other and with the target.
pub(crate) struct Products {
    /// Lengths of the columns; one for a column of zeros.
    scale: Vec<f64>,
    gram: DMatrix<f64>,
    target: DVector<f64>,
    /// Share of the square of every candidate's length that the active ones must leave of it, for it to say something of its own.
    spanned: Vec<f64>,
}

impl Products {
    /// `spanned` are the shares of their lengths that others must leave of the candidates.
    pub(crate) fn of(factor: &DMatrix<f64>, target: &DVector<f64>, spanned: &[f64]) -> Self {
        let (columns, scale) = unit_columns(factor.clone());
        Products {
            gram: gram(&columns),
            target: columns.tr_mul(target),
            scale,
            spanned: spanned.iter().map(|share| share * share).collect(),
        }
    }
}

/// V^-1 by its active columns A: I - A (G^-1 + A'A)^-1 A', where all products are known.
struct Inverse {
    active: Vec<usize>,
    /// Of D A'A D + I, D the roots of the variances.
    factor: Option<Cholesky<f64, Dyn>>,
    roots: Vec<f64>,
}

impl Inverse {
    fn of(products: &Products, variance: &[f64]) -> Self {
        let active: Vec<usize> = (0..variance.len()).filter(|&i| variance[i] > 0.0).collect();
        let roots: Vec<f64> = active.iter().map(|&i| variance[i].sqrt() * products.scale[i]).collect();
        let n = active.len();
        let matrix = DMatrix::from_fn(n, n, |a, b| {
            products.gram[(active[a], active[b])] * roots[a] * roots[b] + if a == b { 1.0 } else { 0.0 }
        });
        Inverse { factor: if n > 0 { Cholesky::new(matrix) } else { None }, active, roots }
    }

    fn logs(&self) -> f64 {
        self.factor.as_ref().map_or(0.0, |factor| factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum())
    }

    /// L^-1 A' x, given A' x by its products.
    fn through(&self, product: &dyn Fn(usize) -> f64) -> DVector<f64> {
        let mut own = DVector::from_fn(self.active.len(), |a, _| self.roots[a] * product(self.active[a]));
        if let Some(factor) = &self.factor {
            factor.l_dirty().solve_lower_triangular_mut(&mut own);
        }
        own
    }
}

/// What a candidate says beside others.
#[derive(Clone, Copy)]
struct Said {
    s: f64,
    /// q^2/s.
    shown: f64,
}

impl Said {
    fn nothing() -> Self {
        Said { s: 1.0, shown: 0.0 }
    }

    /// From s and q of a column of length one, and the length that it has.
    fn of(s: f64, q: f64, length: f64, spanned: f64) -> Self {
        let shown = if s > spanned { q * q / s } else { 0.0 };
        Said { s: (s * length * length).max(f64::MIN_POSITIVE), shown }
    }

    fn best(self) -> f64 {
        if self.shown > 1.0 { (self.shown - 1.0) / self.s } else { 0.0 }
    }

    fn gain(self) -> f64 {
        if self.shown > 1.0 { self.shown - 1.0 - self.shown.ln() } else { 0.0 }
    }
}

impl<'a> Components<'a> {
    /// The variances that the likelihood prefers; a candidate enters when the square of its standardised coefficient is above
    /// `threshold`.
    pub(crate) fn found(products: &'a Products, threshold: f64) -> Self {
        let count = products.scale.len();
        let mut found = Components { products, threshold, variance: vec![0.0; count] };
        found.climb();
        let mut value = found.value();
        for _ in 0..SWAPS {
            let Some(variance) = found.exchange() else { break };
            let mut other = Components { products, threshold, variance };
            other.climb();
            let own = other.value();
            if own > value - 1.0 {
                break;
            }
            (found, value) = (other, own);
        }
        found
    }

    /// The candidates that take part.
    pub(crate) fn active(&self) -> impl Iterator<Item = usize> {
        (0..self.variance.len()).filter(|&i| self.variance[i] > 0.0)
    }

    /// -2 log p(z2) less that of no candidates.
    pub(crate) fn value(&self) -> f64 {
        let inverse = Inverse::of(self.products, &self.variance);
        inverse.logs() - inverse.through(&|i| self.products.target[i]).norm_squared()
    }

    /// What every candidate says beside the others. Of an active one with the variance d^2, K = I + D A'A D gives what it says beside the
    /// other active ones: s = (1/(K^-1)_ii - 1)/d^2, where nothing cancels that counts.
    fn all(&self, variance: &[f64]) -> Vec<Said> {
        let Products { scale, gram, target, spanned } = self.products;
        let inverse = Inverse::of(self.products, variance);
        let of_target = inverse.through(&|k| target[k]);
        let mut said: Vec<Said> = (0..variance.len())
            .map(|i| {
                if gram[(i, i)] <= 0.0 || variance[i] > 0.0 {
                    return Said::nothing();
                }
                let through = inverse.through(&|k| gram[(k, i)]);
                let (s, q) = (gram[(i, i)] - through.norm_squared(), target[i] - through.dot(&of_target));
                Said::of(s, q, scale[i], spanned[i])
            })
            .collect();
        let Some(factor) = &inverse.factor else { return said };
        let whole = factor.inverse();
        let roots = &inverse.roots;
        let weighted = DVector::from_fn(roots.len(), |a, _| roots[a] * target[inverse.active[a]]);
        let means = &whole * weighted;
        for (a, &i) in inverse.active.iter().enumerate() {
            let own = whole[(a, a)];
            let s = (1.0 / own - 1.0) / (roots[a] * roots[a]);
            said[i] = Said::of(s, means[a] / (roots[a] * own), scale[i], spanned[i]);
        }
        said
    }

    fn climb(&mut self) {
        for _ in 0..STEPS {
            let said = self.all(&self.variance);
            let active = |i: &usize| self.variance[*i] > 0.0;
            let by = |of: &dyn Fn(usize) -> f64, among: &dyn Fn(&usize) -> bool| {
                (0..said.len()).filter(among).map(|i| (i, of(i))).max_by(|a, b| a.1.total_cmp(&b.1))
            };
            if let Some((i, least)) = by(&|i| -said[i].shown, &active)
                && -least < LEAVE * self.threshold
            {
                self.variance[i] = 0.0;
                continue;
            }
            let change = |i: usize| (said[i].best().max(f64::MIN_POSITIVE) / self.variance[i]).ln().abs();
            if let Some((i, largest)) = by(&change, &active)
                && largest > SETTLED
            {
                self.variance[i] = said[i].best();
                continue;
            }
            let enters = |i: &usize| self.variance[*i] <= 0.0 && said[*i].shown > self.threshold;
            let Some((i, _)) = by(&|i| said[i].gain(), &enters) else { break };
            self.variance[i] = said[i].best();
        }
    }

    /// The variances with one active candidate exchanged for the one that gains most in its place.
    fn exchange(&self) -> Option<Vec<f64>> {
        let mut best: Option<(f64, Vec<f64>)> = None;
        for i in (0..self.variance.len()).filter(|&i| self.variance[i] > 0.0) {
            let mut without = self.variance.clone();
            without[i] = 0.0;
            let said = self.all(&without);
            let own = said[i].gain();
            let other = (0..said.len())
                .filter(|&k| k != i && without[k] <= 0.0 && said[k].shown > self.threshold)
                .max_by(|&a, &b| said[a].gain().total_cmp(&said[b].gain()));
            let Some(k) = other else { continue };
            let more = said[k].gain() - own;
            if more > SWAP && best.as_ref().is_none_or(|(most, _)| more > *most) {
                without[k] = said[k].best();
                best = Some((more, without));
            }
        }
        best.map(|(_, variance)| variance)
    }

    /// One common variance for all candidates beside the active ones, by the same likelihood: what many small terms would do. `counts`
    /// says which candidates take part.
    pub(super) fn common(&self, factor: &DMatrix<f64>, target: &DVector<f64>, counts: &[bool]) -> f64 {
        let n = target.len();
        let mut all = DMatrix::<f64>::zeros(n, n);
        let mut active = DMatrix::<f64>::identity(n, n);
        for (i, column) in factor.column_iter().enumerate() {
            if counts[i] {
                all.ger(1.0, &column, &column, 1.0);
            }
            if self.variance[i] > 0.0 {
                active.ger(self.variance[i], &column, &column, 1.0);
            }
        }
        let value = |variance: f64| -> Option<f64> {
            let factor = Cholesky::new(&active + &all * variance)?;
            let logs: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
            Some(logs + target.dot(&factor.solve(target)))
        };
        let largest = factor.column_iter().map(|column| column.norm_squared()).fold(0.0, f64::max);
        let Some(none) = value(0.0).filter(|_| largest > 0.0) else { return 0.0 };
        let tried = (-12..28).map(|step| (f64::from(step) * GRID).exp() / largest);
        let best = tried.filter_map(|variance| Some((variance, value(variance)?))).min_by(|a, b| a.1.total_cmp(&b.1));
        best.filter(|(_, value)| *value < none).map_or(0.0, |(variance, _)| variance)
    }
}

#[cfg(test)]
mod tests {
    const SPANNED: f64 = 0.1;

    use super::{Components, Products};
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use tpm_numerics::{DMatrix, DVector};

    #[test]
    fn what_a_candidate_says_is_what_is_left_without_it() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let n = 12;
        let factor = DMatrix::from_fn(n, n, |r, c| if c >= r { draw() * 10_f64.powi(c as i32 % 4) } else { 0.0 });
        let target = DVector::from_fn(n, |_, _| 100.0 * draw());
        let variance: Vec<f64> = (0..n).map(|i| if i % 3 == 0 { 10_f64.powi(i as i32 - 4) } else { 0.0 }).collect();
        let products = Products::of(&factor, &target, &[SPANNED; 20][..factor.ncols()]);
        let found = Components { products: &products, threshold: 9.0, variance: variance.clone() }.all(&variance);
        for (i, said) in found.iter().enumerate() {
            let mut whole = DMatrix::<f64>::identity(n, n);
            for k in (0..n).filter(|&k| k != i) {
                whole.ger(variance[k], &factor.column(k), &factor.column(k), 1.0);
            }
            let inverse = tpm_numerics::Cholesky::new(whole).expect("positive definite").inverse();
            let column = factor.column(i);
            let s = (inverse.clone() * column).dot(&column);
            let q = (inverse * column).dot(&target);
            let relative = s / column.norm_squared();
            if relative > SPANNED * SPANNED {
                assert!((said.s / s - 1.0).abs() < 1e-6, "{i}: {} {s}", said.s);
                assert!((said.shown / (q * q / s) - 1.0).abs() < 1e-5, "{i}: {} {}", said.shown, q * q / s);
            } else {
                assert!(said.shown == 0.0);
            }
        }
    }

    #[test]
    fn what_is_there_enters_and_what_is_not_stays_out() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let (mut entered, mut missed) = (0, 0);
        for _ in 0..50 {
            let factor = DMatrix::from_fn(20, 20, |r, c| if c >= r { draw() } else { 0.0 });
            let mut coefficients = DVector::zeros(20);
            coefficients[12] = 20.0;
            let target = &factor * &coefficients + DVector::from_fn(20, |_, _| draw());
            // Five in a hundred sets of twenty.
            let products = Products::of(&factor, &target, &[SPANNED; 20][..factor.ncols()]);
            let found = Components::found(&products, 9.14);
            missed += usize::from(found.variance[12] <= 0.0);
            entered += found.variance.iter().enumerate().filter(|(i, v)| *i != 12 && **v > 0.0).count();
        }
        assert!(missed == 0 && entered <= 8, "{missed} {entered}");
    }
}
