//! Phasors: the amplitude and phase of a line, and the arithmetic of complex numbers that they need.

use super::Real;
use core::ops::{Add, AddAssign, Mul, Sub, SubAssign};

/// The complex number `re + j im`. As a line of a signal it stands for `re cos - im sin`: the phasor `a_c - j a_s` for `a_c cos + a_s sin`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Phasor<T> {
    /// Real part.
    pub re: T,
    /// Imaginary part.
    pub im: T,
}

impl<T: Real> Phasor<T> {
    /// Zero.
    #[must_use]
    pub fn zero() -> Self {
        Self { re: T::ZERO, im: T::ZERO }
    }

    /// `re + j im`.
    #[must_use]
    pub fn new(re: T, im: T) -> Self {
        Self { re, im }
    }

    /// `e^{j angle}`, the angle in radians.
    #[must_use]
    pub fn turn(angle: T) -> Self {
        Self { re: angle.cos(), im: angle.sin() }
    }

    /// `(j w)^order`: what a derivative makes of a line of angular frequency w.
    #[must_use]
    pub fn derivative(w: T, order: u32) -> Self {
        let mut size = T::ONE;
        for _ in 0..order {
            size *= w;
        }
        if order.is_multiple_of(4) {
            return Self::new(size, T::ZERO);
        }
        if order % 4 == 1 {
            return Self::new(T::ZERO, size);
        }
        if order % 4 == 2 {
            return Self::new(-size, T::ZERO);
        }
        Self::new(T::ZERO, -size)
    }

    /// The complex conjugate.
    #[must_use]
    pub fn conj(self) -> Self {
        Self { re: self.re, im: -self.im }
    }

    /// The square of the absolute value.
    #[must_use]
    pub fn square(self) -> T {
        self.re * self.re + self.im * self.im
    }

    /// This number times a real one.
    #[must_use]
    pub fn times(self, factor: T) -> Self {
        Self { re: self.re * factor, im: self.im * factor }
    }

    /// Whether both parts are finite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.re.is_finite() && self.im.is_finite()
    }
}

impl<T: Real> Add for Phasor<T> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { re: self.re + other.re, im: self.im + other.im }
    }
}

impl<T: Real> Sub for Phasor<T> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { re: self.re - other.re, im: self.im - other.im }
    }
}

impl<T: Real> Mul for Phasor<T> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self { re: self.re * other.re - self.im * other.im, im: self.re * other.im + self.im * other.re }
    }
}

impl<T: Real> AddAssign for Phasor<T> {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<T: Real> SubAssign for Phasor<T> {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}
