//! The watch over a machine's base parameters, as C.
//!
//! Invariant: the method is that of `tpm_controller::support::monitor`, in the caller's memory, over the estimator of base parameters, which holds
//! the block.

use super::super::requested;
use super::context::{Context, Parameter};
use super::dynamics::{matrix, size_macro};
use super::expression::Scalar;
use super::layout::doc;
use super::solve::filled;

const SOURCE: &str = "
/* A column without its part along the directions so far, into `own`; zero where no more than rounding is left. */
static int monitor_beside(MONITOR *monitor, size_t index, size_t count, REAL tiny)
{
    REAL before = ZERO;
    REAL after = ZERO;
    size_t i, k;

    for (i = 0; i < COLUMNS; ++i) {
        monitor->own[i] = monitor->block.factor[i][index];
        monitor->weights[i] = i == index ? ONE : ZERO;
        before += monitor->own[i] * monitor->own[i];
    }
    for (k = 0; k < count; ++k) {
        REAL along = ZERO;
        for (i = 0; i < COLUMNS; ++i) {
            along += monitor->own[i] * monitor->basis[k][i];
        }
        for (i = 0; i < COLUMNS; ++i) {
            monitor->own[i] -= along * monitor->basis[k][i];
            monitor->weights[i] -= along * monitor->basis_weights[k][i];
        }
    }
    for (i = 0; i < COLUMNS; ++i) {
        after += monitor->own[i] * monitor->own[i];
    }
    return after > before * tiny * tiny * SIXTEEN;
}

/* What the block says of a parameter; zero where nothing. */
static int monitor_shown(MONITOR *monitor, size_t index, REAL tiny, REAL *score, REAL *information,
                         REAL *noise, REAL *blind)
{
    const RULES *const rules = monitor->rules;
    REAL variance = ZERO;
    REAL lost = ZERO;
    size_t count = 0;
    size_t i, j;

    for (j = 0; j < COLUMNS; ++j) {
        if (rules->drifts[j] > ZERO && j != index && monitor_beside(monitor, j, count, tiny)) {
            REAL length = ZERO;
            for (i = 0; i < COLUMNS; ++i) {
                length += monitor->own[i] * monitor->own[i];
            }
            length = SQRT(length);
            for (i = 0; i < COLUMNS; ++i) {
                monitor->basis[count][i] = monitor->own[i] / length;
                monitor->basis_weights[count][i] = monitor->weights[i] / length;
            }
            ++count;
        }
    }
    if (!monitor_beside(monitor, index, count, tiny)) {
        return 0;
    }
    *score = ZERO;
    *information = ZERO;
    for (i = 0; i < COLUMNS; ++i) {
        *score += monitor->own[i] * monitor->right[i];
        *information += monitor->own[i] * monitor->own[i];
    }
    /* How an error of every identified value looks like a change of this one. */
    for (j = 0; j < COLUMNS; ++j) {
        REAL share = ZERO;
        for (i = 0; i <= j; ++i) {
            share += monitor->own[i] * monitor->block.factor[i][j];
        }
        monitor->shares[j] = share / *information;
    }
    for (j = 0; j < COLUMNS; ++j) {
        REAL sum = ZERO;
        for (i = 0; i < COLUMNS; ++i) {
            sum += monitor->shares[i] * rules->spread[i][j];
        }
        variance += sum * sum;
        lost += monitor->noise[j] * FABS(monitor->weights[j]);
    }
    /* Noise of the motion that stands in the direction and in what the values explain gives products that no mean takes away. */
    *noise = lost / *information;
    *blind = SQRT(BOUND * variance) + *noise;
    return 1;
}

/* The factor from a variance of so many degrees of freedom to its upper limit of 99 % (Wilson and Hilferty, 1931). */
static REAL monitor_upper(REAL freedom)
{
    const REAL part = TWO / (NINE * freedom);
    const REAL root = ONE - part - QUANTILE * SQRT(part);

    return ONE / (root * root * root);
}

