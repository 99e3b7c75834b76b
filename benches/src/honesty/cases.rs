//! The cases: a machine, how its log is spoilt, the model that it is identified by, and what would name the fault.

use crate::honesty::rig::{DAMPING, Flexible, Force, MASS, PERIOD, Recording, Rig, STIFFNESS};
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use tpm_runtime::harmonics::Hold;

/// A model by which a log is identified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Mass, damper, spring.
    Linear,
    /// With dry friction.
    Friction,
}

/// Size of the machine's friction where its model has it, N.
const FRICTION: f64 = 1.5;

impl Model {
    /// Its text.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Model::Linear => {
                "model Linear {
                    coordinate x [m];
                    input u [N];
                    parameter m [kg], d [N*s/m], k [N/m];

                    m*ddot(x) + d*dot(x) + k*x = u;
                }"
            }
            Model::Friction => {
                "model Friction {
                    coordinate x [m];
                    input u [N];
                    parameter m [kg], d [N*s/m], k [N/m], fc [N];

                    m*ddot(x) + d*dot(x) + k*x + fc*sign(dot(x)) = u;
                }"
            }
        }
    }

    /// Its parameters with their true values.
    #[must_use]
    pub const fn truth(self) -> &'static [(&'static str, f64)] {
        match self {
            Model::Linear => &[("m", MASS), ("d", DAMPING), ("k", STIFFNESS)],
            Model::Friction => &[("m", MASS), ("d", DAMPING), ("k", STIFFNESS), ("fc", FRICTION)],
        }
    }
}

/// A statement that names a fault: of this kind, any kind where it is empty, and with these words.
pub type Mark = (&'static str, &'static str);

/// What happens to a recording before it is identified.
pub type Spoil = fn(&mut Recording, &mut ChaCha8Rng);

/// A case.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// What is the case, in few words.
    pub name: &'static str,
    /// The machine.
    pub rig: Rig,
    /// The model.
    pub model: Model,
    /// The hold that is stated.
    pub hold: Hold,
    /// What happens to the recording.
    pub spoil: Spoil,
    /// Number of logs where none is asked for.
    pub logs: u32,
    /// Whether noise is white, or of an encoder whose error repeats with the motion.
    pub noise: Noise,
    /// Statements each of which names the fault; none where the log is right.
    pub marks: &'static [Mark],
    /// Whether the record fits as well as a right one, so that nothing in it can show the fault.
    pub hidden: bool,
}

/// What is asked of intervals depends on the noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    /// White noise alone.
    White,
    /// Coloured noise, noise of recorded inputs, or an encoder that noise dithers.
    Other,
    /// An encoder whose steps are larger than the noise before them.
    Undithered,
}

impl Case {
    fn right(name: &'static str, noise: Noise, rig: Rig) -> Self {
        let logs = if noise == Noise::Undithered { 100 } else { 200 };
        Case {
            name,
            rig,
            model: Model::Linear,
            hold: Hold::Zoh,
            spoil: |_, _| {},
            logs,
            noise,
            marks: &[],
            hidden: false,
        }
    }

    fn encoder(name: &'static str, noise: Noise, step: f64, white: f64) -> Self {
        // An encoder's error is another one only where the motion is another one.
        Case::right(name, noise, Rig { step, white, variation: 0.03, ..Rig::default() })
    }

    fn wrong(name: &'static str, rig: Rig, marks: &'static [Mark]) -> Self {
        Case { logs: 40, marks, ..Case::right(name, Noise::White, rig) }
    }

    fn spoilt(name: &'static str, marks: &'static [Mark], spoil: Spoil) -> Self {
        Case { spoil, ..Case::wrong(name, Rig::default(), marks) }
    }
}

