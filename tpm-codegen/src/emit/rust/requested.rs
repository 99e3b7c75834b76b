//! Functions that are emitted on request: forces at rest, mass matrix, forward dynamics, regressor and estimator in
//! base parameters.

use proc_macro2::{Ident, TokenStream};
use quote::quote;

use super::super::function::{Body, Function};
use super::super::requested;
use super::super::text;
use super::context::Context;
use super::expression::{Writer, literal};
use super::names::ident;
use super::record::{Field, count, doc, record};
use super::shapes::{arguments, force_fields, label, matrix, quantity_fields, structure};

/// The names that the module imports from the runtime for these functions.
pub(super) fn imports(context: &Context<'_>) -> Vec<&'static str> {
    let parts = &context.estimator.parts;
    let mut names = Vec::new();
    if let Some(forward) = &parts.forward_dynamics {
        names.extend(["SingularMass", "accelerations"]);
        names.extend(forward.factored.then_some("factors_hold"));
    }
    if parts.estimator {
        names.extend(["SampleFault", "SquareRoot"]);
    }
    if parts.monitor {
        names.extend(["MonitorFault", "MonitorPhase", "MonitorState", "Monitoring"]);
    }
    names
}

/// All items of the requested parts.
pub(super) fn items(context: &Context<'_>) -> TokenStream {
    let parts = [gravity, mass_matrix, forward_dynamics, base, estimator, monitor];
    parts.into_iter().map(|part| part(context)).collect()
}

fn gravity(context: &Context<'_>) -> TokenStream {
    let Some(function) = requested::gravity(context.estimator) else { return TokenStream::new() };
    structure(context, "gravity", &function, true, force_fields(context))
}

fn mass_matrix(context: &Context<'_>) -> TokenStream {
    let Some(function) = requested::mass_matrix(context.estimator) else { return TokenStream::new() };
    let arguments = arguments(context, function.reads, true);
    matrix(context, "mass_matrix", &function, arguments, context.names.coordinates.len())
}

fn forward_dynamics(context: &Context<'_>) -> TokenStream {
    let Some(Function { about, reads, body: Body::Values(statements, values) }) =
        requested::forward_dynamics(context.estimator)
    else {
        return TokenStream::new();
    };
    let names = &context.names;
    let fields: Vec<Field> = names
        .coordinates
        .iter()
        .map(|names| Field {
            ident: names.field.clone(),
            doc: text::derivative(context.estimator, names.coordinate, names.order),
        })
        .collect();
    let accelerations = record(&ident("Accelerations"), "The highest time derivative of every coordinate.", &fields);
    // Where an input does not follow from a single equation there is no feed-forward, which defines this structure
    // otherwise.
    let inputs = match context.estimator.plan.feed_forward {
        Some(_) => TokenStream::new(),
        None => record(&ident("Inputs"), "The inputs.", &quantity_fields(context, &names.inputs)),
    };
    let owner = ident("inputs");
    let writer = Writer::new(|leaf| context.leaf(leaf, &owner, &names.inputs));
    let statements = writer.statements(context, &statements, |_, _| TokenStream::new());
    let values: Vec<TokenStream> = values.iter().map(|value| writer.expression(value)).collect();
    let size = names.coordinates.len();
    let (rows, rest) = values.split_at(size * size);
    let (right, solved) = rest.split_at(size);
    let by_factors = match solved.split_at_checked(size) {
        Some((pivots, solved)) => {
            let diagonal = (0..size).map(|k| &rows[k * size + k]);
            quote! {
                let solved = [#(#solved),*];
                if factors_hold(&[#(#pivots),*], &[#(#diagonal),*], &solved) {
                    return Ok(Accelerations::from_array(solved));
                }
            }
        }
        None => TokenStream::new(),
    };
    let rows = rows.chunks(size).map(|row| quote!([#(#row),*]));
    let about = doc(&format!(
        "{about}\n\n# Errors\n[`SingularMass`] when the mass matrix is singular with these parameters, or a number is not finite."
    ));
    let used = |name: &str, read: bool| if read { ident(name) } else { ident(&format!("_{name}")) };
    let (motion, inputs_name) = (used("motion", reads.motion), used("inputs", reads.own));
    let parameters = used("parameters", reads.parameters);
    let constants = context.constants_parameter(reads);
    quote! {
        #accelerations
        #inputs

        #about
        pub fn forward_dynamics<T: Real>(
            #motion: &Motion<T>,
            #inputs_name: &Inputs<T>,
            #parameters: &Parameters<T>,
            #constants
        ) -> Result<Accelerations<T>, SingularMass> {
            #statements
            #by_factors
            let matrix = [#(#rows),*];
            let right = [#(#right),*];
            accelerations(matrix, right, &COORDINATES).map(Accelerations::from_array)
        }
    }
}

/// Names of the fields of the base parameters.
fn base_fields<'a>(context: &'a Context<'_>) -> Vec<&'a Ident> {
    let base = context.estimator.parts.base.iter().flat_map(|base| &base.parameters);
    base.map(|base| &context.names.columns[base.column]).collect()
}

fn base(context: &Context<'_>) -> TokenStream {
    let estimator = context.estimator;
    let (Some(function), Some(Function { about, body: Body::Values(statements, values), .. })) =
        (requested::base_regressor(estimator), requested::base(estimator))
    else {
        return TokenStream::new();
    };
    // The structure of the base parameters.
    let names = base_fields(context);
    let fields: Vec<Field> = names
        .iter()
        .enumerate()
        .map(|(index, &name)| Field { ident: name.clone(), doc: requested::base_parameter(estimator, index) })
        .collect();
    let parameters = record(
        &ident("BaseParameters"),
        "The base parameters: the combinations of parameters on which the forces of all motions depend, each named by the\n\
         parameter that leads it.",
        &fields,
    );
    // Their labels, and their regressor.
    let label_type = ident("Label");
    let columns = estimator.parts.base.iter().flat_map(|base| &base.parameters).map(|base| base.column);
    let labels: Vec<TokenStream> = columns
        .enumerate()
        .map(|(index, column)| {
            label(&label_type, &requested::combination(estimator, index), estimator.form.columns[column].unit.as_ref())
        })
        .collect();
    let length = count(labels.len());
    let arguments = arguments(context, function.reads, false);
    let regressor = matrix(context, "base_regressor", &function, arguments, names.len());
    // Conversions from and to the parameters of the columns.
    let owner = ident("self");
    let writer = Writer::new(|leaf| match *leaf {
        tpm_symbolic::plan::leaf::Leaf::Column(index) => {
            let column = &context.names.columns[index];
            quote!(self.#column)
        }
        _ => context.leaf(leaf, &owner, &[]),
    });
    let statements = writer.statements(context, &statements, |_, _| TokenStream::new());
    let values = values.iter().map(|value| writer.expression(value));
    let (about, representative) = (doc(&about), doc(requested::REPRESENTATIVE));
    let all = &context.names.columns;
    let given = requested::leading(estimator).into_iter().zip(all).map(|(place, column)| match place {
        Some(_) => quote!(self.#column),
        None => quote!(T::ZERO),
    });
    quote! {
        #parameters

        /// The base parameters as combinations, with their units.
        pub const BASE_PARAMETERS: [Label<'static>; #length] = [#(#labels),*];

        impl<T: Real> Parameters<T> {
            #about
            #[must_use]
            pub fn base(&self) -> BaseParameters<T> {
                #statements
                BaseParameters { #(#names: #values),* }
            }
        }

        impl<T: Real> BaseParameters<T> {
            #representative
            #[must_use]
            pub fn representative(&self) -> Parameters<T> {
                Parameters { #(#all: #given),* }
            }
        }

        #regressor
    }
}

fn estimator(context: &Context<'_>) -> TokenStream {
    if !context.estimator.parts.estimator {
        return TokenStream::new();
    }
    let names = base_fields(context);
    let (columns, rows) = (count(names.len()), count(context.names.rows.len()));
    let about = doc(requested::ESTIMATOR);
    let constants = context.constants_handed_on();
    let argument = context.constants_argument();
    let known = match requested::has_known(context.estimator) {
        true => quote!(known(motion, #argument).into_array()),
        false => quote!([T::ZERO; #rows]),
    };
    let fade = context.options.forgetting.then(|| {
        let about = doc(requested::FADE);
        quote! {
            #about
            pub fn fade(&mut self, share: T) {
                self.rows.fade(share);
            }
        }
    });
    quote! {
        #about
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct BaseEstimator<T> {
            rows: SquareRoot<T, #columns>,
        }

        impl<T: Real> Default for BaseEstimator<T> {
            fn default() -> Self {
                Self::new()
            }
        }

        impl<T: Real> BaseEstimator<T> {
            /// No sample yet.
            #[must_use]
            pub fn new() -> Self {
                Self { rows: SquareRoot::default() }
            }

            /// Takes in the motion and the applied forces B u of one instant, every equation with the standard deviation of its
            /// error, or all alike when `deviations` is nothing.
            ///
            /// # Errors
            /// [`SampleFault::NotFinite`] when a number is not finite or a deviation is zero, [`SampleFault::StandsOut`] when an equation leaves
            /// 50 times what those before it leave on the average. The sample is left out then, in the latter case at most one of a hundred,
            /// so that a machine that changes is followed. An equation whose deviation is infinite says nothing.
            pub fn push(
                &mut self,
                motion: &Motion<T>,
                forces: &Forces<T>,
                deviations: Option<&Forces<T>>,
                #constants
            ) -> Result<(), SampleFault> {
                take_rows(&mut self.rows, motion, forces, deviations, #argument)
            }

            #fade

            /// What the samples so far show.
            #[must_use]
            pub fn estimate(&self) -> BaseEstimate<T> {
                let shown = self.rows.solution();
                BaseEstimate {
                    parameters: BaseParameters::from_array(shown.solution),
                    deviations: BaseParameters::from_array(shown.deviations),
                    rank: shown.rank,
                    residual: shown.residual,
                    condition: shown.condition,
                    rows: self.rows.rows(),
                }
            }
        }

        /// Takes the equations of one instant into a factor.
        fn take_rows<T: Real>(
            rows: &mut SquareRoot<T, #columns>,
            motion: &Motion<T>,
            forces: &Forces<T>,
            deviations: Option<&Forces<T>>,
            #constants
        ) -> Result<(), SampleFault> {
            let mut matrix = base_regressor(motion, #argument);
            let mut right = forces.into_array();
            let known = #known;
            let deviations = deviations.map_or([T::ONE; #rows], |deviations| deviations.into_array());
            for (((row, right), known), deviation) in
                matrix.iter_mut().zip(&mut right).zip(known).zip(deviations)
            {
                *right = (*right - known) / deviation;
                row.iter_mut().for_each(|entry| *entry /= deviation);
            }
            if !matrix.as_flattened().iter().chain(&right).all(|value| value.is_finite()) {
                return Err(SampleFault::NotFinite);
            }
            let mut stands_out = false;
            for (mut row, right) in matrix.into_iter().zip(right) {
                stands_out |= rows.stands_out(&mut row, right);
            }
            if stands_out && rows.leaves_out() {
                return Err(SampleFault::StandsOut);
            }
            for (row, right) in matrix.iter_mut().zip(right) {
                let _ = rows.take(row, right);
            }
            Ok(())
        }

        /// What samples show of the base parameters.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct BaseEstimate<T> {
            /// The base parameters; nothing for those that the samples do not show yet.
            pub parameters: BaseParameters<Option<T>>,
            /// Their standard deviations, when the errors of the equations are independent and have the deviations that were given.
            /// Where none were given, `residual / sqrt(rows - rank)` times these.
            pub deviations: BaseParameters<Option<T>>,
            /// The number of directions that the samples show.
            pub rank: usize,
            /// Euclidean length of what is left of the forces, in deviations.
            pub residual: T,
            /// Of what is shown, the Frobenius norm of the matrix with columns of length 1, times that of its inverse: at least the
            /// condition number, and at most the rank times that.
            pub condition: T,
            /// The number of equations so far; past ones count less after a fading.
            pub rows: T,
        }

        impl<T: Real> BaseEstimate<T> {
            /// All base parameters; nothing while the samples do not show one of them.
            #[must_use]
            pub fn whole(&self) -> Option<BaseParameters<T>> {
                Some(BaseParameters { #(#names: self.parameters.#names?),* })
            }
        }
    }
}

fn monitor(context: &Context<'_>) -> TokenStream {
    if !context.estimator.parts.monitor {
        return TokenStream::new();
    }
    let (columns, rows) = (count(base_fields(context).len()), count(context.names.rows.len()));
    let about = doc(requested::MONITOR);
    let constants = context.constants_handed_on();
    let argument = context.constants_argument();
    let support = match context.options.standalone {
        true => quote!(support),
        false => {
            let runtime = &context.runtime;
            quote!(#runtime::support)
        }
    };
    let jumps = requested::jumps(context.estimator);
    let signs = count(jumps.as_ref().map_or(1, |jumps| jumps.count));
    let flags: Vec<bool> = jumps.as_ref().map_or_else(Vec::new, |jumps| jumps.entries.clone());
    let size = base_fields(context).len();
    let flag_rows = (0..context.names.rows.len()).map(|row| {
        let flags = (0..size).map(|column| flags.get(row * size + column).copied().unwrap_or(false));
        quote!([#(#flags),*])
    });
    let (signs_function, arguments_of) = match &jumps {
        Some(jumps) => {
            let function = requested::jumping(context.estimator, jumps);
            let list = arguments(context, function.reads, false);
            (matrix(context, "base_jumps", &function, list, jumps.count), quote!(base_jumps(motion, #argument)))
        }
        None => (TokenStream::new(), quote!([[T::ONE]; #rows])),
    };
    let spread = requested::spread(context.estimator, context.options.identified).map(|spread| {
        let about = doc(requested::SPREAD);
        let rows = spread.iter().map(|row| {
            let entries = row.iter().map(|entry| literal(*entry));
            quote!([#(#entries),*])
        });
        quote! {
            #about
            pub const IDENTIFIED_SPREAD: [[f64; #columns]; #columns] = [#(#rows),*];
        }
    });
    quote! {
        #spread

        #signs_function

        /// Which entries of the regressor depend on a sign.
        const JUMPING: [[bool; #columns]; #rows] = [#(#flag_rows),*];

        /// What a monitor watches, and how; arrays in the order of [`BASE_PARAMETERS`] and of the equations.
        pub type MonitorRules<T> = #support::MonitorRules<T, #rows, #columns>;

        #about
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Monitor<T> {
            watch: Monitoring<T, #rows, #columns, #signs>,
        }

        impl<T: Real> Monitor<T> {
            /// Begins with the run-in.
            ///
            /// # Errors
            /// [`MonitorFault`] when the rules cannot be followed.
            pub fn new(rules: &MonitorRules<T>) -> Result<Self, MonitorFault> {
                rules.check()?;
                Ok(Self { watch: Monitoring::new(rules) })
            }

            /// Takes in the motion, as it is measured, of one instant while the machine stands still, before the run-in: what varies
            /// then is noise, which looks like a change of parameters where the machine moves little. Without any, the motion
            /// counts as exact.
            pub fn rest(&mut self, motion: &Motion<T>, #constants) {
                self.watch.rest(&mut base_regressor(motion, #argument), &#arguments_of, &JUMPING);
            }

            /// Takes in the motion and the applied forces B u of one instant, and tells what is known now. `whole` is false where
            /// the sample is missing, or where an input was at its limit, so that the applied force is not known.
            pub fn push(
                &mut self,
                motion: &Motion<T>,
                forces: &Forces<T>,
                whole: bool,
                #constants
            ) -> MonitorState<T> {
                let mut deviations = self.watch.rules.deviations;
                let (arguments, mut equations) = (#arguments_of, #rows);
                for (row, deviation) in deviations.iter_mut().enumerate() {
                    if self.watch.is_still(row, &arguments) {
                        *deviation = T::from_f64(f64::INFINITY);
                        equations -= 1;
                    }
                }
                let given = Forces::from_array(deviations);
                let taken = whole && take_rows(&mut self.watch.block, motion, forces, Some(&given), #argument).is_ok();
                match self.watch.count(taken, equations) {
                    MonitorPhase::LeftOut => MonitorState::LeftOut,
                    _ => self.watch.state(),
                }
            }

            /// Forgets evidence and alarm, and keeps what was measured at rest and in the run-in: after an alarm that was seen to.
            pub fn again(&mut self) {
                self.watch.again();
            }
        }
    }
}
