//! Names of emitted items: those of the model, made legal and distinct.
//!
//! Invariant: one [`Namer`] serves one namespace. It never gives the same name twice, never a reserved name, and never
//! one that the target language refuses. Equal requests in equal order give equal names.

use std::collections::HashSet;

/// The target language of names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    /// Rust, every edition up to 2024.
    Rust,
    /// C99 and later, and the names of C++ so that its compilers may read the headers.
    C,
}

/// Reserved words of Rust that cannot become raw identifiers.
const RUST_FIXED: [&str; 5] = ["Self", "_", "crate", "self", "super"];

/// Reserved words of Rust.
const RUST: [&str; 50] = [
    "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "do", "dyn", "else", "enum",
    "extern", "false", "final", "fn", "for", "gen", "if", "impl", "in", "let", "loop", "macro", "match", "mod", "move",
    "mut", "override", "priv", "pub", "ref", "return", "static", "struct", "trait", "true", "try", "type", "typeof",
    "unsafe", "unsized", "use", "virtual", "where", "while", "yield", "safe", "raw",
];

/// Reserved words of C and C++, and names of `math.h` that a field or variable must not take.
const C: [&str; 127] = [
    "alignas",
    "alignof",
    "and",
    "asm",
    "auto",
    "bool",
    "break",
    "case",
    "catch",
    "char",
    "class",
    "complex",
    "const",
    "constexpr",
    "continue",
    "default",
    "delete",
    "do",
    "double",
    "else",
    "enum",
    "explicit",
    "export",
    "extern",
    "false",
    "float",
    "for",
    "friend",
    "goto",
    "if",
    "imaginary",
    "inline",
    "int",
    "long",
    "mutable",
    "namespace",
    "new",
    "not",
    "nullptr",
    "operator",
    "or",
    "private",
    "protected",
    "public",
    "register",
    "restrict",
    "return",
    "short",
    "signed",
    "sizeof",
    "static",
    "static_assert",
    "struct",
    "switch",
    "template",
    "this",
    "thread_local",
    "throw",
    "true",
    "try",
    "typedef",
    "typeid",
    "typename",
    "typeof",
    "union",
    "unsigned",
    "using",
    "virtual",
    "void",
    "volatile",
    "wchar_t",
    "while",
    "xor",
    "I",
    "errno",
    "NAN",
    "INFINITY",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "atan2",
    "sqrt",
    "fabs",
    "tanh",
    "exp",
    "log",
    "pow",
    "j0",
    "j1",
    "y0",
    "y1",
    "jn",
    "yn",
    "gamma",
    "gammaf",
    "lgamma",
    "signgam",
    "fmin",
    "fmax",
    "floor",
    "ceil",
    "round",
    "hypot",
    "isnan",
    "isinf",
    "isfinite",
    "signbit",
    "HUGE",
    "HUGE_VAL",
    "M_E",
    "M_PI",
    "NULL",
    "DOMAIN",
    "SING",
    "OVERFLOW",
    "UNDERFLOW",
    "PLOSS",
    "TLOSS",
    "offsetof",
    "unix",
    "linux",
    "i386",
    "near",
    "far",
];

impl Language {
    fn legal(self, name: &str) -> String {
        match self {
            Self::Rust if RUST_FIXED.contains(&name) => format!("{name}_"),
            Self::Rust if RUST.contains(&name) => format!("r#{name}"),
            Self::C if !name.is_ascii() => self.legal(&ascii(name)),
            Self::C if C.contains(&name) || name.starts_with('_') => {
                let rest = name.trim_start_matches('_');
                if rest.starts_with(|first: char| first.is_ascii_alphabetic()) {
                    format!("{rest}_")
                } else {
                    format!("x{rest}")
                }
            }
            _ => name.to_owned(),
        }
    }
}

/// The name with every letter beyond ASCII replaced by its code point: older C compilers read identifiers as ASCII
/// only.
fn ascii(name: &str) -> String {
    let mut text = String::with_capacity(name.len() + 4);
    for letter in name.chars() {
        match letter {
            letter if letter.is_ascii() => text.push(letter),
            letter => text.push_str(&format!("u{:04x}", u32::from(letter))),
        }
    }
    text
}

/// Assigns names in one namespace.
#[derive(Clone, Debug)]
pub struct Namer {
    language: Language,
    taken: HashSet<String>,
}

