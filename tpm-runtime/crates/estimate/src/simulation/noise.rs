//! The noise of a record: of its sensors, and of the forces.

/// What is not known in a record.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Noise {
    /// Factor, by sensor, on the variance that it states of its readings.
    pub(super) white: Vec<f64>,
    /// Least factor of every sensor.
    pub(super) least: Vec<f64>,
    /// Noise of the sensors that goes on from one reading to the next, beside the white one.
    pub(super) colour: Option<FirstOrder>,
    /// Density of the white noise of the force of every row, unit of the row squared times s.
    pub(super) force: Vec<f64>,
    /// Forces that go on, in the place of white ones.
    pub(super) drift: Option<FirstOrder>,
}

/// Noise of the first order, `d' = -d/time + w`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FirstOrder {
    /// Stationary variance, by sensor or by row.
    pub(super) variance: Vec<f64>,
    /// Correlation time, s.
    pub(super) time: f64,
}

impl FirstOrder {
    /// Share that is left after a time.
    pub(super) fn kept(&self, after: f64) -> f64 {
        (-after / self.time).exp()
    }
}

/// One number of the noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    White(usize),
    Force(usize),
    Colour(usize),
    ColourTime,
    Drift(usize),
    DriftTime,
}

impl Noise {
    /// The numbers that a search may change: those of the white noise of sensors alone, without `forces`.
    fn numbers(&self, forces: bool) -> Vec<Number> {
        let mut numbers: Vec<Number> = (0..self.white.len()).map(Number::White).collect();
        if !forces {
            return numbers;
        }
        match &self.drift {
            Some(drift) => {
                numbers.extend((0..drift.variance.len()).filter(|&i| drift.variance[i] > 0.0).map(Number::Drift));
                numbers.push(Number::DriftTime);
            }
            None => numbers.extend((0..self.force.len()).filter(|&i| self.force[i] > 0.0).map(Number::Force)),
        }
        if let Some(colour) = &self.colour {
            numbers.extend((0..colour.variance.len()).filter(|&i| colour.variance[i] > 0.0).map(Number::Colour));
            numbers.push(Number::ColourTime);
        }
        numbers
    }

    /// The logarithm of a number.
    pub(super) fn log(&self, number: Number) -> f64 {
        let of = |own: &Option<FirstOrder>, at: Option<usize>| {
            own.as_ref().map_or(1.0, |own| at.map_or(own.time, |at| own.variance[at]))
        };
        let value = match number {
            Number::White(i) => self.white[i],
            Number::Force(i) => self.force[i],
            Number::Colour(i) => of(&self.colour, Some(i)),
            Number::ColourTime => of(&self.colour, None),
            Number::Drift(i) => of(&self.drift, Some(i)),
            Number::DriftTime => of(&self.drift, None),
        };
        value.max(f64::MIN_POSITIVE).ln()
    }

    /// The noise with another logarithm of a number.
    pub(super) fn with(&self, number: Number, log: f64) -> Self {
        let mut noise = self.clone();
        let value = log.exp();
        let put = |own: &mut Option<FirstOrder>, at: Option<usize>| {
            if let Some(own) = own {
                match at {
                    Some(at) => own.variance[at] = value,
                    None => own.time = value,
                }
            }
        };
        match number {
            Number::White(i) => noise.white[i] = value.max(noise.least[i]),
            Number::Force(i) => noise.force[i] = value,
            Number::Colour(i) => put(&mut noise.colour, Some(i)),
            Number::ColourTime => put(&mut noise.colour, None),
            Number::Drift(i) => put(&mut noise.drift, Some(i)),
            Number::DriftTime => put(&mut noise.drift, None),
        }
        noise
    }
}

/// The numbers of the search for the noise. Steps are in logarithms.
struct Search {
    first_step: f64,
    /// A step that is no longer than this is not made.
    last_step: f64,
    longest_step: f64,
    /// A sweep that gains less ends the search.
    least_gain: f64,
}

const SEARCH: Search = Search { first_step: 1.0, last_step: 0.05, longest_step: 3.0, least_gain: 0.3 };

/// The lengths of the steps of a search, which goes on where an earlier one ended.
#[derive(Clone, Debug, Default)]
pub(super) struct Steps {
    of: Vec<(Number, f64)>,
}

impl Steps {
    fn of(&mut self, number: Number) -> &mut f64 {
        let at = self.of.iter().position(|(own, _)| *own == number).unwrap_or_else(|| {
            self.of.push((number, SEARCH.first_step));
            self.of.len() - 1
        });
        &mut self.of[at].1
    }

    /// Lets all numbers move anew: the motion, or what explains it, is another one.
    pub(super) fn again(&mut self) {
        self.of.iter_mut().for_each(|(_, step)| *step = SEARCH.first_step);
    }
}

/// The noise that makes `cost`, twice the negative logarithm of a likelihood, least: number by number to the vertex of a parabola through
/// three places, in at most so many sweeps. Returns the cost, too.
pub(super) fn most_likely(
    begun: Noise,
    forces: bool,
    sweeps: usize,
    steps: &mut Steps,
    cost: &(impl Fn(&Noise) -> f64 + Sync),
) -> (Noise, f64) {
    let numbers = begun.numbers(forces);
    let (mut noise, mut least) = (begun.clone(), cost(&begun));
    for _ in 0..sweeps {
        let before = least;
        for number in &numbers {
            let length = *steps.of(*number);
            if length < SEARCH.last_step {
                continue;
            }
            let here = noise.log(*number);
            let at = |by: f64| {
                let other = noise.with(*number, here + by);
                (cost(&other), other)
            };
            let (below, above) = rayon::join(|| at(-length), || at(length));
            let curvature = below.0 - 2.0 * least + above.0;
            let vertex = if curvature > 1e-9 {
                0.5 * length * (below.0 - above.0) / curvature
            } else if above.0 < below.0 {
                2.0 * length
            } else {
                -2.0 * length
            };
            let vertex = vertex.clamp(-SEARCH.longest_step * length, SEARCH.longest_step * length);
            let there = at(vertex);
            let best = [below, above, there].into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
            let next = match best.filter(|best| best.0 < least) {
                Some(best) => {
                    let moved = (best.1.log(*number) - here).abs();
                    (least, noise) = best;
                    (0.5 * moved).clamp(0.25 * length, SEARCH.longest_step)
                }
                None => 0.3 * length,
            };
            *steps.of(*number) = next;
        }
        if before - least < SEARCH.least_gain {
            break;
        }
    }
    (noise, least)
}
