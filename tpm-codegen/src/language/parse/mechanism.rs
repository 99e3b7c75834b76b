//! Parses `mechanism { ... }`.

use tpm_symbolic::mechanics::tree::NAMES;
use tpm_symbolic::mechanics::tree::mechanism::{Loss, parameter_name};
use tpm_symbolic::number::rational;

use super::{Parse, Parser, Reported};
use crate::diagnostic::Diagnostic;
use crate::language::ast::mechanism::{
    BodyDeclaration, DriveDeclaration, InertiaDeclaration, JointDeclaration, JointMotion, KnownInertia,
    MechanismDeclaration, MechanismItem, Placement, VectorExpr, loss_word,
};
use crate::language::ast::{Expr, ExprKind, Ident, Item, Operation};
use crate::language::keywords::{BODY_STATEMENTS, MECHANISM_STATEMENTS};
use crate::language::lex::shorten;
use crate::language::suggest::nearest;
use crate::language::token::TokenKind;
use crate::source::Span;

impl Parser<'_, '_> {
    pub(super) fn mechanism(&mut self) -> Parse<Item> {
        let keyword = self.bump().span;
        let open = self.expect(TokenKind::OpenBrace)?.span;
        let mut items = Vec::new();
        self.braced(open, "mechanism", &MECHANISM_STATEMENTS, |parser| {
            items.push(parser.mechanism_item()?);
            Ok(())
        });
        Ok(Item::Mechanism(MechanismDeclaration { keyword, items }))
    }

    /// Statements up to the closing brace; one that cannot be read is reported and skipped.
    fn braced(
        &mut self,
        open: Span,
        what: &str,
        statements: &[&str],
        mut statement: impl FnMut(&mut Self) -> Parse<()>,
    ) {
        loop {
            match self.kind() {
                TokenKind::CloseBrace => {
                    self.bump();
                    return;
                }
                TokenKind::End => {
                    self.report(
                        Diagnostic::error(open, "this `{` is not closed")
                            .help(format!("add a `}}` at the end of the {what}")),
                    );
                    self.incomplete = true;
                    return;
                }
                TokenKind::Semicolon => {
                    self.bump();
                }
                _ => {
                    let begun = self.at;
                    if let Err(Reported) = statement(self) {
                        self.recover(begun, statements);
                    }
                }
            }
        }
    }

    /// Reports a word that begins no statement here.
    fn no_statement(&mut self, of: &str, statements: &[&str]) -> Reported {
        let token = self.peek();
        if token.kind != TokenKind::Ident {
            return self.unexpected(&format!("a statement of {of}"));
        }
        let word = self.text(token);
        let error = Diagnostic::error(token.span, format!("`{}` begins no statement of {of}", shorten(word)));
        let help = match nearest(word, statements.iter().copied()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("its statements begin with {}", statements.join(", ")),
        };
        self.report(error.help(help))
    }

    fn mechanism_item(&mut self) -> Parse<MechanismItem> {
        if self.is_word(0, "gravity") {
            self.bump();
            let gravity = self.vector()?;
            self.end_of_statement()?;
            return Ok(MechanismItem::Gravity(gravity));
        }
        if self.is_word(0, "body") {
            return self.body().map(|body| MechanismItem::Body(Box::new(body)));
        }
        if self.is_word(0, "drive") {
            return self.drive().map(MechanismItem::Drive);
        }
        Err(self.no_statement("a mechanism", &MECHANISM_STATEMENTS))
    }

    fn body(&mut self) -> Parse<BodyDeclaration> {
        self.bump();
        let name = self.name("the body's name")?;
        let parent = if self.is_word(0, "on") {
            self.bump();
            Some(self.name("the body that it stands on")?)
        } else {
            None
        };
        if self.kind() != TokenKind::OpenBrace {
            let error = self.unexpected("`on` and a body, or `{`");
            return Err(error);
        }
        let open = self.bump().span;
        let mut body = BodyDeclaration { name, parent, joint: None, inertia: None, near: None };
        let mut first_inertia = None;
        self.braced(open, "body", &BODY_STATEMENTS, |parser| {
            let keyword = parser.peek().span;
            let twice = |parser: &mut Self, first: Span, what: &str| {
                parser.report(
                    Diagnostic::error(keyword, format!("a body has one {what}"))
                        .label(first, "the first one")
                        .help("remove one of them"),
                )
            };
            if parser.is_word(0, "inertia") {
                let inertia = parser.inertia(&body.name)?;
                if let Some(first) = first_inertia {
                    return Err(twice(parser, first, "inertia"));
                }
                first_inertia = Some(keyword);
                (body.inertia, body.near) = (Some(inertia.0), inertia.1);
                return Ok(());
            }
            let joint = parser.joint()?;
            if let Some(first) = &body.joint {
                let first = first.keyword;
                return Err(twice(parser, first, "joint"));
            }
            body.joint = Some(joint);
            Ok(())
        });
        Ok(body)
    }

