//! A log's estimates refined by simulating the model sample by sample.

use crate::estimate::{
    Candidate, CandidateKind, Course, Differentiable, Estimate, MeasuredMotion, OutputError, OutputErrorFault, Settings,
    Signals,
};
use crate::log::{Log, LogOptions, Periodic};
use crate::numerics::Matrix;
use crate::numerics::differences::white_noise;
use crate::run::Spectra;
use crate::session::refinement_report::{MissingTerm, RefinementReport};
use crate::session::warning::Warning;
use num_complex::Complex;
use std::borrow::Cow;
use std::format;
use std::string::{String, ToString};
use std::vec;
use std::vec::Vec;
use tpm_core::model::{Label, Model};

/// A line belongs to the motion from which the fit starts when its power is this many times that of its noise.
const CERTAIN: f64 = 9.0;
/// Share of a parameter by which something that is missing must move it to be spoken of.
const NEGLIGIBLE: f64 = 1e-3;
/// Deviations by which the halves of a record must contradict each other for its numbers not to be trusted.
const CONTRADICTION: f64 = 3.5;
/// Most samples that are simulated one by one; of a longer record it is means of stretches, or its last periods.
const MOST_SAMPLES: usize = 50_000;
/// Samples of such means together, unless two periods have more.
const AVERAGED: usize = 12_000;
/// Most means, which tell whether the machine changes over the record.
const MEANS: usize = 4;
/// Samples of the last periods: two periods at least.
const LAST: usize = 24_000;

/// A refined estimate.
pub(super) struct Refined {
    pub(super) estimate: Estimate,
    pub(super) report: RefinementReport,
    pub(super) warnings: Vec<Warning>,
}

