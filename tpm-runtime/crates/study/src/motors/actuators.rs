//! Whether motors can follow a pattern: which limit they exceed and when, and the largest frequency and amplitudes that they can follow.

use crate::by_name::by_name;
use crate::motors::moved::MovedMachine;
use serde::Serialize;
use std::fmt;
use tpm_controller::model::Model as _;
use tpm_frequency::Complex;
use tpm_motion::TrialError;
use tpm_plant::actuator::{
    Bound, CutOff, Harmonic, Limit, Motor, Peak, Requirement, bound, requirements, scaled, torque_speed,
};
use tpm_plot::Figure;
use tpm_report::{Align, TextTable, number};

/// Least number of samples in a period.
const SAMPLES: usize = 2048;

/// Samples in the period of the highest harmonic.
const SAMPLES_PER_HARMONIC: usize = 64;

/// Factors on the amplitudes for which the largest frequency is tabulated.
const FACTORS: [f64; 4] = [0.25, 0.5, 1.0, 2.0];

/// An inertia that varies by a smaller share of itself varies by rounding.
const VARYING_INERTIA: f64 = 1e-6;

/// Harmonics of a current below this share of the largest one are not listed.
const LISTED_HARMONIC: f64 = 1e-4;

/// Amplitudes of a current below this share of the largest one are what rounding leaves of zero.
const ROUNDING: f64 = 1e-9;

/// What a motion needs of motors. It is displayed as a text, and serialised as `tpm.actuator/1`.
#[derive(Debug, Serialize)]
pub struct Actuators {
    schema: &'static str,
    model: String,
    #[serde(serialize_with = "by_name")]
    amplitudes: Vec<(String, f64)>,
    frequency: f64,
    feasible: bool,
    motors: Vec<MotorUse>,
    largest_frequency: Vec<FrequencyEnd>,
    largest_factor: End,
    /// The motion in words.
    #[serde(skip)]
    motion: String,
    #[serde(skip)]
    frequency_name: String,
    #[serde(skip)]
    requirements: Vec<Requirement>,
    #[serde(skip)]
    figure: Figure,
}

/// What is needed of one motor.
#[derive(Debug, Serialize)]
struct MotorUse {
    input: String,
    #[serde(skip)]
    unit: Option<String>,
    feasible: bool,
    limits: Vec<LimitUse>,
    force: Force,
    /// W
    average_power: f64,
    /// W
    resistive_power: f64,
    smooth: bool,
    cut_off: Option<CutOff>,
    harmonics: Vec<CurrentAndVoltage>,
}

#[derive(Debug, Serialize)]
struct LimitUse {
    limit: &'static str,
    unit: &'static str,
    largest: f64,
    /// Time of the largest value, s.
    time: f64,
    /// Null in JSON where there is no limit.
    available: f64,
    share: f64,
    /// Share of the period beyond the limit.
    time_beyond: f64,
}

/// Forces in the unit of the input; the one at stall is null in JSON where it is not limited.
#[derive(Debug, Serialize)]
struct Force {
    wanted: f64,
    stall: f64,
}

#[derive(Debug, Serialize)]
struct CurrentAndVoltage {
    harmonic: usize,
    /// A
    current: PartsOf,
    /// V
    voltage: PartsOf,
}

/// Real and imaginary part of what both parts of an input need.
#[derive(Debug, Serialize)]
struct PartsOf {
    independent: [f64; 2],
    dependent: [f64; 2],
}

#[derive(Debug, Serialize)]
struct FrequencyEnd {
    factor: f64,
    largest: End,
}

/// The largest feasible value, and what ends there.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum End {
    /// A value at which an input meets a limit; none where not even slow or small motions are feasible.
    Met {
        value: Option<f64>,
        input: String,
        limit: &'static str,
    },
    Beyond {
        beyond: f64,
    },
}

