//! What a user may say of an estimation from a log, by the model's names.

use crate::error::{SessionError, Setting};
use crate::options::LogOptions;
use crate::reading::RecordSettings;
use std::collections::{BTreeMap, BTreeSet};
use tpm_controller::model::Model;
use tpm_estimate::{Domain, Frozen, Refine, Settings, Weights, is_static};
use tpm_motion::Dynamics;
use tpm_physical::PhysicalSettings;

/// Processor time that a log may take where nothing is said of it, s.
pub const USUAL_TIME: f64 = 60.0;

/// What an estimation from a log is to do, and what is known of the machine beforehand; names and units are those of the model.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct EstimationSettings {
    /// Known dynamics between the recorded value of an input and its force, by input.
    #[serde(skip)]
    pub actuators: BTreeMap<String, Dynamics>,
    /// Inputs whose delays are found with the parameters.
    #[serde(skip_serializing_if = "BTreeSet::is_empty")]
    pub fitted_delays: BTreeSet<String>,
    /// Whether harmonics or the time domain; harmonics of a log that repeats, when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub domain: Option<Domain>,
    /// Highest harmonic to use; chosen from the spectrum when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub harmonics: Option<usize>,
    /// How much every equation counts.
    pub weights: Weights,
    /// Whether the estimates are refined by simulating the model.
    pub refine: Refine,
    /// Values of the constants that are known at run time, by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub constants: BTreeMap<String, f64>,
    /// Values known before, by parameter or physical parameter: what an unobservable direction keeps, or where the search for a
    /// physical parameter starts.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub prior: BTreeMap<String, f64>,
    /// Standard deviations with which sensors are calibrated, which enter those of the parameters: of the zero of a coordinate, in its unit,
    /// of the gain of an input, a share of it. What is not named counts as exact.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub calibration: BTreeMap<String, f64>,
    /// Values that are held, by parameter or physical parameter.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub frozen: BTreeMap<String, f64>,
    /// Least and largest value of a physical parameter; infinite for none.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub bounds: BTreeMap<String, (f64, f64)>,
}

impl EstimationSettings {
    /// These settings by index for a log that is read so, with every name checked against the model; `physical` are the names of the
    /// parameters behind lumped ones.
    ///
    /// # Errors
    /// [`SessionError::UnknownName`], [`SessionError::ParameterAsConstant`], [`SessionError::OutsideInterval`] of a held value, and
    /// [`SessionError::Constants`] where a constant has no value.
    pub(super) fn resolve(
        &self,
        reading: &RecordSettings,
        model: &dyn Model<f64>,
        physical: &[String],
    ) -> Result<LogOptions, SessionError> {
        let dims = model.dims();
        let names = |count: usize, name: &dyn Fn(usize) -> String| -> Vec<String> { (0..count).map(name).collect() };
        let parameters = names(dims.parameters, &|j| model.parameter(j).name.to_string());
        let either: Vec<String> = parameters.iter().chain(physical).cloned().collect();
        let constants = names(dims.constants, &|i| model.constant(i).name.to_string());
        let coordinates = names(dims.coordinates, &|c| model.coordinate(c).name.to_string());
        let inputs = names(dims.inputs, &|i| model.input(i).name.to_string());
        let signals: Vec<String> = coordinates.iter().chain(&inputs).cloned().collect();
        for (setting, given, known) in [
            (Setting::Prior, self.prior.keys().collect::<Vec<_>>(), &either),
            (Setting::Frozen, self.frozen.keys().collect(), &either),
            (Setting::Constant, self.constants.keys().collect(), &constants),
            (Setting::Calibration, self.calibration.keys().collect(), &signals),
            (Setting::Actuator, self.actuators.keys().chain(&self.fitted_delays).collect(), &inputs),
        ] {
            if let Some(name) = given.into_iter().find(|name| !known.contains(name)) {
                if setting == Setting::Constant && either.contains(name) {
                    return Err(SessionError::ParameterAsConstant { name: name.clone() });
                }
                return Err(SessionError::UnknownName { setting, name: name.clone(), known: known.clone() });
            }
        }
        for (j, name) in parameters.iter().enumerate() {
            if let (Some(&value), Some(interval)) = (self.frozen.get(name), model.parameter_interval(j))
                && !(interval[0]..=interval[1]).contains(&value)
            {
                let setting = Setting::Frozen;
                return Err(SessionError::OutsideInterval { setting, name: name.clone(), value, interval });
            }
        }
        let missing: Vec<String> =
            constants.iter().filter(|name| !self.constants.contains_key(*name)).cloned().collect();
        if !missing.is_empty() {
            return Err(SessionError::Constants { names: missing });
        }
        if let Some((name, &value)) = self.calibration.iter().find(|(_, value)| !(value.is_finite() && **value >= 0.0))
        {
            return Err(SessionError::Deviation { name: name.clone(), value });
        }
        let held = |(parameter, name): (usize, &String)| Some(Frozen { parameter, value: *self.frozen.get(name)? });
        let mut reading = reading.clone();
        reading.columns.timeless = is_static(model);
        let following: Vec<_> = (0..dims.coordinates).map(|c| model.presliding(c)).collect();
        let follows = following.iter().any(Option::is_some);
        let mut options = LogOptions {
            reading,
            actuators: inputs.iter().map(|name| self.actuators.get(name).copied().unwrap_or_default()).collect(),
            following,
            // What follows from a motion has no finite series.
            domain: if follows { Some(Domain::Time) } else { self.domain },
            refine: self.refine,
            constants: constants.iter().map(|name| self.constants[name]).collect(),
            estimation: Settings {
                harmonics: self.harmonics,
                weights: self.weights,
                frozen: parameters.iter().enumerate().filter_map(held).collect(),
                fitted_delays: (0..inputs.len()).filter(|&i| self.fitted_delays.contains(&inputs[i])).collect(),
                ..Settings::default()
            },
            zero_deviations: coordinates.iter().map(|name| self.calibration.get(name).copied()).collect(),
            gain_deviations: inputs.iter().map(|name| self.calibration.get(name).copied()).collect(),
            stated: Vec::new(),
        };
        if parameters.iter().any(|name| self.prior.contains_key(name)) {
            let prior: Vec<Option<f64>> = parameters.iter().map(|name| self.prior.get(name).copied()).collect();
            options.state(&prior);
        }
        Ok(options)
    }

    /// What is said of physical parameters.
    pub(super) fn physical(&self) -> PhysicalSettings {
        PhysicalSettings {
            prior: self.prior.clone(),
            frozen: self.frozen.clone(),
            bounds: self.bounds.clone(),
            constants: self.constants.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::LogRequest;
    use tpm_controller::harmonics::Hold;

    #[test]
    fn a_request_is_written_with_all_its_settings_side_by_side() {
        let mut request = LogRequest::new("run.csv").map("x", "position").constant("g", 9.81).hold(Hold::Zoh);
        request.reading.period = Some(0.5);
        request.estimation.harmonics = Some(9);
        request.estimation.frozen.insert("k".into(), 2.0);
        let written = serde_json::to_string(&request).expect("a request is written");
        assert_eq!(
            written,
            r#"{"path":"run.csv","map":{"x":"position"},"period":0.5,"hold":"zoh","harmonics":9,"weights":"noise","refine":"auto","constants":{"g":9.81},"frozen":{"k":2.0}}"#
        );
    }
}
