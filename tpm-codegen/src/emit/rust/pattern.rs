//! The part of a module that belongs to a trajectory pattern: reference motion, estimator matrix, harmonics, solution.

use proc_macro2::{Ident, TokenStream};
use quote::quote;
use std::collections::BTreeSet;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::pattern::PatternPlan;
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::plan::table::TablePlan;

use super::super::code::{Base, Level, Place, Table};
use super::super::function::{self, Body, Function};
use super::super::number::Rounded;
use super::super::text;
use super::context::Context;
use super::expression::{Writer, literal, literal_single};
use super::names::{PatternNames, derivative_field, harmonic_field, ident};
use super::record::{Field, count, doc, locals, record};
use super::shapes::stores;

/// The items of all patterns: in the module itself, or each in a module of its own when there are several.
pub(super) fn items(context: &Context<'_>) -> TokenStream {
    let mut all = TokenStream::new();
    for (index, (pattern, names)) in context.estimator.plan.patterns.iter().zip(&context.names.patterns).enumerate() {
        let items = pattern_items(context, index, pattern, names);
        all.extend(match &names.module {
            None => items,
            Some(module) => {
                let imports = imports(context, pattern);
                let name = pattern.name.clone().unwrap_or_else(|| (index + 1).to_string());
                let motions = text::motions(context.estimator, index);
                let mut about = format!("The pattern `{name}`.\n\n```text\n{motions}```\n");
                let remarks = text::remarks(context.estimator, pattern);
                remarks.iter().for_each(|remark| about.push_str(&format!("\n{remark}\n")));
                let about = doc(&about);
                quote! {
                    #about
                    pub mod #module {
                        #imports
                        #items
                    }
                }
            }
        });
    }
    all
}

