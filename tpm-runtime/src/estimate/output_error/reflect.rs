//! Orthogonal elimination in small dense matrices.

/// Brings the first `pivots` columns of a row-major matrix to upper triangular form by Householder reflections, which leave every
/// sum of squares of a column as it is. A column without an entry is passed over.
pub(super) fn triangularise(matrix: &mut [f64], width: usize, pivots: usize) {
    let rows = matrix.len() / width;
    for pivot in 0..pivots.min(rows) {
        let (above, below) = matrix.split_at_mut((pivot + 1) * width);
        let first = &mut above[pivot * width..];
        let tail: f64 = below.chunks_exact(width).map(|row| row[pivot] * row[pivot]).sum();
        if tail <= 0.0 {
            continue;
        }
        let head = first[pivot];
        let norm = (head * head + tail).sqrt();
        let diagonal = if head > 0.0 { -norm } else { norm };
        // The reflection I - v v' / (norm * |v_1|) with v = x - diagonal e_1, whose first entry has no cancellation.
        let lead = head - diagonal;
        let scale = 1.0 / (diagonal * lead);
        for column in pivot + 1..width {
            let mut product = lead * first[column];
            for row in below.chunks_exact(width) {
                product += row[pivot] * row[column];
            }
            let factor = product * scale;
            if factor.abs() > 0.0 {
                first[column] += factor * lead;
                for row in below.chunks_exact_mut(width) {
                    row[column] += factor * row[pivot];
                }
            }
        }
        first[pivot] = diagonal;
        for row in below.chunks_exact_mut(width) {
            row[pivot] = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::triangularise;
    use std::vec::Vec;

    #[test]
    fn columns_keep_their_products() {
        let (rows, width) = (7, 4);
        let entry = |i: usize| f64::from((i * 7919 % 101) as u32) / 50.0 - 1.0;
        let before: Vec<f64> = (0..rows * width).map(entry).collect();
        let mut after = before.clone();
        triangularise(&mut after, width, 3);
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
