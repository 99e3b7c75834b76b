//! Which harmonics show which base parameter.

use std::collections::BTreeSet;
use tpm_runtime::report::{Align, TextTable};
use tpm_runtime::study::ShowingHarmonic;

/// Harmonics that are printed per base parameter; all of them are in the JSON.
const MOST: usize = 3;

/// By base parameter: the harmonics of the largest amplitudes; empty where there are none.
pub(crate) fn showing_harmonics<'a>(base: impl Iterator<Item = (&'a str, &'a [ShowingHarmonic])>) -> String {
    let base: Vec<(&str, &[ShowingHarmonic])> = base.filter(|(_, harmonics)| !harmonics.is_empty()).collect();
    if base.is_empty() {
        return String::new();
    }
    let all = || base.iter().flat_map(|(_, harmonics)| harmonics.iter());
    let several = all().map(|shown| &shown.experiment).collect::<BTreeSet<_>>().len() > 1;
    let error = all().map(|shown| shown.error).fold(0.0, f64::max);
    let mut table = TextTable::new(&[("base parameter", Align::Left), ("shown most by harmonic", Align::Left)]);
    for (parameter, harmonics) in &base {
        let mut harmonics: Vec<&ShowingHarmonic> = harmonics.iter().collect();
        harmonics.sort_by(|a, b| b.amplitude.total_cmp(&a.amplitude));
        let most = harmonics.iter().take(MOST).map(|shown| {
            let experiment = if several { format!(" in {}", shown.experiment) } else { String::new() };
            format!("{} of {}{experiment} ({:.3e})", shown.harmonic, shown.equation, shown.amplitude)
        });
        table.row(&[(*parameter).to_owned(), most.collect::<Vec<_>>().join(", ")]);
    }
    let note = format!("amplitudes per unit of the base parameter, by Jacobi-Anger series, right to {error:.1e}");
    format!("\n{}{note}\n", table.finish())
}
