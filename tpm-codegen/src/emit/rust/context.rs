//! State shared by the emitters of Rust: options, names, the spelling of leaves and arguments, and comments.

use proc_macro2::{Ident, Literal, TokenStream};
use quote::quote;
use std::cell::RefCell;
use std::str::FromStr;
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::plan::leaf::Leaf;

use super::super::estimator::{EstimatorSource, Identified};
use super::super::filter::Filters;
use super::super::function::{Reads, Role};
use super::names::{self, Names};

/// Options of the Rust code.
#[derive(Clone, Debug)]
pub struct Options<'a> {
    /// The command that generates this code again; it stands in the header.
    pub command: &'a str,
    /// Path of the runtime crate in the emitted code.
    pub runtime: &'a str,
    /// Identified values that the code contains as constants.
    pub identified: Option<&'a Identified>,
    /// Low passes of the feed-forward.
    pub filters: Option<&'a Filters>,
    /// Whether every pattern has a function for single strokes.
    pub strokes: bool,
    /// The text of the model, which the trait of evaluated models returns; nothing where the code need not contain it.
    pub source: Option<&'a str>,
    /// Whether accumulators get a function that reduces the weight of earlier samples.
    pub forgetting: bool,
    /// Whether a file contains the code that it needs of the runtime instead of naming the crate, and does not
    /// implement the runtime's trait.
    pub standalone: bool,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self {
            command: "tpm generate",
            runtime: "::tpm_runtime",
            identified: None,
            filters: None,
            strokes: false,
            source: None,
            forgetting: false,
            standalone: false,
        }
    }
}

/// State shared by the emitters of the parts.
pub(super) struct Context<'a> {
    pub(super) estimator: &'a EstimatorSource,
    pub(super) options: &'a Options<'a>,
    pub(super) names: Names,
    pub(super) runtime: TokenStream,
    /// Texts of comments, by number; `None` in a macro, where comments are lost.
    pub(super) comments: Option<RefCell<Vec<String>>>,
}

impl<'a> Context<'a> {
    pub(super) fn new(estimator: &'a EstimatorSource, options: &'a Options<'a>, comments: bool) -> Self {
        let names = names::names(estimator);
        let runtime = match options.standalone {
            true => quote!(self::support),
            false => TokenStream::from_str(options.runtime).unwrap_or_else(|_| quote!(::tpm_runtime)),
        };
        let comments = comments.then(RefCell::default);
        Self { estimator, options, names, runtime, comments }
    }

    /// The path of the runtime, or of the module that replaces it, from a nested module.
    pub(super) fn runtime_inside(&self) -> TokenStream {
        match self.options.standalone {
            true => quote!(super::support),
            false => self.runtime.clone(),
        }
    }

    /// A comment that [`file`](super::file) inserts; nothing in a macro, whose tokens cannot hold comments.
    pub(super) fn comment(&self, text: String) -> TokenStream {
        match &self.comments {
            Some(comments) => {
                let mut comments = comments.borrow_mut();
                let number = Literal::usize_unsuffixed(comments.len());
                comments.push(text);
                quote!(__comment!(#number);)
            }
            None => TokenStream::new(),
        }
    }

    pub(super) fn has_constants(&self) -> bool {
        !self.names.constants.is_empty()
    }

    /// The spelling of a leaf; `owner` holds the symbols that are not constants.
    pub(super) fn leaf(&self, leaf: &Leaf, owner: &Ident, fields: &[(Symbol, Ident)]) -> TokenStream {
        match *leaf {
            Leaf::Motion(coordinate, order) => {
                let found = self.names.coordinates.iter().find(|names| names.coordinate == coordinate);
                let coordinate = &found.expect("invariant: the evaluation lists its coordinates").field;
                let derivative = names::derivative_field(order);
                quote!(motion.#coordinate.#derivative)
            }
            Leaf::Column(index) => {
                let column = &self.names.columns[index];
                quote!(parameters.#column)
            }
            Leaf::Cos => quote!(cos),
            Leaf::Sin => quote!(sin),
            Leaf::Signal(equation) => {
                let field = &self.names.rows[equation].field;
                quote!(sample.#field)
            }
            Leaf::Symbol(symbol) => {
                if let Some((_, field)) = self.names.constants.iter().find(|(present, _)| *present == symbol) {
                    return quote!(constants.#field);
                }
                let found = fields.iter().find(|(present, _)| *present == symbol);
                let field = &found.expect("invariant: the owner has the plan's symbols").1;
                quote!(#owner.#field)
            }
            Leaf::Harmonic(_) => {
                unreachable!("invariant: harmonics are read by the pseudo-inverse alone, which spells them itself")
            }
        }
    }

    /// `constants: &Constants<T>,` where the model has any.
    pub(super) fn constants_parameter(&self, reads: Reads) -> TokenStream {
        match (self.has_constants(), reads.constants) {
            (false, _) => quote!(),
            (true, true) => quote!(constants: &Constants<T>,),
            (true, false) => quote!(_constants: &Constants<T>,),
        }
    }

    /// `constants: &Constants<T>,` where the model has any, for a function that only passes them on.
    pub(super) fn constants_handed_on(&self) -> TokenStream {
        self.constants_parameter(Reads { constants: true, ..Reads::default() })
    }

    /// The name of a function in documentation.
    pub(super) fn function_name(&self, role: Role) -> String {
        let of = |pattern: usize, name: &str| match &self.names.patterns[pattern].module {
            Some(module) => format!("{module}::{name}"),
            None => name.to_owned(),
        };
        match role {
            Role::Regressor => "regressor".to_owned(),
            Role::Known => "known".to_owned(),
            Role::InputMap => "input_map".to_owned(),
            Role::InverseDynamics => "inverse_dynamics".to_owned(),
            Role::FeedForward => "feed_forward".to_owned(),
            Role::FeedForwardIndependent => "feed_forward_independent".to_owned(),
            Role::FeedForwardDependent => "feed_forward_dependent".to_owned(),
            Role::Gravity => "gravity".to_owned(),
            Role::MassMatrix => "mass_matrix".to_owned(),
            Role::ForwardDynamics => "forward_dynamics".to_owned(),
            Role::BaseRegressor => "base_regressor".to_owned(),
            Role::Lump => "Physical::lump".to_owned(),
            Role::Unlump => "Parameters::unlump".to_owned(),
            Role::Reference(pattern) => of(pattern, "Pattern::reference_from"),
            Role::EstimatorMatrix(pattern) => of(pattern, "Pattern::estimator_matrix"),
            Role::Accumulate(pattern) => of(pattern, "Accumulator::push_at"),
        }
    }

    pub(super) fn constants_argument(&self) -> TokenStream {
        if self.has_constants() { quote!(constants,) } else { quote!() }
    }
}
