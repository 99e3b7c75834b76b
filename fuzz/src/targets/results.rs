//! Results of identifications as other verbs read them, and the parameters of one model in those of another.

use super::machines::machine;
use super::mutated::mutated;
use super::random::Random;
use super::{Verdict, files, refused};
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::OnceLock;
use tpm_runtime::session::{DeclaredModel, StoredResult, compare};
use tpm_runtime::study::{ComparedMotion, ProjectionRequest, Way, projection};
use tpm_symbolic::budget::{self, Budget};

/// Numbers changed here and there, and entries left out that may be missing.
fn varied(value: &mut Value, random: &mut Random) {
    match value {
        Value::Number(number) => {
            if random.below(6) == 0
                && let Some(own) = number.as_f64().filter(|_| number.is_f64())
            {
                let other = own * (0.5 + random.below(1000) as f64 / 900.0);
                *value = serde_json::json!(other);
            }
        }
        Value::Array(list) => list.iter_mut().for_each(|entry| varied(entry, random)),
        Value::Object(map) => {
            if random.below(60) == 0
                && let Some(key) = map.keys().nth(usize::try_from(random.below(map.len() as u64)).expect("small"))
            {
                let key = key.clone();
                map.remove(&key);
            }
            map.values_mut().for_each(|entry| varied(entry, random));
        }
        _ => {}
    }
}

/// The result of a campaign with other numbers, one in three of them changed as a text.
pub(super) fn text(random: &mut Random) -> String {
    let mut result: Value = serde_json::from_str(files::result()).expect("it was written");
    varied(&mut result, random);
    let text = serde_json::to_string_pretty(&result).expect("plain values");
    if random.below(3) == 0 { mutated(&text, random.next()) } else { text }
}

/// A result, compared with that of the campaign it came from.
pub(super) fn comparison(text: &str) -> Verdict {
    static OWN: OnceLock<StoredResult> = OnceLock::new();
    let own = OWN.get_or_init(|| StoredResult::parse(files::result()).expect("it was written"));
    let other = match StoredResult::parse(text) {
        Ok(other) => other,
        Err(fault) => return refused(&fault),
    };
    match compare(own, &other) {
        Ok(found) => {
            assert!(!found.to_string().is_empty() && serde_json::to_string(&found).is_ok(), "a comparison in words");
            Verdict::Answered
        }
        Err(fault) => refused(&fault),
    }
}

/// What stands between two models.
const NEXT_MODEL: &str = "\n-----\n";

/// A machine, and the same without some of its terms; one in eight changed.
pub(super) fn models_text(random: &mut Random) -> String {
    let whole = machine(random, 6);
    let mut lines = Vec::new();
    for line in whole.lines() {
        let Some((terms, input)) = line.split_once(" = ").filter(|_| line.contains("ddot")) else {
            lines.push(line.to_owned());
            continue;
        };
        let mut kept: Vec<&str> = terms.split(" + ").collect();
        if kept.len() > 1 && random.below(3) == 0 {
            kept.remove(usize::try_from(1 + random.below(kept.len() as u64 - 1)).expect("small"));
        }
        lines.push(format!("{} = {input}", kept.join(" + ")));
    }
    // A parameter that no term is left of is no longer declared.
    let body = lines[1..].join("\n");
    let head = lines.first().cloned().unwrap_or_default();
    let head = match head.split_once("parameter ") {
        Some((before, declared)) => {
            let names = declared.trim_end_matches(';').split(", ");
            let used: Vec<&str> = names.filter(|name| body.contains(&format!("{name}*"))).collect();
            format!("{before}parameter {};", used.join(", "))
        }
        None => head,
    };
    let text = format!("{whole}{NEXT_MODEL}{head}\n{body}\n");
    if random.below(8) == 0 { mutated(&text, random.next()) } else { text }
}

/// The parameters of the first model in those of the second, or those of the second that give those of the first.
pub(super) fn projected(text: &str) -> Verdict {
    budget::run(Budget::default(), || project(text)).unwrap_or_else(|halted| {
        refused(&halted);
        Verdict::TooLarge
    })
}

fn project(text: &str) -> Verdict {
    let (from, onto) = text.split_once(NEXT_MODEL).unwrap_or((text, text));
    let model = |text: &str| DeclaredModel::parse("m.tpm", text);
    let (from, onto) = match (model(from), model(onto)) {
        (Ok(from), Ok(onto)) => (from, onto),
        (Err(fault), _) | (_, Err(fault)) => {
            return refused(&fault.to_string().chars().take(3000).collect::<String>());
        }
    };
    let names = ["m", "k", "c", "b", "A", "w"];
    let values: BTreeMap<String, f64> =
        names.iter().zip([2.0, 40.0, 1.5, 3.0, 0.3, 2.0]).map(|(name, value)| ((*name).to_owned(), value)).collect();
    let way = if text.len().is_multiple_of(2) { Way::Onto } else { Way::Back };
    let motion = ComparedMotion::Pattern(None);
    let request = ProjectionRequest { from: &from, onto: &onto, way, values, result: None, motion };
    match projection(&request) {
        Ok(found) => {
            assert!(found.rank <= found.parameters.len(), "a rank of {}", found.rank);
            assert!(found.residual.is_nan() || found.residual >= 0.0, "a share of {}", found.residual);
            assert!(serde_json::to_string(&found).is_ok(), "a projection that cannot be written");
            Verdict::Answered
        }
        Err(fault) => refused(&fault.to_string().chars().take(3000).collect::<String>()),
    }
}
