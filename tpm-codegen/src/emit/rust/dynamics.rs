//! The part of a module that needs no pattern: names, motions, regressor, forces, the runtime's trait.

use proc_macro2::{Ident, TokenStream};
use quote::quote;
use tpm_symbolic::expr::graph::{self, Symbol};
use tpm_symbolic::plan::leaf::Leaf;

use super::super::code::{Place, Statement};
use super::super::estimator::EstimatorSource;
use super::super::function::{self, Body, Function};
use super::super::text;
use super::context::Context;
use super::expression::{Writer, literal, number};
use super::names::{derivative_field, ident};
use super::record::{Field, count, doc, locals, record};
use super::requested;
use super::shapes::{arguments, force_fields, label, matrix, quantity_fields, stores, structure};

/// The names that the module imports from the runtime.
pub(super) fn imports(context: &Context<'_>) -> TokenStream {
    let (runtime, standalone) = (&context.runtime, context.options.standalone);
    let mut root = match standalone {
        true => vec!["Label", "Real"],
        false => vec!["Buffer", "Dims", "EvalError", "Label", "Model", "Real"],
    };
    let follows = context.estimator.model.coordinates.iter().any(|coordinate| coordinate.presliding.is_some());
    if follows && !standalone {
        root.push("Presliding");
        root.sort_unstable();
    }
    if context.estimator.calls(graph::Function::Tanh) {
        root.push("Hyperbolic");
        root.sort_unstable();
    }
    // A file has them beside the rest; the runtime has them where its text for files is.
    let requested = requested::imports(context);
    let support = match standalone || requested.is_empty() {
        true => {
            root.extend(requested);
            quote!()
        }
        false => {
            let requested: Vec<Ident> = requested.into_iter().map(ident).collect();
            quote!(use #runtime::support::{#(#requested),*};)
        }
    };
    root.sort_unstable_by_key(|name| (!name.starts_with(char::is_uppercase), *name));
    let table_here = context.names.patterns.iter().zip(&context.estimator.plan.patterns);
    let table_here = table_here.filter(|(names, pattern)| names.module.is_none() && pattern.table.is_ok());
    let harmonics = if table_here.count() > 0 {
        root.extend(["SolveError", "least_squares", "weighted_least_squares"]);
        if standalone {
            root.insert(0, "AccumulatorError");
            quote!()
        } else {
            quote!(use #runtime::harmonics::AccumulatorError;)
        }
    } else {
        quote!()
    };
    let model = match standalone {
        true => quote!(),
        false => quote!(use #runtime::model::{fixed, require_len, store};),
    };
    let idents = |names: &[&str]| names.iter().map(|name| ident(name)).collect::<Vec<Ident>>();
    let root = idents(&root);
    quote! {
        #harmonics
        #model
        #support
        use #runtime::{#(#root),*};
    }
}

/// All items that need no pattern.
pub(super) fn items(context: &Context<'_>) -> TokenStream {
    let parts = [
        model_type(context),
        labels(context),
        parameters(context),
        identified(context),
        constants(context),
        lumping(context),
        unlumping(context),
        motion(context),
        forces(context),
        regressor(context),
        known(context),
        input_map(context),
        inverse_dynamics(context),
        feed_forward(context),
        feed_forward_with_regressor(context),
        feed_forward_parts(context),
        requested::items(context),
        implementation(context),
    ];
    parts.into_iter().collect()
}

fn model_type(context: &Context<'_>) -> TokenStream {
    if context.options.standalone {
        return TokenStream::new();
    }
    let name = &context.names.model_type;
    let about = doc(&format!("The model `{}`, as the runtime takes any model.", context.estimator.model.name));
    quote! {
        #about
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct #name;
    }
}

fn labels(context: &Context<'_>) -> TokenStream {
    let EstimatorSource { model, form, plan, .. } = context.estimator;
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
    let rows: Vec<TokenStream> = (0..form.rows.len())
        .map(|r| label(&label_type, &form.rows[r].name, text::row_unit(context.estimator, r)))
        .collect();
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
    let hash = proc_macro2::Literal::u64_unsuffixed(text::fingerprint(context.estimator));
    let sizes = match context.options.standalone {
        true => quote!(),
        false => quote! {
            /// The sizes of the model.
            pub const DIMS: Dims = Dims {
                coordinates: COORDINATES.len(),
                order: #order,
                inputs: INPUTS.len(),
                rows: EQUATIONS.len(),
                parameters: PARAMETERS.len(),
                constants: CONSTANTS.len(),
            };
        },
    };
    quote! {
        #(#lists)*
        /// A number that changes with the model, for logs and results to say what they belong to.
        pub const MODEL_HASH: u64 = #hash;

        #sizes
    }
}

fn parameters(context: &Context<'_>) -> TokenStream {
    let fields = context.names.columns.iter().enumerate();
    let fields: Vec<Field> = fields
        .map(|(index, name)| Field { ident: name.clone(), doc: text::column(context.estimator, index) })
        .collect();
    record(&ident("Parameters"), "The parameters that are estimated; every equation is linear in them.", &fields)
}

fn identified(context: &Context<'_>) -> TokenStream {
    let Some(identified) = context.options.identified else { return TokenStream::new() };
    // `generate` has refused values that do not fit the model.
    let Ok(values) = identified.in_order(&context.estimator.model, &context.estimator.form) else {
        return TokenStream::new();
    };
    let about = doc(&identified.about(&values));
    let fields = context.names.columns.iter().zip(&values).map(|(name, settled)| {
        let value = literal(settled.value);
        quote!(#name: #value)
    });
    quote! {
        #about
        pub const IDENTIFIED: Parameters<f64> = Parameters { #(#fields),* };
    }
}

fn constants(context: &Context<'_>) -> TokenStream {
    if !context.has_constants() {
        return TokenStream::new();
    }
    let fields = quantity_fields(context, &context.names.constants);
    record(&ident("Constants"), "Quantities that are known, but only at run time.", &fields)
}

fn lumping(context: &Context<'_>) -> TokenStream {
    let Some(Function { about, reads, body: Body::Stores(statements) }) = function::lump(context.estimator) else {
        return TokenStream::new();
    };
    let fields = quantity_fields(context, &context.names.physical);
    let physical = record(
        &ident("Physical"),
        "The parameters as the model declares them. What is estimated are products and sums of them.",
        &fields,
    );
    let owner = ident("self");
    let columns = &context.names.columns;
    let values: Vec<Ident> = locals(columns.len());
    let writer = Writer::new(|leaf| context.leaf(leaf, &owner, &context.names.physical));
    let body = stores(context, &statements, &writer, &values);
    let (about, constants) = (doc(&about), context.constants_parameter(reads));
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

fn unlumping(context: &Context<'_>) -> TokenStream {
    let Some(Function { about, reads, body: Body::Stores(statements) }) = function::unlump(context.estimator) else {
        return TokenStream::new();
    };
    let physical: Vec<&Ident> = context.names.physical.iter().map(|(_, name)| name).collect();
    let values: Vec<Ident> = locals(physical.len());
    let owner = ident("self");
    let writer = Writer::new(|leaf| match *leaf {
        Leaf::Column(index) => {
            let column = &context.names.columns[index];
            quote!(self.#column)
        }
        _ => context.leaf(leaf, &owner, &[]),
    });
    let body = stores(context, &statements, &writer, &values);
    let (about, constants) = (doc(&about), context.constants_parameter(reads));
    quote! {
        impl<T: Real> Parameters<T> {
            #about
            #[must_use]
            pub fn unlump(&self, #constants) -> Physical<T> {
                #body
                Physical { #(#physical: #values),* }
            }
        }
    }
}

fn motion(context: &Context<'_>) -> TokenStream {
    let model = &context.estimator.model;
    let coordinates = &context.names.coordinates;
    let mut types = TokenStream::new();
    let mut fields = TokenStream::new();
    // One type per coordinate, with its derivatives.
    for names in coordinates {
        let info = &model.coordinates[names.coordinate.0 as usize];
        let derivatives: Vec<Ident> = (0..=names.order).map(derivative_field).collect();
        let docs = (0..=names.order).map(|n| doc(&text::derivative(context.estimator, names.coordinate, n)));
        let (name, field) = (&names.motion_type, &names.field);
        let about = doc(&text::coordinate(context.estimator, info));
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
    // Conversions from and to a list.
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
            /// From one list: derivative n of coordinate c stands at `n * coordinates + c`.
            #[must_use]
            pub fn from_array(values: &[T; #length]) -> Self {
                let &[#(#patterns),*] = values;
                Self { #(#built,)* #unmarked }
            }

            /// The same list, with zeros for derivatives that no equation reads.
            #[must_use]
            pub fn into_array(self) -> [T; #length] {
                [#(#read),*]
            }
        }
    }
}

fn forces(context: &Context<'_>) -> TokenStream {
    let fields: Vec<Field> = (0..context.estimator.form.rows.len())
        .map(|r| Field { ident: context.names.rows[r].field.clone(), doc: text::equation(context.estimator, r) })
        .collect();
    let about = "One number per equation: the generalised force that its left-hand side amounts to.";
    let forces = record(&ident("Forces"), about, &fields);
    let fields = quantity_fields(context, &context.names.inputs);
    let inputs = record(&ident("Inputs"), "The inputs.", &fields);
    if context.estimator.plan.feed_forward.is_some() { quote!(#forces #inputs) } else { forces }
}

fn regressor(context: &Context<'_>) -> TokenStream {
    let function = function::regressor(context.estimator);
    let arguments = arguments(context, function.reads, false);
    matrix(context, "regressor", &function, arguments, context.names.columns.len())
}

fn input_map(context: &Context<'_>) -> TokenStream {
    let function = function::input_map(context.estimator);
    let arguments = context.constants_parameter(function.reads);
    matrix(context, "input_map", &function, arguments, context.names.inputs.len())
}

fn input_fields<'a>(context: &'a Context<'_>) -> (&'static str, Vec<&'a Ident>) {
    ("Inputs", context.names.inputs.iter().map(|(_, name)| name).collect())
}

fn known(context: &Context<'_>) -> TokenStream {
    structure(context, "known", &function::known(context.estimator), false, force_fields(context))
}

fn inverse_dynamics(context: &Context<'_>) -> TokenStream {
    let function = function::inverse_dynamics(context.estimator);
    structure(context, "inverse_dynamics", &function, true, force_fields(context))
}

fn feed_forward(context: &Context<'_>) -> TokenStream {
    let Some(function) = function::feed_forward(context.estimator) else { return TokenStream::new() };
    structure(context, "feed_forward", &function, true, input_fields(context))
}

fn feed_forward_with_regressor(context: &Context<'_>) -> TokenStream {
    let Some(Function { about, reads, body: Body::Stores(statements) }) =
        function::feed_forward_with_regressor(context.estimator)
    else {
        return TokenStream::new();
    };
    let (about, arguments) = (doc(&about), arguments(context, reads, true));
    let (rows, columns) = (context.names.rows.len(), context.names.columns.len());
    let (_, fields) = input_fields(context);
    let values = locals(fields.len());
    let owner = ident("self");
    let writer = Writer::new(|leaf| context.leaf(leaf, &owner, &[]));
    // The matrix is one expression. A matrix that is first filled with zeros prevents compilers from vectorising stores
    // and sums.
    let mut matrix = vec![vec![quote!(T::ZERO); columns]; rows];
    let mut steps: Vec<Statement> = Vec::new();
    for statement in statements {
        match statement {
            Statement::Store(Place::Entry(row, column), value) => {
                matrix[row][column] = writer.expression(&value);
                // The comment with an entry's formula is kept only where a step computes a value for the entry.
                steps.pop_if(|step| matches!(step, Statement::Comment(_)));
            }
            step => steps.push(step),
        }
    }
    let body = stores(context, &steps, &writer, &values);
    let (rows, columns) = (count(rows), count(columns));
    quote! {
        #about
        #[must_use]
        pub fn feed_forward_with_regressor<T: Real>(#arguments) -> (Inputs<T>, [[T; #columns]; #rows]) {
            #body
            (Inputs { #(#fields: #values),* }, [#([#(#matrix),*]),*])
        }
    }
}

fn feed_forward_parts(context: &Context<'_>) -> TokenStream {
    let Some([independent, dependent]) = function::feed_forward_parts(context.estimator) else {
        return TokenStream::new();
    };
    let part = |name: &str, part: &Function| structure(context, name, part, true, input_fields(context));
    let independent = part("feed_forward_independent", &independent);
    let dependent = part("feed_forward_dependent", &dependent);
    quote!(#independent #dependent)
}

fn implementation(context: &Context<'_>) -> TokenStream {
    if context.options.standalone {
        return TokenStream::new();
    }
    let name = &context.names.model_type;
    let text = &context.estimator.model.name;
    // The order of every coordinate below the highest one.
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
    let following = context.names.coordinates.iter().enumerate().filter_map(|(c, names)| {
        let own = context.estimator.model.coordinates[names.coordinate.0 as usize].presliding.as_ref()?;
        let of = context.names.coordinates.iter().position(|other| other.coordinate == own.of)?;
        let (c, of, travel) = (count(c), count(of), number(&own.travel));
        Some(quote!(#c => Some(Presliding { of: #of, travel: #travel }),))
    });
    let following: Vec<TokenStream> = following.collect();
    let presliding = if following.is_empty() {
        quote!()
    } else {
        quote! {
            fn presliding(&self, index: usize) -> Option<Presliding<T>> {
                match index {
                    #(#following)*
                    _ => None,
                }
            }
        }
    };
    // Names and units.
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
    // Conversion of the arguments.
    let constants = if context.has_constants() {
        quote!(let constants = &Constants::from_array(*fixed(Buffer::Constants, constants)?);)
    } else {
        quote!(let [] = fixed(Buffer::Constants, constants)?;)
    };
    let argument = context.constants_argument();
    let source = context.options.source.map(|text| {
        quote! {
            fn source(&self) -> Option<&str> {
                Some(#text)
            }
        }
    });
    quote! {
        impl<T: Real> Model<T> for #name {
            fn name(&self) -> &str {
                #text
            }

            fn dims(&self) -> Dims {
                DIMS
            }

            #source

            #(#labels)*

            #presliding

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
