//! The physical parameters in the module of the estimator of a run, where its parameters are products and sums of them.

use proc_macro2::TokenStream;
use quote::quote;
use tpm_symbolic::plan::leaf::Leaf;

use super::super::code::{Expression, Reader};
use super::super::run::{PHYSICAL, RunPlan, is_zero};
use super::context::Context;
use super::expression::Writer;
use super::names::{Names, ident};
use super::record::{count, doc, record};
use super::shapes::quantity_fields;

/// The type of the physical parameters and their estimate.
pub(super) fn items(context: &Context<'_>, plan: &RunPlan<'_>, names: &Names) -> TokenStream {
    let Some(slopes) = &plan.source.slopes else { return TokenStream::new() };
    let fields = quantity_fields(context, &names.physical);
    let physical = record(&ident("Physical"), "The parameters as the model declares them.", &fields);
    let (columns, width) = (plan.source.form.columns.len(), names.physical.len());
    let owner = ident("self");
    let writer = Writer::new(|leaf: &Leaf| {
        let place = match *leaf {
            Leaf::Symbol(symbol) => names.physical.iter().position(|(own, _)| *own == symbol),
            _ => None,
        };
        match place {
            Some(place) => {
                let place = count(place);
                quote!(physical[#place])
            }
            None => context.leaf(leaf, &owner, &[]),
        }
    });
    let (statements, values) = Reader::new(slopes).outputs();
    let reads_constants = slopes.inputs.iter().any(|leaf| match *leaf {
        Leaf::Symbol(symbol) => names.physical.iter().all(|(own, _)| *own != symbol),
        _ => false,
    });
    let steps = writer.statements(context, &statements, |_, _| TokenStream::new());
    let stores =
        values.iter().enumerate().filter(|(_, value)| !is_zero(value)).map(|(index, value): (_, &Expression)| {
            let value = writer.expression(value);
            let (row, column) = match index.checked_sub(columns) {
                None => {
                    let place = count(index);
                    return quote!(parameters[#place] = #value;);
                }
                Some(place) => (count(place / width), count(place % width)),
            };
            quote!(slopes[#row][#column] = #value;)
        });
    let stores: Vec<TokenStream> = stores.collect();
    let (columns, width) = (count(columns), count(width));
    let constants = if reads_constants { quote!(let constants = self.0;) } else { quote!() };
    let of = if context.has_constants() { quote!(Rows<'_, T>) } else { quote!(Rows) };
    let handed = context.constants_handed_on();
    let model = if context.has_constants() { quote!(&Rows(constants)) } else { quote!(&Rows) };
    let about = doc(PHYSICAL);
    quote! {
        #physical

        impl<T: Real> RunLumping<T, #columns, #width> for #of {
            fn lump(&self, physical: &[T; #width], parameters: &mut [T; #columns], slopes: &mut [[T; #width]; #columns]) {
                #constants
                #steps
                #(#stores)*
            }
        }

        /// What a run says of the physical parameters.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct PhysicalEstimate<T> {
            /// The parameters; nothing for those that the run does not show.
            pub parameters: Physical<Option<T>>,
            /// Their standard deviations.
            pub deviations: Physical<Option<T>>,
            /// Their covariance in the order of the fields; zero for those that the run does not show.
            pub covariance: [[T; #width]; #width],
            /// The number of directions that the run shows.
            pub rank: usize,
            /// At least the condition number of what is shown, and at most the rank times that.
            pub condition: T,
            /// Weighted sum of squares of what the equations leave at these parameters, over its degrees of freedom.
            pub chi_squared: T,
        }

        impl<T: Real> Estimate<T> {
            #about
            ///
            /// # Errors
            /// [`RunFault::Equations`] when a number is not finite, [`RunFault::Still`] when nothing is shown, [`RunFault::Apart`] when no
            /// parameters near the given ones agree with the run.
            pub fn physical(&self, #handed prior: &Physical<T>) -> Result<PhysicalEstimate<T>, RunFault> {
                let found = RunPhysical::of(#model, &self.equations, &self.about, &prior.into_array())?;
                Ok(PhysicalEstimate {
                    parameters: Physical::from_array(found.values),
                    deviations: Physical::from_array(found.deviations),
                    covariance: found.covariance,
                    rank: found.rank,
                    condition: found.condition,
                    chi_squared: found.chi_squared,
                })
            }
        }
    }
}
