//! A campaign in C: its structures, and the functions that know the motion and the model's names.

use tpm_symbolic::mechanics::model::Kind;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::straight_line::Plan;

use super::super::campaign::CampaignPlan;
use super::super::code::{Expression, Reader};
use super::super::names::{Names, derivative_name};
use super::super::run::RunPlan;
use super::campaign_functions::functions;
use super::context::Context;
use super::dynamics::size_macro;
use super::expression::Writer;
use super::layout::{doc, statement};
use super::support;

/// The functions of the controller's code that lead from motion to motion.
struct Calls {
    at: String,
    step: String,
    passing: String,
}

/// Writes the campaign, where it was requested.
pub(super) fn write(context: &mut Context<'_>, plan: &RunPlan<'_>, names: &Names<String>) {
    let Some(campaign) = CampaignPlan::of(context.estimator) else { return };
    let size = size_macro(
        context,
        "RUN_MOTION",
        places(context),
        "Entries of a whole motion: every coordinate with as many derivatives as any has.",
    );
    context.header.push_str(&format!("\n{size}"));
    let parameters = support::sizes(context, &["RUN_PARAMETERS"]);
    let calls = support::write(context, &support::CAMPAIGN, |translator| {
        translator.structure("RunPool", &parameters)?;
        let mut order = |name| translator.method("CampaignOrder", &[], name);
        Ok(Calls {
            at: order("passage_at")?,
            step: order("passage_step")?,
            passing: translator.function("campaign", "passing")?,
        })
    });
    structures(context);
    motion(context);
    play(context, plan, names, &campaign, &calls);
    functions(context, names);
}

/// The structures that hold the model's own.
fn structures(context: &mut Context<'_>) {
    let own = |name: &str| context.global(name);
    let field = |about: &str, declaration: String| format!("{}    {declaration};\n", doc(1, about));
    let stage = format!("    {} pattern;\n    uint32_t samples_per_period;\n", own(&context.of_pattern(0, "pattern")));
    let rules = [
        format!("    {} sampling;\n", own("run_sampling")),
        field(
            "Periods that settle before a run is measured, behind the passage to it.",
            "uint32_t settle_periods".to_owned(),
        ),
        field("Periods that are measured, an even number and at least four.", "uint32_t periods".to_owned()),
        field("Runs of every stage.", "uint32_t runs_per_stage".to_owned()),
        field("Runs of the whole campaign, those that were given up included.", "uint32_t most_runs".to_owned()),
        field(
            "Share of an input's limit from which on no larger stage is begun.",
            format!("{} effort", context.scalar.name()),
        ),
    ]
    .concat();
    let limits = [
        field("The limit of every input.", format!("{} inputs", own("run_applied"))),
        field("The largest tracking error of every coordinate.", format!("{} tracking", own("run_measured"))),
    ]
    .concat();
    let command = [
        field("The reference of every measured coordinate.", format!("{} reference", own("run_measured"))),
        field(
            "The feed-forward; feedback of the measured less the reference is added to it.",
            format!("{} feed_forward", own("run_applied")),
        ),
    ]
    .concat();
    let campaign = [
        format!("    {} phase;\n    {} end;\n    {} status;\n", own("run_phase"), own("run_end"), own("run_status")),
        format!("    {} command;\n", own("run_command")),
        field(
            "The present estimates: the prior where no run has shown a parameter.",
            format!("{} parameters", own("run_parameters")),
        ),
        format!("    bool estimated;\n    {} estimate;\n    uint32_t runs;\n", own("run_estimate")),
        format!("    const {} *stages;\n    {} sampling;\n", own("run_stage"), own("run_sampling")),
        format!("    {} limits;\n    {} order;\n", own("run_limits"), own("run_order")),
        format!("    {} pool;\n    uint32_t number;\n", own("run_pool")),
        format!("    {} run;\n    {} workspace;\n", own("run"), own("run_workspace")),
    ]
    .concat();
    let about = "A whole campaign on the controller: the machine identifies itself. At every sample `command` has reference and feed-forward, the \
                 controller adds its feedback and applies the sum, and the sample is pushed. When a run is whole, an update is due; all runs are \
                 pooled by what they show. Read `phase`, `end`, `status`, `runs`, `command`, `parameters` and, once `estimated` holds, `estimate`.";
    let all = [
        (
            "run_stage",
            "A stage of a campaign: amplitudes, and the samples of a period, which give the frequency.",
            stage,
        ),
        ("run_rules", "What the caller decides about a campaign.", rules),
        ("run_limits", "What makes a campaign give up a run.", limits),
        ("run_command", "What the controller plays at a sample.", command),
        ("run_campaign", about, campaign),
    ];
    for (name, about, fields) in all {
        context.structure(name, about, &fields);
    }
}

