//! Texts of random models, written by the grammar of the language. Equal seeds give equal texts.

use super::random::Random;
use std::fmt::Write as _;

/// Which models are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Models that have a regressor form, whose terms have values of moderate size at motions of moderate size.
    Regular,
    /// Anything that the grammar allows.
    Any,
}

/// Writes one model.
pub(crate) struct Writer {
    random: Random,
    kind: Kind,
    coordinates: u64,
    parameters: u64,
    /// Constants, each with or without a value.
    constants: Vec<bool>,
}

impl Writer {
    pub(crate) fn new(seed: u64, kind: Kind) -> Self {
        let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let (coordinates, parameters) = (random.below(3) + 1, random.below(4) + 1);
        let constants = (0..random.below(3)).map(|_| random.below(2) == 0).collect();
        Self { random, kind, coordinates, parameters, constants }
    }

    fn below(&mut self, count: u64) -> u64 {
        self.random.below(count)
    }

    fn coordinate(&mut self) -> String {
        format!("q{}", self.below(self.coordinates))
    }

    fn positive(&mut self) -> String {
        match self.below(3) {
            0 => format!("{}/{}", self.below(9) + 1, self.below(7) + 2),
            1 => format!("{}.{}", self.below(3) + 1, self.below(100)),
            _ => (self.below(5) + 1).to_string(),
        }
    }

    fn number(&mut self) -> String {
        if self.kind == Kind::Regular {
            return self.positive();
        }
        match self.below(8) {
            0 => "0".to_owned(),
            1 => self.random.next().to_string(),
            2 => "1e3".to_owned(),
            3 => "7".repeat(1 + usize::try_from(self.below(400)).expect("small")),
            _ => self.positive(),
        }
    }

    /// A factor of a term of a regular model.
    fn factor(&mut self) -> String {
        let q = self.coordinate();
        match self.below(14) {
            0 => q,
            1 | 2 => format!("dot({q})"),
            3 => format!("ddot({q})"),
            4 => format!("{q}^{}", self.below(4) + 2),
            5 => format!("({q} - {})^{}", self.positive(), self.below(3) + 1),
            6 => format!("sin({q})"),
            7 => format!("cos(2*{q} + {})", self.positive()),
            8 => format!("abs(dot({q}))"),
            9 => format!("sign(dot({q}))"),
            10 => format!("tanh({q})"),
            11 => format!("1/({} + {q}^2)", self.positive()),
            12 if !self.constants.is_empty() => format!("c{}", self.below(self.constants.len() as u64)),
            _ => self.positive(),
        }
    }

    fn regular_term(&mut self, parameter: u64) -> String {
        let factors: Vec<String> = (0..self.below(3) + 1).map(|_| self.factor()).collect();
        let (factors, own) = (factors.join("*"), self.coordinate());
        match self.below(8) {
            0 => format!("p{parameter}*p0*dot({own})*{factors}"),
            1 => format!("1/p{parameter}*{own}*{factors}"),
            2 => format!("{}*{own}*{factors}", self.positive()),
            _ => format!("p{parameter}*{factors}*{own}"),
        }
    }

    fn leaf(&mut self) -> String {
        let q = self.coordinate();
        match self.below(10) {
            0 | 1 => self.number(),
            2 => format!("dot({q})"),
            3 => format!("ddot({q})"),
            4 => format!("der({q}, {})", self.below(5)),
            5 if !self.constants.is_empty() => format!("c{}", self.below(self.constants.len() as u64)),
            6 => "pi".to_owned(),
            7 => "t".to_owned(),
            _ => q,
        }
    }

    fn expression(&mut self, depth: u64) -> String {
        if depth == 0 {
            return self.leaf();
        }
        let inner = self.expression(depth - 1);
        match self.below(12) {
            0 | 1 => format!("({inner} + {})", self.expression(depth - 1)),
            2 => format!("({inner} - {})", self.expression(depth - 1)),
            3 | 4 => format!("{inner}*{}", self.expression(depth - 1)),
            5 => format!("({inner})/({})", self.expression(depth - 1)),
            6 | 7 => {
                let exponent = if self.below(4) == 0 { self.below(60) } else { self.below(4) };
                format!("({inner})^{exponent}")
            }
            8 => format!("-({inner})"),
            9 => {
                let names = ["sin", "cos", "tan", "sign", "abs", "sqrt", "exp", "log", "tanh", "atan", "asin"];
                format!("{}({inner})", names[usize::try_from(self.below(11)).expect("small")])
            }
            10 => format!("atan2({inner}, {})", self.expression(depth - 1)),
            _ => inner,
        }
    }

    fn any_term(&mut self, parameter: u64) -> String {
        let depth = self.below(4);
        let inner = self.expression(depth);
        match self.below(6) {
            0 => format!("p{parameter}*p0*({inner})"),
            1 => format!("({inner})/p{parameter}"),
            _ => format!("p{parameter}*({inner})"),
        }
    }

    fn motion(&mut self, amplitude: &str) -> String {
        let order = 2 * self.below(4) + 1;
        let multiple = self.below(3) + 1;
        if self.kind == Kind::Any && self.below(3) == 0 {
            return format!("point_to_point({}, {amplitude}, w, {order})", self.number());
        }
        if self.below(2) == 0 {
            return format!("rest_to_rest({amplitude}, {multiple}*w, {order})");
        }
        let terms: Vec<String> = (0..self.below(3) + 1)
            .map(|_| {
                let name = if self.below(2) == 0 { "sin" } else { "cos" };
                format!("{}*{name}({}*w*t)", self.number(), self.below(6) + 1)
            })
            .collect();
        format!("{amplitude}*({})", terms.join(" + "))
    }

    /// The text of the model.
    pub(crate) fn model(mut self) -> String {
        let list = |name: &str, count: u64| (0..count).map(|i| format!("{name}{i}")).collect::<Vec<_>>().join(", ");
        let mut text = format!(
            "model A {{\ncoordinate {};\ninput {};\nparameter {};\n",
            list("q", self.coordinates),
            list("u", self.coordinates),
            list("p", self.parameters)
        );
        for (i, valued) in self.constants.clone().into_iter().enumerate() {
            let value = if valued { format!(" = {}", self.number()) } else { String::new() };
            let _ = writeln!(text, "constant c{i}{value};");
        }
        // Every parameter stands somewhere.
        let mut next = 0;
        for row in 0..self.coordinates {
            let last = row + 1 == self.coordinates;
            let count = if last { (self.parameters - next).max(1) } else { self.below(2) + 1 };
            let mut terms = vec![format!("p{}*ddot(q{row})", self.below(self.parameters))];
            for _ in 0..count {
                let parameter = next.min(self.parameters - 1);
                next = (next + 1).min(self.parameters);
                terms.push(match self.kind {
                    Kind::Regular => self.regular_term(parameter),
                    Kind::Any => self.any_term(parameter),
                });
            }
            let _ = writeln!(text, "{} = u{row};", terms.join(" + "));
        }
        if self.kind == Kind::Any && self.below(3) == 0 {
            let _ = writeln!(text, "taylor q0 about {} order {};", self.number(), self.below(4) + 1);
        }
        let _ = writeln!(text, "pattern {{ amplitude {}; frequency w;", list("a", self.coordinates));
        if self.below(3) == 0 {
            let _ = writeln!(text, "harmonics {};", self.below(40) + 1);
        }
        for row in 0..self.coordinates {
            let motion = self.motion(&format!("a{row}"));
            let _ = writeln!(text, "q{row} = {motion};");
        }
        text + "}\n}\n"
    }
}
