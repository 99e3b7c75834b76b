//! Values of a point at rest as they are given on the command line, such as `pi`, `-pi/2`, `m*g/k` or `0.1`.
//!
//! Invariant: a value is an exact expression of numbers, pi, parameters and constants of the model.

use tpm_symbolic::expr::{ExprId, Graph};
use tpm_symbolic::model::{Kind, Model};
use tpm_symbolic::rational;

/// Parentheses and signs within each other; a command line needs no more.
const DEEPEST: usize = 50;

/// The expression of a text.
pub(crate) fn parse(text: &str, model: &mut Model) -> Result<ExprId, String> {
    let mut parser = Parser { rest: text.trim_start(), model, depth: 0 };
    let value = parser.sum()?;
    match parser.rest.chars().next() {
        None => Ok(value),
        Some(found) => Err(format!("`{text}`: `{found}` is not expected here; write something like -pi/2 or m*g/k")),
    }
}

struct Parser<'t, 'm> {
    rest: &'t str,
    model: &'m mut Model,
    depth: usize,
}

impl Parser<'_, '_> {
    fn graph(&mut self) -> &mut Graph {
        &mut self.model.graph
    }

    /// Whether the next character is this one, which is then passed.
    fn take(&mut self, wanted: char) -> bool {
        let found = self.rest.strip_prefix(wanted).map(str::trim_start);
        self.rest = found.unwrap_or(self.rest);
        found.is_some()
    }

    fn word(&mut self, mut belongs: impl FnMut(char) -> bool) -> String {
        let end = self.rest.find(|c| !belongs(c)).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest.trim_start();
        word.to_owned()
    }

    fn sum(&mut self) -> Result<ExprId, String> {
        let mut value = self.product()?;
        loop {
            if self.take('+') {
                let next = self.product()?;
                value = self.graph().add(value, next);
            } else if self.take('-') {
                let next = self.product()?;
                value = self.graph().sub(value, next);
            } else {
                return Ok(value);
            }
        }
    }

    fn product(&mut self) -> Result<ExprId, String> {
        let mut value = self.signed()?;
        loop {
            if self.take('*') {
                let next = self.signed()?;
                value = self.graph().mul(value, next);
            } else if self.take('/') {
                let next = self.signed()?;
                let zero = self.graph().integer(0);
                if next == zero {
                    return Err("a division by zero".to_owned());
                }
                value = self.graph().div(value, next);
            } else {
                return Ok(value);
            }
        }
    }

    fn signed(&mut self) -> Result<ExprId, String> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!("more than {DEEPEST} signs and parentheses within each other"));
        }
        let value = if self.take('-') {
            let value = self.signed()?;
            self.graph().neg(value)
        } else {
            self.atom()?
        };
        self.depth -= 1;
        Ok(value)
    }

    fn atom(&mut self) -> Result<ExprId, String> {
        match self.rest.chars().next() {
            Some('(') => {
                self.take('(');
                let value = self.sum()?;
                if self.take(')') { Ok(value) } else { Err("a `)` is missing".to_owned()) }
            }
            Some(c) if c.is_ascii_digit() || c == '.' => {
                let mut last = ' ';
                // The sign of an exponent belongs to the number.
                let text = self.word(|c| {
                    let exponent = matches!(last, 'e' | 'E');
                    last = c;
                    c.is_ascii_digit() || matches!(c, '.' | 'e' | 'E') || (exponent && matches!(c, '+' | '-'))
                });
                let value = rational::parse(&text).ok_or_else(|| format!("`{text}` is not a number"))?;
                Ok(self.graph().number(value))
            }
            Some(c) if c.is_alphabetic() || c == '_' => {
                let name = self.word(|c| c.is_alphanumeric() || c == '_');
                if name == "pi" {
                    return Ok(self.graph().pi());
                }
                let symbol = self.model.find_symbol(&name);
                match symbol.filter(|s| matches!(self.model.quantity(*s).kind, Kind::Parameter | Kind::Constant { .. }))
                {
                    Some(symbol) => Ok(self.graph().symbol(symbol)),
                    None => Err(format!("`{name}` is no parameter or constant of model {}", self.model.name)),
                }
            }
            Some(c) => Err(format!("`{c}` is not expected here; write something like -pi/2 or m*g/k")),
            None => Err("the value ends too early; write something like -pi/2 or m*g/k".to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::parse;
    use tpm_symbolic::model::{Kind, Model};

    #[test]
    fn values_are_exact_expressions() {
        let mut model = Model::default();
        for name in ["m", "g", "k"] {
            model.declare(name, None, Kind::Parameter);
        }
        let mut shown = |text: &str| parse(text, &mut model).map(|value| model.display(value));
        assert_eq!(shown("0.1").as_deref(), Ok("1/10"));
        assert_eq!(shown(" - pi / 2 ").as_deref(), Ok("-pi/2"));
        assert_eq!(shown("m*g/k").as_deref(), shown("(g/k)*m").as_deref());
        assert_eq!(shown("1e-3+2").as_deref(), Ok("2001/1000"));
        for wrong in ["", "2 pi", "x", "1/0", "(1", "1+", "^", "1..2", &"-".repeat(60), &"(".repeat(100_000)] {
            assert!(shown(wrong).is_err(), "{wrong}");
        }
    }
}
