//! The physical parameters from a run in C, where those of its equations are products and sums of them.
//!
//! Invariant: the method is that of `tpm_controller::support` (`run_physical`), in the caller's memory.

use tpm_symbolic::plan::leaf::Leaf;

use super::super::code::Reader;
use super::super::names::Names;
use super::super::run::{PHYSICAL, RunPlan, is_zero};
use super::super::text;
use super::context::{Context, Parameter};
use super::dynamics::size_macro;
use super::expression::Writer;
use super::layout::{doc, statement};
use super::requested::SQUARE_ROOT;
use super::solve::filled;

/// Declarations.
const HEADER: &str = "
/* The memory of the physical parameters' iteration. */
typedef struct ESTIMATOR {
    REAL factor[COLUMNS][COLUMNS];
    REAL right[COLUMNS];
    REAL residual;
    REAL rows;
} ESTIMATOR;

typedef struct PHYSICAL_WORKSPACE {
    ESTIMATOR step;
    ESTIMATOR trial;
    REAL matrix[COLUMNS][COLUMNS];
    REAL triangle[COLUMNS][COLUMNS];
    REAL right[COLUMNS];
    REAL scale[COLUMNS];
    REAL solution[COLUMNS];
    REAL column[COLUMNS];
    size_t order[COLUMNS];
    int shown[COLUMNS];
    int rank;
    REAL residual;
    REAL condition;
    REAL values[COLUMNS];
    REAL moved[COLUMNS];
    REAL lumped[LUMPED];
    REAL slopes[LUMPED][COLUMNS];
} PHYSICAL_WORKSPACE;
";

/// The iteration.
const SOURCE: &str = "
/* The equations for a step from these parameters, and the sum of squares there; 0 where a number is not finite. */
static int physical_equations(const WORKSPACE *workspace, PHYSICAL_WORKSPACE *own, const REAL values[COLUMNS],
        ESTIMATOR *step, REAL *squaresCONSTANTS)
{
    size_t i, j, k;

    for (i = 0; i < COLUMNS; ++i) {
        for (j = 0; j < COLUMNS; ++j) {
            step->factor[i][j] = ZERO;
        }
        step->right[i] = ZERO;
    }
    step->residual = step->rows = ZERO;
    *squares = ZERO;
    physical_lump(values, own->lumped, own->slopesARGUMENT);
    for (i = 0; i < LUMPED; ++i) {
        REAL row[COLUMNS];
        REAL rest = workspace->factor.right[i];
        for (k = 0; k < COLUMNS; ++k) {
            row[k] = ZERO;
        }
        for (j = 0; j < LUMPED; ++j) {
            rest -= workspace->factor.factor[i][j] * (own->lumped[j] - workspace->about[j]);
            for (k = 0; k < COLUMNS; ++k) {
                row[k] += workspace->factor.factor[i][j] * own->slopes[j][k];
            }
        }
        for (k = 0; k < COLUMNS; ++k) {
            if (!(FABS(row[k]) <= MAX)) {
                return 0;
            }
        }
        if (!(FABS(rest) <= MAX)) {
            return 0;
        }
        physical_rotate_in(step, row, rest);
        *squares += rest * rest;
    }
    return *squares <= MAX;
}

/* Gauss-Newton from the values of the workspace, with steps that are halved where the sum of squares grows. */
static STATUS physical_solve(const WORKSPACE *workspace, PHYSICAL_WORKSPACE *own, REAL *squaresCONSTANTS)
{
    const REAL small = SQRT(SMALL > EPSILON ? SMALL : EPSILON);
    int iteration, halving;
    size_t k;

    if (!physical_equations(workspace, own, own->values, &own->step, squaresARGUMENT)) {
        return NOT_EVALUATED;
    }
    for (iteration = 0; iteration < 30; ++iteration) {
        REAL size = ZERO;
        REAL share = ONE;
        int better = 0;

        physical_solution_of(&own->step, own, own);
        if (own->rank == 0) {
            return STILL;
        }
        for (k = 0; k < (size_t)own->rank; ++k) {
            const size_t place = own->order[k];
            if (own->shown[place]) {
                const REAL ratio = own->solution[k] * own->solution[k] / own->right[k];
                size = ratio > size ? ratio : size;
            }
        }
        for (halving = 0; halving < 8 && !better; ++halving) {
            REAL after = ZERO;
            for (k = 0; k < COLUMNS; ++k) {
                own->moved[k] = own->values[k] + (own->shown[k] ? share * own->column[k] : ZERO);
            }
            better = physical_equations(workspace, own, own->moved, &own->trial, &afterARGUMENT) && after < *squares;
            if (better) {
                *squares = after;
                own->step = own->trial;
                for (k = 0; k < COLUMNS; ++k) {
                    own->values[k] = own->moved[k];
                }
            }
            share /= TWO;
        }
        if (size <= small || (!better && size <= HUNDREDTH)) {
            physical_solution_of(&own->step, own, own);
            return own->rank == 0 ? STILL : OK;
        }
        if (!better) {
            return APART;
        }
    }
    return APART;
}
";

