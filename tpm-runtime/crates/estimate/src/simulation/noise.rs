//! The noise of a record: of its sensors, and of the forces.

use rayon::prelude::*;
use tpm_numerics::{Cholesky, DMatrix, DVector, patience};

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

    /// Makes noise of forces no less than a share of another one.
    pub(super) fn lift(&mut self, other: &Self, share: f64) {
        self.force.iter_mut().zip(&other.force).for_each(|(own, other)| *own = own.max(share * other));
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

/// The numbers of the search for the noise. Lengths are in logarithms.
struct Search {
    /// Of differences that tell gradient and curvature.
    difference: f64,
    /// The longest step of a number, and that of one along which the cost is not curved.
    longest_step: f64,
    along_a_slope: f64,
    /// A slope below this is none.
    least_slope: f64,
    /// Shares of a step that are tried where the whole one gains nothing.
    shares: [f64; 3],
    /// A step that is to gain less, or gained less, ends the search.
    least_gain: f64,
}

const SEARCH: Search = Search {
    difference: 0.1,
    longest_step: 3.0,
    along_a_slope: 2.0,
    least_slope: 0.05,
    shares: [1.0, 0.3, 0.1],
    least_gain: 0.2,
};

/// What a search learned of how the cost is curved, for the next one.
#[derive(Clone, Debug, Default)]
pub(super) struct Curvature {
    numbers: Vec<Number>,
    /// Second derivatives.
    matrix: DMatrix<f64>,
}

impl Curvature {
    /// Takes in that a step changed the gradient (Broyden, Fletcher, Goldfarb, Shanno).
    fn learn(&mut self, step: &DVector<f64>, change: &DVector<f64>) {
        let along = step.dot(change);
        let before = &self.matrix * step;
        let own = step.dot(&before);
        if along > 1e-9 * step.norm() * change.norm() && own > 0.0 {
            self.matrix += change * change.transpose() / along - &before * before.transpose() / own;
        }
    }

    /// Takes in the second derivative by one number, which is measured; how two act together stays as it was learned.
    fn measured(&mut self, i: usize, curved: f64) {
        let share = (curved / self.matrix[(i, i)].max(f64::MIN_POSITIVE)).sqrt();
        self.matrix.row_mut(i).scale_mut(share);
        self.matrix.column_mut(i).scale_mut(share);
    }
}

/// The noise that makes `cost`, twice the negative logarithm of a likelihood, least, by quasi-Newton steps from a noise on, at most so many
/// of them. Returns the cost, too.
pub(super) fn most_likely(
    begun: Noise,
    forces: bool,
    steps: usize,
    curvature: &mut Curvature,
    cost: &(impl Fn(&Noise) -> f64 + Sync),
) -> (Noise, f64) {
    let numbers = begun.numbers(forces);
    if curvature.numbers != numbers {
        *curvature = Curvature { numbers: numbers.clone(), matrix: DMatrix::identity(numbers.len(), numbers.len()) };
    }
    let (mut noise, mut least) = (begun.clone(), cost(&begun));
    let mut before: Option<(DVector<f64>, DVector<f64>)> = None;
    for _ in 0..steps {
        if patience::is_over() {
            break;
        }
        let h = SEARCH.difference;
        let moved = |number: &Number, by: f64| noise.with(*number, noise.log(*number) + by);
        let beside: Vec<(f64, f64)> =
            numbers.par_iter().map(|number| (cost(&moved(number, -h)), cost(&moved(number, h)))).collect();
        let gradient = DVector::from_iterator(numbers.len(), beside.iter().map(|(down, up)| (up - down) / (2.0 * h)));
        let curved: Vec<f64> = beside.iter().map(|(down, up)| (down + up - 2.0 * least) / (h * h)).collect();
        if let Some((step, last)) = &before {
            curvature.learn(step, &(&gradient - last));
        }
        let usable = |i: usize| curved[i] > SEARCH.least_slope.max(gradient[i].abs() / SEARCH.along_a_slope);
        (0..numbers.len()).filter(|&i| usable(i)).for_each(|i| curvature.measured(i, curved[i]));
        let solved = Cholesky::new(curvature.matrix.clone()).map(|whole| whole.solve(&gradient));
        let mut step = -solved.unwrap_or_else(|| gradient.component_div(&curvature.matrix.diagonal()));
        for (i, own) in step.iter_mut().enumerate() {
            // Where the cost is no bowl, only the direction is known.
            if !usable(i) && *own * gradient[i] >= 0.0 {
                let falls = gradient[i].abs() > SEARCH.least_slope;
                *own = if falls { -SEARCH.along_a_slope * gradient[i].signum() } else { 0.0 };
            }
            *own = own.clamp(-SEARCH.longest_step, SEARCH.longest_step);
        }
        if -gradient.dot(&step) < SEARCH.least_gain {
            break;
        }
        let with = |share: f64| {
            let to = |noise: Noise, (number, by): (&Number, &f64)| noise.with(*number, noise.log(*number) + share * by);
            numbers.iter().zip(step.iter()).fold(noise.clone(), to)
        };
        let tried = SEARCH.shares.into_iter().map(|share| (share, with(share)));
        let better = tried.map(|(share, next)| (share, cost(&next), next)).find(|(_, cost, _)| *cost < least);
        let Some((share, reached, next)) = better else {
            // The curvature is another one here.
            curvature.numbers.clear();
            break;
        };
        let gain = least - reached;
        (noise, least) = (next, reached);
        before = Some((step * share, gradient));
        if gain < SEARCH.least_gain {
            break;
        }
    }
    (noise, least)
}

#[cfg(test)]
mod tests {
    use super::{Curvature, Noise, Number, most_likely};

    #[test]
    fn the_least_of_a_narrow_valley_is_found_from_far_away_and_remembered() {
        let begun = Noise { white: vec![1.0], least: vec![1e-9], colour: None, force: vec![1.0], drift: None };
        // Two numbers that nearly make up for each other, far from the begin in both, over a slope where the valley is left.
        let cost = |noise: &Noise| {
            let (a, b) = (noise.log(Number::White(0)) + 4.0, noise.log(Number::Force(0)) - 3.0);
            let (along, across) = (a - b, a + b);
            2e3 * ((1.0 + across * across).sqrt() - 1.0) + 20.0 * along * along
        };
        let mut curvature = Curvature::default();
        let (found, least) = most_likely(begun, true, 40, &mut curvature, &cost);
        assert!(least < 0.2, "{least}: {found:?}");
        assert!((found.log(Number::White(0)) + 4.0).abs() < 0.1, "{found:?}");
        assert!((found.log(Number::Force(0)) - 3.0).abs() < 0.1, "{found:?}");
        // From there on nothing is gained, and nothing moves.
        let (again, _) = most_likely(found.clone(), true, 5, &mut curvature, &cost);
        assert_eq!(again, found);
    }

    #[test]
    fn a_number_that_nothing_depends_on_stays_where_it_is() {
        let begun = Noise { white: vec![0.5], least: vec![1e-9], colour: None, force: vec![2.0], drift: None };
        let cost = |noise: &Noise| 50.0 * noise.log(Number::White(0)).powi(2);
        let (found, least) = most_likely(begun, true, 20, &mut Curvature::default(), &cost);
        assert!(least < 0.1 && (found.white[0] - 1.0).abs() < 0.1, "{least}: {found:?}");
        assert_eq!(found.force, [2.0]);
    }
}
