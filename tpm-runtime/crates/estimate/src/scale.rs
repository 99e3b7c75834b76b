//! Hidden directions along which parameters are multiplied by powers of a common factor.

/// A hidden direction along which parameters are multiplied by powers of a common factor.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    /// Its place among the unobservable directions.
    pub direction: usize,
    /// The power of every parameter, zero for those that do not take part.
    pub powers: Vec<f64>,
}

impl Scale {
    /// The parameters that take part.
    pub fn members(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.powers.len()).filter(|&j| self.powers[j] != 0.0)
    }

    /// Goes along the scale by a factor.
    pub fn multiply(&self, values: &mut [f64], factor: f64) {
        self.members().for_each(|j| values[j] *= factor.powf(self.powers[j]));
    }

    /// The largest of them by value, whose power is one, and which is one in their gauge.
    #[must_use]
    pub fn own(&self, values: &[f64]) -> Option<usize> {
        let whole = |j: &usize| self.powers[*j] == 1.0 && values[*j].abs() > 0.0;
        self.members().filter(whole).max_by(|&a, &b| values[a].abs().total_cmp(&values[b].abs()))
    }
}
