//! Expressions of the subset in C.
//!
//! Invariant: operators bind in the text as they do in the source; what is constant is computed here, in double precision, and rounded once.

use super::super::super::number::digits;
use super::frame::Frame;
use super::library::{self, Untranslated};
use super::translator::{Callee, Translator};
use super::types::Type;

/// How tightly operators bind in C.
const POSTFIX: u8 = 15;
pub(super) const UNARY: u8 = 14;
pub(super) const ADDITION: u8 = 12;
const RELATION: u8 = 10;
const EQUALITY: u8 = 9;
const CHOICE: u8 = 3;

/// An expression in C with its type.
pub(super) struct Value {
    pub(super) text: String,
    binding: u8,
    pub(super) ty: Type,
}

impl Value {
    fn new(text: impl Into<String>, binding: u8, ty: Type) -> Self {
        Self { text: text.into(), binding, ty }
    }

    /// The value as an operand whose neighbour is of a type: C takes what is written out as a number with a sign, and mixes none with those
    /// without.
    pub(super) fn beside(self, neighbour: &Type) -> Self {
        match (&self.ty, neighbour) {
            (Type::Literal, Type::Whole("int")) => Self { ty: neighbour.clone(), ..self },
            (Type::Literal, Type::Whole(_)) => Self { text: unsigned(&self.text), ty: neighbour.clone(), ..self },
            (Type::Literal, Type::Size) => self.beside(&Type::Whole("size_t")),
            (Type::Size, _) => Self::new(unsigned(&self.text), UNARY, Type::Whole("size_t")),
            _ => self,
        }
    }

    /// The text where an operator binds that tightly.
    pub(super) fn within(&self, binding: u8) -> String {
        if self.binding < binding { format!("({})", self.text) } else { self.text.clone() }
    }
}

