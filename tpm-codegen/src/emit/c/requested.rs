//! Functions that are emitted on request: forces at rest, mass matrix, forward dynamics, regressor and estimator in
//! base parameters.

use super::super::code::Expression;
use super::super::function::{Body, Function};
use super::super::requested;
use super::super::text;
use super::context::{Context, Parameter, push_constants};
use super::dynamics::{forces, inputs_record, matrix, size_macro};
use super::expression::Writer;
use super::layout::{doc, statement, string};
use super::solve;
use super::support;
use tpm_symbolic::plan::leaf::Leaf;

/// Writes the functions of all requested parts.
pub(super) fn write(context: &mut Context<'_>) {
    let parts = &context.estimator.parts;
    if parts.forward_dynamics.is_some() || parts.estimator {
        solve::status(context);
    }
    if let Some(function) = requested::gravity(context.estimator) {
        forces(context, "gravity", &function, true);
    }
    if let Some(function) = requested::mass_matrix(context.estimator) {
        matrix(context, "mass_matrix", &function, [true, true], (context.names.coordinates.len(), "COORDINATES"));
    }
    forward_dynamics(context);
    base(context);
    estimator(context);
}

fn forward_dynamics(context: &mut Context<'_>) {
    let Some(Function { about, reads, body: Body::Values(statements, values) }) =
        requested::forward_dynamics(context.estimator)
    else {
        return;
    };
    let fields: Vec<(String, String)> = context
        .names
        .coordinates
        .iter()
        .map(|names| (names.field.clone(), text::derivative(context.estimator, names.coordinate, names.order)))
        .collect();
    context.record("accelerations", "The highest time derivative of every coordinate.", &fields);
    if context.estimator.plan.feed_forward.is_none() {
        inputs_record(context);
    }
    let eliminate = support::write(context, &[("N", "COORDINATES")], |translator| {
        translator.function("accelerations", "eliminate")
    });
    let pointer = |name: &str| format!("const {} *{name}", context.global(name));
    let mut parameters = vec![
        Parameter::read(pointer("motion"), "motion", reads.motion),
        Parameter::read(pointer("inputs"), "inputs", reads.own),
        Parameter::read(pointer("parameters"), "parameters", reads.parameters),
    ];
    push_constants(&mut parameters, context, reads);
    parameters.push(Parameter::new(format!("{} *accelerations", context.global("accelerations"))));
    let writer = Writer::new(context.scalar, |leaf| context.leaf(leaf, "inputs->", &context.names.inputs, "motion->"));
    let (real, size) = (context.scalar.name(), context.constant("COORDINATES"));
    let mut body = format!("    {real} matrix[{size}][{size}];\n    {real} right[{size}];\n    size_t first;\n");
    body.push_str(&context.statements(&statements, &writer, |_| String::new()));
    let count = fields.len();
    let (rows, rest) = values.split_at(count * count);
    let (right, solved) = rest.split_at(count);
    let ok = context.constant("OK");
    if !solved.is_empty() {
        body.push_str(&by_factors(context, &writer, (rows, solved), &fields));
    }
    for (place, value) in rows.iter().enumerate() {
        let (row, column) = (place / count, place % count);
        body.push_str(&statement(1, &format!("matrix[{row}][{column}] = {};", writer.expression(value))));
    }
    for (row, value) in right.iter().enumerate() {
        body.push_str(&statement(1, &format!("right[{row}] = {};", writer.expression(value))));
    }
    body.push_str(&format!(
        "    first = {eliminate}(matrix, right);
    if (first != (size_t){size}) {{
        return first < (size_t){size} ? {} : {};
    }}
",
        context.constant("SINGULAR"),
        context.constant("NOT_FINITE")
    ));
    for (index, (field, _)) in fields.iter().enumerate() {
        body.push_str(&statement(1, &format!("accelerations->{field} = right[{index}];")));
    }
    body.push_str(&format!("    return {ok};\n"));
    let about = format!(
        "{about}\n\nGives `{}` when the mass matrix is singular with these parameters, and `{}` when a number is not finite.",
        context.constant("SINGULAR"),
        context.constant("NOT_FINITE")
    );
    let (name, about) = (context.global("forward_dynamics"), context.linked(&about, None));
    context.function(&name, &about, &context.global("status"), &parameters, &body);
}

