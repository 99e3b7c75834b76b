//! What a figure shows, as data.

/// Spacing of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Spacing {
    /// Even.
    #[default]
    Linear,
    /// Even, of numbers that count something: ticks stand at whole numbers only.
    Whole,
    /// Even, of angles in degrees: ticks stand at 45 and 90 rather than at 50 and 100.
    Degrees,
    /// By decades.
    Logarithmic,
}

/// One axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// Spacing.
    pub spacing: Spacing,
    /// First and last value; those of the data when not given.
    pub range: Option<(f64, f64)>,
}

impl Axis {
    /// An evenly spaced axis over the data.
    #[must_use]
    pub fn linear(label: &str) -> Self {
        Axis { label: label.into(), spacing: Spacing::Linear, range: None }
    }

    /// An evenly spaced axis of whole numbers.
    #[must_use]
    pub fn whole(label: &str) -> Self {
        Axis { spacing: Spacing::Whole, ..Axis::linear(label) }
    }

    /// An evenly spaced axis of angles in degrees.
    #[must_use]
    pub fn degrees(label: &str) -> Self {
        Axis { spacing: Spacing::Degrees, ..Axis::linear(label) }
    }

    /// An axis by decades over the data.
    #[must_use]
    pub fn logarithmic(label: &str) -> Self {
        Axis { label: label.into(), spacing: Spacing::Logarithmic, range: None }
    }

    /// The axis from `first` to `last`, whatever the data.
    #[must_use]
    pub fn from_to(mut self, first: f64, last: f64) -> Self {
        self.range = Some((first, last));
        self
    }
}

/// Points and how they are drawn.
#[derive(Clone, Debug, PartialEq)]
pub enum Curve {
    /// A line through the points (x, y).
    Line(Vec<(f64, f64)>),
    /// A dashed line.
    Dashed(Vec<(f64, f64)>),
    /// Single points.
    Points(Vec<(f64, f64)>),
    /// The area between two curves: (x, lower, upper).
    Band(Vec<(f64, f64, f64)>),
}

#[cfg(feature = "svg")]
impl Curve {
    /// All points; both edges of a band.
    pub(super) fn points(&self) -> Vec<(f64, f64)> {
        match self {
            Curve::Line(points) | Curve::Dashed(points) | Curve::Points(points) => points.clone(),
            Curve::Band(band) => band.iter().flat_map(|&(x, low, high)| [(x, low), (x, high)]).collect(),
        }
    }
}

/// A curve with its name and colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Name in the legend; none when empty.
    pub name: String,
    /// Number of the colour; curves that belong together share one.
    pub colour: usize,
    /// The curve.
    pub curve: Curve,
}

impl Trace {
    /// A named curve.
    #[must_use]
    pub fn new(name: &str, colour: usize, curve: Curve) -> Self {
        Trace { name: name.into(), colour, curve }
    }
}

/// One pair of axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Abscissa.
    pub x: Axis,
    /// Ordinate.
    pub y: Axis,
    /// Drawn in order, later ones above.
    pub traces: Vec<Trace>,
}

/// Panels above each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Title above all.
    pub title: String,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// From top to bottom, of equal heights.
    pub panels: Vec<Panel>,
}

impl Figure {
    /// A figure of ordinary size.
    #[must_use]
    pub fn new(title: &str, panels: Vec<Panel>) -> Self {
        let height = 60 + 380 * panels.len() as u32;
        Figure { title: title.into(), width: 960, height, panels }
    }
}