impl Translator<'_> {
    pub(super) fn value(&mut self, expression: &syn::Expr, frame: &mut Frame) -> Result<Value, Untranslated> {
        match expression {
            syn::Expr::Lit(literal) => match &literal.lit {
                syn::Lit::Int(number) => Ok(Value::new(number.base10_digits(), POSTFIX, Type::Literal)),
                syn::Lit::Bool(truth) => {
                    Ok(Value::new(if truth.value { "true" } else { "false" }, POSTFIX, Type::Bool))
                }
                syn::Lit::Float(_) => self.double(expression, frame),
                _ => Err("a literal beyond the subset".to_owned()),
            },
            syn::Expr::Paren(inner) => self.value(&inner.expr, frame),
            syn::Expr::Group(inner) => self.value(&inner.expr, frame),
            syn::Expr::Path(path) => self.path(&path.path, frame),
            syn::Expr::Unary(_) | syn::Expr::Binary(_) if self.constant(expression, frame).is_some() => {
                self.double(expression, frame)
            }
            syn::Expr::Unary(unary) => self.unary(unary, frame),
            syn::Expr::Binary(binary) => self.binary(binary, frame),
            syn::Expr::Cast(cast) => {
                let ty = self.ty_in(&cast.ty, frame)?;
                self.cast(&cast.expr, ty, frame)
            }
            syn::Expr::Field(field) => self.field(field, frame),
            syn::Expr::Index(index) => {
                let base = self.value(&index.expr, frame)?;
                let at = self.value(&index.index, frame)?;
                let element = base.ty.element()?.clone();
                Ok(Value::new(format!("{}[{}]", base.within(POSTFIX), at.text), POSTFIX, element))
            }
            syn::Expr::MethodCall(call) => self.method_call(call, frame),
            syn::Expr::Call(call) => self.call(call, frame),
            syn::Expr::If(choice) => self.choice(choice, frame),
            syn::Expr::Reference(reference) => self.value(&reference.expr, frame),
            syn::Expr::Struct(_) => self.fault(expression, frame),
            _ => Err("an expression beyond the subset".to_owned()),
        }
    }

    /// The value of a constant expression of double precision.
    fn constant(&self, expression: &syn::Expr, frame: &Frame) -> Option<f64> {
        match expression {
            syn::Expr::Lit(literal) => match &literal.lit {
                syn::Lit::Float(number) => number.base10_parse().ok(),
                _ => None,
            },
            syn::Expr::Paren(inner) => self.constant(&inner.expr, frame),
            syn::Expr::Unary(unary) => match unary.op {
                syn::UnOp::Neg(_) => self.constant(&unary.expr, frame).map(|value| -value),
                _ => None,
            },
            syn::Expr::Binary(binary) => {
                let (left, right) = (self.constant(&binary.left, frame)?, self.constant(&binary.right, frame)?);
                match binary.op {
                    syn::BinOp::Add(_) => Some(left + right),
                    syn::BinOp::Sub(_) => Some(left - right),
                    syn::BinOp::Mul(_) => Some(left * right),
                    syn::BinOp::Div(_) => Some(left / right),
                    _ => None,
                }
            }
            syn::Expr::Path(path) => {
                let name = path.path.segments.last()?.ident.to_string();
                if path.path.segments.len() > 1 {
                    return (name == "PI").then_some(std::f64::consts::PI);
                }
                let item = self.library.constant(&frame.file, &name)?;
                self.constant(&item.expr, frame)
            }
            _ => None,
        }
    }

    /// An expression of double precision, as one number where it is constant.
    fn double(&mut self, expression: &syn::Expr, frame: &mut Frame) -> Result<Value, Untranslated> {
        match self.constant(expression, frame) {
            Some(value) if value < 0.0 => Ok(Value::new(digits(value), UNARY, Type::Double)),
            Some(value) => Ok(Value::new(digits(value), POSTFIX, Type::Double)),
            None => Err("a number of double precision that is not constant".to_owned()),
        }
    }

    fn real(&self, value: f64) -> Value {
        let binding = if value < 0.0 { UNARY } else { POSTFIX };
        Value::new(self.target.scalar.literal(value), binding, Type::Real)
    }

    fn path(&mut self, path: &syn::Path, frame: &mut Frame) -> Result<Value, Untranslated> {
        let names: Vec<String> = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        match names[..] {
            [name] => {
                if let Some(ty) = frame.local(name) {
                    return Ok(Value::new(name, POSTFIX, ty));
                }
                if let Ok(size) = self.size_named(name, frame) {
                    return Ok(Value::new(size, POSTFIX, Type::Size));
                }
                let library = self.library;
                let item = library.constant(&frame.file, name).ok_or_else(|| format!("an unknown name {name}"))?;
                match self.ty_in(&item.ty, frame)? {
                    Type::Double => self.double(&item.expr, frame),
                    _ => self.value(&item.expr, frame),
                }
            }
            ["T", name] => match name {
                "ZERO" => Ok(self.real(0.0)),
                "ONE" => Ok(self.real(1.0)),
                "PI" => Ok(self.real(std::f64::consts::PI)),
                "EPSILON" => Ok(Value::new(self.target.scalar.epsilon(), POSTFIX, Type::Real)),
                _ => Err(format!("an unknown T::{name}")),
            },
            [model, name] if frame.models.contains(model) => {
                let whole = |name: &'static str| Type::Whole(name);
                let ty = match name {
                    "COORDINATES" => Type::Array(Box::new(whole("size_t")), String::new()),
                    "ORDERS" => Type::Array(Box::new(whole("uint32_t")), String::new()),
                    _ => Type::Size,
                };
                Ok(Value::new((self.target.model)(name), POSTFIX, ty))
            }
            [owner, name] if self.library.is_enumeration(owner) => {
                self.enumeration(owner)?;
                Ok(Value::new((self.target.variant)(owner, name), POSTFIX, Type::Enumeration(owner.to_owned())))
            }
            _ => match self.constant(&syn::parse_quote!(#path), frame) {
                Some(value) => Ok(Value::new(digits(value), POSTFIX, Type::Double)),
                None => Err(format!("an unknown name {}", names.join("::"))),
            },
        }
    }

    fn unary(&mut self, unary: &syn::ExprUnary, frame: &mut Frame) -> Result<Value, Untranslated> {
        let inner = self.value(&unary.expr, frame)?;
        match unary.op {
            syn::UnOp::Neg(_) => match &inner.ty {
                Type::Structure(name, sizes) => {
                    let (name, sizes) = (name.clone(), sizes.clone());
                    let callee = self.resolved(Some((&name, &sizes)), "neg", "")?;
                    Ok(Value::new(format!("{}({})", callee.name, inner.text), POSTFIX, callee.result))
                }
                _ => Ok(Value::new(format!("-{}", inner.within(UNARY)), UNARY, inner.ty)),
            },
            syn::UnOp::Not(_) => Ok(Value::new(format!("!{}", inner.within(UNARY)), UNARY, Type::Bool)),
            _ => match inner.ty.clone() {
                Type::Pointer(of, _) if matches!(*of, Type::Array(..)) => Ok(Value { ty: *of, ..inner }),
                Type::Pointer(of, _) => Ok(Value::new(format!("*{}", inner.within(UNARY)), UNARY, *of)),
                _ => Ok(inner),
            },
        }
    }

    fn binary(&mut self, binary: &syn::ExprBinary, frame: &mut Frame) -> Result<Value, Untranslated> {
        let (left, right) = (self.value(&binary.left, frame)?, self.value(&binary.right, frame)?);
        self.operated(&binary.op, left, right)
    }

    /// Two values with an operator between them.
    pub(super) fn operated(&mut self, op: &syn::BinOp, left: Value, right: Value) -> Result<Value, Untranslated> {
        let (of_left, of_right) = (left.ty.clone(), right.ty.clone());
        let (left, right) = (left.beside(&of_right), right.beside(&of_left));
        if let Type::Structure(name, sizes) = left.ty.inner().clone() {
            let method = match op {
                syn::BinOp::Add(_) | syn::BinOp::AddAssign(_) => "add",
                syn::BinOp::Sub(_) | syn::BinOp::SubAssign(_) => "sub",
                syn::BinOp::Mul(_) | syn::BinOp::MulAssign(_) => "mul",
                _ => return Err(format!("an operator of {name}")),
            };
            let callee = self.resolved(Some((&name, &sizes)), method, "")?;
            return Ok(Value::new(format!("{}({}, {})", callee.name, left.text, right.text), POSTFIX, callee.result));
        }
        let (sign, binding) = match op {
            syn::BinOp::Mul(_) => ("*", 13),
            syn::BinOp::Div(_) => ("/", 13),
            syn::BinOp::Rem(_) => ("%", 13),
            syn::BinOp::Add(_) => ("+", ADDITION),
            syn::BinOp::Sub(_) => ("-", ADDITION),
            syn::BinOp::Lt(_) => ("<", RELATION),
            syn::BinOp::Le(_) => ("<=", RELATION),
            syn::BinOp::Gt(_) => (">", RELATION),
            syn::BinOp::Ge(_) => (">=", RELATION),
            syn::BinOp::Eq(_) => ("==", EQUALITY),
            syn::BinOp::Ne(_) => ("!=", EQUALITY),
            syn::BinOp::And(_) => ("&&", 5),
            syn::BinOp::Or(_) => ("||", 4),
            _ => return Err("an operator beyond the subset".to_owned()),
        };
        // Compilers warn where these two stand side by side without parentheses.
        let inner = match binding {
            4 => 6,
            EQUALITY => RELATION + 1,
            _ => binding,
        };
        let ty = if binding <= RELATION { Type::Bool } else { left.ty.clone() };
        let text = format!("{} {sign} {}", left.within(inner), right.within(inner + 1));
        Ok(Value::new(text, binding, ty))
    }

    fn cast(&mut self, inner: &syn::Expr, ty: Type, frame: &mut Frame) -> Result<Value, Untranslated> {
        let inner = self.value(inner, frame)?;
        if inner.ty == ty {
            return Ok(inner);
        }
        is_simple(&inner)?;
        let name = self.named(&ty)?;
        Ok(Value::new(format!("({name}){}", inner.within(UNARY)), UNARY, ty))
    }

    fn field(&mut self, field: &syn::ExprField, frame: &mut Frame) -> Result<Value, Untranslated> {
        let base = self.value(&field.base, frame)?;
        let syn::Member::Named(name) = &field.member else { return Err("a field without a name".to_owned()) };
        let Type::Structure(owner, sizes) = base.ty.inner() else {
            return Err(format!("a field {name} of no structure"));
        };
        let item = self.library.structure(owner)?;
        let environment = library::bound(&item.generics, sizes);
        let found = item.fields.iter().find(|field| field.ident.as_ref() == Some(name));
        let ty = self.ty(&found.ok_or_else(|| format!("no field {name}"))?.ty, &environment)?;
        let arrow = if matches!(base.ty, Type::Pointer(..)) { "->" } else { "." };
        Ok(Value::new(format!("{}{arrow}{name}", base.within(POSTFIX)), POSTFIX, ty))
    }

    fn choice(&mut self, choice: &syn::ExprIf, frame: &mut Frame) -> Result<Value, Untranslated> {
        let condition = self.value(&choice.cond, frame)?;
        let [syn::Stmt::Expr(yes, None)] = &choice.then_branch.stmts[..] else {
            return Err("a choice of more than expressions".to_owned());
        };
        let Some((_, no)) = &choice.else_branch else { return Err("a choice without an alternative".to_owned()) };
        let no = match &**no {
            syn::Expr::Block(block) => match &block.block.stmts[..] {
                [syn::Stmt::Expr(no, None)] => no,
                _ => return Err("a choice of more than expressions".to_owned()),
            },
            other => other,
        };
        let (yes, no) = (self.value(yes, frame)?, self.value(no, frame)?);
        let (of_yes, of_no) = match (&yes.ty, &no.ty) {
            (Type::Literal, Type::Literal) => (Type::Size, Type::Size),
            (of_yes, of_no) => (of_yes.clone(), of_no.clone()),
        };
        let (yes, no) = (yes.beside(&of_no), no.beside(&of_yes));
        let text = format!("{} ? {} : {}", condition.within(CHOICE + 1), yes.within(CHOICE + 1), no.within(CHOICE));
        Ok(Value::new(text, CHOICE, yes.ty))
    }

    fn method_call(&mut self, call: &syn::ExprMethodCall, frame: &mut Frame) -> Result<Value, Untranslated> {
        let (base, name) = (self.value(&call.receiver, frame)?, call.method.to_string());
        match base.ty.inner().clone() {
            Type::Model => {
                let mut list = self.arguments(call.args.iter(), None, frame)?;
                list.extend(self.target.constants.as_ref().map(|_| "constants".to_owned()));
                Ok(Value::new(format!("{}({})", (self.target.model)(&name), list.join(", ")), POSTFIX, Type::Unit))
            }
            Type::Structure(owner, sizes) => {
                let callee = self.resolved(Some((&owner, &sizes)), &name, "")?;
                let mut list = match callee.parameters.first() {
                    Some((_, Type::Pointer(..))) => vec![reference(&base)],
                    _ => vec![base.text],
                };
                list.extend(self.arguments(call.args.iter(), Some(&callee.parameters[1..]), frame)?);
                Ok(Value::new(format!("{}({})", callee.name, list.join(", ")), POSTFIX, callee.result))
            }
            Type::Slice(..) if name == "len" => {
                Ok(Value::new(format!("{}_length", base.text), POSTFIX, Type::Whole("size_t")))
            }
            Type::Array(_, size) if name == "len" => Ok(Value::new(size, POSTFIX, Type::Size)),
            Type::Status(fault) if name == "is_ok" => {
                let text = format!("{} == {}", base.within(EQUALITY + 1), (self.target.variant)(&fault, "Ok"));
                Ok(Value::new(text, EQUALITY, Type::Bool))
            }
            Type::Real => self.of_real(&base, &name, call, frame),
            ty if ty.is_whole() => self.of_whole(&base, &name, call, frame),
            other => Err(format!("a method {name} of {other:?}")),
        }
    }

    /// A function of the scalar.
    fn of_real(
        &mut self,
        base: &Value,
        name: &str,
        call: &syn::ExprMethodCall,
        frame: &mut Frame,
    ) -> Result<Value, Untranslated> {
        let scalar = self.target.scalar;
        if name == "is_finite" {
            let text = format!("{}({}) <= {}", scalar.function("fabs"), base.text, scalar.max());
            return Ok(Value::new(text, RELATION, Type::Bool));
        }
        let function = match name {
            "abs" => "fabs",
            "ln" => "log",
            "max" => "fmax",
            "min" => "fmin",
            "sqrt" | "sin" | "cos" => name,
            _ => return Err(format!("a function {name} of the scalar")),
        };
        let mut list = vec![base.text.clone()];
        list.extend(self.arguments(call.args.iter(), None, frame)?);
        Ok(Value::new(format!("{}({})", scalar.function(function), list.join(", ")), POSTFIX, Type::Real))
    }

    /// A function of a whole number.
    fn of_whole(
        &mut self,
        base: &Value,
        name: &str,
        call: &syn::ExprMethodCall,
        frame: &mut Frame,
    ) -> Result<Value, Untranslated> {
        let own = base.within(UNARY);
        let other = match call.args.first() {
            Some(other) => Some(self.value(other, frame)?.beside(&base.ty).within(UNARY)),
            None => None,
        };
        let zero = Value::new("0", POSTFIX, Type::Literal).beside(&base.ty).text;
        match (name, other) {
            ("is_multiple_of", Some(other)) => {
                Ok(Value::new(format!("{own} % {other} == {zero}"), EQUALITY, Type::Bool))
            }
            ("isqrt", None) => Ok(Value::new(format!("(uint32_t)sqrt((double){own})"), UNARY, base.ty.clone())),
            ("abs" | "unsigned_abs", None) => {
                Ok(Value::new(format!("{own} < {zero} ? -{own} : {own}"), CHOICE, base.ty.clone()))
            }
            ("max", Some(other)) => {
                Ok(Value::new(format!("{own} > {other} ? {own} : {other}"), CHOICE, base.ty.clone()))
            }
            ("min", Some(other)) => {
                Ok(Value::new(format!("{own} < {other} ? {own} : {other}"), CHOICE, base.ty.clone()))
            }
            ("saturating_mul", Some(other)) => {
                let text = format!("{own} > UINT32_MAX / {other} ? UINT32_MAX : {own} * {other}");
                Ok(Value::new(text, CHOICE, base.ty.clone()))
            }
            ("saturating_add", Some(other)) => {
                let text = format!("{own} > UINT32_MAX - {other} ? UINT32_MAX : {own} + {other}");
                Ok(Value::new(text, CHOICE, base.ty.clone()))
            }
            ("saturating_sub", Some(other)) => {
                Ok(Value::new(format!("{own} > {other} ? {own} - {other} : {zero}"), CHOICE, base.ty.clone()))
            }
            _ => Err(format!("a function {name} of a whole number")),
        }
    }

    fn call(&mut self, call: &syn::ExprCall, frame: &mut Frame) -> Result<Value, Untranslated> {
        let syn::Expr::Path(path) = &*call.func else { return Err("a call of no name".to_owned()) };
        let names: Vec<String> = path.path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let first = call.args.first();
        match (&names[..], first) {
            (["T", "from_f64"], Some(argument)) => {
                if let Some(value) = self.constant(argument, frame) {
                    return Ok(self.real(value));
                }
                let inner = match argument {
                    // A whole number is rounded once either way.
                    syn::Expr::Cast(cast) => self.value(&cast.expr, frame)?,
                    syn::Expr::Call(call) => self.value(call.args.first().unwrap_or(argument), frame)?,
                    other => self.value(other, frame)?,
                };
                is_simple(&inner)?;
                let name = self.target.scalar.name();
                Ok(Value::new(format!("({name}){}", inner.within(UNARY)), UNARY, Type::Real))
            }
            (["f64", "from"], Some(argument)) => self.cast(argument, Type::Double, frame),
            (["usize", "from"], Some(argument)) => self.cast(argument, Type::Whole("size_t"), frame),
            (["u32", "from"], Some(argument)) => self.cast(argument, Type::Whole("uint32_t"), frame),
            (["Ok"], Some(syn::Expr::Tuple(_))) => {
                let fault = match &frame.result {
                    Type::Status(fault) => fault.clone(),
                    _ => "RunFault".to_owned(),
                };
                Ok(Value::new((self.target.variant)(&fault, "Ok"), POSTFIX, Type::Status(fault)))
            }
            (["Err"], Some(fault)) => self.fault(fault, frame),
            ([name], _) => {
                let file = frame.file.clone();
                let callee = self.resolved(None, name, &file)?;
                self.called(callee, call, frame)
            }
            ([owner, name], _) => {
                let (owner, sizes) = match (*owner, &frame.own) {
                    ("Self", Some(Type::Structure(owner, sizes))) => (owner.clone(), sizes.clone()),
                    (owner, Some(Type::Structure(own, sizes))) if owner == own => (own.clone(), sizes.clone()),
                    (owner, _) => (owner.to_owned(), Vec::new()),
                };
                let callee = self.resolved(Some((&owner, &sizes)), name, "")?;
                self.called(callee, call, frame)
            }
            _ => Err("a call beyond the subset".to_owned()),
        }
    }

    /// The status of a fault: what it says beside its kind has no place in a number.
    pub(super) fn fault(&mut self, fault: &syn::Expr, frame: &mut Frame) -> Result<Value, Untranslated> {
        let path = match fault {
            syn::Expr::Struct(with) => &with.path,
            syn::Expr::Path(bare) => &bare.path,
            _ => return Err("a fault that is not named".to_owned()),
        };
        self.path(path, frame)
    }

    fn called(&mut self, callee: Callee, call: &syn::ExprCall, frame: &mut Frame) -> Result<Value, Untranslated> {
        let list = self.arguments(call.args.iter(), Some(&callee.parameters), frame)?;
        Ok(Value::new(format!("{}({})", callee.name, list.join(", ")), POSTFIX, callee.result))
    }

    /// Arguments as the parameters take them.
    fn arguments<'e>(
        &mut self,
        arguments: impl Iterator<Item = &'e syn::Expr>,
        parameters: Option<&[(String, Type)]>,
        frame: &mut Frame,
    ) -> Result<Vec<String>, Untranslated> {
        let mut list = Vec::new();
        for (index, argument) in arguments.enumerate() {
            let value = self.value(argument, frame)?;
            match (parameters.and_then(|parameters| parameters.get(index)), &value.ty) {
                (Some((_, Type::Model)), _) => {
                    list.extend(self.target.constants.as_ref().map(|_| "constants".to_owned()));
                }
                (Some((_, Type::Slice(..))), Type::Slice(..)) => {
                    list.push(value.text.clone());
                    list.push(format!("{}_length", value.text));
                }
                (Some((_, Type::Slice(..))), ty) => {
                    let Type::Array(_, size) = ty.inner() else { return Err("a slice of no array".to_owned()) };
                    list.push(value.text);
                    list.push(size.clone());
                }
                (Some((_, Type::Pointer(..))), _) => list.push(reference(&value)),
                _ => list.push(value.text),
            }
        }
        Ok(list)
    }
}

/// A number that is written out, or the macro of a size, as a number without a sign.
pub(super) fn unsigned(text: &str) -> String {
    if text.bytes().all(|byte| byte.is_ascii_digit()) { format!("{text}u") } else { format!("(size_t){text}") }
}

/// What becomes another kind of number is one name or call: the result of an operator is of the operands' type in C, and a cast behind it hides
/// that nothing wider was computed.
fn is_simple(value: &Value) -> Result<(), Untranslated> {
    match value.ty.is_whole() && value.binding < UNARY {
        true => Err(format!("a conversion of {}, which has no name", value.text)),
        false => Ok(()),
    }
}

/// A reference to a value: arrays and pointers are references already.
fn reference(value: &Value) -> String {
    match value.ty {
        Type::Pointer(..) | Type::Array(..) | Type::Slice(..) => value.text.clone(),
        _ => format!("&{}", value.within(UNARY)),
    }
}
