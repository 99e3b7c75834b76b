//! C from the controller's own Rust: the one source of what every estimator computes is `tpm_controller::support`, and this prints it as C99.
//!
//! The subset that is read: structures of scalars, numbers and arrays of fixed size; functions over them with arrays and structures by
//! reference; loops over ranges; no closures, iterators, options, or generics but the scalar, sizes, and the model. What is asked for is
//! translated with all that it calls, and nothing else, so that other items of the same files may be anything. The scalar becomes `float` or
//! `double`, every size a macro of the model's header, and a fault the number of its status.
//!
//! Invariant: an operation of the source is one of the text, in the same order, so that both give the same bits.

mod expression;
mod library;
mod statement;
mod types;

use std::collections::{HashMap, HashSet};

use super::expression::Scalar;
use super::layout::{doc, signature, statement as line};
pub(super) use library::Library;
use types::Type;

/// Why something is not of the subset.
pub(super) type Untranslated = String;

/// What stands in C for names of the source.
pub(super) struct Target<'a> {
    pub(super) scalar: Scalar,
    /// The macro of every size, by the name of the constant generic.
    pub(super) sizes: HashMap<&'static str, String>,
    /// The name of a structure or enumeration with these sizes, and how the names of its functions begin.
    pub(super) structure: &'a dyn Fn(&str, &[String]) -> [String; 2],
    /// The name of a variant.
    pub(super) variant: &'a dyn Fn(&str, &str) -> String,
    /// The name of a function, or of an array or number, that the model itself gives.
    pub(super) model: &'a dyn Fn(&str) -> String,
    /// The parameter of functions that evaluate the model, and its argument; nothing where it has no constants.
    pub(super) constants: Option<String>,
}

/// A translation: definitions of types, and of functions, in the order in which C needs them.
pub(super) struct Translator<'a> {
    library: &'a Library,
    target: &'a Target<'a>,
    pub(super) types: String,
    pub(super) functions: String,
    pub(super) done: HashSet<String>,
}

/// A function as it is called.
struct Callee {
    name: String,
    parameters: Vec<(String, Type)>,
    result: Type,
}

impl<'a> Translator<'a> {
    /// A translation behind others, whose types and functions are `done`.
    pub(super) fn new(library: &'a Library, target: &'a Target<'a>, done: HashSet<String>) -> Self {
        Self { library, target, types: String::new(), functions: String::new(), done }
    }

    /// Defines a structure, and those that it holds; gives its name.
    pub(super) fn structure(&mut self, name: &str, sizes: &[String]) -> Result<String, Untranslated> {
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
    pub(super) fn method(&mut self, owner: &str, sizes: &[String], name: &str) -> Result<String, Untranslated> {
        self.resolved(Some((owner, sizes)), name, "").map(|callee| callee.name)
    }

    /// Defines a function of a file, with all that it calls; gives its name.
    pub(super) fn function(&mut self, file: &str, name: &str) -> Result<String, Untranslated> {
        self.resolved(None, name, file).map(|callee| callee.name)
    }

    /// The function behind a call, which is defined where it was not yet.
    fn resolved(&mut self, owner: Option<(&str, &[String])>, name: &str, file: &str) -> Result<Callee, Untranslated> {
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

/// A function while it is translated.
struct Frame {
    file: String,
    /// The sizes of its structure.
    environment: HashMap<String, String>,
    own: Option<Type>,
    /// Names of type parameters that stand for a model.
    models: HashSet<String>,
    scopes: Vec<HashMap<String, Type>>,
    used: HashSet<String>,
    result: Type,
    text: String,
    depth: usize,
    counters: usize,
}

impl Frame {
    fn new(file: String, environment: HashMap<String, String>, own: Option<Type>) -> Self {
        let (scopes, used) = (vec![HashMap::new()], HashSet::new());
        let (models, text) = (HashSet::new(), String::new());
        Self { file, environment, own, models, scopes, used, result: Type::Unit, text, depth: 1, counters: 0 }
    }

    /// A name that no other of the function has: C would hide the outer one, or refuse it.
    fn declare(&mut self, name: &str, ty: Type) -> Result<(), Untranslated> {
        if self.scopes.iter().any(|scope| scope.contains_key(name)) {
            return Err(format!("the name {name} is given twice"));
        }
        if let Some(scope) = self.scopes.last_mut() {
            scope.insert(name.to_owned(), ty);
        }
        Ok(())
    }

    fn local(&mut self, name: &str) -> Option<Type> {
        let found = self.scopes.iter().rev().find_map(|scope| scope.get(name).cloned());
        if found.is_some() {
            self.used.insert(name.to_owned());
        }
        found
    }

    fn write(&mut self, text: &str) {
        self.text.push_str(&line(self.depth, text));
    }

    /// An index that no other loop has.
    fn counter(&mut self) -> String {
        self.counters += 1;
        format!("i{}", self.counters)
    }
}
