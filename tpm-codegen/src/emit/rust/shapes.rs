//! Building blocks of functions of the dynamics: labels, fields, parameter lists, matrices and returned structures.

use proc_macro2::{Ident, TokenStream};
use quote::quote;
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::unit::Unit;
use tpm_symbolic::plan::leaf::Leaf;

use super::super::code::{Place, Statement};
use super::super::function::{Body, Function, Reads};
use super::super::text;
use super::context::Context;
use super::expression::Writer;
use super::names::ident;
use super::record::{Field, count, doc};

/// A label with its unit.
pub(super) fn label(runtime_label: &Ident, name: &str, unit: Option<&Unit>) -> TokenStream {
    match unit.map(ToString::to_string) {
        Some(unit) => quote!(#runtime_label::new(#name, #unit)),
        None => quote!(#runtime_label::bare(#name)),
    }
}

/// A field per quantity.
pub(super) fn quantity_fields(context: &Context<'_>, symbols: &[(Symbol, Ident)]) -> Vec<Field> {
    let field = |(symbol, name): &(Symbol, Ident)| Field {
        ident: name.clone(),
        doc: text::quantity(context.estimator, *symbol),
    };
    symbols.iter().map(field).collect()
}

/// The parameter list of a function of the motion.
pub(super) fn arguments(context: &Context<'_>, reads: Reads, with_parameters: bool) -> TokenStream {
    let motion = if reads.motion { ident("motion") } else { ident("_motion") };
    let constants = context.constants_parameter(reads);
    let parameters = match (with_parameters, reads.parameters) {
        (false, _) => quote!(),
        (true, true) => quote!(parameters: &Parameters<T>,),
        (true, false) => quote!(_parameters: &Parameters<T>,),
    };
    quote!(#motion: &Motion<T>, #parameters #constants)
}

/// Steps that fill `matrix` and define the local variables `values`.
pub(super) fn stores<L: Fn(&Leaf) -> TokenStream>(
    context: &Context<'_>,
    statements: &[Statement],
    writer: &Writer<L>,
    values: &[Ident],
) -> TokenStream {
    writer.statements(context, statements, |place, expression| match place {
        Place::Entry(row, column) => {
            let (row, column) = (count(row), count(column));
            quote!(matrix[#row][#column] = #expression;)
        }
        Place::Value(index) => {
            let value = values.get(index).expect("invariant: every value that is stored has its variable");
            quote!(let #value = #expression;)
        }
    })
}

/// A function that returns one matrix row per equation.
pub(super) fn matrix(
    context: &Context<'_>,
    name: &str,
    function: &Function,
    arguments: TokenStream,
    columns: usize,
) -> TokenStream {
    let (rows, columns) = (count(context.names.rows.len()), count(columns));
    let (name, about) = (ident(name), doc(&function.about));
    let Body::Stores(statements) = &function.body else {
        unreachable!("invariant: matrices of the dynamics are written entry by entry")
    };
    let body = if statements.is_empty() {
        quote!([[T::ZERO; #columns]; #rows])
    } else {
        let owner = ident("self");
        let body = stores(context, statements, &Writer::new(|leaf| context.leaf(leaf, &owner, &[])), &[]);
        quote! {
            let mut matrix = [[T::ZERO; #columns]; #rows];
            #body
            matrix
        }
    };
    quote! {
        #about
        #[must_use]
        pub fn #name<T: Real>(#arguments) -> [[T; #columns]; #rows] {
            #body
        }
    }
}

/// A function of the motion with one value per field of a structure.
pub(super) fn structure(
    context: &Context<'_>,
    name: &str,
    function: &Function,
    with_parameters: bool,
    (result, fields): (&str, Vec<&Ident>),
) -> TokenStream {
    let (about, name, result) = (doc(&function.about), ident(name), ident(result));
    let arguments = arguments(context, function.reads, with_parameters);
    let Body::Values(statements, values) = &function.body else {
        unreachable!("invariant: forces and inputs are given all at once")
    };
    let owner = ident("self");
    let writer = Writer::new(|leaf| context.leaf(leaf, &owner, &[]));
    let statements = writer.statements(context, statements, |_, _| TokenStream::new());
    let values = values.iter().map(|value| writer.expression(value));
    quote! {
        #about
        #[must_use]
        pub fn #name<T: Real>(#arguments) -> #result<T> {
            #statements
            #result { #(#fields: #values),* }
        }
    }
}

/// The structure of the forces, with its fields.
pub(super) fn force_fields<'a>(context: &'a Context<'_>) -> (&'static str, Vec<&'a Ident>) {
    ("Forces", context.names.rows.iter().map(|row| &row.field).collect())
}
