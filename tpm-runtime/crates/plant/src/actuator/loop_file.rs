//! Loop files: feedback and filters of a controller with feed-forward.
//!
//! ```toml
//! settle_periods = 4              # before the period that is looked at; 4 when not given
//! feedback_filtered = false       # whether the feedback passes the filter too; false when not given
//! at_actual_motion = false        # whether the feed-forward takes actual positions and velocities; false when not given
//!
//! [[feedback]]                    # u = -kp e - kd e', one table per path
//! input = "F"
//! coordinate = "x"
//! kp = 1000.0
//! kd = 100.0
//!
//! [filter]                        # of the motion-dependent part, and of everything in the common scheme
//! natural_frequency = 100.0       # rad/s
//! quality = 1.0                   # 1/sqrt(2) when not given
//!
//! [independent_filter]            # of the motion-independent part in the split scheme; none when not given
//! natural_frequency = 2000.0
//!
//! [plant]                         # true values of parameters where they differ from those of the feed-forward
//! m = 1.1
//! ```
//!
//! Invariant: every field is documented here, unknown fields are refused, and a fault is reported with line and column.

use crate::actuator::drive::Scheme;
use crate::actuator::placed::{self, FileFault, Placed, Table};
use tpm_controller::control::Gain;
use tpm_controller::model::Model;
use tpm_motion::LowPass;

/// Periods before the one that is recorded, when the file gives none.
const DEFAULT_SETTLE_PERIODS: usize = 4;
/// Most periods before the one that is recorded.
const MOST_SETTLE_PERIODS: f64 = 1e6;

/// A loop file as it was read.
#[derive(Clone, Debug)]
pub struct LoopFile {
    text: String,
    whole: Table,
}

impl LoopFile {
    /// Reads a loop file's text.
    ///
    /// # Errors
    /// [`FileFault`] when it is no TOML or has unknown fields.
    pub fn parse(text: &str) -> Result<Self, FileFault> {
        let whole = placed::parse(text)?;
        let known = [
            "settle_periods",
            "feedback_filtered",
            "at_actual_motion",
            "feedback",
            "filter",
            "independent_filter",
            "plant",
        ];
        whole.only(text, &known)?;
        Ok(LoopFile { text: text.to_string(), whole })
    }

    /// Periods before the one that is recorded.
    ///
    /// # Errors
    /// [`FileFault`] when it is no whole number.
    pub fn settle_periods(&self) -> Result<usize, FileFault> {
        match self.whole.number(&self.text, "settle_periods")? {
            None => Ok(DEFAULT_SETTLE_PERIODS),
            Some(Placed { value, .. }) if (0.0..=MOST_SETTLE_PERIODS).contains(&value) && value.fract() == 0.0 => {
                Ok(value as usize)
            }
            Some(Placed { value, offset }) => {
                let message =
                    format!("settle_periods = {value}: the value must be a whole number up to {MOST_SETTLE_PERIODS}");
                Err(FileFault::at(&self.text, offset, message))
            }
        }
    }

    /// True values of parameters that differ from those of the feed-forward, by name.
    ///
    /// # Errors
    /// [`FileFault`] when one is no finite number.
    pub fn plant(&self) -> Result<Vec<(&str, f64)>, FileFault> {
        let Some(plant) = self.whole.table(&self.text, "plant")? else { return Ok(Vec::new()) };
        let mut values = Vec::new();
        for Placed { value: name, .. } in plant.keys() {
            if let Some(found) = plant.number(&self.text, name)? {
                values.push((name, found.value));
            }
        }
        Ok(values)
    }

    /// The fault of a name in the table `plant`, at its line and column.
    #[must_use]
    pub fn refuse_plant(&self, name: &str, message: String) -> FileFault {
        let plant = self.whole.table(&self.text, "plant").ok().flatten();
        let key = plant.and_then(|plant| plant.keys().find(|key| key.value == name));
        FileFault::at(&self.text, key.map_or(0, |key| key.offset), message)
    }

