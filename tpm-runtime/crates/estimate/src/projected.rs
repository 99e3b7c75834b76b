//! Parameters of one model in those of another, by the forces of both along a motion.
//!
//! The forces of the two models are R A + r and S a + s, row by row along the motion. The parameters a that come nearest to the forces of A
//! in least squares are a = P A + p with P = S+ R and p = S+ (r - s). Forwards, A is known and a is wanted. Backwards, a is known and A is
//! wanted: an identification whose model is S gives, as far as the machine is R, values with the mean P A + p, so that A solves
//! P A + p = a, weighed by the covariance of a. Going forwards and then back gives the combinations of A that P shows.
//!
//! Invariant: nothing is said along what the motion hides of the wanted parameters, and along what the known ones leave open.

use crate::information::{Information, beside_known, touched};
use crate::result::Estimate;
use crate::verdict::{Evidence, POOR_DEVIATION, ResidualOf, Status};
use tpm_numerics::singular::{Singular, complement, unit_columns};
use tpm_numerics::{Cholesky, DMatrix, DVector, Matrix, tolerance};

/// What is known of parameters: combinations, with their values.
#[derive(Clone, Debug, PartialEq)]
pub struct Known {
    /// Weights of the parameters, a row for every combination.
    pub weights: DMatrix<f64>,
    /// Values of the combinations.
    pub values: DVector<f64>,
    /// Covariance of the values; zero for exact ones.
    pub covariance: DMatrix<f64>,
}

impl Known {
    /// Exact values of all parameters.
    pub fn exact(values: Vec<f64>) -> Self {
        let n = values.len();
        Known { weights: DMatrix::identity(n, n), values: DVector::from_vec(values), covariance: DMatrix::zeros(n, n) }
    }

    /// Whether the values have no deviations.
    pub fn is_exact(&self) -> bool {
        self.covariance.iter().all(|entry| *entry == 0.0)
    }

    /// Parameters that are multiplied by `scale` in place of the own ones, in combinations of length one.
    fn scaled(&self, scale: &[f64]) -> Self {
        let mut weights = DMatrix::from_fn(self.weights.nrows(), scale.len(), |r, c| self.weights[(r, c)] / scale[c]);
        let lengths: Vec<f64> = weights.row_iter().map(|row| row.norm()).collect();
        for (mut row, length) in weights.row_iter_mut().zip(&lengths) {
            row /= *length;
        }
        let values = DVector::from_fn(lengths.len(), |k, _| self.values[k] / lengths[k]);
        let entry = |r: usize, c: usize| self.covariance[(r, c)] / (lengths[r] * lengths[c]);
        Known { weights, values, covariance: DMatrix::from_fn(lengths.len(), lengths.len(), entry) }
    }

    /// Parameters for which all combinations hold, the shortest in units of `scale`.
    pub fn settled(&self, scale: &[f64]) -> DVector<f64> {
        let own = self.scaled(scale);
        let values = own.inverse() * &own.values;
        DVector::from_fn(scale.len(), |j, _| values[j] / scale[j])
    }

    /// The pseudo-inverse of the weights.
    fn inverse(&self) -> DMatrix<f64> {
        inverse(&Singular::new(&self.weights, tolerance::RANK))
    }
}

/// V S^-1 U' of a decomposition.
fn inverse(singular: &Singular) -> DMatrix<f64> {
    let mut right = singular.right.clone();
    for (mut column, value) in right.column_iter_mut().zip(&singular.values) {
        column /= *value;
    }
    right * singular.left.transpose()
}

/// The forces of two models along a motion: rows of mean square one, all with the weights of their inputs.
#[derive(Clone, Debug)]
pub struct Projector {
    /// Number of parameters that are projected onto.
    onto: usize,
    /// S with columns of length one, and what these were divided by.
    scale: Vec<f64>,
    decomposed: Singular,
    /// R, and what its columns are divided by to have length one.
    from: DMatrix<f64>,
    from_scale: Vec<f64>,
    /// P.
    matrix: DMatrix<f64>,
    /// p.
    offset: DVector<f64>,
}

