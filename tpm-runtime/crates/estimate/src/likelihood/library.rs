//! Terms that a model may lack, each a column along the smoothed motion.

use crate::likelihood::path::{Along, Columns, Entry, Path};
use crate::time_domain::presliding::built_up;
use std::f64::consts::{PI, SQRT_2};
use tpm_controller::model::{Model, moving};
use tpm_numerics::root_mean_square;

/// Share of the root mean square velocity up to which friction is larger at low speed.
const STRIBECK_VELOCITY: f64 = 0.15;
/// Share of the root mean square force over which a dead zone is rounded, and of the root mean square distance for play.
const DEAD_ZONE: f64 = 0.05;
/// Smallest range of a coordinate, rad or unit of the coordinate, over which sines of the coordinate itself are told from its powers.
const SINE_RANGE: f64 = 0.5;
/// Range of an angle, rad, over which it is asked whether its reading errs once or twice a turn.
const TURN: f64 = 2.0 * PI;
/// Half waves over the range of a coordinate that ripples may have: fewer are powers, more are not followed.
const RIPPLES: std::ops::RangeInclusive<u32> = 5..=30;
/// A column that is made of the recorded force takes no part when it is that force to within this cosine.
const ITSELF: f64 = 0.9;
/// A named term makes at least this share of the force of its row.
pub(super) const LEAST_SHARE: f64 = 0.003;
/// Most coordinates of a machine in which every pair is asked for forces between them; of more, those that the model joins by a force.
const MOST_PAIRED: usize = 3;

/// A term that a model may lack.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum TermKind {
    /// A constant force, or an offset of a sensor or an input.
    Offset,
    /// Dry friction, `sign(v)`.
    Friction,
    /// More friction at low speed than at high speed.
    Stribeck,
    /// Dry friction that builds up again after every reversal, over a travel of one of so many parts of the range of the coordinate. It is asked
    /// where every sample counts: the lines leave the times around reversals out.
    Presliding(u32),
    /// A power of the velocity.
    RatePower(u32),
    /// Drag, `v |v|`.
    Drag,
    /// A power of the position.
    Power(u32),
    /// Dry friction in proportion to a power of the position.
    PositionFriction(u32),
    /// Damping in proportion to a power of the position.
    PositionDamping(u32),
    /// An inertia; with exponent one in proportion to the position.
    Inertia(u32),
    /// A sine of a multiple of the position.
    Sine(u32),
    /// A cosine of a multiple of the position.
    Cosine(u32),
    /// A ripple over the position (cogging), by its half waves over the range of the coordinate.
    Ripple {
        /// Half waves over the range.
        half_waves: u32,
        /// Whether it is a cosine about the middle of the range.
        even: bool,
    },
    /// A constant force that drifts.
    Drift,
    /// Damping that drifts.
    DriftingDamping,
    /// Dry friction that drifts.
    DriftingFriction,
    /// Dry friction in proportion to the force.
    LoadFriction,
    /// A dead zone: a force that opposes the input whatever its size.
    DeadZone,
    /// Play in a spring about zero: a force that is less by a constant, with the sign of the position.
    Play,
    /// An input that acts later than it is recorded; the value is the delay, s.
    Delay,
    /// An input that is a multiple of what is recorded, as one that is recorded in another unit; the value is the factor.
    InputGain,
    /// A coordinate that is by a constant larger than it is recorded, unit of the coordinate.
    PositionOffset,
    /// A power of the distance between two coordinates.
    PairPower(u32),
    /// A force that depends on the relative velocity, in the same way as a term of one coordinate.
    PairDamping,
    /// The size of the relative velocity.
    PairAsymmetry,
    /// Drag between two coordinates.
    PairDrag,
    /// Dry friction between two coordinates.
    PairFriction,
    /// Damping in proportion to the distance.
    PairPositionDamping,
    /// Play in a spring between two coordinates.
    PairPlay,
    /// An inertia that couples two coordinates.
    PairInertia,
    /// An inertia that feels the relative acceleration of two coordinates, as that of a beam which turns when its ends do not move alike.
    RelativeInertia,
    /// A sine of the sum of the angles from one coordinate to another, as gravity of a link on a chain: the derivative of one potential, in the
    /// rows of all of them.
    Chain {
        /// Whether it is a cosine.
        even: bool,
        /// Whether the two angles are counted against each other.
        against: bool,
    },
    /// The product of two coordinates. This kind and the next two are asked of output error alone.
    Product,
    /// A parameter that changes over the record; the term is of the parameter.
    ParameterDrift,
    /// Dynamics between an input and a sensor: a flexible mode, or a lag.
    Flexible,
    /// An error of the reading of an angle that is a sine of a multiple of it, as that of an encoder whose wheel is not centred; the value is its
    /// amplitude.
    Reading {
        /// The multiple.
        multiple: u32,
        /// Whether it is a cosine.
        even: bool,
    },
    /// Play between a coordinate and its sensor; the value is half its width, unit of the coordinate.
    Backlash,
    /// An input that is cut off at a limit behind the place where it is recorded; the value is its largest size, unit of the input.
    Limit,
}

