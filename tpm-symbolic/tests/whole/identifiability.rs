//! Exact identifiability of small models, and the harmonics that their terms reach.

use crate::chain::{Chain, chain, cubic};
use std::slice;
use tpm_symbolic::algebra::fourier::{Fourier, Trig};
use tpm_symbolic::algebra::polynomial::{Monomial, Polynomial};
use tpm_symbolic::expr::graph::{Coordinate, ExprId};
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::identifiability::{
    Experiment, Identifiability, IdentifiabilityError, evaluated_matrix, identifiability,
};
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
use tpm_symbolic::mechanics::pattern::{Motion, Pattern, rest_to_rest};
use tpm_symbolic::number::rational::{Rational, integer, ratio};
use tpm_symbolic::regressor::form::{RegressorForm, Row, regressor_form};
use tpm_symbolic::regressor::parameter_map::ParameterMap;
use tpm_symbolic::regressor::prepare::prepare;

/// A model under construction: terms (parameter name, motion factors) of one equation each.
struct Builder {
    model: ExactModel,
    x: Vec<Coordinate>,
    next: u32,
}

impl Builder {
    fn new(coordinates: &[&str]) -> Self {
        let mut model = ExactModel { name: "Test".to_owned(), ..ExactModel::default() };
        let x = coordinates.iter().map(|name| model.declare_coordinate(name, None)).collect();
        Self { model, x, next: 0 }
    }

    fn atom(&mut self, name: &str, kind: Kind) -> ExprId {
        let symbol = self.model.find_symbol(name).unwrap_or_else(|| self.model.declare(name, None, kind));
        self.model.graph.symbol(symbol)
    }

    /// coefficient * parameter * product of (coordinate, derivative, exponent)
    fn term(&mut self, coefficient: i64, parameter: &str, factors: &[(usize, u32, i32)]) -> ExprId {
        let mut product = vec![self.model.graph.integer(coefficient), self.atom(parameter, Kind::Parameter)];
        for &(coordinate, order, exponent) in factors {
            let base = self.model.graph.derivative_of(self.x[coordinate], order);
            product.push(self.model.graph.pow(base, exponent));
        }
        self.model.graph.product(&product)
    }

    fn row(&mut self, input: &str, mut terms: Vec<ExprId>) {
        let u = self.atom(input, Kind::Input);
        terms.push(self.model.graph.neg(u));
        let terms = terms.into_iter().map(|expr| {
            self.next += 1;
            SourceTerm { id: TermId(self.next), expr }
        });
        let terms = terms.collect();
        self.model.equations.push(Equation { name: input.to_owned(), terms });
    }

    fn pattern(&mut self, motions: &[(&str, Fourier)]) {
        let find = |model: &mut ExactModel, name: &str, kind: Kind| {
            model.find_symbol(name).unwrap_or_else(|| model.declare(name, None, kind))
        };
        let frequency = find(&mut self.model, "w", Kind::Frequency);
        let mut amplitudes = Vec::new();
        let motions = motions.iter().map(|(name, fourier)| {
            let amplitude = find(&mut self.model, name, Kind::Amplitude);
            amplitudes.push(amplitude);
            Some(Motion::term(Monomial::power_of(amplitude, 1), fourier.clone()))
        });
        let motions = motions.collect();
        self.model.patterns.push(Pattern { name: None, amplitudes, frequency, motions });
    }

    fn table(&self, pattern: usize) -> (RegressorForm, HarmonicTable) {
        let form = regressor_form(&self.model).expect("linear in the parameters");
        let table = expand(&self.model, &form, &self.model.patterns[pattern]).expect("finite");
        (form, table)
    }
}

fn rest(order: u32) -> Fourier {
    rest_to_rest(order).expect("odd order")
}

