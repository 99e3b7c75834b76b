//! Expressions over columns: `0.5*(pwm1 - pwm2)`.
//!
//! Numbers, `pi`, names, the four operations, powers, brackets and a few functions. A name that is no word stands in quotes:
//! `"Motor current [A]"`. Powers bind before a sign, and from the right.

/// Deepest nesting of brackets, powers and signs.
const DEEPEST: usize = 64;

/// A function of one number.
type Function = fn(f64) -> f64;

/// Functions by name. The sign of zero is zero, as in models.
const FUNCTIONS: [(&str, Function); 8] = [
    ("abs", f64::abs),
    ("sign", |x| if x == 0.0 { 0.0 } else { x.signum() }),
    ("sqrt", f64::sqrt),
    ("sin", f64::sin),
    ("cos", f64::cos),
    ("tan", f64::tan),
    ("exp", f64::exp),
    ("log", f64::ln),
];

/// A step of the calculation; it takes its numbers from a stack, and leaves its result there.
#[derive(Clone, Copy, Debug)]
enum Step {
    Number(f64),
    /// The value of a name, by its place among the names.
    Name(usize),
    One(Function),
    Two(fn(f64, f64) -> f64),
}

/// An expression that has one name at least, and something to calculate.
#[derive(Clone, Debug)]
pub(super) struct Expression {
    /// The names in it, each once.
    pub(super) names: Vec<String>,
    steps: Vec<Step>,
}

impl Expression {
    /// The expression of a text; nothing where it is none, or a name or a number alone.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let mut parser = Parser { rest: text.trim_start(), names: Vec::new(), steps: Vec::new() };
        parser.sum(0)?;
        let whole = parser.rest.is_empty() && parser.steps.len() > 1 && !parser.names.is_empty();
        whole.then_some(Expression { names: parser.names, steps: parser.steps })
    }

    /// Its value where the names have these values; `stack` is used on the way.
    pub(super) fn evaluate(&self, values: &[f64], stack: &mut Vec<f64>) -> f64 {
        stack.clear();
        for step in &self.steps {
            let result = match step {
                Step::Number(number) => *number,
                Step::Name(name) => values[*name],
                Step::One(function) => function(stack.pop().unwrap_or(f64::NAN)),
                Step::Two(function) => {
                    let (right, left) = (stack.pop().unwrap_or(f64::NAN), stack.pop().unwrap_or(f64::NAN));
                    function(left, right)
                }
            };
            stack.push(result);
        }
        stack.pop().unwrap_or(f64::NAN)
    }

    /// How far its value moves where every name moves by a step, up or down; infinite where a step is not known. The values of the names are
    /// as before afterwards.
    pub(super) fn step(&self, values: &mut [f64], steps: &[f64], stack: &mut Vec<f64>) -> f64 {
        let value = self.evaluate(values, stack);
        let mut all = 0.0;
        for (i, step) in steps.iter().enumerate() {
            if !step.is_finite() {
                return f64::INFINITY;
            }
            let own = values[i];
            let mut apart = 0.0_f64;
            for moved in [own - step, own + step] {
                values[i] = moved;
                // What is no number beyond the end of a root's range does not count.
                apart = apart.max((self.evaluate(values, stack) - value).abs());
            }
            values[i] = own;
            all += apart;
        }
        all
    }
}

/// What is left of a text, and the steps so far.
struct Parser<'a> {
    rest: &'a str,
    names: Vec<String>,
    steps: Vec<Step>,
}

