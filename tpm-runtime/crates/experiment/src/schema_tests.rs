//! Tests that the schema of experiment files has exactly the fields that the reader accepts.

use crate::Experiment;
use std::collections::BTreeSet;
use tpm_report::{FieldText, fields};

/// The fields that the reader lists when it refuses an unknown one.
fn accepted(text: &str) -> BTreeSet<String> {
    let message = Experiment::parse(text).expect_err("an unknown field").to_string();
    let (_, known) = message.split_once("expected").unwrap_or_else(|| panic!("{text}: {message}"));
    known.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// The text of an experiment with an unknown field in the table at a path.
fn with_unknown(table: &str, all: &[FieldText]) -> String {
    let mut text = "{ unknown_field = 1 }".to_owned();
    let parts: Vec<&str> = table.split('.').collect();
    for depth in (1..=parts.len()).rev() {
        let path = parts[..depth].join(".");
        let is_list = all.iter().any(|field| field.path == path && field.kind.starts_with("list"));
        let value = if is_list { format!("[{text}]") } else { text };
        text = if depth == 1 {
            format!("{} = {value}", parts[0])
        } else {
            format!("{{ {} = {value} }}", parts[depth - 1])
        };
    }
    text
}

#[test]
fn every_field_that_the_reader_accepts_is_explained_and_no_other() {
    let all = fields(&Experiment::schema());
    let below = |table: &str| -> BTreeSet<String> {
        let path = |field: &FieldText| match table {
            "" => Some(field.path.clone()),
            table => field.path.strip_prefix(table)?.strip_prefix('.').map(str::to_owned),
        };
        all.iter().filter_map(path).filter(|rest| !rest.contains('.') && rest != "NAME").collect()
    };
    assert_eq!(below(""), accepted("unknown_field = 1"));
    let mut tables: BTreeSet<&str> = all.iter().filter_map(|field| Some(field.path.rsplit_once('.')?.0)).collect();
    // A stage accepts any name, since its amplitudes and its frequency are fields.
    assert!(tables.remove("schedule.stages"));
    assert!(tables.len() > 10, "{tables:?}");
    for table in tables {
        assert_eq!(below(table), accepted(&with_unknown(table, &all)), "{table}");
    }
    for field in &all {
        assert!(field.meaning.len() > 3, "{} has no meaning", field.path);
    }
}
