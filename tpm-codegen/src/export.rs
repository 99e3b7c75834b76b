//! Models with identified values in the formats of other programs.
//!
//! Invariant: what a format cannot hold is named in [`Exported::lost`] with what stands in its place, and a file of a result that is not
//! trusted says so.

use crate::emit::c;
use crate::emit::casadi;
use crate::emit::estimator::{EmitError, EstimatorSource, Identified, Part};
use crate::emit::infix::Given;
use crate::emit::name::{camel, snake};
use crate::emit::structured_text;
use crate::generate::{File, Language, Options, Scalar, generate};
use serde::Deserialize;
use std::collections::BTreeMap;

/// A format of another program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// A file in Python with functions of CasADi: inverse dynamics, and forward dynamics where there are any.
    Casadi,
    /// Structured text (IEC 61131-3): function blocks for the feed-forward and for the friction in it.
    StructuredText,
    /// A library for Arduino around the code in C, single precision.
    Arduino,
}

/// What a result says beside its values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Told {
    /// Why the result is not all that was asked for; nothing when it is trusted.
    pub shortfall: Option<String>,
    /// What lies between inputs and forces: one sentence for every input with a delay, a low pass or a bandwidth.
    pub actuators: Vec<String>,
}

impl Told {
    /// Reads the JSON of a result. Of other files nothing is known.
    #[must_use]
    pub fn from_json(text: &str) -> Self {
        #[derive(Deserialize)]
        struct Whole {
            shortfall: Option<String>,
            #[serde(default)]
            warnings: Vec<String>,
            #[serde(default)]
            findings: Vec<Finding>,
            log: Option<Log>,
        }
        #[derive(Deserialize)]
        struct Finding {
            severity: Option<String>,
        }
        #[derive(Deserialize)]
        struct Log {
            #[serde(default)]
            actuators: BTreeMap<String, Actuator>,
        }
        #[derive(Deserialize)]
        struct Actuator {
            #[serde(default)]
            delay: f64,
            low_pass: Option<(f64, f64)>,
            bandwidth: Option<f64>,
        }
        let Ok(whole) = serde_json::from_str::<Whole>(text) else { return Self::default() };
        // Results of the first schema name no shortfall.
        let grave = whole.findings.iter().position(|own| own.severity.as_deref() == Some("distrust"));
        let shortfall = whole.shortfall.or_else(|| grave.and_then(|place| whole.warnings.get(place).cloned()));
        let of = |(input, own): (&String, &Actuator)| {
            let parts = [
                (own.delay != 0.0).then(|| format!("a delay of {} s", own.delay)),
                own.low_pass.map(|(w, quality)| format!("a low pass of {w} rad/s and quality {quality}")),
                own.bandwidth.map(|bandwidth| format!("a bandwidth of {bandwidth} rad/s")),
            ];
            let parts: Vec<String> = parts.into_iter().flatten().collect();
            (!parts.is_empty()).then(|| {
                format!("{} between the input `{input}` and its force: `{input}` acts at once", parts.join(" and "))
            })
        };
        let actuators = whole.log.iter().flat_map(|log| &log.actuators).filter_map(of).collect();
        Self { shortfall, actuators }
    }

    /// A sentence on a result that is not trusted.
    #[must_use]
    pub fn note(&self) -> Option<String> {
        let why = self.shortfall.as_ref()?;
        Some(format!("Values of a result that is not trusted: {why}"))
    }
}

/// What is exported.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The identified values.
    pub identified: &'a Identified,
    /// What the result says beside them.
    pub told: &'a Told,
    /// The command that reproduces the files, for their headers.
    pub command: &'a str,
}

/// Files of another program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// The files; their names begin with folders, parted by `/`, where the format asks for these.
    pub files: Vec<File>,
    /// One sentence for everything that the format cannot hold, with what stands in its place.
    pub lost: Vec<String>,
}

