//! The functions of a campaign in C that the caller names.

use super::super::names::Names;
use super::context::{Context, Parameter};
use super::layout::statement;
use super::support;

/// The functions of the controller's code that a campaign calls.
struct Calls {
    begin: String,
    advance: String,
    run_is_whole: String,
    updated: String,
    stop: String,
    fail: String,
    clear: String,
    add: String,
    solve: String,
}

/// What the caller reads of the order of a campaign.
const SHOW: &str = "    campaign->phase = campaign->order.state;
    campaign->end = campaign->order.reason;
    campaign->status = campaign->order.status;
    campaign->runs = campaign->order.runs;
";

/// The functions that the caller names.
pub(super) fn functions(context: &mut Context<'_>, names: &Names<String>) {
    let parameters = support::sizes(context, &["RUN_PARAMETERS"]);
    let calls = support::write(context, &support::CAMPAIGN, |translator| {
        let mut order = |name| translator.method("CampaignOrder", &[], name);
        Ok(Calls {
            begin: order("start")?,
            advance: order("advance")?,
            run_is_whole: order("run_is_whole")?,
            updated: order("updated")?,
            stop: order("stop")?,
            fail: order("fail")?,
            clear: translator.method("RunPool", &parameters, "clear")?,
            add: translator.method("RunPool", &parameters, "add")?,
            solve: translator.method("SquareRoot", &parameters, "solve")?,
        })
    });
    let status = context.global("run_status");
    let phase = context.global("run_phase");
    let pointer = Parameter::new(format!("{} *campaign", context.global("run_campaign")));
    begin(context, names, &calls, [&status, &phase], pointer.clone());
    push(context, names, &calls, &phase, pointer.clone());
    update(context, names, &calls, &phase, pointer.clone());
    let body = format!("    {}(&campaign->order);\n    (void)campaign_show(campaign);\n", calls.stop);
    let about = "Ends the campaign: the machine passes to rest while further samples are pushed.";
    context.function(&context.global("run_campaign_stop"), about, "void", &[pointer], &body);
}

fn begin(
    context: &mut Context<'_>,
    names: &Names<String>,
    calls: &Calls,
    [status, phase]: [&str; 2],
    pointer: Parameter,
) {
    let argument = context.constants_argument();
    let run_begin = context.global("run_begin");
    let ok = context.constant("RUN_OK");
    let campaign = context.global("run_campaign");
    context.source.push_str(&format!(
        "\nstatic {phase} campaign_show({campaign} *campaign)\n{{\n{SHOW}    return campaign->phase;\n}}\n"
    ));
    let (real, size) = (context.scalar.name(), context.constant("RUN_PARAMETERS"));
    let prior: Vec<String> = names.columns.iter().map(|name| format!("prior->{name}")).collect();
    let mut body = statement(1, &format!("const {real} centre[{size}] = {{{}}};", prior.join(", ")));
    body.push_str(&format!(
        "    const {order_rules} order_rules = {{
        rules->settle_periods, rules->periods, rules->runs_per_stage, rules->most_runs, rules->effort
    }};
    {status} status = stage_count > 0u ? {ok} : {samples};

    campaign->parameters = *prior;
    campaign->estimated = false;
    campaign->stages = stages;
    campaign->sampling = rules->sampling;
    campaign->limits = *limits;
    campaign->number = 0;
    {clear}(&campaign->pool, centre);
    /* The first stage comes last, so that its run is the one that is begun. */
    for (size_t passed = 0; passed < stage_count; ++passed) {{
        if (status == {ok}) {{
            const uint32_t samples = stages[stage_count - 1u - passed].samples_per_period;
            status = {run_begin}(&campaign->run, samples, rules->periods, &rules->sampling, NULL);
        }}
    }}
    {start}(&campaign->order, &order_rules, stage_count, stage_count > 0u ? stages[0].samples_per_period : 0u);
    if (status != {ok}) {{
        campaign->order.runs = 0;
        campaign->order.state = {settling};
        {fail}(&campaign->order, status);
    }} else {{
        campaign_play_now(campaign{argument});
    }}
    (void)campaign_show(campaign);
    return status;
",
        samples = context.constant("RUN_SAMPLES"),
        settling = context.constant("RUN_SETTLING"),
        clear = calls.clear,
        order_rules = context.global("run_order_rules"),
        start = calls.begin,
        fail = calls.fail,
    ));
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

