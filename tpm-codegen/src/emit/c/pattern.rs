//! The part of the code that belongs to trajectory patterns: reference motion, estimator matrix, harmonics, solution.

use std::f64::consts::TAU;
use tpm_symbolic::plan::bank::TableRow;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::pattern::PatternPlan;
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::plan::table::TablePlan;

use super::super::code::{Level, Place};
use super::super::function::{self, Body, Function};
use super::super::names::{derivative_name, harmonic_name};
use super::super::text;
use super::context::{Context, Parameter, push_constants};
use super::dynamics::{entry, size_macro, stored};
use super::expression::Writer;
use super::layout::{doc, statement};
use super::solve;

/// Writes the declarations and functions of all patterns.
pub(super) fn write(context: &mut Context<'_>) {
    let patterns = &context.estimator.plan.patterns;
    if patterns.iter().any(|pattern| pattern.table.is_ok()) {
        solve::write(context);
    }
    for (index, pattern) in patterns.iter().enumerate() {
        one(context, index, pattern);
    }
}

fn one(context: &mut Context<'_>, index: usize, pattern: &PatternPlan) {
    let estimator = context.estimator;
    let motions = text::motions(estimator, index);
    let name = pattern.name.as_ref().map_or_else(String::new, |name| format!(" `{name}`"));
    let mut about = format!("Amplitudes and frequency of the trajectory pattern{name}\n\n```text\n{motions}```\n");
    if context.names.patterns[index].module.is_some() {
        let remarks = text::remarks(estimator, pattern);
        remarks.iter().for_each(|remark| about.push_str(&format!("\n{remark}\n")));
    }
    let fields = context.names.patterns[index].fields.iter();
    let fields = fields.map(|(symbol, name)| (name.clone(), text::pattern_symbol(estimator, pattern, *symbol)));
    let fields: Vec<(String, String)> = fields.collect();
    context.record(&context.of_pattern(index, "pattern"), &about, &fields);
    let frequency = context.names.patterns[index].frequency(pattern).clone();
    let scalar = context.scalar;
    let two_pi = scalar.literal(TAU);
    let parameter = pattern_parameter(context, index, true);
    let body = statement(1, &format!("return {two_pi} / pattern->{frequency};"));
    let period = context.global(&context.of_pattern(index, "period"));
    context.function(&period, "One period of the motion in seconds.", scalar.name(), &[parameter], &body);
    if let Ok(plan) = &pattern.reference {
        reference(context, index, pattern, plan);
    }
    if let Ok(table) = &pattern.table {
        harmonics(context, index, table);
        estimator_matrix(context, index, table);
        known_harmonics(context, index, table);
        accumulator(context, index, table);
        transform(context, index, table);
        identify(context, index, table);
        identify_direct(context, index, pattern, table);
    }
}

fn pattern_parameter(context: &Context<'_>, index: usize, read: bool) -> Parameter {
    let declaration = format!("const {} *pattern", context.global(&context.of_pattern(index, "pattern")));
    Parameter::read(declaration, "pattern", read)
}

fn reference(context: &mut Context<'_>, index: usize, pattern: &PatternPlan, plan: &Plan) {
    let Function { about, reads, body: Body::Values(statements, values) } =
        function::reference(context.estimator, pattern, plan)
    else {
        unreachable!("invariant: a motion is given all at once")
    };
    let scalar = context.scalar;
    let motion = format!("{} *motion", context.global("motion"));
    let from = context.global(&context.of_pattern(index, "reference_from"));
    let mut parameters = vec![pattern_parameter(context, index, reads.own)];
    push_constants(&mut parameters, context, reads);
    parameters.push(Parameter::read(format!("{} cosine", scalar.name()), "cosine", reads.cos));
    parameters.push(Parameter::read(format!("{} sine", scalar.name()), "sine", reads.sin));
    parameters.push(Parameter::new(motion.clone()));
    let writer =
        Writer::new(scalar, |leaf| context.leaf(leaf, "pattern->", &context.names.patterns[index].fields, "motion->"));
    let mut body = context.statements(&statements, &writer, |_| String::new());
    let fields = context
        .names
        .coordinates
        .iter()
        .flat_map(|names| (0..=names.order).map(|order| format!("{}.{}", names.field, derivative_name(order))));
    for (field, value) in fields.zip(&values) {
        body.push_str(&statement(1, &format!("motion->{field} = {};", writer.expression(value))));
    }
    context.function(&from, &context.linked(&about, Some(index)), "void", &parameters, &body);
    let name = context.global(&context.of_pattern(index, "reference_at"));
    let mut parameters = vec![pattern_parameter(context, index, true)];
    parameters.extend(context.constants_parameter(true));
    parameters.push(Parameter::new(format!("{} phase", scalar.name())));
    parameters.push(Parameter::new(motion.clone()));
    let argument = context.constants_argument();
    let (cos, sin) = (scalar.function("cos"), scalar.function("sin"));
    let body = statement(1, &format!("{from}(pattern{argument}, {cos}(phase), {sin}(phase), motion);"));
    let about = function::reference_at(context.estimator, pattern);
    context.function(&name, &about, "void", &parameters, &body);
    let mut parameters = vec![pattern_parameter(context, index, true)];
    parameters.extend(context.constants_parameter(true));
    parameters.push(Parameter::new(format!("{} time", scalar.name())));
    parameters.push(Parameter::new(motion));
    let frequency = context.names.patterns[index].frequency(pattern);
    let body = statement(1, &format!("{name}(pattern{argument}, pattern->{frequency} * time, motion);"));
    let about = "The reference motion at a time in seconds. Reduce long times to one period, so that the phase keeps its digits.";
    context.function(&context.global(&context.of_pattern(index, "reference")), about, "void", &parameters, &body);
    if context.strokes {
        stroke(context, index, pattern);
    }
}