/// Cases in which the model is right and the log is sound.
#[must_use]
pub fn correct() -> Vec<Case> {
    use Noise::{Other, Undithered, White};
    let with = |change: fn(&mut Rig)| {
        let mut rig = Rig::default();
        change(&mut rig);
        rig
    };
    vec![
        Case::right("white noise 0.1 mm", White, Rig::default()),
        Case::right("white noise 1 mm", White, with(|rig| rig.white = 1e-3)),
        Case::right("white noise 0.1 mm, two periods", White, with(|rig| rig.samples = 2 * PERIOD)),
        Case::right("white noise 0.1 mm, four periods", White, with(|rig| rig.samples = 4 * PERIOD)),
        Case {
            model: Model::Friction,
            ..Case::right(
                "white noise 0.1 mm, friction 1.5 N in the model",
                White,
                with(|rig| rig.force = Force::Coulomb(FRICTION)),
            )
        },
        Case::right("white noise 0.1 mm, input recorded with 0.5 N", Other, with(|rig| rig.input_noise = 0.5)),
        Case::right(
            "no sensor noise, input recorded with 0.5 N",
            Other,
            with(|rig| (rig.white, rig.input_noise) = (0.0, 0.5)),
        ),
        Case::right("coloured noise 0.1 mm", Other, with(|rig| (rig.white, rig.coloured) = (0.0, 1e-4))),
        Case { logs: 200, ..Case::encoder("encoder 0.1 mm, noise 0.1 mm", Other, 1e-4, 1e-4) },
        Case::encoder("encoder 0.1 mm, noise 1 um", Undithered, 1e-4, 1e-6),
        Case::encoder("encoder 0.5 mm, noise 10 um", Undithered, 5e-4, 1e-5),
        Case::encoder("encoder 1 mm, noise 10 um", Undithered, 1e-3, 1e-5),
        Case::encoder("encoder 2 mm, noise 10 um", Undithered, 2e-3, 1e-5),
    ]
}

const COULOMB: &[Mark] = &[("missing_term", "sign(dot(x))")];
const STRIBECK: &[Mark] = &[("missing_term", "Stribeck")];
const CUBIC: &[Mark] = &[("missing_term", " x^3")];
const DRAG: &[Mark] = &[("missing_term", "dot(x)*abs(dot(x))")];
const DRIFT: &[Mark] = &[("missing_term", "drift"), ("halves", "d is")];
const BACKLASH: &[Mark] = &[("missing_term", "backlash")];
/// A delay of the input, of the sensor, and a lag look alike.
const LATE: &[Mark] = &[("missing_term", "lag")];
const SIGN: &[Mark] = &[("negative_inertia", "a sign"), ("unexplained", "a sign")];
const CLIPPED: &[Mark] = &[("limited", "")];
const FLEXIBLE: &[Mark] = &[("vibration", "flexible mode"), ("missing_term", "flexible mode")];
const SENSOR: &[Mark] = &[("", "sensor that is not linear")];
const OFFSET: &[Mark] = &[("missing_term", "offset")];
const HOLD: &[Mark] = &[("other_hold", "")];
const LOST: &[Mark] = &[("", "rows"), ("", "samples are missing"), ("", "lost"), ("", "the recording did")];
const STALE: &[Mark] = &[("", "repeated value"), ("", "stale"), ("", "values repeat"), ("", "not updated")];
const SPIKES: &[Mark] = &[("lone_readings", "")];
const TIME: &[Mark] = &[("error", "time")];
const NUMBER: &[Mark] = &[("error", "not a finite number")];
const CONSTANT: &[Mark] = &[("error", "throughout")];
const COLUMN: &[Mark] = &[("exchanged", ""), ("", "a column"), ("", "the right column")];

/// Share of the samples that repeat the one before them, where a sensor is stale.
const STALE_SHARE: f64 = 0.05;
/// Samples that are zero, where a sensor drops out.
const DROPPED: usize = 5;
/// Rows that are lost.
const GAPS: [usize; 3] = [1000, 3333, 5000];

