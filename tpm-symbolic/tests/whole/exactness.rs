//! The production expansion against the naive twin, on random models and patterns and on large ones, through every
//! width of numerators; and the identities that every table must satisfy.

use crate::naive;
use num_bigint::BigInt;
use num_rational::BigRational;
use num_traits::{One, Zero};
use proptest::prelude::{Just, ProptestConfig, Strategy, any, prop, prop_assert_eq, prop_oneof, proptest};
use std::ops::ControlFlow;
use tpm_symbolic::algebra::fourier::{Fourier, Trig};
use tpm_symbolic::algebra::polynomial::{Monomial, Polynomial};
use tpm_symbolic::expr::graph::{ExprId, Symbol};
use tpm_symbolic::harmonic::expand::{ExpandError, ExpandOptions, Progress, expand, expand_with};
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::model::{ExactModel, Kind, TermId};
use tpm_symbolic::mechanics::pattern::{Motion, Pattern, rest_to_rest};
use tpm_symbolic::number::rational::{Rational, integer, ratio};
use tpm_symbolic::regressor::form::{Column, RegressorForm, Row, Term};

/// A model whose regressor form is written term by term.
struct Builder {
    model: ExactModel,
    form: RegressorForm,
    next: u32,
}

impl Builder {
    fn new(coordinates: usize, equations: usize) -> Self {
        let mut model = ExactModel { name: "Test".to_owned(), ..ExactModel::default() };
        for i in 0..coordinates {
            model.declare_coordinate(&format!("q{i}"), None);
        }
        let row = |i| Row { name: format!("eq{i}").into(), terms: Vec::new(), inputs: Vec::new() };
        let form = RegressorForm { columns: Vec::new(), rows: (0..equations).map(row).collect() };
        Self { model, form, next: 0 }
    }

    fn symbol(&mut self, name: &str, kind: Kind) -> Symbol {
        self.model.declare(name, None, kind)
    }

    fn atom(&mut self, coordinate: u32, order: u32) -> ExprId {
        self.model.graph.derivative_of(tpm_symbolic::expr::graph::Coordinate(coordinate), order)
    }

    fn column(&mut self) -> usize {
        let (name, definition) = (format!("p{}", self.form.columns.len()), Polynomial::zero());
        self.form.columns.push(Column { name: name.into(), unit: None, definition, parameter: None });
        self.form.columns.len() - 1
    }

    fn term(&mut self, row: usize, column: Option<usize>, coefficient: Rational, atoms: &[(ExprId, i32)]) {
        self.next += 1;
        let atoms = atoms.iter().copied().collect();
        self.form.rows[row].terms.push(Term { column, coefficient, atoms, source: TermId(self.next) });
    }

    /// Sorts and collects terms into the canonical order of `regressor_form`.
    fn finish(&mut self) {
        for row in &mut self.form.rows {
            row.terms.sort_by(|a, b| (a.column, &a.atoms).cmp(&(b.column, &b.atoms)));
            row.terms.dedup_by(|next, kept| {
                let same = (next.column, &next.atoms) == (kept.column, &kept.atoms);
                if same {
                    kept.coefficient += &next.coefficient;
                }
                same
            });
            row.terms.retain(|term| !term.coefficient.is_zero());
        }
    }
}

fn rows_of(table: &HarmonicTable) -> Vec<naive::Row> {
    let mut rows: Vec<naive::Row> = table
        .entries()
        .map(|entry| {
            assert!(entry.sign.is_one());
            assert!(!entry.coefficient.is_zero(), "no zero entries");
            let coefficient: BigRational = entry.coefficient.into();
            let reduced = BigRational::new(coefficient.numer().clone(), coefficient.denom().clone());
            assert_eq!(reduced.denom(), coefficient.denom(), "lowest terms");
            let mut powers: Vec<(u32, i32)> = entry.powers.factors().map(|(&s, e)| (s as u32, e)).collect();
            if entry.pi != 0 {
                powers.push((u32::MAX, entry.pi));
            }
            (entry.equation, entry.harmonic, entry.function == Trig::Sin, entry.column, powers, coefficient)
        })
        .collect();
    assert_eq!(rows.len(), table.entries().len());
    let keys: Vec<_> = table.entries().map(|e| format!("{:?}", e.key())).collect();
    assert!(table.entries().collect::<Vec<_>>().is_sorted_by(|a, b| a.key() < b.key()), "sorted: {keys:?}");
    rows.sort();
    rows
}

