//! What compares a run with its reference: the estimators that are linearised about it, and the one by differences of runs.

use proc_macro2::TokenStream;
use quote::quote;

use super::super::run::{ABOUT, NUMERICAL, REFERENCE, RunPlan};
use super::context::Context;
use super::record::doc;
use super::run_sizes::Sizes;

/// The reference, and the requested estimators that read it.
pub(super) fn items(context: &Context<'_>, plan: &RunPlan<'_>) -> TokenStream {
    if !plan.takes_reference(context.estimator) {
        return TokenStream::new();
    }
    let Sizes { coordinates, lines, .. } = Sizes::of(plan);
    let reference = doc(REFERENCE);
    let (linearised, numerical) = (linearised(context), numerical(context, plan));
    quote! {
        #reference
        #[derive(Clone, Copy, Debug)]
        pub struct Reference<T>(RunReference<T, #coordinates, #lines>);

        impl<T: Real> Reference<T> {
            /// Before the first sample of a period.
            ///
            /// # Errors
            /// [`RunFault::Samples`] when a period has too few samples for the harmonics.
            pub fn new(samples_per_period: u32) -> Result<Self, RunFault> {
                Ok(Self(RunReference::new(samples_per_period)?))
            }

            /// Takes in the reference of sample `number`, counted as the samples of the run are; samples behind the first period are
            /// not used. Says whether the period is whole.
            ///
            /// # Errors
            /// [`RunFault::Missed`], [`RunFault::NotFinite`]; they stay until a new reference is begun.
            pub fn push(&mut self, number: u32, reference: &Measured<T>) -> Result<bool, RunFault> {
                self.0.push(number, &reference.into_array())?;
                Ok(self.0.is_whole())
            }
        }

        #linearised
        #numerical
    }
}

/// The estimators that are linearised about the reference, where they were requested.
fn linearised(context: &Context<'_>) -> TokenStream {
    if !context.estimator.parts.linearised {
        return TokenStream::new();
    }
    let constants = context.constants_handed_on();
    let model = if context.has_constants() { quote!(&Rows(constants)) } else { quote!(&Rows) };
    let about = doc(ABOUT);
    quote! {
        impl<T: Real> Estimator<T> {
            #about
            ///
            /// # Errors
            /// Those of [`Self::estimate`], those of the reference, and [`RunFault::Samples`] when it has another period than the run.
            pub fn estimate_about(
                &mut self,
                #constants
                which: RunLinearisation,
                reference: &Reference<T>,
                prior: &Parameters<T>,
            ) -> Result<Estimate<T>, RunFault> {
                let found = self.workspace.estimate(
                    #model,
                    (&self.lines, &self.passed),
                    self.sampling,
                    &prior.into_array(),
                    Some((which, &reference.0)),
                )?;
                Ok(Estimate::of(found))
            }
        }
    }
}

/// The estimator by differences of runs, where it was requested.
fn numerical(context: &Context<'_>, plan: &RunPlan<'_>) -> TokenStream {
    if !context.estimator.parts.numerical {
        return TokenStream::new();
    }
    let Sizes { coordinates, parameters, lines, .. } = Sizes::of(plan);
    let about = doc(NUMERICAL);
    quote! {
        #about
        #[derive(Clone, Copy, Debug)]
        pub struct Numerical<T>(RunNumerical<T, #coordinates, #parameters, #lines>);

        impl<T: Real> Default for Numerical<T> {
            fn default() -> Self {
                Self(RunNumerical::default())
            }
        }

        impl<T: Real> Numerical<T> {
            /// Begins with the run that an estimator has taken in.
            ///
            /// # Errors
            /// What ended the run or its reference, [`RunFault::Unfinished`] before their last samples; what was there before has stayed.
            pub fn begin(&mut self, run: &Estimator<T>, reference: &Reference<T>) -> Result<(), RunFault> {
                self.0.begin(&run.lines, &reference.0)
            }

            /// Takes in a run in whose feed-forward one parameter, by its place in [`PARAMETERS`], is larger by a step; all else is as in
            /// the first run. A second run with the opposite step takes the bend of the response out of the first one's difference; any
            /// other takes the place of what was there. The tracking error must differ from that of the first run by far more than
            /// noise, and yet in proportion to the step, or by a parabola where both directions are played.
            ///
            /// # Errors
            /// [`RunFault::Perturbation`] when there is no such parameter, the step is zero or not finite, or there is no first run;
            /// [`RunFault::Samples`] when the run has other samples than the first one; and those of [`Self::begin`].
            pub fn change(
                &mut self,
                parameter: usize,
                step: T,
                run: &Estimator<T>,
                reference: &Reference<T>,
            ) -> Result<(), RunFault> {
                self.0.change(parameter, step, &run.lines, &reference.0)
            }

            /// What the runs say of the parameters; `played` were those of the first run's feed-forward. A parameter that was not changed
            /// stays as it was played, and gets no number.
            ///
            /// # Errors
            /// [`RunFault::Unfinished`] before any parameter was changed, [`RunFault::Still`] when nothing stands out of the noise,
            /// [`RunFault::Equations`] when a number is not finite.
            pub fn estimate(&self, played: &Parameters<T>) -> Result<Estimate<T>, RunFault> {
                Ok(Estimate::of(self.0.estimate(&played.into_array())?))
            }
        }
    }
}