/// Feng, Eqns 5.1-5.7, in the deviations from (th10, th20), with f_i = a_i0 + a_i1 d + a_i2 d^2.
fn arm() -> Builder {
    let mut b = Builder::new(&["d1", "d2"]);
    let f = |b: &mut Builder, scale: i64, i: u32, motion: &[(usize, u32, i32)]| -> Vec<ExprId> {
        (0..3)
            .map(|k| {
                let mut factors = motion.to_vec();
                if k > 0 {
                    factors.push((1, 0, k));
                }
                b.term(scale, &format!("a{i}{k}"), &factors)
            })
            .collect()
    };
    let rate = |b: &mut Builder, scale: i64, i: u32, motion: &[(usize, u32, i32)]| -> Vec<ExprId> {
        (1..3)
            .map(|k| {
                let mut factors = motion.to_vec();
                if k > 1 {
                    factors.push((1, 0, k - 1));
                }
                b.term(scale * i64::from(k), &format!("a{i}{k}"), &factors)
            })
            .collect()
    };
    for i in 1..=3 {
        for k in 0..3 {
            b.atom(&format!("a{i}{k}"), Kind::Parameter);
        }
    }
    let mut first = f(&mut b, 2, 1, &[(0, 2, 1)]);
    first.extend(f(&mut b, 1, 3, &[(1, 2, 1)]));
    first.extend(rate(&mut b, 2, 1, &[(0, 1, 1), (1, 1, 1)]));
    first.extend(rate(&mut b, 1, 3, &[(1, 1, 2)]));
    b.row("tau1", first);
    let mut second = f(&mut b, 1, 3, &[(0, 2, 1)]);
    second.extend(f(&mut b, 2, 2, &[(1, 2, 1)]));
    second.extend(rate(&mut b, -1, 1, &[(0, 1, 2)]));
    second.extend(rate(&mut b, 1, 2, &[(1, 1, 2)]));
    b.row("tau2", second);
    // Both joints start at their reference: the shape minus its start.
    let shape = rest(3).sub(&Fourier::constant(ratio(8, 9)));
    b.pattern(&[("lambda1", shape.clone()), ("lambda2", shape.clone())]);
    b.pattern(&[("lambda1", shape.with_multiple(3)), ("lambda2", shape.with_multiple(2))]);
    b
}

fn power(found: &Identifiability, factors: &[(&str, i32)], coefficient: i64) -> Polynomial<usize> {
    let index = |name: &str| found.variables.iter().position(|v| v == name).expect("an indeterminate");
    let monomial = factors.iter().map(|(name, exponent)| (index(name), *exponent)).collect();
    Polynomial::term(monomial, integer(coefficient))
}

#[test]
fn one_pattern_shows_six_of_the_nine_arm_parameters() {
    let b = arm();
    let (_, table) = b.table(0);
    assert_eq!(table.parameters, ["a10", "a11", "a12", "a20", "a21", "a22", "a30", "a31", "a32"]);
    let found = identifiability(&[Experiment::new("one", &table)]).expect("one table");
    assert_eq!((found.rank, found.proven), (6, true));
    let directions = found.unobservable.as_ref().expect("short");
    assert_eq!(directions.len(), 3);
    for k in 0..3 {
        let mut expected = vec![Polynomial::zero(); 9];
        expected[k] = power(&found, &[("lambda2", 2)], 1);
        expected[3 + k] = power(&found, &[("lambda1", 2)], 1);
        expected[6 + k] = power(&found, &[("lambda1", 1), ("lambda2", 1)], -2);
        assert!(directions.contains(&expected), "k = {k}: {directions:?}");
    }
    assert!(found.observability.iter().all(|o| !o.observable && !o.visible.is_empty() && o.band.is_none()));
    // The observable set: a1k + lambda2/(2 lambda1) a3k and a2k + lambda1/(2 lambda2) a3k.
    let base = found.base.as_ref().expect("short");
    assert_eq!(base.len(), 6);
    assert_eq!(found.parameters[base[0].column], "a10");
    let [(other, factor)] = &base[0].others[..] else { panic!("{:?}", base[0]) };
    assert_eq!(found.parameters[*other], "a30");
    assert_eq!(factor.display(|variable: &usize| found.variables[*variable].clone()), "lambda2/2/lambda1");
}

#[test]
fn at_given_amplitudes_the_direction_is_a_rational_vector() {
    let b = arm();
    let (_, table) = b.table(0);
    let run = Experiment::new("one", &table)
        .with("lambda1", ratio(-1406, 100))
        .with("lambda2", ratio(1143, 100))
        .with("w", integer(2));
    let found = identifiability(&[run]).expect("one table");
    assert_eq!((found.rank, found.variables.len()), (6, 0));
    let directions = found.unobservable.expect("numbers");
    let value = |j: usize| directions[0][j].as_constant().expect("a number");
    // (lambda2^2, lambda1^2, -2 lambda1 lambda2) up to a factor
    let (l1, l2) = (ratio(-1406, 100), ratio(1143, 100));
    assert_eq!(value(3) / value(0), &l1 * &l1 / (&l2 * &l2));
    assert_eq!(value(6) / value(0), integer(-2) * l1 / l2);
}