impl TermKind {
    /// Whether it is a force. Others are what a channel does beside what is recorded of it.
    #[must_use]
    pub const fn is_force(self) -> bool {
        !matches!(
            self,
            TermKind::Delay | TermKind::InputGain | TermKind::PositionOffset | TermKind::Backlash | TermKind::Limit
        ) && !self.is_of_reading()
    }

    /// Whether it is an error of a reading over its own value.
    #[must_use]
    pub const fn is_of_reading(self) -> bool {
        matches!(self, TermKind::Reading { .. })
    }

    /// Whether a model that predicts forces can have it: what drifts is another force on another record, and what is made of the recorded force
    /// predicts nothing.
    #[must_use]
    pub const fn predicts(self) -> bool {
        let drifts = matches!(
            self,
            TermKind::Drift | TermKind::DriftingDamping | TermKind::DriftingFriction | TermKind::ParameterDrift
        );
        self.is_force() && !drifts && !matches!(self, TermKind::LoadFriction | TermKind::DeadZone | TermKind::Flexible)
    }

    /// Whether it is asked of a coordinate whose rate alone stands in the rows, as a speed or a temperature: that rate is no velocity, and the
    /// coordinate no position.
    const fn is_of_first_order(self) -> bool {
        let of_state = matches!(
            self,
            TermKind::Offset | TermKind::Power(_) | TermKind::PairPower(_) | TermKind::Play | TermKind::PairPlay
        );
        of_state || matches!(self, TermKind::Drift | TermKind::DeadZone) || !self.is_force()
    }
}

/// A term in its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Term {
    /// What it is.
    pub kind: TermKind,
    /// The row on which it acts; nothing for an input, which acts where it acts.
    pub row: Option<usize>,
    /// The coordinate on which it depends; the input of a term of an input, and the parameter of one that drifts.
    pub of: usize,
    /// The other coordinate of a force between two.
    pub other: Option<usize>,
}

/// Cosine of the angle between two signals.
fn likeness(a: &[f64], b: &[f64]) -> f64 {
    let product: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    let size = |signal: &[f64]| signal.iter().map(|x| x * x).sum::<f64>().sqrt();
    product / (size(a) * size(b)).max(f64::MIN_POSITIVE)
}

/// Deviation of the times within the cell of a grid, in units of the cell.
const CELL: f64 = 0.289;

/// E[sign(v)] where v is known up to a deviation.
fn sign(v: f64, deviation: f64) -> f64 {
    libm::erf(v / (SQRT_2 * deviation.max(f64::MIN_POSITIVE)))
}

/// The sign of a signal of a given root mean square, rounded about zero.
fn rounded_sign(signal: &[f64], size: f64) -> Vec<f64> {
    let width = (DEAD_ZONE * size).max(f64::MIN_POSITIVE);
    signal.iter().map(|x| (x / width).tanh()).collect()
}

/// A force between two coordinates, which acts on both rows with opposite signs.
fn against_each_other((a, b): (usize, usize), values: Vec<f64>) -> Columns {
    let against = values.iter().map(|value| -value).collect();
    vec![(a, values), (b, against)]
}

