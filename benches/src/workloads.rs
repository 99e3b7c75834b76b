//! The expansion workloads, as models in memory: built once, expanded many times.

use std::collections::BTreeMap;
use tpm_symbolic::algebra::fourier::{Fourier, Trig};
use tpm_symbolic::algebra::polynomial::Monomial;
use tpm_symbolic::expr::graph::{ExprId, Graph, Names as _, Node};
use tpm_symbolic::harmonic::expand::expand;
use tpm_symbolic::harmonic::table::HarmonicTable;
use tpm_symbolic::linear::jet::nodes_of;
use tpm_symbolic::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
use tpm_symbolic::mechanics::pattern::{Motion, Pattern, rest_to_rest};
use tpm_symbolic::number::rational::{Rational, integer, ratio};
use tpm_symbolic::regressor::form::{RegressorForm, regressor_form};

/// A workload ready to expand.
pub struct Workload {
    /// The model; its equations are not read any more.
    pub model: ExactModel,
    /// The model sorted into its parameters.
    pub form: RegressorForm,
    /// The trajectory pattern.
    pub pattern: Pattern,
}

impl Workload {
    /// The table, within the default limits.
    ///
    /// # Panics
    /// When the workload does not expand, which would be a fault of this crate.
    #[must_use]
    pub fn expand(&self) -> HarmonicTable {
        self.table(&self.form)
    }

    /// The table from the model as it was declared, sorted into its parameters first; `None` where coordinates were
    /// eliminated on the way.
    ///
    /// # Panics
    /// When the workload does not expand, which would be a fault of this crate.
    #[must_use]
    pub fn derive(&self) -> Option<HarmonicTable> {
        self.model.eliminations.is_empty().then(|| self.table(&sorted(&self.model)))
    }

    fn table(&self, form: &RegressorForm) -> HarmonicTable {
        expand(&self.model, form, &self.pattern).expect("invariant: workloads expand")
    }
}

fn sorted(model: &ExactModel) -> RegressorForm {
    regressor_form(model).expect("invariant: workloads are linear in their parameters")
}

/// Every entry as `equation parameter function harmonic coefficient symbol^power ...`, for comparison with other tools.
#[must_use]
pub fn listing(table: &HarmonicTable) -> Vec<String> {
    table
        .entries()
        .map(|entry| {
            let mut line = format!(
                "{} {} {} {} {}",
                table.equations[entry.equation],
                entry.column.map_or("-", |column| table.parameters[column].as_str()),
                if entry.function == Trig::Cos { "cos" } else { "sin" },
                entry.harmonic,
                entry.coefficient
            );
            let mut powers: Vec<String> =
                entry.powers.factors().map(|(&s, power)| format!(" {}^{power}", table.symbols[s])).collect();
            powers.sort();
            line.push_str(&powers.concat());
            line
        })
        .collect()
}

/// The input of an expansion as lines, for other tools that start there too. Every coordinate and part of its motion
/// has a line `motion coordinate symbol harmonic:coefficient ...` (cosines). Every node of the equations' expressions
/// has a line `node number kind ...` after the nodes that it needs. Every equation has a line `equation name node ...`
/// with its terms.
///
/// # Panics
/// When a motion has sines or an expression has functions, which no workload has.
#[must_use]
pub fn source(workload: &Workload) -> Vec<String> {
    let Workload { model, pattern, .. } = workload;
    let mut lines = Vec::new();
    for (coordinate, motion) in pattern.motions.iter().enumerate() {
        for (symbols, shape) in motion.iter().flat_map(Motion::terms) {
            let mut line = format!("motion {coordinate}");
            for (&symbol, exponent) in symbols.factors() {
                assert_eq!(exponent, 1, "parts of workloads have one symbol");
                line.push_str(&format!(" {}", model.symbol_name(symbol)));
            }
            for (harmonic, function, coefficient) in shape.terms() {
                assert_eq!(function, Trig::Cos, "workloads are sums of cosines");
                line.push_str(&format!(" {harmonic}:{coefficient}"));
            }
            lines.push(line);
        }
    }
    let mut numbers = BTreeMap::new();
    for equation in &model.equations {
        for (id, node) in equation.terms.iter().flat_map(|term| nodes_of(&model.graph, term.expr)) {
            if !numbers.contains_key(&id) {
                lines.push(format!("node {} {}", numbers.len(), written(model, &node, &numbers)));
                numbers.insert(id, numbers.len());
            }
        }
        let terms = equation.terms.iter().map(|term| format!(" {}", numbers[&term.expr]));
        lines.push(format!("equation {}{}", equation.name, terms.collect::<String>()));
    }
    lines
}