#[test]
fn two_amplitude_ratios_or_two_multiples_show_all_nine() {
    let b = arm();
    let (_, one) = b.table(0);
    let (_, other) = b.table(1);
    let multiples = identifiability(&[Experiment::new("3w and 2w", &other)]).expect("one table");
    assert_eq!((multiples.rank, multiples.proven), (9, true));
    assert!(multiples.observability.iter().all(|o| o.observable));
    let run = |sign: i64| {
        Experiment::new("run", &one).with("lambda1", integer(1)).with("lambda2", integer(sign)).with("w", integer(2))
    };
    assert_eq!(identifiability(&[run(1), run(-1)]).expect("two runs").rank, 9);
    // A run with an equal ratio of amplitudes adds nothing, whatever its frequency and size.
    let faster =
        Experiment::new("faster", &one).with("lambda1", integer(3)).with("lambda2", integer(3)).with("w", integer(7));
    assert_eq!(identifiability(&[run(1), faster]).expect("two runs").rank, 6);
    // Amplitudes left open are independent of each other.
    let open = identifiability(&[Experiment::new("1", &one), Experiment::new("2", &one)]).expect("two runs");
    assert_eq!((open.rank, open.proven), (9, true));
    assert!(open.variables.contains(&"lambda1[2]".to_owned()));
    // Neither of the two runs shows any parameter by itself.
    assert!(open.observability.iter().all(|o| o.experiments.is_empty() && o.observable));
    let mixed = identifiability(&[Experiment::new("1", &one), Experiment::new("2", &other)]).expect("two runs");
    assert!(mixed.observability.iter().all(|o| o.experiments == [1]));
}

#[test]
fn two_carts_are_identified_whole() {
    let prepared = prepare(cubic(2)).expect("a chain");
    let table = expand(&prepared.model, &prepared.form, &prepared.model.patterns[0]).expect("finite");
    let found = identifiability(&[Experiment::of("run", &prepared.model, &table)]).expect("one table");
    assert_eq!((found.rank, found.proven, found.rows.len()), (7, true, 8));
    assert!(found.observability.iter().all(|o| o.observable && o.experiments == [0]));
    let physical = found.physical(&ParameterMap::new(&prepared)).expect("rational");
    assert_eq!((physical.rank, physical.determined), (5, vec![true; 5]));
}

#[test]
fn linear_chains_are_seen_but_not_taken_apart() {
    for masses in 2..=4 {
        let prepared = prepare(chain(Chain { masses, cubic: false, dampers: false })).expect("a chain");
        let table = expand(&prepared.model, &prepared.form, &prepared.model.patterns[0]).expect("finite");
        let found = identifiability(&[Experiment::of("run", &prepared.model, &table)]).expect("one table");
        let physical = found.physical(&ParameterMap::new(&prepared)).expect("rational");
        let masses = masses as usize;
        assert_eq!(found.rank, masses + 1);
        assert_eq!((physical.rank, physical.parameters.len()), (masses + 1, 2 * masses));
        let determined: Vec<&String> =
            physical.parameters.iter().zip(&physical.determined).filter(|(_, d)| **d).map(|(name, _)| name).collect();
        assert_eq!(determined, ["k1"]);
    }
}

/// Feng, Eqn 3.24.
fn mass_spring_drag() -> Builder {
    let mut b = Builder::new(&["x"]);
    let terms = vec![b.term(1, "m", &[(0, 2, 1)]), b.term(1, "k1", &[(0, 0, 1)]), b.term(1, "k2", &[(0, 1, 2)])];
    b.row("u", terms);
    b.pattern(&[("lambda", rest(3))]);
    b
}

#[test]
fn which_harmonics_make_a_parameter_observable() {
    let b = mass_spring_drag();
    let (_, table) = b.table(0);
    let found = identifiability(&[Experiment::new("run", &table)]).expect("one table");
    assert_eq!(found.rank, 3);
    let harmonics = |column: usize| -> Vec<usize> {
        found.observability[column].visible.iter().map(|&row| found.rows[row].harmonic).collect()
    };
    assert_eq!((harmonics(0), harmonics(1), harmonics(2)), (vec![1, 3], vec![1, 3], vec![0, 2, 4, 6]));
    // Mass and stiffness share harmonic 1 and come apart with harmonic 3; drag shows in the mean already.
    let bands: Vec<Option<usize>> = found.observability.iter().map(|o| o.band).collect();
    assert_eq!(bands, [Some(3), Some(3), Some(0)]);
}

