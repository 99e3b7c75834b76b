//! The functions of the language.
//!
//! Invariant: this table is the only place that knows their names and numbers of arguments.

/// A function that an expression may call.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Function {
    /// `dot(e)`: first time derivative.
    Dot,
    /// `ddot(e)`: second time derivative.
    Ddot,
    /// `der(e, n)`: time derivative of order n.
    Der,
    /// `diff(e, q)`: partial derivative by a coordinate.
    Diff,
    /// `sin(e)`
    Sin,
    /// `cos(e)`
    Cos,
    /// `tan(e)`
    Tan,
    /// `asin(e)`
    Asin,
    /// `acos(e)`
    Acos,
    /// `atan2(y, x)`: the angle of the point (x, y).
    Atan2,
    /// `sqrt(e)`
    Sqrt,
    /// `abs(e)`
    Abs,
    /// `sign(e)`: -1, 0 or 1.
    Sign,
    /// `rest_to_rest(lambda, w, n)`: the pattern with derivatives 1 to n zero at both ends (Feng, Eqns 4.13, 4.42).
    RestToRest,
    /// `point_to_point(x0, x1, w, n)`: the shape of `rest_to_rest` between two points (Feng, Eqn 2.20).
    PointToPoint,
}

impl Function {
    /// Every function, in the order in which messages list them.
    pub const ALL: &'static [Self] = &[
        Self::Dot,
        Self::Ddot,
        Self::Der,
        Self::Diff,
        Self::Sin,
        Self::Cos,
        Self::Tan,
        Self::Asin,
        Self::Acos,
        Self::Atan2,
        Self::Sqrt,
        Self::Abs,
        Self::Sign,
        Self::RestToRest,
        Self::PointToPoint,
    ];

    /// How it is written.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Dot => "dot",
            Self::Ddot => "ddot",
            Self::Der => "der",
            Self::Diff => "diff",
            Self::Sin => "sin",
            Self::Cos => "cos",
            Self::Tan => "tan",
            Self::Asin => "asin",
            Self::Acos => "acos",
            Self::Atan2 => "atan2",
            Self::Sqrt => "sqrt",
            Self::Abs => "abs",
            Self::Sign => "sign",
            Self::RestToRest => "rest_to_rest",
            Self::PointToPoint => "point_to_point",
        }
    }

    /// How a call of it looks, for messages; the number of its arguments follows from it.
    #[must_use]
    pub fn usage(self) -> &'static str {
        match self {
            Self::Dot => "dot(x)",
            Self::Ddot => "ddot(x)",
            Self::Der => "der(x, n)",
            Self::Diff => "diff(f, q)",
            Self::Sin => "sin(x)",
            Self::Cos => "cos(x)",
            Self::Tan => "tan(x)",
            Self::Asin => "asin(x)",
            Self::Acos => "acos(x)",
            Self::Atan2 => "atan2(y, x)",
            Self::Sqrt => "sqrt(x)",
            Self::Abs => "abs(x)",
            Self::Sign => "sign(x)",
            Self::RestToRest => "rest_to_rest(lambda, w, 3)",
            Self::PointToPoint => "point_to_point(x0, x1, w, 3)",
        }
    }

    /// How many arguments it takes.
    #[must_use]
    pub fn arity(self) -> usize {
        self.usage().split(',').count()
    }

    /// The function of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|function| function.name() == name)
    }

    /// Whether it is a time derivative or a partial one.
    #[must_use]
    pub fn is_derivative(self) -> bool {
        matches!(self, Self::Dot | Self::Ddot | Self::Der | Self::Diff)
    }

    /// Whether it makes a motion, so that it stands in patterns only.
    #[must_use]
    pub fn is_pattern(self) -> bool {
        matches!(self, Self::RestToRest | Self::PointToPoint)
    }
}