    /// The word before the axis of a joint.
    fn before_axis(&mut self, word: &str, example: &str) -> Parse<()> {
        if self.is_word(0, word) {
            self.bump();
            return Ok(());
        }
        let (note, span) = (self.found(), self.peek().span);
        let fault = Diagnostic::error(span, format!("expected `{word}` and the axis of the joint"));
        Err(self.report(fault.note(note).help(format!("write a direction, such as `{example}`"))))
    }

    fn joint(&mut self) -> Parse<JointDeclaration> {
        let keyword = self.peek().span;
        let (motion, factor) = if self.is_word(0, "fixed") {
            self.bump();
            (JointMotion::Fixed, None)
        } else if self.is_word(0, "revolute") {
            self.bump();
            let (factor, coordinate) = self.moved("revolute 1/2*q about z")?;
            self.before_axis("about", "revolute q about z")?;
            (JointMotion::Revolute(coordinate, self.axis()?), factor)
        } else if self.is_word(0, "prismatic") {
            self.bump();
            let (factor, coordinate) = self.moved("prismatic -1*q along z")?;
            self.before_axis("along", "prismatic q along z")?;
            (JointMotion::Prismatic(coordinate, self.axis()?), factor)
        } else {
            return Err(self.no_statement("a body", &BODY_STATEMENTS));
        };
        let placement = self.placement()?;
        self.end_of_statement()?;
        Ok(JointDeclaration { keyword, motion, factor, placement })
    }

    /// A coordinate, or a factor times a coordinate.
    fn moved(&mut self, example: &str) -> Parse<(Option<Expr>, Ident)> {
        let begins_factor = matches!(self.kind(), TokenKind::Number | TokenKind::Minus | TokenKind::OpenParen)
            || matches!(self.nth(1).kind, TokenKind::Star | TokenKind::Slash);
        if !begins_factor {
            return Ok((None, self.name("a coordinate")?));
        }
        let product = self.expr()?;
        let span = product.span;
        match multiple(product) {
            Some((factor, coordinate)) => Ok((Some(factor), coordinate)),
            None => {
                let error = Diagnostic::error(span, "a joint moves by a number times a coordinate");
                Err(self.report(error.help(format!("write the coordinate last, such as `{example}`"))))
            }
        }
    }

    fn placement(&mut self) -> Parse<Placement> {
        let mut placement = Placement::default();
        if self.is_word(0, "at") {
            self.bump();
            placement.at = Some(self.vector()?);
        }
        if self.is_word(0, "turned") {
            self.bump();
            placement.turned = Some(self.vector()?);
        }
        Ok(placement)
    }

    fn inertia(&mut self, body: &Ident) -> Parse<(InertiaDeclaration, Option<Vec<Expr>>)> {
        let keyword = self.bump().span;
        if self.is_word(0, "parameters") {
            self.bump();
            let near = if self.is_word(0, "near") {
                self.bump();
                Some(
                    self.list(
                        NAMES.len(),
                        "the parameters of an inertia are m, mx, my, mz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz",
                    )?
                    .0,
                )
            } else {
                None
            };
            self.end_of_statement()?;
            let names = NAMES.map(|name| Ident { name: parameter_name(name, &body.name), span: keyword });
            return Ok((InertiaDeclaration::Parameters(names.to_vec()), near));
        }
        if !self.is_word(0, "mass") {
            let error = self.unexpected("`parameters` or `mass`");
            return Err(error);
        }
        self.bump();
        let mass = self.expr()?;
        let placement = self.placement()?;
        let moments = if self.is_word(0, "moments") {
            self.bump();
            Some(self.list(6, "moments of inertia are Ixx, Ixy, Ixz, Iyy, Iyz, Izz")?.0)
        } else {
            None
        };
        self.end_of_statement()?;
        Ok((InertiaDeclaration::Known(Box::new(KnownInertia { keyword, mass, placement, moments })), None))
    }