#[test]
fn what_acts_beside_the_model_at_a_harmonic_without_redundancy_is_taken_for_parameters() {
    let b = mass_spring_drag();
    let (_, table) = b.table(0);
    let unchecked = |runs: &[Experiment<'_>]| -> Vec<Vec<usize>> {
        let found = identifiability(runs).expect("experiments");
        found.observability.iter().map(|o| o.unchecked.iter().map(|&row| found.rows[row].harmonic).collect()).collect()
    };
    // Two harmonics determine mass and stiffness, and drag has four for itself.
    let run = Experiment::new("run", &table);
    assert_eq!(unchecked(slice::from_ref(&run)), [vec![1, 3], vec![1, 3], vec![]]);
    // Mass and stiffness together are one base parameter, which harmonic 1 alone shows.
    assert_eq!(unchecked(&[run.clone().up_to(Some(2))]), [vec![1], vec![], vec![]]);
    assert!(unchecked(&[run.clone(), run.with("w", integer(2))]).iter().all(Vec::is_empty));
    // Of carts with as many rows as rank all that is known is unchecked, parameters and base parameters.
    let prepared = prepare(cubic(3)).expect("a chain");
    let table = expand(&prepared.model, &prepared.form, &prepared.model.patterns[0]).expect("finite");
    let found = identifiability(&[Experiment::of("run", &prepared.model, &table)]).expect("one table");
    assert_eq!(found.rank, found.rows.len());
    let base = found.base.as_ref().expect("short");
    assert!(base.iter().all(|one| !found.observability[one.column].unchecked.is_empty()));
    // No harmonic of theirs is the mean.
    let nothing = Experiment::of("run", &prepared.model, &table).up_to(Some(0));
    let nothing = identifiability(&[nothing]).expect("one table");
    assert_eq!((nothing.rank, nothing.rows.len()), (0, 0));
    assert!(nothing.observability.iter().all(|o| !o.observable && o.unchecked.is_empty()));
}

#[test]
fn a_sinusoid_cannot_tell_mass_from_stiffness() {
    let mut b = mass_spring_drag();
    b.model.patterns.clear();
    b.pattern(&[("lambda", Fourier::cos(1, integer(1)))]);
    let (_, table) = b.table(0);
    let found = identifiability(&[Experiment::new("run", &table)]).expect("one table");
    assert_eq!((found.rank, found.proven), (2, true));
    let directions = found.unobservable.as_ref().expect("short");
    let expected = [power(&found, &[], 1), power(&found, &[("w", 2)], 1), Polynomial::zero()];
    assert_eq!(directions, &[expected]);
    assert!(found.observability[2].observable);
    // At two frequencies they come apart.
    let at = |w: i64| Experiment::new("run", &table).with("w", integer(w)).with("lambda", integer(1));
    assert_eq!(identifiability(&[at(1), at(2)]).expect("two runs").rank, 3);
}

#[test]
fn directions_need_not_be_monomials() {
    // k0 + k1 x^2 + k2 x'^2 on x = a cos + b sin: x'^2 + w^2 x^2 is constant.
    let mut b = Builder::new(&["x"]);
    let terms = vec![b.term(1, "k0", &[]), b.term(1, "k1", &[(0, 0, 2)]), b.term(1, "k2", &[(0, 1, 2)])];
    b.row("u", terms);
    b.pattern(&[("a", Fourier::cos(1, integer(1)))]);
    let sine = b.model.declare("b", None, Kind::Amplitude);
    let cosine = b.model.patterns[0].motions[0].clone().expect("given");
    let motion = cosine.add(&Motion::term(Monomial::power_of(sine, 1), Fourier::sin(1, integer(1))));
    b.model.patterns[0].motions[0] = Some(motion);
    let (_, table) = b.table(0);
    let found = identifiability(&[Experiment::new("run", &table)]).expect("one table");
    assert_eq!((found.rank, found.proven), (2, true));
    let directions = found.unobservable.as_ref().expect("short");
    let squares = power(&found, &[("a", 2), ("w", 2)], 1).add(&power(&found, &[("b", 2), ("w", 2)], 1));
    let minus = |p: Polynomial<usize>| p.scale(&integer(-1));
    let expected = [squares, minus(power(&found, &[("w", 2)], 1)), minus(power(&found, &[], 1))];
    assert_eq!(directions, &[expected]);
    assert_eq!(evaluated_matrix(&[&table], |_, _| 1.0).1.len(), found.rows.len());
}

