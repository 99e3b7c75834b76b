//! The campaign of the module `run`: its stages, and the machine of states over the runtime's order.

use proc_macro2::{Ident, TokenStream};
use quote::quote;
use tpm_symbolic::mechanics::model::Kind;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::straight_line::Plan;

use super::super::campaign::{CAMPAIGN, CampaignPlan};
use super::super::code::Reader;
use super::super::run::RunPlan;
use super::context::Context;
use super::expression::{Writer, number};
use super::names::{Names, derivative_field, ident};
use super::record::count;

/// The items of the campaign, where it was requested.
pub(super) fn items(context: &Context<'_>, plan: &RunPlan<'_>, names: &Names) -> TokenStream {
    let Some(campaign) = CampaignPlan::of(context.estimator) else { return TokenStream::new() };
    let command = command(context, plan, names, &campaign);
    let machine = machine(context, plan);
    let about = super::record::doc(CAMPAIGN);
    let pattern = pattern(context);
    quote! {
        /// A stage of a campaign.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Stage<T> {
            /// The amplitudes; the frequency is that of the period.
            pub pattern: #pattern<T>,
            /// Samples of a period.
            pub samples_per_period: u32,
        }

        /// What the controller plays at a sample.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Command<T> {
            /// The reference of every measured coordinate.
            pub reference: Measured<T>,
            /// The feed-forward; feedback of `measured - reference` is added to it.
            pub feed_forward: Applied<T>,
        }

        /// What ends a run.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Limits<T> {
            /// The limit of every input.
            pub inputs: Applied<T>,
            /// The largest tracking error of every coordinate.
            pub tracking: Measured<T>,
        }

        #about
        #[derive(Clone, Copy, Debug)]
        pub struct Campaign<'s, T> {
            stages: &'s [Stage<T>],
            order: CampaignOrder<T>,
            rules: CampaignRules<T>,
            limits: Limits<T>,
            estimator: Estimator<T>,
            pool: RunPool<T, { PARAMETERS.len() }>,
            parameters: Parameters<T>,
            estimate: Option<Estimate<T>>,
            command: Command<T>,
            number: u32,
        }

        #machine
        #command
    }
}

