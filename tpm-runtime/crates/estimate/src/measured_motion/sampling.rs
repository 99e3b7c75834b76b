//! Rows and their Jacobian, sampled along one period of the measured motion.
//!
//! Invariant: the motion is the trigonometric polynomial of the record's lines, so that its derivatives are exact, and the
//! grid is fine enough that the harmonics of the rows no longer depend on it (up to the most of [`GRID`]).

use crate::error::EstimateError;
use num_complex::Complex;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{Dims, Model};
use tpm_motion::{Spectra, held};
use tpm_numerics::fourier::{analyse, synthesise, two_sided};
use tpm_numerics::{DMatrix, Doubling, RowDVector};

/// Points of a period at which the rows are evaluated: doubled until no harmonic of a regressor changes by more than a share of the
/// largest (terms that jump need many).
const GRID: Doubling = Doubling { least: 1024, most: 32_768, settled: 1e-9 };
/// Most points of a period at which the Jacobian is evaluated.
const MOST_JACOBIAN_POINTS: usize = 1024;
/// The floor under the highest lines is taken for an error that repeats with the period when its power is this many times
/// that of the noise between the lines.
const LEAST_FLOOR_RATIO: f64 = 4.0;
/// Harmonics of a derivative below this share of its strongest one are left out: they mix no noise that counts.
const LEAST_MIXING_HARMONIC: f64 = 1e-9;
/// A derivative ends with its last harmonic of this share of its strongest one. That of a term that jumps is a row of spikes, which
/// does not end within the grid.
const LEAST_LAST_HARMONIC: f64 = 1e-3;

/// d row / d slot along the period, slots being the coordinates' derivatives that the model uses.
#[derive(Clone, Debug)]
pub(super) struct Jacobian {
    /// (coordinate, derivative).
    pub(super) slots: Vec<(usize, usize)>,
    /// Points of the grid on the period.
    points: usize,
    /// Two-sided Fourier coefficients along the period from the mean on, up to the last above [`LEAST_MIXING_HARMONIC`]:
    /// `[slot][row * (parameters + 1) + j]`; j = parameters is the known term.
    pub(super) lines: Vec<Lines>,
}

impl Jacobian {
    /// The highest harmonic that the derivatives have, but for a small share of each; nothing where one does not end, because its
    /// term jumps.
    pub(super) fn reach(&self) -> Option<usize> {
        let of = |lines: &Vec<Complex<f64>>| {
            let strongest = lines.iter().map(Complex::norm_sqr).fold(0.0, f64::max);
            lines
                .iter()
                .rposition(|line| line.norm_sqr() > LEAST_LAST_HARMONIC * LEAST_LAST_HARMONIC * strongest)
                .unwrap_or(0)
        };
        let reach = self.lines.iter().flatten().map(of).max().unwrap_or(0);
        // The grid has harmonics up to half of its points.
        (4 * reach < self.points).then_some(reach)
    }

    /// The coefficients of a row's derivative with respect to every slot at theta.
    pub(super) fn gains(&self, row: usize, theta: &[f64]) -> Lines {
        let width = theta.len() + 1;
        let gain = |columns: &Lines| {
            let own = &columns[row * width..(row + 1) * width];
            let mut gain = vec![Complex::new(0.0, 0.0); own.iter().map(Vec::len).max().unwrap_or(0)];
            for (column, &factor) in own.iter().zip(theta.iter().chain(&[1.0])) {
                for (sum, line) in gain.iter_mut().zip(column) {
                    *sum += line * factor;
                }
            }
            gain
        };
        self.lines.iter().map(gain).collect()
    }
}

/// Two-sided Fourier coefficients of a derivative along the period, up to the last above [`LEAST_MIXING_HARMONIC`].
fn mixing_lines(series: &[f64]) -> Vec<Complex<f64>> {
    let mut lines = two_sided(series);
    let strongest = lines.iter().map(Complex::norm_sqr).fold(0.0, f64::max);
    let last =
        lines.iter().rposition(|line| line.norm_sqr() > LEAST_MIXING_HARMONIC * LEAST_MIXING_HARMONIC * strongest);
    lines.truncate(last.map_or(0, |last| last + 1));
    lines
}

