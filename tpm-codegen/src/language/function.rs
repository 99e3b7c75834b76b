//! The functions of the language.
//!
//! Invariant: this table is the only place that holds their names and numbers of arguments.

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
    /// `tanh(e)`
    Tanh,
    /// `exp(e)`
    Exp,
    /// `log(e)`: the natural logarithm.
    Log,
    /// `abs(e)`
    Abs,
    /// `sign(e)`: -1, 0 or 1.
    Sign,
    /// `rest_to_rest(lambda, w, n)`: the pattern with derivatives 1 to n zero at both ends (Feng, Eqns 4.13, 4.42).
    RestToRest,
    /// `point_to_point(x0, x1, w, n)`: the shape of `rest_to_rest` between two points (Feng, Eqn 2.20).
    PointToPoint,
    /// `shape(w, ...)`: the series that meets the end conditions of its clauses (Feng, Eqns 2.1 to 2.9).
    Shape,
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
        Self::Tanh,
        Self::Exp,
        Self::Log,
        Self::Abs,
        Self::Sign,
        Self::RestToRest,
        Self::PointToPoint,
        Self::Shape,
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
            Self::Tanh => "tanh",
            Self::Exp => "exp",
            Self::Log => "log",
            Self::Abs => "abs",
            Self::Sign => "sign",
            Self::RestToRest => "rest_to_rest",
            Self::PointToPoint => "point_to_point",
            Self::Shape => "shape",
        }
    }

    /// The syntax of a call, for messages; the number of its arguments is counted in it.
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
            Self::Tanh => "tanh(x)",
            Self::Exp => "exp(x)",
            Self::Log => "log(x)",
            Self::Abs => "abs(x)",
            Self::Sign => "sign(x)",
            Self::RestToRest => "rest_to_rest(lambda, w, 3)",
            Self::PointToPoint => "point_to_point(x0, x1, w, 3)",
            Self::Shape => "shape(w, start(x0), end(pi, x1), rest(3))",
        }
    }

    /// The meaning, for editors.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Dot => "the first time derivative",
            Self::Ddot => "the second time derivative",
            Self::Der => "the time derivative of order n",
            Self::Diff => "the partial derivative by a coordinate",
            Self::Sin => "the sine of an angle, rad",
            Self::Cos => "the cosine of an angle, rad",
            Self::Tan => "the tangent of an angle, rad",
            Self::Asin => "the angle of this sine, rad",
            Self::Acos => "the angle of this cosine, rad",
            Self::Atan2 => "the angle of the point (x, y), rad",
            Self::Sqrt => "the square root",
            Self::Tanh => "the hyperbolic tangent",
            Self::Exp => "the exponential function",
            Self::Log => "the natural logarithm",
            Self::Abs => "the absolute value",
            Self::Sign => "-1, 0 or 1",
            Self::RestToRest => {
                "a motion of amplitude lambda and frequency w whose derivatives 1 to n vanish at both ends"
            }
            Self::PointToPoint => "a motion from x0 to x1 whose derivatives 1 to n vanish at both ends",
            Self::Shape => "the motion that meets the end conditions of its clauses",
        }
    }

    /// How many arguments it takes; `None` for a shape, which takes any number of clauses.
    #[must_use]
    pub fn arity(self) -> Option<usize> {
        (self != Self::Shape).then(|| self.usage().split(',').count())
    }

    /// The function of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|function| function.name() == name)
    }

    /// Whether it is a time derivative or a partial derivative.
    #[must_use]
    pub fn is_derivative(self) -> bool {
        matches!(self, Self::Dot | Self::Ddot | Self::Der | Self::Diff)
    }

    /// Whether it constructs a motion, so that it is allowed in patterns only.
    #[must_use]
    pub fn is_pattern(self) -> bool {
        matches!(self, Self::RestToRest | Self::PointToPoint | Self::Shape)
    }
}

/// A clause of `shape(w, ...)`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Clause {
    /// `start(x0, v0, ...)`: position, velocity and further derivatives with respect to time at the phase 0.
    Start,
    /// `end(phase, x1, v1, ...)`: the phase at which the motion ends, and position and derivatives there.
    End,
    /// `rest(n)`: derivatives 1 to n vanish at both ends where no other value is given.
    Rest,
    /// `amplitude(lambda)`: the coefficient of the lowest cosine.
    Amplitude,
    /// `harmonics(1, 3)`: harmonics with sine and cosine.
    Harmonics,
    /// `cosines(1, 3)`: harmonics with a cosine.
    Cosines,
    /// `sines(2)`: harmonics with a sine.
    Sines,
}

impl Clause {
    /// Every clause with its name, in the order in which messages list them.
    const NAMES: [(Self, &'static str); 7] = [
        (Self::Start, "start"),
        (Self::End, "end"),
        (Self::Rest, "rest"),
        (Self::Amplitude, "amplitude"),
        (Self::Harmonics, "harmonics"),
        (Self::Cosines, "cosines"),
        (Self::Sines, "sines"),
    ];

    /// The names of the clauses.
    pub fn names() -> impl Iterator<Item = &'static str> {
        Self::NAMES.into_iter().map(|(_, name)| name)
    }

    /// The clause of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::NAMES.iter().find(|(_, own)| *own == name).map(|(clause, _)| *clause)
    }

    /// The clauses in one line, for messages.
    #[must_use]
    pub fn list() -> String {
        Self::NAMES.map(|(_, name)| format!("`{name}(...)`")).join(", ")
    }
}