impl Projector {
    /// The projector of the forces `from` onto those of `onto`, matrices with a row for every instant and input, a column for every
    /// parameter; `known` are the terms of `from` without a parameter less those of `onto`.
    pub fn new(from: &DMatrix<f64>, onto: &DMatrix<f64>, known: &DVector<f64>) -> Self {
        let (p, q) = (onto.ncols(), from.ncols());
        let joint = DMatrix::from_fn(onto.nrows().max(p + q + 1), p + q + 1, |r, c| match c {
            _ if r >= onto.nrows() => 0.0,
            c if c < p => onto[(r, c)],
            c if c < p + q => from[(r, c - p)],
            _ => known[r],
        });
        // The triangle has the lengths and angles of the columns, in as many rows as there are columns.
        let triangle = joint.qr().unpack_r();
        let (unit, scale) = unit_columns(triangle.columns(0, p).into_owned());
        let from = triangle.columns(p, q).into_owned();
        let (_, from_scale) = unit_columns(from.clone());
        let decomposed = Singular::new(&unit, tolerance::RANK);
        let raw = |scaled: DMatrix<f64>| DMatrix::from_fn(p, scaled.ncols(), |r, c| scaled[(r, c)] / scale[r]);
        let inverse = inverse(&decomposed);
        let matrix = raw(&inverse * &from);
        let offset = raw(&inverse * triangle.columns(p + q, 1)).column(0).into_owned();
        Projector { onto: p, scale, decomposed, from, from_scale, matrix, offset }
    }

    /// What the columns that are projected onto are divided by to have length one.
    pub fn scale(&self) -> &[f64] {
        &self.scale
    }

    /// What the columns that are projected are divided by to have length one.
    pub fn projected_scale(&self) -> &[f64] {
        &self.from_scale
    }

    /// The parameters nearest to the forces of others.
    pub fn apply(&self, from: &DVector<f64>) -> DVector<f64> {
        &self.matrix * from + &self.offset
    }

    /// The nearest parameters to known ones, with what of them the motion and the known ones show.
    pub fn forward(&self, known: &Known) -> Estimate {
        let own = known.scaled(&self.from_scale);
        let inverse_weights = own.inverse();
        let unscaled = |scaled: DMatrix<f64>| {
            DMatrix::from_fn(scaled.nrows(), scaled.ncols(), |r, c| scaled[(r, c)] / self.from_scale[r])
        };
        let from = unscaled(inverse_weights);
        let values = self.apply(&(&from * &own.values));
        let covariance = {
            let passed = &self.matrix * &from;
            &passed * &own.covariance * passed.transpose()
        };
        // What the known ones leave open moves the nearest parameters where the motion feels it.
        let open = unscaled(Singular::new(&own.weights, tolerance::RANK).null());
        let felt = Singular::new(&(&self.from * open), tolerance::RANK);
        let counted = felt.values.iter().filter(|value| **value > tolerance::STORED).count();
        let images = self.decomposed.right.clone()
            * DMatrix::from_fn(self.decomposed.rank(), counted, |r, c| {
                self.decomposed.left.column(r).dot(&felt.left.column(c)) / self.decomposed.values[r]
            });
        let moved = Singular::new(&unit_columns(images).0, tolerance::STORED).left;
        let hidden = self.decomposed.null();
        let lost = hidden.column_iter().chain(moved.column_iter());
        let lost: Vec<Vec<f64>> = lost.map(|direction| direction.iter().copied().collect()).collect();
        let unobservable = beside_known(&[], lost, &self.scale);
        self.estimate(values, covariance, unobservable, &self.scale)
    }

    /// The parameters whose nearest ones are known, with what of them follows from the known ones. Also the sum of squares that is left,
    /// in deviations of the known ones, and its degrees of freedom.
    pub fn backward(&self, known: &Known) -> (Estimate, f64, usize) {
        let own = known.scaled(&self.scale);
        // Combinations of the known ones that the motion shows too.
        let mut strange = &own.weights * self.decomposed.null();
        strange.iter_mut().filter(|entry| entry.abs() <= tolerance::STORED).for_each(|entry| *entry = 0.0);
        let basis = complement(&Singular::new(&strange, tolerance::STORED).left);
        let shown = basis.tr_mul(&own.weights);
        // Deviations of equal forces: (S' S)+ in scaled parameters.
        let along = &shown * inverse(&self.decomposed);
        let equal = &along * along.transpose();
        let covariance =
            basis.tr_mul(&own.covariance) * &basis + equal * (tolerance::EXACT_DEVIATION * tolerance::EXACT_DEVIATION);
        let scaled = |raw: DMatrix<f64>| DMatrix::from_fn(self.onto, raw.ncols(), |r, c| raw[(r, c)] * self.scale[r]);
        let offset = scaled(DMatrix::from_columns(std::slice::from_ref(&self.offset)));
        let right = basis.tr_mul(&own.values) - (&shown * offset).column(0);
        let passed = &shown * scaled(self.matrix.clone());
        let hidden = self.unfelt(&passed);
        let mut rows = passed.insert_column(self.matrix.ncols(), 0.0);
        rows.column_mut(self.matrix.ncols()).copy_from(&right);
        let count = rows.nrows();
        if let Some(weights) = Cholesky::new(covariance) {
            weights.l_dirty().solve_lower_triangular_mut(&mut rows);
        }
        let equations = Information::of(rows);
        let solved = equations.scaled().solve(&[], None, &hidden);
        let covariance =
            if known.is_exact() { DMatrix::zeros(self.matrix.ncols(), self.matrix.ncols()) } else { solved.covariance };
        let values = DVector::from_vec(solved.values);
        let condition = equations.scaled().condition(&hidden);
        let estimate = self.estimate(values, covariance, solved.unobservable, &self.from_scale);
        let estimate = Estimate { condition, ..estimate };
        (estimate, solved.remainder, count - solved.rank)
    }