/// Writes the physical parameters' estimate, where the parameters of the run's equations are products and sums of them.
pub(super) fn write(
    context: &mut Context<'_>,
    plan: &RunPlan<'_>,
    names: &Names<String>,
    run: &[(&'static str, String)],
) {
    if plan.source.slopes.is_none() {
        return;
    }
    let size = size_macro(
        context,
        "RUN_PHYSICAL",
        names.physical.len(),
        "Physical parameters behind the parameters of the run.",
    );
    context.header.push_str(&format!("\n{size}"));
    let fields = names.physical.iter().map(|(symbol, name)| (name.clone(), text::quantity(plan.source, *symbol)));
    let fields: Vec<(String, String)> = fields.collect();
    context.record("run_physical", "The parameters as the model declares them.", &fields);
    let scalar = context.scalar;
    let factor = context.global("run_physical_factor");
    let workspace = context.global("run_physical_workspace");
    let own = [
        ("LUMPED", context.constant("RUN_PARAMETERS")),
        ("COLUMNS", context.constant("RUN_PHYSICAL")),
        ("ESTIMATOR", factor),
        ("PHYSICAL_WORKSPACE", workspace.clone()),
        ("SMALL", scalar.literal(1e-12)),
        ("HUNDREDTH", scalar.literal(1e-2)),
    ];
    let mut words: Vec<(&'static str, String)> = own.into();
    words.extend(run.iter().filter(|(name, _)| !["COLUMNS", "ESTIMATOR"].contains(name)).cloned());
    // The solver again, of the number of the physical parameters: what it shows stands in the same memory.
    let mut solver_words = vec![
        ("SOLVER_WORKSPACE", workspace.clone()),
        ("ESTIMATE", workspace),
        ("SOLVE", "physical_solution_of".to_owned()),
    ];
    let inner = ["hypotenuse", "rotate_in", "column_length", "remove_part", "back_substitute"];
    solver_words.extend(inner.map(|name| (name, format!("physical_{name}"))));
    solver_words.extend(words.iter().filter(|(name, _)| !["ESTIMATE", "SOLVE"].contains(name)).cloned());
    let solver = SQUARE_ROOT.replace("\nSTATUS SOLVE", "\nstatic void SOLVE").replace("WORKSPACE", "SOLVER_WORKSPACE");
    let solver = format!("{}}}\n", filled(&solver, &solver_words));
    let constants = match context.has_constants() {
        true => format!(", const {} *constants", context.global("constants")),
        false => String::new(),
    };
    let arguments = |text: &str| {
        filled(&text.replace("CONSTANTS", &constants).replace("ARGUMENT", context.constants_argument()), &words)
    };
    let (header, source) = (arguments(HEADER), arguments(SOURCE));
    context.header.push_str(&header);
    lump(context, plan, names, &constants);
    context.source.push_str(&solver);
    context.source.push_str(&source);
    estimate(context, names);
}

/// The parameters of the equations from the physical ones, with their derivatives.
fn lump(context: &mut Context<'_>, plan: &RunPlan<'_>, names: &Names<String>, constants: &str) {
    let Some(slopes) = &plan.source.slopes else { return };
    let (columns, width) = (plan.source.form.columns.len(), names.physical.len());
    let writer = Writer::new(context.scalar, |leaf: &Leaf| {
        let place = match *leaf {
            Leaf::Symbol(symbol) => names.physical.iter().position(|(own, _)| *own == symbol),
            _ => None,
        };
        place.map_or_else(|| context.leaf(leaf, "", &[], ""), |place| format!("physical[{place}]"))
    });
    let (statements, values) = Reader::new(slopes).outputs();
    let reads = |own: bool| {
        let is = |leaf: &Leaf| match *leaf {
            Leaf::Symbol(symbol) => names.physical.iter().any(|(name, _)| *name == symbol) == own,
            _ => false,
        };
        slopes.inputs.iter().any(is)
    };
    let real = context.scalar.name();
    let (lumped, physical) = (context.constant("RUN_PARAMETERS"), context.constant("RUN_PHYSICAL"));
    let mut text = format!(
        "\n/* The parameters of the equations from the physical ones, and their derivatives. */\nstatic void physical_lump(const {real} physical[{physical}], {real} lumped[{lumped}],\n        {real} slopes[{lumped}][{physical}]{constants})\n{{\n"
    );
    text.push_str(&context.statements(&statements, &writer, |_| String::new()));
    if !reads(true) {
        text.push_str("    (void)physical;\n");
    }
    if context.has_constants() && !reads(false) {
        text.push_str("    (void)constants;\n");
    }
    for (index, value) in values.iter().enumerate() {
        let target = match index.checked_sub(columns) {
            None => format!("lumped[{index}]"),
            Some(place) => format!("slopes[{}][{}]", place / width, place % width),
        };
        let value = if is_zero(value) { context.zero() } else { writer.expression(value) };
        text.push_str(&statement(1, &format!("{target} = {value};")));
    }
    text.push_str("}\n");
    context.source.push_str(&text);
}

/// The structure of the estimate, and the function that gives it.
fn estimate(context: &mut Context<'_>, names: &Names<String>) {
    let (real, size) = (context.scalar.name(), context.constant("RUN_PHYSICAL"));
    let record = context.global("run_physical");
    let field = |about: &str, declaration: String| format!("{}    {declaration};\n", doc(1, about));
    let fields = [
        field("The parameters; not a number where the run does not show them.", format!("{record} parameters")),
        field("Their standard deviations.", format!("{record} deviations")),
        field(
            "Their covariance in the order of the fields; zero for those that the run does not show.",
            format!("{real} covariance[{size}][{size}]"),
        ),
        field("For each parameter 1 when the run shows it, otherwise 0.", format!("int shown[{size}]")),
        field("The number of directions that the run shows.", "int rank".to_owned()),
        field(
            "At least the condition number of what is shown, and at most the rank times that.",
            format!("{real} condition"),
        ),
        field(
            "Weighted sum of squares of what the equations leave at these parameters, over its degrees of freedom.",
            format!("{real} chi_squared"),
        ),
    ]
    .concat();
    context.structure("run_physical_estimate", "What a run says of the physical parameters.", &fields);
    let mut list = vec![
        Parameter::new(format!("const {} *workspace", context.global("run_workspace"))),
        Parameter::new(format!("{} *own", context.global("run_physical_workspace"))),
    ];
    list.extend(context.constants_parameter(true));
    list.push(Parameter::new(format!("const {record} *prior")));
    list.push(Parameter::new(format!("{} *estimate", context.global("run_physical_estimate"))));
    let (zero, one, ok) = (context.zero(), context.scalar.literal(1.0), context.constant("RUN_OK"));
    let sqrt = context.scalar.function("sqrt");
    let mut body = format!(
        "    {status} status;\n    {real} squares, freedom, factor;\n    size_t rank, i, j, k;\n\n",
        status = context.global("run_status")
    );
    for (index, (_, name)) in names.physical.iter().enumerate() {
        body.push_str(&statement(1, &format!("own->values[{index}] = prior->{name};")));
    }
    body.push_str(&format!(
        "    status = physical_solve(workspace, own, &squares{constants});
    if (status != {ok}) {{
        return status;
    }}
    rank = (size_t)own->rank;
    freedom = workspace->factor.rows - ({real})rank;
    squares += workspace->factor.residual * workspace->factor.residual;
    estimate->rank = own->rank;
    estimate->condition = own->condition;
    estimate->chi_squared = freedom > {zero} ? squares / freedom : {zero};
    factor = estimate->chi_squared > {one} ? estimate->chi_squared : {one};
    for (i = 0; i < {size}; ++i) {{
        estimate->shown[i] = own->shown[i];
        own->moved[i] = own->shown[i] ? own->values[i] : ({real})NAN;
        for (j = 0; j < {size}; ++j) {{
            estimate->covariance[i][j] = {zero};
        }}
    }}
    /* By the columns of the inverse of the triangle. */
    for (k = 0; k < rank; ++k) {{
        for (i = 0; i < rank; ++i) {{
            own->column[i] = i == k ? {one} : {zero};
        }}
        physical_back_substitute(own, rank, own->column);
        for (i = 0; i < rank; ++i) {{
            for (j = 0; j < rank; ++j) {{
                const size_t row = own->order[i];
                const size_t column = own->order[j];
                if (own->shown[row] && own->shown[column]) {{
                    estimate->covariance[row][column] += factor * own->column[i] * own->column[j]
                            / own->scale[row] / own->scale[column];
                }}
            }}
        }}
    }}
    for (i = 0; i < {size}; ++i) {{
        own->column[i] = own->shown[i] ? {sqrt}(estimate->covariance[i][i]) : ({real})NAN;
    }}
",
        constants = context.constants_argument()
    ));
    for (index, (_, name)) in names.physical.iter().enumerate() {
        body.push_str(&statement(1, &format!("estimate->parameters.{name} = own->moved[{index}];")));
        body.push_str(&statement(1, &format!("estimate->deviations.{name} = own->column[{index}];")));
    }
    body.push_str(&format!("    return {ok};\n"));
    let about = format!(
        "{PHYSICAL} `workspace` is that of the run's last update. Only with the first status is anything written to `estimate`."
    );
    let (name, status) = (context.global("run_identify_physical"), context.global("run_status"));
    context.function(&name, &about, &status, &list, &body);
}