/// Refines an estimate from the periodic part of a log.
///
/// # Errors
/// [`OutputErrorFault`] when the log cannot be simulated.
pub(super) fn refine(
    machine: Differentiable<'_>,
    log: &Log,
    (periodic, spectra): (&Periodic, &Spectra),
    options: &LogOptions,
    (record, estimate): (&MeasuredMotion, &Estimate),
    settings: &Settings,
) -> Result<Refined, OutputErrorFault> {
    let model = machine.model;
    let dims = model.dims();
    let whole = (periodic.samples_per_period * periodic.periods as f64).round() as usize;
    let samples = whole.min(log.len() - periodic.from);
    let used: Vec<&[f64]> = log.channels.iter().map(|c| &c[periodic.from..periodic.from + samples]).collect();
    let excerpt = Excerpt::of(&used, periodic);
    let channels: Vec<&[f64]> = excerpt.channels.iter().map(AsRef::as_ref).collect();
    let (coordinates, inputs) = channels.split_at(dims.coordinates);
    let signals = Signals {
        sample_time: log.sample_time,
        hold: options.hold,
        coordinates: coordinates.to_vec(),
        inputs: inputs.to_vec(),
        course: Course::Periodic {
            samples_per_period: periodic.samples_per_period,
            lines: (0..dims.coordinates).map(|c| motion(spectra, c, record.motion_harmonics())).collect(),
            input_lines: (0..dims.inputs).map(|i| motion(spectra, dims.coordinates + i, spectra.highest())).collect(),
        },
        white: coordinates.iter().map(|signal| white_noise(signal)).collect(),
        joins: excerpt.joins.clone(),
        steps: (0..dims.coordinates).map(|c| if excerpt.averaged > 1 { 0.0 } else { spectra.step(c) }).collect(),
        unexplained: estimate.residual,
    };
    let free: Vec<usize> =
        (0..dims.parameters).filter(|j| settings.frozen.iter().all(|frozen| frozen.parameter != *j)).collect();
    let hidden: Vec<Vec<f64>> =
        estimate.unobservable.iter().map(|direction| free.iter().map(|&j| direction[j]).collect()).collect();
    let found = OutputError::fit(machine, &options.constants, &signals, &estimate.values, &free, &hidden)?;
    let misfit = &found.misfit;
    let shift = &misfit.shift;
    // A parameter that drifts has gone on drifting where the log was left out.
    let middle = periodic.from as f64 + excerpt.middle;
    let reach = middle.max(log.len() as f64 - middle) / excerpt.half;
    let range: Vec<f64> = misfit.range.iter().map(|range| range * reach).collect();
    let mut covariance = vec![vec![0.0; dims.parameters]; dims.parameters];
    for (a, &i) in free.iter().enumerate() {
        for (b, &j) in free.iter().enumerate() {
            let own = match found.iterations {
                Some(_) => found.covariance(a, b).unwrap_or_default() * misfit.inflation,
                None => estimate.covariance[(i, j)],
            };
            covariance[i][j] = own + shift[a] * shift[b];
        }
        covariance[i][i] += range[a].powi(2) + misfit.bent[a].powi(2);
    }
    let covariance = Matrix::from_rows(&covariance).unwrap_or_else(|| estimate.covariance.clone());
    let report = RefinementReport {
        used: found.iterations.is_some(),
        note: found.iterations.is_none().then(|| {
            "the simulation does not settle on parameters without the term that is missing; those of the harmonics are widened by how far it moves them".to_string()
        }),
        samples: signals.coordinates.first().map_or(0, |c| c.len()),
        averaged: excerpt.averaged,
        of: samples,
        steps: found.iterations.unwrap_or(0),
        sensor_noise: found.sensor_noise.clone(),
        input_noise: found.input_noise.clone(),
        residual: found.residual.clone(),
        before: estimate.values.clone(),
        missing: misfit.terms.iter().map(|term| missing(model, term)).collect(),
    };
    // What moves nothing by more than this is too small to look for, however surely it is there.
    let matters = |moved: &dyn Fn(usize) -> f64| {
        free.iter().enumerate().any(|(a, &j)| moved(a).abs() > NEGLIGIBLE * found.values[j].abs())
    };
    let lacking = matters(&|a| shift[a].hypot(range[a]));
    let wide = matters(&|a| (found.covariance(a, a).unwrap_or_default() * misfit.inflation).sqrt());
    let mut warnings: Vec<Warning> =
        report.note.iter().cloned().map(|message| Warning::Estimator { message }).collect();
    let (limits, others) = report.missing.split_at(usize::from(misfit.limited));
    warnings.extend(limits.iter().cloned().map(|term| Warning::Limited { term }));
    if lacking {
        warnings.extend(others.iter().cloned().map(|term| Warning::MissingTerm { term }));
    }
    if misfit.repeats && wide {
        warnings.push(Warning::Repeats { power: misfit.periodic });
    }
    if let Some(frequency) = misfit.vibration.filter(|_| matters(&|a| misfit.bent[a])) {
        warnings.push(Warning::Vibration { frequency });
    }
    for ((a, half), &j) in misfit.halves.iter().enumerate().zip(&free) {
        let known = shift[a].powi(2) + range[a].powi(2) + misfit.bent[a].powi(2);
        // A half has twice the variance of the whole, so that the difference of two has four times as much.
        let deviation = (half.variance * misfit.scale * misfit.inflation + 4.0 * known).sqrt();
        if half.moved.abs() > CONTRADICTION * deviation && half.moved.abs() > NEGLIGIBLE * found.values[j].abs() {
            let parameter = model.parameter(j).name.to_string();
            warnings.push(Warning::Halves { parameter, moved: half.moved, deviation });
        }
    }
    let (share, settled) = (found.share, found.iterations.is_some());
    let mut restated = record.restated(estimate, found.values, covariance, settings);
    if settled {
        restated.residual = share;
    }
    Ok(Refined { estimate: restated, report, warnings })
}

/// Harmonics of a coordinate that stand out of the noise.
fn motion(spectra: &Spectra, coordinate: usize, harmonics: usize) -> Vec<Complex<f64>> {
    let floor = spectra.floor(coordinate).unwrap_or(0.0);
    let certain = |(k, line): (usize, &Complex<f64>)| {
        let noise = spectra.variance(coordinate, k).max(floor);
        if k == 0 || line.norm_sqr() > CERTAIN * noise { *line } else { Complex::new(0.0, 0.0) }
    };
    spectra.lines[coordinate].iter().take(harmonics + 1).enumerate().map(certain).collect()
}

/// What is simulated of a record that is too long to be simulated sample by sample.
struct Excerpt<'a> {
    channels: Vec<Cow<'a, [f64]>>,
    /// Stretches of the record of which each simulated one is the mean.
    averaged: usize,
    /// Samples at which another stretch begins.
    joins: Vec<usize>,
    /// Middle of the part of the record that it stands for, and half its length, samples of the record.
    middle: f64,
    half: f64,
}