/// A function of the sum of the angles from one coordinate to another, in the rows of all of them.
fn chain((from, to): (usize, usize), (even, against): (bool, bool), seen: &dyn Seen) -> Columns {
    let sign = |c: usize| if against && c == to { -1.0 } else { 1.0 };
    let mut sum = vec![0.0; seen.points()];
    for c in from..=to {
        sum.iter_mut().zip(seen.series(c, 0)).for_each(|(sum, q)| *sum += sign(c) * q);
    }
    let values: Vec<f64> = sum.into_iter().map(if even { f64::cos } else { f64::sin }).collect();
    (from..=to).map(|c| (c, values.iter().map(|value| sign(c) * value).collect())).collect()
}

/// How the rows of a model depend on the motion.
pub(crate) struct Structure<'a> {
    /// Whether a row has the acceleration of a coordinate.
    pub(crate) coupled: &'a dyn Fn(usize, usize) -> bool,
    /// Whether a row depends on the position of a coordinate.
    pub(crate) by_position: &'a dyn Fn(usize, usize) -> bool,
    /// Whether a row depends on the motion of a coordinate.
    pub(crate) feels: &'a dyn Fn(usize, usize) -> bool,
    /// Whether a parameter makes the acceleration of a coordinate in its own row, and no other.
    pub(crate) has_own_inertia: &'a dyn Fn(usize) -> bool,
}

/// What the terms of all stretches have in common: so that a column means the same in each of them.
#[derive(Clone, Debug)]
pub(crate) struct Scales {
    /// Root mean square velocity, by coordinate.
    speed: Vec<f64>,
    /// Least and largest position.
    range: Vec<(f64, f64)>,
    /// Mean product of the positions of two coordinates.
    products: Vec<Vec<f64>>,
    /// Deviation of the velocity.
    rate_deviation: Vec<f64>,
    /// Root mean square force, by row.
    force: Vec<f64>,
    /// Length of the whole record, s.
    duration: f64,
    /// The rows in which an input acts.
    driven: Vec<bool>,
}

/// A motion along which terms are evaluated, with the inputs that act on it.
pub(crate) trait Seen {
    /// Number of points.
    fn points(&self) -> usize;
    /// Time of a point since the begin of the record, s.
    fn time(&self, point: usize) -> f64;
    /// Time from one point to the next, s.
    fn apart(&self) -> f64;
    /// Derivative `d` of a coordinate at all points.
    fn series(&self, coordinate: usize, d: usize) -> Vec<f64>;
    /// What a row does not owe to parameters, on the other side; nothing where that is nothing.
    fn right(&self, row: usize) -> Option<Vec<f64>>;
    /// Force that the rate of an input would make, were it the input.
    fn rate_of(&self, input: usize) -> Columns;
}

/// A stretch on its grid, which begins at `from` seconds of the record.
pub(super) struct OnGrid<'a> {
    pub(super) path: &'a Path,
    pub(super) along: &'a Along,
    pub(super) from: f64,
}

impl Seen for OnGrid<'_> {
    fn points(&self) -> usize {
        self.path.points
    }

    fn time(&self, point: usize) -> f64 {
        self.from + point as f64 * self.path.apart
    }

    fn apart(&self) -> f64 {
        self.path.apart
    }

    fn series(&self, coordinate: usize, d: usize) -> Vec<f64> {
        self.path.series(coordinate, d)
    }

    fn right(&self, row: usize) -> Option<Vec<f64>> {
        Some(self.along.column(self.along.place(row, Entry::Right)?))
    }

    fn rate_of(&self, input: usize) -> Columns {
        let entries = self.along.entries.iter().enumerate().filter(|(_, (_, entry))| *entry == Entry::Rate(input));
        entries.map(|(at, (row, _))| (*row, self.along.column(at))).collect()
    }
}

