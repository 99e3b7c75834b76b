//! The part of a module that follows from a trajectory pattern: reference motion, estimator matrix, harmonics, solve.

use proc_macro2::{Ident, TokenStream};
use quote::quote;
use std::collections::BTreeSet;
use tpm_symbolic::estimator::{Leaf, PatternPlan, TablePlan, entry_formula};
use tpm_symbolic::fourier::Trig;
use tpm_symbolic::plan::Plan;
use tpm_symbolic::table::Entry;

use super::super::estimator::gaps;
use super::super::number::Rounded;
use super::expression::{PlanWriter, literal, literal_single};
use super::names::{PatternNames, derivative_field, harmonic_field, harmonic_function, ident};
use super::record::{Field, count, doc, locals, record};
use super::{Context, text};

/// Entries of the estimator matrix up to which it is straight-line code; beyond, it is a table and a loop.
pub(super) const STRAIGHT_LINE_ENTRIES: usize = 400;

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
                let remarks = gaps(pattern).into_iter().chain(text::approximations(context.estimator, pattern));
                remarks.for_each(|remark| about.push_str(&format!("\n{remark}\n")));
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

/// What a pattern's own module takes from around it.
fn imports(context: &Context<'_>, pattern: &PatternPlan) -> TokenStream {
    let runtime = &context.runtime;
    let mut own: BTreeSet<Ident> = BTreeSet::new();
    let mut root: BTreeSet<&str> = BTreeSet::from(["Real"]);
    let mut harmonics = quote!();
    if pattern.reference.is_ok() {
        own.insert(ident("Motion"));
        own.extend(context.names.coordinates.iter().map(|names| names.motion_type.clone()));
    }
    if pattern.table.is_ok() {
        own.extend(["Forces", "PARAMETERS", "Parameters"].map(ident));
        root.extend(["SolveError", "least_squares"]);
        harmonics = quote!(use #runtime::harmonics::AccumulatorError;);
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
    let model = &context.estimator.model;
    let fields: Vec<Field> = names
        .fields
        .iter()
        .map(|(symbol, name)| {
            let quantity = model.quantity(*symbol);
            let what = if *symbol == pattern.frequency { "Fundamental angular frequency" } else { "Amplitude" };
            let doc = format!("{what} `{}`{}.", quantity.name, text::in_unit(quantity.unit.as_ref()));
            Field { ident: name.clone(), doc }
        })
        .collect();
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
        rest.extend(harmonics(context, table));
        rest.extend(solve(context, table));
    }
    quote! {
        #structure

        impl<T: Real> Pattern<T> {
            #methods
        }

        #rest
    }
}

fn frequency(pattern: &PatternPlan, names: &PatternNames) -> Ident {
    let found = names.fields.iter().find(|(symbol, _)| *symbol == pattern.frequency);
    found.expect("invariant: a pattern has its frequency").1.clone()
}

fn period(pattern: &PatternPlan, names: &PatternNames) -> TokenStream {
    let w = frequency(pattern, names);
    quote! {
        /// One period of the motion in seconds.
        #[must_use]
        pub fn period(&self) -> T {
            T::from_f64(2.0) * T::PI / self.#w
        }
    }
}

/// Which of cos w t and sin w t a plan reads.
fn phase_functions(context: &Context<'_>, plan: &Plan) -> (bool, bool) {
    let reads = |leaf: Leaf| plan.inputs.iter().any(|node| context.estimator.plan.leaves.leaf(node) == leaf);
    (reads(Leaf::Cos), reads(Leaf::Sin))
}

fn reference(context: &Context<'_>, plan: &Plan, pattern: &PatternPlan, names: &PatternNames) -> TokenStream {
    let w = frequency(pattern, names);
    let owner = ident("self");
    let (statements, values) = PlanWriter::new(plan, |node| context.leaf(node, &owner, &names.fields)).outputs();
    let mut values = values.into_iter();
    let coordinates = context.names.coordinates.iter().map(|coordinate| {
        let (field, motion_type) = (&coordinate.field, &coordinate.motion_type);
        let derivatives = (0..=coordinate.order).map(derivative_field);
        let entries = derivatives.zip(values.by_ref().take(coordinate.order as usize + 1));
        let entries = entries.map(|(derivative, value)| quote!(#derivative: #value));
        quote!(#field: #motion_type { #(#entries),* })
    });
    let coordinates: Vec<TokenStream> = coordinates.collect();
    let phase = match phase_functions(context, plan) {
        (true, true) => quote!(let (sin, cos) = phase.sin_cos();),
        (true, false) => quote!(let cos = phase.cos();),
        (false, true) => quote!(let sin = phase.sin();),
        (false, false) => quote!(let _ = phase;),
    };
    let constants = context.constants_parameter(context.sources(&[plan]).constants);
    let outer = context.constants_parameter(true);
    let argument = context.constants_argument();
    let about = doc(&format!(
        "The reference motion at a phase `{}*t` in radians, with every derivative that the equations read.{}, one sine and cosine.",
        context.estimator.model.quantity(pattern.frequency).name,
        text::operations(plan).trim_end_matches('.')
    ));
    quote! {
        /// The reference motion at a time in seconds. Reduce long times to one period, so that the phase keeps its digits.
        #[must_use]
        pub fn reference(&self, #outer time: T) -> Motion<T> {
            self.reference_at(#argument self.#w * time)
        }

        #about
        #[must_use]
        pub fn reference_at(&self, #constants phase: T) -> Motion<T> {
            #phase
            #statements
            Motion { #(#coordinates),* }
        }
    }
}

/// A table row as text: `u, cos 3`.
fn row_text(table: &TablePlan, row: usize) -> String {
    let (equation, harmonic, function) = table.rows[row];
    format!("{}, {} {harmonic}", table.table.equations[equation], harmonic_function(function))
}

/// The exact formula of a place of the table.
fn formula(table: &TablePlan, row: usize, column: Option<usize>) -> String {
    let (equation, harmonic, function) = table.rows[row];
    let mut text = String::new();
    for entry in table.table.at(equation, harmonic, function, column) {
        let term = entry_formula(&table.table, &entry);
        match term.strip_prefix('-') {
            _ if text.is_empty() => text.push_str(&term),
            Some(positive) => text.push_str(&format!(" - {positive}")),
            None => text.push_str(&format!(" + {term}")),
        }
    }
    text
}

fn estimator_matrix(context: &Context<'_>, table: &TablePlan, names: &PatternNames) -> TokenStream {
    let (rows, columns) = (count(table.rows.len()), count(context.estimator.form.columns.len()));
    let constants = context.constants_parameter(context.sources(&[&table.matrix]).constants);
    let entries = table.places.iter().filter(|(_, column)| column.is_some()).count();
    let about = "The estimator matrix B Lambda: the exact harmonic coefficients of every parameter's regressor.\n\n\
                 Rows are in the order of [`Harmonics`], columns in the order of [`Parameters`].";
    if entries > STRAIGHT_LINE_ENTRIES {
        let about = doc(&format!(
            "{about}\n\nIts {entries} entries are a table and a loop; as straight-line code they would be long."
        ));
        let body = looped(context, table, names, &|entry| entry.column);
        return quote! {
            #about
            #[must_use]
            pub fn estimator_matrix(&self, #constants) -> [[T; #columns]; #rows] {
                let mut matrix = [[T::ZERO; #columns]; #rows];
                #body
                for &(row, column, double, single, powers) in &ENTRIES {
                    let value = term(double, single, &powers);
                    if let Some(entry) = matrix.get_mut(usize::from(row)).and_then(|row| row.get_mut(usize::from(column))) {
                        *entry += value;
                    }
                }
                matrix
            }
        };
    }
    let about = doc(&format!("{about}{}", text::operations(&table.matrix)));
    let owner = ident("self");
    let mut writer = PlanWriter::new(&table.matrix, |node| context.leaf(node, &owner, &names.fields));
    let mut body = TokenStream::new();
    for (output, &(row, column)) in table.places.iter().enumerate() {
        let (statements, value) = writer.output(output);
        body.extend(match column {
            None => statements,
            Some(column) => {
                let name = &context.estimator.form.columns[column].name;
                let comment =
                    context.comment(format!("{}, {name}: {}", row_text(table, row), formula(table, row, Some(column))));
                let (row, column) = (count(row), count(column));
                quote!(#comment #statements matrix[#row][#column] = #value;)
            }
        });
    }
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
fn looped(
    context: &Context<'_>,
    table: &TablePlan,
    names: &PatternNames,
    column_of: &dyn Fn(&Entry) -> Option<usize>,
) -> TokenStream {
    let entries: Vec<Entry> = table.table.entries().filter(|entry| column_of(entry).is_some()).collect();
    let mut bases: BTreeSet<(bool, Option<usize>)> = BTreeSet::new();
    for entry in &entries {
        bases.extend(entry.powers.factors().map(|(&symbol, _)| (false, Some(symbol))));
        bases.extend(entry.sign.factors().map(|(&symbol, _)| (true, Some(symbol))));
        if entry.pi != 0 {
            bases.insert((false, None));
        }
    }
    let owner = ident("self");
    let base_values = bases.iter().map(|&(sign, symbol)| match symbol {
        None => quote!(T::PI),
        Some(symbol) => {
            let symbol = tpm_symbolic::expr::Symbol(u32::try_from(symbol).expect("invariant: symbols are 32 bits"));
            let value = context.leaf(&tpm_symbolic::expr::Node::Symbol(symbol), &owner, &names.fields);
            if sign { quote!(#value.sign()) } else { value }
        }
    });
    let base_values: Vec<TokenStream> = base_values.collect();
    let rows = entries.iter().map(|entry| {
        let row = table.rows.iter().position(|row| *row == (entry.equation, entry.harmonic, entry.function));
        let row = count(row.expect("invariant: every entry has its row"));
        let column = count(column_of(entry).unwrap_or(0));
        let rounded = Rounded::new(&entry.coefficient);
        let (double, single) = (literal(rounded.double), literal_single(rounded.single));
        let powers = bases.iter().map(|&(sign, symbol)| {
            let power = match (sign, symbol) {
                (false, None) => entry.pi,
                (false, Some(symbol)) => entry.powers.exponent(&symbol),
                (true, symbol) => symbol.map_or(0, |symbol| entry.sign.exponent(&symbol) % 2),
            };
            proc_macro2::Literal::i32_unsuffixed(power)
        });
        quote!((#row, #column, #double, #single, [#(#powers),*]))
    });
    let (length, bases_count) = (count(entries.len()), count(bases.len()));
    let order: Vec<String> = bases
        .iter()
        .map(|&(sign, symbol)| match symbol {
            None => "pi".to_owned(),
            Some(symbol) if sign => format!("sign({})", table.table.symbols[symbol]),
            Some(symbol) => table.table.symbols[symbol].to_string(),
        })
        .collect();
    let comment = context
        .comment(format!("Row, column, coefficient in double and single precision, powers of {}.", order.join(", ")));
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
    let known = table.places.iter().enumerate().filter(|(_, (_, column))| column.is_none());
    let known: Vec<(usize, usize)> = known.map(|(output, &(row, _))| (output, row)).collect();
    if known.is_empty() {
        return TokenStream::new();
    }
    let rows = count(table.rows.len());
    let constants = context.constants_parameter(context.sources(&[&table.matrix]).constants);
    let body = if known.len() > STRAIGHT_LINE_ENTRIES {
        let looped = looped(context, table, names, &|entry| entry.column.map_or(Some(0), |_| None));
        quote! {
            #looped
            for &(row, _, double, single, powers) in &ENTRIES {
                let value = term(double, single, &powers);
                if let Some(entry) = harmonics.get_mut(usize::from(row)) {
                    *entry += value;
                }
            }
        }
    } else {
        // The matrix's plan restricted to these outputs, so that nothing is computed for the others.
        let mut merger = tpm_symbolic::plan::Merger::default();
        let slots = merger.append(&table.matrix);
        let plan = merger.finish(known.iter().map(|&(output, _)| slots[output]).collect());
        let owner = ident("self");
        let mut writer = PlanWriter::new(&plan, |node| context.leaf(node, &owner, &names.fields));
        let mut body = TokenStream::new();
        for (output, &(_, row)) in known.iter().enumerate() {
            let comment = context.comment(format!("{}: {}", row_text(table, row), formula(table, row, None)));
            let (statements, value) = writer.output(output);
            let row = count(row);
            body.extend(quote!(#comment #statements harmonics[#row] = #value;));
        }
        body
    };
    quote! {
        /// Harmonics of the terms without an unknown parameter, on the left-hand side.
        #[must_use]
        pub fn known_harmonics(&self, #constants) -> Harmonics<T> {
            let mut harmonics = [T::ZERO; #rows];
            #body
            Harmonics::from_array(harmonics)
        }
    }
}

fn parameters(context: &Context<'_>, table: &TablePlan) -> TokenStream {
    let constants = context.constants_parameter(true);
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

/// The structures of harmonics, and what fills them from samples.
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
        let docs = rows.iter().map(|&row| {
            let (_, harmonic, function) = table.rows[row];
            doc(&match harmonic {
                0 => "Mean.".to_owned(),
                1 => format!("Factor of {}(w t).", harmonic_function(function)),
                _ => format!("Factor of {}({harmonic} w t).", harmonic_function(function)),
            })
        });
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
    let owner = ident("self");
    let (statements, values) = PlanWriter::new(&table.bank, |node| context.leaf(node, &owner, &[])).factors();
    let locals = locals(table.rows.len());
    let (reads_cos, reads_sin) = phase_functions(context, &table.bank);
    let cos = ident(if reads_cos { "cos" } else { "_cos" });
    let sin = ident(if reads_sin { "sin" } else { "_sin" });
    let products = table.rows.iter().zip(values).zip(&locals).map(|((&(equation, harmonic, function), value), sum)| {
        let field = &context.names.rows[equation].field;
        match (harmonic, function) {
            (0, Trig::Cos) => quote!(*#sum += sample.#field;),
            _ => quote!(*#sum += sample.#field * #value;),
        }
    });
    let scaled = table.rows.iter().zip(&locals).map(|(&(_, harmonic, _), local)| match harmonic {
        0 => quote!(let #local = #local * mean;),
        _ => quote!(let #local = #local * twice;),
    });
    let only_mean = table.rows.iter().all(|(_, harmonic, _)| *harmonic == 0);
    let twice = if only_mean { quote!() } else { quote!(let twice = mean + mean;) };
    let comment = "The phasor turns with every sample and is set anew now and then, before its rounding errors add up.";
    let comment = context.comment(comment.to_owned());
    quote! {
        /// Fourier sums of one signal per equation, sample by sample, over whole periods.
        ///
        /// Give it samples that divide a whole number of periods evenly, and then ask for the harmonics.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Accumulator<T> {
            sums: [T; HARMONICS],
            samples: u64,
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
                Self { sums: [T::ZERO; HARMONICS], samples: 0 }
            }

            /// Takes in one sample at a phase `w t` in radians.
            pub fn push(&mut self, phase: T, sample: &Forces<T>) {
                let (sin, cos) = phase.sin_cos();
                self.push_at(cos, sin, sample);
            }

            /// Takes in one sample where cosine and sine of the phase are known.
            pub fn push_at(&mut self, #cos: T, #sin: T, sample: &Forces<T>) {
                #statements
                let [#(#locals),*] = &mut self.sums;
                #(#products)*
                self.samples = self.samples.saturating_add(1);
            }

            /// Samples taken in so far.
            #[must_use]
            pub fn samples(&self) -> u64 {
                self.samples
            }

            /// The harmonics of the samples so far; `None` before the first one.
            #[must_use]
            pub fn harmonics(&self) -> Option<Harmonics<T>> {
                if self.samples == 0 {
                    return None;
                }
                let mean = T::ONE / T::from_f64(self.samples as f64);
                #twice
                let [#(#locals),*] = self.sums;
                #(#scaled)*
                Some(Harmonics::from_array([#(#locals),*]))
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
            let angle = |index: usize| {
                T::from_f64(2.0 * ::core::f64::consts::PI * (index as f64 / samples.len() as f64)).sin_cos()
            };
            let (step_sin, step_cos) = angle(1);
            let (mut sin, mut cos) = (T::ZERO, T::ONE);
            let mut accumulator = Accumulator::new();
            for (index, sample) in samples.iter().enumerate() {
                #comment
                if index % 64 == 0 {
                    (sin, cos) = angle(index);
                }
                accumulator.push_at(cos, sin, sample);
                (sin, cos) = (sin * step_cos + cos * step_sin, cos * step_cos - sin * step_sin);
            }
            accumulator.harmonics().ok_or(too_few)
        }
    }
}
