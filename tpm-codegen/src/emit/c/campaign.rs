//! A campaign in C: its structures, and the functions that know the motion and the model's names.

use tpm_symbolic::mechanics::model::Kind;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::straight_line::Plan;

use super::super::campaign::CampaignPlan;
use super::super::code::{Expression, Reader};
use super::super::names::{Names, derivative_name};
use super::super::run::RunPlan;
use super::campaign_functions::functions;
use super::campaign_source::{HEADER, ORDER};
use super::context::Context;
use super::expression::{Scalar, Writer};
use super::layout::statement;
use super::solve::filled;

/// Writes the campaign, where it was requested; `words` are those of the estimator of a run.
pub(super) fn write(
    context: &mut Context<'_>,
    plan: &RunPlan<'_>,
    names: &Names<String>,
    words: &[(&'static str, String)],
) {
    let Some(campaign) = CampaignPlan::of(context.estimator) else { return };
    let mut words = words.to_vec();
    words.extend(own_words(context));
    context.header.push_str(&filled(HEADER, &words));
    let order = filled(ORDER, &words);
    context.source.push_str(&order);
    motion(context);
    play(context, plan, names, &campaign);
    functions(context, names);
}

fn own_words(context: &Context<'_>) -> Vec<(&'static str, String)> {
    let scalar = context.scalar;
    let coordinates = context.names.coordinates.len();
    let types = [
        ("STAGE", "run_stage"),
        ("RULES", "run_rules"),
        ("LIMITS", "run_limits"),
        ("COMMAND", "run_command"),
        ("PHASE", "run_phase"),
        ("END", "run_end"),
        ("PLAY", "run_play"),
        ("CAMPAIGN", "run_campaign"),
        ("MEASURED", "run_measured"),
        ("PARAMETERS", "run_parameters"),
        ("FOUND", "run_estimate"),
    ];
    let mut words: Vec<(&'static str, String)> = types.map(|(name, own)| (name, context.global(own))).into();
    words.push(("PATTERN", context.global(&context.of_pattern(0, "pattern"))));
    let states = [
        ("SETTLING", "RUN_SETTLING"),
        ("MEASURING", "RUN_MEASURING"),
        ("DUE", "RUN_DUE"),
        ("ENDED", "RUN_ENDED"),
        ("END_NONE", "RUN_END_NONE"),
        ("END_STAGES", "RUN_END_STAGES"),
        ("END_RUNS", "RUN_END_RUNS"),
        ("END_EFFORT", "RUN_END_EFFORT"),
        ("END_LIMIT", "RUN_END_LIMIT"),
        ("END_FAULT", "RUN_END_FAULT"),
        ("END_STOPPED", "RUN_END_STOPPED"),
    ];
    words.extend(states.map(|(name, own)| (name, context.constant(own))));
    let quarter = match scalar {
        Scalar::Float => "1.5707964f",
        Scalar::Double => "1.5707963267948966",
    };
    words.push(("QUARTER", quarter.to_owned()));
    let numbers = [("SIX", 6.0), ("FIFTY", 50.0), ("HALF", 0.5), ("SCALE", 75.0 / 128.0)];
    words.extend(numbers.map(|(name, value)| (name, scalar.literal(value))));
    words.push(("SMALLER", scalar.literal(if quarter.ends_with('f') { f64::from(0.7_f32) } else { 0.7 })));
    words.push(("BACK_OFFS", "4".to_owned()));
    words.push(("MOVED", coordinates.to_string()));
    words.push(("PLACES", places(context).to_string()));
    words
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
         size_t place;\n\n    pattern.{frequency} = ({real}){turn} / (({real})play->samples_per_period * campaign->rules.sampling.sample_time);\n",
        campaign = context.global("run_campaign"),
        play = context.global("run_play"),
        places = places(context),
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
         for (place = 0; place < {places}; ++place) {{\n        values[place] = {zero};\n    }}\n",
        at = context.global(&context.of_pattern(0, "reference_at")),
        places = places(context),
        zero = scalar.literal(0.0),
    ));
    for (place, name) in entries(context) {
        text.push_str(&statement(1, &format!("values[{place}] = {name};")));
    }
    text.push_str("}\n");
    context.source.push_str(&text);
}

/// Reference and feed-forward of the present sample.
fn play(context: &mut Context<'_>, plan: &RunPlan<'_>, names: &Names<String>, campaign: &CampaignPlan<'_>) {
    let (real, argument) = (context.scalar.name(), context.constants_argument());
    let (pi, places) = ("3.141592653589793", places(context));
    let eliminated = !context.estimator.model.eliminations.is_empty();
    let physical = if eliminated { format!("    {} physical;\n", context.global("physical")) } else { String::new() };
    let mut text = format!(
        "\n/* Reference and feed-forward of the present sample. */\nstatic void campaign_play_now({campaign} *campaign{constants})\n{{\n    \
         const {parameters} *const parameters = &campaign->parameters;\n    {real} values[{places}];\n    {motion} motion;\n{physical}    \
         {columns} columns;\n    {inputs} inputs;\n\n    campaign_motion_of(campaign, &campaign->now, values{argument});\n    \
         if (campaign->passed < campaign->passage) {{\n        const {real} step = ({real}){pi} / ({real})campaign->passage;\n        \
         {real} before[{places}];\n        campaign_motion_of(campaign, &campaign->before, before{argument});\n        \
         campaign_passing(before, values, step * ({real})campaign->passed,\n                step / campaign->rules.sampling.sample_time);\n    }}\n",
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
