//! First values: what the lines show, from which values rows without an input are linear, and how the rows feel the motion.

use crate::error::EstimateError;
use crate::free::Free;
use crate::information::{beside, beside_known, set_apart};
use crate::likelihood::library::{OnGrid, Scales, Seen, Structure, Term, TermKind};
use crate::likelihood::lines::{RowLines, Signals, row_lines};
use crate::likelihood::noise::{Noise, triangle};
use crate::likelihood::pass::{Known, Look, Pass};
use crate::likelihood::path::{Along, Columns, Entry, Felt, Path, Paths};
use crate::rows::Rows;
use crate::settings::Settings;
use crate::time_domain::MOST_NOISE_INFORMATION;
use tpm_numerics::singular::{Singular, unit_columns};
use tpm_numerics::{DMatrix, DVector};

/// A direction of scaled parameters whose singular value is below this share of the largest is not shown.
pub(super) const RANK: f64 = 1e-8;
/// Known terms above this share of a row's force fix the scale of a row without an input.
pub(super) const KNOWN_SHARE: f64 = 1e-3;

impl<'a> Pass<'a> {
    pub(super) fn new(
        rows: Rows<'a>,
        (record, motion, circular, memory): Known<'a>,
        look: &Look,
        free: &Free,
        settings: &Settings,
    ) -> Result<Self, EstimateError> {
        let dims = rows.model.dims();
        let paths = Paths::new(rows, record, motion, circular, (&look.inputs, &look.taken));
        let ground = memory.of(look, &paths)?;
        let along: Vec<Along> =
            ground.along.iter().zip(&paths.paths).map(|(own, path)| own.under_inputs_of(rows, path)).collect();
        let deviations = paths.measured.iter().map(|own| own.rate_deviation).collect();
        let driven =
            |row: usize| along.iter().any(|own| (0..dims.inputs).any(|i| own.place(row, Entry::Rate(i)).is_some()));
        let stretches: Vec<OnGrid<'_>> =
            paths.paths.iter().zip(&along).map(|(path, along)| OnGrid { path, along, from: 0.0 }).collect();
        let stretches: Vec<&dyn Seen> = stretches.iter().map(|own| own as &dyn Seen).collect();
        let scales = Scales::of((dims.coordinates, (0..dims.rows).map(driven).collect()), &stretches, deviations);
        let theta = settings.start(dims.parameters);
        let mut pass = Pass {
            rows,
            record,
            motion,
            look: look.clone(),
            ground,
            paths,
            along,
            scales,
            terms: Vec::new(),
            columns: Vec::new(),
            sizes: Vec::new(),
            theta,
            kept: free.indices.clone(),
            hidden: Vec::new(),
            scale_directions: 0,
            views: Vec::new(),
            leading: vec![None; dims.rows],
            coefficients: Vec::new(),
            lines: Vec::new(),
            felt: None,
        };
        pass.first(free, settings)?;
        Ok(pass)
    }

    /// First values, what is not shown, and which coordinates a row feels.
    fn first(&mut self, free: &Free, settings: &Settings) -> Result<(), EstimateError> {
        let dims = self.rows.model.dims();
        self.views = self.views(&|row| if row < dims.coordinates { vec![row] } else { Vec::new() });
        // A row without an input as it stands: nothing on the other side.
        let mut lines = self.all_rows(&[])?;
        self.rank(&lines, free, settings)?;
        for row in &mut lines {
            self.hold(row);
        }
        let coefficients = self.rows.leading_coefficients(&self.paths)?;
        self.start(&lines, &coefficients)?;
        let felt = Felt::of(&self.paths, &self.theta)?;
        self.views = self.views(&|row| felt.coordinates(row));
        let leads = |row: usize| if self.homogeneous(row) { leading(row, &coefficients[row]) } else { None };
        self.leading = (0..dims.rows).map(leads).collect();
        if self.leading.iter().any(Option::is_some) {
            self.scale_free(free)?;
        }
        self.coefficients = coefficients;
        self.felt = Some(felt);
        Ok(())
    }