/* Adds a log-likelihood ratio, of which one block never gives more than three tenths of an alarm; whether anything is left. */
static int monitor_step(EVIDENCE *side, REAL step, REAL threshold)
{
    if (!(FABS(step) <= MAX)) {
        return 0;
    }
    side->ratio += step < SHARE * threshold ? step : SHARE * threshold;
    if (side->ratio > ZERO) {
        return 1;
    }
    side->ratio = ZERO;
    side->score = ZERO;
    side->information = ZERO;
    return 0;
}

/* The sum for the power that no parameters explain; whether it has passed the threshold. */
static int monitor_unexplained(MONITOR *monitor, REAL rounding, REAL threshold)
{
    const REAL freedom = (REAL)monitor->equations - (REAL)COLUMNS;
    const REAL power = monitor->block.residual * monitor->block.residual / freedom;
    const REAL blocks = (REAL)monitor->blocks;
    REAL mean, variance, shape, usual;

    if (monitor->blocks < monitor->rules->run_in) {
        ++monitor->blocks;
        monitor->left += power;
        monitor->squares += power * power;
        return 0;
    }
    mean = monitor->left / blocks;
    variance = monitor->squares / blocks - mean * mean;
    variance = (variance > ZERO ? variance : ZERO) * monitor_upper(blocks - ONE);
    if (!(variance > EPSILON * mean * mean)) {
        variance = EPSILON * mean * mean;
    }
    /* White noise has the largest shape there is. */
    shape = mean * mean / variance;
    if (!(shape < HALF * freedom)) {
        shape = HALF * freedom;
    }
    usual = mean * (ONE + THREE / SQRT(shape * blocks)) + rounding * rounding / freedom;
    (void)monitor_step(&monitor->unexplained, shape * (power / usual * HALF - LOG(TWO)), threshold);
    monitor->growth = power / usual;
    return monitor->unexplained.ratio > threshold;
}

/* Judges a block that is over. */
static void monitor_judge(MONITOR *monitor)
{
    const RULES *const rules = monitor->rules;
    const REAL tiny = EPSILON * FOUR * ((REAL)COLUMNS + SQRT(monitor->block.rows));
    const REAL rest = (REAL)monitor->taken / (monitor->rests > ONE ? monitor->rests : ONE);
    REAL threshold = LOG(TESTS * HOUR / (rules->sample_time * (REAL)rules->block) / rules->false_alarms);
    REAL rounding = ZERO;
    REAL most = ZERO;
    int waits = 0;
    int moved = 0;
    size_t i, j;

    if (!(threshold > ONE)) {
        threshold = ONE;
    }
    for (i = 0; i < COLUMNS; ++i) {
        REAL left = monitor->block.right[i];
        rounding += left * left;
        for (j = i; j < COLUMNS; ++j) {
            left -= monitor->block.factor[i][j] * rules->values[j];
        }
        monitor->right[i] = left;
        monitor->noise[i] = ZERO;
        for (j = 0; j < COLUMNS; ++j) {
            monitor->noise[i] += rest * FABS(monitor->products[i][j] * rules->values[j]);
        }
    }
    rounding = SQRT(rounding) * tiny;
    monitor->testable = 0;
    for (j = 0; j < COLUMNS; ++j) {
        WATCHED *const one = &monitor->parameters[j];
        const int ready = one->blocks >= rules->run_in;
        const REAL change = rules->changes[j];
        REAL score, information, noise, blind, variance, gap, middle;
        int side;

        waits |= !ready;
        if (!monitor_shown(monitor, j, tiny, &score, &information, &noise, &blind)
            || noise >= change * HALF) {
            continue;
        }
        ++monitor->testable;
        if (!ready) {
            ++one->blocks;
            one->score += score;
            one->information += information;
            one->squares += score * score / information;
            continue;
        }
        variance = (one->squares - one->score * one->score / one->information) / (REAL)(one->blocks - 1)
                 * monitor_upper((REAL)(one->blocks - 1));
        if (!(variance > rounding * rounding)) {
            variance = rounding * rounding;
        }
        score /= variance;
        information /= variance;
        /* From what is no change to the one that is to be found. */
        gap = change - blind;
        if (!(gap > ZERO)) {
            continue;
        }
        middle = rules->drifts[j] + (blind + change) * HALF;
        for (side = 0; side < 2; ++side) {
            EVIDENCE *const evidence = &one->sides[side];
            const REAL own = side == 0 ? score : -score;
            if (monitor_step(evidence, gap * (own - information * middle), threshold)) {
                REAL found;
                evidence->score += score;
                evidence->information += information;
                found = evidence->score * evidence->score / evidence->information;
                if (evidence->ratio > threshold && found > most) {
                    most = found;
                    moved = 1;
                    monitor->moved = j;
                    monitor->change = evidence->score / evidence->information;
                    monitor->deviation = ONE / SQRT(evidence->information);
                }
            }
        }
    }
    monitor->state = RUN_IN;
    if (monitor_unexplained(monitor, rounding, threshold)) {
        monitor->state = UNEXPLAINED;
    } else if (!waits && monitor->blocks >= rules->run_in) {
        monitor->state = WATCHING;
    }
    if (moved) {
        monitor->state = MOVED;
    }
}
";

