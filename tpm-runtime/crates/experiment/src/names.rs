//! Resolution of an experiment's names to indices of a model, and checks of its values.

use crate::error::ExperimentError;
use crate::file::Named;
use tpm_controller::model::Model;

/// Smallest Jaro-Winkler similarity, from 0 to 1, at which a known name is suggested in place of an unknown one.
const SIMILAR: f64 = 0.7;

/// Names of one kind in a model.
pub(super) struct Names {
    pub(super) kind: &'static str,
    pub(super) names: Vec<String>,
}

impl Names {
    pub(super) fn index(&self, place: &str, name: &str) -> Result<usize, ExperimentError> {
        self.names.iter().position(|known| known == name).ok_or_else(|| ExperimentError::UnknownName {
            place: place.to_string(),
            kind: self.kind,
            name: name.to_string(),
            available: self.names.clone(),
            near: near(name, self.names.iter().map(String::as_str)),
        })
    }

    /// One value per name, `default` where none is given.
    pub(super) fn fill(&self, place: &str, given: &Named, default: f64) -> Result<Vec<f64>, ExperimentError> {
        let mut values = vec![default; self.names.len()];
        for (name, &value) in given {
            let at = self.index(place, name)?;
            require(value.is_finite(), format!("{place}.{name}"), value, "the value must be finite")?;
            values[at] = value;
        }
        Ok(values)
    }

    /// One value per name, each of which must be given.
    pub(super) fn all(&self, place: &str, given: &Named) -> Result<Vec<f64>, ExperimentError> {
        let values = self.fill(place, given, f64::NAN)?;
        match values.iter().position(|value| value.is_nan()) {
            Some(at) => Err(ExperimentError::Missing { place: place.to_string(), name: self.names[at].clone() }),
            None => Ok(values),
        }
    }
}

pub(super) fn require(holds: bool, key: String, value: f64, must: &'static str) -> Result<(), ExperimentError> {
    if holds { Ok(()) } else { Err(ExperimentError::Invalid { key, value, must }) }
}

pub(super) fn positive(key: &str, value: f64) -> Result<(), ExperimentError> {
    require(value.is_finite() && value > 0.0, key.to_string(), value, "the value must be positive")
}

pub(super) fn parameters(model: &dyn Model<f64>) -> Names {
    let names = (0..model.dims().parameters).map(|i| model.parameter(i).name.to_string()).collect();
    Names { kind: "parameter", names }
}

pub(super) fn coordinates(model: &dyn Model<f64>) -> Names {
    let names = (0..model.dims().coordinates).map(|i| model.coordinate(i).name.to_string()).collect();
    Names { kind: "coordinate", names }
}

pub(super) fn inputs(model: &dyn Model<f64>) -> Names {
    let names = (0..model.dims().inputs).map(|i| model.input(i).name.to_string()).collect();
    Names { kind: "input", names }
}

/// The names most similar to `name`, most similar first, three at most.
pub(super) fn near<'a>(name: &str, names: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut scored: Vec<(f64, &str)> = names
        .into_iter()
        .map(|candidate| (strsim::jaro_winkler(name, candidate), candidate))
        .filter(|(score, _)| *score >= SIMILAR)
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    scored.dedup_by(|a, b| a.1 == b.1);
    scored.into_iter().take(3).map(|(_, candidate)| candidate.to_string()).collect()
}