/// The function for a single stroke. Before and after the stroke the phase is held at its ends, where every derivative
/// is zero.
fn stroke(context: &mut Context<'_>, index: usize, pattern: &PatternPlan) {
    let scalar = context.scalar;
    let at = context.global(&context.of_pattern(index, "reference_at"));
    let argument = context.constants_argument();
    let frequency = context.names.patterns[index].frequency(pattern).clone();
    let mut parameters = vec![pattern_parameter(context, index, true)];
    parameters.extend(context.constants_parameter(true));
    for name in ["time", "from", "to"] {
        parameters.push(Parameter::new(format!("{} {name}", scalar.name())));
    }
    parameters.push(Parameter::new(format!("{} *motion", context.global("motion"))));
    let mut body = statement(1, &format!("const {} phase = from + pattern->{frequency} * time;", scalar.name()));
    body.push_str("    if (phase > from && phase < to) {\n");
    body.push_str(&statement(2, &format!("{at}(pattern{argument}, phase, motion);")));
    body.push_str(&statement(2, "return;"));
    body.push_str("    }\n");
    body.push_str(&statement(1, &format!("{at}(pattern{argument}, phase > from ? to : from, motion);")));
    let zero = scalar.literal(0.0);
    for names in &context.names.coordinates {
        for order in 1..=names.order {
            body.push_str(&statement(1, &format!("motion->{}.{} = {zero};", names.field, derivative_name(order))));
        }
    }
    let about = function::stroke(context.estimator, pattern);
    context.function(&context.global(&context.of_pattern(index, "stroke")), &about, "void", &parameters, &body);
}

/// The field of the harmonics structure, such as `u.cos3`, for every row of the table.
fn paths(context: &Context<'_>, table: &TablePlan) -> Vec<String> {
    let path = |&(equation, harmonic, function): &TableRow| {
        format!("{}.{}", context.names.rows[equation].field, harmonic_name(harmonic, function))
    };
    table.rows.iter().map(path).collect()
}

/// The highest harmonic of any equation.
fn highest(table: &TablePlan) -> usize {
    table.rows.iter().map(|(_, harmonic, _)| *harmonic).max().unwrap_or(0)
}

fn harmonics(context: &mut Context<'_>, index: usize, table: &TablePlan) {
    let highest = highest(table);
    let sizes = [
        ("harmonics", table.rows.len(), "Number of harmonics in the table, over all equations."),
        ("highest_harmonic", highest, "The highest harmonic of any equation."),
    ];
    context.header.push('\n');
    for (name, size, about) in sizes {
        let name = context.of_pattern(index, name).to_uppercase();
        let text = size_macro(context, &name, size, about);
        context.header.push_str(&text);
    }
    let mut fields = String::new();
    for equation in 0..context.names.rows.len() {
        let rows = table.rows.iter().filter(|row| row.0 == equation);
        let rows = rows
            .map(|&(_, harmonic, function)| (harmonic_name(harmonic, function), text::harmonic(harmonic, function)));
        let rows: Vec<(String, String)> = rows.collect();
        if rows.is_empty() {
            continue;
        }
        let names = &context.names.rows[equation];
        let (field, plain) = (names.field.clone(), names.harmonics_type.clone());
        let name = context.of_pattern(index, &plain);
        let equation_name = &table.table.equations[equation];
        fields.push_str(&doc(1, &format!("Harmonics of equation `{equation_name}`.")));
        fields.push_str(&format!("    {} {field};\n", context.global(&name)));
        context.record(&name, &format!("Harmonics of equation `{equation_name}`: those that its table has."), &rows);
    }
    let about = "Harmonics of one signal per equation, those that the estimator matrix has a row for.";
    context.structure(&context.of_pattern(index, "harmonics"), about, &fields);
}