/// Writes types and functions, where the monitor was asked for.
pub(super) fn write(context: &mut Context<'_>) {
    if !context.estimator.parts.monitor {
        return;
    }
    let scalar = context.scalar;
    let (real, size, rows) = (scalar.name(), context.constant("BASE_PARAMETERS"), context.constant("EQUATIONS"));
    if let Some(spread) = requested::spread(context.estimator, context.identified) {
        let declaration = format!("const {real} {}[{size}][{size}]", context.global("identified_spread"));
        context.header.push_str(&format!("\n{}extern {declaration};\n", doc(0, requested::SPREAD)));
        let lines: String = (spread.iter())
            .map(|row| {
                let entries: Vec<String> = row.iter().map(|entry| scalar.literal(*entry)).collect();
                format!("    {{{}}},\n", entries.join(", "))
            })
            .collect();
        context.source.push_str(&format!("\n{declaration} = {{\n{lines}}};\n"));
    }
    let field = |about: &str, declaration: String| format!("{}    {declaration};\n", doc(1, about));
    let rules = [
        field("The base parameters of the machine as it was identified.", format!("{real} values[{size}]")),
        field(
            "A matrix S with S S^T the covariance of these values, such as the Cholesky factor.",
            format!("{real} spread[{size}][{size}]"),
        ),
        field(
            "The change of every base parameter that is to be found, larger than zero, and beyond its drift where it drifts. A block whose \
             uncertainty looks larger than this says nothing of the parameter.",
            format!("{real} changes[{size}]"),
        ),
        field(
            "How far every base parameter may be off by itself, with temperature or wear; zero for one that does not drift.",
            format!("{real} drifts[{size}]"),
        ),
        field(
            "Standard deviations of the equations' errors. Only their ratios count, since the run-in measures the noise.",
            format!("{} deviations", context.global("forces")),
        ),
        field("The time between samples, s.", format!("{real} sample_time")),
        field("The false alarms that are allowed per hour.", format!("{real} false_alarms")),
        field(
            "The samples of a block: a few times longer than noise remembers, and than the slowest motion takes.",
            "uint32_t block".to_owned(),
        ),
        field("The blocks of the run-in, at least 20, of the work that will be watched.", "uint32_t run_in".to_owned()),
    ]
    .concat();
    context.structure(
        "monitor_rules",
        "What is watched, and how; arrays in the order of the base parameters' labels.",
        &rules,
    );
    let names = ["RUN_IN", "WATCHING", "LEFT_OUT", "MOVED", "UNEXPLAINED"];
    let about = [
        "Some parameter, or the power of what is left, still waits for blocks of its run-in; the others are watched.",
        "The machine is watched; `testable` says of how many parameters the last block could show the change, 0 when it stood still.",
        "This sample is left out: it is missing, an input was at its limit, or a number is not finite.",
        "The parameter `moved` has moved by `change`, whose deviation from noise is `deviation`; so until the monitor begins again.",
        "The power that no parameters explain is `growth` times that of the run-in; so until the monitor begins again.",
    ];
    let entries: Vec<String> = names
        .iter()
        .zip(about)
        .map(|(name, about)| format!("{}    {}", doc(1, about), context.constant(&format!("MONITOR_{name}"))))
        .collect();
    let state = context.global("monitor_state");
    context.header.push_str(&format!(
        "\n/* What a monitor says. */\ntypedef enum {state} {{\n{}\n}} {state};\n",
        entries.join(",\n")
    ));
    context.structure(
        "monitor_evidence",
        "The evidence for a change in one direction since it was last zero.",
        &format!("    {real} ratio;\n    {real} score;\n    {real} information;\n"),
    );
    let fields = format!(
        "    uint32_t blocks;\n    {real} score;\n    {real} information;\n    {real} squares;\n    {} sides[2];\n",
        context.global("monitor_evidence")
    );
    let about = "What the run-in showed of a parameter, and the evidence that it has grown or shrunk.";
    context.structure("monitor_watched", about, &fields);
    let jumps = requested::jumps(context.estimator);
    let signs = context.constant("BASE_JUMPS");
    if let Some(jumps) = &jumps {
        let size_macro = size_macro(
            context,
            "BASE_JUMPS",
            jumps.count,
            "The most signs, and functions that saturate, in an equation.",
        );
        context.header.push_str(&format!("\n{size_macro}"));
    }
    let fields = [
        format!("    const {} *rules;\n    {state} state;\n", context.global("monitor_rules")),
        field("The base parameter that has moved, by how much as if it alone had, and the deviation of that.", "size_t moved".to_owned()),
        format!("    {real} change;\n    {real} deviation;\n"),
        field("The unexplained power of the last block, in that of the run-in.", format!("{real} growth")),
        field("The parameters of which the last block could show the change that is to be found.", "size_t testable".to_owned()),
        field("The block so far: its rows, its samples, how many of them were taken in, and with how many equations.", format!("{} block", context.global("base_estimator"))),
        "    uint32_t samples;\n    uint32_t taken;\n    uint32_t equations;\n".to_owned(),
        match &jumps {
            Some(_) => field(
                "Means of the arguments of signs at rest, and sums of the squares of what is left of them.",
                format!("{real} level[{rows}][{signs}];\n    {real} wander[{rows}][{signs}]"),
            ),
            None => String::new(),
        },
        field(
            "Means of the entries of the regressor at rest, and sums of the products of what is left of two columns.",
            format!("{real} mean[{rows}][{size}]"),
        ),
        format!("    {real} products[{size}][{size}];\n    {real} rests;\n    {} parameters[{size}];\n", context.global("monitor_watched")),
        field("Run-in and evidence of the power that is left.", "uint32_t blocks".to_owned()),
        format!("    {real} left;\n    {real} squares;\n    {} unexplained;\n", context.global("monitor_evidence")),
        field("Memory of a judgement.", format!("{real} basis[{size}][{size}]")),
        format!("    {real} basis_weights[{size}][{size}];\n    {real} own[{size}];\n    {real} weights[{size}];\n    {real} shares[{size}];\n    {real} right[{size}];\n    {real} noise[{size}];\n"),
    ]
    .concat();
    context.structure("monitor", requested::MONITOR, &fields);

    if let Some(jumps) = &jumps {
        let function = requested::jumping(context.estimator, jumps);
        matrix(context, "base_jumps", &function, [true, false], (jumps.count, "BASE_JUMPS"));
        let count = base_parameters(context);
        let rows: String = (jumps.entries.chunks(count))
            .map(|row| {
                let flags: Vec<&str> = row.iter().map(|jumps| if *jumps { "1" } else { "0" }).collect();
                format!("    {{{}}},\n", flags.join(", "))
            })
            .collect();
        context.source.push_str(&format!(
            "\n/* Which entries of the regressor depend on a sign. */\nstatic const unsigned char jumping[{rows_of}][{size}] = {{\n{rows}}};\n",
            rows_of = context.constant("EQUATIONS"),
        ));
    }
    let mut words = words(context);
    words.push(("SIGNS", signs));
    let source = filled(SOURCE, &words);
    context.source.push_str(&source);
    if jumps.is_some() {
        context.source.push_str(&filled(STILL, &words));
    }
    let pointer = Parameter::new(format!("{} *monitor", context.global("monitor")));
    let motion = Parameter::new(format!("const {} *motion", context.global("motion")));
    let status = context.global("status");
    // Begin.
    let about = format!(
        "Begins with the run-in. `{}` when a rule is not finite or not in its range, or a block has no more equations than two per base\n\
         parameter, or the run-in fewer than 20 blocks; the monitor must not be used then. The rules must outlive the monitor.",
        context.constant("UNDETERMINED")
    );
    // Names of the model come in after the words, which they might equal.
    let deviations: String = (context.names.rows.iter())
        .map(|names| format!("        || !is_positive(rules->deviations.{})\n", names.field))
        .collect();
    let part = |text: &str| if jumps.is_some() { filled(text, &words) } else { String::new() };
    let body = filled(&BEGIN.replace("    LEVELS\n", &part(LEVELS)), &words).replace("    DEVIATIONS\n", &deviations);
    let helper = filled(POSITIVE, &words);
    context.source.push_str(&helper);
    let rules = Parameter::new(format!("const {} *rules", context.global("monitor_rules")));
    context.function(&context.global("monitor_begin"), &about, &status, &[pointer.clone(), rules], &body);
    // At rest.
    let argument = context.constants_argument();
    let list: Vec<String> =
        context.names.rows.iter().map(|names| format!("monitor->rules->deviations.{}", names.field)).collect();
    let evaluate = format!("{}(motion{argument}, arguments);", context.global("base_jumps"));
    let rest = REST.replace("        FINITE\n", &part(FINITE)).replace("    MEASURE\n", &part(MEASURE));
    let declared = if jumps.is_some() { "    REAL arguments[ROWS][SIGNS];\n" } else { "" };
    let evaluated = if jumps.is_some() { format!("\n    {evaluate}") } else { String::new() };
    let body = filled(&rest.replace("    ARGUMENTS\n", declared), &words)
        .replace("REGRESSOR", &format!("{}(motion{argument}, matrix);{evaluated}", context.global("base_regressor")))
        .replace("DEVIATION_LIST", &list.join(",\n                                   "));
    let mut parameters = vec![pointer.clone(), motion.clone()];
    parameters.extend(context.constants_parameter(true));
    let about = "Takes in the motion, as it is measured, of one instant while the machine stands still, before the run-in: what varies then\n\
                 is noise, which looks like a change of parameters where the machine moves little. Without any, the motion counts as exact.";
    context.function(&context.global("monitor_rest"), about, "void", &parameters, &body);
    // A sample.
    let accumulate = format!(
        "{}(&monitor->block, motion{argument}, applied, &deviations) == {}",
        context.global("base_accumulate"),
        context.constant("OK")
    );
    let counted = match &jumps {
        Some(_) => {
            let rows: String = (context.names.rows.iter().enumerate())
                .map(|(row, names)| {
                    filled(COUNTED, &words).replace("INDEX", &row.to_string()).replace("FIELD", &names.field)
                })
                .collect();
            format!("    {evaluate}\n{rows}")
        }
        None => String::new(),
    };
    let push = PUSH.replace("    ARGUMENTS\n", declared);
    let body = filled(&push, &words).replace("ACCUMULATE", &accumulate).replace("    COUNTED\n", &counted);
    parameters.push(Parameter::new(format!("const {} *applied", context.global("forces"))));
    parameters.push(Parameter::new("int whole".to_owned()));
    let about = "Takes in the motion and the applied forces B u of one instant, and tells what is known now. `whole` is 0 where the sample is\n\
                 missing, or where an input was at its limit, so that the applied force is not known.";
    context.function(&context.global("monitor_push"), about, &state, &parameters, &body);
    // Again.
    let about = "Forgets evidence and alarm, and keeps what was measured at rest and in the run-in: after an alarm that was seen to.";
    let body = filled(AGAIN, &words);
    context.function(&context.global("monitor_again"), about, "void", &[pointer], &body);
}

