//! Parses expressions: `^` binds tighter than unary minus, that tighter than `*` and `/`, those tighter than `+` and `-`.

use num_bigint::BigInt;
use tpm_symbolic::number::rational::Rational;

use super::{DEEPEST_NESTING, Parse, Parser, Reported};
use crate::diagnostic::Diagnostic;
use crate::language::ast::{Expr, ExprKind, Ident, Operation, Sign};
use crate::language::lex::shorten;
use crate::language::token::TokenKind;
use crate::source::Span;

/// Most digits of a literal's mantissa: far more than any number of a model has, and few enough that reading one, which
/// takes quadratic time, is fast.
const MOST_DIGITS: usize = 20_000;

/// Largest decimal exponent of a literal. Without a bound a ten-byte text could ask for a gigabyte of zeros.
const LARGEST_EXPONENT: u32 = 1_000;

impl Parser<'_, '_> {
    pub(super) fn expr(&mut self) -> Parse<Expr> {
        let first = self.product()?;
        if !matches!(self.kind(), TokenKind::Plus | TokenKind::Minus) {
            return Ok(first);
        }
        let mut span = first.span;
        let mut terms = vec![(Sign::Plus, first)];
        loop {
            let sign = match self.kind() {
                TokenKind::Plus => Sign::Plus,
                TokenKind::Minus => Sign::Minus,
                _ => return Ok(Expr { kind: ExprKind::Sum(terms), span }),
            };
            self.bump();
            let term = self.product()?;
            span = span.to(term.span);
            terms.push((sign, term));
        }
    }

    fn product(&mut self) -> Parse<Expr> {
        let first = self.unary()?;
        if !matches!(self.kind(), TokenKind::Star | TokenKind::Slash) {
            return Ok(first);
        }
        let mut span = first.span;
        let mut factors = vec![(Operation::Times, first)];
        loop {
            let operation = match self.kind() {
                TokenKind::Star => Operation::Times,
                TokenKind::Slash => Operation::Over,
                _ => return Ok(Expr { kind: ExprKind::Product(factors), span }),
            };
            self.bump();
            let factor = self.unary()?;
            span = span.to(factor.span);
            factors.push((operation, factor));
        }
    }

    fn unary(&mut self) -> Parse<Expr> {
        if self.kind() == TokenKind::Plus {
            let span = self.peek().span;
            self.report(Diagnostic::error(span, "a `+` without a left side").help("remove it"));
            self.bump();
        }
        if self.kind() != TokenKind::Minus {
            return self.power();
        }
        let minus = self.bump().span;
        let inner = self.deeper(minus, Self::unary)?;
        let span = minus.to(inner.span);
        Ok(Expr { kind: ExprKind::Negative(Box::new(inner)), span })
    }

    /// Runs a part of the parser one level deeper.
    fn deeper<T>(&mut self, opening: Span, part: impl FnOnce(&mut Self) -> Parse<T>) -> Parse<T> {
        if self.depth >= DEEPEST_NESTING {
            return Err(self.report(
                Diagnostic::error(opening, format!("nested more than {DEEPEST_NESTING} levels deep"))
                    .help("give parts of the expression names with `let name = ...;`"),
            ));
        }
        self.depth += 1;
        let result = part(self);
        self.depth -= 1;
        result
    }

    fn power(&mut self) -> Parse<Expr> {
        let base = self.atom()?;
        let exponent = match self.kind() {
            TokenKind::Caret => {
                self.bump();
                self.exponent()?
            }
            TokenKind::Superscript(digit) => {
                self.bump();
                u32::from(digit)
            }
            _ => return Ok(base),
        };
        let span = base.span.to(self.last());
        if matches!(self.kind(), TokenKind::Caret | TokenKind::Superscript(_)) {
            let token = self.peek();
            return Err(self.report(
                Diagnostic::error(span.to(token.span), "`^` after `^`: its order is not defined")
                    .help("write the exponent out, or put the inner power in parentheses, `(x^2)^3`"),
            ));
        }
        Ok(Expr { kind: ExprKind::Power(Box::new(base), exponent), span })
    }