fn dims(context: &Context<'_>, index: usize) -> String {
    let rows = context.constant(&context.of_pattern(index, "harmonics").to_uppercase());
    format!("[{rows}][{}]", context.constant("PARAMETERS"))
}

fn estimator_matrix(context: &mut Context<'_>, index: usize, table: &TablePlan) {
    let Function { about, reads, body } = function::estimator_matrix(context.estimator, table);
    let mut parameters = vec![pattern_parameter(context, index, reads.own)];
    push_constants(&mut parameters, context, reads);
    parameters.push(Parameter::new(format!("{} matrix{}", context.scalar.name(), dims(context, index))));
    let (rows, columns) = (table.rows.len(), context.names.columns.len());
    let pattern = context.global(&context.of_pattern(index, "pattern"));
    let spell = |leaf: &_| context.leaf(leaf, "own.", &context.names.patterns[index].fields, "");
    let mut text = String::new();
    if reads.own {
        // The local copy tells the compiler that no store into the matrix changes the pattern.
        text.push_str(&statement(1, &format!("const {pattern} own = *pattern;")));
    }
    text.push_str(&match &body {
        Body::Table(table) => context.table(table, &spell, "matrix", rows, Some(columns)),
        Body::Stores(statements) => {
            let zeros = context.zeros(rows, Some(columns), &stored(statements), entry);
            zeros + &context.statements(statements, &Writer::new(context.scalar, spell), entry)
        }
        Body::Values(..) => unreachable!("invariant: a matrix is written entry by entry"),
    });
    let name = context.global(&context.of_pattern(index, "estimator_matrix"));
    context.function(&name, &context.linked(&about, Some(index)), "void", &parameters, &text);
}

fn known_harmonics(context: &mut Context<'_>, index: usize, table: &TablePlan) {
    let Some(Function { about, reads, body }) = function::known_harmonics(context.estimator, table) else { return };
    let harmonics = context.global(&context.of_pattern(index, "harmonics"));
    let mut parameters = vec![pattern_parameter(context, index, reads.own)];
    push_constants(&mut parameters, context, reads);
    parameters.push(Parameter::new(format!("{harmonics} *harmonics")));
    let paths = paths(context, table);
    let store = |place: Place| match place {
        Place::Value(row) => format!("harmonics->{}", paths[row]),
        Place::Entry(..) => unreachable!("invariant: harmonics are no matrix"),
    };
    let spell = |leaf: &_| context.leaf(leaf, "pattern->", &context.names.patterns[index].fields, "");
    let text = match &body {
        Body::Table(terms) => {
            let mut text = statement(1, &format!("{} sums[{}];", context.scalar.name(), paths.len()));
            text.push_str(&context.table(terms, &spell, "sums", paths.len(), None));
            for (row, path) in paths.iter().enumerate() {
                text.push_str(&statement(1, &format!("harmonics->{path} = sums[{row}];")));
            }
            text
        }
        Body::Stores(statements) => {
            let zeros = context.zeros(paths.len(), None, &stored(statements), store);
            zeros + &context.statements(statements, &Writer::new(context.scalar, spell), store)
        }
        Body::Values(..) => unreachable!("invariant: harmonics are written one by one"),
    };
    let name = context.global(&context.of_pattern(index, "known_harmonics"));
    context.function(&name, &about, "void", &parameters, &text);
}

