//! A log whose model is simulated between its stamps, since only a simulation tells its parameters.

use crate::found::Found;
use crate::log_fault::LogFault;
use crate::log_report::{HoldResiduals, RecordedReport, SensorReport, Way};
use crate::model::DeclaredModel;
use crate::options::LogOptions;
use crate::summary;
use crate::warning::{Data, Warning};
use tpm_controller::model::Model;
use tpm_estimate::{Channel, RecordedFit, Sensed, SignalsAsRecorded, fit_recorded, is_static};
use tpm_log::{AsRecorded, ChannelReadings, ReadingSettings, acceleration_column, rate_column};
use tpm_motion::Dynamics;

/// Whether what is known of a log lets it be simulated between its stamps: nothing lies between its inputs and the machine, and nobody asks
/// for its harmonics.
pub(super) fn may_be(options: &LogOptions) -> bool {
    let asked = options.domain == Some(tpm_estimate::Domain::Harmonics);
    let part = options.reading.period.is_some() || options.reading.from_sample.is_some();
    options.actuators.iter().all(Dynamics::is_ideal) && options.estimation.fitted_delays.is_empty() && !asked && !part
}

/// Whether a log is simulated between its stamps from the beginning: only that tells the model's parameters, or an acceleration is measured,
/// which no other way uses. A static map has nothing between its samples.
pub(super) fn is_for(declared: Option<&DeclaredModel>, model: &dyn Model<f64>, options: &ReadingSettings) -> bool {
    let mapped = (0..model.dims().coordinates).any(|c| options.map.contains_key(&acceleration_column(model, c)));
    (mapped || declared.is_some_and(DeclaredModel::is_only_simulated)) && !is_static(model)
}

/// Identifies a model from a log by simulating it between the stamps; `unshown` is the number of directions of its parameters that these
/// sensors cannot show, where that is known.
///
/// # Errors
/// [`LogFault`].
pub(super) fn identify(
    model: &dyn Model<f64>,
    recorded: &AsRecorded,
    unshown: Option<usize>,
    options: &LogOptions,
) -> Result<Found, LogFault> {
    let path = || recorded.path.clone();
    if !may_be(options) {
        return Err(LogFault::OnlySimulated { path: path() });
    }
    let signals = signals(recorded, options);
    let fit = fit_recorded(model, &options.constants, &signals, unshown, &options.estimation)
        .map_err(|source| LogFault::Recorded { path: path(), source })?;
    let mut warnings = summary::doubts(model, &fit.estimate, Data::Log);
    let beyond = (0..signals.sensors.len())
        .filter(|&s| !fit.explains(s))
        .max_by(|&a, &b| fit.shares[a].total_cmp(&fit.shares[b]));
    warnings.extend(beyond.map(|s| {
        let Sensed { coordinate, derivative, .. } = signals.sensors[s];
        Warning::BeyondNoise {
            signal: signal_name(model, coordinate, derivative),
            left: fit.noise[s],
            noise: fit.own_noise[s],
        }
    }));
    warnings.extend(summary::lone_readings(model, &recorded.lone));
    warnings.extend(recorded.report.repeated.iter().cloned().map(|repeated| Warning::RepeatedReadings { repeated }));
    let hold = options.reading.hold;
    Ok(Found {
        harmonics: 0,
        hold_residuals: HoldResiduals::of(hold, fit.estimate.residual, fit.other_hold),
        row_residuals: Vec::new(),
        way: Way::Recorded(report(model, &signals, &fit)),
        estimate: fit.estimate,
        refinement: None,
        warnings,
        tells_hold: false,
        delays: Vec::new(),
        calibration: Vec::new(),
        unseen_gain: None,
    })
}

/// The signals of a record for a simulation.
pub(super) fn signals(recorded: &AsRecorded, options: &LogOptions) -> SignalsAsRecorded {
    let channel = |own: &ChannelReadings| Channel { time: own.time.clone(), value: own.value.clone() };
    let sensed = |derivative: usize| {
        move |(coordinate, own): (usize, &Option<ChannelReadings>)| {
            Some(Sensed { coordinate, derivative, channel: channel(own.as_ref()?) })
        }
    };
    let positions = recorded.coordinates.iter().enumerate().filter_map(sensed(0));
    let rates = recorded.rates.iter().enumerate().filter_map(sensed(1));
    let accelerations = recorded.accelerations.iter().enumerate().filter_map(sensed(2));
    SignalsAsRecorded {
        inputs: recorded.inputs.iter().map(channel).collect(),
        sensors: positions.chain(rates).chain(accelerations).collect(),
        hold: options.reading.hold,
    }
}

/// What a sensor reads, as a column of a log is called: `x`, `dot(x)` or `ddot(x)`.
pub(super) fn signal_name(model: &dyn Model<f64>, coordinate: usize, derivative: usize) -> String {
    match derivative {
        0 => model.coordinate(coordinate).name.to_string(),
        1 => rate_column(model, coordinate),
        _ => acceleration_column(model, coordinate),
    }
}

fn report(model: &dyn Model<f64>, signals: &SignalsAsRecorded, fit: &RecordedFit) -> RecordedReport {
    let sensor = |(s, sensed): (usize, &Sensed)| SensorReport {
        signal: signal_name(model, sensed.coordinate, sensed.derivative),
        readings: sensed.channel.time.len(),
        left: fit.noise[s],
        share: fit.shares[s],
        late: fit.late[s].map(|[late, _]| late),
        late_std: fit.late[s].map(|[_, std]| std),
    };
    RecordedReport {
        readings: fit.readings,
        of: fit.of,
        blocks: fit.blocks,
        duration: fit.duration,
        sensors: signals.sensors.iter().enumerate().map(sensor).collect(),
        unmeasured: (0..model.dims().coordinates)
            .filter(|&c| !model.is_measured(c))
            .map(|c| model.coordinate(c).name.to_string())
            .collect(),
    }
}