impl Actuators {
    /// Works out what the motion needs of the motors, one per input, and the largest motions that they can follow.
    ///
    /// # Errors
    /// [`TrialError`] when the machine cannot be evaluated along a motion.
    pub fn new(moved: &MovedMachine, motors: &[Option<Motor>]) -> Result<Self, TrialError> {
        let (sizes, frequency) = (moved.sizes(), moved.frequency.1);
        let (demand, trajectory) = (moved.machine.demand(), moved.trajectory());
        let finest = SAMPLES_PER_HARMONIC * (trajectory.highest_harmonic() as usize).next_power_of_two();
        let found = requirements(&demand, motors, &trajectory, SAMPLES.max(finest))?;
        let motion = |factor: f64, w: f64| Ok(moved.machine.trajectory(&scaled(&sizes, factor), w));
        let mut frequencies = Vec::new();
        for factor in FACTORS {
            let largest = bound(&demand, motors, frequency, |w| motion(factor, w))?;
            frequencies.push(FrequencyEnd { factor, largest: End::new(moved, largest) });
        }
        let factor = bound(&demand, motors, 1.0, |factor| motion(factor, frequency))?;
        let names: Vec<String> = (0..motors.len()).map(|i| input(moved, i)).collect();
        Ok(Self {
            schema: "tpm.actuator/1",
            model: moved.model.clone(),
            amplitudes: moved.amplitudes.clone(),
            frequency,
            feasible: found.iter().all(Requirement::feasible),
            motors: found.iter().map(|requirement| MotorUse::new(moved, requirement)).collect(),
            largest_frequency: frequencies,
            largest_factor: End::new(moved, factor),
            motion: moved.to_string(),
            frequency_name: moved.frequency.0.clone(),
            figure: torque_speed(&moved.title(), &found, motors, &names),
            requirements: found,
        })
    }

    /// Torque over speed and voltage over time.
    #[must_use]
    pub fn figure(&self) -> &Figure {
        &self.figure
    }

    /// One sentence for every motor that cannot follow.
    #[must_use]
    pub fn overloaded(&self) -> Vec<String> {
        let all = self.motors.iter().zip(&self.requirements);
        all.filter(|(own, _)| !own.feasible).map(|(own, requirement)| own.verdict(requirement)).collect()
    }

    fn amplitudes(&self, factor: f64) -> String {
        let all = self.amplitudes.iter().map(|(name, value)| format!("{name} = {}", number(factor * value)));
        all.collect::<Vec<_>>().join(", ")
    }
}

fn input(moved: &MovedMachine, index: usize) -> String {
    moved.machine.model().input(index).name.to_owned()
}

fn name(limit: Limit) -> &'static str {
    limit.name_and_unit().0
}

impl End {
    fn new(moved: &MovedMachine, end: Bound) -> Self {
        let met = |value: Option<f64>, index: usize, limit: Limit| Self::Met {
            value,
            input: input(moved, index),
            limit: name(limit),
        };
        match end {
            Bound::At { value, input, limit } => met(Some(value), input, limit),
            Bound::Never { input, limit } => met(None, input, limit),
            Bound::Beyond(beyond) => Self::Beyond { beyond },
        }
    }

    /// The value and the limit in words.
    fn words(&self) -> (String, String) {
        match self {
            Self::Met { value: Some(value), input, limit } => (number(*value), format!("{limit} of {input}")),
            Self::Met { value: None, input, limit } => {
                ("none".to_owned(), format!("{limit} of {input}, however slow or small"))
            }
            Self::Beyond { beyond } => (format!("beyond {}", number(*beyond)), "none met".to_owned()),
        }
    }
}

impl MotorUse {
    fn new(moved: &MovedMachine, found: &Requirement) -> Self {
        let limit = |peak: &Peak| {
            let (limit, unit) = peak.limit.name_and_unit();
            LimitUse {
                limit,
                unit,
                largest: peak.value,
                time: peak.time,
                available: peak.available,
                share: peak.share(),
                time_beyond: found.share_of_time(peak.limit),
            }
        };
        let parts = |independent: Complex, dependent: Complex| PartsOf {
            independent: [independent.re, independent.im],
            dependent: [dependent.re, dependent.im],
        };
        let harmonic = |own: &Harmonic| CurrentAndVoltage {
            harmonic: own.harmonic,
            current: parts(own.independent, own.dependent),
            voltage: parts(own.independent_voltage, own.dependent_voltage),
        };
        Self {
            input: input(moved, found.input),
            unit: moved.machine.model().input(found.input).unit.map(str::to_owned),
            feasible: found.feasible(),
            limits: found.peaks.iter().map(limit).collect(),
            force: Force { wanted: found.force.0, stall: found.force.1 },
            average_power: found.average_power,
            resistive_power: found.resistive_power,
            smooth: found.smooth,
            cut_off: found.cut_off,
            harmonics: found.harmonics.iter().map(harmonic).collect(),
        }
    }

    /// One sentence on whether the motor suffices.
    fn verdict(&self, found: &Requirement) -> String {
        if self.feasible {
            let worst = found.worst();
            let share = number(100.0 * worst.share());
            return format!(
                "the motor of {} can follow: at most {share} % of its {} is used",
                self.input,
                name(worst.limit)
            );
        }
        let over = self.limits.iter().filter(|own| own.share > 1.0).map(|own| {
            let LimitUse { limit, unit, largest, available, time, .. } = own;
            let (value, available) = (number(*largest), number(*available));
            format!("{limit} {value} {unit} of {available} {unit} at {} s", number(*time))
        });
        format!("the motor of {} cannot follow: {}", self.input, over.collect::<Vec<_>>().join(", "))
    }

