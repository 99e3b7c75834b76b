//! Lowers reference motions to Fourier polynomials.
//!
//! Invariant: a motion is a finite Fourier series in w t with rational coefficients times products of amplitudes and
//! constants. Any other motion is reported as an error at its place, never approximated.

use std::collections::{BTreeSet, HashMap};

use num_traits::{One, ToPrimitive, Zero};
use tpm_symbolic::algebra::fourier::Fourier;
use tpm_symbolic::algebra::polynomial::{Monomial, Polynomial};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::pattern::{self, Motion};
use tpm_symbolic::mechanics::shape::{self, Condition, ConditionError, End, EndPhase, Shape};
use tpm_symbolic::number::rational::{self, Rational};

use super::expression::{self, Lower};
use crate::diagnostic::Diagnostic;
use crate::language::ast::{Expr, ExprKind, Operation, Sign};
use crate::language::function::{Clause, Function};
use crate::source::Span;

/// Highest harmonic of a motion: no controller plays more, and a series is stored densely.
pub(super) const HIGHEST_HARMONIC: usize = 4096;

/// The names that a pattern's motions may use.
pub(super) struct Scope<'a> {
    /// Amplitudes, the frequency, and constants that are known at run time.
    pub(super) symbols: HashMap<String, Symbol>,
    /// Constants with their values.
    pub(super) values: HashMap<&'a str, Rational>,
    /// The frequency's name.
    pub(super) frequency: Option<String>,
}

/// The product `factor * w^frequency * t^time`.
struct Phase {
    factor: Rational,
    frequency: i64,
    time: i64,
}

