//! Least squares of fixed size, as C.

use super::context::Context;
use super::layout::doc;
use super::support;

/// The status codes that functions return.
pub(super) fn status(context: &mut Context<'_>) {
    let status = context.global("status");
    let mut names = ["OK", "TOO_FEW", "UNDETERMINED", "NOT_FINITE"].map(|name| context.constant(name)).to_vec();
    let mut about = vec![
        "As asked for.",
        "There are too few samples for the harmonics.",
        "The data do not determine a parameter: its column is zero, or a combination of others.",
        "An entry of the matrix or of the data is infinite or not a number.",
    ];
    if context.estimator.parts.estimator {
        names.push(context.constant("STANDS_OUT"));
        about.push("A sample stands out of those before it, and is left out.");
    }
    if context.estimator.parts.forward_dynamics.is_some() {
        names.push(context.constant("SINGULAR"));
        about.push("The mass matrix is singular: no equation determines the acceleration of a coordinate.");
    }
    let entries = names.iter().zip(about).map(|(name, about)| format!("{}    {name},\n", doc(1, about)));
    let entries: String = entries.collect();
    let entries = entries.trim_end().trim_end_matches(',');
    context
        .header
        .push_str(&format!("\n/* How a function ended. */\ntypedef enum {status} {{\n{entries}\n}} {status};\n"));
}

/// The types of results, and the solver that all patterns share.
pub(super) fn write(context: &mut Context<'_>) {
    let scalar = context.scalar;
    let parts = &context.estimator.parts;
    if parts.forward_dynamics.is_none() && !parts.estimator {
        status(context);
    }
    let names = ["OK", "TOO_FEW", "UNDETERMINED", "NOT_FINITE"].map(|name| context.constant(name));
    let status = context.global("status");
    let (parameters, count) = (context.global("parameters"), context.constant("PARAMETERS"));
    let fields = [
        ("The parameters.", format!("{parameters} parameters")),
        (
            "Their covariance, rows and columns in the order of the parameters, when the rows' errors have the deviations that were given, or 1 where none were.",
            format!("{} covariance[{count}][{count}]", scalar.name()),
        ),
        ("Euclidean length of what is left of the data, in deviations.", format!("{} residual", scalar.name())),
        (
            "Frobenius norm of the matrix with columns of length 1, times that of its inverse: at least the condition number, and at most the number of parameters times that.",
            format!("{} condition", scalar.name()),
        ),
        ("Number of parameters that the data were found to determine.", "int rank".to_owned()),
        (
            "Index of a parameter that they do not determine, or -1. Then nothing else but the rank is set.",
            "int undetermined".to_owned(),
        ),
    ];
    let fields: String = fields.iter().map(|(about, field)| format!("{}    {field};\n", doc(1, about))).collect();
    context.structure("estimate", "What the harmonics say about the parameters.", &fields);
    let sizes = [count.clone()];
    let solve = support::write(context, &[("C", "PARAMETERS")], |translator| translator.method("Fit", &sizes, "solve"));
    let (real, fit, estimate) = (scalar.name(), context.global("least_squares"), context.global("estimate"));
    let [ok, _, undetermined, not_finite] = names;
    let mut text = format!(
        "
/* The x that minimises |A x - b|; A becomes orthonormal, b what is left of it. */
static {status} least_squares(size_t rows, {real} matrix[][{count}], {real} *right, {fit} *fit, {estimate} *estimate)
{{
    const size_t first = {solve}(fit, matrix, rows, right, rows);

    estimate->rank = (int)fit->rank;
    estimate->undetermined = first < (size_t){count} ? (int)first : -1;
    if (first != (size_t){count}) {{
        return first < (size_t){count} ? {undetermined} : {not_finite};
    }}
    for (size_t i = 0; i < (size_t){count}; ++i) {{
        for (size_t j = 0; j < (size_t){count}; ++j) {{
            estimate->covariance[i][j] = fit->covariance[i][j];
        }}
    }}
    estimate->residual = fit->residual;
    estimate->condition = fit->condition;
"
    );
    for (index, name) in context.names.columns.iter().enumerate() {
        text.push_str(&format!("    estimate->parameters.{name} = fit->solution[{index}];\n"));
    }
    context.source.push_str(&format!("{text}    return {ok};\n}}\n"));
}