impl Scales {
    /// The scales of a record of so many coordinates and inputs, whose stretches are given, with the deviation of every rate; `driven` says in
    /// which rows an input acts.
    pub(crate) fn of(
        (coordinates, driven): (usize, Vec<bool>),
        stretches: &[&dyn Seen],
        rate_deviation: Vec<f64>,
    ) -> Self {
        let series = |c: usize, d: usize| stretches.iter().flat_map(move |own| own.series(c, d));
        let right = |row: usize| root_mean_square(stretches.iter().filter_map(|own| own.right(row)).flatten());
        let range = |c: usize| {
            series(c, 0).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(q), high.max(q)))
        };
        let points: usize = stretches.iter().map(|own| own.points()).sum();
        let positions: Vec<Vec<f64>> = (0..coordinates).map(|c| series(c, 0).collect()).collect();
        let product =
            |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>() / points.max(1) as f64;
        Scales {
            speed: (0..coordinates).map(|c| root_mean_square(series(c, 1))).collect(),
            range: (0..coordinates).map(range).collect(),
            products: positions.iter().map(|a| positions.iter().map(|b| product((a, b))).collect()).collect(),
            rate_deviation,
            force: (0..driven.len()).map(right).collect(),
            duration: stretches.iter().map(|own| own.points() as f64 * own.apart()).sum(),
            driven,
        }
    }

    /// About how far noise of the sensors puts a column off, as a share of it. Columns of offsets, gains and delays are made of first values and
    /// of inputs, and count as exact; for inertias the error is not computed, and they count as wholly uncertain.
    pub(super) fn relative_error(&self, term: Term) -> f64 {
        let of = |c: usize| self.rate_deviation[c] / self.speed[c].max(f64::MIN_POSITIVE);
        match term.kind {
            TermKind::PositionOffset | TermKind::InputGain | TermKind::Delay => 0.0,
            TermKind::Inertia(_) | TermKind::PairInertia | TermKind::RelativeInertia => 1.0,
            _ => of(term.of).max(term.other.map_or(0.0, of)),
        }
    }

    /// The numbers in the column of a term: the rate at which Stribeck friction has fallen to 1/e, the travel over which friction builds up, the
    /// width over which play is rounded, the wave number of a ripple and the middle of its range; none of other terms.
    pub(super) fn constants(&self, term: Term) -> Vec<f64> {
        let c = term.of;
        let apart = |other: usize| self.products[c][c] + self.products[other][other] - 2.0 * self.products[c][other];
        match (term.kind, term.other) {
            (TermKind::Stribeck, _) => vec![STRIBECK_VELOCITY * self.speed[c]],
            (TermKind::Presliding(parts), _) => vec![self.travel(c, parts)],
            (TermKind::Play, _) => vec![DEAD_ZONE * self.products[c][c].sqrt()],
            (TermKind::PairPlay, Some(other)) => vec![DEAD_ZONE * apart(other).max(0.0).sqrt()],
            (TermKind::Ripple { half_waves, .. }, _) => self.wave(c, half_waves).into(),
            _ => Vec::new(),
        }
    }

    /// Wave number of a ripple over the range of a coordinate, and the middle of this range.
    fn wave(&self, coordinate: usize, half_waves: u32) -> [f64; 2] {
        let (low, high) = self.range[coordinate];
        [PI * f64::from(half_waves) / (high - low).max(f64::MIN_POSITIVE), 0.5 * (low + high)]
    }

    /// The travel over which friction builds up.
    fn travel(&self, coordinate: usize, parts: u32) -> f64 {
        self.span(coordinate).max(f64::MIN_POSITIVE) / f64::from(parts)
    }

    /// The range of a coordinate, its unit.
    pub(crate) fn span(&self, coordinate: usize) -> f64 {
        let (low, high) = self.range[coordinate];
        high - low
    }

    /// Root mean square force of a row.
    pub(crate) fn force(&self, row: usize) -> f64 {
        self.force[row]
    }

    /// Whether an input acts in a row.
    pub(crate) fn driven(&self, row: usize) -> bool {
        self.driven[row]
    }

    /// The column of a term along a motion.
    pub(crate) fn columns(&self, term: Term, seen: &dyn Seen) -> Columns {
        let series = |c: usize, d: usize| seen.series(c, d);
        if term.kind == TermKind::Delay {
            return seen.rate_of(term.of);
        }
        let row = term.row.unwrap_or(term.of);
        if let Some(other) = term.other {
            return match term.kind {
                TermKind::Chain { even, against } => chain((term.of, other), (even, against), seen),
                kind => self.between(kind, (term.of, other), seen),
            };
        }
        let c = term.of;
        let (q, v) = (series(c, 0), series(c, 1));
        let a = series(c, 2);
        let deviation = |k: usize| self.rate_deviation[c].hypot(CELL * seen.apart() * a[k]);
        let time = |k: usize| seen.time(k) / self.duration - 0.5;
        let right = || seen.right(row).unwrap_or_default();
        let by = |of: &dyn Fn(usize) -> f64| -> Vec<f64> { (0..seen.points()).map(of).collect() };
        let values = match term.kind {
            TermKind::Offset => vec![1.0; seen.points()],
            TermKind::Friction => by(&|k| sign(v[k], deviation(k))),
            TermKind::Stribeck => {
                let bend = STRIBECK_VELOCITY * self.speed[c];
                by(&|k| sign(v[k], deviation(k)) * (-(v[k] / bend).powi(2)).exp())
            }
            TermKind::Presliding(parts) => built_up(&q, self.travel(c, parts), 0.0),
            TermKind::RatePower(n) => by(&|k| v[k].powi(n as i32)),
            TermKind::Drag => by(&|k| v[k] * v[k].abs()),
            TermKind::Power(n) => by(&|k| q[k].powi(n as i32)),
            TermKind::PositionFriction(n) => by(&|k| q[k].powi(n as i32) * sign(v[k], deviation(k))),
            TermKind::PositionDamping(n) => by(&|k| q[k].powi(n as i32) * v[k]),
            TermKind::Inertia(n) => by(&|k| q[k].powi(n as i32) * a[k]),
            TermKind::Sine(n) => by(&|k| (f64::from(n) * q[k]).sin()),
            TermKind::Cosine(n) => by(&|k| (f64::from(n) * q[k]).cos()),
            TermKind::Ripple { half_waves, even } => {
                let [wave, middle] = self.wave(c, half_waves);
                by(&|k| {
                    let angle = wave * (q[k] - middle);
                    if even { angle.cos() } else { angle.sin() }
                })
            }
            // The acceleration that the error of the reading adds, which no force makes.
            TermKind::Reading { multiple, even } => {
                let n = f64::from(multiple);
                by(&|k| {
                    let (s, c) = (n * q[k]).sin_cos();
                    let (error, slope) = if even { (c, -s) } else { (s, c) };
                    n * slope * a[k] - n * n * error * v[k] * v[k]
                })
            }
            TermKind::Drift => by(&time),
            TermKind::DriftingDamping => by(&|k| time(k) * v[k]),
            TermKind::DriftingFriction => by(&|k| time(k) * sign(v[k], deviation(k))),
            TermKind::LoadFriction => {
                let force = right();
                let values = self.rubbing(c, seen, &force);
                // A force that has the sign of the velocity throughout is this column itself, which explains nothing.
                if likeness(&values, &force).abs() > ITSELF { Vec::new() } else { values }
            }
            TermKind::DeadZone => rounded_sign(&right(), self.force[row]),
            TermKind::Play => rounded_sign(&q, self.products[c][c].sqrt()),
            _ => vec![0.0; seen.points()],
        };
        if values.is_empty() { Vec::new() } else { vec![(row, values)] }
    }

    /// Dry friction of a coordinate in proportion to a force.
    fn rubbing(&self, coordinate: usize, seen: &dyn Seen, force: &[f64]) -> Vec<f64> {
        let (v, a) = (seen.series(coordinate, 1), seen.series(coordinate, 2));
        let deviation = |k: usize| self.rate_deviation[coordinate].hypot(CELL * seen.apart() * a[k]);
        (0..seen.points()).map(|k| force[k].abs() * sign(v[k], deviation(k))).collect()
    }

    /// Dry friction in proportion to the load that some parameters make with these values. The recorded force would explain itself.
    pub(super) fn load_friction(&self, term: Term, seen: &OnGrid<'_>, (load, values): (&[usize], &[f64])) -> Columns {
        let row = term.row.unwrap_or(term.of);
        let mut force = vec![0.0; seen.points()];
        for (j, column) in seen.along.parameters(row).iter().filter(|(j, _)| load.contains(j)) {
            force.iter_mut().zip(column).for_each(|(sum, x)| *sum += values[*j] * x);
        }
        vec![(row, self.rubbing(term.of, seen, &force))]
    }

    /// A force between two coordinates acts on both rows, with opposite signs; an inertia that couples them on each by the other's
    /// acceleration.
    fn between(&self, kind: TermKind, (a, b): (usize, usize), seen: &dyn Seen) -> Columns {
        let series = |c: usize, d: usize| seen.series(c, d);
        if kind == TermKind::PairInertia {
            return vec![(a, series(b, 2)), (b, series(a, 2))];
        }
        let apart = |d: usize| -> Vec<f64> { series(a, d).iter().zip(series(b, d)).map(|(x, y)| x - y).collect() };
        let (r, w) = (apart(0), apart(1));
        let acceleration = apart(2);
        let own = self.rate_deviation[a].hypot(self.rate_deviation[b]);
        let deviation = |k: usize| own.hypot(CELL * seen.apart() * acceleration[k]);
        if kind == TermKind::PairPlay {
            let size = (self.products[a][a] + self.products[b][b] - 2.0 * self.products[a][b]).max(0.0).sqrt();
            return against_each_other((a, b), rounded_sign(&r, size));
        }
        let of = |k: usize| match kind {
            TermKind::PairPower(n) => r[k].powi(n as i32),
            TermKind::RelativeInertia => acceleration[k],
            TermKind::PairDamping => w[k],
            TermKind::PairAsymmetry => w[k] * sign(w[k], deviation(k)),
            TermKind::PairDrag => w[k] * w[k].abs(),
            TermKind::PairFriction => sign(w[k], deviation(k)),
            TermKind::PairPositionDamping => r[k] * w[k],
            _ => 0.0,
        };
        against_each_other((a, b), (0..seen.points()).map(of).collect())
    }

    /// The terms that are asked for.
    pub(crate) fn terms(&self, model: &dyn Model<f64>, structure: &Structure<'_>) -> Vec<Term> {
        let Structure { coupled, feels, has_own_inertia, by_position } = structure;
        let dims = model.dims();
        let mut terms = Vec::new();
        // Coordinates that follow from others stand behind those that move on their own, and no force depends on them but by the model.
        let coordinates = moving(model);
        for row in 0..dims.rows {
            let c = row.min(coordinates.saturating_sub(1));
            let mut add = |kind: TermKind| terms.push(Term { kind, row: Some(row), of: c, other: None });
            let driven = self.driven(row);
            let (low, high) = self.range[c];
            for kind in [TermKind::Offset, TermKind::Friction, TermKind::Stribeck, TermKind::Drag, TermKind::Inertia(0)]
            {
                add(kind);
            }
            for exponent in 1..=3 {
                add(TermKind::RatePower(exponent));
                add(TermKind::Power(exponent));
            }
            for exponent in 1..=2 {
                add(TermKind::PositionFriction(exponent));
                add(TermKind::PositionDamping(exponent));
            }
            add(TermKind::Inertia(1));
            add(TermKind::Play);
            if high - low > SINE_RANGE {
                for multiple in 1..=2 {
                    add(TermKind::Sine(multiple));
                    add(TermKind::Cosine(multiple));
                }
            }
            for kind in [TermKind::Drift, TermKind::DriftingDamping, TermKind::DriftingFriction] {
                add(kind);
            }
            let is_angle = model.coordinate(c).unit.is_none_or(|unit| unit == "rad");
            if is_angle && high - low > TURN && coupled(row, c) {
                for multiple in 1..=2 {
                    add(TermKind::Reading { multiple, even: false });
                    add(TermKind::Reading { multiple, even: true });
                }
            }
            if driven {
                add(TermKind::LoadFriction);
                add(TermKind::DeadZone);
            }
            if coordinates == 1 {
                for half_waves in RIPPLES {
                    add(TermKind::Ripple { half_waves, even: false });
                    add(TermKind::Ripple { half_waves, even: true });
                }
            }
        }
        let mut add = |kind: TermKind, input: usize| terms.push(Term { kind, row: None, of: input, other: None });
        for input in 0..dims.inputs {
            add(TermKind::Delay, input);
            // The gain of a single input is that of all parameters.
            if dims.inputs > 1 {
                add(TermKind::InputGain, input);
            }
        }
        // Of one coordinate such an offset is one of the terms above.
        if coordinates > 1 {
            terms.extend((0..coordinates).map(|c| Term {
                kind: TermKind::PositionOffset,
                row: None,
                of: c,
                other: None,
            }));
        }
        // Forces between coordinates that are measured in one unit: a distance means nothing between an angle and a length.
        let alike = |a: usize, b: usize| model.coordinate(a).unit == model.coordinate(b).unit;
        let inertial = |a: usize, b: usize| coupled(a, b) || coupled(b, a);
        let joined = |a: usize, b: usize| (feels(a, b) || feels(b, a)) && !inertial(a, b);
        let asked = |a: usize, b: usize| alike(a, b) && (coordinates <= MOST_PAIRED || joined(a, b));
        if dims.rows == coordinates {
            for a in 0..coordinates {
                for b in (a + 1..coordinates).filter(|&b| asked(a, b)) {
                    let mut add = |kind: TermKind| terms.push(Term { kind, row: None, of: a, other: Some(b) });
                    for exponent in 1..=3 {
                        add(TermKind::PairPower(exponent));
                    }
                    for kind in [
                        TermKind::PairDamping,
                        TermKind::PairAsymmetry,
                        TermKind::PairDrag,
                        TermKind::PairFriction,
                        TermKind::PairPositionDamping,
                        TermKind::PairPlay,
                    ] {
                        add(kind);
                    }
                    // Where the model couples the two accelerations itself, a missing coupling is told from the parameters only when
                    // either coordinate has an inertia of its own among them.
                    if !inertial(a, b) {
                        add(TermKind::PairInertia);
                    } else if has_own_inertia(a) && has_own_inertia(b) {
                        add(TermKind::RelativeInertia);
                    }
                }
            }
            terms.extend(self.chains(model, coordinates, by_position));
        }
        let order = |c: usize| model.coordinate_order(c.min(coordinates.saturating_sub(1)));
        terms.retain(|term| term.kind.is_of_first_order() || order(term.of) != 1);
        terms
    }

    /// Forces of links on chains of few joints: sines of sums of successive angles, and of the difference of two. They are asked where the row of
    /// the last joint does not depend on the position of the first, so that the model has no such force.
    fn chains(
        &self,
        model: &dyn Model<f64>,
        coordinates: usize,
        by_position: &dyn Fn(usize, usize) -> bool,
    ) -> Vec<Term> {
        let is_angle = |c: usize| model.coordinate(c).unit.is_none_or(|unit| unit == "rad");
        if coordinates > MOST_PAIRED {
            return Vec::new();
        }
        let pairs = (0..coordinates).flat_map(|a| (a + 1..coordinates).map(move |b| (a, b)));
        let turns = |a: usize, b: usize| (a..=b).map(|c| self.span(c)).fold(0.0, f64::max) > SINE_RANGE;
        let of_angles = pairs.filter(|&(a, b)| (a..=b).all(is_angle) && turns(a, b) && !by_position(b, a));
        let both = of_angles.flat_map(|(a, b)| [false, true].map(|against| (a, b, against)));
        both.filter(|(a, b, against)| !against || b - a == 1)
            .flat_map(|(of, other, against)| {
                [false, true].map(|even| Term {
                    kind: TermKind::Chain { even, against },
                    row: None,
                    of,
                    other: Some(other),
                })
            })
            .collect()
    }
}