/// A model with identified values in a format.
///
/// # Errors
/// [`EmitError`] when no sensor measures a coordinate, the values are of another model or leave open what an equation needs, a value is
/// beyond single precision where the format has no other, or the format cannot express the model.
pub fn export(estimator: &EstimatorSource, format: Format, request: &Request<'_>) -> Result<Exported, EmitError> {
    let Request { identified, told, command } = *request;
    if let Some(own) = estimator.model.coordinates.iter().find(|coordinate| coordinate.unmeasured) {
        return Err(EmitError::Unmeasured(own.name.clone()));
    }
    let model = &estimator.model;
    let identified = identified.with_sums(model, &estimator.form, estimator.plan.lumping.as_ref());
    let settled = identified.in_order(model, &estimator.form)?;
    let values: Vec<f64> = settled.iter().map(|own| own.value).collect();
    let constants: Vec<Option<f64>> = (estimator.plan.evaluation.constants.iter())
        .map(|symbol| {
            let name = model.quantity(*symbol).name.as_str();
            identified.parameters.iter().find(|own| own.name == name).and_then(|own| own.value)
        })
        .collect();
    let mut lost = told.actuators.clone();
    for (symbol, _) in estimator.plan.evaluation.constants.iter().zip(&constants).filter(|(_, own)| own.is_none()) {
        let instead = match format {
            Format::Casadi => "an argument without a value",
            Format::StructuredText => "an input of the blocks that is 0 until it is set",
            Format::Arduino => "a member of the constants, which is 1 in the example",
        };
        lost.push(format!(
            "the constant `{}`, of which the result has no value: {instead}",
            model.quantity(*symbol).name
        ));
    }
    let mut own = estimator.clone();
    if format == Format::Casadi {
        match own.clone().with(&[Part::ForwardDynamics]) {
            Ok(with) => own = with,
            Err(EmitError::Part(why)) => lost.push(format!("no forward dynamics: {why}")),
            Err(other) => return Err(other),
        }
    }
    let what = match format {
        Format::Casadi => "functions of CasADi over SX",
        Format::StructuredText => "function blocks in structured text (IEC 61131-3)",
        Format::Arduino => "a library for Arduino",
    };
    let mut about = format!("`{}`: {what}. Generated by\n`{command}`; to change it, change the model.\n\n", model.name);
    about += &told.note().map_or_else(String::new, |note| format!("{note}\n\n"));
    about += &identified.about(&settled);
    if !lost.is_empty() {
        about += &format!("\nNot held here:\n\n{}", lost.iter().map(|own| format!("- {own}\n")).collect::<String>());
    }
    let given = Given { about: about.trim_end(), values: &values, constants: &constants };
    let name = snake(&model.name);
    let files = match format {
        Format::Casadi => vec![File { name: format!("{name}.py"), text: casadi::file(&own, &given) }],
        Format::StructuredText => {
            vec![File { name: format!("{name}.st"), text: structured_text::file(&own, &given) }]
        }
        Format::Arduino => arduino(&own, &identified, &given, command)?,
    };
    Ok(Exported { files, lost })
}

/// The folder of a library as the development environment of Arduino expects it.
fn arduino(
    estimator: &EstimatorSource,
    identified: &Identified,
    given: &Given<'_>,
    command: &str,
) -> Result<Vec<File>, EmitError> {
    let options = Options { identified: Some(identified), scalar: Scalar::Float, ..Options::new(Language::C, command) };
    let mut files = generate(estimator, &options)?;
    let header = files.first().map(|file| file.name.clone()).unwrap_or_default();
    for file in &mut files {
        file.name.insert_str(0, "src/");
    }
    let options = c::Options {
        command,
        prefix: None,
        scalar: Scalar::Float,
        identified: Some(identified),
        filters: None,
        forgetting: false,
        strokes: false,
    };
    let example = c::sketch::sketch(estimator, &options, given.constants)?;
    let name = camel(&estimator.model.name);
    let sentence = format!("Feed-forward and estimator of the model {}, with identified values.", estimator.model.name);
    // `version` is that of the library's form, and the fields are those that the library manager asks for.
    let properties = format!(
        "name={name}\nversion=1.0.0\nauthor=generated\nmaintainer=generated\nsentence={sentence}\nparagraph=Generated by {command}.\n\
         category=Device Control\nurl=https://www.arduino.cc/\narchitectures=*\nincludes={header}\n"
    );
    files.push(File { name: "library.properties".to_owned(), text: properties });
    files.push(File { name: format!("examples/{name}/{name}.ino"), text: example });
    files.push(File { name: "README.md".to_owned(), text: format!("# {name}\n\n{}\n", given.about) });
    Ok(files)
}