/// Phasors per signal, or per entry of a matrix, and harmonic.
pub(super) type Lines = Vec<Vec<Complex<f64>>>;

/// Rows sampled along a period.
pub(super) struct Sampled {
    pub(super) points: usize,
    pub(super) motion: Vec<f64>,
    pub(super) phi: Vec<f64>,
    pub(super) known: Vec<f64>,
    pub(super) map: Vec<f64>,
}

/// Input lines and channel noise with the hold taken into account.
pub(super) fn hold_corrected(spectra: &Spectra, dims: Dims, hold: Hold) -> (Lines, Vec<DMatrix<Complex<f64>>>) {
    let factor = |k: usize| held(hold, k as f64 * spectra.fundamental * spectra.sample_time);
    let inputs = (0..dims.inputs)
        .map(|i| spectra.lines[dims.coordinates + i].iter().enumerate().map(|(k, line)| line * factor(k)).collect())
        .collect();
    // An input's record is what was applied, its rounding included; only a coordinate's floor is an error of measurement.
    let floors: Vec<Option<f64>> = (0..spectra.lines.len()).map(|c| spectra.floor(c)).collect();
    let noise = spectra
        .noise
        .iter()
        .enumerate()
        .map(|(k, covariance)| {
            let mut corrected = covariance.clone();
            for (c, floor) in floors.iter().enumerate() {
                // A mean has a quarter of the variance of a phasor. Floor and noise between the lines estimate one variance unless
                // the error repeats; taking the larger one always would be biased.
                let repeated = floor.map_or(0.0, |f| if k == 0 { f / 4.0 } else { f });
                let judged = c < dims.coordinates || spectra.noise_bins == 0;
                if judged && LEAST_FLOOR_RATIO * corrected[(c, c)].re < repeated {
                    corrected[(c, c)] = Complex::new(repeated, 0.0);
                }
            }
            for i in dims.coordinates..dims.coordinates + dims.inputs {
                let f = factor(k);
                corrected.row_mut(i).iter_mut().for_each(|z| *z *= f);
                corrected.column_mut(i).iter_mut().for_each(|z| *z *= f.conj());
            }
            corrected
        })
        .collect();
    (inputs, noise)
}

/// Lines of B u per row, and the mean of B.
pub(super) fn drive_lines(
    dims: Dims,
    sampled: &Sampled,
    inputs: &[Vec<Complex<f64>>],
    harmonics: usize,
) -> (Lines, DMatrix<f64>) {
    let size = dims.input_map_len();
    let mut mean = DMatrix::zeros(dims.rows, dims.inputs);
    let mut constant = true;
    if size > 0 {
        for sample in sampled.map.chunks_exact(size) {
            mean += DMatrix::from_row_slice(dims.rows, dims.inputs, sample);
            constant &= sample == &sampled.map[..size];
        }
        mean /= sampled.points as f64;
    }
    if constant {
        if size > 0 {
            mean = DMatrix::from_row_slice(dims.rows, dims.inputs, &sampled.map[..size]);
        }
        let drive = (0..dims.rows)
            .map(|r| {
                (0..=harmonics)
                    .map(|k| {
                        (0..dims.inputs).map(|i| inputs[i].get(k).copied().unwrap_or_default() * mean[(r, i)]).sum()
                    })
                    .collect()
            })
            .collect();
        return (drive, mean);
    }
    let waves: Vec<Vec<f64>> =
        inputs.iter().map(|lines| synthesise(lines, 0, 1.0, lines.len() - 1, sampled.points)).collect();
    let drive = (0..dims.rows)
        .map(|r| {
            let product: Vec<f64> = sampled
                .map
                .chunks_exact(size)
                .enumerate()
                .map(|(i, map)| {
                    let row = RowDVector::from_row_slice(&map[r * dims.inputs..(r + 1) * dims.inputs]);
                    row.iter().zip(&waves).map(|(b, wave)| b * wave[i]).sum()
                })
                .collect();
            analyse(&product, 0, 1, harmonics)
        })
        .collect();
    (drive, mean)
}

/// What the sampling of a model along a record needs.
pub(super) struct Context<'a> {
    pub(super) model: &'a dyn Model<f64>,
    pub(super) dims: Dims,
    pub(super) constants: &'a [f64],
    pub(super) spectra: &'a Spectra,
    pub(super) motion_harmonics: usize,
}

