//! A record linearised about a motion, from each instant at which something was read to the next.

/// One reading, linearised.
#[derive(Clone, Copy, Debug)]
pub(super) struct Read {
    pub(super) sensor: usize,
    /// State that is read.
    pub(super) state: usize,
    /// Reading less what the motion says of it.
    pub(super) error: f64,
    /// Variance that the sensor states.
    pub(super) variance: f64,
}

/// A record linearised about states x_k and columns: the parameters that are estimated, then whatever else may act on the machine.
///
/// ```text
/// d_{k+1} = A_k d_k + C_k t + G_k w_k + f_k ,     y - x = d + H t + v
/// ```
///
/// Behind the columns the forcings have a unit force of every row, and half the jump of every switch of the model.
#[derive(Clone, Debug, Default)]
pub(super) struct Chain {
    /// Number of states.
    pub(super) order: usize,
    /// Number of columns.
    pub(super) columns: usize,
    /// Number of rows of the model.
    pub(super) rows: usize,
    /// Number of switches.
    pub(super) switches: usize,
    /// Time of every instant, s.
    pub(super) time: Vec<f64>,
    /// Whether the motion at an instant does not follow from that at the one before.
    pub(super) begins: Vec<bool>,
    /// `d x_{k+1} / d x_k`, per transition, row-major.
    pub(super) transition: Vec<f64>,
    /// `d x_{k+1} / d(forcing)`, per transition, row-major.
    pub(super) forcing: Vec<f64>,
    /// The model's next state less x_{k+1}, per transition.
    pub(super) defect: Vec<f64>,
    /// Standard deviation of every switch's force as a multiple of half its jump, per transition.
    pub(super) loose: Vec<f64>,
    /// The readings, and where those of every instant begin.
    pub(super) reads: Vec<Read>,
    pub(super) first_read: Vec<usize>,
    /// What the columns add to every reading; empty where they add nothing.
    pub(super) read_columns: Vec<f64>,
    /// Variance of every state at the begin of a block, about which nothing is known.
    pub(super) unknown: Vec<f64>,
}

impl Chain {
    pub(super) const fn width(&self) -> usize {
        self.columns + self.rows + self.switches
    }

    pub(super) fn instants(&self) -> usize {
        self.time.len()
    }

    /// What a forcing adds to the states in the transition after instant k, state by state.
    pub(super) fn forced(&self, k: usize, forcing: usize) -> impl Iterator<Item = f64> + '_ {
        let width = self.width();
        let from = k * self.order * width;
        self.forcing[from..from + self.order * width].iter().skip(forcing).step_by(width).copied()
    }

    pub(super) fn transition(&self, k: usize) -> &[f64] {
        &self.transition[k * self.order * self.order..(k + 1) * self.order * self.order]
    }

    pub(super) fn defect(&self, k: usize) -> &[f64] {
        &self.defect[k * self.order..(k + 1) * self.order]
    }

    /// The readings at an instant, with their numbers.
    pub(super) fn reads_at(&self, k: usize) -> impl Iterator<Item = (usize, &Read)> {
        let range = self.first_read[k]..self.first_read[k + 1];
        range.clone().zip(&self.reads[range])
    }

    /// So many blocks of instants, evenly spread, of so many together; the whole where it has no more.
    pub(super) fn blocks(&self, count: usize, together: usize) -> Option<Self> {
        let (instants, each) = (self.instants(), together / count);
        if instants <= together {
            return None;
        }
        let (n, width, switches) = (self.order, self.width(), self.switches);
        let mut part = Chain {
            order: n,
            columns: self.columns,
            rows: self.rows,
            switches,
            unknown: self.unknown.clone(),
            ..Chain::default()
        };
        for block in 0..count {
            let from = block * (instants - each) / (count - 1).max(1);
            for k in from..from + each {
                part.time.push(self.time[k]);
                part.begins.push(self.begins[k] || k == from);
                part.first_read.push(part.reads.len());
                for (number, read) in self.reads_at(k) {
                    part.reads.push(*read);
                    let own = number * self.columns..(number + 1) * self.columns;
                    part.read_columns.extend(self.read_columns.get(own).into_iter().flatten());
                }
                // The transition from a block to the next one is passed over, and stands for itself.
                let at = k.min(instants - 2);
                part.transition.extend_from_slice(&self.transition[at * n * n..(at + 1) * n * n]);
                part.forcing.extend_from_slice(&self.forcing[at * n * width..(at + 1) * n * width]);
                part.defect.extend_from_slice(&self.defect[at * n..(at + 1) * n]);
                part.loose.extend_from_slice(&self.loose[at * switches..(at + 1) * switches]);
            }
        }
        part.first_read.push(part.reads.len());
        Some(part)
    }

    /// What a column adds to a reading.
    pub(super) fn read_column(&self, read: usize, column: usize) -> f64 {
        self.read_columns.get(read * self.columns + column).copied().unwrap_or(0.0)
    }
}