    /// Terms that the model may lack, and the lines of all rows with them; `load` are parameters whose forces are the load of the drives.
    ///
    /// # Errors
    /// As of [`all_rows`](Self::all_rows).
    pub(super) fn with_terms(mut self, load: &[usize]) -> Result<Self, EstimateError> {
        let feels = |row: usize, c: usize| self.felt.as_ref().is_some_and(|felt| felt.feels(row, c));
        // Stretch by stretch and coordinate by coordinate; a single coordinate is asked for no offset and for no chain.
        let coordinates = Some(self.rows.model.dims().coordinates).filter(|own| *own > 1).unwrap_or(0);
        let along = |path: &Path| {
            let at = (self.theta.as_slice(), self.paths.stride(path));
            (0..coordinates).map(|c| self.rows.by_position(path, at, c)).collect()
        };
        let by_position = self.paths.paths.iter().map(along).collect::<Result<Vec<Vec<Columns>>, EstimateError>>()?;
        let moves = |(_, values): &(usize, Vec<f64>)| values.iter().any(|value| *value != 0.0);
        let structure = Structure {
            coupled: &|row, c| self.coupled(row, c),
            by_position: &|row, c| by_position.iter().any(|own| own[c].iter().any(|own| own.0 == row && moves(own))),
            feels: &feels,
            has_own_inertia: &|c| self.own_inertia(c).is_some(),
        };
        self.terms = self.scales.terms(self.rows.model, &structure);
        let look = &self.look;
        self.terms.retain(|term| look.is_fitted(*term) || !look.refused.contains(term));
        let mut from = 0.0;
        for ((path, along), by_position) in self.paths.paths.iter().zip(&self.along).zip(by_position) {
            let of = |term: &Term| match term.kind {
                TermKind::InputGain => along.of_input(term.of, &self.theta),
                TermKind::PositionOffset => by_position[term.of].clone(),
                TermKind::LoadFriction if !load.is_empty() => {
                    self.scales.load_friction(*term, &OnGrid { path, along, from }, (load, &self.theta))
                }
                _ => self.scales.columns(*term, &OnGrid { path, along, from }),
            };
            self.columns.push(self.terms.iter().map(of).collect());
            from += path.points as f64 * path.apart;
        }
        self.scale_terms();
        self.lines = self.above_floors()?;
        Ok(self)
    }

    /// Takes what parameters that are no longer estimated make from the right-hand side of a row.
    fn hold(&self, row: &mut RowLines) {
        let right = self.right();
        let made = row.columns.iter().copied().filter(|column| *column != right && !self.kept.contains(column));
        let held: Vec<usize> = made.filter(|&j| self.theta[j] != 0.0).collect();
        let mut target = row.column(right);
        for &j in &held {
            target.axpy(-self.theta[j], &row.column(j), 1.0);
        }
        if let Some(at) = row.place(right).filter(|_| !held.is_empty()) {
            row.entries.set_column(at, &target);
            row.take_power(target);
        }
    }

    /// What noise of the sensors makes of the columns of the parameters: lines of all rows.
    fn noise_lines(&self) -> Result<&[RowLines], EstimateError> {
        if let Some(known) = self.ground.noise.get() {
            return Ok(known);
        }
        let noisy = self.paths.with_noise(self.motion);
        let along: Vec<Along> = noisy.paths.iter().map(|path| self.rows.along(path)).collect::<Result<_, _>>()?;
        let of_row = |row: usize| {
            let of = |((own, noisy), path): ((&Along, &Along), &Path)| -> Signals {
                let own = own.parameters(row);
                let without = |(j, column): (usize, Vec<f64>)| {
                    let exact = own.iter().find(|(other, _)| *other == j).map(|(_, column)| column.as_slice());
                    (j, column.iter().enumerate().map(|(k, x)| x - exact.map_or(0.0, |exact| exact[k])).collect())
                };
                let columns = noisy.parameters(row).into_iter().map(without);
                columns.chain([(self.right(), vec![0.0; path.points])]).collect()
            };
            let signals: Vec<Signals> = self.along.iter().zip(&along).zip(&self.paths.paths).map(of).collect();
            row_lines(&self.paths.paths, self.views[row], &signals).ok_or(EstimateError::NoSignal)
        };
        let lines = (0..self.rows.model.dims().rows).map(of_row).collect::<Result<_, _>>()?;
        Ok(self.ground.noise.get_or_init(|| lines))
    }

