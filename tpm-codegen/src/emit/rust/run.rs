//! The module of the estimator of a run: its sample, its parameters, its rows, and the estimator over the runtime's.

use proc_macro2::{Ident, Literal, TokenStream};
use quote::quote;
use tpm_symbolic::expr::graph::Function;
use tpm_symbolic::plan::leaf::Leaf;

use super::super::code::Place;
use super::super::run::{ESTIMATOR, PARAMETERS, RunPlan, SAMPLE};
use super::super::text;
use super::campaign;
use super::context::Context;
use super::expression::Writer;
use super::names::{self, ident};
use super::record::{Field, count, doc, record};
use super::run_physical;
use super::run_sizes::Sizes;
use super::run_tracking;
use super::shapes::{label, quantity_fields};

/// The module `run`, where it was requested.
pub(super) fn items(context: &Context<'_>) -> TokenStream {
    let Some(plan) = RunPlan::of(context.estimator) else { return TokenStream::new() };
    let names = names::names(plan.source);
    let types = types(context, &plan, &names);
    let rows = rows(context, &plan);
    let estimator = estimator(context, &plan);
    let tracking = run_tracking::items(context, &plan);
    let physical = run_physical::items(context, &plan, &names);
    let campaign = campaign::items(context, &plan, &names);
    let runtime = match context.options.standalone {
        true => quote!(super::support),
        false => {
            let runtime = &context.runtime;
            quote!(#runtime::support)
        }
    };
    let constants = if context.has_constants() {
        quote!(
            use super::Constants;
        )
    } else {
        quote!()
    };
    let about = doc(ESTIMATOR);
    let mut names =
        vec!["Label", "Real", "RunEstimate", "RunLines", "RunModel", "RunPassed", "RunWorkspace", "SquareRoot"];
    let mut public = vec!["RunFault", "RunSampling"];
    if context.estimator.campaign.is_some() {
        names.extend(["CampaignOrder", "Play", "RunPool", "passing"]);
        public.extend(["CampaignEnd", "CampaignPhase", "CampaignRules"]);
    }
    if plan.source.slopes.is_some() {
        names.extend(["RunLumping", "RunPhysical"]);
    }
    if plan.takes_reference(context.estimator) {
        names.push("RunReference");
    }
    if context.estimator.parts.linearised {
        public.push("RunLinearisation");
    }
    if context.estimator.parts.numerical {
        names.push("RunNumerical");
    }
    if plan.source.calls(Function::Tanh) {
        names.push("Hyperbolic");
    }
    let idents = |names: Vec<&str>| names.into_iter().map(ident).collect::<Vec<Ident>>();
    let (names, public) = (idents(names), idents(public));
    quote! {
        #about
        pub mod run {
            #constants
            use #runtime::{#(#names),*};
            pub use #runtime::{#(#public),*};

            #types
            #rows
            #estimator
            #tracking
            #physical
            #campaign
        }
    }
}

/// The structures of samples, inputs and parameters.
fn types(context: &Context<'_>, plan: &RunPlan<'_>, names: &names::Names) -> TokenStream {
    let source = plan.source;
    let coordinates = names
        .coordinates
        .iter()
        .map(|names| Field { ident: names.field.clone(), doc: text::derivative(source, names.coordinate, 0) });
    let coordinates: Vec<Field> = coordinates.collect();
    let motion = record(&ident("Measured"), "The measured coordinates, or the noise of each.", &coordinates);
    let inputs = record(&ident("Applied"), "The inputs as they are applied.", &quantity_fields(context, &names.inputs));
    let columns = names.columns.iter().enumerate();
    let fields: Vec<Field> =
        columns.map(|(index, name)| Field { ident: name.clone(), doc: text::column(source, index) }).collect();
    let parameters = record(&ident("Parameters"), PARAMETERS, &fields);
    let label_type = ident("Label");
    let labels = source.form.columns.iter().map(|column| label(&label_type, &column.name, column.unit.as_ref()));
    let length = count(source.form.columns.len());
    let about = doc(SAMPLE);
    quote! {
        #motion
        #inputs

        #about
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct Sample<T> {
            /// The measured coordinates.
            pub measured: Measured<T>,
            /// The inputs that are applied from this sample on.
            pub applied: Applied<T>,
        }

        #parameters

        /// Names and units of the parameters.
        pub const PARAMETERS: [Label<'static>; #length] = [#(#labels),*];
    }
}

/// The rows along a motion, for the runtime's estimator.
fn rows(context: &Context<'_>, plan: &RunPlan<'_>) -> TokenStream {
    let sizes = Sizes::of(plan);
    let Sizes { inputs, rows, parameters, motion, .. } = &sizes;
    let of: Vec<Literal> = plan.motion.iter().map(|&(coordinate, _)| count(coordinate)).collect();
    let orders: Vec<Literal> = plan.motion.iter().map(|&(_, derivative)| count(derivative as usize)).collect();
    let (steps, reads) = plan.rows();
    let owner = ident("self");
    let writer = Writer::new(|leaf: &Leaf| match plan.place(leaf) {
        Some(place) => {
            let place = count(place);
            quote!(motion[#place])
        }
        None => context.leaf(leaf, &owner, &[]),
    });
    let used = |name: &str, used: bool| ident(&if used { name.to_owned() } else { format!("_{name}") });
    let targets: Vec<Ident> = steps.iter().map(|(name, steps)| used(name, !steps.is_empty())).collect();
    let steps = steps.iter().filter(|(_, steps)| !steps.is_empty()).map(|(name, steps)| {
        let name = ident(name);
        let steps = writer.statements(context, steps, |place, value| match place {
            Place::Entry(row, column) => {
                let (row, column) = (count(row), count(column));
                quote!(#name[#row][#column] = #value;)
            }
            Place::Value(row) => {
                let row = count(row);
                quote!(#name[#row] = #value;)
            }
        });
        quote!({ #steps })
    });
    let steps: Vec<TokenStream> = steps.collect();
    let (regressor, known, map) = (&targets[0], &targets[1], &targets[2]);
    let motion_name = used("motion", reads.motion);
    let points = count(plan.points);
    let (structure, constants) = match context.has_constants() {
        true => (
            quote!(
                struct Rows<'c, T>(&'c Constants<T>);
            ),
            quote!(let constants = self.0;),
        ),
        false => (
            quote!(
                struct Rows;
            ),
            quote!(),
        ),
    };
    let constants = if reads.constants { constants } else { quote!() };
    let name = if context.has_constants() { quote!(Rows<'_, T>) } else { quote!(Rows) };
    quote! {
        /// The equations along a motion.
        #structure

        impl<T: Real> RunModel<T, #inputs, #rows, #parameters, #motion> for #name {
            const COORDINATES: [usize; #motion] = [#(#of),*];
            const ORDERS: [u32; #motion] = [#(#orders),*];
            const POINTS: usize = #points;

            fn rows(
                &self,
                #motion_name: &[T; #motion],
                #regressor: &mut [[T; #parameters]; #rows],
                #known: &mut [T; #rows],
                #map: &mut [[T; #inputs]; #rows],
            ) {
                #constants
                #(#steps)*
            }
        }
    }
}

/// The estimator, and what it gives.
fn estimator(context: &Context<'_>, plan: &RunPlan<'_>) -> TokenStream {
    let Sizes { coordinates, inputs, channels, rows, parameters, motion, lines, equations, covariances } =
        Sizes::of(plan);
    let evaluation = &plan.source.plan.evaluation;
    let (highest, count_coordinates) = (count(plan.harmonics), evaluation.coordinates.len());
    let measured: Vec<TokenStream> = (0..count_coordinates).map(|i| entry("measured", i)).collect();
    let applied: Vec<TokenStream> = (0..evaluation.inputs.len()).map(|i| entry("applied", i)).collect();
    let constants = context.constants_handed_on();
    let model = if context.has_constants() { quote!(&Rows(constants)) } else { quote!(&Rows) };
    quote! {
        /// The highest harmonic that is used.
        pub const HIGHEST_HARMONIC: usize = #highest;

        /// The parameters from the samples of one run.
        ///
        /// A sample that cannot be used ends the run: its fault stays until the next run begins, and no parameter is given.
        #[derive(Clone, Copy, Debug)]
        pub struct Estimator<T> {
            lines: RunLines<T, #channels, #lines>,
            passed: RunPassed<T, #inputs>,
            workspace: RunWorkspace<T, #inputs, #coordinates, #rows, #parameters, #motion, #lines, #equations, #covariances>,
            sampling: RunSampling<T>,
            limits: Option<Applied<T>>,
        }

        impl<T: Real> Estimator<T> {
            /// Before the first sample of a run of so many periods. Samples of a period divide it evenly; inputs whose size reaches
            /// their limit end the run.
            ///
            /// # Errors
            /// [`RunFault::Periods`] unless the periods are even and at least four, [`RunFault::Samples`] when a period has too few
            /// samples for the harmonics.
            pub fn new(
                samples_per_period: u32,
                periods: u32,
                sampling: RunSampling<T>,
                limits: Option<Applied<T>>,
            ) -> Result<Self, RunFault> {
                let lines = RunLines::new(samples_per_period, periods)?;
                let passed = RunPassed::new(samples_per_period, #lines);
                Ok(Self { lines, passed, workspace: RunWorkspace::default(), sampling, limits })
            }

            /// Begins another run.
            ///
            /// # Errors
            /// Those of [`Self::new`].
            pub fn begin(&mut self, samples_per_period: u32, periods: u32) -> Result<(), RunFault> {
                self.passed.begin(samples_per_period, #lines);
                self.lines.begin(samples_per_period, periods)
            }

            /// Takes in sample `number`, counted from 0 at the beginning of a period of a motion that has settled; says whether the run
            /// is whole.
            ///
            /// # Errors
            /// What ended the run: [`RunFault::Missed`], [`RunFault::NotFinite`], [`RunFault::Saturated`].
            pub fn push(&mut self, number: u32, sample: &Sample<T>) -> Result<bool, RunFault> {
                let (measured, applied) = (sample.measured.into_array(), sample.applied.into_array());
                if let Some(limits) = self.limits {
                    let mut pairs = applied.iter().zip(limits.into_array());
                    if pairs.any(|(value, limit)| value.abs() >= limit) {
                        self.lines.fail(RunFault::Saturated { sample: number });
                    }
                }
                let belongs = !self.lines.is_whole();
                self.lines.push(number, &[#(#measured,)* #(#applied),*])?;
                if belongs {
                    self.passed.push(&applied);
                }
                Ok(self.lines.is_whole())
            }

            /// Ends the run, which then gives no parameter: the machine stopped, or did something else.
            pub fn stop(&mut self) {
                self.lines.fail(RunFault::Unfinished { samples: self.lines.count() });
            }

            /// What the run says of the parameters. `prior` has the present estimates, at which weights begin.
            ///
            /// # Errors
            /// What ended the run, [`RunFault::Unfinished`] before its last sample, [`RunFault::Equations`] when the equations are not
            /// finite along the motion, [`RunFault::Still`] when nothing stands out of the noise.
            pub fn estimate(&mut self, #constants prior: &Parameters<T>) -> Result<Estimate<T>, RunFault> {
                let found: RunEstimate<T, #coordinates, #parameters> = self.workspace.estimate(
                    #model,
                    (&self.lines, &self.passed),
                    self.sampling,
                    &prior.into_array(),
                    None,
                )?;
                Ok(Estimate::of(found))
            }
        }

        impl<T: Real> Estimate<T> {
            fn of(found: RunEstimate<T, #coordinates, #parameters>) -> Self {
                Self {
                    parameters: Parameters::from_array(found.values),
                    deviations: Parameters::from_array(found.deviations),
                    covariance: found.covariance,
                    combinations: found.combinations,
                    combined: found.combined,
                    equations: found.equations,
                    about: found.about,
                    rank: found.rank,
                    condition: found.condition,
                    chi_squared: found.chi_squared,
                    noise: Measured::from_array(found.noise),
                }
            }
        }

        /// What a run says of the parameters.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Estimate<T> {
            /// The parameters; nothing for those that the run does not show.
            pub parameters: Parameters<Option<T>>,
            /// Their standard deviations.
            pub deviations: Parameters<Option<T>>,
            /// Their covariance in the order of the fields; zero for those that the run does not show.
            pub covariance: [[T; #parameters]; #parameters],
            /// A row for every parameter that leads a combination which the run shows: the weights of all parameters in it, one at its own.
            /// A shown parameter is a combination of itself alone; the others lead none.
            pub combinations: [[T; #parameters]; #parameters],
            /// The values of the combinations and their standard deviations; nothing where there is none.
            pub combined: [Option<[T; 2]>; #parameters],
            /// The weighted equations of the run, for the step from `about`.
            pub equations: SquareRoot<T, #parameters>,
            /// The parameters from which the steps of the equations count.
            pub about: [T; #parameters],
            /// The number of directions that the run shows.
            pub rank: usize,
            /// At least the condition number of what is shown, and at most the rank times that.
            pub condition: T,
            /// Weighted sum of squares of what the equations leave, over its degrees of freedom: about one where the machine obeys
            /// them. Where it is larger, the deviations are those of the noise times its root.
            pub chi_squared: T,
            /// Standard deviation of the noise in the samples of every coordinate.
            pub noise: Measured<T>,
        }
    }
}

/// An entry of an array.
fn entry(name: &str, index: usize) -> TokenStream {
    let (name, index) = (ident(name), count(index));
    quote!(#name[#index])
}