/// Cases in which the model lacks something, or the log is not what it seems.
#[must_use]
pub fn spoilt() -> Vec<Case> {
    let with = |change: fn(&mut Rig)| {
        let mut rig = Rig::default();
        change(&mut rig);
        rig
    };
    let stribeck = with(|rig| rig.force = Force::Stribeck { moving: FRICTION, rest: 2.0 * FRICTION, velocity: 0.1 });
    vec![
        Case::wrong("friction 1.5 N left out", with(|rig| rig.force = Force::Coulomb(FRICTION)), COULOMB),
        Case::wrong("Stribeck friction left out", stribeck, COULOMB),
        Case { model: Model::Friction, ..Case::wrong("Stribeck friction, Coulomb's in the model", stribeck, STRIBECK) },
        Case::wrong("cubic spring 60 N/m^3 left out", with(|rig| rig.force = Force::Cubic(60.0)), CUBIC),
        Case::wrong("cubic spring 20 N/m^3 left out", with(|rig| rig.force = Force::Cubic(20.0)), CUBIC),
        Case::wrong("drag 1 N s^2/m^2 left out", with(|rig| rig.force = Force::Drag(1.0)), DRAG),
        Case::wrong("drag 0.2 N s^2/m^2 left out", with(|rig| rig.force = Force::Drag(0.2)), DRAG),
        Case::wrong("damping drifts by 3 % a second", with(|rig| rig.drift = 0.03), DRIFT),
        Case::wrong("backlash of 1 mm before the sensor", with(|rig| rig.backlash = 1e-3), BACKLASH),
        Case::wrong("input acts one sample late", with(|rig| rig.input_delay = 1), LATE),
        Case::wrong("input acts three samples late", with(|rig| rig.input_delay = 3), LATE),
        Case::wrong("sensor one sample late", with(|rig| rig.sensor_delay = 1), LATE),
        Case::wrong("input lags by 3 ms", with(|rig| rig.lag = 3e-3), LATE),
        Case::wrong("clipped at 30 N behind the record", with(|rig| rig.limit = 30.0), CLIPPED),
        Case::wrong("clipped at 20 N behind the record", with(|rig| rig.limit = 20.0), CLIPPED),
        Case::wrong("clipped at 10 N behind the record", with(|rig| rig.limit = 10.0), CLIPPED),
        Case::wrong(
            "flexible mode at 20 Hz",
            with(|rig| rig.flexible = Some(Flexible { mass: 0.5, stiffness: 8000.0, damping: 2.0 })),
            FLEXIBLE,
        ),
        Case::wrong("eccentric encoder, 1 mm", with(|rig| rig.eccentricity = (1e-3, 20.0)), SENSOR),
        Case::spoilt("sign of the input wrong", SIGN, |log, _| log.input.iter_mut().for_each(|u| *u = -*u)),
        Case::spoilt("sign of the position wrong", SIGN, |log, _| log.position.iter_mut().for_each(|x| *x = -*x)),
        Case {
            hidden: true,
            ..Case::spoilt("position in degrees", &[], |log, _| {
                log.position.iter_mut().for_each(|x| *x = x.to_degrees());
            })
        },
        Case {
            hidden: true,
            ..Case::spoilt("time in ms as s", &[], |log, _| log.time.iter_mut().for_each(|t| *t *= 1e3))
        },
        Case::spoilt("position recorded with 5 cm more", OFFSET, |log, _| {
            log.position.iter_mut().for_each(|x| *x += 0.05);
        }),
        Case::spoilt("input recorded with 1 N more", OFFSET, |log, _| log.input.iter_mut().for_each(|u| *u += 1.0)),
        Case::spoilt("position a row late in the file", LATE, |log, _| {
            log.position.pop();
            log.time.remove(0);
            log.input.remove(0);
        }),
        Case { hold: Hold::None, ..Case::spoilt("hold not stated", HOLD, |_, _| {}) },
        Case::spoilt("three rows missing", TIME, |log, _| log.delete(&GAPS)),
        Case::spoilt("three rows lost, time renumbered", LOST, |log, _| {
            let mut time = log.time.clone();
            log.delete(&GAPS);
            time.truncate(log.position.len());
            log.time = time;
        }),
        Case::spoilt("5 % of the positions repeated", STALE, |log, rng| {
            for i in 1..log.position.len() {
                if rng.random_bool(STALE_SHARE) {
                    log.position[i] = log.position[i - 1];
                }
            }
        }),
        Case::spoilt("five positions are zero", SPIKES, |log, rng| {
            for _ in 0..DROPPED {
                let at = rng.random_range(0..log.position.len());
                log.position[at] = 0.0;
            }
        }),
        Case::spoilt("one position is no number", NUMBER, |log, _| log.position[1234] = f64::NAN),
        Case::spoilt("time stamps uneven by 10 %", TIME, |log, rng| {
            for t in &mut log.time {
                let noise: f64 = StandardNormal.sample(rng);
                *t += 1e-4 * noise;
            }
        }),
        Case::spoilt("input is zero throughout", CONSTANT, |log, _| log.input.fill(0.0)),
        Case::spoilt("columns swapped", COLUMN, |log, _| std::mem::swap(&mut log.position, &mut log.input)),
    ]
}