impl Scope<'_> {
    pub(super) fn motion(&self, expr: &Expr) -> Lower<Motion> {
        match &expr.kind {
            ExprKind::Number(value) => Ok(constant(value.clone())),
            ExprKind::Name(name) => self.name(name, expr.span),
            ExprKind::Negative(inner) => Ok(self.motion(inner)?.mul(&constant(-Rational::one()))),
            ExprKind::Sum(terms) => {
                let mut sum = Motion::zero();
                for (sign, term) in terms {
                    let motion = self.motion(term)?;
                    let motion = if *sign == Sign::Minus { motion.mul(&constant(-Rational::one())) } else { motion };
                    sum = sum.add(&motion);
                }
                Ok(sum)
            }
            ExprKind::Product(factors) => {
                let mut product = constant(Rational::one());
                for (operation, factor) in factors {
                    let motion = self.motion(factor)?;
                    let motion = if *operation == Operation::Over { inverse(&motion, factor.span)? } else { motion };
                    product = multiply(&product, &motion, expr.span)?;
                }
                Ok(product)
            }
            ExprKind::Power(base, exponent) => {
                let base = self.motion(base)?;
                let mut power = constant(Rational::one());
                if *exponent as usize > HIGHEST_HARMONIC {
                    return Err(too_high(expr.span));
                }
                for _ in 0..*exponent {
                    power = multiply(&power, &base, expr.span)?;
                }
                Ok(power)
            }
            ExprKind::Call(function, arguments) => match (Function::from_name(&function.name), arguments.as_slice()) {
                (Some(Function::Cos), [argument]) => self.harmonic(argument, false),
                (Some(Function::Sin), [argument]) => self.harmonic(argument, true),
                (Some(Function::RestToRest), [amplitude, frequency, order]) => {
                    let shape = self.rest_to_rest(frequency, order)?;
                    let amplitude = self.steady(amplitude)?;
                    Ok(amplitude.mul(&Motion::term(Monomial::one(), shape)))
                }
                (Some(Function::PointToPoint), [from, to, frequency, order]) => {
                    // Feng, Eqn 2.20: the shape scaled so that it runs from x0 at the phase 0 to x1 at the phase pi.
                    let shape = self.rest_to_rest(frequency, order)?;
                    let unit = shape.scale(&shape.at_zero().recip());
                    let (from, to) = (self.steady(from)?, self.steady(to)?);
                    let half = constant(Rational::new(1.into(), 2.into()));
                    let centre = from.add(&to).mul(&half);
                    let travel = from.add(&to.mul(&constant(-Rational::one()))).mul(&half);
                    Ok(centre.add(&travel.mul(&Motion::term(Monomial::one(), unit))))
                }
                (Some(Function::Shape), [frequency, clauses @ ..]) => self.end_conditions(frequency, clauses, expr.span),
                _ => Err(Diagnostic::error(expr.span, format!("`{}` does not make a finite Fourier series", function.name))
                    .help("a motion is made of sines and cosines of multiples of `w*t`, and of `rest_to_rest`, `point_to_point` and `shape`")),
            },
        }
    }

    fn name(&self, name: &str, span: Span) -> Lower<Motion> {
        match (name, self.values.get(name), self.symbols.get(name)) {
            ("t", _, _) => Err(Diagnostic::error(span, "the time stands inside sine and cosine only")
                .help("a motion is periodic: write, for example, `cos(w*t)`")),
            ("pi", _, _) => Err(Diagnostic::error(span, "a motion has rational coefficients, and pi is none").help(
                "declare a constant for this product, `constant x0 [rad];`, and give its value with the experiment",
            )),
            (_, Some(value), _) => Ok(constant(value.clone())),
            (_, _, Some(&symbol)) => {
                Ok(Motion::term(Monomial::power_of(symbol, 1), Fourier::constant(Rational::one())))
            }
            // The fault was reported by the checks.
            _ => Err(Diagnostic::error(span, format!("`{name}` cannot stand in a motion"))
                .help("use amplitudes and constants")),
        }
    }

    /// cos or sin of a multiple of w t.
    fn harmonic(&self, argument: &Expr, sine: bool) -> Lower<Motion> {
        let wrong = |what: &str| {
            let w = self.frequency.as_deref().unwrap_or("w");
            Diagnostic::error(argument.span, format!("the argument is {what}, not an integer multiple of `{w}*t`"))
                .help(format!("write, for example, `cos(3*{w}*t)`; a phase is a sum of a cosine and a sine"))
        };
        let phase = self.phase(argument)?.ok_or_else(|| wrong("something else"))?;
        let zero = phase.factor.is_zero();
        if !zero && (phase.frequency, phase.time) != (1, 1) {
            return Err(wrong("something else"));
        }
        if !phase.factor.is_integer() {
            return Err(wrong("a fraction of it"));
        }
        let negative = phase.factor < Rational::zero();
        let Some(harmonic) = num_traits::abs(phase.factor.to_integer()).to_usize().filter(|&n| n <= HIGHEST_HARMONIC)
        else {
            return Err(too_high(argument.span));
        };
        let one = Rational::one();
        let series = match (sine, harmonic) {
            (false, 0) => Fourier::constant(one),
            (true, 0) => Fourier::zero(),
            (false, _) => Fourier::cos(harmonic, one),
            (true, _) => Fourier::sin(harmonic, if negative { -one } else { one }),
        };
        Ok(Motion::term(Monomial::one(), series))
    }

    /// An expression as a number times powers of w and t; `None` when it does not have this form.
    fn phase(&self, expr: &Expr) -> Lower<Option<Phase>> {
        let pure = |factor: Rational| Phase { factor, frequency: 0, time: 0 };
        Ok(match &expr.kind {
            ExprKind::Name(name) if name == "t" => Some(Phase { time: 1, ..pure(Rational::one()) }),
            ExprKind::Name(name) if Some(name) == self.frequency.as_ref() => {
                Some(Phase { frequency: 1, ..pure(Rational::one()) })
            }
            ExprKind::Number(_) => Some(pure(expression::exact(expr, &self.values)?)),
            ExprKind::Name(name) => self.values.get(name.as_str()).cloned().map(pure),
            ExprKind::Negative(inner) => self.phase(inner)?.map(|phase| Phase { factor: -phase.factor, ..phase }),
            ExprKind::Sum(terms) => {
                let mut sum: Option<Phase> = None;
                for (sign, term) in terms {
                    let Some(mut phase) = self.phase(term)? else { return Ok(None) };
                    if *sign == Sign::Minus {
                        phase.factor = -phase.factor;
                    }
                    sum = match sum {
                        None => Some(phase),
                        Some(sum) if (sum.frequency, sum.time) == (phase.frequency, phase.time) => {
                            Some(Phase { factor: sum.factor + phase.factor, ..sum })
                        }
                        Some(_) => return Ok(None),
                    };
                }
                sum
            }
            ExprKind::Product(factors) => {
                let mut product = pure(Rational::one());
                for (operation, factor) in factors {
                    let Some(phase) = self.phase(factor)? else { return Ok(None) };
                    if *operation == Operation::Times {
                        product.factor *= phase.factor;
                        product.frequency += phase.frequency;
                        product.time += phase.time;
                    } else if phase.factor.is_zero() {
                        return Err(Diagnostic::error(factor.span, "a division by zero").help("this divisor is 0"));
                    } else {
                        product.factor /= phase.factor;
                        product.frequency -= phase.frequency;
                        product.time -= phase.time;
                    }
                }
                Some(product)
            }
            ExprKind::Power(..) | ExprKind::Call(..) => None,
        })
    }

    /// The integer multiple of the fundamental frequency at which a motion is played.
    fn multiple(&self, frequency: &Expr) -> Lower<usize> {
        let w = self.frequency.as_deref().unwrap_or("w");
        self.phase(frequency)?
            .filter(|phase| {
                (phase.frequency, phase.time) == (1, 0) && phase.factor.is_integer() && phase.factor > Rational::zero()
            })
            .and_then(|phase| phase.factor.to_integer().to_usize())
            .ok_or_else(|| {
                Diagnostic::error(
                    frequency.span,
                    format!("the frequency of a motion is a positive integer multiple of `{w}`"),
                )
                .help(format!("write `{w}` or, for example, `3*{w}`"))
            })
    }

    /// The rest-to-rest shape of an order, on an integer multiple of the fundamental.
    fn rest_to_rest(&self, frequency: &Expr, order: &Expr) -> Lower<Fourier> {
        let multiple = self.multiple(frequency)?;
        let order_value = order.integer().unwrap_or_default();
        let shape = pattern::rest_to_rest(order_value).map_err(|error| {
            Diagnostic::error(order.span, error.to_string()).help("choose an odd order, 3, 5, 7, ...")
        })?;
        if shape.highest_harmonic().checked_mul(multiple).is_none_or(|highest| highest > HIGHEST_HARMONIC) {
            return Err(too_high(frequency.span));
        }
        Ok(shape.with_multiple(multiple))
    }

    /// `shape(w, ...)`: the series that meets the end conditions of the clauses (Feng, Eqns 2.1 to 2.9).
    fn end_conditions(&self, frequency: &Expr, clauses: &[Expr], span: Span) -> Lower<Motion> {
        let multiple = self.multiple(frequency)?;
        let mut shape = Shape {
            cosines: BTreeSet::new(),
            sines: BTreeSet::new(),
            end: EndPhase::Pi(Rational::one()),
            conditions: Vec::new(),
            amplitude: None,
        };
        let (mut rest, mut chosen, mut phase) = (0, false, None);
        for clause in clauses {
            let ExprKind::Call(name, values) = &clause.kind else { continue };
            let kind = Clause::from_name(&name.name);
            match (kind, values.as_slice()) {
                (Some(Clause::Start), values) => {
                    shape.conditions.extend(self.values_at(End::Start, values, multiple)?)
                }
                (Some(Clause::End), [at, values @ ..]) => {
                    shape.end = self.end_phase(at)?;
                    phase = Some(at.span);
                    shape.conditions.extend(self.values_at(End::Finish, values, multiple)?);
                }
                (Some(Clause::Rest), [order]) => rest = self.whole(order, "the number of derivatives that vanish")?,
                (Some(Clause::Amplitude), [value]) => shape.amplitude = Some(steady_value(&self.steady(value)?)),
                (Some(Clause::Harmonics | Clause::Cosines | Clause::Sines), values) => {
                    chosen = true;
                    for value in values {
                        let harmonic = self.whole(value, "a harmonic")?;
                        if kind != Some(Clause::Sines) {
                            shape.cosines.insert(harmonic);
                        }
                        if kind != Some(Clause::Cosines) {
                            shape.sines.insert(harmonic);
                        }
                    }
                }
                _ => {
                    return Err(Diagnostic::error(clause.span, format!("`{}` does not take these values", name.name))
                        .help("write `start(x0, v0)`, `end(pi, x1, v1)`, `rest(3)`, `amplitude(lambda)`, `harmonics(1, 3)`"));
                }
            }
        }
        for order in 1..=rest.min(shape::MAX_DERIVATIVE + 1) {
            for end in [End::Start, End::Finish] {
                if !shape.conditions.iter().any(|given| (given.end, given.order) == (end, order)) {
                    shape.conditions.push(Condition { end, order, value: Polynomial::zero() });
                }
            }
        }
        // Positions come first, then velocities, so that the message on a contradiction names the highest derivative.
        shape.conditions.sort_by_key(|condition| (condition.order, condition.end));
        let solved = if chosen { shape.solve() } else { shape.solve_lowest() };
        let motion = Motion::of_shape(solved.map_err(|error| unsolved(&error, &shape.end, phase, span))?);
        if motion.highest_harmonic().checked_mul(multiple).is_none_or(|highest| highest > HIGHEST_HARMONIC) {
            return Err(too_high(frequency.span));
        }
        let parts = motion.terms().map(|(factor, series)| Motion::term(factor.clone(), series.with_multiple(multiple)));
        Ok(parts.fold(Motion::zero(), |sum, part| sum.add(&part)))
    }

    /// Position and derivatives with respect to time at an end, as derivatives with respect to the phase of the shape.
    fn values_at(&self, end: End, values: &[Expr], multiple: usize) -> Lower<Vec<Condition>> {
        let symbol = self.frequency.as_ref().and_then(|name| self.symbols.get(name));
        let mut conditions = Vec::new();
        for (order, value) in (0_u32..).zip(values) {
            let given = steady_value(&self.steady(value)?);
            // d/dt = multiple * w * d/dphase.
            let factor = Rational::from_integer(multiple.into()).pow(-(order as i32));
            let power = symbol.map_or_else(Monomial::one, |&w| Monomial::power_of(w, 1).pow(-(order as i32)));
            conditions.push(Condition { end, order, value: given.mul_monomial(&power).scale(&factor) });
        }
        Ok(conditions)
    }

    /// A non-negative whole number.
    fn whole(&self, expr: &Expr, what: &str) -> Lower<u32> {
        let value = expression::exact(expr, &self.values)?;
        let whole = value.is_integer().then(|| value.to_integer().to_u32()).flatten();
        whole.ok_or_else(|| {
            Diagnostic::error(expr.span, format!("{what} is a whole number")).help("write, for example, `3`")
        })
    }

    /// The phase at which a motion ends: a multiple of pi, or an angle whose half has a rational tangent.
    fn end_phase(&self, expr: &Expr) -> Lower<EndPhase> {
        if let Some(multiple) = expression::multiple_of_pi(expr, &self.values)? {
            if multiple <= Rational::zero() {
                return Err(Diagnostic::error(expr.span, "a motion ends at a positive phase")
                    .help("it begins at the phase 0; write, for example, `pi`"));
            }
            return Ok(EndPhase::Pi(multiple));
        }
        if let Some((y, x)) = expression::half_tangent(expr, &self.values)? {
            if y <= Rational::zero() {
                return Err(Diagnostic::error(expr.span, "a motion ends at a phase between 0 and 2 pi")
                    .help("the first argument of this `atan2` must be positive"));
            }
            return Ok(if x.is_zero() { EndPhase::Pi(Rational::one()) } else { EndPhase::HalfTangent(y / x) });
        }
        let angle = expression::exact(expr, &self.values).ok().map(|value| rational::to_f64(&value));
        Err(Diagnostic::error(expr.span, "this is no phase at which a motion ends").help(end_phases(angle)))
    }

    /// A motion that is constant in time, such as an amplitude.
    fn steady(&self, expr: &Expr) -> Lower<Motion> {
        let motion = self.motion(expr)?;
        if motion.highest_harmonic() > 0 {
            return Err(Diagnostic::error(expr.span, "an amplitude does not change with time")
                .help("give an amplitude, a constant or a number"));
        }
        Ok(motion)
    }
}