    /// What the lines do not show, and which parameters are estimated.
    fn rank(&mut self, lines: &[RowLines], free: &Free, settings: &Settings) -> Result<(), EstimateError> {
        let noise = Noise::first(lines, false);
        let factor = triangle(lines, &noise.variance, &free.indices, self.right());
        let n = free.indices.len();
        let (factor, scale) = unit_columns(factor.view((0, 0), (n, n)).into_owned());
        let known: Vec<Vec<f64>> = settings.hidden.iter().map(|direction| free.of(direction)).collect();
        let shown_by_some = beside(&known, &scale);
        let known = if shown_by_some.is_some() { known } else { Vec::new() };
        let (narrow, whole) = match &shown_by_some {
            Some(basis) => (&factor * basis, Some(basis)),
            None => (factor, None),
        };
        let singular = Singular::new(&narrow, RANK);
        if singular.rank() == 0 {
            return Err(EstimateError::NoSignal);
        }
        let in_scaled =
            |directions: DMatrix<f64>| whole.map_or_else(|| directions.clone(), |basis| basis * &directions);
        // Coordinates in which the information is the identity, and what noise alone would make of it there.
        let mut shown = in_scaled(singular.right.clone());
        for (mut column, value) in shown.column_iter_mut().zip(singular.values.iter()) {
            column /= *value;
        }
        let of_noise = triangle(self.noise_lines()?, &noise.variance, &free.indices, self.right());
        let mut of_noise = of_noise.view((0, 0), (n, n)).into_owned();
        for (mut column, scale) in of_noise.column_iter_mut().zip(&scale) {
            column /= *scale;
        }
        let of_noise = of_noise * &shown;
        let of_noise = of_noise.tr_mul(&of_noise).symmetric_eigen();
        let by_noise = of_noise.eigenvalues.iter().zip(of_noise.eigenvectors.column_iter());
        let by_noise: Vec<DVector<f64>> = (by_noise.filter(|(share, _)| **share > MOST_NOISE_INFORMATION))
            .map(|(_, own)| (&shown * own).normalize())
            .collect();
        if singular.rank() == by_noise.len() {
            return Err(EstimateError::NoSignal);
        }
        let null = in_scaled(singular.null());
        let lost = null.column_iter().map(|column| column.iter().copied().collect());
        let lost = lost.chain(by_noise.iter().map(|own| own.iter().copied().collect())).collect();
        let lost = beside_known(&known, lost, &scale);
        self.hidden = known.into_iter().chain(lost).collect();
        let apart = set_apart(self.hidden.clone());
        self.kept = (0..n).filter(|at| apart.iter().all(|(own, _)| own != at)).map(|at| free.indices[at]).collect();
        Ok(())
    }

    /// Scales that nothing shows: parameters of rows without an input that no other row shares show in ratios alone.
    fn scale_free(&mut self, free: &Free) -> Result<(), EstimateError> {
        let lines = self.all_rows(&[])?;
        let noise = Noise::first(&lines, false);
        let n = self.kept.len();
        let factor = triangle(&lines, &noise.variance, &self.kept, self.right());
        let (factor, scale) = unit_columns(factor.view((0, 0), (n, n)).into_owned());
        let null = Singular::new(&factor, RANK).null();
        let lost = null.column_iter().map(|column| column.iter().copied().collect()).collect();
        let (own, lost): (Vec<usize>, Vec<Vec<f64>>) = set_apart(beside_known(&[], lost, &scale)).into_iter().unzip();
        let apart: Vec<usize> = own.into_iter().map(|own| self.kept[own]).collect();
        self.scale_directions = lost.len();
        for direction in lost {
            let place = |j: &usize| self.kept.iter().position(|kept| kept == j);
            let of = |j: &usize| place(j).map_or(0.0, |at| direction[at]);
            self.hidden.push(free.indices.iter().map(of).collect());
        }
        self.kept.retain(|j| !apart.contains(j));
        if self.kept.is_empty() { Err(EstimateError::NoSignal) } else { Ok(()) }
    }