fn agree(b: &Builder, pattern: &Pattern) {
    let table = expand(&b.model, &b.form, pattern).expect("finite");
    assert_eq!(rows_of(&table), naive::expand(&b.model, &b.form, pattern));
    let rebuilt = HarmonicTable::new(
        table.model.clone(),
        table.equations.clone(),
        table.parameters.clone(),
        table.symbols.clone(),
        table.entries().collect(),
    );
    assert_eq!(rebuilt, table, "a table is the list of its entries");
}

/// Small numbers mostly; now and then large ones, and denominators with large prime factors.
fn coefficient() -> impl Strategy<Value = Rational> {
    let big = |n: i128, d: u64| Rational::new(BigInt::from(n), BigInt::from(d));
    prop_oneof![
        4 => (-9i64..10, 1i64..10).prop_map(|(n, d)| ratio(n, d)),
        1 => (any::<i64>(), prop_oneof![Just(1u64), Just(1_000_003), Just(9_007_199_254_740_881), 1u64..u64::MAX])
            .prop_map(move |(n, d)| big(n.into(), d)),
        1 => (any::<i128>(), 1u64..2000).prop_map(move |(n, d)| big(n, d)),
    ]
}

fn fourier() -> impl Strategy<Value = Fourier> {
    let cosines = prop::collection::vec(coefficient(), 0..4);
    let sines = prop::collection::vec(coefficient(), 0..4);
    (cosines, sines, 0u8..4, 1usize..4).prop_map(|(cos, sin, kind, multiple)| {
        let shape = match kind {
            0 => Fourier::from_parts(cos, sin),
            1 => Fourier::from_parts(cos, Vec::new()),
            2 => Fourier::from_parts(Vec::new(), sin),
            // harmonics of one parity
            _ => {
                let odd = |list: Vec<Rational>| {
                    list.into_iter().enumerate().map(|(i, c)| if i % 2 == 1 { c } else { Rational::zero() }).collect()
                };
                Fourier::from_parts(odd(cos), Vec::new())
            }
        };
        shape.with_multiple(multiple)
    })
}

#[derive(Debug, Clone)]
struct RandomTerm {
    row: usize,
    column: Option<usize>,
    coefficient: Rational,
    motion: Vec<(u32, u32, i32)>,
    constants: Vec<(usize, i32)>,
    pi: i32,
}

fn random_term() -> impl Strategy<Value = RandomTerm> {
    let motion = prop::collection::vec((0u32..2, 0u32..5, 1i32..4), 0..3);
    let constants = prop::collection::vec((0usize..3, -3i32..4), 0..2);
    (0usize..2, prop::option::of(0usize..3), coefficient(), motion, constants, -1i32..2).prop_map(
        |(row, column, coefficient, motion, constants, pi)| RandomTerm {
            row,
            column,
            coefficient,
            motion,
            constants,
            pi,
        },
    )
}