fn push(context: &mut Context<'_>, names: &Names<String>, calls: &Calls, phase: &str, pointer: Parameter) {
    let (real, scalar, zero) = (context.scalar.name(), context.scalar, context.zero());
    let fabs = scalar.function("fabs");
    let mut body = format!("    {real} effort = {zero};\n    bool within = true;\n    bool finite = true;\n\n");
    let max = scalar.max();
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
        {fail}(&campaign->order, {not_finite});
    }} else if (campaign->order.state == {measuring} && within) {{
        const {status} status = {push}(&campaign->run, campaign->number, sample);
        ++campaign->number;
        if (status != {ok}) {{
            {fail}(&campaign->order, status);
        }} else if ({whole}(&campaign->run)) {{
            {run_is_whole}(&campaign->order);
        }} else {{
            /* The run goes on. */
        }}
    }} else {{
        /* The sample settles the machine. */
    }}
    if ({advance}(&campaign->order, effort, !within)) {{
        const {status} status = {begin}(&campaign->run, campaign->order.now.samples_per_period,
                campaign->order.rules.periods, &campaign->sampling, NULL);
        campaign->number = 0;
        if (status != {ok}) {{
            {fail}(&campaign->order, status);
        }}
    }}
    campaign_play_now(campaign{argument});
    return campaign_show(campaign);
",
        fail = calls.fail,
        run_is_whole = calls.run_is_whole,
        advance = calls.advance,
        not_finite = context.constant("RUN_NOT_FINITE"),
        measuring = context.constant("RUN_MEASURING"),
        status = context.global("run_status"),
        push = context.global("run_push"),
        ok = context.constant("RUN_OK"),
        whole = context.global("run_is_whole"),
        begin = context.global("run_begin"),
        argument = context.constants_argument(),
    ));
    let mut parameters = vec![pointer, Parameter::new(format!("const {} *sample", context.global("run_sample")))];
    parameters.extend(context.constants_parameter(true));
    let about = "Takes in the present sample, with the inputs that are applied from then on, and goes on to the next one. A reading or an input that\n\
                 is not finite ends the campaign; a limit makes the next run smaller.";
    context.function(&context.global("run_campaign_push"), about, phase, &parameters, &body);
}

fn update(context: &mut Context<'_>, names: &Names<String>, calls: &Calls, phase: &str, pointer: Parameter) {
    let (ok, one) = (context.constant("RUN_OK"), context.scalar.literal(1.0));
    let mut body = format!(
        "    const size_t next = campaign->order.now.stage + 1u;
    {status} status;
    {real} chi_squared;

    if (campaign->order.state != {due}) {{
        return campaign->phase;
    }}
    status = {identify}(&campaign->run, &campaign->workspace{argument}, &campaign->parameters, &campaign->estimate);
    if (status != {ok}) {{
        {fail}(&campaign->order, status);
        return campaign_show(campaign);
    }}
    {add}(&campaign->pool, &campaign->workspace.factor, campaign->workspace.about, campaign->estimate.chi_squared);
    {solve}(&campaign->pool.factor, &campaign->workspace.found);
    chi_squared = campaign->estimate.chi_squared;
    run_fill(&campaign->workspace.found, campaign->pool.centre, {one}, &campaign->estimate);
    campaign->estimate.chi_squared = chi_squared;
    campaign->estimated = true;
",
        real = context.scalar.name(),
        status = context.global("run_status"),
        due = context.constant("RUN_DUE"),
        identify = context.global("run_identify"),
        argument = context.constants_argument(),
        fail = calls.fail,
        add = calls.add,
        solve = calls.solve,
    );
    for (index, name) in names.columns.iter().enumerate() {
        let moved = format!("campaign->pool.centre[{index}] + campaign->workspace.found.steps[{index}]");
        body.push_str(&statement(1, &format!("campaign->parameters.{name} = {moved};")));
    }
    body.push_str(&format!(
        "    {}(&campaign->order, next < campaign->order.stages ? campaign->stages[next].samples_per_period : 0u);\n    \
         return campaign_show(campaign);\n",
        calls.updated
    ));
    let mut parameters = vec![pointer];
    parameters.extend(context.constants_parameter(true));
    let about = "Makes the update that is due, and goes on to the next run. It takes longer than a sample: the pattern goes on while samples are pushed\n\
                 before it is called.";
    context.function(&context.global("run_campaign_update"), about, phase, &parameters, &body);
}