impl Parser<'_> {
    /// Whether a sign is next; it is then split off with the blanks behind it.
    fn takes(&mut self, sign: char) -> bool {
        let behind = self.rest.strip_prefix(sign);
        self.rest = behind.unwrap_or(self.rest);
        if behind.is_some() {
            self.rest = self.rest.trim_start();
        }
        behind.is_some()
    }

    fn sum(&mut self, depth: usize) -> Option<()> {
        self.product(depth)?;
        loop {
            let operation: fn(f64, f64) -> f64 = if self.takes('+') {
                |a, b| a + b
            } else if self.takes('-') {
                |a, b| a - b
            } else {
                return Some(());
            };
            self.product(depth)?;
            self.steps.push(Step::Two(operation));
        }
    }

    fn product(&mut self, depth: usize) -> Option<()> {
        self.signed(depth)?;
        loop {
            let operation: fn(f64, f64) -> f64 = if self.takes('*') {
                |a, b| a * b
            } else if self.takes('/') {
                |a, b| a / b
            } else {
                return Some(());
            };
            self.signed(depth)?;
            self.steps.push(Step::Two(operation));
        }
    }

    fn signed(&mut self, depth: usize) -> Option<()> {
        let depth = Some(depth + 1).filter(|depth| *depth < DEEPEST)?;
        if self.takes('-') {
            self.signed(depth)?;
            self.steps.push(Step::One(|x| -x));
            return Some(());
        }
        self.single(depth)?;
        if self.takes('^') {
            self.signed(depth)?;
            self.steps.push(Step::Two(f64::powf));
        }
        Some(())
    }

    fn bracket(&mut self, depth: usize) -> Option<()> {
        self.sum(depth)?;
        self.takes(')').then_some(())
    }

    fn single(&mut self, depth: usize) -> Option<()> {
        if self.takes('(') {
            return self.bracket(depth);
        }
        let first = self.rest.chars().next()?;
        if first == '"' || first == '`' {
            let (name, behind) = self.rest[1..].split_once(first)?;
            self.rest = behind.trim_start();
            self.name(name);
        } else if first.is_ascii_digit() || first == '.' {
            let digits = |text: &str| text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
            let mut end = digits(self.rest);
            if let Some(exponent) = self.rest[end..].strip_prefix(['e', 'E']) {
                let signed = exponent.strip_prefix(['+', '-']).unwrap_or(exponent);
                let length = signed.find(|c: char| !c.is_ascii_digit()).unwrap_or(signed.len());
                end += if length > 0 { 1 + exponent.len() - signed.len() + length } else { 0 };
            }
            self.steps.push(Step::Number(self.rest[..end].parse().ok()?));
            self.rest = self.rest[end..].trim_start();
        } else {
            // A word, with the place in a list behind it: `q[1]`.
            let word = |c: char| c.is_alphanumeric() || c == '_' || c == '.';
            let mut end = self.rest.find(|c: char| !word(c)).unwrap_or(self.rest.len());
            if end == 0 {
                return None;
            }
            if let Some((place, _)) = self.rest[end..].strip_prefix('[').and_then(|rest| rest.split_once(']'))
                && place.bytes().all(|byte| byte.is_ascii_digit())
            {
                end += place.len() + 2;
            }
            let name = &self.rest[..end];
            self.rest = self.rest[end..].trim_start();
            let function = FUNCTIONS.iter().find(|(own, _)| *own == name);
            match function {
                Some((_, function)) if self.takes('(') => {
                    self.bracket(depth)?;
                    self.steps.push(Step::One(*function));
                }
                _ if name == "pi" => self.steps.push(Step::Number(std::f64::consts::PI)),
                _ => self.name(name),
            }
        }
        Some(())
    }

    fn name(&mut self, name: &str) {
        let at = self.names.iter().position(|own| own == name).unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.names.len() - 1
        });
        self.steps.push(Step::Name(at));
    }
}

#[cfg(test)]
mod tests {
    use super::Expression;

    fn value(text: &str, values: &[f64]) -> f64 {
        let expression = Expression::parse(text).unwrap_or_else(|| panic!("{text}"));
        expression.evaluate(values, &mut Vec::new())
    }

    #[test]
    fn expressions_have_their_values() {
        for (text, values, expected) in [
            ("0.5*(pwm1-pwm2)", &[3.0, 1.0][..], 1.0),
            ("a - b - c", &[10.0, 3.0, 2.0], 5.0),
            ("a/b/c*2", &[12.0, 3.0, 2.0], 4.0),
            ("-a^2", &[3.0], -9.0),
            ("2^-a", &[1.0], 0.5),
            ("a^2^3", &[2.0], 256.0),
            ("--a", &[2.0], 2.0),
            ("duty * \"Battery [V]\" / 1e2", &[50.0, 12.0], 6.0),
            ("`a-b` + q[2]", &[1.0, 2.0], 3.0),
            ("abs(u)*sign(u)", &[-4.0], -4.0),
            ("sign(u) + 1", &[0.0], 1.0),
            ("x*pi/180", &[180.0], std::f64::consts::PI),
            ("arm.x+arm.x", &[1.5], 3.0),
            ("2.5e-1*x", &[4.0], 1.0),
        ] {
            assert_eq!(value(text, values), expected, "{text}");
        }
        assert!(value("a + b", &[1.0, f64::NAN]).is_nan());
    }

    #[test]
    fn a_value_moves_with_the_steps_of_its_names() {
        for (text, values, steps, expected) in [
            ("0.5*(a-b)", &mut [3.0, 1.0][..], &[0.1, 0.2][..], 0.15),
            ("a^2", &mut [3.0], &[0.1], 0.61),
            ("sqrt(a)", &mut [0.0], &[0.01], 0.1),
            ("a+b", &mut [1.0, 1.0], &[0.1, f64::INFINITY], f64::INFINITY),
        ] {
            let expression = Expression::parse(text).unwrap_or_else(|| panic!("{text}"));
            let before = values.to_vec();
            let step = expression.step(values, steps, &mut Vec::new());
            assert!(step == expected || (step - expected).abs() < 1e-12, "{text}: {step}");
            assert_eq!(values, before, "{text}");
        }
    }

    #[test]
    fn what_is_no_expression_is_left_alone() {
        let deep = "(".repeat(100_000) + "a";
        let signs = "-".repeat(100_000) + "a";
        for text in
            ["", "a", "1.5", "2*3", "a b", "a+", "/drive/volts", "(a", "a)", "Motor current [A]", "\"a", &deep, &signs]
        {
            assert!(Expression::parse(text).is_none(), "{}", text.len());
        }
    }
}