fn check_random(terms: &[RandomTerm], parts: &[Vec<(usize, usize, Fourier)>], extra_symbols: usize) {
    let mut b = Builder::new(2, 2);
    let constants = [0, 1, 2].map(|i| b.symbol(&format!("c{i}"), Kind::Constant { value: None }));
    // Many unused and used symbols drive the packed exponents into several words.
    let spare: Vec<Symbol> =
        (0..extra_symbols).map(|i| b.symbol(&format!("s{i}"), Kind::Constant { value: None })).collect();
    let amplitudes = [0, 1].map(|i| b.symbol(&format!("a{i}"), Kind::Amplitude));
    let frequency = b.symbol("w", Kind::Frequency);
    let pi = b.model.graph.pi();
    for _ in 0..3 {
        b.column();
    }
    for term in terms {
        let mut atoms: Vec<(ExprId, i32)> = Vec::new();
        for &(coordinate, order, exponent) in &term.motion {
            atoms.push((b.atom(coordinate, order), exponent));
        }
        for &(constant, exponent) in &term.constants {
            atoms.push((b.model.graph.symbol(constants[constant]), exponent));
        }
        for &symbol in &spare {
            atoms.push((b.model.graph.symbol(symbol), 1));
        }
        atoms.push((pi, term.pi));
        b.term(term.row, term.column, term.coefficient.clone(), &atoms);
    }
    b.finish();
    let motions = parts.iter().map(|parts| {
        let part = |(kind, constant, fourier): &(usize, usize, Fourier)| {
            let monomial = match kind {
                0 => Monomial::power_of(constants[*constant], 1),
                1 => Monomial::power_of(amplitudes[*constant % 2], 1),
                2 => Monomial::power_of(amplitudes[0], 2).mul(&Monomial::power_of(constants[*constant], -1)),
                _ => Monomial::one(),
            };
            Motion::term(monomial, fourier.clone())
        };
        Some(parts.iter().fold(Motion::zero(), |motion, next| motion.add(&part(next))))
    });
    let pattern = Pattern { name: None, amplitudes: amplitudes.to_vec(), frequency, motions: motions.collect() };
    agree(&b, &pattern);
}

fn part() -> impl Strategy<Value = (usize, usize, Fourier)> {
    let constant = coefficient().prop_map(Fourier::constant);
    (0usize..4, 0usize..3, prop_oneof![2 => fourier(), 1 => constant, 1 => Just(Fourier::constant(integer(1)))])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(160))]

    #[test]
    fn random_models_agree_with_the_twin(
        terms in prop::collection::vec(random_term(), 1..5),
        parts in prop::collection::vec(prop::collection::vec(part(), 0..3), 2),
        extra in prop_oneof![4 => Just(0usize), 1 => 14usize..40],
    ) {
        check_random(&terms, &parts, extra);
    }

    #[test]
    fn products_of_fourier_polynomials_agree_with_the_twin(a in fourier(), b in fourier()) {
        let expected = naive::series_product(&naive::series_of(&a), &naive::series_of(&b));
        prop_assert_eq!(naive::series_of(&a.mul(&b)), expected);
    }

    #[test]
    fn powers_are_repeated_products(a in fourier(), n in 0u32..9) {
        let one: naive::Series = [((0, false), BigRational::one())].into();
        let base = naive::series_of(&a);
        let expected = (0..n).fold(one, |product, _| naive::series_product(&product, &base));
        prop_assert_eq!(naive::series_of(&a.pow(n)), expected);
    }

    /// On odd harmonics x^p x'^q has those of the parity of p + q, cosines for even q and sines for odd, up to (p + q) times
    /// the highest.
    #[test]
    fn harmonics_have_the_parity_of_the_product(p in 0i32..9, q in 0i32..9, half in 0u32..5) {
        let order = 2 * half + 1;
        let (b, pattern) = monomials(order, [(p, q)].into_iter());
        let table = expand(&b.model, &b.form, &pattern).expect("finite");
        let degree = usize::try_from(p + q).expect("not negative");
        for entry in table.entries() {
            prop_assert_eq!(entry.harmonic % 2, degree % 2);
            prop_assert_eq!(entry.function == Trig::Sin, q % 2 == 1);
        }
        let highest = table.entries().map(|entry| entry.harmonic).max();
        prop_assert_eq!(highest, Some(degree * order as usize));
    }
}