fn accumulator(context: &mut Context<'_>, index: usize, table: &TablePlan) {
    // The structure of the sums.
    let scalar = context.scalar;
    let (real, one) = (scalar.name(), scalar.literal(1.0));
    let of = |context: &Context<'_>, name: &str| context.global(&context.of_pattern(index, name));
    let rows = context.constant(&context.of_pattern(index, "harmonics").to_uppercase());
    let forgetting = context.forgetting;
    let mut fields = format!(
        "{}    {real} sums[{rows}];\n{}    uint64_t samples;\n",
        doc(1, "Sums of the signal times cosine in the order of the harmonics, then of those times sine."),
        doc(1, if forgetting { "Samples taken in since the last fading." } else { "Samples taken in so far." })
    );
    if forgetting {
        let about = doc(1, "How often the samples before the last fading count.");
        fields.push_str(&format!("{about}    {real} faded;\n"));
    }
    let about = "Fourier sums of one signal per equation, sample by sample, over whole periods.\n\n\
                 Clear it, give it samples that divide a whole number of periods evenly, and then ask for the harmonics.";
    context.structure(&context.of_pattern(index, "accumulator"), about, &fields);
    let accumulator = format!("{} *accumulator", of(context, "accumulator"));
    let sample = format!("const {} *sample", context.global("forces"));
    // Clear and, where requested, fade the sums.
    let mut clear = format!(
        "    size_t i;\n\n    for (i = 0; i < (size_t){rows}; ++i) {{\n        accumulator->sums[i] = {};\n    }}\n    accumulator->samples = 0;\n",
        scalar.literal(0.0)
    );
    if forgetting {
        clear.push_str(&format!("    accumulator->faded = {};\n", scalar.literal(0.0)));
    }
    let parameters = [Parameter::new(accumulator.clone())];
    context.function(&of(context, "accumulator_clear"), "No sample yet.", "void", &parameters, &clear);
    if forgetting {
        let body = format!(
            "    size_t i;\n\n    accumulator->faded = (accumulator->faded + ({real})accumulator->samples) * share;\n    accumulator->samples = 0;\n    for (i = 0; i < (size_t){rows}; ++i) {{\n        accumulator->sums[i] *= share;\n    }}\n"
        );
        let parameters = [Parameter::new(accumulator.clone()), Parameter::new(format!("{real} share"))];
        context.function(&of(context, "accumulator_fade"), function::FADE, "void", &parameters, &body);
    }

    // Add a sample with known cosine and sine of the phase.
    let (reads, statements, addends) = function::bank(context.estimator, table);
    let writer = Writer::new(scalar, |leaf| context.leaf(leaf, "", &[], ""));
    // The local copy tells the compiler that no store into the sums changes the sample.
    let mut body = statement(1, &format!("const {} now = *sample;", context.global("forces")));
    body.push_str(&context.statements(&statements, &writer, |_| String::new()));
    let storage = function::storage(table);
    for (place, addend) in addends.iter().enumerate() {
        let addend = writer.at(addend, Level::Sum);
        body.push_str(&statement(1, &format!("accumulator->sums[{place}] += {addend};")));
    }
    body.push_str("    if (accumulator->samples < UINT64_MAX) {\n        accumulator->samples += 1u;\n    }\n");
    let at = of(context, "accumulate_at");
    let parameters = [
        Parameter::new(accumulator.clone()),
        Parameter::read(format!("{real} cosine"), "cosine", reads.cos),
        Parameter::read(format!("{real} sine"), "sine", reads.sin),
        Parameter::new(sample.clone()),
    ];
    let about =
        format!("Takes in one sample where cosine and sine of the phase are known.{}", text::operations(&table.bank));
    context.function(&at, &about, "void", &parameters, &body);
    // Add a sample at a phase.
    let body = statement(
        1,
        &format!("{at}(accumulator, {}(phase), {}(phase), sample);", scalar.function("cos"), scalar.function("sin")),
    );
    let accumulate = of(context, "accumulate");
    let parameters =
        [Parameter::new(accumulator.clone()), Parameter::new(format!("{real} phase")), Parameter::new(sample.clone())];
    let about = "Takes in one sample at a phase `w t` in radians: one sine and one cosine for all harmonics, so that no error adds up from sample to sample.";
    context.function(&accumulate, about, "void", &parameters, &body);

    // Add a sample under a Hann window.
    let mut body = statement(1, &format!("const {real} weight = {one} - {}(phase / periods);", scalar.function("cos")));
    body.push_str(&statement(1, &format!("{} weighted;", context.global("forces"))));
    body.push('\n');
    for names in &context.names.rows {
        let field = &names.field;
        body.push_str(&statement(1, &format!("weighted.{field} = sample->{field} * weight;")));
    }
    body.push_str(&statement(1, &format!("{accumulate}(accumulator, phase, &weighted);")));
    let parameters = [
        Parameter::new(accumulator),
        Parameter::new(format!("{real} phase")),
        Parameter::new(format!("{real} periods")),
        Parameter::new(sample),
    ];
    let about = "The same under a Hann window over so many whole periods, at least two: the sample counts `1 - cos(w t / periods)` times. \
                 What is no harmonic leaks less into the harmonics, at the price of some of the data.";
    context.function(&of(context, "accumulate_hann"), about, "void", &parameters, &body);

    // The harmonics from the sums.
    let (empty, weight) = if forgetting {
        let empty = format!("accumulator->samples == 0u && accumulator->faded <= {}", scalar.literal(0.0));
        (empty, format!("(accumulator->faded + ({real})accumulator->samples)"))
    } else {
        ("accumulator->samples == 0u".to_owned(), format!("({real})accumulator->samples"))
    };
    let mut body = format!(
        "    if ({empty}) {{\n        return {};\n    }}\n    const {real} mean = {one} / {weight};\n",
        context.constant("TOO_FEW")
    );
    if table.rows.iter().any(|(_, harmonic, _)| *harmonic > 0) {
        body.push_str(&statement(1, &format!("const {real} twice = mean + mean;")));
    }
    for ((path, &(_, harmonic, _)), place) in paths(context, table).iter().zip(&table.rows).zip(&storage) {
        let factor = if harmonic == 0 { "mean" } else { "twice" };
        body.push_str(&statement(1, &format!("harmonics->{path} = accumulator->sums[{place}] * {factor};")));
    }
    body.push_str(&statement(1, &format!("return {};", context.constant("OK"))));
    let parameters = [
        Parameter::new(format!("const {} *accumulator", of(context, "accumulator"))),
        Parameter::new(format!("{} *harmonics", of(context, "harmonics"))),
    ];
    let about = format!("The harmonics of the samples so far; `{}` before the first one.", context.constant("TOO_FEW"));
    let status = context.global("status");
    context.function(&of(context, "accumulated"), &about, &status, &parameters, &body);
}