    /// The scheme for a model, split or common.
    ///
    /// # Errors
    /// [`FileFault`] for a name that the model does not have and a filter that is none.
    pub fn scheme(&self, model: &dyn Model<f64>, split: bool) -> Result<Scheme, FileFault> {
        let text = &self.text;
        let dims = model.dims();
        let inputs: Vec<&str> = (0..dims.inputs).map(|i| model.input(i).name).collect();
        let coordinates: Vec<&str> = (0..dims.coordinates).map(|c| model.coordinate(c).name).collect();
        let index = |path: &Table, kind: &str, names: &[&str]| {
            let name = path.required(text, kind, "", path.text(text, kind)?)?;
            names.iter().position(|known| *known == name.value).ok_or_else(|| {
                let message = format!("the model has no {kind} `{}`; it has {}", name.value, names.join(", "));
                FileFault::at(text, name.offset, message)
            })
        };
        let mut gains = Vec::new();
        for path in self.whole.tables(text, "feedback")? {
            path.only(text, &["input", "coordinate", "kp", "kd"])?;
            gains.push(Gain {
                input: index(path, "input", &inputs)?,
                coordinate: index(path, "coordinate", &coordinates)?,
                proportional: path.required(text, "kp", "", path.number(text, "kp")?)?.value,
                derivative: path.required(text, "kd", "", path.number(text, "kd")?)?.value,
            });
        }
        Ok(Scheme {
            gains,
            filter: self.low_pass("filter")?,
            split,
            independent_filter: self.low_pass("independent_filter")?,
            feedback_filtered: self.whole.flag(text, "feedback_filtered")?.unwrap_or(false),
            at_actual_motion: self.whole.flag(text, "at_actual_motion")?.unwrap_or(false),
        })
    }

    fn low_pass(&self, name: &str) -> Result<Option<LowPass>, FileFault> {
        let text = &self.text;
        let Some(filter) = self.whole.table(text, name)? else { return Ok(None) };
        filter.only(text, &["natural_frequency", "quality"])?;
        let frequency = filter.positive(text, "natural_frequency")?;
        let quality = filter.positive(text, "quality")?;
        Ok(Some(LowPass {
            natural_frequency: filter.required(text, "natural_frequency", " (rad/s)", frequency)?.value,
            quality: quality.map_or(std::f64::consts::FRAC_1_SQRT_2, |quality| quality.value),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::LoopFile;
    use crate::actuator::tests::CartPendulum;

    const GOOD: &str = "[[feedback]]\ninput = \"F\"\ncoordinate = \"x\"\nkp = 1000\nkd = 100\n[filter]\nnatural_frequency = 100\nquality = 1\n[plant]\nm = 1.1\n";

    #[test]
    fn a_loop_is_read_and_faults_have_their_place() {
        let file = LoopFile::parse(GOOD).expect("a loop file");
        let scheme = file.scheme(&CartPendulum, true).expect("fits");
        assert_eq!((scheme.gains.len(), scheme.split, scheme.feedback_filtered), (1, true, false));
        assert_eq!(scheme.filter.map(|filter| filter.quality), Some(1.0));
        assert_eq!((scheme.independent_filter, file.settle_periods()), (None, Ok(4)));
        assert_eq!(file.plant(), Ok(vec![("m", 1.1)]));
        assert!(file.refuse_plant("m", "no".into()).to_string().starts_with("line 10, column 1"));
        let fault = |from: &str, to: &str| {
            let found = LoopFile::parse(&GOOD.replacen(from, to, 1)).and_then(|file| file.scheme(&CartPendulum, false));
            found.expect_err("a fault").to_string()
        };
        assert!(fault("\"F\"", "\"G\"").starts_with("line 2, column 9: the model has no input `G`; it has F, tau"));
        assert!(fault("\"x\"", "\"y\"").starts_with("line 3, column 14"));
        assert!(fault("quality = 1", "quality = -1").starts_with("line 8, column 11"));
        assert!(fault("quality", "qality").contains("line 8"));
    }
}