    fn write(&self, f: &mut fmt::Formatter<'_>, found: &Requirement, frequency: f64) -> fmt::Result {
        writeln!(f, "{}\n", self.verdict(found))?;
        let mut table = TextTable::new(&[
            ("limit", Align::Left),
            ("largest", Align::Right),
            ("available", Align::Right),
            ("unit", Align::Left),
            ("share [%]", Align::Right),
            ("at [s]", Align::Right),
            ("beyond, of time [%]", Align::Right),
        ]);
        for own in &self.limits {
            let given = |value: f64| if own.available.is_finite() { number(value) } else { "-".to_owned() };
            table.row(&[
                own.limit.to_owned(),
                number(own.largest),
                given(own.available),
                own.unit.to_owned(),
                given(100.0 * own.share),
                number(own.time),
                given(100.0 * own.time_beyond),
            ]);
        }
        let unit = self.unit.as_ref().map_or_else(String::new, |unit| format!(" {unit}"));
        let (wanted, stall) = (number(self.force.wanted), number(self.force.stall));
        writeln!(f, "{}{} wanted {wanted}{unit}, available at stall {stall}{unit}", table.finish(), self.input)?;
        let (whole, lost) = (number(self.average_power), number(self.resistive_power));
        writeln!(f, "average power {whole} W, of which the resistance takes {lost} W")?;
        if let Some(cut) = &self.cut_off {
            let varies = cut.inertia - cut.least_inertia > VARYING_INERTIA * cut.inertia;
            let varying = if varies { format!("{} to ", number(cut.least_inertia)) } else { String::new() };
            writeln!(
                f,
                "inertia at the rotor {}{} kg m^2, amplitude {} rad: natural frequency {} rad/s (C.9), cut-off by current {} rad/s (C.12) at {} V (C.13)",
                varying,
                number(cut.inertia),
                number(cut.amplitude),
                number(cut.natural),
                number(cut.current),
                number(cut.voltage)
            )?;
        }
        if !self.smooth {
            f.write_str("the force jumps, so that the voltage of the inductance at the jumps is more than shown\n")?;
        }
        let mut table = TextTable::new(&[
            ("harmonic", Align::Right),
            ("[rad/s]", Align::Right),
            ("motion-independent [A]", Align::Right),
            ("motion-dependent [A]", Align::Right),
            ("current [A]", Align::Right),
            ("voltage [V]", Align::Right),
        ]);
        let current = |own: &Harmonic| (own.independent + own.dependent).norm();
        let largest = found.harmonics.iter().map(current).fold(0.0, f64::max);
        let shown = |size: f64| if size > ROUNDING * largest { number(size) } else { "0".to_owned() };
        let is_listed = |own: &&Harmonic| own.independent.norm().max(own.dependent.norm()) > LISTED_HARMONIC * largest;
        for harmonic in found.harmonics.iter().filter(is_listed) {
            table.row(&[
                harmonic.harmonic.to_string(),
                number(harmonic.harmonic as f64 * frequency),
                shown(harmonic.independent.norm()),
                shown(harmonic.dependent.norm()),
                shown(current(harmonic)),
                shown((harmonic.independent_voltage + harmonic.dependent_voltage).norm()),
            ]);
        }
        write!(f, "\n{}", table.finish())
    }
}

impl fmt::Display for Actuators {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {}", self.model, self.motion)?;
        for (own, requirement) in self.motors.iter().zip(&self.requirements) {
            f.write_str("\n")?;
            own.write(f, requirement, self.frequency)?;
        }
        writeln!(f, "\nlargest {} by factor on the amplitudes\n", self.frequency_name)?;
        let mut table = TextTable::new(&[
            ("factor", Align::Right),
            ("amplitudes", Align::Left),
            ("largest [rad/s]", Align::Right),
            ("limit", Align::Left),
        ]);
        for FrequencyEnd { factor, largest } in &self.largest_frequency {
            let (value, limit) = largest.words();
            table.row(&[number(*factor), self.amplitudes(*factor), value, limit]);
        }
        let (value, limit) = self.largest_factor.words();
        let size = match self.largest_factor {
            End::Met { value: Some(value), .. } => format!(" ({})", self.amplitudes(value)),
            _ => String::new(),
        };
        writeln!(
            f,
            "{}\nlargest factor on the amplitudes at {} = {}: {value}{size}, limit: {limit}",
            table.finish(),
            self.frequency_name,
            number(self.frequency)
        )
    }
}