fn transform(context: &mut Context<'_>, index: usize, table: &TablePlan) {
    let of = |name: &str| context.global(&context.of_pattern(index, name));
    let real = context.scalar.name();
    let two_pi = context.scalar.literal(TAU);
    let body = format!(
        "    {accumulator} accumulator;
    size_t i;

    /* Twice the highest harmonic. */
    if (count <= {fewest}u) {{
        return {too_few};
    }}
    {clear}(&accumulator);
    for (i = 0; i < count; ++i) {{
        /* Measured from the nearer end of the period, so that the phase keeps its digits. */
        const size_t left = count - i;
        const {real} turns = i <= left ? ({real})i / ({real})count : -(({real})left / ({real})count);
        {accumulate}(&accumulator, {two_pi} * turns, &samples[i]);
    }}
    return {accumulated}(&accumulator, harmonics);
",
        accumulator = of("accumulator"),
        clear = of("accumulator_clear"),
        accumulate = of("accumulate"),
        accumulated = of("accumulated"),
        fewest = 2 * highest(table),
        too_few = context.constant("TOO_FEW"),
    );
    let parameters = [
        Parameter::new(format!("const {} *samples", context.global("forces"))),
        Parameter::new("size_t count"),
        Parameter::new(format!("{} *harmonics", of("harmonics"))),
    ];
    let about = format!(
        "The harmonics of one whole period of evenly spaced samples that begins at phase 0; `{}` when they are too few for the highest harmonic.",
        context.constant("TOO_FEW")
    );
    let (name, status) = (of("transform"), context.global("status"));
    context.function(&name, &about, &status, &parameters, &body);
}

