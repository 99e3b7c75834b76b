//! The reference of a run in C, with which estimators compare it.

use super::super::names::Names;
use super::super::run::REFERENCE;
use super::context::{Context, Parameter};
use super::layout::statement;
use super::support;

/// Writes the functions that the caller names by the model's own names.
pub(super) fn write(context: &mut Context<'_>, names: &Names<String>) {
    let sizes = support::sizes(context, &["RUN_COORDINATES", "RUN_LINES"]);
    let [begin, push] = support::write(context, &support::RUN, |translator| {
        Ok([translator.method("RunReference", &sizes, "begin")?, translator.method("RunReference", &sizes, "push")?])
    });
    let (status, reference) = (context.global("run_status"), context.global("run_reference"));
    let pointer = Parameter::new(format!("{reference} *reference"));
    let about =
        format!("Before the first sample of the reference of a run with so many samples in a period. {REFERENCE}");
    let name = context.global("run_reference_begin");
    let body = format!("    return {begin}(reference, samples_per_period);\n");
    context.function(&name, &about, &status, &[pointer.clone(), Parameter::new("uint32_t samples_per_period")], &body);
    let list: Vec<String> = names.coordinates.iter().map(|names| format!("sample->{}", names.field)).collect();
    let (real, size) = (context.scalar.name(), context.constant("RUN_COORDINATES"));
    let mut body = statement(1, &format!("const {real} values[{size}] = {{{}}};", list.join(", ")));
    body.push_str(&format!("\n    return {push}(reference, number, values);\n"));
    let parameters = [
        pointer,
        Parameter::new("uint32_t number"),
        Parameter::new(format!("const {} *sample", context.global("run_measured"))),
    ];
    let about = "Takes in the reference of sample `number`, counted as the samples of the run are; samples behind the first period are not\n\
                 used. A status other than the first stays until the reference is begun again.";
    context.function(&context.global("run_reference_push"), about, &status, &parameters, &body);
}
