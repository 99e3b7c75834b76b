//! Signals as they are written.

/// Signals with the stamps that they share.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// What they are: the topic, in formats that hold several tracks.
    pub name: String,
    /// Stamps, s, in the order of the record.
    pub time: Vec<f64>,
    /// Names with units (`q [deg]`), and readings, as many as there are stamps; not a number where one is missing.
    pub signals: Vec<(String, Vec<f64>)>,
}
