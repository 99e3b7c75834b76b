//! The functions of a campaign in C that the caller names.

use super::super::names::Names;
use super::context::{Context, Parameter};
use super::expression::Scalar;
use super::layout::statement;

/// The functions that the caller names.
pub(super) fn functions(context: &mut Context<'_>, names: &Names<String>) {
    let status = context.global("run_status");
    let phase = context.global("run_phase");
    let pointer = Parameter::new(format!("{} *campaign", context.global("run_campaign")));
    begin(context, names, &status, pointer.clone());
    push(context, names, &phase, pointer.clone());
    update(context, names, &phase, pointer.clone());
    let body = format!("    campaign_finish(campaign, {});\n", context.constant("RUN_END_STOPPED"));
    let about = "Ends the campaign: the machine passes to rest while further samples are pushed.";
    context.function(&context.global("run_campaign_stop"), about, "void", &[pointer], &body);
}

fn begin(context: &mut Context<'_>, names: &Names<String>, status: &str, pointer: Parameter) {
    let (zero, one, size) = (context.zero(), context.scalar.literal(1.0), context.constant("RUN_PARAMETERS"));
    let argument = context.constants_argument();
    let run_begin = context.global("run_begin");
    let ok = context.constant("RUN_OK");
    let mut body = format!(
        "    {play} first;
    size_t i, j;

    campaign->phase = {settling};
    campaign->end = {none};
    campaign->status = {ok};
    campaign->parameters = *prior;
    campaign->estimated = 0;
    campaign->stages = stages;
    campaign->stage_count = stage_count;
    campaign->rules = *rules;
    campaign->limits = *limits;
    campaign->runs = campaign->runs_of_stage = campaign->back_offs = campaign->number = 0;
    campaign->passed = campaign->passage = 0;
    for (i = 0; i < {size}; ++i) {{
        for (j = 0; j < {size}; ++j) {{
            campaign->pool.factor[i][j] = {zero};
        }}
        campaign->pool.right[i] = {zero};
    }}
    campaign->pool.residual = campaign->pool.rows = {zero};
    if (stage_count == 0) {{
        campaign->status = {samples};
    }}
    for (i = stage_count; i-- > 0 && campaign->status == {ok};) {{
        campaign->status = {run_begin}(&campaign->run, stages[i].samples_per_period, rules->periods, &rules->sampling, NULL);
    }}
    if (campaign->status != {ok}) {{
        campaign->phase = {ended};
        campaign->end = {fault};
        return campaign->status;
    }}
    first.stage = 0;
    first.share = {zero};
    first.samples_per_period = stages[0].samples_per_period;
    first.number = 0;
    campaign->now = campaign->before = first;
    first.share = {one};
    campaign_next_run(campaign, first);
",
        play = context.global("run_play"),
        settling = context.constant("RUN_SETTLING"),
        none = context.constant("RUN_END_NONE"),
        samples = context.constant("RUN_SAMPLES"),
        ended = context.constant("RUN_ENDED"),
        fault = context.constant("RUN_END_FAULT"),
    );
    for (index, name) in names.columns.iter().enumerate() {
        body.push_str(&statement(1, &format!("campaign->centre[{index}] = prior->{name};")));
    }
    body.push_str(&format!("    campaign_play_now(campaign{argument});\n    return {ok};\n"));
    let mut parameters = vec![
        pointer,
        Parameter::new(format!("const {} *stages", context.global("run_stage"))),
        Parameter::new("size_t stage_count"),
        Parameter::new(format!("const {} *rules", context.global("run_rules"))),
        Parameter::new(format!("const {} *limits", context.global("run_limits"))),
        Parameter::new(format!("const {} *prior", context.global("run_parameters"))),
    ];
    parameters.extend(context.constants_parameter(true));
    let about = "A campaign with these estimates to begin with, before its first sample: the machine rests where the pattern is with amplitudes\n\
                 of zero. The stages must outlive the campaign. With any other than the first status the campaign has ended.";
    context.function(&context.global("run_campaign_begin"), about, status, &parameters, &body);
}

