//! The noise of a record.

use std::ops::Range;

/// The size of what is not known in a record.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Noise {
    /// Standard deviation of every reading, sample by sample and coordinate by coordinate; infinite where there is none.
    pub(super) readings: Vec<f64>,
    /// Correlation of a sensor's noise from one sample to the next, per coordinate; zero for white noise.
    pub(super) colour: Vec<f64>,
    /// Standard deviation of every input.
    pub(super) inputs: Vec<f64>,
    /// Whether the inputs are exact but where a coordinate turns.
    pub(super) only_at_turns: bool,
}

impl Noise {
    /// The noise of some of the samples, each with so many readings.
    pub(super) fn part(&self, samples: Range<usize>, outputs: usize) -> Self {
        let readings = self.readings[samples.start * outputs..samples.end * outputs].to_vec();
        Noise { readings, colour: self.colour.clone(), inputs: self.inputs.clone(), ..*self }
    }

    /// Whether nothing but white noise of the sensors is there.
    pub(super) fn is_plain(&self) -> bool {
        self.inputs.iter().chain(&self.colour).all(|value| value.abs() <= 0.0)
    }

    /// Standard deviation of a sensor over the record: the root of the mean variance of its readings.
    pub(super) fn typical(&self, coordinate: usize, outputs: usize) -> f64 {
        let of = self.readings.iter().skip(coordinate).step_by(outputs.max(1)).filter(|sigma| sigma.is_finite());
        let (sum, count) = of.fold((0.0, 0_u32), |(sum, count), sigma| (sum + sigma * sigma, count + 1));
        (sum / f64::from(count.max(1))).sqrt()
    }
}
