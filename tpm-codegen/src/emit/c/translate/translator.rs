//! What is asked for, and all that it needs, in the order in which C needs it.

use std::collections::{HashMap, HashSet};

use super::super::expression::Scalar;
use super::super::layout::{doc, signature, statement as line};
use super::frame::Frame;
use super::library::{self, Library, Untranslated};
use super::types::Type;

/// What stands in C for names of the source.
pub(in crate::emit::c) struct Target<'a> {
    pub(in crate::emit::c) scalar: Scalar,
    /// The macro of every size, by the name of the constant generic.
    pub(in crate::emit::c) sizes: HashMap<&'static str, String>,
    /// The name of a structure or enumeration with these sizes, and how the names of its functions begin.
    pub(in crate::emit::c) structure: &'a dyn Fn(&str, &[String]) -> [String; 2],
    /// The name of a variant.
    pub(in crate::emit::c) variant: &'a dyn Fn(&str, &str) -> String,
    /// The name of a function, or of an array or number, that the model itself gives.
    pub(in crate::emit::c) model: &'a dyn Fn(&str) -> String,
    /// The parameter of functions that evaluate the model, and its argument; nothing where it has no constants.
    pub(in crate::emit::c) constants: Option<String>,
}

/// A translation: definitions of types, and of functions, in the order in which C needs them.
pub(in crate::emit::c) struct Translator<'a> {
    pub(super) library: &'a Library,
    pub(super) target: &'a Target<'a>,
    pub(in crate::emit::c) types: String,
    pub(in crate::emit::c) functions: String,
    pub(in crate::emit::c) done: HashSet<String>,
}

/// A function as it is called.
pub(super) struct Callee {
    pub(super) name: String,
    pub(super) parameters: Vec<(String, Type)>,
    pub(super) result: Type,
}

impl<'a> Translator<'a> {
    /// A translation behind others, whose types and functions are `done`.
    pub(in crate::emit::c) fn new(library: &'a Library, target: &'a Target<'a>, done: HashSet<String>) -> Self {
        Self { library, target, types: String::new(), functions: String::new(), done }
    }

    /// Defines a structure, and those that it holds; gives its name.
    pub(in crate::emit::c) fn structure(&mut self, name: &str, sizes: &[String]) -> Result<String, Untranslated> {
        let [c_name, _] = (self.target.structure)(name, sizes);
        if !self.done.insert(c_name.clone()) {
            return Ok(c_name);
        }
        let item = self.library.structure(name)?;
        let environment = library::bound(&item.generics, sizes);
        let mut fields = String::new();
        for field in &item.fields {
            let Some(ident) = &field.ident else { return Err(format!("{name} has fields without names")) };
            let ty = self.ty(&field.ty, &environment)?;
            if let Some(about) = library::docs(&field.attrs) {
                fields.push_str(&doc(1, &about));
            }
            fields.push_str(&line(1, &format!("{};", self.declared(&ty, &ident.to_string(), false)?)));
        }
        let about = library::docs(&item.attrs).map_or_else(String::new, |about| doc(0, &about));
        self.types.push_str(&format!("\n{about}typedef struct {c_name} {{\n{fields}}} {c_name};\n"));
        Ok(c_name)
    }

    /// Defines an enumeration; gives its name.
    pub(super) fn enumeration(&mut self, name: &str) -> Result<String, Untranslated> {
        let [c_name, _] = (self.target.structure)(name, &[]);
        if !self.done.insert(c_name.clone()) {
            return Ok(c_name);
        }
        let item = self.library.enumeration(name)?;
        // The status that a function gives is a fault, or none.
        let ok = name
            .ends_with("Fault")
            .then(|| format!("{}    {}", doc(1, "As asked for."), (self.target.variant)(name, "Ok")));
        let variants = item.variants.iter().map(|variant| {
            let about = library::docs(&variant.attrs).map_or_else(String::new, |about| doc(1, &about));
            format!("{about}    {}", (self.target.variant)(name, &variant.ident.to_string()))
        });
        let variants: Vec<String> = ok.into_iter().chain(variants).collect();
        let about = library::docs(&item.attrs).map_or_else(String::new, |about| doc(0, &about));
        self.types.push_str(&format!("\n{about}typedef enum {c_name} {{\n{}\n}} {c_name};\n", variants.join(",\n")));
        Ok(c_name)
    }