/// All x^p x'^q with `degrees` of p + q, under a rest-to-rest pattern.
fn monomials(order: u32, degrees: impl Iterator<Item = (i32, i32)>) -> (Builder, Pattern) {
    let mut b = Builder::new(1, 1);
    let (x, v) = (b.atom(0, 0), b.atom(0, 1));
    for (p, q) in degrees {
        let column = b.column();
        b.term(0, Some(column), integer(1), &[(x, p), (v, q)]);
    }
    b.finish();
    let amplitude = b.symbol("lambda", Kind::Amplitude);
    let frequency = b.symbol("w", Kind::Frequency);
    let motion = Motion::term(Monomial::power_of(amplitude, 1), rest_to_rest(order).expect("odd order"));
    let pattern = Pattern { name: None, amplitudes: vec![amplitude], frequency, motions: vec![Some(motion)] };
    (b, pattern)
}

fn all_up_to(degree: i32) -> impl Iterator<Item = (i32, i32)> {
    (0..=degree).flat_map(move |p| (0..=degree - p).map(move |q| (p, q)))
}

/// Column sums over the cosine harmonics are the regressor at t = 0 (at rest): 0 with a derivative in it, x(0)^p without.
fn check_column_sums(order: u32, degree: i32) -> HarmonicTable {
    let (b, pattern) = monomials(order, all_up_to(degree));
    let table = expand(&b.model, &b.form, &pattern).expect("finite");
    let start = rest_to_rest(order).expect("odd order").at_zero();
    let mut sums = vec![Rational::zero(); b.form.columns.len()];
    for entry in table.entries().filter(|entry| entry.function == Trig::Cos) {
        sums[entry.column.expect("no known term")] += entry.coefficient;
    }
    for ((p, q), sum) in all_up_to(degree).zip(sums) {
        let expected = if q > 0 { Rational::zero() } else { tpm_symbolic::number::rational::power(&start, p) };
        assert_eq!(sum, expected, "x^{p} x'^{q}");
    }
    table
}

#[test]
fn all_monomials_satisfy_the_column_sums() {
    for degree in [4, 8, 16] {
        check_column_sums(3, degree);
    }
    check_column_sums(5, 10);
    check_column_sums(13, 7);
}

#[test]
fn degree_32_has_the_known_size() {
    let table = check_column_sums(3, 32);
    assert_eq!(table.entries().len(), 18_241);
    let bits = table.entries().map(|entry| entry.coefficient.numer().bits()).max();
    assert_eq!(bits, Some(122));
}

#[test]
fn degree_64_satisfies_the_column_sums() {
    check_column_sums(3, 64);
}

#[test]
fn every_width_agrees_with_the_twin() {
    // x^p grows by about four bits a power: one word, two, three, four, six, eight, unlimited.
    for p in [8, 15, 16, 31, 32, 47, 64, 95, 130] {
        let (b, pattern) = monomials(3, [(p, 0), (p - 3, 3)].into_iter());
        agree(&b, &pattern);
    }
    let (b, pattern) = monomials(13, [(9, 0), (20, 1), (0, 25)].into_iter());
    agree(&b, &pattern);
    // The pattern's denominators fit no machine word.
    let (b, pattern) = monomials(101, [(2, 0), (1, 2)].into_iter());
    agree(&b, &pattern);
}