    fn exponent(&mut self) -> Parse<u32> {
        let token = self.peek();
        let text = self.text(token);
        if token.kind == TokenKind::Number && text.bytes().all(|byte| byte.is_ascii_digit()) {
            self.bump();
            return text.parse().map_err(|_| {
                self.report(
                    Diagnostic::error(token.span, format!("the exponent {} is too large", shorten(text)))
                        .help(format!("exponents go up to {}", u32::MAX)),
                )
            });
        }
        let help = match token.kind {
            TokenKind::Minus => "divide instead: `1/x^2`",
            TokenKind::Number if text.trim_end_matches('0').ends_with(".5") || text == ".5" => {
                "a square root is written `sqrt(x)`"
            }
            TokenKind::OpenParen => "write the integer without parentheses; a square root is `sqrt(x)`",
            _ => "write the exponent as a number, as in `x^2`",
        };
        let note = self.found();
        Err(self.report(Diagnostic::error(token.span, "an exponent is a non-negative integer").note(note).help(help)))
    }

    fn atom(&mut self) -> Parse<Expr> {
        let token = self.peek();
        match token.kind {
            TokenKind::Number => {
                self.bump();
                let value = self.number(self.text(token), token.span)?;
                Ok(Expr { kind: ExprKind::Number(value), span: token.span })
            }
            TokenKind::Ident => {
                self.bump();
                let name = self.text(token).to_owned();
                if self.kind() == TokenKind::OpenParen && !self.on_new_line() {
                    return self.call(Ident { name, span: token.span });
                }
                Ok(Expr { kind: ExprKind::Name(name), span: token.span })
            }
            TokenKind::OpenParen => {
                self.bump();
                let mut inner = self.deeper(token.span, Self::expr)?;
                let close = self.close(token.span)?;
                inner.span = token.span.to(close);
                Ok(inner)
            }
            TokenKind::OpenBracket => {
                let error = Diagnostic::error(token.span, "brackets hold units, and units belong to declarations");
                Err(self.report(error.help("group with parentheses")))
            }
            _ => Err(self.unexpected("an expression")),
        }
    }

    fn call(&mut self, function: Ident) -> Parse<Expr> {
        let open = self.bump().span;
        let mut arguments = Vec::new();
        if self.kind() != TokenKind::CloseParen {
            loop {
                arguments.push(self.deeper(open, Self::expr)?);
                if self.kind() != TokenKind::Comma {
                    break;
                }
                self.bump();
            }
        }
        let close = self.close(open)?;
        let span = function.span.to(close);
        Ok(Expr { kind: ExprKind::Call(function, arguments), span })
    }

    pub(super) fn close(&mut self, open: Span) -> Parse<Span> {
        if self.kind() == TokenKind::CloseParen {
            return Ok(self.bump().span);
        }
        let token = self.peek();
        let mut error =
            Diagnostic::error(token.span, "expected `)` or an operator").note(self.found()).label(open, "opened here");
        if matches!(token.kind, TokenKind::Ident | TokenKind::Number | TokenKind::OpenParen) {
            error = error.help("a product is written with `*`");
        }
        Err(self.report(error))
    }

    /// The exact value of a literal.
    pub(super) fn number(&mut self, text: &str, span: Span) -> Parse<Rational> {
        let (mantissa, exponent) = match text.find(['e', 'E']) {
            Some(at) => (&text[..at], &text[at + 1..]),
            None => (text, ""),
        };
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        let (negative, magnitude) = match exponent.strip_prefix('-') {
            Some(magnitude) => (true, magnitude),
            None => (false, exponent.strip_prefix('+').unwrap_or(exponent)),
        };
        let magnitude =
            if magnitude.is_empty() { Some(0) } else { magnitude.parse().ok().filter(|&m| m <= LARGEST_EXPONENT) };
        let (Some(magnitude), true) = (magnitude, whole.len() + fraction.len() <= MOST_DIGITS) else {
            return Err(self.too_long(span));
        };
        let Ok(digits) = format!("{whole}{fraction}").parse::<BigInt>() else {
            return Err(self.unexpected("a number"));
        };
        // At most MOST_DIGITS digits of fraction, so both exponents fit.
        let shift = fraction.len() as i64 + if negative { i64::from(magnitude) } else { -i64::from(magnitude) };
        let power = num_traits::pow(BigInt::from(10), shift.unsigned_abs() as usize);
        Ok(if shift > 0 { Rational::new(digits, power) } else { Rational::from_integer(digits * power) })
    }

    fn too_long(&mut self, span: Span) -> Reported {
        self.report(
            Diagnostic::error(span, "this number is too long to be meant")
                .help(format!("numbers have at most {MOST_DIGITS} digits and exponents up to {LARGEST_EXPONENT}")),
        )
    }
}