/// Entries of a whole motion: every coordinate with as many derivatives as any has.
fn places(context: &Context<'_>) -> usize {
    context.names.coordinates.len() * (context.estimator.plan.evaluation.order() as usize + 1)
}

fn constants(context: &Context<'_>) -> String {
    match context.has_constants() {
        true => format!(", const {} *constants", context.global("constants")),
        false => String::new(),
    }
}

/// Every entry of a motion that an equation reads, with its place.
fn entries(context: &Context<'_>) -> Vec<(usize, String)> {
    let coordinates = &context.names.coordinates;
    let of = |(c, names): (usize, &super::super::names::CoordinateNames<String>)| {
        let place = |order: u32| {
            let name = format!("motion.{}.{}", names.field, derivative_name(order));
            (order as usize * coordinates.len() + c, name)
        };
        (0..=names.order).map(place).collect::<Vec<_>>()
    };
    coordinates.iter().enumerate().flat_map(of).collect()
}

/// The motion of a pattern while it is played.
fn motion(context: &mut Context<'_>) {
    let (real, scalar) = (context.scalar.name(), context.scalar);
    let turn = "6.283185307179586";
    let pattern_plan = &context.estimator.plan.patterns[0];
    let pattern = &context.names.patterns[0];
    let frequency = pattern.frequency(pattern_plan).clone();
    let mut text = format!(
        "\n/* The motion of a pattern while it is played. */\nstatic void campaign_motion_of(const {campaign} *campaign, const {play} *play,\n        \
         {real} values[{places}]{constants})\n{{\n    {pattern} pattern = campaign->stages[play->stage].pattern;\n    {motion} motion;\n    \
         size_t place;\n\n    pattern.{frequency} = ({real}){turn} / (({real})play->samples_per_period * campaign->sampling.sample_time);\n",
        campaign = context.global("run_campaign"),
        play = context.global("run_play"),
        places = context.constant("RUN_MOTION"),
        constants = constants(context),
        pattern = context.global(&context.of_pattern(0, "pattern")),
        motion = context.global("motion"),
    );
    for (symbol, name) in &pattern.fields {
        if *symbol != pattern_plan.frequency {
            text.push_str(&statement(1, &format!("pattern.{name} *= play->share;")));
        }
    }
    let argument = context.constants_argument();
    text.push_str(&format!(
        "    {at}(&pattern{argument},\n            ({real})({turn} * (double)play->number / (double)play->samples_per_period), &motion);\n    \
         for (place = 0; place < (size_t){places}; ++place) {{\n        values[place] = {zero};\n    }}\n",
        at = context.global(&context.of_pattern(0, "reference_at")),
        places = context.constant("RUN_MOTION"),
        zero = scalar.literal(0.0),
    ));
    for (place, name) in entries(context) {
        text.push_str(&statement(1, &format!("values[{place}] = {name};")));
    }
    text.push_str("}\n");
    context.source.push_str(&text);
}