impl Namer {
    /// An empty namespace that never gives out the `reserved` names.
    #[must_use]
    pub fn new(language: Language, reserved: &[&str]) -> Self {
        Self { language, taken: reserved.iter().map(|&name| name.to_owned()).collect() }
    }

    /// The requested name, followed by underscores until it is new.
    pub fn name(&mut self, wanted: &str) -> String {
        let mut plain = wanted.to_owned();
        loop {
            let legal = self.language.legal(&plain);
            // `r#x` and `x` are the same name.
            if self.taken.insert(legal.strip_prefix("r#").unwrap_or(&legal).to_owned()) {
                return legal;
            }
            plain.push('_');
        }
    }

    /// A name for a type: `th1` becomes `Th1`, followed by `suffix`.
    pub fn type_name(&mut self, wanted: &str, suffix: &str) -> String {
        let name = camel(wanted) + suffix;
        self.name(&name)
    }
}

/// `MassSpringDrag`, `mass_spring_drag` and `Mass_spring` as `MassSpringDrag` and `MassSpring`.
#[must_use]
pub fn camel(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    for part in name.split('_').filter(|part| !part.is_empty()) {
        let mut letters = part.chars();
        if let Some(first) = letters.next() {
            // Digits of neighbouring parts must stay apart: x1_2 is not x12.
            if first.is_numeric() && text.ends_with(char::is_numeric) {
                text.push('_');
            }
            text.extend(first.to_uppercase());
            text.push_str(letters.as_str());
        }
    }
    if text.chars().next().is_none_or(char::is_numeric) { format!("M{text}") } else { text }
}

/// `MassSpringDrag` as `mass_spring_drag`; runs of capitals stay together.
#[must_use]
pub fn snake(name: &str) -> String {
    let mut text = String::with_capacity(name.len() + 4);
    let letters: Vec<char> = name.chars().collect();
    for (i, &letter) in letters.iter().enumerate() {
        if letter.is_uppercase() {
            let after_small = i > 0 && !letters[i - 1].is_uppercase() && letters[i - 1] != '_';
            let before_small =
                i > 0 && letters[i - 1].is_uppercase() && letters.get(i + 1).is_some_and(|next| next.is_lowercase());
            if after_small || before_small {
                text.push('_');
            }
        }
        text.extend(letter.to_lowercase());
    }
    text
}

/// Whether Rust's lint on naming style accepts a field's name.
#[must_use]
pub fn is_snake(name: &str) -> bool {
    let inner = name.trim_matches('_');
    !inner.contains("__") && !inner.chars().any(char::is_uppercase)
}

#[cfg(test)]
mod tests {
    use super::{C, Language, Namer, RUST, camel, is_snake, snake};

    #[test]
    fn reserved_words_and_collisions() {
        let mut fields = Namer::new(Language::Rust, &["value"]);
        let found = ["type", "self", "value", "x", "x", "x_", "M"].map(|name| fields.name(name));
        assert_eq!(found, ["r#type", "self_", "value_", "x", "x_", "x__", "M"]);
        let mut fields = Namer::new(Language::C, &[]);
        let found = ["int", "_x", "sin", "type", "_1", "θ"].map(|name| fields.name(name));
        assert_eq!(found, ["int_", "x_", "sin_", "type", "x1", "u03b8"]);
    }

    #[test]
    fn every_reserved_word_of_rust_is_escaped() {
        for word in RUST {
            let mut namer = Namer::new(Language::Rust, &[]);
            assert!(syn::parse_str::<syn::Ident>(&namer.name(word)).is_ok(), "{word}");
        }
        assert!(C.iter().all(|word| Namer::new(Language::C, &[]).name(word) != **word));
    }

    #[test]
    fn cases() {
        assert_eq!(["th1", "alpha_2", "x_1_2", "eq1", "F", "_"].map(camel), ["Th1", "Alpha2", "X1_2", "Eq1", "F", "M"]);
        assert_eq!(
            ["MassSpringDrag", "Emps", "TPMArm", "arm", "RotaryPendulum2D"].map(snake),
            ["mass_spring_drag", "emps", "tpm_arm", "arm", "rotary_pendulum2_d"]
        );
        assert!(is_snake("k1") && is_snake("m_") && !is_snake("Fv") && !is_snake("a__b"));
    }
}