/// The accelerations by the factors of M, where all pivots are positive beyond rounding: `rows` are the entries of M, `solved` the pivots and
/// behind them the accelerations.
fn by_factors<L: Fn(&Leaf) -> String>(
    context: &Context<'_>,
    writer: &Writer<L>,
    (rows, solved): (&[Expression], &[Expression]),
    fields: &[(String, String)],
) -> String {
    let count = fields.len();
    let (real, fabs, epsilon) = (context.scalar.name(), context.scalar.function("fabs"), context.scalar.epsilon());
    let max = context.scalar.max();
    let mut body =
        statement(1, &format!("const {real} tiny = {epsilon} * ({real}){};", context.constant("COORDINATES")));
    let (pivots, accelerations) = solved.split_at(count);
    let mut conditions = Vec::with_capacity(2 * count);
    for (k, (pivot, acceleration)) in pivots.iter().zip(accelerations).enumerate() {
        body.push_str(&statement(1, &format!("const {real} pivot{k} = {};", writer.expression(pivot))));
        body.push_str(&statement(1, &format!("const {real} solved{k} = {};", writer.expression(acceleration))));
        let entry = writer.expression(&rows[k * count + k]);
        conditions.push(format!("pivot{k} > tiny * {fabs}({entry})"));
        conditions.push(format!("{fabs}(solved{k}) <= {max}"));
    }
    body.push_str(&format!("    if ({}) {{\n", conditions.join("\n        && ")));
    for (k, (field, _)) in fields.iter().enumerate() {
        body.push_str(&statement(2, &format!("accelerations->{field} = solved{k};")));
    }
    body.push_str(&format!("        return {};\n    }}\n", context.constant("OK")));
    body
}

/// Names of the fields of the base parameters.
fn base_fields(context: &Context<'_>) -> Vec<String> {
    let base = context.estimator.parts.base.iter().flat_map(|base| &base.parameters);
    base.map(|base| context.names.columns[base.column].clone()).collect()
}

fn base(context: &mut Context<'_>) {
    let estimator = context.estimator;
    let (Some(function), Some(Function { about, body: Body::Values(statements, values), .. })) =
        (requested::base_regressor(estimator), requested::base(estimator))
    else {
        return;
    };
    let names = base_fields(context);
    let size = size_macro(context, "BASE_PARAMETERS", names.len(), "Base parameters.");
    context.header.push_str(&format!("\n{size}"));
    let fields: Vec<(String, String)> = names
        .iter()
        .enumerate()
        .map(|(index, name)| (name.clone(), requested::base_parameter(estimator, index)))
        .collect();
    let structure = "The base parameters: the combinations of parameters on which the forces of all motions depend, each named by the\n\
                     parameter that leads it.";
    context.record("base_parameters", structure, &fields);
    let columns = estimator.parts.base.iter().flat_map(|base| &base.parameters).map(|base| base.column);
    let declaration = format!(
        "const {} {}[{}]",
        context.global("label"),
        context.global("base_parameter_labels"),
        context.constant("BASE_PARAMETERS")
    );
    let labels = doc(0, "The base parameters as combinations, with their units.");
    context.header.push_str(&format!("\n{labels}extern {declaration};\n"));
    context.source.push_str(&format!("\n{declaration} = {{\n"));
    for (index, column) in columns.enumerate() {
        let unit = estimator.form.columns[column].unit.as_ref().map_or_else(String::new, ToString::to_string);
        let name = requested::combination(estimator, index);
        context.source.push_str(&format!("    {{{}, {}}},\n", string(&name), string(&unit)));
    }
    context.source.push_str("};\n");
    matrix(context, "base_regressor", &function, [true, false], (names.len(), "BASE_PARAMETERS"));

    let writer = Writer::new(context.scalar, |leaf| context.leaf(leaf, "", &[], ""));
    let mut body = context.statements(&statements, &writer, |_| String::new());
    for (name, value) in names.iter().zip(&values) {
        body.push_str(&statement(1, &format!("base->{name} = {};", writer.expression(value))));
    }
    let parameters = pointers(context, ["parameters", "base_parameters"], ["parameters", "base"]);
    context.function(&context.global("base"), &context.linked(&about, None), "void", &parameters, &body);
    let parameters = pointers(context, ["base_parameters", "parameters"], ["base", "parameters"]);
    let zero = context.zero();
    let given = requested::leading(estimator).into_iter().zip(&context.names.columns).map(|(place, name)| {
        let value = place.map_or_else(|| zero.clone(), |_| format!("base->{name}"));
        statement(1, &format!("parameters->{name} = {value};"))
    });
    let body: String = given.collect();
    context.function(&context.global("representative"), requested::REPRESENTATIVE, "void", &parameters, &body);
}