    /// Directions of the parameters along which rows do not change, but for what the digits of a stored result leave of nothing.
    fn unfelt(&self, rows: &DMatrix<f64>) -> Vec<Vec<f64>> {
        let of_force = DMatrix::from_fn(rows.nrows(), rows.ncols(), |r, c| rows[(r, c)] / self.from_scale[c]);
        let lengths: Vec<f64> = of_force.column_iter().map(|column| column.norm()).collect();
        let largest = lengths.iter().copied().fold(0.0, f64::max);
        // A column of rounding is not scaled up.
        let counts = |c: usize| lengths[c] > tolerance::STORED * largest;
        let scale: Vec<f64> = (0..lengths.len()).map(|c| if counts(c) { lengths[c] } else { 1.0 }).collect();
        let unit =
            DMatrix::from_fn(
                rows.nrows(),
                rows.ncols(),
                |r, c| {
                    if counts(c) { of_force[(r, c)] / scale[c] } else { 0.0 }
                },
            );
        let null = Singular::new(&unit, tolerance::STORED).null();
        let lost = null.column_iter().map(|direction| direction.iter().copied().collect()).collect();
        let scale: Vec<f64> = scale.iter().zip(&self.from_scale).map(|(own, force)| own * force).collect();
        beside_known(&[], lost, &scale)
    }

