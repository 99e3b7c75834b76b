//! The part of a module that needs no pattern: names, motions, regressor, forces, the shared trait.

use num_traits::Zero;
use proc_macro2::{Ident, TokenStream};
use quote::quote;
use tpm_symbolic::expr::Symbol;
use tpm_symbolic::plan::{Op, Plan};
use tpm_symbolic::regressor::canonical;
use tpm_symbolic::unit::Unit;

use super::super::estimator::Estimator;
use super::expression::{PlanWriter, literal};
use super::names::{derivative_field, derivative_text, ident};
use super::record::{Field, count, doc, locals, record};
use super::{Context, text};

/// What the module takes from the runtime.
pub(super) fn imports(context: &Context<'_>) -> TokenStream {
    let runtime = &context.runtime;
    let model = ["fixed", "require_len", "store"];
    let mut root = vec!["Buffer", "Dims", "EvalError", "Label", "Model", "Real"];
    let table_here = context.names.patterns.iter().zip(&context.estimator.plan.patterns);
    let table_here = table_here.filter(|(names, pattern)| names.module.is_none() && pattern.table.is_ok());
    let harmonics = if table_here.count() > 0 {
        root.extend(["SolveError", "least_squares"]);
        quote!(use #runtime::harmonics::AccumulatorError;)
    } else {
        quote!()
    };
    let idents = |names: &[&str]| names.iter().map(|name| ident(name)).collect::<Vec<Ident>>();
    let (model, root) = (idents(&model), idents(&root));
    quote! {
        #harmonics
        use #runtime::model::{#(#model),*};
        use #runtime::{#(#root),*};
    }
}

/// All items.
pub(super) fn items(context: &Context<'_>) -> TokenStream {
    let parts = [
        model_type(context),
        labels(context),
        parameters(context),
        identified(context),
        constants(context),
        lumping(context),
        motion(context),
        forces(context),
        regressor(context),
        known(context),
        input_map(context),
        inverse_dynamics(context),
        feed_forward(context),
        feed_forward_parts(context),
        implementation(context),
    ];
    parts.into_iter().collect()
}

fn model_type(context: &Context<'_>) -> TokenStream {
    let name = &context.names.model_type;
    let about = doc(&format!("The model `{}`, as the runtime takes any model.", context.estimator.model.name));
    quote! {
        #about
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct #name;
    }
}

fn label(runtime_label: &Ident, name: &str, unit: Option<&Unit>) -> TokenStream {
    match unit.map(ToString::to_string) {
        Some(unit) => quote!(#runtime_label::new(#name, #unit)),
        None => quote!(#runtime_label::bare(#name)),
    }
}

fn labels(context: &Context<'_>) -> TokenStream {
    let Estimator { model, form, plan, .. } = context.estimator;
    let label_type = ident("Label");
    let quantities = |symbols: &[Symbol]| -> Vec<TokenStream> {
        let quantities = symbols.iter().map(|symbol| model.quantity(*symbol));
        quantities.map(|quantity| label(&label_type, &quantity.name, quantity.unit.as_ref())).collect()
    };
    let coordinates: Vec<TokenStream> = plan
        .evaluation
        .coordinates
        .iter()
        .map(|(coordinate, _)| {
            let info = &model.coordinates[coordinate.0 as usize];
            label(&label_type, &info.name, info.unit.as_ref())
        })
        .collect();
    let columns: Vec<TokenStream> =
        form.columns.iter().map(|column| label(&label_type, &column.name, column.unit.as_ref())).collect();
    let rows: Vec<TokenStream> =
        (0..form.rows.len()).map(|r| label(&label_type, &form.rows[r].name, row_unit(context.estimator, r))).collect();
    let lists = [
        ("COORDINATES", "Names and units of the coordinates.", coordinates),
        ("INPUTS", "Names and units of the inputs.", quantities(&plan.evaluation.inputs)),
        ("PARAMETERS", "Names and units of the parameters that are estimated.", columns),
        ("CONSTANTS", "Names and units of the constants known at run time.", quantities(&plan.evaluation.constants)),
        ("EQUATIONS", "Names and units of the equations: the input's, where there is exactly one.", rows),
    ];
    let lists = lists.into_iter().map(|(name, about, entries)| {
        let (name, about, length) = (ident(name), doc(about), count(entries.len()));
        quote!(#about pub const #name: [Label<'static>; #length] = [#(#entries),*];)
    });
    let order = count(plan.evaluation.order() as usize);
    quote! {
        #(#lists)*
        /// The sizes of the model.
        pub const DIMS: Dims = Dims {
            coordinates: COORDINATES.len(),
            order: #order,
            inputs: INPUTS.len(),
            rows: EQUATIONS.len(),
            parameters: PARAMETERS.len(),
            constants: CONSTANTS.len(),
        };
    }
}

/// The unit of an equation whose right-hand side is one input.
fn row_unit(estimator: &Estimator, row: usize) -> Option<&Unit> {
    match estimator.form.rows[row].inputs.as_slice() {
        [(symbol, factor)] if factor.as_constant().is_some() => estimator.model.quantity(*symbol).unit.as_ref(),
        _ => None,
    }
}

fn parameters(context: &Context<'_>) -> TokenStream {
    let Estimator { model, form, .. } = context.estimator;
    let fields: Vec<Field> = form
        .columns
        .iter()
        .zip(&context.names.columns)
        .map(|(column, name)| {
            let definition = match column.parameter {
                Some(_) => String::new(),
                None => format!(" = `{}`", canonical(model, &column.definition)),
            };
            let doc = format!("`{}`{definition}{}.", column.name, text::in_unit(column.unit.as_ref()));
            Field { ident: name.clone(), doc }
        })
        .collect();
    record(&ident("Parameters"), "The parameters that are estimated; every equation is linear in them.", &fields)
}

fn identified(context: &Context<'_>) -> TokenStream {
    let Some(identified) = context.options.identified else { return TokenStream::new() };
    // `generate` has refused values that do not fit the model.
    let Ok(values) = identified.in_order(context.estimator) else { return TokenStream::new() };
    let mut about =
        String::from("The identified parameters.\n\n| parameter | value | standard deviation | |\n|---|---|---|---|\n");
    for parameter in &values {
        let std = parameter.std.map_or_else(|| "unknown".to_owned(), |std| format!("{std:.3e}"));
        about.push_str(&format!("| `{}` | {} | {std} | {} |\n", parameter.name, parameter.value, parameter.status));
    }
    let about = doc(&about);
    let fields = context.names.columns.iter().zip(&values).map(|(name, parameter)| {
        let value = literal(parameter.value);
        quote!(#name: #value)
    });
    quote! {
        #about
        pub const IDENTIFIED: Parameters<f64> = Parameters { #(#fields),* };
    }
}

fn quantity_fields(context: &Context<'_>, symbols: &[(Symbol, Ident)]) -> Vec<Field> {
    let field = |(symbol, name): &(Symbol, Ident)| {
        let quantity = context.estimator.model.quantity(*symbol);
        let doc = format!("`{}`{}.", quantity.name, text::in_unit(quantity.unit.as_ref()));
        Field { ident: name.clone(), doc }
    };
    symbols.iter().map(field).collect()
}

fn constants(context: &Context<'_>) -> TokenStream {
    if !context.has_constants() {
        return TokenStream::new();
    }
    let fields = quantity_fields(context, &context.names.constants);
    record(&ident("Constants"), "Quantities that are known, but only at run time.", &fields)
}

fn lumping(context: &Context<'_>) -> TokenStream {
    let Some(plan) = &context.estimator.plan.lumping else { return TokenStream::new() };
    let fields = quantity_fields(context, &context.names.physical);
    let physical = record(
        &ident("Physical"),
        "The parameters as the model declares them. What is estimated are products and sums of them.",
        &fields,
    );
    let owner = ident("self");
    let mut writer = PlanWriter::new(plan, |node| context.leaf(node, &owner, &context.names.physical));
    let columns = &context.names.columns;
    let mut body = TokenStream::new();
    let values: Vec<Ident> = locals(columns.len());
    for (i, (value, column)) in values.iter().zip(&context.estimator.form.columns).enumerate() {
        let definition = canonical(&context.estimator.model, &column.definition);
        let comment = context.comment(format!("{} = {definition}", column.name));
        let (statements, expression) = writer.output(i);
        body.extend(quote!(#comment #statements let #value = #expression;));
    }
    let constants = context.constants_parameter(context.sources(&[plan]).constants);
    let about = doc(&format!("The estimated parameters that belong to these physical ones.{}", text::operations(plan)));
    quote! {
        #physical

        impl<T: Real> Physical<T> {
            #about
            #[must_use]
            pub fn lump(&self, #constants) -> Parameters<T> {
                #body
                Parameters { #(#columns: #values),* }
            }
        }
    }
}

fn motion(context: &Context<'_>) -> TokenStream {
    let model = &context.estimator.model;
    let coordinates = &context.names.coordinates;
    let mut types = TokenStream::new();
    let mut fields = TokenStream::new();
    for names in coordinates {
        let info = &model.coordinates[names.coordinate.0 as usize];
        let derivatives: Vec<Ident> = (0..=names.order).map(derivative_field).collect();
        let docs = (0..=names.order).map(|n| {
            let unit = text::rate(info.unit.as_ref(), n);
            doc(&format!("`{}`{}.", derivative_text(&info.name, n), text::in_unit(unit.as_ref())))
        });
        let (name, field) = (&names.motion_type, &names.field);
        let about = doc(&format!("The coordinate `{}` and its time derivatives at one instant.", info.name));
        types.extend(quote! {
            #about
            #[derive(Clone, Copy, Debug, Default, PartialEq)]
            pub struct #name<T> {
                #(#docs pub #derivatives: T,)*
            }
        });
        let about = doc(&format!("`{}` and its derivatives.", info.name));
        fields.extend(quote!(#about pub #field: #name<T>,));
    }
    let order = context.estimator.plan.evaluation.order();
    let values = locals(coordinates.len() * (order as usize + 1));
    let length = count(values.len());
    let place = |n: u32, c: usize| &values[n as usize * coordinates.len() + c];
    let patterns = (0..=order).flat_map(|n| {
        coordinates.iter().enumerate().map(move |(c, names)| {
            if n <= names.order {
                let value = place(n, c);
                quote!(#value)
            } else {
                quote!(_)
            }
        })
    });
    let built = coordinates.iter().enumerate().map(|(c, names)| {
        let (name, field) = (&names.motion_type, &names.field);
        let entries = (0..=names.order).map(|n| {
            let (derivative, value) = (derivative_field(n), place(n, c));
            quote!(#derivative: #value)
        });
        quote!(#field: #name { #(#entries),* })
    });
    let read = (0..=order).flat_map(|n| {
        coordinates.iter().map(move |names| {
            if n <= names.order {
                let (field, derivative) = (&names.field, derivative_field(n));
                quote!(self.#field.#derivative)
            } else {
                quote!(T::ZERO)
            }
        })
    });
    let (marker, unmarked) = match coordinates.len() {
        0 => (quote!(_scalar: ::core::marker::PhantomData<T>), quote!(_scalar: ::core::marker::PhantomData)),
        _ => (quote!(), quote!()),
    };
    quote! {
        #types

        /// One instant of the motion.
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct Motion<T> {
            #fields
            #marker
        }

        impl<T: Real> Motion<T> {
            /// From the order that [`Model`] uses: derivative n of coordinate c stands at `n * coordinates + c`.
            #[must_use]
            pub fn from_array(values: &[T; #length]) -> Self {
                let &[#(#patterns),*] = values;
                Self { #(#built,)* #unmarked }
            }

            /// In the order that [`Model`] uses, with zeros for derivatives that no equation reads.
            #[must_use]
            pub fn into_array(self) -> [T; #length] {
                [#(#read),*]
            }
        }
    }
}

fn forces(context: &Context<'_>) -> TokenStream {
    let fields: Vec<Field> = (0..context.estimator.form.rows.len())
        .map(|r| {
            let unit = text::in_unit(row_unit(context.estimator, r));
            let doc = format!("Equation `{}`{unit}.", context.estimator.form.rows[r].name);
            Field { ident: context.names.rows[r].field.clone(), doc }
        })
        .collect();
    let about = "One number per equation: the generalised force that its left-hand side amounts to.";
    let forces = record(&ident("Forces"), about, &fields);
    let fields = quantity_fields(context, &context.names.inputs);
    let inputs = record(&ident("Inputs"), "The inputs.", &fields);
    if context.estimator.plan.feed_forward.is_some() { quote!(#forces #inputs) } else { forces }
}

/// The parameter list of a function of the motion.
fn arguments(context: &Context<'_>, plan: &Plan, with_parameters: bool) -> TokenStream {
    let sources = context.sources(&[plan]);
    let motion = if sources.motion { ident("motion") } else { ident("_motion") };
    let constants = context.constants_parameter(sources.constants);
    let parameters = match (with_parameters, sources.parameters) {
        (false, _) => quote!(),
        (true, true) => quote!(parameters: &Parameters<T>,),
        (true, false) => quote!(_parameters: &Parameters<T>,),
    };
    quote!(#motion: &Motion<T>, #parameters #constants)
}

fn written(context: &Context<'_>, plan: &Plan) -> (TokenStream, Vec<TokenStream>) {
    let owner = ident("self");
    PlanWriter::new(plan, |node| context.leaf(node, &owner, &[])).outputs()
}

fn regressor(context: &Context<'_>) -> TokenStream {
    let estimator = context.estimator;
    let plan = &estimator.plan.evaluation.regressor;
    let (rows, columns) = (count(estimator.form.rows.len()), count(estimator.form.columns.len()));
    let mut about = String::from(
        "The regressor Phi, one row per equation and one column per parameter: Phi theta + known = B u.\n",
    );
    for (r, row) in estimator.form.rows.iter().enumerate() {
        about.push_str(&format!("\nEquation `{}`:\n\n```text\n", row.name));
        for (c, column) in estimator.form.columns.iter().enumerate() {
            if row.terms.iter().any(|term| term.column == Some(c)) {
                about.push_str(&format!("{}: {}\n", column.name, text::entry(estimator, r, Some(c))));
            }
        }
        about.push_str("```\n");
    }
    about.push_str(text::operations(plan).trim_start_matches('\n'));
    let (about, arguments) = (doc(&about), arguments(context, plan, false));
    let body = entries(context, plan, estimator.form.columns.len(), |row, column| {
        let name = &estimator.form.columns[column].name;
        format!("{}, {name}: {}", estimator.form.rows[row].name, text::entry(estimator, row, Some(column)))
    });
    quote! {
        #about
        #[must_use]
        pub fn regressor<T: Real>(#arguments) -> [[T; #columns]; #rows] {
            #body
        }
    }
}

/// A matrix that is not zero everywhere, entry by entry, each under its formula.
fn entries(
    context: &Context<'_>,
    plan: &Plan,
    columns: usize,
    formula: impl Fn(usize, usize) -> String,
) -> TokenStream {
    let owner = ident("self");
    let mut writer = PlanWriter::new(plan, |node| context.leaf(node, &owner, &[]));
    let mut body = TokenStream::new();
    for output in 0..plan.outputs.len() {
        let zero = matches!(&plan.ops[plan.outputs[output].index()], Op::Constant(value) if value.is_zero());
        let (statements, value) = writer.output(output);
        if zero {
            body.extend(statements);
            continue;
        }
        let (row, column) = (output / columns, output % columns);
        let comment = context.comment(formula(row, column));
        let (row, column) = (count(row), count(column));
        body.extend(quote!(#comment #statements matrix[#row][#column] = #value;));
    }
    let (rows, columns) = (count(plan.outputs.len() / columns.max(1)), count(columns));
    if body.is_empty() {
        let rows = count(context.estimator.form.rows.len());
        return quote!([[T::ZERO; #columns]; #rows]);
    }
    quote! {
        let mut matrix = [[T::ZERO; #columns]; #rows];
        #body
        matrix
    }
}

/// A function of the motion with one value per field of a structure.
fn function(
    context: &Context<'_>,
    name: &str,
    about: &str,
    plan: &Plan,
    with_parameters: bool,
    (result, fields): (&str, Vec<&Ident>),
) -> TokenStream {
    let about = doc(&format!("{about}{}", text::operations(plan)));
    let (name, result) = (ident(name), ident(result));
    let arguments = arguments(context, plan, with_parameters);
    let (statements, values) = written(context, plan);
    quote! {
        #about
        #[must_use]
        pub fn #name<T: Real>(#arguments) -> #result<T> {
            #statements
            #result { #(#fields: #values),* }
        }
    }
}

fn force_fields<'a>(context: &'a Context<'_>) -> (&'static str, Vec<&'a Ident>) {
    ("Forces", context.names.rows.iter().map(|row| &row.field).collect())
}

fn input_fields<'a>(context: &'a Context<'_>) -> (&'static str, Vec<&'a Ident>) {
    ("Inputs", context.names.inputs.iter().map(|(_, name)| name).collect())
}

fn known(context: &Context<'_>) -> TokenStream {
    let plan = &context.estimator.plan.evaluation.known;
    let about = "The terms without an unknown parameter, on the left-hand side.";
    function(context, "known", about, plan, false, force_fields(context))
}

fn input_map(context: &Context<'_>) -> TokenStream {
    let estimator = context.estimator;
    let plan = &estimator.plan.evaluation.input_map;
    let (rows, inputs) = (count(estimator.form.rows.len()), count(estimator.plan.evaluation.inputs.len()));
    let about =
        doc(&format!("The input map B, one row per equation and one column per input.{}", text::operations(plan)));
    let constants = context.constants_parameter(context.sources(&[plan]).constants);
    let names = |row: usize, input: usize| {
        let name = &estimator.model.quantity(estimator.plan.evaluation.inputs[input]).name;
        format!("{}, {name}: {}", estimator.form.rows[row].name, text::input_factor(estimator, row, input))
    };
    let body = entries(context, plan, estimator.plan.evaluation.inputs.len(), names);
    quote! {
        #about
        #[must_use]
        pub fn input_map<T: Real>(#constants) -> [[T; #inputs]; #rows] {
            #body
        }
    }
}

fn inverse_dynamics(context: &Context<'_>) -> TokenStream {
    let plan = &context.estimator.plan.inverse_dynamics;
    let about = "Phi theta + known: the generalised force of every equation that the motion needs.";
    function(context, "inverse_dynamics", about, plan, true, force_fields(context))
}

fn feed_forward(context: &Context<'_>) -> TokenStream {
    let Some(plan) = &context.estimator.plan.feed_forward else { return TokenStream::new() };
    let free =
        context.estimator.form.rows.iter().filter(|row| row.inputs.is_empty()).map(|row| format!("`{}`", row.name));
    let free: Vec<String> = free.collect();
    let free = match free.as_slice() {
        [] => String::new(),
        names => format!(" The motion must satisfy {} by itself.", names.join(", ")),
    };
    let about = format!("Feed-forward: the inputs that the reference motion needs.{free}");
    function(context, "feed_forward", &about, plan, true, input_fields(context))
}

fn feed_forward_parts(context: &Context<'_>) -> TokenStream {
    let Some([independent, dependent]) = &context.estimator.plan.feed_forward_parts else { return TokenStream::new() };
    let part = |name: &str, plan: &Plan, about: &str| function(context, name, about, plan, true, input_fields(context));
    let independent = part(
        "feed_forward_independent",
        independent,
        "The motion-independent part of the feed-forward: of every input the reaction that holds its own coordinate\n\
         still while the others move. An actuator gives it as fast as its amplifier is, so that it needs no low pass.",
    );
    let dependent = part(
        "feed_forward_dependent",
        dependent,
        "The motion-dependent part of the feed-forward: what moves the coordinates that the inputs drive. With\n\
         [`feed_forward_independent`] it adds up to [`feed_forward`].",
    );
    quote!(#independent #dependent)
}

fn implementation(context: &Context<'_>) -> TokenStream {
    let name = &context.names.model_type;
    let text = &context.estimator.model.name;
    let orders = context.names.coordinates.iter().enumerate().filter_map(|(c, names)| {
        let (c, order) = (count(c), count(names.order as usize));
        (names.order < context.estimator.plan.evaluation.order()).then(|| quote!(#c => #order,))
    });
    let orders: Vec<TokenStream> = orders.collect();
    let coordinate_order = if orders.is_empty() {
        quote!()
    } else {
        quote! {
            fn coordinate_order(&self, index: usize) -> usize {
                match index {
                    #(#orders)*
                    _ => DIMS.order,
                }
            }
        }
    };
    let labels = [
        ("coordinate", "COORDINATES"),
        ("input", "INPUTS"),
        ("parameter", "PARAMETERS"),
        ("constant", "CONSTANTS"),
        ("row", "EQUATIONS"),
    ]
    .map(|(method, list)| {
        let (method, list) = (ident(method), ident(list));
        quote! {
            fn #method(&self, index: usize) -> Label<'_> {
                #list.get(index).copied().unwrap_or(Label::bare(""))
            }
        }
    });
    let constants = if context.has_constants() {
        quote!(let constants = &Constants::from_array(*fixed(Buffer::Constants, constants)?);)
    } else {
        quote!(let [] = fixed(Buffer::Constants, constants)?;)
    };
    let argument = context.constants_argument();
    quote! {
        impl<T: Real> Model<T> for #name {
            fn name(&self) -> &str {
                #text
            }

            fn dims(&self) -> Dims {
                DIMS
            }

            #(#labels)*

            #coordinate_order

            fn workspace_len(&self) -> usize {
                0
            }

            fn regressor(
                &self,
                motion: &[T],
                constants: &[T],
                _workspace: &mut [T],
                out: &mut [T],
            ) -> Result<(), EvalError> {
                let motion = &Motion::from_array(fixed(Buffer::Motion, motion)?);
                #constants
                store(regressor(motion, #argument).as_flattened(), out)
            }

            fn known(
                &self,
                motion: &[T],
                constants: &[T],
                _workspace: &mut [T],
                out: &mut [T],
            ) -> Result<(), EvalError> {
                let motion = &Motion::from_array(fixed(Buffer::Motion, motion)?);
                #constants
                store(&known(motion, #argument).into_array(), out)
            }

            fn input_map(
                &self,
                motion: &[T],
                constants: &[T],
                _workspace: &mut [T],
                out: &mut [T],
            ) -> Result<(), EvalError> {
                require_len(Buffer::Motion, motion.len(), DIMS.motion_len())?;
                #constants
                store(input_map(#argument).as_flattened(), out)
            }

            fn inverse_workspace_len(&self) -> usize {
                0
            }

            fn inverse_dynamics(
                &self,
                motion: &[T],
                parameters: &[T],
                constants: &[T],
                _workspace: &mut [T],
                out: &mut [T],
            ) -> Result<(), EvalError> {
                let motion = &Motion::from_array(fixed(Buffer::Motion, motion)?);
                let parameters = &Parameters::from_array(*fixed(Buffer::Parameters, parameters)?);
                #constants
                store(&inverse_dynamics(motion, parameters, #argument).into_array(), out)
            }
        }
    }
}
