//! The generated sources are what is kept of them in `tests/generated`: texts and hashes.

#[allow(dead_code, unreachable_pub, reason = "the program that accepts new texts uses the rest")]
#[path = "../../../tests/src/goldens.rs"]
mod goldens;

use crate::support::root;
use goldens::{Golden, Kept, all, difference};
use std::collections::BTreeSet;
use std::path::Path;

const ACCEPT: &str = "cargo run -p tpm-tests --bin generated -- accept";

#[test]
fn committed_sources_are_current() {
    let goldens = all(&root());
    let stale = Kept::read(&root()).expect("texts and hashes").stale(&goldens);
    if !stale.is_empty() {
        let scratch = Path::new(env!("CARGO_TARGET_TMPDIR")).join("generated");
        let names: Vec<_> = stale.iter().map(String::as_str).collect();
        panic!(
            "not as they are kept in tests/generated: {}\n{}`{ACCEPT}` keeps them as they are now.",
            names.join(", "),
            difference(&root(), &scratch, &goldens, &stale)
        );
    }
}

/// A changed text is found by its hash as well as by its text, and so is a source that is not kept, or kept and not generated.
#[test]
fn every_change_of_a_source_is_found() {
    let goldens = all(&root());
    let kept = Kept::read(&root()).expect("texts and hashes");
    let stale = kept.stale(&goldens);
    let found = |change: &dyn Fn(&mut Vec<Golden>)| {
        let mut changed = goldens.clone();
        change(&mut changed);
        kept.stale(&changed)
    };
    for (at, golden) in goldens.iter().enumerate() {
        let middle = golden.text.len() / 2;
        let middle = (middle..).find(|&at| golden.text.is_char_boundary(at)).expect("a text");
        let mut expected = &stale | &BTreeSet::from([golden.name.clone()]);
        assert_eq!(found(&|changed| changed[at].text.insert(middle, ' ')), expected);
        assert_eq!(found(&|changed| drop(changed.remove(at))), expected);
        expected.insert(format!("{}x", golden.name));
        assert_eq!(found(&|changed| changed[at].name.push('x')), expected);
    }
}