impl<'a> Excerpt<'a> {
    /// A few means of stretches of whole periods, in the order of the record, or its last periods where these are no whole numbers of
    /// samples; a short record as it is.
    ///
    /// The motion at the end of a mean is not that at the beginning of the next, because a loop passes the noise of its sensors on.
    fn of(channels: &[&'a [f64]], periodic: &Periodic) -> Self {
        let samples = channels.first().map_or(0, |channel| channel.len());
        let exact = periodic.samples_per_period;
        let period = exact.round() as usize;
        let part = |from: usize| Excerpt {
            channels: channels.iter().map(|channel| Cow::Borrowed(&channel[from..])).collect(),
            averaged: 1,
            joins: Vec::new(),
            middle: 0.5 * (from + samples) as f64,
            half: 0.5 * (samples - from) as f64,
        };
        if samples <= MOST_SAMPLES || period == 0 {
            return part(0);
        }
        if (exact - period as f64).abs() >= 1e-9 {
            let shown = ((LAST as f64 / exact) as usize).max(2).min(periodic.periods);
            return part(samples.saturating_sub((shown as f64 * exact).round() as usize));
        }
        let means = (AVERAGED / period).clamp(2, MEANS).min(periodic.periods);
        let length = (AVERAGED / (means * period)).clamp(1, periodic.periods / means) * period;
        let averaged = samples / (means * length);
        let mean = |channel: &&[f64]| {
            let mut out = Vec::with_capacity(means * length);
            for part in channel.chunks_exact(averaged * length).take(means) {
                for i in 0..length {
                    out.push(part[i..].iter().step_by(length).sum::<f64>() / averaged as f64);
                }
            }
            Cow::Owned(out)
        };
        let half = 0.5 * (means * averaged * length) as f64;
        let joins = (1..means).map(|mean| mean * length).collect();
        Excerpt { channels: channels.iter().map(mean).collect(), averaged, joins, middle: half, half }
    }
}

fn missing(model: &dyn Model<f64>, candidate: &Candidate) -> MissingTerm {
    let name = |label: Label<'_>| label.name.to_string();
    let q = |c: usize| name(model.coordinate(c));
    let (term, meaning): (String, Cow<'static, str>) = match candidate.term {
        CandidateKind::Offset => ("1".into(), "a constant force, or an offset of a sensor or an input".into()),
        CandidateKind::Power { coordinate, exponent } => {
            (format!("{}^{exponent}", q(coordinate)), "a force that is not linear in the position".into())
        }
        CandidateKind::Product { coordinate, other } => {
            (format!("{}*{}", q(coordinate), q(other)), "a coupling of two coordinates".into())
        }
        CandidateKind::RatePower { coordinate, exponent } => {
            (format!("dot({})^{exponent}", q(coordinate)), "a force that is not linear in the velocity".into())
        }
        CandidateKind::Drag { coordinate } => {
            (format!("dot({0})*abs(dot({0}))", q(coordinate)), "drag that grows with the square of the velocity".into())
        }
        CandidateKind::Friction { coordinate } => {
            (format!("sign(dot({}))", q(coordinate)), "dry (Coulomb) friction".into())
        }
        CandidateKind::Stribeck { coordinate } => (
            format!("sign(dot({0}))*exp(-(dot({0})/vs)^2)", q(coordinate)),
            "friction that is larger at low speed (Stribeck)".into(),
        ),
        CandidateKind::Drift { parameter } => {
            let name = name(model.parameter(parameter));
            let meaning = format!("{name} changes over the record (drift)");
            (format!("{name} * time"), meaning.into())
        }
        CandidateKind::Delay { input } => (
            format!("rate of {}", name(model.input(input))),
            format!("a delay or lag of one channel, {:.3} ms if it is the input's", 1e3 * candidate.value).into(),
        ),
        CandidateKind::Flexible { input } => (
            format!("second rate of {}", name(model.input(input))),
            "dynamics between input and sensor: a flexible mode, or a lag".into(),
        ),
        CandidateKind::Limit { input, limit } => (
            format!("{0} beyond {limit:.4}", name(model.input(input))),
            format!("clipping: the input is limited (saturation) at about {limit:.4}").into(),
        ),
        CandidateKind::Backlash { coordinate } => (
            format!("sign(dot({})) on its reading", q(coordinate)),
            "backlash or hysteresis between machine and sensor".into(),
        ),
    };
    MissingTerm {
        term,
        row: candidate.row.map(|row| name(model.row(row))),
        value: candidate.value,
        std: candidate.std,
        gain: candidate.gain,
        meaning: meaning.into_owned(),
    }
}
