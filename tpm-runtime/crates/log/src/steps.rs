//! The steps in which the numbers of a signal are written.
//!
//! Readings differ by whole steps: of an encoder, or of the last digit of a file. Numbers that were written with so many significant digits
//! are rounded more coarsely the larger they are, so that steps are told by the power of ten. They are told from the numbers of the file
//! itself, since a factor moves the powers of ten, wraps that are followed make small numbers large, and differences that are computed have
//! rounding errors far below any step:
//!
//! ```text
//! y = f(a, b) ,      step of y = |change of f by a step of a| + |change of f by a step of b| .
//! ```

use std::collections::BTreeMap;

/// The steps of a signal's numbers by the power of ten of their size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Steps(BTreeMap<i32, f64>);

impl Steps {
    /// The least difference of neighbouring numbers that is not zero, by the power of ten of the larger one; where larger numbers differ by
    /// less, theirs. What is no number is passed over.
    pub(super) fn of(numbers: &[f64]) -> Self {
        let mut least = BTreeMap::new();
        let there = || numbers.iter().copied().filter(|number| number.is_finite());
        for (one, next) in there().zip(there().skip(1)).filter(|(one, next)| one != next) {
            let own = least.entry(power_of_ten(one.abs().max(next.abs()))).or_insert(f64::INFINITY);
            *own = (next - one).abs().min(*own);
        }
        let mut above = f64::INFINITY;
        for own in least.values_mut().rev() {
            above = above.min(*own);
            *own = above;
        }
        Steps(least)
    }

    /// The largest of the steps of values, by the power of ten of the values.
    pub(super) fn of_values(values: &[f64], steps: &[f64]) -> Self {
        let mut largest = BTreeMap::new();
        for (value, step) in values.iter().zip(steps).filter(|(value, _)| value.is_finite()) {
            let own = largest.entry(power_of_ten(value.abs())).or_insert(0.0);
            *own = step.max(*own);
        }
        Steps(largest)
    }

    /// The step about a number; infinite where no numbers of its size or larger ones differ.
    #[must_use]
    pub fn at(&self, number: f64) -> f64 {
        self.0.range(power_of_ten(number.abs())..).next().map_or(f64::INFINITY, |(_, step)| *step)
    }

    /// The least of the steps; zero where no numbers differ.
    #[must_use]
    pub fn least(&self) -> f64 {
        let least = self.0.values().copied().fold(f64::INFINITY, f64::min);
        if least.is_finite() { least } else { 0.0 }
    }
}

/// The power of ten at or below a size.
fn power_of_ten(size: f64) -> i32 {
    size.log10().floor() as i32
}

/// What the numbers of a signal are before its factor and its offset: those of a column of the file, or computed of columns.
#[derive(Clone, Debug)]
pub(super) struct Numbers {
    pub(super) factor: f64,
    pub(super) offset: f64,
    /// The steps of computed numbers with the lines of the file, which ascend.
    pub(super) computed: Option<Vec<(u64, f64)>>,
}

impl Numbers {
    /// The step of every value of the signal, of which the lines of the file are known.
    pub(super) fn steps(&self, values: &[f64], lines: &[u64]) -> Vec<f64> {
        let Some(computed) = &self.computed else {
            let numbers: Vec<f64> = values.iter().map(|value| (value - self.offset) / self.factor).collect();
            let steps = Steps::of(&numbers);
            return numbers.into_iter().map(|number| self.factor.abs() * steps.at(number)).collect();
        };
        let of_line = |line: &u64| {
            let at = computed.partition_point(|(own, _)| own < line);
            computed.get(at).filter(|(own, _)| own == line).map_or(f64::INFINITY, |(_, step)| self.factor.abs() * step)
        };
        lines.iter().map(of_line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::Steps;

    #[test]
    fn steps_grow_with_the_size_of_numbers() {
        let steps = Steps::of(&[0.0123, 0.0124, 0.121, 0.122, 1.55, 1.54, 12.1, 12.4]);
        for (number, step) in [(0.05, 1e-4), (-0.5, 1e-3), (3.0, 0.01), (20.0, 0.3)] {
            assert!((steps.at(number) / step - 1.0).abs() < 1e-9, "{number}: {}", steps.at(number));
        }
        assert_eq!(steps.at(200.0), f64::INFINITY);
        assert_eq!((Steps::of(&[1.0; 9]).least(), Steps::of(&[]).least()), (0.0, 0.0));
    }
}