    /// Defines a method of a structure with these sizes, with all that it calls; gives its name.
    pub(in crate::emit::c) fn method(
        &mut self,
        owner: &str,
        sizes: &[String],
        name: &str,
    ) -> Result<String, Untranslated> {
        self.resolved(Some((owner, sizes)), name, "").map(|callee| callee.name)
    }

    /// Defines a function of a file, with all that it calls; gives its name.
    pub(in crate::emit::c) fn function(&mut self, file: &str, name: &str) -> Result<String, Untranslated> {
        self.resolved(None, name, file).map(|callee| callee.name)
    }

    /// The function behind a call, which is defined where it was not yet.
    pub(super) fn resolved(
        &mut self,
        owner: Option<(&str, &[String])>,
        name: &str,
        file: &str,
    ) -> Result<Callee, Untranslated> {
        let library = self.library;
        let function = library.function(owner.map(|(owner, _)| owner), name, file)?;
        let mut environment = HashMap::new();
        let (own, beginning) = match owner {
            Some((owner, sizes)) => {
                environment = function.bound(sizes);
                let [_, beginning] = (self.target.structure)(owner, sizes);
                (Some(Type::Structure(owner.to_owned(), sizes.to_vec())), beginning)
            }
            None => (None, function.file.clone()),
        };
        let c_name = format!("{beginning}_{name}");
        let mut frame = Frame::new(function.file.clone(), environment, own);
        for parameter in &function.signature.generics.params {
            if let syn::GenericParam::Type(parameter) = parameter
                && parameter.ident != "T"
            {
                frame.models.insert(parameter.ident.to_string());
            }
        }
        let (parameters, result) = self.shape(&function.signature, &mut frame)?;
        let callee = Callee { name: c_name.clone(), parameters, result };
        if !self.done.insert(c_name) {
            return Ok(callee);
        }
        self.define(&callee, function, frame).map_err(|why| format!("{} in {}.rs: {why}", name, function.file))?;
        Ok(callee)
    }

    /// Parameters and result; parameters become names of the frame.
    fn shape(
        &self,
        signature: &syn::Signature,
        frame: &mut Frame,
    ) -> Result<(Vec<(String, Type)>, Type), Untranslated> {
        let mut parameters = Vec::new();
        for input in &signature.inputs {
            let (name, ty) = match input {
                syn::FnArg::Receiver(receiver) => {
                    let own = frame.own.clone().ok_or("self without a structure")?;
                    let ty = match &receiver.reference {
                        Some(_) => Type::Pointer(Box::new(own), receiver.mutability.is_some()),
                        None => own,
                    };
                    ("self".to_owned(), ty)
                }
                syn::FnArg::Typed(typed) => {
                    let syn::Pat::Ident(name) = &*typed.pat else { return Err("a pattern as parameter".to_owned()) };
                    (name.ident.to_string(), self.ty_in(&typed.ty, frame)?)
                }
            };
            frame.declare(&name, ty.clone())?;
            parameters.push((name, ty));
        }
        let result = match &signature.output {
            syn::ReturnType::Default => Type::Unit,
            syn::ReturnType::Type(_, ty) => self.ty_in(ty, frame)?,
        };
        Ok((parameters, result))
    }

    fn define(
        &mut self,
        callee: &Callee,
        function: &'a library::Function,
        mut frame: Frame,
    ) -> Result<(), Untranslated> {
        let mut list = Vec::new();
        for (name, ty) in &callee.parameters {
            match ty {
                Type::Model => list.extend(self.target.constants.clone()),
                Type::Slice(_, _) => {
                    list.push(self.declared(ty, name, true)?);
                    list.push(format!("size_t {name}_length"));
                }
                _ => list.push(self.declared(ty, name, true)?),
            }
        }
        frame.result = callee.result.clone();
        self.block(&function.block, &mut frame, true)?;
        let list: Vec<&str> = list.iter().map(String::as_str).collect();
        let result = self.named(&callee.result)?;
        let about = library::docs(&function.attributes).map_or_else(String::new, |about| doc(0, &about));
        let constants = self.target.constants.as_ref().map(|_| "constants");
        let unused = callee.parameters.iter().filter(|(name, _)| !frame.used.contains(name));
        let unused = unused.filter_map(|(name, ty)| match ty {
            Type::Model => constants,
            _ => Some(name.as_str()),
        });
        let unused: String = unused.map(|name| line(1, &format!("(void){name};"))).collect();
        let head = signature(&result, &callee.name, &list);
        self.functions.push_str(&format!("\n{about}static {head}\n{{\n{unused}{}}}\n", frame.text));
        Ok(())
    }
}
