//! A low pass without phase that reaches over a short time.
//!
//! Its impulse response is `sin(w t)/(pi t) exp(-(s t)^2 / 2)`, that of an ideal low pass at w, cut off by a bell; its frequency
//! response is a step at w that a bell of width s rounds. Frequencies below `w - 4 s` pass within 3e-5, those above `w + 4 s` are left
//! with as little.

/// Width of the bell as a share of the cut-off.
const BELL_WIDTH: f64 = 0.2;
/// Widths from the cut-off beyond which nothing passes: a share below 4e-7.
const STOP_WIDTHS: f64 = 5.0;
/// Widths of the impulse response's bell within which it counts: beyond, less than 1e-4 of it is left.
const IMPULSE_WIDTHS: f64 = 4.5;

/// A low pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LowPass {
    /// Angular frequency at which half of a wave passes, rad/s.
    pub(crate) cut_off: f64,
}

impl LowPass {
    /// Share of a wave that passes, given its angular frequency (rad/s).
    pub(crate) fn response(self, frequency: f64) -> f64 {
        let width = BELL_WIDTH * self.cut_off;
        let below = (self.cut_off - frequency) / width;
        if below < -STOP_WIDTHS { 0.0 } else { 0.5 * libm::erfc(-below / 2.0_f64.sqrt()) }
    }

    /// Angular frequency above which nothing passes, rad/s.
    pub(crate) fn stop(self) -> f64 {
        self.cut_off * (1.0 + STOP_WIDTHS * BELL_WIDTH)
    }

    /// Time over which it reaches to either side, s.
    pub(crate) fn reach(self) -> f64 {
        IMPULSE_WIDTHS / (BELL_WIDTH * self.cut_off)
    }
}

#[cfg(test)]
mod tests {
    use super::LowPass;

    #[test]
    fn half_passes_at_the_cut_off_and_nothing_far_above() {
        let low_pass = LowPass { cut_off: 10.0 };
        assert!((low_pass.response(10.0) - 0.5).abs() < 1e-15);
        assert!(low_pass.response(2.0) > 1.0 - 4e-5);
        assert!(low_pass.response(low_pass.stop()) < 1e-6);
    }
}