/// Two pointer parameters: to a structure that is read, and to one that is written.
fn pointers(context: &Context<'_>, [from, to]: [&str; 2], [source, target]: [&str; 2]) -> [Parameter; 2] {
    [
        Parameter::new(format!("const {} *{source}", context.global(from))),
        Parameter::new(format!("{} *{target}", context.global(to))),
    ]
}

fn estimator(context: &mut Context<'_>) {
    if !context.estimator.parts.estimator {
        return;
    }
    let names = base_fields(context);
    let (real, size) = (context.scalar.name(), context.constant("BASE_PARAMETERS"));
    let context_forgetting = context.forgetting;
    let of_size = [size.clone()];
    let written = support::write(context, &support::BASE, |translator| {
        translator.structure("SquareRoot", &of_size)?;
        translator.structure("Solution", &of_size)?;
        let mut of_rows = |name| translator.method("SquareRoot", &of_size, name);
        let take = [of_rows("take")?, of_rows("stands_out")?, of_rows("leaves_out")?];
        let clear = translator.method("SquareRoot", &of_size, "clear")?;
        let fade = context_forgetting.then(|| translator.method("SquareRoot", &of_size, "fade")).transpose()?;
        Ok((take, clear, fade, translator.method("SquareRoot", &of_size, "solve")?))
    });
    let (take, clear, fade, solve) = written;
    // Structures of the result.
    let field = |about: &str, declaration: String| format!("{}    {declaration};\n", doc(1, about));
    let base = context.global("base_parameters");
    let fields = [
        field("The base parameters; not a number where the samples do not show them.", format!("{base} parameters")),
        field(
            "Their standard deviations, when the errors of the equations are independent and have the deviations that were given; \
             where none were given, residual / sqrt(rows - rank) times these.",
            format!("{base} deviations"),
        ),
        field("For each base parameter whether the samples show it.", format!("bool shown[{size}]")),
        field("The number of directions that the samples show.", "int rank".to_owned()),
        field("Euclidean length of what is left of the forces, in deviations.", format!("{real} residual")),
        field(
            "Of what is shown, the Frobenius norm of the matrix with columns of length 1, times that of its inverse: at least the \
             condition number, and at most the rank times that.",
            format!("{real} condition"),
        ),
    ]
    .concat();
    context.structure("base_estimate", "What samples show of the base parameters.", &fields);

    // Clear and, where requested, fade the estimator.
    let pointer = Parameter::new(format!("{} *estimator", context.global("base_estimator")));
    let name = context.global("base_estimator_clear");
    let body = format!("    {clear}(estimator);\n");
    context.function(&name, requested::ESTIMATOR, "void", std::slice::from_ref(&pointer), &body);
    if let Some(fade) = fade {
        let parameters = [pointer.clone(), Parameter::new(format!("{real} share"))];
        let name = context.global("base_estimator_fade");
        context.function(&name, requested::FADE, "void", &parameters, &format!("    {fade}(estimator, share);\n"));
    }
    accumulate(context, pointer, &take);

    let (ok, undetermined) = (context.constant("OK"), context.constant("UNDETERMINED"));
    let about = format!(
        "What the samples so far show; `{undetermined}` when they do not show every base parameter. Modified Gram-Schmidt with column pivoting on\n\
         the factor, its columns scaled to unit length; a direction counts as not shown when what is left of its column is within the\n\
         rounding errors of all equations."
    );
    let parameters = [
        Parameter::new(format!("const {} *estimator", context.global("base_estimator"))),
        Parameter::new(format!("{} *workspace", context.global("base_workspace"))),
        Parameter::new(format!("{} *estimate", context.global("base_estimate"))),
    ];
    let mut body = format!(
        "    const {workspace} *const found = workspace;

    {solve}(estimator, workspace);
    estimate->rank = (int)found->rank;
    estimate->residual = found->residual;
    estimate->condition = found->condition;
",
        workspace = context.global("base_workspace")
    );
    body.push_str(&shown(context, &names, &|index| format!("found->values[{index}]"), ""));
    body.push_str(&statement(1, &format!("return found->rank == (size_t){size} ? {ok} : {undetermined};")));
    context.function(&context.global("base_solve"), &about, &context.global("status"), &parameters, &body);
}

