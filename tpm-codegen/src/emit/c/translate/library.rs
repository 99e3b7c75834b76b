//! The items of the controller's source by their names.

use std::collections::HashMap;

use quote::ToTokens;
use tpm_controller::source::SUPPORT;

/// Why something is not of the subset.
pub(in crate::emit::c) type Untranslated = String;

/// All items of `tpm_controller::support`.
pub(in crate::emit::c) struct Library {
    structures: HashMap<String, syn::ItemStruct>,
    enumerations: HashMap<String, syn::ItemEnum>,
    functions: Vec<(Option<String>, Function)>,
    constants: Vec<(String, syn::ItemConst)>,
}

/// A function or method.
pub(super) struct Function {
    pub(super) file: String,
    pub(super) signature: syn::Signature,
    pub(super) block: syn::Block,
    pub(super) attributes: Vec<syn::Attribute>,
    /// The names of the sizes of the structure where it is a method.
    sizes: Vec<String>,
}

impl Function {
    /// The names of the structure's sizes with these sizes.
    pub(super) fn bound(&self, sizes: &[String]) -> HashMap<String, String> {
        self.sizes.iter().cloned().zip(sizes.iter().cloned()).collect()
    }
}

impl Library {
    /// Reads the source.
    ///
    /// # Errors
    /// When a file is not Rust.
    pub(in crate::emit::c) fn read() -> Result<Self, Untranslated> {
        let mut library = Self {
            structures: HashMap::new(),
            enumerations: HashMap::new(),
            functions: Vec::new(),
            constants: Vec::new(),
        };
        for (file, text) in SUPPORT {
            let parsed = syn::parse_file(text).map_err(|error| format!("{file}.rs: {error}"))?;
            parsed.items.into_iter().for_each(|item| library.take(file, item));
        }
        Ok(library)
    }

    fn take(&mut self, file: &str, item: syn::Item) {
        match item {
            syn::Item::Struct(item) => {
                self.structures.insert(item.ident.to_string(), item);
            }
            syn::Item::Enum(item) => {
                self.enumerations.insert(item.ident.to_string(), item);
            }
            syn::Item::Const(item) => self.constants.push((file.to_owned(), item)),
            syn::Item::Fn(item) => {
                let function = Function {
                    file: file.to_owned(),
                    signature: item.sig,
                    block: *item.block,
                    attributes: item.attrs,
                    sizes: Vec::new(),
                };
                self.functions.push((None, function));
            }
            syn::Item::Impl(item) => {
                let Some((name, sizes)) = path_and_sizes(&item.self_ty) else { return };
                if item.trait_.as_ref().is_some_and(|(_, path, _)| !is_operator(path)) {
                    return;
                }
                for inner in item.items {
                    if let syn::ImplItem::Fn(inner) = inner {
                        let function = Function {
                            file: file.to_owned(),
                            signature: inner.sig,
                            block: inner.block,
                            attributes: inner.attrs,
                            sizes: sizes.clone(),
                        };
                        self.functions.push((Some(name.clone()), function));
                    }
                }
            }
            _ => {}
        }
    }

    pub(super) fn structure(&self, name: &str) -> Result<&syn::ItemStruct, Untranslated> {
        self.structures.get(name).ok_or_else(|| format!("no structure {name}"))
    }

    pub(super) fn enumeration(&self, name: &str) -> Result<&syn::ItemEnum, Untranslated> {
        self.enumerations.get(name).ok_or_else(|| format!("no enumeration {name}"))
    }

    pub(super) fn is_enumeration(&self, name: &str) -> bool {
        self.enumerations.contains_key(name)
    }

    /// A method of a structure, or a function: that of the same file, or else of another.
    pub(super) fn function(&self, owner: Option<&str>, name: &str, file: &str) -> Result<&Function, Untranslated> {
        let fits =
            |(of, function): &&(Option<String>, Function)| of.as_deref() == owner && function.signature.ident == name;
        let near = self.functions.iter().filter(fits).find(|(_, function)| function.file == file);
        let any = near.or_else(|| self.functions.iter().find(fits));
        any.map(|(_, function)| function).ok_or_else(|| format!("no function {name} of {owner:?}"))
    }

    /// The value of a constant of a file.
    pub(super) fn constant(&self, file: &str, name: &str) -> Option<&syn::ItemConst> {
        self.constants.iter().find(|(of, item)| of == file && item.ident == name).map(|(_, item)| item)
    }
}

/// Whether a trait is one of the operators of `core::ops`.
fn is_operator(path: &syn::Path) -> bool {
    ["Add", "Sub", "Mul"].iter().any(|name| path.is_ident(name))
}

/// A structure's name, and the names of its sizes.
fn path_and_sizes(ty: &syn::Type) -> Option<(String, Vec<String>)> {
    let syn::Type::Path(path) = ty else { return None };
    let segment = path.path.segments.last()?;
    Some((segment.ident.to_string(), arguments(segment)))
}

/// The arguments of a structure but its scalar.
pub(super) fn arguments(segment: &syn::PathSegment) -> Vec<String> {
    let syn::PathArguments::AngleBracketed(list) = &segment.arguments else { return Vec::new() };
    let texts = list.args.iter().map(|argument| argument.to_token_stream().to_string());
    texts.filter(|text| text != "T").collect()
}

/// The sizes of a structure by their names in its declaration.
pub(super) fn bound(generics: &syn::Generics, sizes: &[String]) -> HashMap<String, String> {
    generics.const_params().map(|parameter| parameter.ident.to_string()).zip(sizes.iter().cloned()).collect()
}

/// The documentation of an item up to its list of errors, without links.
pub(super) fn docs(attributes: &[syn::Attribute]) -> Option<String> {
    let mut lines: Vec<String> = Vec::new();
    for attribute in attributes.iter().filter(|attribute| attribute.path().is_ident("doc")) {
        if let syn::Meta::NameValue(pair) = &attribute.meta
            && let syn::Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(text), .. }) = &pair.value
        {
            lines.push(text.value().trim().to_owned());
        }
    }
    let text = lines.split(|line| line.starts_with("# ")).next()?.join("\n");
    let text = text.trim().replace("[`", "`").replace("`]", "`").replace("Self::", "").replace("super::", "");
    (!text.is_empty()).then_some(text)
}