fn push(context: &mut Context<'_>, names: &Names<String>, phase: &str, pointer: Parameter) {
    let (real, scalar, zero) = (context.scalar.name(), context.scalar, context.zero());
    let fabs = scalar.function("fabs");
    let mut body = format!("    {real} effort = {zero};\n    int within = 1;\n    int finite = 1;\n\n");
    let max = match scalar {
        Scalar::Float => "FLT_MAX",
        Scalar::Double => "DBL_MAX",
    };
    for (_, name) in &names.inputs {
        body.push_str(&format!(
            "    {{\n        const {real} share = {fabs}(sample->applied.{name}) / campaign->limits.inputs.{name};\n        \
             effort = share > effort ? share : effort;\n        within = within && share < {one};\n        \
             finite = finite && {fabs}(sample->applied.{name}) <= {max};\n    }}\n",
            one = scalar.literal(1.0)
        ));
    }
    for names in &names.coordinates {
        let field = &names.field;
        body.push_str(&format!(
            "    {{\n        const {real} error = sample->measured.{field} - campaign->command.reference.{field};\n        \
             within = within && {fabs}(error) <= campaign->limits.tracking.{field};\n        \
             finite = finite && {fabs}(sample->measured.{field}) <= {max};\n    }}\n"
        ));
    }
    body.push_str(&format!(
        "    if (!finite) {{
        campaign_fail(campaign, {not_finite});
    }} else if (campaign->phase == {measuring} && within) {{
        const {status} status = {push}(&campaign->run, campaign->number, sample);
        ++campaign->number;
        if (status != {ok}) {{
            campaign_fail(campaign, status);
        }} else if ({whole}(&campaign->run)) {{
            campaign->phase = {due};
        }}
    }}
    if (campaign_advance(campaign, effort, !within)) {{
        const {status} status = {begin}(&campaign->run, campaign->now.samples_per_period,
                campaign->rules.periods, &campaign->rules.sampling, NULL);
        campaign->number = 0;
        if (status != {ok}) {{
            campaign_fail(campaign, status);
        }}
    }}
    campaign_play_now(campaign{argument});
    return campaign->phase;
",
        not_finite = context.constant("RUN_NOT_FINITE"),
        measuring = context.constant("RUN_MEASURING"),
        status = context.global("run_status"),
        push = context.global("run_push"),
        ok = context.constant("RUN_OK"),
        whole = context.global("run_is_whole"),
        due = context.constant("RUN_DUE"),
        begin = context.global("run_begin"),
        argument = context.constants_argument(),
    ));
    let mut parameters = vec![pointer, Parameter::new(format!("const {} *sample", context.global("run_sample")))];
    parameters.extend(context.constants_parameter(true));
    let about = "Takes in the present sample, with the inputs that are applied from then on, and goes on to the next one. A reading or an input that\n\
                 is not finite ends the campaign; a limit makes the next run smaller.";
    context.function(&context.global("run_campaign_push"), about, phase, &parameters, &body);
}

fn update(context: &mut Context<'_>, names: &Names<String>, phase: &str, pointer: Parameter) {
    let (ok, one) = (context.constant("RUN_OK"), context.scalar.literal(1.0));
    let mut body = format!(
        "    {status} status;

    if (campaign->phase != {due}) {{
        return campaign->phase;
    }}
    status = {identify}(&campaign->run, &campaign->workspace{argument}, &campaign->parameters, &campaign->estimate);
    if (status != {ok}) {{
        campaign_fail(campaign, status);
        return campaign->phase;
    }}
    campaign_take(campaign, campaign->estimate.chi_squared);
    run_fill(&campaign->workspace, {one}, &campaign->estimate);
    campaign->estimated = 1;
",
        status = context.global("run_status"),
        due = context.constant("RUN_DUE"),
        identify = context.global("run_identify"),
        argument = context.constants_argument(),
    );
    for (index, name) in names.columns.iter().enumerate() {
        body.push_str(&format!(
            "    if (campaign->estimate.shown[{index}]) {{\n        campaign->parameters.{name} = campaign->estimate.parameters.{name};\n    }}\n"
        ));
    }
    body.push_str("    campaign_updated(campaign);\n    return campaign->phase;\n");
    let mut parameters = vec![pointer];
    parameters.extend(context.constants_parameter(true));
    let about = "Makes the update that is due, and goes on to the next run. It takes longer than a sample: the pattern goes on while samples are pushed\n\
                 before it is called.";
    context.function(&context.global("run_campaign_update"), about, phase, &parameters, &body);
}
