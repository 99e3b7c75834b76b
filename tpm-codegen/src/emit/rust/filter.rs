//! Filtered feed-forward: a module `filtered` with the low passes, and the common and split schemes.

use num_traits::Signed;
use proc_macro2::TokenStream;
use quote::quote;

use super::super::filter::{Coefficients, Filters, LowPass};
use super::super::function::Reads;
use super::context::Context;
use super::expression::number;
use super::names::ident;
use super::record::{count, doc};

/// The module, where filters were requested.
pub(super) fn items(context: &Context<'_>) -> TokenStream {
    // `generate` has refused low passes that do not exist, and models whose feed-forward cannot be split.
    let Some(filters) = context.options.filters else { return TokenStream::new() };
    let (Some(_), Ok((dependent, independent))) = (&context.estimator.plan.feed_forward_parts, filters.coefficients())
    else {
        return TokenStream::new();
    };
    let inputs = count(context.names.inputs.len());
    let fields: Vec<_> = context.names.inputs.iter().map(|(_, name)| name).collect();
    let indices: Vec<_> = (0..fields.len()).map(count).collect();
    let slow = low_pass("DependentLowPass", filters, &filters.dependent, &dependent, Filters::DEPENDENT);
    let (mut fast, mut fast_field, mut fast_settled, mut fast_start) = Default::default();
    let mut independent_values: Vec<TokenStream> = fields.iter().map(|field| quote!(independent.#field)).collect();
    if let (Some(filter), Some(coefficients)) = (&filters.independent, &independent) {
        fast = low_pass("IndependentLowPass", filters, filter, coefficients, Filters::INDEPENDENT);
        fast_field = quote! {
            /// Past of the motion-independent part, per input.
            independent: [IndependentLowPass<T>; #inputs],
        };
        fast_start = quote!(independent: [IndependentLowPass::default(); #inputs],);
        fast_settled = quote!(#(self.independent[#indices].settle(independent.#fields);)*);
        independent_values = fields
            .iter()
            .zip(&indices)
            .map(|(field, i)| quote!(self.independent[#i].push(independent.#field)))
            .collect();
    }
    let constants_type = if context.has_constants() { quote!(Constants,) } else { quote!() };
    let constants = context.constants_parameter(Reads { constants: true, ..Reads::default() });
    let argument = context.constants_argument();
    let runtime = context.runtime_inside();
    let parts = quote! {
        let independent = feed_forward_independent(motion, parameters, #argument);
        let dependent = feed_forward_dependent(motion, parameters, #argument);
    };
    let scheme = |name: &str,
                  about: &str,
                  state: TokenStream,
                  start: TokenStream,
                  settle: TokenStream,
                  next: Vec<TokenStream>| {
        let about = doc(&format!("{about},\nwith the past of the filters: memory of the caller."));
        let name = ident(name);
        quote! {
            #about
            #[derive(Clone, Copy, Debug, PartialEq)]
            pub struct #name<T> {
                #state
            }

            impl<T: Real> #name<T> {
                /// Settled where the machine stands still under these inputs, so that nothing jerks at the start.
                #[must_use]
                pub fn settled(motion: &Motion<T>, parameters: &Parameters<T>, #constants) -> Self {
                    let mut scheme = Self { #start };
                    scheme.settle(motion, parameters, #argument);
                    scheme
                }

                /// Settles as if the motion had stood here for long.
                pub fn settle(&mut self, motion: &Motion<T>, parameters: &Parameters<T>, #constants) {
                    #parts
                    #settle
                }

                /// The inputs of the next sample.
                pub fn next(&mut self, motion: &Motion<T>, parameters: &Parameters<T>, #constants) -> Inputs<T> {
                    #parts
                    Inputs { #(#fields: #next),* }
                }
            }
        }
    };
    let common = scheme(
        "Common",
        Filters::COMMON,
        quote! {
            /// Past of the inputs.
            whole: [DependentLowPass<T>; #inputs],
        },
        quote!(whole: [DependentLowPass::default(); #inputs],),
        quote!(#(self.whole[#indices].settle(independent.#fields + dependent.#fields);)*),
        fields
            .iter()
            .zip(&indices)
            .map(|(field, i)| quote!(self.whole[#i].push(independent.#field + dependent.#field)))
            .collect(),
    );
    let split = scheme(
        "Split",
        filters.split(),
        quote! {
            /// Past of the motion-dependent part, per input.
            dependent: [DependentLowPass<T>; #inputs],
            #fast_field
        },
        quote!(dependent: [DependentLowPass::default(); #inputs], #fast_start),
        quote!(#(self.dependent[#indices].settle(dependent.#fields);)* #fast_settled),
        fields
            .iter()
            .zip(&indices)
            .zip(&independent_values)
            .map(|((field, i), independent)| quote!(self.dependent[#i].push(dependent.#field) + #independent))
            .collect(),
    );
    quote! {
        /// The feed-forward behind low passes, sample by sample.
        pub mod filtered {
            use super::{#constants_type Inputs, Motion, Parameters, feed_forward_dependent, feed_forward_independent};
            use #runtime::Real;

            #slow
            #fast
            #common
            #split
        }
    }
}

fn low_pass(name: &str, filters: &Filters, filter: &LowPass, coefficients: &Coefficients, part: &str) -> TokenStream {
    let (name, about) = (ident(name), doc(&filters.about(filter, part)));
    let Coefficients { gain, feedback } = coefficients;
    let gain = number(gain);
    // Subtracting a negative number is written as an addition.
    let [first, second] = feedback.each_ref().map(|value| match value.is_negative() {
        true => {
            let size = number(&-value);
            quote!(+ #size)
        }
        false => {
            let size = number(value);
            quote!(- #size)
        }
    });
    quote! {
        #about
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct #name<T> {
            /// The last two samples that came in, the newest first.
            inputs: [T; 2],
            /// The last two that went out.
            outputs: [T; 2],
        }

        impl<T: Real> Default for #name<T> {
            /// At rest in 0.
            fn default() -> Self {
                Self { inputs: [T::ZERO; 2], outputs: [T::ZERO; 2] }
            }
        }

        impl<T: Real> #name<T> {
            /// Settles in a constant.
            pub fn settle(&mut self, value: T) {
                self.inputs = [value; 2];
                self.outputs = [value; 2];
            }

            /// Takes in one sample and returns the filtered one.
            pub fn push(&mut self, input: T) -> T {
                let [x1, x2] = self.inputs;
                let [y1, y2] = self.outputs;
                let output = #gain * (input + T::from_f64(2.0) * x1 + x2) #first * y1 #second * y2;
                self.inputs = [input, x1];
                self.outputs = [output, y1];
                output
            }
        }
    }
}
