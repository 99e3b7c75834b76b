//! "Did you mean": the known name nearest to an unknown one.

/// The candidate that differs from `name` by the fewest single-letter edits (a swap of neighbours counts as one edit).
/// The number of edits must be at most a third of the name's length, unless only upper and lower case differ. Of
/// equally near candidates the first is returned.
pub(crate) fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Longer names are no typing mistakes, and the computing time of the distance is quadratic in the length.
    const LONGEST: usize = 40;
    if name.len() > LONGEST {
        return None;
    }
    // For a name of one letter nothing is suggested, since any other letter is a different name.
    let allowed = if name.len() == 1 { 0 } else { name.len().div_ceil(3) };
    candidates
        .into_iter()
        .filter(|candidate| candidate.len() <= LONGEST && *candidate != name)
        .map(|candidate| match candidate.eq_ignore_ascii_case(name) {
            true => (0, candidate),
            false => (distance(name.as_bytes(), candidate.as_bytes()), candidate),
        })
        .filter(|&(distance, candidate)| distance <= allowed && distance < candidate.len())
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, candidate)| candidate)
}

/// Optimal string alignment distance.
fn distance(a: &[u8], b: &[u8]) -> usize {
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    for (i, row) in rows.iter_mut().enumerate() {
        row[0] = i;
    }
    rows[0] = (0..=b.len()).collect();
    for i in 1..=a.len() {
        for j in 1..=b.len() {
            let change = usize::from(a[i - 1] != b[j - 1]);
            let mut best = (rows[i - 1][j] + 1).min(rows[i][j - 1] + 1).min(rows[i - 1][j - 1] + change);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(rows[i - 2][j - 2] + 1);
            }
            rows[i][j] = best;
        }
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_finger_is_found_and_another_word_is_not() {
        assert_eq!(nearest("lamda", ["lambda", "w"]), Some("lambda"));
        assert_eq!(nearest("paramter", ["parameter", "coordinate"]), Some("parameter"));
        assert_eq!(nearest("k3", ["k1", "k2", "m"]), Some("k1"));
        assert_eq!(nearest("TH1", ["x", "th1"]), Some("th1"));
        assert_eq!(nearest("M", ["x", "m"]), Some("m"));
        assert_eq!(nearest("q", ["x", "m"]), None);
        assert_eq!(nearest("force", ["mass", "k1"]), None);
    }
}