/// The names that a pattern's own module imports from the surrounding module.
fn imports(context: &Context<'_>, pattern: &PatternPlan) -> TokenStream {
    let runtime = context.runtime_inside();
    let mut own: BTreeSet<Ident> = BTreeSet::new();
    let mut root: BTreeSet<&str> = BTreeSet::from(["Real"]);
    let mut harmonics = quote!();
    if pattern.reference.is_ok() {
        own.insert(ident("Motion"));
        own.extend(context.names.coordinates.iter().map(|names| names.motion_type.clone()));
    }
    if pattern.table.is_ok() {
        own.extend(["Forces", "PARAMETERS", "Parameters"].map(ident));
        root.extend(["SolveError", "least_squares", "weighted_least_squares"]);
        if context.options.standalone {
            root.insert("AccumulatorError");
        } else {
            harmonics = quote!(use #runtime::harmonics::AccumulatorError;);
        }
    }
    if context.has_constants() && (pattern.reference.is_ok() || pattern.table.is_ok()) {
        own.insert(ident("Constants"));
    }
    let root = root.into_iter().map(ident);
    let own = own.into_iter();
    let own = if own.len() > 0 { quote!(use super::{#(#own),*};) } else { quote!() };
    quote!(#own #harmonics use #runtime::{#(#root),*};)
}

fn pattern_items(context: &Context<'_>, index: usize, pattern: &PatternPlan, names: &PatternNames) -> TokenStream {
    let fields = names.fields.iter().map(|(symbol, name)| Field {
        ident: name.clone(),
        doc: text::pattern_symbol(context.estimator, pattern, *symbol),
    });
    let fields: Vec<Field> = fields.collect();
    let motions = text::motions(context.estimator, index);
    let about = format!("Amplitudes and frequency of the trajectory pattern\n\n```text\n{motions}```");
    let structure = record(&ident("Pattern"), &about, &fields);
    let mut methods = period(pattern, names);
    if let Ok(plan) = &pattern.reference {
        methods.extend(reference(context, plan, pattern, names));
    }
    let mut rest = TokenStream::new();
    if let Ok(table) = &pattern.table {
        methods.extend(estimator_matrix(context, table, names));
        methods.extend(known_harmonics(context, table, names));
        methods.extend(parameters(context, table));
        methods.extend(direct(context, pattern, table, names));
        rest.extend(harmonics(context, table));
        rest.extend(solve(context, table));
        rest.extend(estimate(context));
    }
    quote! {
        #structure

        impl<T: Real> Pattern<T> {
            #methods
        }

        #rest
    }
}

fn period(pattern: &PatternPlan, names: &PatternNames) -> TokenStream {
    let w = names.frequency(pattern);
    quote! {
        /// One period of the motion in seconds.
        #[must_use]
        pub fn period(&self) -> T {
            T::from_f64(2.0) * T::PI / self.#w
        }
    }
}

fn reference(context: &Context<'_>, plan: &Plan, pattern: &PatternPlan, names: &PatternNames) -> TokenStream {
    let Function { about, reads, body: Body::Values(statements, values) } =
        function::reference(context.estimator, pattern, plan)
    else {
        unreachable!("invariant: a motion is given all at once")
    };
    let w = names.frequency(pattern);
    let owner = ident("self");
    let writer = Writer::new(|leaf| context.leaf(leaf, &owner, &names.fields));
    let statements = writer.statements(context, &statements, |_, _| TokenStream::new());
    let mut values = values.iter().map(|value| writer.expression(value));
    let coordinates = context.names.coordinates.iter().map(|coordinate| {
        let (field, motion_type) = (&coordinate.field, &coordinate.motion_type);
        let derivatives = (0..=coordinate.order).map(derivative_field);
        let entries = derivatives.zip(values.by_ref().take(coordinate.order as usize + 1));
        let entries = entries.map(|(derivative, value)| quote!(#derivative: #value));
        quote!(#field: #motion_type { #(#entries),* })
    });
    let coordinates: Vec<TokenStream> = coordinates.collect();
    let cos = ident(if reads.cos { "cos" } else { "_cos" });
    let sin = ident(if reads.sin { "sin" } else { "_sin" });
    let at = doc(&function::reference_at(context.estimator, pattern));
    let constants = context.constants_parameter(reads);
    let outer = context.constants_handed_on();
    let argument = context.constants_argument();
    let about = doc(&about);
    let stroke = if context.options.strokes { stroke(context, pattern, names) } else { TokenStream::new() };
    quote! {
        /// The reference motion at a time in seconds. Reduce long times to one period, so that the phase keeps its digits.
        #[must_use]
        pub fn reference(&self, #outer time: T) -> Motion<T> {
            self.reference_at(#argument self.#w * time)
        }

        #at
        #[must_use]
        pub fn reference_at(&self, #outer phase: T) -> Motion<T> {
            let (sin, cos) = phase.sin_cos();
            self.reference_from(#argument cos, sin)
        }

        #about
        #[must_use]
        pub fn reference_from(&self, #constants #cos: T, #sin: T) -> Motion<T> {
            #statements
            Motion { #(#coordinates),* }
        }

        #stroke
    }
}

/// The method for a single stroke. Before and after the stroke the phase is held at its ends, where every derivative is
/// zero.
fn stroke(context: &Context<'_>, pattern: &PatternPlan, names: &PatternNames) -> TokenStream {
    let w = names.frequency(pattern);
    let about = doc(&function::stroke(context.estimator, pattern));
    let (outer, argument) = (context.constants_handed_on(), context.constants_argument());
    let derivatives = context.names.coordinates.iter().flat_map(|coordinate| {
        let field = &coordinate.field;
        let derivatives = (1..=coordinate.order).map(derivative_field);
        derivatives.map(move |derivative| quote!(motion.#field.#derivative = T::ZERO;))
    });
    quote! {
        #about
        #[must_use]
        pub fn stroke(&self, #outer time: T, from: T, to: T) -> Motion<T> {
            let phase = from + self.#w * time;
            if phase > from && phase < to {
                return self.reference_at(#argument phase);
            }
            let mut motion = self.reference_at(#argument if phase > from { to } else { from });
            #(#derivatives)*
            motion
        }
    }
}

fn estimator_matrix(context: &Context<'_>, table: &TablePlan, names: &PatternNames) -> TokenStream {
    let (rows, columns) = (count(table.rows.len()), count(context.names.columns.len()));
    let Function { about, reads, body } = function::estimator_matrix(context.estimator, table);
    let (about, constants) = (doc(&about), context.constants_parameter(reads));
    let body = match &body {
        Body::Table(table) => {
            let table = looped(context, table, names);
            quote! {
                #table
                for &(row, column, double, single, powers) in &ENTRIES {
                    let value = term(double, single, &powers);
                    if let Some(entry) = matrix.get_mut(usize::from(row)).and_then(|row| row.get_mut(usize::from(column))) {
                        *entry += value;
                    }
                }
            }
        }
        Body::Stores(statements) => {
            let owner = ident("self");
            stores(context, statements, &Writer::new(|leaf| context.leaf(leaf, &owner, &names.fields)), &[])
        }
        Body::Values(..) => unreachable!("invariant: a matrix is written entry by entry"),
    };
    quote! {
        #about
        #[must_use]
        pub fn estimator_matrix(&self, #constants) -> [[T; #columns]; #rows] {
            let mut matrix = [[T::ZERO; #columns]; #rows];
            #body
            matrix
        }
    }
}

/// The table of entries, the bases of their powers, and the closure that evaluates one entry.
fn looped(context: &Context<'_>, table: &Table, names: &PatternNames) -> TokenStream {
    let owner = ident("self");
    let base_values = table.bases.iter().map(|base| match base {
        Base::Pi => quote!(T::PI),
        Base::Symbol(symbol) => context.leaf(&Leaf::Symbol(*symbol), &owner, &names.fields),
        Base::Sign(symbol) => {
            let value = context.leaf(&Leaf::Symbol(*symbol), &owner, &names.fields);
            quote!(#value.sign())
        }
    });
    let base_values: Vec<TokenStream> = base_values.collect();
    let rows = table.terms.iter().map(|term| {
        let (row, column) = match term.place {
            Place::Entry(row, column) => (count(row), count(column)),
            Place::Value(row) => (count(row), count(0)),
        };
        let rounded = Rounded::new(&term.coefficient);
        let (double, single) = (literal(rounded.double), literal_single(rounded.single));
        let powers = term.powers.iter().map(|&power| proc_macro2::Literal::i32_unsuffixed(power));
        quote!((#row, #column, #double, #single, [#(#powers),*]))
    });
    let (length, bases_count) = (count(table.terms.len()), count(table.bases.len()));
    let comment = format!("Row, column, coefficient in double and single precision, powers of {}.", table.order);
    let comment = context.comment(comment);
    quote! {
        #comment
        const ENTRIES: [(u16, u16, f64, f32, [i32; #bases_count]); #length] = [#(#rows),*];
        let bases = [#(#base_values),*];
        let term = |double: f64, single: f32, powers: &[i32; #bases_count]| {
            let (mut above, mut below) = (T::rounded(double, single), T::ONE);
            for (&base, &power) in bases.iter().zip(powers) {
                if power < 0 {
                    below *= base.powi(power.unsigned_abs());
                } else {
                    above *= base.powi(power.unsigned_abs());
                }
            }
            above / below
        };
    }
}

fn known_harmonics(context: &Context<'_>, table: &TablePlan, names: &PatternNames) -> TokenStream {
    let Some(Function { about, reads, body }) = function::known_harmonics(context.estimator, table) else {
        return TokenStream::new();
    };
    let rows = count(table.rows.len());
    let (about, constants) = (doc(&about), context.constants_parameter(reads));
    let body = match &body {
        Body::Table(table) => {
            let table = looped(context, table, names);
            quote! {
                #table
                for &(row, _, double, single, powers) in &ENTRIES {
                    let value = term(double, single, &powers);
                    if let Some(entry) = harmonics.get_mut(usize::from(row)) {
                        *entry += value;
                    }
                }
            }
        }
        Body::Stores(statements) => {
            let owner = ident("self");
            let writer = Writer::new(|leaf| context.leaf(leaf, &owner, &names.fields));
            writer.statements(context, statements, |place, value| match place {
                Place::Value(row) => {
                    let row = count(row);
                    quote!(harmonics[#row] = #value;)
                }
                Place::Entry(..) => unreachable!("invariant: harmonics are no matrix"),
            })
        }
        Body::Values(..) => unreachable!("invariant: harmonics are written one by one"),
    };
    quote! {
        #about
        #[must_use]
        pub fn known_harmonics(&self, #constants) -> Harmonics<T> {
            let mut harmonics = [T::ZERO; #rows];
            #body
            Harmonics::from_array(harmonics)
        }
    }
}

fn parameters(context: &Context<'_>, table: &TablePlan) -> TokenStream {
    let constants = context.constants_handed_on();
    let argument = context.constants_argument();
    let known = table.places.iter().any(|(_, column)| column.is_none());
    let right = if known {
        quote! {
            let mut effort = effort.into_array();
            for (right, known) in effort.iter_mut().zip(self.known_harmonics(#argument).into_array()) {
                *right -= known;
            }
            let effort = &Harmonics::from_array(effort);
        }
    } else {
        quote!()
    };
    quote! {
        /// The parameters for which the harmonics of the pattern's own forces are `effort`, in the sense of least squares.
        ///
        /// # Errors
        /// When the pattern does not determine a parameter, or a number is not finite.
        pub fn parameters(&self, #constants effort: &Harmonics<T>) -> Result<Parameters<T>, SolveError> {
            #right
            solve(&self.estimator_matrix(#argument), effort)
        }

        /// The same with every harmonic counted by its standard deviation, or all alike when there are none, and how well the
        /// parameters are known.
        ///
        /// # Errors
        /// When the pattern does not determine a parameter, or a number is not finite.
        pub fn estimate(
            &self,
            #constants
            effort: &Harmonics<T>,
            deviations: Option<&Harmonics<T>>,
        ) -> Result<Estimate<T>, SolveError> {
            #right
            let deviations = deviations.map(|deviations| deviations.into_array());
            let found = weighted_least_squares(
                &self.estimator_matrix(#argument),
                &effort.into_array(),
                deviations.as_ref(),
                &PARAMETERS,
            )?;
            Ok(Estimate {
                parameters: Parameters::from_array(found.solution),
                covariance: found.covariance,
                residual: found.residual,
                condition: found.condition,
            })
        }
    }
}

/// The type of an estimate.
fn estimate(context: &Context<'_>) -> TokenStream {
    let columns = count(context.names.columns.len());
    quote! {
        /// What the harmonics say about the parameters.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Estimate<T> {
            /// The parameters.
            pub parameters: Parameters<T>,
            /// Their covariance in the order of the fields, when the harmonics' errors have the deviations that were given, or 1
            /// where none were.
            pub covariance: [[T; #columns]; #columns],
            /// Euclidean length of what is left of the harmonics, in deviations.
            pub residual: T,
            /// Frobenius norm of the matrix with columns of length 1, times that of its inverse: at least the condition number,
            /// and at most the number of parameters times that.
            pub condition: T,
        }
    }
}

/// The method that computes the parameters by the exact pseudo-inverse, where there is one.
fn direct(context: &Context<'_>, pattern: &PatternPlan, table: &TablePlan, names: &PatternNames) -> TokenStream {
    let Some(Function { about, reads, body: Body::Stores(statements) }) =
        function::direct(context.estimator, pattern, table)
    else {
        return TokenStream::new();
    };
    let owner = ident("self");
    let columns = &context.names.columns;
    let values: Vec<Ident> = locals(columns.len());
    let writer = Writer::new(|leaf| match *leaf {
        Leaf::Harmonic(row) => {
            let (equation, harmonic, function) = table.rows[row];
            let (field, harmonic) = (&context.names.rows[equation].field, harmonic_field(harmonic, function));
            quote!(effort.#field.#harmonic)
        }
        _ => context.leaf(leaf, &owner, &names.fields),
    });
    let body = stores(context, &statements, &writer, &values);
    let (about, constants) = (doc(&about), context.constants_parameter(reads));
    quote! {
        #about
        #[must_use]
        pub fn parameters_direct(&self, #constants effort: &Harmonics<T>) -> Parameters<T> {
            #body
            Parameters { #(#columns: #values),* }
        }
    }
}

fn solve(context: &Context<'_>, table: &TablePlan) -> TokenStream {
    let (rows, columns) = (count(table.rows.len()), count(context.estimator.form.columns.len()));
    quote! {
        /// Least squares: the parameters, or parameter errors, that take the harmonics nearest to `harmonics` through a matrix
        /// such as [`Pattern::estimator_matrix`].
        ///
        /// # Errors
        /// When the matrix does not determine a parameter, or a number is not finite.
        pub fn solve<T: Real>(
            matrix: &[[T; #columns]; #rows],
            harmonics: &Harmonics<T>,
        ) -> Result<Parameters<T>, SolveError> {
            least_squares(matrix, &harmonics.into_array(), &PARAMETERS).map(Parameters::from_array)
        }
    }
}

/// The structures of harmonics, and the functions that compute them from samples.
fn harmonics(context: &Context<'_>, table: &TablePlan) -> TokenStream {
    let mut types = TokenStream::new();
    let mut fields = TokenStream::new();
    let values = locals(table.rows.len());
    let mut built = TokenStream::new();
    let mut read = TokenStream::new();
    for (equation, names) in context.names.rows.iter().enumerate() {
        let rows: Vec<usize> = (0..table.rows.len()).filter(|&row| table.rows[row].0 == equation).collect();
        if rows.is_empty() {
            continue;
        }
        let (field, name) = (&names.field, &names.harmonics_type);
        let idents: Vec<Ident> = rows.iter().map(|&row| harmonic_field(table.rows[row].1, table.rows[row].2)).collect();
        let docs = rows.iter().map(|&row| doc(&text::harmonic(table.rows[row].1, table.rows[row].2)));
        let equation_name = &table.table.equations[equation];
        let about = doc(&format!("Harmonics of equation `{equation_name}`: those that its table has."));
        types.extend(quote! {
            #about
            #[derive(Clone, Copy, Debug, Default, PartialEq)]
            pub struct #name<T> {
                #(#docs pub #idents: T,)*
            }
        });
        let about = doc(&format!("Harmonics of equation `{equation_name}`."));
        fields.extend(quote!(#about pub #field: #name<T>,));
        let own = rows.iter().map(|&row| &values[row]);
        built.extend(quote!(#field: #name { #(#idents: #own),* },));
        read.extend(quote!(#(self.#field.#idents,)*));
    }
    let rows = count(table.rows.len());
    let highest = table.rows.iter().map(|(_, harmonic, _)| *harmonic).max().unwrap_or(0);
    let highest = count(highest);
    let accumulator = accumulator(context, table);
    quote! {
        /// Number of harmonics in the table, over all equations.
        pub const HARMONICS: usize = #rows;

        /// The highest harmonic of any equation.
        pub const HIGHEST_HARMONIC: usize = #highest;

        #types

        /// Harmonics of one signal per equation, those that the estimator matrix has a row for.
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct Harmonics<T> {
            #fields
        }

        impl<T> Harmonics<T> {
            /// From the order of the estimator matrix's rows.
            #[must_use]
            pub fn from_array(values: [T; HARMONICS]) -> Self {
                let [#(#values),*] = values;
                Self { #built }
            }

            /// In the order of the estimator matrix's rows.
            #[must_use]
            pub fn into_array(self) -> [T; HARMONICS] {
                [#read]
            }
        }

        #accumulator
    }
}

fn accumulator(context: &Context<'_>, table: &TablePlan) -> TokenStream {
    let (reads, statements, addends) = function::bank(context.estimator, table);
    let owner = ident("self");
    let writer = Writer::new(|leaf| context.leaf(leaf, &owner, &[]));
    let statements = writer.statements(context, &statements, |_, _| TokenStream::new());
    let locals = locals(table.rows.len());
    let cos = ident(if reads.cos { "cos" } else { "_cos" });
    let sin = ident(if reads.sin { "sin" } else { "_sin" });
    let storage = function::storage(table);
    let stored: Vec<&Ident> = storage.iter().map(|&place| &locals[place]).collect();
    // The sums of a sample, and the factors of the harmonics.
    let sums = addends.iter().zip(&locals).map(|(addend, sum)| {
        let addend = writer.at(addend, Level::Sum);
        quote!(*#sum += #addend;)
    });
    let scaled = table.rows.iter().zip(&stored).map(|(&(_, harmonic, _), local)| match harmonic {
        0 => quote!(let #local = #local * mean;),
        _ => quote!(let #local = #local * twice;),
    });
    let only_mean = table.rows.iter().all(|(_, harmonic, _)| *harmonic == 0);
    let twice = if only_mean { quote!() } else { quote!(let twice = mean + mean;) };
    let comment = "Measured from the nearer end of the period, so that the phase keeps its digits.";
    let comment = context.comment(comment.to_owned());
    let fields: Vec<&Ident> = context.names.rows.iter().map(|names| &names.field).collect();
    // Where requested, a method that reduces the weight of earlier samples.
    let (mut field, mut start, mut fade) = Default::default();
    let (mut empty, mut weight) = (quote!(self.samples == 0), quote!(T::from_f64(self.samples as f64)));
    let mut about = doc("Samples taken in so far.");
    if context.options.forgetting {
        field = quote! {
            /// How often the samples before the last fading count.
            faded: T,
        };
        start = quote!(faded: T::ZERO,);
        about = doc("Samples taken in since the last fading.");
        empty = quote!(self.samples == 0 && self.faded <= T::ZERO);
        weight = quote!((self.faded + #weight));
        let share = doc(function::FADE);
        fade = quote! {
            #share
            pub fn fade(&mut self, share: T) {
                self.faded = (self.faded + T::from_f64(self.samples as f64)) * share;
                self.samples = 0;
                for sum in &mut self.sums {
                    *sum *= share;
                }
            }
        };
    }
    quote! {
        /// Fourier sums of one signal per equation, sample by sample, over whole periods.
        ///
        /// Give it samples that divide a whole number of periods evenly, and then ask for the harmonics.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Accumulator<T> {
            sums: [T; HARMONICS],
            samples: u64,
            #field
        }

        impl<T: Real> Default for Accumulator<T> {
            fn default() -> Self {
                Self::new()
            }
        }

        impl<T: Real> Accumulator<T> {
            /// No sample yet.
            #[must_use]
            pub fn new() -> Self {
                Self { sums: [T::ZERO; HARMONICS], samples: 0, #start }
            }

            /// Takes in one sample at a phase `w t` in radians: one sine and one cosine for all harmonics, so that no error adds
            /// up from sample to sample.
            pub fn push(&mut self, phase: T, sample: &Forces<T>) {
                let (sin, cos) = phase.sin_cos();
                self.push_at(cos, sin, sample);
            }

            /// The same under a Hann window over so many whole periods, at least two: the sample counts `1 - cos(w t / periods)`
            /// times. What is no harmonic leaks less into the harmonics, at the price of some of the data.
            pub fn push_hann(&mut self, phase: T, periods: T, sample: &Forces<T>) {
                let weight = T::ONE - (phase / periods).cos();
                self.push(phase, &Forces { #(#fields: sample.#fields * weight),* });
            }

            /// Takes in one sample where cosine and sine of the phase are known.
            pub fn push_at(&mut self, #cos: T, #sin: T, sample: &Forces<T>) {
                #statements
                let [#(#locals),*] = &mut self.sums;
                #(#sums)*
                self.samples = self.samples.saturating_add(1);
            }

            #fade

            #about
            #[must_use]
            pub fn samples(&self) -> u64 {
                self.samples
            }

            /// The harmonics of the samples so far; `None` before the first one.
            #[must_use]
            pub fn harmonics(&self) -> Option<Harmonics<T>> {
                if #empty {
                    return None;
                }
                let mean = T::ONE / #weight;
                #twice
                let [#(#locals),*] = self.sums;
                #(#scaled)*
                Some(Harmonics::from_array([#(#stored),*]))
            }
        }

        /// The harmonics of one whole period of evenly spaced samples that begins at phase 0.
        ///
        /// # Errors
        /// When the samples are too few for the highest harmonic.
        pub fn harmonics<T: Real>(samples: &[Forces<T>]) -> Result<Harmonics<T>, AccumulatorError> {
            let too_few = AccumulatorError::TooFewSamples { samples: samples.len(), harmonics: HIGHEST_HARMONIC };
            if samples.len() <= 2 * HIGHEST_HARMONIC {
                return Err(too_few);
            }
            let mut accumulator = Accumulator::new();
            for (index, sample) in samples.iter().enumerate() {
                #comment
                let left = samples.len() - index;
                let place = if index <= left { index as f64 } else { -(left as f64) };
                let turns = place / samples.len() as f64;
                accumulator.push(T::from_f64(2.0 * ::core::f64::consts::PI * turns), sample);
            }
            accumulator.harmonics().ok_or(too_few)
        }
    }
}
