//! A model's source files in a target language.
//!
//! Invariant: equal models and options give equal bytes; nothing is written to disk here.

pub use crate::emit::c::Scalar;
use crate::emit::estimator::{EmitError, EstimatorSource, Identified};
pub use crate::emit::filter::{Filters, LowPass};
use crate::emit::name::Language as Words;
use crate::emit::regulator::RegulatorSource;
use crate::emit::rounding;
pub use crate::emit::rounding::ranges::{RangeError, Ranges};
use crate::emit::{c, rust};

/// A target language.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Language {
    /// A `no_std` Rust module over `core` and the crate `libm` alone.
    Rust,
    /// A header and a source in C99, over `math.h` alone.
    C,
}

impl Language {
    /// The language that `rust` or `c` names.
    ///
    /// ```
    /// # use tpm_codegen::generate::Language;
    /// assert_eq!((Language::from_name("c"), Language::from_name("basic")), (Some(Language::C), None));
    /// ```
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Rust, Self::C].into_iter().find(|language| language.name() == name)
    }

    /// `rust` or `c`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rust => "rust",
            Self::C => "c",
        }
    }
}

/// Options of the generated source.
#[derive(Clone, Debug)]
pub struct Options<'a> {
    /// The target language.
    pub language: Language,
    /// The command that reproduces this output, for the header.
    pub command: &'a str,
    /// Identified values that the code contains as constants. Values of parameters that the data do not determine come
    /// from stated priors, or do not affect the equations.
    pub identified: Option<&'a Identified>,
    /// Whether the functions of the dynamics are made for the machine with the identified values: these stand in them as numbers, and the
    /// functions do not read the parameters that they are given.
    pub specialise: bool,
    /// Low passes of the feed-forward, common and split; none when not given.
    pub filters: Option<&'a Filters>,
    /// Whether accumulators of harmonics get a function that reduces the weight of earlier samples, for a machine that
    /// changes.
    pub forgetting: bool,
    /// Whether every pattern has a function for single strokes, with rest before and after each.
    pub strokes: bool,
    /// The prefix of names and files in C; the model's name when not given.
    pub prefix: Option<&'a str>,
    /// The scalar type in C. Rust code is generic over both.
    pub scalar: Scalar,
    /// Ranges of what functions read: with them, bounds of rounding errors stand beside the functions and in a file of their own.
    pub ranges: Option<&'a Ranges>,
}

impl<'a> Options<'a> {
    /// Options without identified values and filters, with the model's own prefix and double precision.
    #[must_use]
    pub fn new(language: Language, command: &'a str) -> Self {
        Self {
            language,
            command,
            identified: None,
            specialise: false,
            filters: None,
            forgetting: false,
            strokes: false,
            prefix: None,
            scalar: Scalar::default(),
            ranges: None,
        }
    }
}

/// A generated file.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct File {
    /// Its name, without a folder.
    pub name: String,
    /// Its text.
    pub text: String,
}

/// The functions without a bound of rounding, each with the reason; none in a file other than that with the bounds.
#[must_use]
pub fn unbounded(file: &File) -> Vec<String> {
    if file.name.ends_with(rounding::EXTENSION) { rounding::refused(&file.text) } else { Vec::new() }
}

/// The source files of a regulator: state feedback that keeps a machine at rest at an operating point.
///
/// # Errors
/// [`EmitError`] when the prefix cannot begin names of C, or a number is beyond the scalar.
pub fn generate_regulator(
    regulator: &RegulatorSource,
    language: Language,
    command: &str,
    prefix: Option<&str>,
    scalar: Scalar,
) -> Result<Vec<File>, EmitError> {
    match language {
        Language::Rust => {
            let (name, text) = rust::regulator::file(regulator, command, scalar)?;
            Ok(vec![File { name: format!("{name}.rs"), text }])
        }
        Language::C => {
            let files = c::regulator::files(regulator, command, prefix, scalar)?;
            Ok(vec![
                File { name: format!("{}.h", files.name), text: files.header },
                File { name: format!("{}.c", files.name), text: files.source },
            ])
        }
    }
}

/// The source files of an estimator.
///
/// # Errors
/// [`EmitError`] when no sensor measures a coordinate, the identified values are of another model or leave open what an equation needs, or
/// are not there for code that is made for one machine, no bound of rounding follows from the ranges, a filter is out of range or has no feed-forward to pass, there are no strokes or nothing to forget, or the
/// target language cannot express the model.
pub fn generate(estimator: &EstimatorSource, options: &Options<'_>) -> Result<Vec<File>, EmitError> {
    if let Some(own) = estimator.model.coordinates.iter().find(|coordinate| coordinate.unmeasured) {
        return Err(EmitError::Unmeasured(own.name.clone()));
    }
    let lumping = estimator.plan.lumping.as_ref();
    let identified = options.identified.map(|given| given.with_sums(&estimator.model, &estimator.form, lumping));
    let options = &Options { identified: identified.as_ref(), ..options.clone() };
    if let Some(identified) = options.identified {
        identified.in_order(&estimator.model, &estimator.form)?;
    }
    if let Some(filters) = options.filters {
        estimator.check_filters(filters)?;
    }
    if options.strokes {
        estimator.check_strokes()?;
    }
    if options.forgetting {
        estimator.check_forgetting()?;
    }
    let mut own = options.specialise.then(|| estimator.specialised(options.identified)).transpose()?;
    let mut document = None;
    if let Some(ranges) = options.ranges {
        let both = [Scalar::Double, Scalar::Float];
        let (language, scalars) = match options.language {
            Language::Rust => (Words::Rust, both.as_slice()),
            Language::C => (Words::C, std::slice::from_ref(&options.scalar)),
        };
        let bounded = own.get_or_insert_with(|| estimator.clone());
        let given = (ranges, options.identified);
        document = Some(rounding::add(bounded, given, (language, scalars), options.command)?);
    }
    let estimator = own.as_ref().unwrap_or(estimator);
    let mut files = match options.language {
        Language::Rust => {
            let rust_options = rust::Options {
                command: options.command,
                identified: options.identified,
                filters: options.filters,
                forgetting: options.forgetting,
                strokes: options.strokes,
                standalone: true,
                ..rust::Options::default()
            };
            let text = rust::file(estimator, &rust_options).map_err(|error| EmitError::Layout(error.to_string()))?;
            vec![File { name: format!("{}.rs", rust::module_name(estimator).trim_start_matches("r#")), text }]
        }
        Language::C => {
            let Options { command, identified, filters, forgetting, strokes, prefix, scalar, .. } = *options;
            let files =
                c::files(estimator, &c::Options { command, prefix, scalar, identified, filters, forgetting, strokes })?;
            vec![
                File { name: format!("{}.h", files.name), text: files.header },
                File { name: format!("{}.c", files.name), text: files.source },
            ]
        }
    };
    if let (Some(text), Some(last)) = (document, files.last()) {
        let stem = last.name.split('.').next().unwrap_or_default();
        files.push(File { name: format!("{stem}{}", rounding::EXTENSION), text });
    }
    Ok(files)
}