    fn estimate(
        &self,
        values: DVector<f64>,
        covariance: DMatrix<f64>,
        unobservable: Vec<Vec<f64>>,
        scale: &[f64],
    ) -> Estimate {
        let hidden = touched(&unobservable, scale);
        let deviation = |j: usize| covariance[(j, j)].max(0.0).sqrt();
        let status = |j: usize| {
            let shown = Evidence::Shown { value: values[j], std: deviation(j), felt: deviation(j) * scale[j] };
            Status::of(if hidden[j] { Evidence::Hidden } else { shown }, POOR_DEVIATION)
        };
        let p = values.len();
        Estimate {
            std: (0..p).map(|j| if hidden[j] { f64::INFINITY } else { deviation(j) }).collect(),
            status: (0..p).map(status).collect(),
            values: values.as_slice().to_vec(),
            covariance: Matrix::of(covariance),
            rank: p - unobservable.len(),
            unobservable,
            scales: Vec::new(),
            condition: self.decomposed.condition(),
            residual: 0.0,
            residual_of: ResidualOf::Force,
            chi_squared: 1.0,
            model_error: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Known, Projector};
    use crate::Status;
    use tpm_numerics::{DMatrix, DVector};

    /// Rows without any pattern.
    fn forces(rows: usize, columns: usize, of: f64) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |r, c| ((r * r) as f64 * 0.37 + (c as f64 + of) * 1.91 * r as f64).sin())
    }

    /// A model whose last column is the sum of the first ones, so that one direction is hidden.
    fn dependent(rows: usize) -> DMatrix<f64> {
        let three = forces(rows, 3, 0.3);
        let sum = three.column(0) + three.column(1) * 2.0;
        let mut four = three.insert_column(3, 0.0);
        four.column_mut(3).copy_from(&sum);
        four
    }

    fn nothing(rows: usize) -> DVector<f64> {
        DVector::zeros(rows)
    }

    #[test]
    fn onto_itself_it_is_the_identity_on_what_is_shown() {
        let model = dependent(40);
        let projector = Projector::new(&model, &model, &nothing(40));
        let given = [3.0, -1.0, 2.0, 5.0];
        let known = Known::exact(given.to_vec());
        let (back, _, _) = projector.backward(&known);
        for found in [projector.forward(&known), back] {
            assert_eq!(found.rank, 3);
            assert!((found.values[2] - 2.0).abs() < 1e-12 && found.std[2] == 0.0);
            assert_eq!(found.status[2], Status::Identified);
            for j in [0, 1, 3] {
                assert_eq!(found.status[j], Status::Unobservable);
            }
            assert_eq!(found.combinations().len(), 2);
            for shown in found.combinations() {
                let sum: f64 = shown.weights.iter().zip(&given).map(|(weight, value)| weight * value).sum();
                assert!((sum - shown.value).abs() < 1e-12, "{shown:?}");
            }
        }
    }

    #[test]
    fn the_nearest_are_those_of_the_normal_equations_and_terms_without_parameters_count() {
        let (from, onto) = (forces(50, 5, 0.1), forces(50, 3, 7.7));
        let known = DVector::from_fn(50, |r, _| (r as f64).cos());
        let given = vec![1.0, -2.0, 0.5, 3.0, 0.1];
        let found = Projector::new(&from, &onto, &known).forward(&Known::exact(given.clone()));
        let force = &from * DVector::from_vec(given) + &known;
        let normal = (onto.tr_mul(&onto)).try_inverse().expect("independent columns") * onto.tr_mul(&force);
        for (found, expected) in found.values.iter().zip(&normal) {
            assert!((found - expected).abs() < 1e-12);
        }
    }

    /// What a first identification left open stays open, and its covariance goes through both ways.
    #[test]
    fn what_is_open_stays_open_and_deviations_go_through() {
        // a + 2 d and b are known of four parameters.
        let weights = DMatrix::from_row_slice(2, 4, &[1.0, 0.0, 0.0, 2.0, 0.0, 1.0, 0.0, 0.0]);
        let covariance = DMatrix::from_row_slice(2, 2, &[0.04, 0.01, 0.01, 0.09]);
        let known = Known { weights, values: DVector::from_vec(vec![7.0, 3.0]), covariance };
        let from = forces(60, 4, 0.4);
        // b alone, and the sum of what the others move, which the known ones do not tell.
        let onto = DMatrix::from_fn(60, 3, |r, c| match c {
            0 => from[(r, 1)],
            1 => from[(r, 0)] + from[(r, 2)],
            _ => from[(r, 3)],
        });
        let projector = Projector::new(&from, &onto, &nothing(60));
        let forward = projector.forward(&known);
        // Two directions are open, and both move the nearest parameters.
        assert_eq!(forward.rank, 1);
        for shown in forward.combinations() {
            for others in [[7.0, 3.0, -4.0, 0.0], [1.0, 3.0, 20.0, 3.0]] {
                let nearest = projector.apply(&DVector::from_column_slice(&others));
                let sum: f64 = shown.weights.iter().zip(&nearest).map(|(weight, value)| weight * value).sum();
                assert!((sum - shown.value).abs() < 1e-9, "{shown:?}");
            }
        }
        // Of a model with the same columns, what was known comes out again, with its covariance.
        let same = Projector::new(&from, &from, &nothing(60));
        let (back, left, degrees) = same.backward(&known);
        for found in [same.forward(&known), back] {
            assert_eq!(found.rank, 2);
            assert!((found.values[1] - 3.0).abs() < 1e-9 && (found.std[1] - 0.3).abs() < 1e-6, "{found:?}");
            let shown = found.combinations();
            let lead: Vec<_> =
                shown.iter().map(|shown| (shown.value / shown.weights[0], shown.std / shown.weights[0])).collect();
            assert!(shown.len() == 1 && (lead[0].0 - 7.0).abs() < 1e-9 && (lead[0].1 - 0.2).abs() < 1e-6, "{lead:?}");
            assert_eq!([found.status[0], found.status[2], found.status[3]], [Status::Unobservable; 3]);
        }
        assert!(left < 1e-9 && degrees == 0);
        // Weights of nine digits show no more.
        let mut stored = known.clone();
        stored.weights[(0, 3)] += 1e-9;
        stored.weights[(0, 2)] += 1e-9;
        assert_eq!(same.backward(&stored).0.rank, 2);
        assert_eq!(same.forward(&stored).rank, 2);
    }

    /// Nearest parameters of a model that is poorer, and back: the combinations that were put in.
    #[test]
    fn forwards_and_back_gives_the_combinations_again() {
        let rich = dependent(80);
        let onto = forces(80, 6, 2.2);
        let projector = Projector::new(&rich, &onto, &nothing(80));
        let given = [3.0, -1.0, 2.0, 5.0];
        let forward = projector.forward(&Known::exact(given.to_vec()));
        assert_eq!(forward.rank, 6);
        let (back, left, degrees) = projector.backward(&Known::exact(forward.values.clone()));
        assert_eq!((back.rank, degrees), (3, 3));
        assert!(left < 1e-9, "{left}");
        for shown in back.combinations() {
            let sum: f64 = shown.weights.iter().zip(&given).map(|(weight, value)| weight * value).sum();
            assert!((sum - shown.value).abs() < 1e-9, "{shown:?}");
        }
        assert!((back.values[2] - 2.0).abs() < 1e-9);
    }
}