    fn drive(&mut self) -> Parse<DriveDeclaration> {
        self.bump();
        let name = self.name("a coordinate, or a name")?;
        let moves = if self.kind() == TokenKind::Equals {
            self.bump();
            Some(self.expr()?)
        } else {
            None
        };
        let input = if self.is_word(0, "by") {
            self.bump();
            Some(self.name("an input")?)
        } else {
            None
        };
        let mut losses = Vec::new();
        if self.is_word(0, "with") {
            self.bump();
            loop {
                losses.push(self.loss(&name)?);
                if !self.eat(TokenKind::Comma) {
                    break;
                }
            }
        }
        self.end_of_statement()?;
        Ok(DriveDeclaration { name, moves, input, losses })
    }

    fn loss(&mut self, drive: &Ident) -> Parse<(Loss, Ident)> {
        let token = self.peek();
        let words = Loss::ALL.map(loss_word);
        let word = if token.kind == TokenKind::Ident { self.text(token) } else { "" };
        let Some(loss) = Loss::ALL.into_iter().find(|&loss| loss_word(loss) == word) else {
            let error = Diagnostic::error(token.span, "this is no torque of a drive").note(self.found());
            let help = match nearest(word, words) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("a drive has {}", words.join(", ")),
            };
            return Err(self.report(error.help(help)));
        };
        self.bump();
        Ok((loss, Ident { name: parameter_name(loss.symbol(), &drive.name), span: token.span }))
    }

    /// `x`, `-y`, `z`, or a vector.
    fn axis(&mut self) -> Parse<VectorExpr> {
        let start = self.peek().span;
        let negative = self.kind() == TokenKind::Minus;
        let Some(axis) = ["x", "y", "z"].iter().position(|word| self.is_word(usize::from(negative), word)) else {
            return self.vector();
        };
        if negative {
            self.bump();
        }
        let span = start.to(self.bump().span);
        let components = std::array::from_fn(|i| {
            let value = Expr { kind: ExprKind::Number(rational::integer(i64::from(i == axis))), span };
            if i == axis && negative { Expr { kind: ExprKind::Negative(Box::new(value)), span } } else { value }
        });
        Ok(VectorExpr { components, span })
    }

    fn vector(&mut self) -> Parse<VectorExpr> {
        let (list, span) = self.list(3, "a vector is written `(x, y, z)`")?;
        match <[Expr; 3]>::try_from(list) {
            Ok(components) => Ok(VectorExpr { components, span }),
            Err(_) => Err(self.unexpected("three components")),
        }
    }

    /// A parenthesised list of so many expressions.
    fn list(&mut self, count: usize, rule: &str) -> Parse<(Vec<Expr>, Span)> {
        if self.kind() != TokenKind::OpenParen {
            let note = self.found();
            let error = Diagnostic::error(self.peek().span, format!("expected {count} values in parentheses"));
            return Err(self.report(error.note(note).help(rule)));
        }
        let open = self.bump().span;
        let mut list = vec![self.expr()?];
        while self.eat(TokenKind::Comma) {
            list.push(self.expr()?);
        }
        let span = open.to(self.close(open)?);
        if list.len() != count {
            let error = Diagnostic::error(span, format!("{count} values stand here, not {}", list.len()));
            return Err(self.report(error.help(rule)));
        }
        Ok((list, span))
    }
}

/// A product as its last factor, a name, and what stands before it; `-q` is -1 times q.
fn multiple(product: Expr) -> Option<(Expr, Ident)> {
    let span = product.span;
    match product.kind {
        ExprKind::Negative(inner) => {
            let ExprKind::Name(name) = inner.kind else { return None };
            let one = Expr { kind: ExprKind::Number(rational::integer(1)), span };
            Some((Expr { kind: ExprKind::Negative(Box::new(one)), span }, Ident { name, span: inner.span }))
        }
        ExprKind::Product(mut factors) => {
            let (Operation::Times, Expr { kind: ExprKind::Name(name), span: place }) = factors.pop()? else {
                return None;
            };
            let factor = match factors.len() {
                1 => factors.pop()?.1,
                _ => Expr { kind: ExprKind::Product(factors), span },
            };
            Some((factor, Ident { name, span: place }))
        }
        _ => None,
    }
}
