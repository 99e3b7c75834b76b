//! Types of the subset as they are spelled, in the source and in C.

use std::collections::HashMap;

use super::frame::Frame;
use super::library::{self, Untranslated};
use super::translator::Translator;
use super::types::Type;

impl Translator<'_> {
    /// A type of a structure's field.
    pub(super) fn ty(&self, ty: &syn::Type, environment: &HashMap<String, String>) -> Result<Type, Untranslated> {
        self.ty_in(ty, &Frame::new(String::new(), environment.clone(), None))
    }

    /// A type within a function.
    pub(super) fn ty_in(&self, ty: &syn::Type, frame: &Frame) -> Result<Type, Untranslated> {
        match ty {
            syn::Type::Array(array) => {
                let element = self.ty_in(&array.elem, frame)?;
                Ok(Type::Array(Box::new(element), self.size(&array.len, frame)?))
            }
            syn::Type::Reference(reference) => {
                let changed = reference.mutability.is_some();
                if let syn::Type::Slice(slice) = &*reference.elem {
                    return Ok(Type::Slice(Box::new(self.ty_in(&slice.elem, frame)?), changed));
                }
                match self.ty_in(&reference.elem, frame)? {
                    Type::Model => Ok(Type::Model),
                    inner => Ok(Type::Pointer(Box::new(inner), changed)),
                }
            }
            syn::Type::Path(path) => {
                let Some(segment) = path.path.segments.last() else { return Err("a type without a name".to_owned()) };
                self.named_type(segment, frame)
            }
            syn::Type::Tuple(tuple) if tuple.elems.is_empty() => Ok(Type::Unit),
            _ => Err("a type beyond the subset".to_owned()),
        }
    }

    fn named_type(&self, segment: &syn::PathSegment, frame: &Frame) -> Result<Type, Untranslated> {
        let name = segment.ident.to_string();
        Ok(match name.as_str() {
            "T" => Type::Real,
            "f64" => Type::Double,
            "usize" => Type::Whole("size_t"),
            "u32" => Type::Whole("uint32_t"),
            "u16" => Type::Whole("uint16_t"),
            "i32" => Type::Whole("int"),
            "bool" => Type::Bool,
            "Self" => frame.own.clone().ok_or("Self without a structure")?,
            "Result" => {
                let fault = library::arguments(segment).pop().ok_or("a result without a fault")?;
                Type::Status(fault)
            }
            _ if frame.models.contains(&name) => Type::Model,
            _ if self.library.is_enumeration(&name) => Type::Enumeration(name),
            _ => {
                self.library.structure(&name)?;
                let sizes = library::arguments(segment);
                let sizes: Result<Vec<String>, _> = sizes.iter().map(|size| self.size_named(size, frame)).collect();
                Type::Structure(name, sizes?)
            }
        })
    }

    fn size(&self, length: &syn::Expr, frame: &Frame) -> Result<String, Untranslated> {
        use quote::ToTokens;
        self.size_named(&length.to_token_stream().to_string(), frame)
    }

    /// A size by its name: that of the structure, that of the model, or a number.
    pub(super) fn size_named(&self, name: &str, frame: &Frame) -> Result<String, Untranslated> {
        let known = frame.environment.get(name).or_else(|| self.target.sizes.get(name)).cloned();
        let number = || name.parse::<usize>().ok().map(|number| number.to_string());
        known.or_else(number).ok_or_else(|| format!("no size {name}"))
    }

    /// The name of a type that is not an array.
    pub(super) fn named(&mut self, ty: &Type) -> Result<String, Untranslated> {
        Ok(match ty {
            Type::Real => self.target.scalar.name().to_owned(),
            Type::Double => "double".to_owned(),
            Type::Whole(name) => (*name).to_owned(),
            Type::Literal | Type::Size => "size_t".to_owned(),
            Type::Bool => "bool".to_owned(),
            Type::Unit => "void".to_owned(),
            Type::Structure(name, sizes) => self.structure(name, sizes)?,
            Type::Enumeration(name) | Type::Status(name) => self.enumeration(name)?,
            other => return Err(format!("no name of {other:?}")),
        })
    }

    /// A declaration; what `parameter`s do not change is constant.
    pub(super) fn declared(&mut self, ty: &Type, name: &str, parameter: bool) -> Result<String, Untranslated> {
        match ty {
            Type::Array(element, size) => self.declared(element, &format!("{name}[{size}]"), parameter),
            // C does not convert arrays of arrays to constant ones.
            Type::Slice(element, _) if matches!(**element, Type::Array(..)) => {
                self.declared(element, &format!("(*{name})"), false)
            }
            Type::Slice(element, changed) => {
                let constant = if *changed { "" } else { "const " };
                Ok(format!("{constant}{} *{name}", self.named(element)?))
            }
            Type::Pointer(inner, changed) => match &**inner {
                Type::Array(element, _) => {
                    let constant = if *changed || matches!(**element, Type::Array(..)) { "" } else { "const " };
                    let own = match parameter {
                        true => self.declared(inner, name, true)?,
                        false => match &**element {
                            Type::Array(..) => self.declared(element, &format!("(*{name})"), false)?,
                            _ => format!("{} *{name}", self.named(element)?),
                        },
                    };
                    Ok(format!("{constant}{own}"))
                }
                inner => {
                    let constant = if *changed { "" } else { "const " };
                    Ok(format!("{constant}{} *{name}", self.named(inner)?))
                }
            },
            other => Ok(format!("{} {name}", self.named(other)?)),
        }
    }
}
