//! Filtered feed-forward: the low passes, and the common and split schemes.

use super::super::filter::{Coefficients, Filters, LowPass};
use super::context::{Context, Parameter};
use super::layout::{doc, statement};

/// Writes the low passes and the schemes, where filters were requested.
pub(super) fn write(context: &mut Context<'_>) {
    // `generate` has refused low passes that do not exist, and models whose feed-forward cannot be split.
    let Some(filters) = context.filters else { return };
    let Ok((dependent, independent)) = filters.coefficients() else { return };
    if context.estimator.plan.feed_forward_parts.is_none() {
        return;
    }
    // The state of a low pass, and its steady state.
    let real = context.scalar.name();
    let fields = format!(
        "{}    {real} inputs[2];\n{}    {real} outputs[2];\n",
        doc(1, "The last two samples that came in, the newest first."),
        doc(1, "The last two that went out.")
    );
    context.structure("low_pass", "The past of a low pass: memory of the caller.", &fields);
    let filter = format!("{} *filter", context.global("low_pass"));
    let body =
        "    filter->inputs[0] = filter->inputs[1] = value;\n    filter->outputs[0] = filter->outputs[1] = value;\n";
    let parameters = [Parameter::new(filter.clone()), Parameter::new(format!("{real} value"))];
    context.function(&context.global("low_pass_settle"), "Settles in a constant.", "void", &parameters, body);
    low_pass(context, "dependent_low_pass", filters, &filters.dependent, &dependent, Filters::DEPENDENT);
    if let (Some(filter), Some(coefficients)) = (&filters.independent, &independent) {
        low_pass(context, "independent_low_pass", filters, filter, coefficients, Filters::INDEPENDENT);
    }
    // The common scheme: one low pass per input for the whole feed-forward.
    let (of_slow, of_fast) = (context.global("dependent_low_pass"), context.global("independent_low_pass"));
    let settle = context.global("low_pass_settle");
    let state = |name: &str, about: &str, context: &Context<'_>| {
        format!("{}    {} {name}[{}];\n", doc(1, about), context.global("low_pass"), context.constant("INPUTS"))
    };
    let whole = state("whole", "Past of the inputs.", context);
    scheme(
        context,
        "common",
        Filters::COMMON,
        &whole,
        &|i, field| statement(1, &format!("{settle}(&filters->whole[{i}], independent.{field} + dependent.{field});")),
        &|i, field| format!("{of_slow}(&filters->whole[{i}], independent.{field} + dependent.{field})"),
    );
    // The split scheme: low passes for the parts.
    let mut both = state("dependent", "Past of the motion-dependent part, per input.", context);
    let fast = independent.is_some();
    if fast {
        both.push_str(&state("independent", "Past of the motion-independent part, per input.", context));
    }
    scheme(
        context,
        "split",
        filters.split(),
        &both,
        &|i, field| {
            let mut text = statement(1, &format!("{settle}(&filters->dependent[{i}], dependent.{field});"));
            if fast {
                text.push_str(&statement(1, &format!("{settle}(&filters->independent[{i}], independent.{field});")));
            }
            text
        },
        &|i, field| {
            let slow = format!("{of_slow}(&filters->dependent[{i}], dependent.{field})");
            if fast {
                format!("{slow} + {of_fast}(&filters->independent[{i}], independent.{field})")
            } else {
                format!("{slow} + independent.{field}")
            }
        },
    );
}

fn low_pass(
    context: &mut Context<'_>,
    name: &str,
    filters: &Filters,
    filter: &LowPass,
    coefficients: &Coefficients,
    part: &str,
) {
    let (real, two) = (context.scalar.name(), context.scalar.literal(2.0));
    let number = |value: &tpm_symbolic::number::rational::Rational| context.scalar.number(value);
    let Coefficients { gain, feedback: [one, last] } = coefficients;
    let sign = |value: &tpm_symbolic::number::rational::Rational| {
        let text = number(value);
        match text.strip_prefix('-') {
            Some(positive) => format!("+ {positive}"),
            None => format!("- {text}"),
        }
    };
    let mut body = statement(
        1,
        &format!(
            "const {real} output = {} * (input + {two} * filter->inputs[0] + filter->inputs[1]) {} * filter->outputs[0] {} * filter->outputs[1];",
            number(gain),
            sign(one),
            sign(last)
        ),
    );
    body.push('\n');
    body.push_str(
        "    filter->inputs[1] = filter->inputs[0];\n    filter->inputs[0] = input;\n    filter->outputs[1] = filter->outputs[0];\n    filter->outputs[0] = output;\n    return output;\n",
    );
    let parameters =
        [Parameter::new(format!("{} *filter", context.global("low_pass"))), Parameter::new(format!("{real} input"))];
    let about = format!("Takes in one sample and returns the filtered one.\n\n{}", filters.about(filter, part));
    context.function(&context.global(name), &about, real, &parameters, &body);
}

/// Gives the code for one input, from its index and its field.
type OfInput<'a> = dyn Fn(usize, &str) -> String + 'a;

fn scheme(context: &mut Context<'_>, name: &str, about: &str, state: &str, settle: &OfInput<'_>, next: &OfInput<'_>) {
    context.structure(
        &format!("{name}_filters"),
        &format!("{about}. The past of its filters: memory of the caller."),
        state,
    );
    let filters = format!("{} *filters", context.global(&format!("{name}_filters")));
    let mut parameters = vec![
        Parameter::new(filters),
        Parameter::new(format!("const {} *motion", context.global("motion"))),
        Parameter::new(format!("const {} *parameters", context.global("parameters"))),
    ];
    parameters.extend(context.constants_parameter(true));
    let constants = context.constants_argument();
    let parts: String = ["independent", "dependent"]
        .iter()
        .map(|part| format!("    {} {part};\n", context.global("inputs")))
        .chain(std::iter::once("\n".to_owned()))
        .chain(["independent", "dependent"].iter().map(|part| {
            let function = context.global(&format!("feed_forward_{part}"));
            statement(1, &format!("{function}(motion, parameters{constants}, &{part});"))
        }))
        .collect();
    let fields: Vec<String> = context.names.inputs.iter().map(|(_, name)| name.clone()).collect();
    let body: String =
        std::iter::once(parts.clone()).chain(fields.iter().enumerate().map(|(i, field)| settle(i, field))).collect();
    let settled = "Settles as if the motion had stood here for long, so that nothing jerks at the start.";
    context.function(&context.global(&format!("{name}_feed_forward_settle")), settled, "void", &parameters, &body);
    parameters.push(Parameter::new(format!("{} *inputs", context.global("inputs"))));
    let stores =
        fields.iter().enumerate().map(|(i, field)| statement(1, &format!("inputs->{field} = {};", next(i, field))));
    let body: String = std::iter::once(parts).chain(stores).collect();
    let about = format!("The inputs of the next sample. {about}.");
    context.function(&context.global(&format!("{name}_feed_forward")), &about, "void", &parameters, &body);
}