#[test]
fn experiments_that_do_not_fit_are_refused() {
    let (b, a) = (mass_spring_drag(), arm());
    let ((_, drag), (_, arm)) = (b.table(0), a.table(0));
    assert_eq!(identifiability(&[]), Err(IdentifiabilityError::NoExperiment));
    let wrong = identifiability(&[Experiment::new("1", &drag), Experiment::new("2", &arm)]);
    assert_eq!(wrong, Err(IdentifiabilityError::Parameters { experiment: "2".to_owned() }));
    let unknown = identifiability(&[Experiment::new("1", &drag).with("lamda", integer(1))]);
    assert!(matches!(unknown, Err(IdentifiabilityError::UnknownSymbol { .. })), "{unknown:?}");
    // A standstill shows nothing.
    let still = identifiability(&[Experiment::new("1", &drag).with("lambda", integer(0))]).expect("a setting");
    assert_eq!(still.rank, 0);
}

/// The harmonics of every term of the first equation: its column's name, its motion and the harmonics that it reaches.
fn contents(model: &ExactModel, form: &RegressorForm) -> Vec<(String, String, Vec<usize>)> {
    let mut graph = model.graph.clone();
    let terms = form.rows[0].terms.iter().map(|term| {
        let factors: Vec<ExprId> = term.atoms.factors().map(|(&atom, exponent)| graph.pow(atom, exponent)).collect();
        let motion = graph.product(&factors);
        let alone = RegressorForm {
            columns: form.columns.clone(),
            rows: vec![Row { terms: vec![term.clone()], ..form.rows[0].clone() }],
        };
        let table = expand(model, &alone, &model.patterns[0]).expect("finite");
        let mut harmonics: Vec<usize> = table.entries().map(|entry| entry.harmonic).collect();
        harmonics.dedup();
        let parameter = term.column.map_or_else(String::new, |column| form.columns[column].name.to_string());
        (parameter, graph.display(motion, model), harmonics)
    });
    terms.collect()
}

#[test]
fn the_content_of_every_term() {
    let b = mass_spring_drag();
    let (form, table) = b.table(0);
    let content = contents(&b.model, &form);
    let found: Vec<(&str, &[usize])> =
        content.iter().map(|(_, motion, harmonics)| (motion.as_str(), harmonics.as_slice())).collect();
    assert_eq!(found, [("ddot(x)", &[1, 3][..]), ("x", &[1, 3]), ("dot(x)^2", &[0, 2, 4, 6])]);
    // Feng, Eqn 2.28, would give 3 (2 + 1) = 9 for this model; 3 max(1, max{i+j}) is 6.
    assert_eq!(table.highest_harmonic(0), 6);
}

#[test]
fn products_reach_the_corrected_highest_harmonic() {
    for l in 1..=2u32 {
        let order = 2 * l + 1;
        let mut b = Builder::new(&["x"]);
        let mut terms = Vec::new();
        for i in 0..=4 {
            for j in 0..=(4 - i) {
                let factors: Vec<_> = [(0, 1, i), (0, 0, j)].into_iter().filter(|(_, _, e)| *e > 0).collect();
                terms.push(b.term(1, &format!("k{i}{j}"), &factors));
            }
        }
        b.row("u", terms);
        b.pattern(&[("lambda", rest(order))]);
        let (form, table) = b.table(0);
        for (name, _, harmonics) in contents(&b.model, &form) {
            assert!(!name.is_empty(), "a parameter");
            let degree: u32 = name.chars().skip(1).filter_map(|c| c.to_digit(10)).sum();
            assert_eq!(harmonics.last(), Some(&((order * degree) as usize)), "{name}");
            assert!(harmonics.iter().all(|h| h % 2 == degree as usize % 2), "{name}");
        }
        assert_eq!(table.highest_harmonic(0), 4 * order as usize);
    }
    // The inertia alone reaches 2l + 1.
    let prepared = prepare(cubic(2)).expect("a chain");
    let table = expand(&prepared.model, &prepared.form, &prepared.model.patterns[0]).expect("finite");
    assert_eq!(table.highest_harmonic(0), 15);
    assert_eq!(contents(&prepared.model, &prepared.form)[0].2, [1, 3, 5]);
}

#[test]
fn values_in_double_precision_agree_with_the_exact_matrix() {
    let b = mass_spring_drag();
    let (_, table) = b.table(0);
    let (labels, matrix) = evaluated_matrix(&[&table], |_, name| if name == "w" { 2.0 } else { 0.5 });
    let exact: Rational = ratio(-5, 6);
    let row = labels.iter().position(|l| l.harmonic == 2 && l.function == Trig::Cos).expect("present");
    // -5/6 lambda^2 w^2 with lambda = 1/2, w = 2
    assert_eq!(matrix[row], [0.0, 0.0, tpm_symbolic::number::rational::to_f64(&exact)]);
}
