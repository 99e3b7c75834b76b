//! Hidden directions along which parameters are multiplied by powers of a common factor.

use tpm_numerics::DMatrix;

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

    /// Goes along the scale until a parameter has a size; gives the derivatives of the values there by those before.
    pub fn bring(&self, values: &mut [f64], own: usize, size: f64) -> DMatrix<f64> {
        let before = values[own];
        self.multiply(values, size / before);
        let mut map = DMatrix::identity(values.len(), values.len());
        for j in self.members() {
            map[(j, j)] = (size / before).powf(self.powers[j]);
            map[(j, own)] -= self.powers[j] * values[j] / before;
        }
        map
    }

    /// The largest of them by value, whose power is one, and which is one in their gauge.
    #[must_use]
    pub fn own(&self, values: &[f64]) -> Option<usize> {
        let whole = |j: &usize| self.powers[*j] == 1.0 && values[*j].abs() > 0.0;
        self.members().filter(whole).max_by(|&a, &b| values[a].abs().total_cmp(&values[b].abs()))
    }
}