fn identify(context: &mut Context<'_>, index: usize, table: &TablePlan) {
    let of = |name: &str| context.global(&context.of_pattern(index, name));
    let real = context.scalar.name();
    let rows = context.constant(&context.of_pattern(index, "harmonics").to_uppercase());
    let columns = context.constant("PARAMETERS");
    let (workspace, solve, status) = (of("workspace"), of("solve"), context.global("status"));
    let (harmonics, pattern, matrix) = (of("harmonics"), of("pattern"), of("estimator_matrix"));
    let (known_harmonics, identify) = (of("known_harmonics"), of("identify"));
    let estimate = format!("{} *estimate", context.global("estimate"));
    // The workspace and the least-squares solver.
    let fields = format!(
        "{}    {real} matrix[{rows}][{columns}];\n{}    {real} right[{rows}];\n{}    {} fit;\n",
        doc(1, "What takes parameters to harmonics; destroyed by a solution."),
        doc(1, "The harmonics; afterwards what is left of them."),
        doc(1, "Scratch."),
        context.global("least_squares")
    );
    let about = "The memory of a solution: the caller's, so that nothing here is static.";
    context.structure(&context.of_pattern(index, "workspace"), about, &fields);
    let parameters = [Parameter::new(format!("{workspace} *workspace")), Parameter::new(estimate.clone())];
    let body = statement(
        1,
        &format!("return least_squares({rows}, workspace->matrix, workspace->right, &workspace->fit, estimate);"),
    );
    let about = format!(
        "Least squares: the parameters, or parameter errors, that take the harmonics nearest to `right` through `matrix`, such as that of `{matrix}`. Divide a row of both by its deviation to weigh it."
    );
    context.function(&solve, &about, &status, &parameters, &body);

    // The identification: fill matrix and right-hand side, weigh the rows, solve.
    let mut parameters = vec![Parameter::new(format!("const {pattern} *pattern"))];
    parameters.extend(context.constants_parameter(true));
    parameters.push(Parameter::new(format!("const {harmonics} *effort")));
    parameters.push(Parameter::new(format!("const {harmonics} *deviations")));
    parameters.push(Parameter::new(format!("{workspace} *workspace")));
    parameters.push(Parameter::new(estimate));
    let constants = context.constants_argument();
    let mut body = String::new();
    let known = function::known_harmonics(context.estimator, table).is_some();
    if known {
        body.push_str(&statement(1, &format!("{harmonics} known;")));
    }
    body.push_str("    size_t i;\n    size_t j;\n");
    body.push('\n');
    body.push_str(&statement(1, &format!("{matrix}(pattern{constants}, workspace->matrix);")));
    if known {
        body.push_str(&statement(1, &format!("{known_harmonics}(pattern{constants}, &known);")));
    }
    let paths = paths(context, table);
    for (row, path) in paths.iter().enumerate() {
        let minus = if known { format!(" - known.{path}") } else { String::new() };
        body.push_str(&statement(1, &format!("workspace->right[{row}] = effort->{path}{minus};")));
    }
    let list: Vec<String> = paths.iter().map(|path| format!("deviations->{path}")).collect();
    body.push_str("    if (deviations != NULL) {\n");
    body.push_str(&statement(2, &format!("const {real} deviation[{rows}] = {{{}}};", list.join(", "))));
    body.push_str(&format!(
        "        for (i = 0; i < (size_t){rows}; ++i) {{
            workspace->right[i] /= deviation[i];
            for (j = 0; j < (size_t){columns}; ++j) {{
                workspace->matrix[i][j] /= deviation[i];
            }}
        }}
    }}
"
    ));
    body.push_str(&statement(1, &format!("return {solve}(workspace, estimate);")));
    let about = "The parameters for which the harmonics of the pattern's own forces are `effort`, in the sense of least squares, \
                 every harmonic with its standard deviation, or all alike when `deviations` is null.";
    context.function(&identify, about, &status, &parameters, &body);
}

/// The function that computes the parameters by the exact pseudo-inverse, where there is one.
fn identify_direct(context: &mut Context<'_>, index: usize, pattern: &PatternPlan, table: &TablePlan) {
    let Some(Function { about, reads, body: Body::Stores(statements) }) =
        function::direct(context.estimator, pattern, table)
    else {
        return;
    };
    let of = |name: &str| context.global(&context.of_pattern(index, name));
    let mut parameters = vec![pattern_parameter(context, index, reads.own)];
    push_constants(&mut parameters, context, reads);
    parameters.push(Parameter::new(format!("const {} *effort", of("harmonics"))));
    parameters.push(Parameter::new(format!("{} *parameters", context.global("parameters"))));
    let paths = paths(context, table);
    let writer = Writer::new(context.scalar, |leaf| match *leaf {
        Leaf::Harmonic(row) => format!("effort->{}", paths[row]),
        _ => context.leaf(leaf, "pattern->", &context.names.patterns[index].fields, ""),
    });
    let body = context.statements(&statements, &writer, |place| match place {
        Place::Value(index) => format!("parameters->{}", context.names.columns[index]),
        Place::Entry(..) => unreachable!("invariant: the parameters are no matrix"),
    });
    context.function(&of("identify_direct"), &about, "void", &parameters, &body);
}