const POSITIVE: &str = "
static int is_positive(REAL value)
{
    return value > ZERO && value <= MAX;
}
";

const BEGIN: &str = "    static const WATCHED unheard = {0};
    size_t i, j;

    if (!is_positive(rules->sample_time) || !is_positive(rules->false_alarms)
    DEVIATIONS
        || (REAL)rules->block * (REAL)ROWS <= TWO * (REAL)COLUMNS || rules->run_in < 20) {
        return UNDETERMINED;
    }
    for (i = 0; i < COLUMNS; ++i) {
        if (!(FABS(rules->values[i]) <= MAX) || !is_positive(rules->changes[i])
            || !(rules->drifts[i] >= ZERO && rules->drifts[i] <= MAX)) {
            return UNDETERMINED;
        }
        for (j = 0; j < COLUMNS; ++j) {
            if (!(FABS(rules->spread[i][j]) <= MAX)) {
                return UNDETERMINED;
            }
        }
    }
    for (j = 0; j < COLUMNS; ++j) {
        for (i = 0; i < ROWS; ++i) {
            monitor->mean[i][j] = ZERO;
        }
        for (i = 0; i < COLUMNS; ++i) {
            monitor->products[i][j] = ZERO;
        }
        monitor->parameters[j] = unheard;
    }
    LEVELS
    CLEAR(&monitor->block);
    monitor->unexplained = unheard.sides[0];
    monitor->left = ZERO;
    monitor->squares = ZERO;
    monitor->rests = ZERO;
    monitor->change = ZERO;
    monitor->deviation = ZERO;
    monitor->growth = ZERO;
    monitor->moved = 0;
    monitor->testable = 0;
    monitor->blocks = 0;
    monitor->samples = 0;
    monitor->taken = 0;
    monitor->equations = 0;
    monitor->rules = rules;
    monitor->state = RUN_IN;
    return OK;