/// The text of a node, with the numbers of the nodes that it needs.
fn written(model: &ExactModel, node: &Node, numbers: &BTreeMap<ExprId, usize>) -> String {
    let all = |kind: &str, operands: &[ExprId]| {
        let operands = operands.iter().map(|operand| format!(" {}", numbers[operand]));
        format!("{kind}{}", operands.collect::<String>())
    };
    match node {
        Node::Number(value) => format!("number {value}"),
        Node::Symbol(symbol) => {
            let kind = match model.quantity(*symbol).kind {
                Kind::Parameter => "parameter",
                Kind::Input => "input",
                _ => "constant",
            };
            format!("{kind} {}", model.symbol_name(*symbol))
        }
        Node::Derivative(coordinate, order) => format!("derivative {} {order}", coordinate.0),
        Node::Sum(terms) => all("sum", terms),
        Node::Product(factors) => all("product", factors),
        Node::Power(base, exponent) => format!("{} {exponent}", all("power", &[*base])),
        _ => panic!("workloads are polynomials"),
    }
}

pub(crate) struct Builder {
    pub(crate) model: ExactModel,
    next: u32,
}

impl Builder {
    pub(crate) fn new(name: &str) -> Self {
        Self { model: ExactModel { name: name.to_owned(), ..ExactModel::default() }, next: 0 }
    }

    pub(crate) fn quantity(&mut self, name: &str, kind: Kind) -> ExprId {
        let symbol = self.model.declare(name, None, kind);
        self.model.graph.symbol(symbol)
    }

    pub(crate) fn parameters<const N: usize>(&mut self, names: [&str; N]) -> [ExprId; N] {
        names.map(|name| self.quantity(name, Kind::Parameter))
    }

    /// Adds the equation: sum of terms = input.
    pub(crate) fn equation(&mut self, input: &str, mut terms: Vec<ExprId>) {
        let input_expr = self.quantity(input, Kind::Input);
        terms.push(self.model.graph.neg(input_expr));
        self.free_equation(input, terms);
    }

    /// Adds the equation: sum of terms = 0.
    pub(crate) fn free_equation(&mut self, name: &str, terms: Vec<ExprId>) {
        let terms = terms.into_iter().map(|expr| {
            self.next += 1;
            SourceTerm { id: TermId(self.next), expr }
        });
        let equation = Equation { name: name.to_owned(), terms: terms.collect() };
        self.model.equations.push(equation);
    }

    fn finish(self, motions: Vec<(&str, Option<&str>, Fourier)>) -> Workload {
        self.finish_with(motions.into_iter().map(Some).collect(), |model| {
            let form = sorted(&model);
            (model, form)
        })
    }

    /// `sort` gives the model its regressor form; eliminated coordinates have no motion.
    pub(crate) fn finish_with(
        mut self,
        motions: Vec<Option<(&str, Option<&str>, Fourier)>>,
        sort: impl FnOnce(ExactModel) -> (ExactModel, RegressorForm),
    ) -> Workload {
        let mut amplitudes = Vec::new();
        for (name, ..) in motions.iter().flatten() {
            amplitudes.push(self.model.declare(name, None, Kind::Amplitude));
        }
        let frequency = self.model.declare("w", None, Kind::Frequency);
        let mut next = amplitudes.iter();
        let parts = motions.iter().map(|motion| {
            let (_, offset, shape) = motion.as_ref()?;
            let &amplitude = next.next()?;
            let motion = Motion::term(Monomial::power_of(amplitude, 1), shape.clone());
            let offset = offset.and_then(|name| self.model.find_symbol(name));
            Some(match offset {
                Some(symbol) => motion.add(&Motion::term(Monomial::power_of(symbol, 1), Fourier::constant(integer(1)))),
                None => motion,
            })
        });
        let pattern = Pattern { name: None, motions: parts.collect(), amplitudes: amplitudes.clone(), frequency };
        let (model, form) = sort(self.model);
        Workload { model, form, pattern }
    }
}