/// The value of a motion that is constant in time.
fn steady_value(motion: &Motion) -> Polynomial<Symbol> {
    motion.terms().map(|(monomial, series)| (monomial.clone(), series.cos_coefficient(0))).collect()
}

/// The permitted end phases as text, with one near `angle` (rad) where an angle is given.
fn end_phases(angle: Option<f64>) -> String {
    let rule = "write a multiple of pi, such as `pi` or `pi/2`, or `2*atan2(p, q)` with rational p and q";
    match angle.and_then(|angle| EndPhase::next_to(angle).map(|next| (angle, next))) {
        Some((angle, next)) => format!("{rule}; `{next}`, which is {:.4}, lies next to {angle:.4}", next.radians()),
        None => rule.to_owned(),
    }
}

/// The fault in the end conditions of a shape, at its place.
fn unsolved(error: &ConditionError, end: &EndPhase, phase: Option<Span>, span: Span) -> Diagnostic {
    match error {
        ConditionError::Irrational { .. } => {
            Diagnostic::error(phase.unwrap_or(span), error.to_string()).help(end_phases(Some(end.radians())))
        }
        ConditionError::Impossible { least: Some(least), .. } => Diagnostic::error(span, error.to_string())
            .help(format!("add harmonics up to {}, or leave the clauses of harmonics out", least.highest)),
        ConditionError::Impossible { least: None, .. } => Diagnostic::error(span, error.to_string())
            .help("leave this condition out, or choose another end phase; a whole period ends where it began"),
        ConditionError::NoCosine => Diagnostic::error(span, error.to_string())
            .help("add `cosines(1)`, or give positions in place of the amplitude"),
        ConditionError::NoMotion => {
            Diagnostic::error(span, error.to_string()).help("give a position, a velocity or `amplitude(...)`")
        }
        _ => Diagnostic::error(span, error.to_string()).help("choose lower numbers"),
    }
}