/// The path of the pattern's type from the module `run`.
fn pattern(context: &Context<'_>) -> TokenStream {
    match &context.names.patterns[0].module {
        Some(module) => quote!(super::#module::Pattern),
        None => quote!(super::Pattern),
    }
}

/// The methods that do not depend on the motion.
fn machine(context: &Context<'_>, plan: &RunPlan<'_>) -> TokenStream {
    let handed = context.constants_handed_on();
    let argument = context.constants_argument();
    let lines = count(plan.lines());
    let evaluation = &plan.source.plan.evaluation;
    let channels = count(evaluation.coordinates.len() + evaluation.inputs.len());
    let measured: Vec<TokenStream> = (0..evaluation.coordinates.len()).map(|i| indexed("measured", i)).collect();
    let reference: Vec<TokenStream> = (0..evaluation.coordinates.len()).map(|i| indexed("reference", i)).collect();
    let tracking: Vec<TokenStream> = (0..evaluation.coordinates.len()).map(|i| indexed("tracking", i)).collect();
    let applied: Vec<TokenStream> = (0..evaluation.inputs.len()).map(|i| indexed("applied", i)).collect();
    let limit: Vec<TokenStream> = (0..evaluation.inputs.len()).map(|i| indexed("limits", i)).collect();
    quote! {
        impl<'s, T: Real> Campaign<'s, T> {
            /// A campaign with these estimates to begin with, before its first sample: the machine rests where the pattern is with
            /// amplitudes of zero.
            ///
            /// # Errors
            /// [`RunFault::Periods`] unless the measured periods are even and at least four, [`RunFault::Samples`] when a period of a
            /// stage has too few samples, or there is no stage.
            pub fn new(
                stages: &'s [Stage<T>],
                rules: CampaignRules<T>,
                sampling: RunSampling<T>,
                limits: Limits<T>,
                prior: Parameters<T>,
                #handed
            ) -> Result<Self, RunFault> {
                let first = stages.first().ok_or(RunFault::Samples)?;
                for stage in stages {
                    RunLines::<T, #channels, #lines>::check(stage.samples_per_period, rules.periods)?;
                }
                let rest = Command { reference: Measured::default(), feed_forward: Applied::default() };
                let mut this = Self {
                    stages,
                    order: CampaignOrder::new(rules, stages.len(), first.samples_per_period),
                    rules,
                    limits,
                    estimator: Estimator::new(first.samples_per_period, rules.periods, sampling, None)?,
                    pool: RunPool::new(prior.into_array()),
                    parameters: prior,
                    estimate: None,
                    command: rest,
                    number: 0,
                };
                this.command = this.play(#argument);
                Ok(this)
            }

            /// Reference and feed-forward of the present sample.
            #[must_use]
            pub fn command(&self) -> Command<T> {
                self.command
            }

            /// Where the campaign is.
            #[must_use]
            pub fn phase(&self) -> CampaignPhase {
                self.order.phase()
            }

            /// Runs that were begun.
            #[must_use]
            pub fn runs(&self) -> u32 {
                self.order.runs()
            }

            /// The present estimates: the prior where no run has shown a parameter.
            #[must_use]
            pub fn parameters(&self) -> Parameters<T> {
                self.parameters
            }

            /// What all runs together say; nothing before the first update.
            #[must_use]
            pub fn estimate(&self) -> Option<&Estimate<T>> {
                self.estimate.as_ref()
            }

            /// Takes in the present sample, with the inputs that are applied from then on, and goes on to the next one. A reading or an
            /// input that is not finite ends the campaign; a limit makes the next run smaller.
            pub fn push(&mut self, sample: &Sample<T>, #handed) -> CampaignPhase {
                let (measured, applied) = (sample.measured.into_array(), sample.applied.into_array());
                let reference = self.command.reference.into_array();
                let (limits, tracking) = (self.limits.inputs.into_array(), self.limits.tracking.into_array());
                let mut effort = T::ZERO;
                #(effort = effort.max(#applied.abs() / #limit);)*
                let mut within = effort < T::ONE;
                #(within &= (#measured - #reference).abs() <= #tracking;)*
                let numbers = [#(#measured,)* #(#applied),*];
                if !numbers.iter().all(|value| value.is_finite()) {
                    self.order.fail(RunFault::NotFinite { sample: self.number });
                } else if self.order.phase() == CampaignPhase::Measuring && within {
                    match self.estimator.push(self.number, sample) {
                        Ok(true) => self.order.run_is_whole(),
                        Ok(false) => self.number = self.number.saturating_add(1),
                        Err(fault) => self.order.fail(fault),
                    }
                }
                if self.order.advance(effort, !within) {
                    let stage = self.order.plays().0.stage;
                    let samples = self.stages.get(stage).map_or(0, |stage| stage.samples_per_period);
                    self.number = 0;
                    if let Err(fault) = self.estimator.begin(samples, self.rules.periods) {
                        self.order.fail(fault);
                    }
                }
                self.command = self.play(#argument);
                self.order.phase()
            }

            /// Makes the update that is due, and goes on to the next run. It takes longer than a sample: the pattern goes on while
            /// samples are pushed before it is called.
            pub fn update(&mut self, #handed) -> CampaignPhase {
                if self.order.phase() != CampaignPhase::Due {
                    return self.order.phase();
                }
                match self.estimator.estimate(#argument &self.parameters) {
                    Ok(mut estimate) => {
                        self.pool.add(&mut estimate.equations, &estimate.about, estimate.chi_squared);
                        let pooled = Estimate::of(self.pool.shown(estimate.noise.into_array()));
                        estimate = Estimate { chi_squared: estimate.chi_squared, ..pooled };
                        self.parameters = Parameters::from_array(self.pool.moved());
                        self.estimate = Some(estimate);
                        let next = self.stages.get(self.order.plays().0.stage + 1);
                        self.order.updated(next.map_or(0, |stage| stage.samples_per_period));
                    }
                    Err(fault) => self.order.fail(fault),
                }
                self.order.phase()
            }

            /// Ends the campaign: the machine passes to rest while further samples are pushed.
            pub fn stop(&mut self) {
                self.order.stop();
            }
        }
    }
}

/// The method that gives reference and feed-forward.
fn command(context: &Context<'_>, plan: &RunPlan<'_>, names: &Names, campaign: &CampaignPlan<'_>) -> TokenStream {
    let handed = context.constants_handed_on();
    let argument = context.constants_argument();
    let own = &context.names;
    let pattern_names = &own.patterns[0];
    let pattern_plan = &context.estimator.plan.patterns[0];
    let frequency = pattern_names.frequency(pattern_plan);
    let amplitudes = pattern_names.fields.iter().filter(|(symbol, _)| *symbol != pattern_plan.frequency);
    let amplitudes: Vec<&Ident> = amplitudes.map(|(_, name)| name).collect();
    let order = context.estimator.plan.evaluation.order() as usize;
    let entries = count(own.coordinates.len() * (order + 1));
    let coordinates = count(own.coordinates.len());
    // The parameters of the equations that give the feed-forward.
    let lumped = match context.estimator.model.eliminations.is_empty() {
        false => {
            let fields = own.physical.iter().map(|(_, field)| quote!(#field: parameters.#field));
            quote!(super::Physical { #(#fields),* }.lump(#argument))
        }
        true => {
            let fields = own.columns.iter().map(|field| quote!(#field: parameters.#field));
            quote!(super::Parameters { #(#fields),* })
        }
    };
    let inputs = own.inputs.iter().map(|(_, name)| quote!(#name: inputs.#name));
    let references = plan.source.plan.evaluation.coordinates.iter().zip(&names.coordinates).map(|(&(of, _), names)| {
        let field = &names.field;
        match campaign.reconstruction(of) {
            Some(plan) => reconstruction(context, field, plan),
            None => {
                let own = own.coordinates.iter().find(|own| own.coordinate == of);
                let own = own.map_or(field, |own| &own.field);
                let position = derivative_field(0);
                quote!(let #field = motion.#own.#position;)
            }
        }
    });
    let references: Vec<TokenStream> = references.collect();
    let fields: Vec<&Ident> = names.coordinates.iter().map(|names| &names.field).collect();
    quote! {
        impl<'s, T: Real> Campaign<'s, T> {
            /// The motion of a pattern while it is played.
            fn motion(&self, #handed play: &Play<T>) -> [T; #entries] {
                let Some(stage) = self.stages.get(play.stage) else { return [T::ZERO; #entries] };
                let mut pattern = stage.pattern;
                let period = T::from_f64(f64::from(stage.samples_per_period)) * self.estimator.sampling.sample_time;
                pattern.#frequency = T::from_f64(2.0) * T::PI / period;
                #(pattern.#amplitudes *= play.share;)*
                pattern.reference_at(#argument play.phase()).into_array()
            }

            /// Reference and feed-forward of the present sample.
            fn play(&self, #handed) -> Command<T> {
                let (now, before) = self.order.plays();
                let step = self.order.passage_step() / self.estimator.sampling.sample_time;
                let mut motion = self.motion(#argument &now);
                passing(&self.motion(#argument &before), &mut motion, #coordinates, self.order.passage_at(), step);
                let motion = super::Motion::from_array(&motion);
                let parameters = &self.parameters;
                let inputs = super::feed_forward(&motion, &#lumped, #argument);
                #(#references)*
                Command {
                    reference: Measured { #(#fields),* },
                    feed_forward: Applied { #(#inputs),* },
                }
            }
        }
    }
}

/// The reference of an eliminated coordinate.
fn reconstruction(context: &Context<'_>, field: &Ident, plan: &Plan) -> TokenStream {
    let owner = ident("parameters");
    let fields = &context.names.physical;
    let writer = Writer::new(|leaf: &Leaf| match *leaf {
        Leaf::Symbol(symbol) => match &context.estimator.model.quantity(symbol).kind {
            Kind::Constant { value: Some(value) } => number(value),
            _ => context.leaf(leaf, &owner, fields),
        },
        _ => context.leaf(leaf, &owner, fields),
    });
    let (statements, values) = Reader::new(plan).outputs();
    let statements = writer.statements(context, &statements, |_, _| TokenStream::new());
    let value = values.first().map(|value| writer.expression(value));
    quote! {
        let #field = {
            #statements
            #value
        };
    }
}

/// An entry of an array.
fn indexed(name: &str, index: usize) -> TokenStream {
    let (name, index) = (ident(name), count(index));
    quote!(#name[#index])
}