";

const REST: &str = "    const REAL deviation[ROWS] = {DEVIATION_LIST};
    REAL matrix[ROWS][COLUMNS];
    ARGUMENTS
    REAL before[COLUMNS];
    REAL after[COLUMNS];
    size_t i, j, k;

    REGRESSOR
    for (i = 0; i < ROWS; ++i) {
        for (j = 0; j < COLUMNS; ++j) {
            if (!(FABS(matrix[i][j]) <= MAX)) {
                return;
            }
        }
        FINITE
    }
    monitor->rests += ONE;
    MEASURE
    for (i = 0; i < ROWS; ++i) {
        for (j = 0; j < COLUMNS; ++j) {
            const REAL entry = matrix[i][j] / deviation[i];
            before[j] = entry - monitor->mean[i][j];
            monitor->mean[i][j] += before[j] / monitor->rests;
            after[j] = entry - monitor->mean[i][j];
        }
        for (j = 0; j < COLUMNS; ++j) {
            for (k = 0; k < COLUMNS; ++k) {
                monitor->products[j][k] += before[j] * after[k];
            }
        }
    }
";

const PUSH: &str = "    ARGUMENTS
    FORCES deviations = monitor->rules->deviations;
    uint32_t equations = ROWS;
    int taken;

    COUNTED
    taken = whole != 0 && ACCUMULATE;
    ++monitor->samples;
    monitor->taken += taken ? 1U : 0U;
    monitor->equations += taken ? equations : 0U;
    if (monitor->samples >= monitor->rules->block) {
        if (monitor->state != MOVED && monitor->state != UNEXPLAINED
            && monitor->equations > 2U * COLUMNS) {
            monitor_judge(monitor);
        }
        CLEAR(&monitor->block);
        monitor->samples = 0;
        monitor->taken = 0;
        monitor->equations = 0;
    }
    if (!taken && monitor->state != MOVED && monitor->state != UNEXPLAINED) {
        return LEFT_OUT;
    }
    return monitor->state;