    /// First values: by the lines far above the noise; in rows without an input ratios first, which the other rows give a scale.
    fn start(&mut self, lines: &[RowLines], coefficients: &[Vec<Vec<f64>>]) -> Result<(), EstimateError> {
        let right = self.right();
        let highest: Vec<f64> = self.views.iter().map(|view| view.used).collect();
        let of = |rows: &[RowLines], columns: &[usize], highest: &[f64]| {
            let noise = Noise::first(rows, false);
            noise.found(rows, columns, right, None, Some(highest)).1
        };
        let known = |row: &RowLines| row.size(right) > 0.5 * KNOWN_SHARE * KNOWN_SHARE * row.force();
        let ratios: Vec<usize> = (0..lines.len()).filter(|&row| self.homogeneous(row) && !known(&lines[row])).collect();
        if ratios.is_empty() {
            let values = of(lines, &self.kept, &highest);
            self.kept.iter().for_each(|&j| self.theta[j] = values[j]);
            return Ok(());
        }
        let mut groups: Vec<Vec<f64>> = Vec::new();
        for &row in &ratios {
            groups.extend(
                leading(row, &coefficients[row]).and_then(|c| self.ratios(row, &lines[row], &coefficients[row][c])),
            );
        }
        let grouped = |j: usize| groups.iter().any(|group| group[j] != 0.0);
        let alone: Vec<usize> = self.kept.iter().copied().filter(|&j| !grouped(j)).collect();
        // The rows with inputs in terms of the scales of the groups and of the parameters that stand alone.
        let driven: Vec<usize> = (0..lines.len()).filter(|row| !ratios.contains(row)).collect();
        let condensed: Vec<RowLines> = driven
            .iter()
            .map(|&row| {
                let own = &lines[row];
                let mut columns = alone.clone();
                let mut entries: Vec<DVector<f64>> = alone.iter().map(|&j| own.column(j)).collect();
                for (g, group) in groups.iter().enumerate() {
                    let mut sum = DVector::zeros(2 * own.lines());
                    for (j, ratio) in group.iter().enumerate().filter(|(_, ratio)| **ratio != 0.0) {
                        sum.axpy(*ratio, &own.column(j), 1.0);
                    }
                    columns.push(right + g);
                    entries.push(sum);
                }
                columns.push(right + groups.len());
                entries.push(own.column(right));
                RowLines { columns, entries: DMatrix::from_columns(&entries), ..own.clone() }
            })
            .collect();
        for &j in &self.kept {
            self.theta[j] = 0.0;
        }
        let mut scales = vec![1.0; groups.len()];
        if !condensed.is_empty() {
            let columns: Vec<usize> = alone.iter().copied().chain((0..groups.len()).map(|g| right + g)).collect();
            let own: Vec<f64> = driven.iter().map(|&row| highest[row]).collect();
            let noise = Noise::first(&condensed, false);
            let values = noise.found(&condensed, &columns, right + groups.len(), None, Some(&own)).1;
            alone.iter().for_each(|&j| self.theta[j] = values[j]);
            let shared = |g: usize| condensed.iter().any(|row| row.size(right + g) > 0.0);
            for (g, scale) in scales.iter_mut().enumerate() {
                if shared(g) && values[right + g] != 0.0 {
                    *scale = values[right + g];
                }
            }
        }
        for (group, scale) in groups.iter().zip(&scales) {
            for (j, ratio) in group.iter().enumerate().filter(|(_, ratio)| **ratio != 0.0) {
                self.theta[j] += scale * ratio;
            }
        }
        Ok(())
    }

