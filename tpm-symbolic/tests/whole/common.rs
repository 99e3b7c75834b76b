//! Formulas as Rust operators, so that tests read like the equations they check.

use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Sub};
use std::rc::Rc;
use tpm_symbolic::expr::graph::{Coordinate, ExprId, Function, Graph, Node, Symbol};
use tpm_symbolic::expr::trigonometric;
use tpm_symbolic::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
use tpm_symbolic::number::rational::{self, Rational};

/// A model under construction.
#[derive(Clone, Default)]
pub(crate) struct Build(Rc<RefCell<(ExactModel, u32)>>);

/// An expression of a model under construction.
#[derive(Clone)]
pub(crate) struct E {
    pub(crate) id: ExprId,
    build: Build,
}

impl Build {
    pub(crate) fn new() -> Self {
        Self::default()
    }

    pub(crate) fn model<T>(&self, f: impl FnOnce(&mut ExactModel) -> T) -> T {
        f(&mut self.0.borrow_mut().0)
    }

    pub(crate) fn graph<T>(&self, f: impl FnOnce(&mut Graph) -> T) -> T {
        self.model(|model| f(&mut model.graph))
    }

    pub(crate) fn take(&self) -> ExactModel {
        std::mem::take(&mut self.0.borrow_mut().0)
    }

    pub(crate) fn e(&self, id: ExprId) -> E {
        E { id, build: self.clone() }
    }

    pub(crate) fn quantity(&self, name: &str, kind: Kind) -> E {
        let id = self.model(|model| {
            let symbol = model.declare(name, None, kind);
            model.graph.symbol(symbol)
        });
        self.e(id)
    }

    pub(crate) fn parameters<const N: usize>(&self, names: [&str; N]) -> [E; N] {
        names.map(|name| self.quantity(name, Kind::Parameter))
    }

    pub(crate) fn coordinate(&self, name: &str) -> Coordinate {
        self.model(|model| model.declare_coordinate(name, None))
    }

    pub(crate) fn der(&self, coordinate: Coordinate, order: u32) -> E {
        self.e(self.graph(|g| g.derivative_of(coordinate, order)))
    }

    /// The coordinate, its velocity and its acceleration.
    pub(crate) fn motion(&self, coordinate: Coordinate) -> [E; 3] {
        [0, 1, 2].map(|order| self.der(coordinate, order))
    }

    pub(crate) fn num(&self, n: i64) -> E {
        self.exact(rational::integer(n))
    }

    pub(crate) fn exact(&self, value: Rational) -> E {
        self.e(self.graph(|g| g.number(value)))
    }

    pub(crate) fn pi(&self) -> E {
        self.e(self.graph(Graph::pi))
    }

    pub(crate) fn term(&self, expr: &E) -> SourceTerm {
        let mut state = self.0.borrow_mut();
        state.1 += 1;
        SourceTerm { id: TermId(state.1), expr: expr.id }
    }

    pub(crate) fn terms(&self, exprs: &[E]) -> Vec<SourceTerm> {
        exprs.iter().map(|expr| self.term(expr)).collect()
    }

    /// An equation: the terms add up to zero.
    pub(crate) fn equation(&self, terms: &[E]) {
        let terms = self.terms(terms);
        self.model(|model| {
            let name = format!("eq{}", model.equations.len() + 1);
            model.equations.push(Equation { name, terms });
        });
    }

    pub(crate) fn is_zero(&self, expr: &E) -> bool {
        self.graph(|g| trigonometric::is_zero(g, expr.id))
    }
}

impl E {
    pub(crate) fn build_pi(&self) -> E {
        self.build.pi()
    }

    pub(crate) fn call(&self, function: Function) -> E {
        self.build.e(self.build.graph(|g| g.function(function, self.id)))
    }

    pub(crate) fn sin(&self) -> E {
        self.call(Function::Sin)
    }

    pub(crate) fn cos(&self) -> E {
        self.call(Function::Cos)
    }

    pub(crate) fn pow(&self, exponent: i32) -> E {
        self.build.e(self.build.graph(|g| g.pow(self.id, exponent)))
    }

    pub(crate) fn diff(&self, variable: &E) -> E {
        self.build.e(self.build.graph(|g| g.differentiate(self.id, variable.id)))
    }

    pub(crate) fn time(&self) -> E {
        self.build.e(self.build.graph(|g| g.time_derivative(self.id)))
    }

    pub(crate) fn atan2(&self, x: &E) -> E {
        self.build.e(self.build.graph(|g| g.atan2(self.id, x.id)))
    }

    pub(crate) fn at(&self, values: &[(ExprId, f64)]) -> f64 {
        self.build.graph(|g| {
            g.evaluate(self.id, |node: &Node| {
                let found = values.iter().find(|(leaf, _)| g.node(*leaf) == node);
                found.unwrap_or_else(|| panic!("no value for {node:?}")).1
            })
        })
    }

    pub(crate) fn symbol(&self) -> Symbol {
        self.build.graph(|g| match g.node(self.id) {
            Node::Symbol(symbol) => *symbol,
            other => panic!("{other:?} is no symbol"),
        })
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident) => {
        impl $trait<&E> for &E {
            type Output = E;
            fn $method(self, other: &E) -> E {
                self.build.e(self.build.graph(|g| g.$method(self.id, other.id)))
            }
        }
        impl $trait<E> for &E {
            type Output = E;
            fn $method(self, other: E) -> E {
                self.$method(&other)
            }
        }
        impl $trait<&E> for E {
            type Output = E;
            fn $method(self, other: &E) -> E {
                (&self).$method(other)
            }
        }
        impl $trait<E> for E {
            type Output = E;
            fn $method(self, other: E) -> E {
                (&self).$method(&other)
            }
        }
        impl $trait<i64> for E {
            type Output = E;
            fn $method(self, other: i64) -> E {
                let other = self.build.num(other);
                (&self).$method(&other)
            }
        }
        impl $trait<i64> for &E {
            type Output = E;
            fn $method(self, other: i64) -> E {
                self.$method(&self.build.num(other))
            }
        }
        impl $trait<E> for i64 {
            type Output = E;
            fn $method(self, other: E) -> E {
                other.build.num(self).$method(&other)
            }
        }
        impl $trait<&E> for i64 {
            type Output = E;
            fn $method(self, other: &E) -> E {
                other.build.num(self).$method(other)
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl Neg for &E {
    type Output = E;
    fn neg(self) -> E {
        self.build.e(self.build.graph(|g| g.neg(self.id)))
    }
}

impl Neg for E {
    type Output = E;
    fn neg(self) -> E {
        -&self
    }
}