pub(crate) fn shape(order: u32) -> Fourier {
    rest_to_rest(order).expect("invariant: odd orders")
}

/// W1: Feng, Eqns 3.24 and 3.26.
#[must_use]
pub fn mass_spring_drag() -> Workload {
    let mut b = Builder::new("MassSpringDrag");
    let x = b.model.declare_coordinate("x", None);
    let [m, k1, k2] = b.parameters(["m", "k1", "k2"]);
    let g = &mut b.model.graph;
    let (x0, x1, x2) = (g.derivative_of(x, 0), g.derivative_of(x, 1), g.derivative_of(x, 2));
    let drag = g.pow(x1, 2);
    let terms = vec![g.mul(m, x2), g.mul(k1, x0), g.mul(k2, drag)];
    b.equation("u", terms);
    b.finish(vec![("lambda", None, shape(3))])
}

/// W2: Feng, Eqns 4.34 and 4.44.
#[must_use]
pub fn two_carts() -> Workload {
    let mut b = Builder::new("TwoCarts");
    let x = b.model.declare_coordinate("x", None);
    let c = b.parameters(["c1", "c2", "c3", "c4", "c5", "c6", "c7"]);
    let g = &mut b.model.graph;
    let (x0, x2, x4) = (g.derivative_of(x, 0), g.derivative_of(x, 2), g.derivative_of(x, 4));
    let (xx, aa) = (g.pow(x0, 2), g.pow(x2, 2));
    let regressors = [x4, x2, g.mul(xx, x2), g.mul(x0, aa), g.pow(x2, 3), x0, g.pow(x0, 3)];
    let terms = c.into_iter().zip(regressors).map(|(c, phi)| g.mul(c, phi)).collect();
    b.equation("F", terms);
    b.finish(vec![("lambda", None, shape(5))])
}

/// W3: Feng, Eqns 5.1-5.7, B.1 and B.2, with symbolic offsets.
#[must_use]
pub fn closed_loop_arm() -> Workload {
    let mut b = Builder::new("ClosedLoopArm");
    let [c1, c2] = ["th1", "th2"].map(|name| b.model.declare_coordinate(name, None));
    let a = b.parameters(["a10", "a11", "a12", "a20", "a21", "a22", "a30", "a31", "a32"]);
    b.quantity("th10", Kind::Constant { value: None });
    let th20 = b.quantity("th20", Kind::Constant { value: None });
    let g = &mut b.model.graph;
    let th2 = g.derivative_of(c2, 0);
    let deviation = g.sub(th2, th20);
    let f = |g: &mut Graph, i: usize| {
        let square = g.pow(deviation, 2);
        let (linear, quadratic) = (g.mul(a[3 * i + 1], deviation), g.mul(a[3 * i + 2], square));
        let (two, slope) = (g.integer(2), g.mul(a[3 * i + 2], deviation));
        let slope = g.mul(two, slope);
        (g.sum(&[a[3 * i], linear, quadratic]), g.add(a[3 * i + 1], slope))
    };
    let ((f1, d1), (f2, d2), (f3, d3)) = (f(g, 0), f(g, 1), f(g, 2));
    let [v1, v2, a1, a2] = [(c1, 1), (c2, 1), (c1, 2), (c2, 2)].map(|(c, order)| g.derivative_of(c, order));
    let (two, v1v1, v2v2) = (g.integer(2), g.pow(v1, 2), g.pow(v2, 2));
    let minus = g.integer(-1);
    let first = vec![g.product(&[two, f1, a1]), g.mul(f3, a2), g.product(&[two, d1, v1, v2]), g.mul(d3, v2v2)];
    let second = vec![g.mul(f3, a1), g.product(&[two, f2, a2]), g.product(&[minus, d1, v1v1]), g.mul(d2, v2v2)];
    b.equation("tau1", first);
    b.equation("tau2", second);
    let shape = shape(3).add(&Fourier::constant(ratio(-8, 9)));
    b.finish(vec![("lambda1", Some("th10"), shape.clone()), ("lambda2", Some("th20"), shape)])
}