    /// The ratios that a row without an input shows, such that the mean coefficient of its leading acceleration is one.
    /// `coefficients` are those of that acceleration, one for every parameter.
    fn ratios(&self, row: usize, lines: &RowLines, coefficients: &[f64]) -> Option<Vec<f64>> {
        let present: Vec<usize> = self.kept.iter().copied().filter(|&j| lines.size(j) > 0.0).collect();
        let lead = present.iter().copied().max_by(|&a, &b| coefficients[a].abs().total_cmp(&coefficients[b].abs()));
        let lead = lead.filter(|&lead| coefficients[lead] != 0.0)?;
        let leading = lines.column(lead) / coefficients[lead];
        let others: Vec<usize> = present.iter().copied().filter(|&j| j != lead).collect();
        let mut entries: Vec<DVector<f64>> =
            others.iter().map(|&j| lines.column(j) - &leading * coefficients[j]).collect();
        entries.push(-&leading);
        let right = self.right();
        let mut columns = others.clone();
        columns.push(right);
        let row_of = RowLines { columns, entries: DMatrix::from_columns(&entries), ..lines.clone() };
        let rows = [row_of];
        let values = Noise::first(&rows, false).found(&rows, &others, right, None, Some(&[self.views[row].used])).1;
        let mut ratios = vec![0.0; coefficients.len()];
        others.iter().for_each(|&j| ratios[j] = values[j]);
        ratios[lead] = (1.0 - others.iter().map(|&j| coefficients[j] * values[j]).sum::<f64>()) / coefficients[lead];
        Some(ratios)
    }

    /// Divides the columns of every term by the largest of its root mean squares.
    fn scale_terms(&mut self) {
        self.sizes = (0..self.terms.len())
            .map(|i| {
                let mut sums = vec![(0.0, 0usize); self.rows.model.dims().rows];
                for (row, values) in self.columns.iter().flat_map(|columns| &columns[i]) {
                    sums[*row].0 += values.iter().map(|x| x * x).sum::<f64>();
                    sums[*row].1 += values.len();
                }
                let largest = sums.iter().map(|(sum, count)| sum / (*count).max(1) as f64).fold(0.0, f64::max).sqrt();
                if largest > 0.0 && largest.is_finite() { largest } else { 1.0 }
            })
            .collect();
        for columns in &mut self.columns {
            for (own, size) in columns.iter_mut().zip(&self.sizes) {
                own.iter_mut().flat_map(|(_, values)| values).for_each(|x| *x /= size);
            }
        }
    }

    /// The lines of all rows, with the noise that the sensors add to every line.
    ///
    /// # Errors
    /// As of [`all_rows`](Self::all_rows).
    pub(super) fn above_floors(&self) -> Result<Vec<RowLines>, EstimateError> {
        let h = self.paths.sample_time;
        let mut lines = self.all_rows(&[])?;
        let Some(felt) = &self.felt else { return Ok(lines) };
        for (j, row) in lines.iter_mut().enumerate() {
            let view = self.views[j];
            for (floor, f) in row.floor.iter_mut().zip(&row.frequency) {
                let w = 2.0 * std::f64::consts::PI * f;
                *floor = felt.noise(j, &self.paths.measured, w, h) * view.low_pass.response(w).powi(2);
            }
        }
        Ok(lines)
    }
}

/// The coordinate whose acceleration leads a row, given the coefficients of all of them: the row's own, or the one of the largest.
fn leading(row: usize, coefficients: &[Vec<f64>]) -> Option<usize> {
    let size = |c: usize| coefficients[c].iter().map(|a| a.abs()).fold(0.0, f64::max);
    let own = (row < coefficients.len() && size(row) > 0.0).then_some(row);
    let largest = || (0..coefficients.len()).filter(|&c| size(c) > 0.0).max_by(|&a, &b| size(a).total_cmp(&size(b)));
    own.or_else(largest)
}