#[test]
fn offsets_cancel_before_anything_is_multiplied_out() {
    // (q - q0)^k is a^k F^k, whatever is written.
    let mut b = Builder::new(1, 1);
    let q = b.atom(0, 0);
    let offset = b.symbol("q0", Kind::Constant { value: None });
    let amplitude = b.symbol("a", Kind::Amplitude);
    let frequency = b.symbol("w", Kind::Frequency);
    let q0 = b.model.graph.symbol(offset);
    let k = 24u64;
    let column = b.column();
    for j in 0..=k {
        let sign = if j % 2 == 0 { BigInt::one() } else { -BigInt::one() };
        let coefficient = Rational::from_integer(tpm_symbolic::number::rational::binomial(k, j) * sign);
        b.term(0, Some(column), coefficient, &[(q, (k - j) as i32), (q0, j as i32)]);
    }
    b.finish();
    let shape = rest_to_rest(3).expect("odd order");
    let motion = Motion::term(Monomial::power_of(offset, 1), Fourier::constant(integer(1)))
        .add(&Motion::term(Monomial::power_of(amplitude, 1), shape.clone()));
    let pattern = Pattern { name: None, amplitudes: vec![amplitude], frequency, motions: vec![Some(motion)] };
    let mut steps = 0;
    let mut count = |_: Progress| {
        steps += 1;
        ControlFlow::Continue(())
    };
    let mut options = ExpandOptions { progress: Some(&mut count), ..ExpandOptions::default() };
    let table = expand_with(&b.model, &b.form, &pattern, &mut options).expect("finite");
    assert!(steps < 60, "one product, not {steps} steps");
    let power = shape.pow(k as u32);
    assert_eq!(table.entries().len(), power.terms().count());
    for (entry, (harmonic, function, value)) in table.entries().zip(power.terms()) {
        assert_eq!((entry.harmonic, entry.function, &entry.coefficient), (harmonic, function, value));
        assert_eq!(entry.powers, Monomial::power_of(amplitude.0 as usize, k as i32));
    }
}

#[test]
fn what_would_be_too_large_is_refused_before_the_work() {
    let (b, pattern) = monomials(3, [(2, 0), (30_000, 0)].into_iter());
    let error = expand(&b.model, &b.form, &pattern).expect_err("gigabytes");
    let ExpandError::TooLarge { term, entries, bytes, limit } = error.clone() else { panic!("{error}") };
    assert_eq!((term, limit), (TermId(2), ExpandOptions::DEFAULT_LIMIT));
    assert!(entries > 40_000 && bytes > limit);
    assert!(error.to_string().contains("MB"), "{error}");
    // A table that no machine can hold is refused even when large tables are allowed.
    let (b, pattern) = monomials(3, [(i32::MAX, i32::MAX)].into_iter());
    let mut options = ExpandOptions { allow_large: true, ..ExpandOptions::default() };
    let error = expand_with(&b.model, &b.form, &pattern, &mut options).expect_err("beyond memory");
    assert!(matches!(error, ExpandError::TooLarge { .. }), "{error}");
}

#[test]
fn a_long_expansion_can_be_stopped() {
    let (b, pattern) = monomials(3, [(3000, 0)].into_iter());
    let mut left = 40;
    let mut stop = |progress: Progress| {
        assert!(progress.done < progress.total);
        left -= 1;
        if left == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let mut options = ExpandOptions { progress: Some(&mut stop), ..ExpandOptions::default() };
    let error = expand_with(&b.model, &b.form, &pattern, &mut options).expect_err("stopped");
    assert_eq!(error, ExpandError::Stopped { term: TermId(1) });
    assert_eq!(left, 0);
}

#[test]
fn entries_far_apart_take_little_room() {
    let entry = |harmonic| tpm_symbolic::harmonic::table::Entry {
        equation: 0,
        harmonic,
        function: Trig::Cos,
        column: None,
        coefficient: ratio(1, 3),
        pi: 0,
        powers: Monomial::one(),
        sign: Monomial::one(),
    };
    let far = [5, 1, usize::MAX, 1 << 40];
    let table = HarmonicTable::new(
        "Far".into(),
        vec!["u".into()],
        Vec::new(),
        Vec::new(),
        far.into_iter().map(entry).collect(),
    );
    assert_eq!(table.entries().map(|e| e.harmonic).collect::<Vec<_>>(), [1, 5, 1 << 40, usize::MAX]);
    assert_eq!(table.highest_harmonic(0), usize::MAX);
    assert_eq!(table.rows().len(), 4);
    assert_eq!(table.at(0, 5, Trig::Cos, None).count(), 1);
    assert_eq!(table.at(0, 6, Trig::Cos, None).count(), 0);
}