impl Context<'_> {
    /// Samples the rows on a grid that is doubled until their harmonics no longer change.
    pub(super) fn converge(
        &self,
        harmonics: usize,
        grid: Option<usize>,
    ) -> Result<(Sampled, Lines, Lines), EstimateError> {
        let least = 2 * (self.motion_harmonics.max(harmonics) + 1);
        if let Some(points) = grid {
            let sampled = self.sample(points.max(least))?;
            let (phi, known) = self.columns(&sampled, 1, harmonics);
            return Ok((sampled, phi, known));
        }
        let mut points = (2 * least).next_power_of_two().max(GRID.least);
        loop {
            let sampled = self.sample(points)?;
            let (phi, known) = self.columns(&sampled, 1, harmonics);
            if points >= GRID.most {
                return Ok((sampled, phi, known));
            }
            let (coarse_phi, coarse_known) = self.columns(&sampled, 2, harmonics);
            let settled = phi.iter().zip(&coarse_phi).chain(known.iter().zip(&coarse_known)).all(|(fine, coarse)| {
                let peak = fine.iter().map(|z| z.norm()).fold(0.0, f64::max);
                fine.iter().zip(coarse).all(|(a, b)| (a - b).norm() <= GRID.settled * peak)
            });
            if settled {
                return Ok((sampled, phi, known));
            }
            points *= 2;
        }
    }

    fn columns(&self, sampled: &Sampled, stride: usize, harmonics: usize) -> (Lines, Lines) {
        let (size, rows) = (self.dims.regressor_len(), self.dims.rows);
        let phi = (0..size).map(|e| analyse(&sampled.phi, e, size * stride, harmonics)).collect();
        let known = (0..rows).map(|r| analyse(&sampled.known, r, rows * stride, harmonics)).collect();
        (phi, known)
    }

    fn sample(&self, points: usize) -> Result<Sampled, EstimateError> {
        let points = points + points % 2;
        let dims = self.dims;
        let mut motion = vec![0.0; points * dims.motion_len()];
        for c in 0..dims.coordinates {
            for d in 0..=self.model.coordinate_order(c) {
                let wave =
                    synthesise(&self.spectra.lines[c], d, self.spectra.fundamental, self.motion_harmonics, points);
                let slot = d * dims.coordinates + c;
                for (i, value) in wave.iter().enumerate() {
                    motion[i * dims.motion_len() + slot] = *value;
                }
            }
        }
        let mut phi = vec![0.0; points * dims.regressor_len()];
        let mut known = vec![0.0; points * dims.rows];
        let mut map = vec![0.0; points * dims.input_map_len()];
        let mut scratch = vec![0.0; self.model.workspace_len()];
        for i in 0..points {
            let now = &motion[i * dims.motion_len()..(i + 1) * dims.motion_len()];
            self.model.regressor(
                now,
                self.constants,
                &mut scratch,
                &mut phi[i * dims.regressor_len()..(i + 1) * dims.regressor_len()],
            )?;
            self.model.known(now, self.constants, &mut scratch, &mut known[i * dims.rows..(i + 1) * dims.rows])?;
            self.model.input_map(
                now,
                self.constants,
                &mut scratch,
                &mut map[i * dims.input_map_len()..(i + 1) * dims.input_map_len()],
            )?;
        }
        if let Some(at) = phi.iter().position(|x| !x.is_finite()) {
            let entry = at % dims.regressor_len();
            return Err(self.not_finite(entry / dims.parameters, self.model.parameter(entry % dims.parameters).name));
        }
        if let Some(at) = known.iter().position(|x| !x.is_finite()) {
            return Err(self.not_finite(at % dims.rows, "a term without an unknown parameter"));
        }
        if let Some(at) = map.iter().position(|x| !x.is_finite()) {
            return Err(self.not_finite(at % dims.input_map_len() / dims.inputs, "the input's factor"));
        }
        Ok(Sampled { points, motion, phi, known, map })
    }

    fn not_finite(&self, row: usize, what: &str) -> EstimateError {
        EstimateError::NotFinite { row: self.model.row(row).name.into(), what: what.into() }
    }

    pub(super) fn jacobian(&self, sampled: &Sampled) -> Result<Jacobian, EstimateError> {
        let dims = self.dims;
        let slots: Vec<(usize, usize)> =
            (0..dims.coordinates).flat_map(|c| (0..=self.model.coordinate_order(c)).map(move |d| (c, d))).collect();
        let mut stride = 1;
        while sampled.points / stride > MOST_JACOBIAN_POINTS && (sampled.points / stride).is_multiple_of(2) {
            stride *= 2;
        }
        let points = sampled.points / stride;
        let width = dims.parameters + 1;
        let mut scratch = vec![0.0; self.model.workspace_len()];
        let mut lines = Vec::with_capacity(slots.len());
        let mut now = vec![0.0; dims.motion_len()];
        let mut side = [
            (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows]),
            (vec![0.0; dims.regressor_len()], vec![0.0; dims.rows]),
        ];
        for &(c, d) in &slots {
            let slot = d * dims.coordinates + c;
            let power = sampled.motion.chunks_exact(dims.motion_len()).map(|m| m[slot] * m[slot]).sum::<f64>()
                / sampled.points as f64;
            let step = if power > 0.0 { 1e-3 * power.sqrt() } else { 1e-3 };
            let mut series = vec![0.0; dims.rows * width * points];
            for i in 0..points {
                let at = i * stride * dims.motion_len();
                now.copy_from_slice(&sampled.motion[at..at + dims.motion_len()]);
                let centre = now[slot];
                for (sign, (phi, known)) in [1.0, -1.0].iter().zip(side.iter_mut()) {
                    now[slot] = centre + sign * step;
                    self.model.regressor(&now, self.constants, &mut scratch, phi)?;
                    self.model.known(&now, self.constants, &mut scratch, known)?;
                }
                for r in 0..dims.rows {
                    for j in 0..width {
                        let difference = if j == dims.parameters {
                            side[0].1[r] - side[1].1[r]
                        } else {
                            side[0].0[r * dims.parameters + j] - side[1].0[r * dims.parameters + j]
                        };
                        series[(r * width + j) * points + i] = difference / (2.0 * step);
                    }
                }
            }
            lines.push(series.chunks_exact(points).map(mixing_lines).collect());
        }
        Ok(Jacobian { slots, points, lines })
    }

    /// Per row, whether a term depends on velocities (odd derivatives) and does not change when all of them change sign.
    pub(super) fn even_in_velocity(&self, sampled: &Sampled) -> Result<Vec<bool>, EstimateError> {
        let dims = self.dims;
        let p = dims.parameters;
        let mut scratch = vec![0.0; self.model.workspace_len()];
        let mut flipped = vec![0.0; dims.regressor_len()];
        let mut still = vec![0.0; dims.regressor_len()];
        let (mut odd_part, mut moving_part) = (vec![0.0_f64; flipped.len()], vec![0.0_f64; flipped.len()]);
        let stride = (sampled.points / 64).max(1);
        for i in (0..sampled.points).step_by(stride) {
            let mut now = sampled.motion[i * dims.motion_len()..(i + 1) * dims.motion_len()].to_vec();
            let phi = &sampled.phi[i * flipped.len()..(i + 1) * flipped.len()];
            for (slot, value) in now.iter_mut().enumerate() {
                if (slot / dims.coordinates) % 2 == 1 {
                    *value = -*value;
                }
            }
            self.model.regressor(&now, self.constants, &mut scratch, &mut flipped)?;
            for (slot, value) in now.iter_mut().enumerate() {
                if (slot / dims.coordinates) % 2 == 1 {
                    *value = 0.0;
                }
            }
            self.model.regressor(&now, self.constants, &mut scratch, &mut still)?;
            for e in 0..phi.len() {
                odd_part[e] = odd_part[e].max((phi[e] - flipped[e]).abs());
                moving_part[e] = moving_part[e].max((phi[e] - still[e]).abs());
            }
        }
        Ok((0..dims.rows)
            .map(|r| (r * p..(r + 1) * p).any(|e| moving_part[e] > 0.0 && odd_part[e] <= 1e-9 * moving_part[e]))
            .collect())
    }
}
