//! `tpm expand`: the exact harmonic coefficient table.

use crate::failure::{Failure, Outcome};
use crate::input::load::Loaded;
use crate::interrupt;
use crate::output::{file, progress};
use clap::ValueEnum;
use std::ops::ControlFlow;
use std::path::PathBuf;
use tpm_codegen::emit::table;
use tpm_symbolic::budget::{self, Budget};
use tpm_symbolic::harmonic::expand::{ExpandError, ExpandOptions, expand_with};

/// How a table is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// The contract's JSON (tpm.table/1).
    Json,
    /// One line per entry.
    Csv,
    /// A matrix of harmonics and parameters per equation.
    Markdown,
    /// A document that pdflatex compiles.
    Latex,
}

/// Options of `tpm expand`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The model file.
    file: PathBuf,
    /// How to write the table.
    #[arg(long, value_enum, default_value = "markdown")]
    format: Format,
    /// The pattern to expand under; the model's first when not given.
    #[arg(long, value_name = "NAME")]
    pattern: Option<String>,
    /// Highest harmonic kept of terms that have infinitely many, such as sign(dot(x)); the pattern's own number when
    /// not given, else 31.
    #[arg(long, value_name = "N")]
    harmonics: Option<usize>,
    /// Write to this file instead of standard output.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> Outcome {
    let loaded = Loaded::from_file(&args.file)?;
    let pattern = loaded.pattern(args.pattern.as_deref())?;
    let (prepared, constants) = loaded.for_tables()?;
    let bar = progress::Bar::new("expanding");
    let expanded = interrupt::watched(|go_on| {
        let mut step = |step: tpm_symbolic::harmonic::expand::Progress| {
            bar.set(step.done as u64, step.total as u64);
            if go_on() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let harmonics = args.harmonics.or_else(|| loaded.harmonics(pattern));
        let mut options = ExpandOptions { progress: Some(&mut step), harmonics, ..ExpandOptions::default() };
        // Between two steps there may be long arithmetic.
        let budget = Budget::of_outer().stopped_by(interrupt::requested);
        budget::run(budget, || expand_with(&prepared.model, &prepared.form, pattern, &mut options))
    });
    drop(bar);
    let table = expanded?.map_err(|error| match error {
        ExpandError::Stopped { .. } => Failure::Interrupted,
        ExpandError::TooLarge { .. } => loaded.at_with_help(&error, "to expand it all the same, give --allow-large"),
        error => loaded.at(&error),
    })?;
    let table = table.gathered(constants, prepared.model.is_constant());
    for tail in &table.tails {
        file::remark(&format!("remark: {}", table::left_out(&table, tail)));
    }
    if args.format == Format::Csv {
        for constant in &table.constants {
            file::remark(&format!("remark: {} = {}", constant.name, constant.definition));
        }
    }
    let text = match args.format {
        Format::Json => file::json(&table)?,
        Format::Csv => table::csv(&table),
        Format::Markdown => table::markdown(&table),
        Format::Latex => table::latex(&table),
    };
    file::emit(args.output.as_deref(), &text)
}
