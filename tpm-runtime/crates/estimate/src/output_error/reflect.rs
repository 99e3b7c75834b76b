//! Orthogonal elimination in small dense matrices.

/// Brings the first `pivots` columns of a row-major matrix to upper triangular form by Householder reflections, which leave every
/// sum of squares of a column as it is. A column without an entry is passed over. `factors` is a place to work in, of any length.
///
/// Rows have few entries and there are millions of them, so that loops over indices stand where iterators would take longer to set up
/// than to run.
pub(crate) fn triangularise(matrix: &mut [f64], factors: &mut Vec<f64>, width: usize, pivots: usize) {
    let rows = matrix.len() / width;
    factors.resize(width, 0.0);
    let factors = &mut factors[..width];
    for pivot in 0..pivots.min(rows) {
        let (above, below) = matrix.split_at_mut((pivot + 1) * width);
        let first = &mut above[pivot * width..][..width];
        let mut tail = 0.0;
        for row in below.chunks_exact(width) {
            tail += row[pivot] * row[pivot];
        }
        if tail <= 0.0 {
            continue;
        }
        let head = first[pivot];
        let norm = (head * head + tail).sqrt();
        let diagonal = if head > 0.0 { -norm } else { norm };
        // The reflection I - v v' / (norm * |v_1|) with v = x - diagonal e_1, whose first entry has no cancellation. Rows are read
        // one after the other, as they are stored; every column's product with v grows by one row's share at a time. Rows that begin
        // with a zero, of which the matrices of a chain are full, have no share.
        let lead = head - diagonal;
        let scale = 1.0 / (diagonal * lead);
        for column in pivot + 1..width {
            factors[column] = lead * first[column];
        }
        for row in below.chunks_exact(width) {
            let weight = row[pivot];
            if weight != 0.0 {
                for column in pivot + 1..width {
                    factors[column] += weight * row[column];
                }
            }
        }
        for column in pivot + 1..width {
            factors[column] *= scale;
            first[column] += factors[column] * lead;
        }
        for row in below.chunks_exact_mut(width) {
            let weight = row[pivot];
            if weight != 0.0 {
                for column in pivot + 1..width {
                    row[column] += factors[column] * weight;
                }
                row[pivot] = 0.0;
            }
        }
        first[pivot] = diagonal;
    }
}

#[cfg(test)]
mod tests {
    use super::triangularise;

    #[test]
    fn columns_keep_their_products() {
        let (rows, width) = (7, 4);
        let entry = |i: usize| f64::from((i * 7919 % 101) as u32) / 50.0 - 1.0;
        let before: Vec<f64> = (0..rows * width).map(entry).collect();
        let mut after = before.clone();
        triangularise(&mut after, &mut Vec::new(), width, 3);
        let product =
            |m: &[f64], a: usize, b: usize| (0..rows).map(|r| m[r * width + a] * m[r * width + b]).sum::<f64>();
        for a in 0..width {
            for b in 0..width {
                assert!((product(&before, a, b) - product(&after, a, b)).abs() < 1e-13);
            }
        }
        for column in 0..3 {
            assert!((column + 1..rows).all(|row| after[row * width + column].abs() < 1e-15));
        }
    }
}
