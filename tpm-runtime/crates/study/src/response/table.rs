//! A frequency response line by line.

use crate::response::measured::MeasuredResponse;
use serde::{Serialize, Serializer};
use std::fmt;
use tpm_frequency::{Complex, ResponseEstimator, ResponseLine};
use tpm_report::{Align, TextTable, cells, number};

/// Most lines that the text shows.
const SHOWN: usize = 24;

/// The lines of a measured response by one estimate. They are displayed as a text with some of them, and serialised with all of them as
/// `tpm.frf/1`.
#[derive(Debug)]
pub struct ResponseTable<'a> {
    measured: &'a MeasuredResponse,
    estimator: ResponseEstimator,
}

#[derive(Serialize)]
struct Table<'a> {
    schema: &'static str,
    input: &'a str,
    output: &'a str,
    estimator: &'static str,
    sample_time: f64,
    samples: usize,
    segment: usize,
    overlap: f64,
    window: String,
    hold: String,
    segments: usize,
    averages: f64,
    hold_effect: Effect,
    lines: Vec<Line>,
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct Effect {
    median: f64,
    largest: f64,
}

#[derive(Serialize)]
struct Line {
    frequency_hz: f64,
    re: f64,
    im: f64,
    coherence: f64,
    std: f64,
    radius_95: f64,
    usable: bool,
}

impl<'a> ResponseTable<'a> {
    /// The response by this estimate.
    #[must_use]
    pub fn new(measured: &'a MeasuredResponse, estimator: ResponseEstimator) -> Self {
        Self { measured, estimator }
    }

    /// What the response lacks in its band, in words.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let MeasuredResponse { response, low, high, .. } = self.measured;
        response.gaps(*low, *high).iter().map(ToString::to_string).collect()
    }

    fn lines(&self) -> impl Iterator<Item = &'a ResponseLine> {
        self.measured.response.band(self.measured.low, self.measured.high)
    }

    fn value(&self, line: &ResponseLine) -> Complex {
        match self.estimator {
            ResponseEstimator::H1 => line.h1,
            ResponseEstimator::H2 => line.h2,
        }
    }

    /// Every line of the band as a row of comma-separated values, below a head.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = "frequency_hz,re,im,magnitude,phase_deg,coherence,std,radius_95,usable\n".to_owned();
        for line in self.lines() {
            let h = self.value(line);
            text.push_str(&format!(
                "{},{},{},{},{},{},{},{},{}\n",
                line.hertz(),
                h.re,
                h.im,
                h.norm(),
                h.arg().to_degrees(),
                line.coherence,
                line.std,
                self.measured.response.radius(line, 0.95),
                u8::from(line.usable)
            ));
        }
        text
    }
}

impl Serialize for ResponseTable<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let MeasuredResponse { input, output, log, response, low, high, .. } = self.measured;
        let effect = response.hold_effect(*low, *high);
        let line = |line: &ResponseLine| Line {
            frequency_hz: line.hertz(),
            re: self.value(line).re,
            im: self.value(line).im,
            coherence: line.coherence,
            std: line.std,
            radius_95: response.radius(line, 0.95),
            usable: line.usable,
        };
        let table = Table {
            schema: "tpm.frf/1",
            input,
            output,
            estimator: match self.estimator {
                ResponseEstimator::H1 => "h1",
                ResponseEstimator::H2 => "h2",
            },
            sample_time: response.sample_time,
            samples: log.len(),
            segment: response.welch.segment,
            overlap: response.welch.overlap,
            window: response.welch.window.to_string(),
            hold: response.welch.hold.to_string(),
            segments: response.segments,
            averages: response.averages,
            hold_effect: Effect { median: effect.median, largest: effect.largest },
            lines: self.lines().map(line).collect(),
            warnings: self.warnings(),
        };
        table.serialize(serializer)
    }
}

impl fmt::Display for ResponseTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = TextTable::new(&[
            ("frequency [Hz]", Align::Right),
            ("magnitude", Align::Decimal),
            ("phase [deg]", Align::Right),
            ("coherence", Align::Right),
            ("std of H", Align::Decimal),
        ]);
        let usable: Vec<&ResponseLine> = self.lines().filter(|line| line.usable).collect();
        let low = self.measured.low.max(usable.first().map_or(0.0, |line| line.hertz()));
        let mut last = None;
        for i in 0..SHOWN {
            let wanted = low * (self.measured.high / low).powf(i as f64 / (SHOWN - 1) as f64);
            let distance = |line: &ResponseLine| (line.hertz() - wanted).abs();
            let nearest = usable.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            if let Some(line) = nearest.filter(|line| last != Some(line.frequency)) {
                last = Some(line.frequency);
                let h = self.value(line);
                let [magnitude, std] = cells(Some(h.norm()), Some(line.std));
                let (phase, coherence) = (h.arg().to_degrees(), line.coherence);
                let row = [number(line.hertz()), magnitude, format!("{phase:.2}"), format!("{coherence:.4}"), std];
                table.row(&row);
            }
        }
        write!(f, "{}\n{}", self.measured, table.finish())?;
        self.warnings().iter().try_for_each(|gap| writeln!(f, "warning: {gap}"))
    }
}