";

const LEVELS: &str = "    for (i = 0; i < ROWS; ++i) {
        for (j = 0; j < SIGNS; ++j) {
            monitor->level[i][j] = ZERO;
            monitor->wander[i][j] = ZERO;
        }
    }
";

const FINITE: &str = "        for (j = 0; j < SIGNS; ++j) {
            if (!(FABS(arguments[i][j]) <= MAX)) {
                return;
            }
        }
";

const MEASURE: &str = "    for (i = 0; i < ROWS; ++i) {
        for (j = 0; j < SIGNS; ++j) {
            const REAL off = arguments[i][j] - monitor->level[i][j];
            monitor->level[i][j] += off / monitor->rests;
            monitor->wander[i][j] += off * (arguments[i][j] - monitor->level[i][j]);
        }
        /* A row is counted where its signs are exact: what else there is in the entry is its noise then. */
        for (j = 0; j < COLUMNS; ++j) {
            matrix[i][j] = jumping[i][j] ? FABS(matrix[i][j]) : matrix[i][j];
        }
    }
";

const STILL: &str = "
/* Whether a sign is that of noise, within five deviations of what it is taken of: normal noise leaves them once in 1.7 million samples.
 * Dry friction at rest, or at a reversal, is anything between its limits. */
static int monitor_still(const MONITOR *monitor, size_t row, const REAL arguments[SIGNS])
{
    const REAL share = STILL / (monitor->rests > TWO ? monitor->rests - ONE : ONE);
    size_t i;

    for (i = 0; i < SIGNS; ++i) {
        if (arguments[i] * arguments[i] <= monitor->wander[row][i] * share) {
            return 1;
        }
    }
    return 0;
}
";

