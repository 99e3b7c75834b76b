//! Statements of the subset in C.

use std::collections::HashMap;

use super::expression::{ADDITION, UNARY, unsigned};
use super::frame::Frame;
use super::library::{self, Untranslated};
use super::translator::Translator;
use super::types::Type;

impl Translator<'_> {
    /// The statements of a block; the last expression of a function is its result.
    pub(super) fn block(&mut self, block: &syn::Block, frame: &mut Frame, last: bool) -> Result<(), Untranslated> {
        for (index, statement) in block.stmts.iter().enumerate() {
            match statement {
                syn::Stmt::Local(local) => self.local(local, frame)?,
                syn::Stmt::Expr(expression, None) if last && index + 1 == block.stmts.len() => {
                    self.result(expression, frame)?;
                }
                syn::Stmt::Expr(expression, _) => self.statement(expression, frame)?,
                _ => return Err("a statement beyond the subset".to_owned()),
            }
        }
        Ok(())
    }

    /// The statements of an inner block.
    fn inner(&mut self, block: &syn::Block, frame: &mut Frame, last: bool) -> Result<(), Untranslated> {
        frame.scopes.push(HashMap::new());
        frame.depth += 1;
        self.block(block, frame, last)?;
        frame.depth -= 1;
        frame.scopes.pop();
        Ok(())
    }

    /// The result of a function.
    fn result(&mut self, expression: &syn::Expr, frame: &mut Frame) -> Result<(), Untranslated> {
        match expression {
            syn::Expr::If(choice) if self.is_long(choice) || frame.result == Type::Unit => {
                self.branches(choice, frame, frame.result != Type::Unit)
            }
            _ if frame.result == Type::Unit => self.statement(expression, frame),
            syn::Expr::Struct(literal) => {
                let ty = frame.result.clone();
                let declared = self.declared(&ty, "made", false)?;
                frame.write(&format!("{declared};"));
                self.fields("made", literal, frame)?;
                frame.write("return made;");
                Ok(())
            }
            _ => {
                let value = self.value(expression, frame)?;
                frame.write(&format!("return {};", value.text));
                Ok(())
            }
        }
    }

    /// Whether a choice has more than an expression on a side.
    fn is_long(&self, choice: &syn::ExprIf) -> bool {
        let long = |block: &syn::Block| !matches!(&block.stmts[..], [syn::Stmt::Expr(inner, None)] if is_short(inner));
        long(&choice.then_branch)
            || choice.else_branch.as_ref().is_some_and(|(_, other)| match &**other {
                syn::Expr::Block(block) => long(&block.block),
                syn::Expr::If(other) => self.is_long(other),
                _ => false,
            })
    }

    fn local(&mut self, local: &syn::Local, frame: &mut Frame) -> Result<(), Untranslated> {
        let Some(init) = &local.init else { return Err("a name without a value".to_owned()) };
        if init.diverge.is_some() {
            return Err("a pattern that may not fit".to_owned());
        }
        if let syn::Pat::Wild(_) = &local.pat {
            // A name alone is said not to be used; a result is not looked at.
            return if matches!(*init.expr, syn::Expr::Path(_)) { Ok(()) } else { self.statement(&init.expr, frame) };
        }
        if let syn::Pat::Tuple(names) = &local.pat {
            let syn::Expr::Tuple(values) = &*init.expr else {
                return Err("a tuple that is not written out".to_owned());
            };
            return names
                .elems
                .iter()
                .zip(&values.elems)
                .try_for_each(|(name, value)| self.named_local(name, value, frame));
        }
        self.named_local(&local.pat, &init.expr, frame)
    }

    fn named_local(&mut self, pattern: &syn::Pat, value: &syn::Expr, frame: &mut Frame) -> Result<(), Untranslated> {
        let (pattern, stated) = match pattern {
            syn::Pat::Type(typed) => (&*typed.pat, Some(self.ty_in(&typed.ty, frame)?)),
            other => (other, None),
        };
        let syn::Pat::Ident(ident) = pattern else { return Err("a pattern as name".to_owned()) };
        let (name, changed) = (ident.ident.to_string(), ident.mutability.is_some());
        let ty = match stated {
            Some(ty) => ty,
            None => self.type_of(value, frame)?,
        };
        match (&ty, value) {
            (Type::Array(..), _) | (_, syn::Expr::Struct(_)) => {
                let declared = self.declared(&ty, &name, false)?;
                frame.write(&format!("{declared};"));
                frame.declare(&name, ty.clone())?;
                frame.used.insert(name.clone());
                self.assign(&name, &ty, value, frame)
            }
            _ => {
                let text = self.value(value, frame)?.text;
                let declared = self.declared(&ty, &name, false)?;
                // A pointer's own value does not change: what it refers to may.
                let declared = match (&ty, changed) {
                    (_, true) => declared,
                    (Type::Pointer(..) | Type::Slice(..), false) => match declared.rsplit_once('*') {
                        Some((before, after)) => format!("{before}*const {after}"),
                        None => declared,
                    },
                    (_, false) => format!("const {declared}"),
                };
                let refers = matches!(value, syn::Expr::Reference(_)) && !matches!(ty.inner(), Type::Array(..));
                let mark = if refers { "&" } else { "" };
                frame.write(&format!("{declared} = {mark}{text};"));
                frame.declare(&name, ty)
            }
        }
    }

    /// The type of a value that a name is given.
    fn type_of(&mut self, value: &syn::Expr, frame: &mut Frame) -> Result<Type, Untranslated> {
        match value {
            syn::Expr::Repeat(repeat) => {
                let element = self.type_of(&repeat.expr, frame)?;
                use quote::ToTokens;
                let size = self.size_named(&repeat.len.to_token_stream().to_string(), frame)?;
                Ok(Type::Array(Box::new(element), size))
            }
            syn::Expr::Array(array) => {
                let Some(first) = array.elems.first() else { return Err("an array of nothing".to_owned()) };
                Ok(Type::Array(Box::new(self.type_of(first, frame)?), array.elems.len().to_string()))
            }
            syn::Expr::Reference(reference) => {
                let inner = self.value(&reference.expr, frame)?.ty;
                Ok(Type::Pointer(Box::new(inner), reference.mutability.is_some()))
            }
            syn::Expr::Struct(literal) => {
                let Some(name) = literal.path.get_ident() else { return Err("a structure of no name".to_owned()) };
                self.ty_in(&syn::parse_quote!(#name), frame)
            }
            _ => Ok(match self.value(value, frame)?.ty {
                Type::Literal | Type::Size => Type::Whole("size_t"),
                ty => ty,
            }),
        }
    }

    /// Gives a place a value, entry by entry where it is an array.
    fn assign(&mut self, place: &str, ty: &Type, value: &syn::Expr, frame: &mut Frame) -> Result<(), Untranslated> {
        match (ty.inner(), value) {
            (Type::Array(element, size), syn::Expr::Repeat(repeat)) => {
                let index = frame.counter();
                frame.write(&entries(&index, size));
                frame.depth += 1;
                self.assign(&format!("{place}[{index}]"), element, &repeat.expr, frame)?;
                frame.depth -= 1;
                frame.write("}");
                Ok(())
            }
            (Type::Array(element, _), syn::Expr::Array(array)) => array
                .elems
                .iter()
                .enumerate()
                .try_for_each(|(index, value)| self.assign(&format!("{place}[{index}]"), element, value, frame)),
            (Type::Array(..), _) => {
                let from = self.value(value, frame)?.text;
                copy(place, &from, ty.inner(), frame);
                Ok(())
            }
            (_, syn::Expr::Struct(literal)) => self.fields(place, literal, frame),
            _ => {
                let text = self.value(value, frame)?.text;
                frame.write(&format!("{place} = {text};"));
                Ok(())
            }
        }
    }

    /// Gives the fields of a structure their values.
    fn fields(&mut self, place: &str, literal: &syn::ExprStruct, frame: &mut Frame) -> Result<(), Untranslated> {
        let ty = match literal.path.get_ident() {
            Some(name) => self.ty_in(&syn::parse_quote!(#name), frame)?,
            None => return Err("a structure of no name".to_owned()),
        };
        let Type::Structure(owner, sizes) = ty else { return Err("a structure of no name".to_owned()) };
        let library = self.library;
        let item = library.structure(&owner)?;
        let environment = library::bound(&item.generics, &sizes);
        if literal.rest.is_some() {
            return Err("a structure from another".to_owned());
        }
        for field in &literal.fields {
            let syn::Member::Named(name) = &field.member else { return Err("a field without a name".to_owned()) };
            let found = item.fields.iter().find(|own| own.ident.as_ref() == Some(name));
            let ty = self.ty(&found.ok_or_else(|| format!("no field {name}"))?.ty, &environment)?;
            self.assign(&format!("{place}.{name}"), &ty, &field.expr, frame)?;
        }
        Ok(())
    }

    fn statement(&mut self, expression: &syn::Expr, frame: &mut Frame) -> Result<(), Untranslated> {
        match expression {
            syn::Expr::Assign(assign) => {
                if let (syn::Expr::Tuple(places), syn::Expr::Tuple(values)) = (&*assign.left, &*assign.right) {
                    // Only numbers that do not depend on each other are given at once.
                    return places.elems.iter().zip(&values.elems).try_for_each(|(place, value)| {
                        let place = self.value(place, frame)?;
                        self.assign(&place.text, &place.ty, value, frame)
                    });
                }
                let place = self.value(&assign.left, frame)?;
                self.assign(&place.text, &place.ty, &assign.right, frame)
            }
            syn::Expr::Binary(binary) => {
                let place = self.value(&binary.left, frame)?;
                let value = self.value(&binary.right, frame)?;
                if matches!(place.ty, Type::Structure(..)) {
                    let text = place.text.clone();
                    let whole = self.operated(&binary.op, place, value)?;
                    frame.write(&format!("{text} = {};", whole.text));
                    return Ok(());
                }
                let value = value.beside(&place.ty);
                let sign = match binary.op {
                    // The value is looked at whatever the place holds.
                    syn::BinOp::BitOrAssign(_) if place.ty == Type::Bool => {
                        frame.write(&format!("{0} = {1} || {0};", place.text, value.within(UNARY)));
                        return Ok(());
                    }
                    syn::BinOp::AddAssign(_) => "+=",
                    syn::BinOp::SubAssign(_) => "-=",
                    syn::BinOp::MulAssign(_) => "*=",
                    syn::BinOp::DivAssign(_) => "/=",
                    _ => return Err("an expression that does nothing".to_owned()),
                };
                frame.write(&format!("{} {sign} {};", place.text, value.text));
                Ok(())
            }
            syn::Expr::If(choice) => self.branches(choice, frame, false),
            syn::Expr::ForLoop(over) => self.for_loop(over, frame),
            syn::Expr::While(over) => {
                let condition = self.value(&over.cond, frame)?.text;
                frame.write(&format!("while ({condition}) {{"));
                self.inner(&over.body, frame, false)?;
                frame.write("}");
                Ok(())
            }
            syn::Expr::Block(block) => {
                frame.write("{");
                self.inner(&block.block, frame, false)?;
                frame.write("}");
                Ok(())
            }
            syn::Expr::Return(back) => match &back.expr {
                None => {
                    frame.write("return;");
                    Ok(())
                }
                Some(value) => self.result(value, frame),
            },
            syn::Expr::Break(_) => {
                frame.write("break;");
                Ok(())
            }
            syn::Expr::Continue(_) => {
                frame.write("continue;");
                Ok(())
            }
            syn::Expr::Try(tried) => {
                let value = self.value(&tried.expr, frame)?;
                let Type::Status(fault) = &value.ty else { return Err("a question to no status".to_owned()) };
                let (name, ok) = (self.enumeration(fault)?, (self.target.variant)(fault, "Ok"));
                let status = frame.counter().replace('i', "status");
                frame.write(&format!("const {name} {status} = {};", value.text));
                frame.write(&format!("if ({status} != {ok}) {{"));
                frame.depth += 1;
                frame.write(&format!("return {status};"));
                frame.depth -= 1;
                frame.write("}");
                Ok(())
            }
            syn::Expr::MethodCall(call) if call.method == "swap" => self.swap(call, frame),
            syn::Expr::MethodCall(_) | syn::Expr::Call(_) => {
                let value = self.value(expression, frame)?;
                let unused = if value.ty == Type::Unit { "" } else { "(void)" };
                frame.write(&format!("{unused}{};", value.text));
                Ok(())
            }
            _ => Err("a statement beyond the subset".to_owned()),
        }
    }

    /// Exchanges two entries of an array.
    fn swap(&mut self, call: &syn::ExprMethodCall, frame: &mut Frame) -> Result<(), Untranslated> {
        let array = self.value(&call.receiver, frame)?;
        let mut element = array.ty.element()?;
        let mut places = Vec::new();
        for index in &call.args {
            places.push(format!("{}[{}]", array.text, self.value(index, frame)?.text));
        }
        let mut loops = 0;
        while let Type::Array(inner, size) = element {
            let index = frame.counter();
            frame.write(&entries(&index, size));
            frame.depth += 1;
            places.iter_mut().for_each(|place| place.push_str(&format!("[{index}]")));
            (element, loops) = (inner, loops + 1);
        }
        let [one, other] = &places[..] else { return Err("an exchange of two entries".to_owned()) };
        let (kind, held) = (self.named(element)?, frame.counter().replace('i', "held"));
        frame.write(&format!("const {kind} {held} = {one};"));
        frame.write(&format!("{one} = {other};"));
        frame.write(&format!("{other} = {held};"));
        for _ in 0..loops {
            frame.depth -= 1;
            frame.write("}");
        }
        Ok(())
    }

    fn branches(&mut self, choice: &syn::ExprIf, frame: &mut Frame, last: bool) -> Result<(), Untranslated> {
        let condition = self.value(&choice.cond, frame)?.text;
        frame.write(&format!("if ({condition}) {{"));
        self.inner(&choice.then_branch, frame, last)?;
        let mut other = choice.else_branch.as_ref().map(|(_, other)| &**other);
        while let Some(expression) = other {
            match expression {
                syn::Expr::If(next) => {
                    let condition = self.value(&next.cond, frame)?.text;
                    frame.write(&format!("}} else if ({condition}) {{"));
                    self.inner(&next.then_branch, frame, last)?;
                    other = next.else_branch.as_ref().map(|(_, other)| &**other);
                }
                syn::Expr::Block(block) => {
                    frame.write("} else {");
                    self.inner(&block.block, frame, last)?;
                    other = None;
                }
                _ => return Err("a branch beyond the subset".to_owned()),
            }
        }
        if choice.else_branch.as_ref().is_some_and(|(_, other)| has_no_last(other)) {
            frame.write("} else {");
            frame.depth += 1;
            frame.write("/* Nothing else. */");
            frame.depth -= 1;
        }
        frame.write("}");
        Ok(())
    }

    /// A loop over a range, upwards, downwards, or in steps.
    fn for_loop(&mut self, over: &syn::ExprForLoop, frame: &mut Frame) -> Result<(), Untranslated> {
        let name = match &*over.pat {
            syn::Pat::Ident(name) => name.ident.to_string(),
            _ => frame.counter(),
        };
        let (range, down, step) = match &*over.expr {
            syn::Expr::MethodCall(call) if call.method == "rev" => (&*call.receiver, true, None),
            syn::Expr::MethodCall(call) if call.method == "step_by" => (&*call.receiver, false, call.args.first()),
            other => (other, false, None),
        };
        let range = match range {
            syn::Expr::Paren(inner) => &*inner.expr,
            other => other,
        };
        let syn::Expr::Range(syn::ExprRange { start: Some(start), end: Some(end), limits, .. }) = range else {
            return Err("a loop over no range".to_owned());
        };
        let (start, end) = (self.value(start, frame)?, self.value(end, frame)?);
        let ty = match (&start.ty, &end.ty) {
            (Type::Literal | Type::Size, Type::Literal | Type::Size) => Type::Whole("size_t"),
            (Type::Literal | Type::Size, other) | (other, _) => other.clone(),
        };
        let kind = self.named(&ty)?;
        let (start, end) = (start.text, end.beside(&ty).within(ADDITION));
        let relation = if matches!(limits, syn::RangeLimits::Closed(_)) { "<=" } else { "<" };
        let forward = match step {
            Some(step) => format!("{name} += {}", self.value(step, frame)?.beside(&ty).text),
            None => format!("++{name}"),
        };
        frame.scopes.push(HashMap::new());
        frame.declare(&name, ty)?;
        if down {
            if start != "0" {
                return Err("a loop downwards to more than zero".to_owned());
            }
            // The loop itself counts upwards: a counter without a sign cannot fall below zero.
            let passed = frame.counter();
            frame.write(&format!("for ({kind} {passed} = 0; {passed} < {end}; ++{passed}) {{"));
            frame.depth += 1;
            frame.write(&format!("const {kind} {name} = {end} - 1u - {passed};"));
            frame.depth -= 1;
        } else {
            frame.write(&format!("for ({kind} {name} = {start}; {name} {relation} {end}; {forward}) {{"));
        }
        self.inner(&over.body, frame, false)?;
        frame.scopes.pop();
        frame.write("}");
        Ok(())
    }
}

/// Whether a chain of choices ends with a condition.
fn has_no_last(expression: &syn::Expr) -> bool {
    match expression {
        syn::Expr::If(choice) => choice.else_branch.as_ref().is_none_or(|(_, other)| has_no_last(other)),
        _ => false,
    }
}

/// Whether an expression is one in C too.
fn is_short(expression: &syn::Expr) -> bool {
    match expression {
        syn::Expr::Struct(_) | syn::Expr::Return(_) | syn::Expr::Assign(_) => false,
        syn::Expr::If(choice) => {
            let short =
                |block: &syn::Block| matches!(&block.stmts[..], [syn::Stmt::Expr(inner, None)] if is_short(inner));
            short(&choice.then_branch)
                && choice.else_branch.as_ref().is_some_and(|(_, other)| match &**other {
                    syn::Expr::Block(block) => short(&block.block),
                    other => is_short(other),
                })
        }
        _ => true,
    }
}

/// Copies an array entry by entry.
fn copy(place: &str, from: &str, ty: &Type, frame: &mut Frame) {
    let Type::Array(element, size) = ty else {
        frame.write(&format!("{place} = {from};"));
        return;
    };
    let index = frame.counter();
    frame.write(&entries(&index, size));
    frame.depth += 1;
    copy(&format!("{place}[{index}]"), &format!("{from}[{index}]"), element, frame);
    frame.depth -= 1;
    frame.write("}");
}

/// The head of a loop over the entries of an array.
fn entries(index: &str, size: &str) -> String {
    format!("for (size_t {index} = 0; {index} < {}; ++{index}) {{", unsigned(size))
}