/// Gives the fields of an estimate what a solution shows; deviations are multiplied by a factor.
pub(super) fn shown(context: &Context<'_>, names: &[String], value: &dyn Fn(usize) -> String, factor: &str) -> String {
    let real = context.scalar.name();
    let one = |(index, name): (usize, &String)| {
        let where_shown = |of: &str| format!("found->shown[{index}] ? {of} : ({real})NAN;");
        let deviation = format!("found->deviations[{index}]{factor}");
        [
            statement(1, &format!("estimate->shown[{index}] = found->shown[{index}];")),
            statement(1, &format!("estimate->parameters.{name} = {}", where_shown(&value(index)))),
            statement(1, &format!("estimate->deviations.{name} = {}", where_shown(&deviation))),
        ]
        .concat()
    };
    names.iter().enumerate().map(one).collect()
}

/// The function that processes a sample.
fn accumulate(context: &mut Context<'_>, pointer: Parameter, [take, gate, leaves_out]: &[String; 3]) {
    let (real, scalar) = (context.scalar.name(), context.scalar);
    let (rows, size) = (context.constant("EQUATIONS"), context.constant("BASE_PARAMETERS"));
    let forces = context.global("forces");
    let max = scalar.max();
    let argument = context.constants_argument();
    let known = requested::has_known(context.estimator);
    // Evaluate the regressor and the right-hand side.
    let mut body = format!("    {real} matrix[{rows}][{size}];\n    {real} right[{rows}];\n");
    if known {
        body.push_str(&format!("    {forces} known;\n"));
    }
    body.push_str("    size_t i;\n    size_t j;\n    bool stands_out = false;\n\n");
    body.push_str(&statement(1, &format!("{}(motion{argument}, matrix);", context.global("base_regressor"))));
    if known {
        body.push_str(&statement(1, &format!("{}(motion{argument}, &known);", context.global("known"))));
    }
    for (row, names) in context.names.rows.iter().enumerate() {
        let field = &names.field;
        let minus = if known { format!(" - known.{field}") } else { String::new() };
        body.push_str(&statement(1, &format!("right[{row}] = applied->{field}{minus};")));
    }
    // Weigh the rows, refuse values that are not finite, and rotate the rows into the factor.
    body.push_str("    if (deviations != NULL) {\n");
    let list: Vec<String> = context.names.rows.iter().map(|names| format!("deviations->{}", names.field)).collect();
    body.push_str(&statement(2, &format!("const {real} deviation[{rows}] = {{{}}};", list.join(", "))));
    let fabs = scalar.function("fabs");
    body.push_str(&format!(
        "        for (i = 0; i < (size_t){rows}; ++i) {{
            right[i] /= deviation[i];
            for (j = 0; j < (size_t){size}; ++j) {{
                matrix[i][j] /= deviation[i];
            }}
        }}
    }}
    for (i = 0; i < (size_t){rows}; ++i) {{
        if (!({fabs}(right[i]) <= {max})) {{
            return {not_finite};
        }}
        for (j = 0; j < (size_t){size}; ++j) {{
            if (!({fabs}(matrix[i][j]) <= {max})) {{
                return {not_finite};
            }}
        }}
    }}
    for (i = 0; i < (size_t){rows}; ++i) {{
        {real} row[{size}];
        for (j = 0; j < (size_t){size}; ++j) {{
            row[j] = matrix[i][j];
        }}
        stands_out = stands_out || {gate}(estimator, row, right[i]);
    }}
    if (stands_out && {leaves_out}(estimator)) {{
        return {odd};
    }}
    for (i = 0; i < (size_t){rows}; ++i) {{
        (void){take}(estimator, matrix[i], right[i]);
    }}
    return {ok};
",
        not_finite = context.constant("NOT_FINITE"),
        odd = context.constant("STANDS_OUT"),
        ok = context.constant("OK"),
    ));
    let mut parameters = vec![pointer, Parameter::new(format!("const {} *motion", context.global("motion")))];
    parameters.extend(context.constants_parameter(true));
    parameters.push(Parameter::new(format!("const {forces} *applied")));
    parameters.push(Parameter::new(format!("const {forces} *deviations")));
    let about = format!(
        "Takes in the motion and the applied forces B u of one instant, every equation with the standard deviation of its error, or all\n\
         alike when `deviations` is null. `{}` when a number is not finite or a deviation is zero, `{}` when an equation leaves 50\n\
         times what those before it leave on the average; the sample is left out then, in the latter case at most one of a hundred, so\n\
         that a machine that changes is followed. An equation whose deviation is infinite says nothing.",
        context.constant("NOT_FINITE"),
        context.constant("STANDS_OUT")
    );
    let (name, status) = (context.global("base_accumulate"), context.global("status"));
    context.function(&name, &about, &status, &parameters, &body);
}