const COUNTED: &str = "    if (monitor_still(monitor, INDEX, arguments[INDEX])) {
        deviations.FIELD = INFINITE;
        --equations;
    }
";

const AGAIN: &str = "    static const EVIDENCE nothing = {0};
    size_t j;

    for (j = 0; j < COLUMNS; ++j) {
        monitor->parameters[j].sides[0] = nothing;
        monitor->parameters[j].sides[1] = nothing;
    }
    monitor->unexplained = nothing;
    monitor->state = RUN_IN;
";

fn base_parameters(context: &Context<'_>) -> usize {
    context.estimator.parts.base.as_ref().map_or(0, |base| base.parameters.len())
}

fn words(context: &Context<'_>) -> Vec<(&'static str, String)> {
    let scalar = context.scalar;
    let count = base_parameters(context) as f64;
    let mut words = vec![
        ("REAL", scalar.name().to_owned()),
        ("COLUMNS", context.constant("BASE_PARAMETERS")),
        ("ROWS", context.constant("EQUATIONS")),
        ("MONITOR", context.global("monitor")),
        ("RULES", context.global("monitor_rules")),
        ("EVIDENCE", context.global("monitor_evidence")),
        ("WATCHED", context.global("monitor_watched")),
        ("RUN_IN", context.constant("MONITOR_RUN_IN")),
        ("WATCHING", context.constant("MONITOR_WATCHING")),
        ("LEFT_OUT", context.constant("MONITOR_LEFT_OUT")),
        ("MOVED", context.constant("MONITOR_MOVED")),
        ("FORCES", context.global("forces")),
        ("INFINITE", format!("({})INFINITY", scalar.name())),
        ("UNEXPLAINED", context.constant("MONITOR_UNEXPLAINED")),
        ("CLEAR", context.global("base_estimator_clear")),
        ("OK", context.constant("OK")),
        ("UNDETERMINED", context.constant("UNDETERMINED")),
        ("EPSILON", scalar.epsilon().to_owned()),
        ("MAX", if scalar == Scalar::Float { "FLT_MAX" } else { "DBL_MAX" }.to_owned()),
        ("BOUND", scalar.literal(2.0 * (2.0 * count / 1e-3).ln())),
        ("TESTS", scalar.literal(2.0 * count + 1.0)),
    ];
    let numbers = [
        ("ZERO", 0.0),
        ("SHARE", 0.3),
        ("HALF", 0.5),
        ("ONE", 1.0),
        ("TWO", 2.0),
        ("QUANTILE", 2.326_348),
        ("THREE", 3.0),
        ("FOUR", 4.0),
        ("NINE", 9.0),
        ("SIXTEEN", 16.0),
        ("STILL", 25.0),
        ("HOUR", 3600.0),
    ];
    words.extend(numbers.map(|(name, value)| (name, scalar.literal(value))));
    words.extend([("FABS", "fabs"), ("SQRT", "sqrt"), ("LOG", "log")].map(|(name, of)| (name, scalar.function(of))));
    words
}
