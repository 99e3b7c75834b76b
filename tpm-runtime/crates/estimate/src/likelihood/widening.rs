//! How far the noise of the forces lets rows be used: up to which frequency, and how near to a reversal.
//!
//! A motion stands out of its sensor's noise up to some frequency. Where the forces have more noise than the sensors make, forces at higher
//! frequencies tell something too. Around a reversal friction takes any value within its bounds, and a smoothed sign comes late; a row in
//! which this makes no more than the noise needs no notch.

use crate::error::EstimateError;
use crate::likelihood::lines::{Masks, View, is_enough};
use crate::likelihood::noise::Noise;
use crate::likelihood::pass::Pass;
use rayon::prelude::*;
use tpm_numerics::{Cholesky, DMatrix};

/// Highest frequency up to which a motion may be taken, over the one at which it stands out of its noise: beyond, its forces have next to
/// nothing. Below it frequencies are tried in steps of this ratio.
const WIDEST: f64 = 4.0;
const FINER: f64 = 1.1;
/// A motion is taken up to where its sensor's noise makes this share of the noise of the forces: sensors whose noise is coloured may have up
/// to twenty times of it there before it counts as much.
const HIDDEN: f64 = 0.05;
/// Highest frequency of a motion that is taken, in units of the sampling rate: eight points an oscillation.
const HIGHEST: f64 = 0.125;
/// What is left around reversals counts as no larger than elsewhere up to so many standard deviations of its mean square.
const ALIKE: f64 = 1.0;

/// Sums over the times of a row.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// Squares of what is left.
    squares: f64,
    /// Squares that the uncertainty of the parameters makes of it.
    spread: f64,
    points: f64,
    /// Independent equations.
    equations: f64,
}

impl Sums {
    fn and(self, other: Self) -> Self {
        Sums {
            squares: self.squares + other.squares,
            spread: self.spread + other.spread,
            points: self.points + other.points,
            equations: self.equations + other.equations,
        }
    }
}

impl Pass<'_> {
    /// Frequencies up to which the coordinates are taken, Hz, where the noise of the forces allows more than their own noise, and zero for
    /// others: nothing where it does so for none, or where more is taken already.
    pub(super) fn wider(&self) -> Result<Option<Vec<f64>>, EstimateError> {
        let Some(felt) = self.felt.as_ref().filter(|_| self.look.taken.iter().all(|taken| *taken <= 0.0)) else {
            return Ok(None);
        };
        let lines = self.above_floors()?;
        let noise = Noise::first(&lines, true).found(&lines, &self.kept, self.right(), None, None).0;
        let of_forces: Vec<f64> = (lines.iter().zip(&noise.variance))
            .map(|(row, variance)| {
                let last = row.bands().saturating_sub(1);
                let own =
                    row.band.iter().zip(variance).filter(|(band, _)| **band == last).map(|(_, variance)| *variance);
                own.fold(f64::INFINITY, f64::min)
            })
            .collect();
        let (h, measured) = (self.paths.sample_time, &self.paths.measured);
        let of = |c: usize| {
            let own = &measured[c].spectrum;
            let rows: Vec<usize> = (0..of_forces.len()).filter(|&row| felt.feels(row, c)).collect();
            let hidden = |f: &f64| {
                let w = 2.0 * std::f64::consts::PI * f;
                rows.iter().all(|&row| felt.noise_of(row, c, measured, w, h) < HIDDEN * of_forces[row])
            };
            let most = (WIDEST * own.followed).min(HIGHEST / h);
            let tried = std::iter::successors(Some(most), |f| Some(f / FINER)).take_while(|f| *f > own.used);
            tried.into_iter().find(hidden).unwrap_or(0.0)
        };
        let taken: Vec<f64> = (0..measured.len()).map(of).collect();
        Ok(taken.iter().any(|taken| *taken > 0.0).then_some(taken))
    }

    /// Largest share of the full width that the notches of a row need: what is left of the row in the times that a narrower one would
    /// leave, besides, is no larger there than elsewhere. `columns` are those of the covariance.
    pub(super) fn needed_notch(
        &self,
        row: usize,
        (values, missing): (&[f64], &[f64]),
        (columns, covariance): (&[usize], &DMatrix<f64>),
    ) -> Result<f64, EstimateError> {
        let view = self.views[row];
        let (p, right) = (self.rows.model.dims().parameters, self.right());
        let signals = self.signals(row, missing)?.0;
        let Some(factor) = Cholesky::new(covariance.clone()) else { return Ok(view.notch) };
        let lower = factor.l();
        // Of every share: squares in the times that it adds to those of the full width, what parameters make of them, and their number.
        let mut added: Vec<(f64, Sums)> = Vec::new();
        let mut kept = Sums::default();
        for (path, signals) in self.paths.paths.iter().zip(&signals) {
            let Some(Masks { valid, of_share }) = view.left_by_notches(path) else { return Ok(view.notch) };
            let Some(widest) = of_share.iter().rev().map(|(_, mask)| mask).find(|mask| is_enough(mask)) else {
                continue;
            };
            let mut left = vec![0.0; path.points];
            let mut spread = DMatrix::<f64>::zeros(columns.len(), path.points);
            let shares = view.shares(path);
            let factor = |number: usize| match number {
                j if j == right => 1.0,
                j if j < p => -values[j],
                j => -missing[j - p],
            };
            let place = |number: usize| columns.iter().position(|column| *column == number);
            let own = signals.iter().filter(|(number, _)| factor(*number) != 0.0 || place(*number).is_some());
            let own: Vec<&(usize, Vec<f64>)> = own.collect();
            let passed: Vec<Vec<f64>> = own.par_iter().map(|(_, signal)| View::passed(path, &shares, signal)).collect();
            for ((number, _), passed) in own.into_iter().zip(&passed) {
                let factor = factor(*number);
                left.iter_mut().zip(passed).for_each(|(sum, x)| *sum += factor * x);
                if let Some(at) = place(*number) {
                    spread.row_mut(at).copy_from_slice(passed);
                }
            }
            let spread = lower.tr_mul(&spread);
            let rate = 2.0 * path.apart * view.low_pass.cut_off / (2.0 * std::f64::consts::PI);
            let at = |i: usize| {
                let k = valid.start + i;
                Sums { squares: left[k].powi(2), spread: spread.column(k).norm_squared(), points: 1.0, equations: rate }
            };
            let chosen = |mask: &dyn Fn(usize) -> bool| {
                (0..valid.len()).filter(|&i| mask(i)).map(at).fold(Sums::default(), Sums::and)
            };
            kept = kept.and(chosen(&|i| widest[i]));
            for (place, (share, mask)) in of_share.iter().enumerate() {
                let own = chosen(&|i| mask[i] && !widest[i]);
                match added.get_mut(place) {
                    Some((_, sums)) => *sums = sums.and(own),
                    None => added.push((*share, own)),
                }
            }
        }
        let noise = (kept.squares + kept.spread) / kept.points.max(1.0);
        let alike = |(_, own): &&(f64, Sums)| {
            let expected = own.points * noise + own.spread;
            let chance = (2.0 / own.equations.max(1.0) + 2.0 / kept.equations.max(1.0)).sqrt();
            own.squares <= (1.0 + ALIKE * chance) * expected
        };
        Ok(added.iter().find(alike).map_or(view.notch, |(share, _)| *share))
    }
}