/// W4: a parameter for every monomial x^p x'^q with p + q <= `degree`, on the pattern of order 3.
#[must_use]
pub fn monomials(degree: u32) -> Workload {
    let mut b = Builder::new("Monomials");
    let x = b.model.declare_coordinate("x", None);
    let mut terms = Vec::new();
    for p in 0..=degree {
        for q in 0..=degree - p {
            let parameter = b.quantity(&format!("k_{p}_{q}"), Kind::Parameter);
            let g = &mut b.model.graph;
            let (x0, x1) = (g.derivative_of(x, 0), g.derivative_of(x, 1));
            let (p, q) = (i32::try_from(p).expect("small"), i32::try_from(q).expect("small"));
            let (position, speed) = (g.pow(x0, p), g.pow(x1, q));
            terms.push(g.product(&[parameter, position, speed]));
        }
    }
    b.equation("u", terms);
    b.finish(vec![("lambda", None, shape(3))])
}

/// W6: two joints in series with gravity; sines and cosines as Taylor polynomials about 0 of the given order.
///
/// ```text
/// (p1 + 2 p2 cos q2) q1'' + (p3 + p2 cos q2) q2'' - p2 sin q2 (2 q1' q2' + q2'^2) + p4 cos q1 + p5 cos(q1 + q2) = tau1
/// (p3 + p2 cos q2) q1'' + p3 q2'' + p2 sin q2 q1'^2 + p5 cos(q1 + q2) = tau2
/// ```
#[must_use]
pub fn serial_arm(order: u32) -> Workload {
    let mut b = Builder::new("SerialArm");
    let [c1, c2] = ["q1", "q2"].map(|name| b.model.declare_coordinate(name, None));
    let [p1, p2, p3, p4, p5] = b.parameters(["p1", "p2", "p3", "p4", "p5"]);
    let g = &mut b.model.graph;
    let [q1, q2] = [c1, c2].map(|c| g.derivative_of(c, 0));
    let [v1, v2, a1, a2] = [(c1, 1), (c2, 1), (c1, 2), (c2, 2)].map(|(c, order)| g.derivative_of(c, order));
    let sum = g.add(q1, q2);
    let (cos1, cos2, cos12, sin2) =
        (taylor(g, q1, order, 0), taylor(g, q2, order, 0), taylor(g, sum, order, 0), taylor(g, q2, order, 1));
    let (two, minus) = (g.integer(2), g.integer(-1));
    let (v1v1, v2v2, v1v2) = (g.pow(v1, 2), g.pow(v2, 2), g.product(&[two, v1, v2]));
    let coriolis = g.add(v1v2, v2v2);
    let first = vec![
        g.mul(p1, a1),
        g.product(&[two, p2, cos2, a1]),
        g.mul(p3, a2),
        g.product(&[p2, cos2, a2]),
        g.product(&[minus, p2, sin2, coriolis]),
        g.mul(p4, cos1),
        g.mul(p5, cos12),
    ];
    let second =
        vec![g.mul(p3, a1), g.product(&[p2, cos2, a1]), g.mul(p3, a2), g.product(&[p2, sin2, v1v1]), g.mul(p5, cos12)];
    b.equation("tau1", first);
    b.equation("tau2", second);
    b.finish(vec![("lambda1", None, shape(3)), ("lambda2", None, shape(3))])
}

/// The Taylor polynomial of cos (`odd` = 0) or sin (`odd` = 1) about 0, up to `order`.
fn taylor(g: &mut Graph, argument: ExprId, order: u32, odd: u32) -> ExprId {
    let mut factorial = integer(1);
    let mut terms = Vec::new();
    for k in 0..=order {
        if k > 0 {
            factorial *= integer(i64::from(k));
        }
        if k % 2 == odd {
            let power = g.pow(argument, i32::try_from(k).expect("small"));
            let coefficient: Rational = integer(if k / 2 % 2 == 0 { 1 } else { -1 }) / &factorial;
            terms.push(g.scale(power, coefficient));
        }
    }
    g.sum(&terms)
}