/// Reference and feed-forward of the present sample.
fn play(
    context: &mut Context<'_>,
    plan: &RunPlan<'_>,
    names: &Names<String>,
    campaign: &CampaignPlan<'_>,
    calls: &Calls,
) {
    let (real, argument) = (context.scalar.name(), context.constants_argument());
    let places = context.constant("RUN_MOTION");
    let eliminated = !context.estimator.model.eliminations.is_empty();
    let physical = if eliminated { format!("    {} physical;\n", context.global("physical")) } else { String::new() };
    let mut text = format!(
        "\n/* Reference and feed-forward of the present sample. */\nstatic void campaign_play_now({campaign} *campaign{constants})\n{{\n    \
         const {parameters} *const parameters = &campaign->parameters;\n    {real} values[{places}];\n    {motion} motion;\n{physical}    \
         {columns} columns;\n    {inputs} inputs;\n\n    campaign_motion_of(campaign, &campaign->order.now, values{argument});\n    \
         if (campaign->order.passed < campaign->order.passage) {{\n        {real} before[{places}];\n        \
         campaign_motion_of(campaign, &campaign->order.before, before{argument});\n        \
         {passing}(before, values, {coordinates}, {at}(&campaign->order),\n                {step}(&campaign->order) / campaign->sampling.sample_time);\n    }}\n",
        passing = calls.passing,
        at = calls.at,
        step = calls.step,
        coordinates = context.names.coordinates.len(),
        campaign = context.global("run_campaign"),
        constants = constants(context),
        parameters = context.global("run_parameters"),
        motion = context.global("motion"),
        columns = context.global("parameters"),
        inputs = context.global("inputs"),
    );
    for (place, name) in entries(context) {
        text.push_str(&statement(1, &format!("{name} = values[{place}];")));
    }
    if eliminated {
        for (_, field) in &context.names.physical {
            text.push_str(&statement(1, &format!("physical.{field} = parameters->{field};")));
        }
        text.push_str(&format!("    {}(&physical{argument}, &columns);\n", context.global("lump")));
    } else {
        for field in &context.names.columns {
            text.push_str(&statement(1, &format!("columns.{field} = parameters->{field};")));
        }
    }
    text.push_str(&format!("    {}(&motion, &columns{argument}, &inputs);\n", context.global("feed_forward")));
    for (_, name) in &names.inputs {
        text.push_str(&statement(1, &format!("campaign->command.feed_forward.{name} = inputs.{name};")));
    }
    for (&(of, _), names) in plan.source.plan.evaluation.coordinates.iter().zip(&names.coordinates) {
        let target = format!("campaign->command.reference.{}", names.field);
        match campaign.reconstruction(of) {
            Some(plan) => text.push_str(&reconstruction(context, &target, plan)),
            None => {
                let own = context.names.coordinates.iter().find(|own| own.coordinate == of);
                let own = own.map_or(&names.field, |own| &own.field);
                text.push_str(&statement(1, &format!("{target} = motion.{own}.{};", derivative_name(0))));
            }
        }
    }
    text.push_str("}\n");
    context.source.push_str(&text);
}

/// The reference of an eliminated coordinate.
fn reconstruction(context: &Context<'_>, target: &str, plan: &Plan) -> String {
    let writer = Writer::new(context.scalar, |leaf: &Leaf| match *leaf {
        Leaf::Symbol(symbol) => match &context.estimator.model.quantity(symbol).kind {
            Kind::Constant { value: Some(value) } => context.scalar.number(value),
            _ => context.leaf(leaf, "parameters->", &context.names.physical, "motion."),
        },
        _ => context.leaf(leaf, "", &[], "motion."),
    });
    let (statements, values) = Reader::new(plan).outputs();
    let mut inner = context.statements(&statements, &writer, |_| String::new());
    let value = values.first().map_or_else(String::new, |value: &Expression| writer.expression(value));
    inner.push_str(&statement(1, &format!("{target} = {value};")));
    let inner: String = inner.lines().map(|line| format!("    {line}\n")).collect();
    format!("    {{\n{inner}    }}\n")
}
