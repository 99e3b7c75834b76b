//! A record linearised about a motion, sample by sample.

use crate::output_error::noise::Noise;

/// A record linearised about states x_k and parameters.
///
/// Columns are the parameters that are estimated, then whatever else may act on the machine (candidate terms). A forcing has, beside
/// the columns, the inputs and the switches of the model.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    pub(super) samples: usize,
    /// Time between samples, s.
    pub(super) sample_time: f64,
    /// Number of states.
    pub(super) order: usize,
    /// Number of columns.
    pub(super) columns: usize,
    /// Number of inputs.
    pub(super) inputs: usize,
    /// Number of switches.
    pub(super) switches: usize,
    /// Coordinate and order of differentiation of every state.
    pub(super) states: Vec<(usize, usize)>,
    /// State that each sensor reads, by coordinate.
    pub(super) outputs: Vec<usize>,
    /// Size of the noise of each sensor, beside which what is exact is small.
    pub(super) scale: Vec<f64>,
    /// Whether the state after a sample does not follow from the one before.
    pub(super) breaks: Vec<bool>,
    /// `d x_{k+1} / d x_k`, per transition, row-major.
    pub(super) transition: Vec<f64>,
    /// `d x_{k+1} / d(forcing)`, per transition, row-major.
    pub(super) forcing: Vec<f64>,
    /// The model's next state less x_{k+1}, per transition.
    pub(super) defect: Vec<f64>,
    /// Readings less the states that they read.
    pub(super) errors: Vec<f64>,
    /// What the columns add to the readings, per sample, coordinate and column; empty where they add nothing.
    pub(super) reading_columns: Vec<f64>,
    /// Standard deviation of every switch's force as a multiple of half its jump, per transition.
    pub(super) loose: Vec<f64>,
    /// Whether a coordinate turns, per transition.
    pub(super) turns: Vec<bool>,
    /// What the inputs are taken to be beside what was recorded, per sample.
    pub(super) disturbed: Vec<f64>,
    /// As many zeros as there are columns.
    pub(super) nothing: Vec<f64>,
}

impl Chain {
    pub(super) fn duration(&self) -> f64 {
        self.samples as f64 * self.sample_time
    }

    pub(super) const fn width(&self) -> usize {
        self.columns + self.inputs + self.switches
    }

    /// Row of a state in the transition that follows sample k.
    pub(super) fn transition(&self, k: usize, state: usize) -> &[f64] {
        let n = self.order;
        &self.transition[(k * n + state) * n..(k * n + state + 1) * n]
    }

    /// What the forcings add to a state in the transition that follows sample k.
    pub(super) fn forcing(&self, k: usize, state: usize) -> &[f64] {
        let width = self.width();
        let at = (k * self.order + state) * width;
        &self.forcing[at..at + width]
    }

    pub(super) fn defect(&self, k: usize) -> &[f64] {
        &self.defect[k * self.order..(k + 1) * self.order]
    }

    pub(super) fn error(&self, k: usize, coordinate: usize) -> f64 {
        self.errors[k * self.outputs.len() + coordinate]
    }

    /// What the columns add to a reading.
    pub(super) fn readings(&self, k: usize, coordinate: usize) -> &[f64] {
        let at = (k * self.outputs.len() + coordinate) * self.columns;
        self.reading_columns.get(at..at + self.columns).unwrap_or(&self.nothing)
    }

    /// How far a forcing is from what was recorded in the transition after sample k.
    pub(super) fn disturbance(&self, k: usize, forcing: usize) -> f64 {
        let input = forcing - self.columns;
        if input < self.inputs { self.disturbed[k * self.inputs + input] } else { 0.0 }
    }

    /// The forcings that disturb the transition after sample k, with their standard deviations.
    pub(super) fn disturbances<'a>(&'a self, k: usize, noise: &'a Noise) -> impl Iterator<Item = (usize, f64)> + 'a {
        let exact = noise.only_at_turns && !self.turns[k];
        let inputs = noise.inputs.iter().map(move |size| if exact { 0.0 } else { *size });
        let loose = &self.loose[k * self.switches..(k + 1) * self.switches];
        let sizes = inputs.chain(loose.iter().copied()).enumerate();
        sizes.filter(|(_, size)| *size > 0.0).map(|(i, size)| (self.columns + i, size))
    }
}

impl Chain {
    /// The chain with the inputs as they were recorded.
    pub(super) fn undisturbed(mut self) -> Self {
        let (n, width) = (self.order, self.width());
        for (k, defect) in self.defect.chunks_exact_mut(n).enumerate() {
            for (s, value) in defect.iter_mut().enumerate() {
                let forcing =
                    &self.forcing[(k * n + s) * width + self.columns..(k * n + s) * width + self.columns + self.inputs];
                let disturbed = &self.disturbed[k * self.inputs..(k + 1) * self.inputs];
                *value -= forcing.iter().zip(disturbed).map(|(f, w)| f * w).sum::<f64>();
            }
        }
        self.disturbed.fill(0.0);
        self
    }

    /// A stretch of the record.
    pub(super) fn stretch(&self, from: usize, samples: usize) -> Self {
        let part = |values: &[f64], of_sample: usize, count: usize| -> Vec<f64> {
            values.get(from * of_sample..(from + count) * of_sample).map(<[f64]>::to_vec).unwrap_or_default()
        };
        let transitions = samples.saturating_sub(1);
        let (n, outputs) = (self.order, self.outputs.len());
        Self {
            samples,
            states: self.states.clone(),
            outputs: self.outputs.clone(),
            scale: self.scale.clone(),
            breaks: self.breaks[from..from + transitions].to_vec(),
            transition: part(&self.transition, n * n, transitions),
            forcing: part(&self.forcing, n * self.width(), transitions),
            defect: part(&self.defect, n, transitions),
            errors: part(&self.errors, outputs, samples),
            reading_columns: part(&self.reading_columns, outputs * self.columns, samples),
            turns: self.turns[from..from + transitions].to_vec(),
            loose: part(&self.loose, self.switches, transitions),
            disturbed: part(&self.disturbed, self.inputs, samples),
            nothing: self.nothing.clone(),
            ..*self
        }
    }
}