fn constant(value: Rational) -> Motion {
    Motion::term(Monomial::one(), Fourier::constant(value))
}

fn multiply(left: &Motion, right: &Motion, span: Span) -> Lower<Motion> {
    if left.highest_harmonic() + right.highest_harmonic() > HIGHEST_HARMONIC {
        return Err(too_high(span));
    }
    Ok(left.mul(right))
}

/// The reciprocal of a motion that is a single product of numbers, amplitudes and constants.
fn inverse(motion: &Motion, span: Span) -> Lower<Motion> {
    let mut terms = motion.terms();
    match (terms.next(), terms.next()) {
        (Some((monomial, series)), None) if series.highest_harmonic() == 0 => {
            Ok(Motion::term(monomial.pow(-1), Fourier::constant(series.cos_coefficient(0).recip())))
        }
        (None, _) => Err(Diagnostic::error(span, "a division by zero").help("this divisor is 0")),
        _ => Err(Diagnostic::error(span, "a motion is divided by numbers, amplitudes and constants only")
            .help("a quotient of series is no finite series")),
    }
}

fn too_high(span: Span) -> Diagnostic {
    Diagnostic::error(span, format!("a motion has harmonics up to {HIGHEST_HARMONIC}"))
        .help("lower the multiple or the exponent")
}
