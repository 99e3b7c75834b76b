//! Structures of scalars with named fields and a fixed order.

use proc_macro2::{Ident, Literal, TokenStream};
use quote::{format_ident, quote};

use super::super::text::filled;

/// Widest line of documentation.
pub(super) const WIDTH: usize = 110;

/// One field.
pub(super) struct Field {
    /// Its name.
    pub(super) ident: Ident,
    /// What it holds.
    pub(super) doc: String,
}

/// `v0, v1, ...`: local names that differ from every name of the model.
pub(super) fn locals(count: usize) -> Vec<Ident> {
    (0..count).map(|i| format_ident!("v{i}")).collect()
}

/// A number of entries as a literal without a suffix.
pub(super) fn count(value: usize) -> Literal {
    Literal::usize_unsuffixed(value)
}

/// A documentation attribute; an empty text gives an empty line.
pub(super) fn doc(text: &str) -> TokenStream {
    let lines = filled(text, WIDTH).into_iter().map(|line| {
        let line = if line.is_empty() { String::new() } else { format!(" {line}") };
        quote!(#[doc = #line])
    });
    quote!(#(#lines)*)
}

/// A structure of scalars and its conversions from and to an array.
pub(super) fn record(name: &Ident, about: &str, fields: &[Field]) -> TokenStream {
    let length = count(fields.len());
    let about = doc(about);
    let values = locals(fields.len());
    let idents: Vec<&Ident> = fields.iter().map(|field| &field.ident).collect();
    let docs = fields.iter().map(|field| doc(&field.doc));
    // Without a field the type would not use its scalar parameter.
    let (marker, unmarked) = match fields.len() {
        0 => (quote!(_scalar: ::core::marker::PhantomData<T>), quote!(_scalar: ::core::marker::PhantomData)),
        _ => (quote!(), quote!()),
    };
    quote! {
        #about
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct #name<T> {
            #(#docs pub #idents: T,)*
            #marker
        }

        impl<T> #name<T> {
            /// From the entries in the order of the fields.
            #[must_use]
            pub fn from_array(values: [T; #length]) -> Self {
                let [#(#values),*] = values;
                Self { #(#idents: #values,)* #unmarked }
            }

            /// The entries in the order of the fields.
            #[must_use]
            pub fn into_array(self) -> [T; #length] {
                [#(self.#idents),*]
            }
        }
    }
}
