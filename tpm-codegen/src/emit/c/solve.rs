//! Least squares of fixed size, as C.
//!
//! Invariant: the method is that of `tpm_runtime::least_squares` (modified Gram-Schmidt with column pivoting, the right-hand
//! side carried along; Björck, 1967), in the caller's memory.

use super::context::Context;
use super::layout::doc;

const SOURCE: &str = "
/* Euclidean length, scaled by the largest entry so that squares neither overflow nor vanish. */
static REAL length_of(const REAL *values, size_t stride, size_t count)
{
    REAL largest = ZERO;
    REAL sum = ZERO;
    size_t i;

    for (i = 0; i < count; ++i) {
        const REAL size = FABS(values[i * stride]);
        if (!(size <= MAX)) {
            return size;
        }
        if (size > largest) {
            largest = size;
        }
    }
    if (!(largest > ZERO)) {
        return ZERO;
    }
    for (i = 0; i < count; ++i) {
        const REAL part = values[i * stride] / largest;
        sum += part * part;
    }
    return largest * SQRT(sum);
}

/* Removes the part along a unit vector and returns its size. */
static REAL project(const REAL *unit, REAL *values, size_t stride, size_t count)
{
    REAL along = ZERO;
    size_t i;

    for (i = 0; i < count; ++i) {
        along += unit[i * COLUMNS] * values[i * stride];
    }
    for (i = 0; i < count; ++i) {
        values[i * stride] -= along * unit[i * COLUMNS];
    }
    return along;
}

/* The x that minimises |A x - b|; A becomes orthonormal, b what is left of it. */
static STATUS least_squares(size_t rows, REAL matrix[][COLUMNS], REAL *right, REAL factor[COLUMNS][COLUMNS],
                            ESTIMATE *estimate)
{
    const REAL tiny = EPSILON * FOUR * (REAL)(rows + COLUMNS);
    REAL *const first = &matrix[0][0];
    REAL scale[COLUMNS];
    REAL solution[COLUMNS];
    REAL square = ZERO;
    size_t order[COLUMNS];
    size_t i, j, k;

    estimate->rank = 0;
    estimate->undetermined = -1;
    for (j = 0; j < COLUMNS; ++j) {
        const REAL length = length_of(first + j, COLUMNS, rows);
        if (!(length <= MAX)) {
            return NOT_FINITE;
        }
        order[j] = j;
        scale[j] = length > ZERO ? length : ONE;
        for (i = 0; i < rows; ++i) {
            matrix[i][j] /= scale[j];
        }
    }
    if (!(length_of(right, 1, rows) <= MAX)) {
        return NOT_FINITE;
    }
    for (k = 0; k < COLUMNS; ++k) {
        REAL diagonal = ZERO;
        REAL *unit;
        size_t best = k;
        size_t column;

        for (j = k; j < COLUMNS; ++j) {
            const REAL length = length_of(first + order[j], COLUMNS, rows);
            if (length > diagonal) {
                diagonal = length;
                best = j;
            }
        }
        column = order[best];
        order[best] = order[k];
        order[k] = column;
        if (!(diagonal > tiny)) {
            estimate->undetermined = (int)column;
            return UNDETERMINED;
        }
        unit = first + column;
        for (i = 0; i < rows; ++i) {
            matrix[i][column] /= diagonal;
        }
        factor[k][column] = diagonal;
        for (j = k + 1; j < COLUMNS; ++j) {
            factor[k][order[j]] = project(unit, first + order[j], COLUMNS, rows);
        }
        solution[k] = project(unit, right, 1, rows);
        estimate->rank = (int)k + 1;
    }
    estimate->residual = length_of(right, 1, rows);
    /* Back substitution, in the order of the pivots. */
    for (k = COLUMNS; k-- > 0;) {
        for (j = k + 1; j < COLUMNS; ++j) {
            solution[k] -= factor[k][order[j]] * solution[j];
        }
        solution[k] /= factor[k][order[k]];
    }
    /* The inverse of the triangular factor in its place, column by column. */
    for (j = 0; j < COLUMNS; ++j) {
        const size_t column = order[j];
        factor[j][column] = ONE / factor[j][column];
        for (i = 0; i < j; ++i) {
            REAL sum = ZERO;
            for (k = i; k < j; ++k) {
                sum += factor[i][order[k]] * factor[k][column];
            }
            factor[i][column] = -(sum * factor[j][column]);
        }
    }
    for (i = 0; i < COLUMNS; ++i) {
        for (j = 0; j <= i; ++j) {
            REAL sum = ZERO;
            for (k = i; k < COLUMNS; ++k) {
                sum += factor[i][order[k]] * factor[j][order[k]];
            }
            if (i == j) {
                square += sum;
            }
            sum = sum / scale[order[i]] / scale[order[j]];
            estimate->covariance[order[i]][order[j]] = sum;
            estimate->covariance[order[j]][order[i]] = sum;
        }
    }
    estimate->condition = SQRT((REAL)COLUMNS * square);
";

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
    let max = scalar.max();
    let replaced = [
        ("REAL", scalar.name().to_owned()),
        ("STATUS", status),
        ("ESTIMATE", context.global("estimate")),
        ("COLUMNS", count),
        ("UNDETERMINED", names[2].clone()),
        ("NOT_FINITE", names[3].clone()),
        ("EPSILON", scalar.epsilon().to_owned()),
        ("MAX", max.to_owned()),
        ("ZERO", scalar.literal(0.0)),
        ("ONE", scalar.literal(1.0)),
        ("FOUR", scalar.literal(4.0)),
        ("FABS", scalar.function("fabs")),
        ("SQRT", scalar.function("sqrt")),
    ];
    context.source.push_str(&filled(SOURCE, &replaced));
    let mut rest = filled(
        "    for (j = 0; j < COLUMNS; ++j) {\n        scale[order[j]] = solution[j] / scale[order[j]];\n    }\n",
        &replaced,
    );
    for (index, name) in context.names.columns.iter().enumerate() {
        rest.push_str(&format!("    estimate->parameters.{name} = scale[{index}];\n"));
    }
    context.source.push_str(&format!("{rest}    return {};\n}}\n", names[0]));
}

/// Replaces every whole word of a text that equals one of `words`, which are in capitals.
pub(super) fn filled(text: &str, words: &[(&str, String)]) -> String {
    let mut out = String::with_capacity(text.len());
    let mut word = String::new();
    for letter in text.chars().chain(['\0']) {
        if letter.is_ascii_alphanumeric() || letter == '_' {
            word.push(letter);
            continue;
        }
        match words.iter().find(|(name, _)| *name == word) {
            Some((_, replacement)) => out.push_str(replacement),
            None => out.push_str(&word),
        }
        word.clear();
        if letter != '\0' {
            out.push(letter);
        }
    }
    out
}
