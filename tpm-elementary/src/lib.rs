//! Elementary functions of a program, the same to the last bit on every platform.
//!
//! `f64::sin` and its like call the function of that name in the C library of the platform. All of them are right to about half a unit in the
//! last place; no two agree on which values they round the other way, and an optimum that is found by them differs in its last digits. A
//! program that links this crate, by `use tpm_elementary as _;`, has these functions from the crate libm instead: in its own code, in the
//! libraries it is built from, and in theirs. What is computed by additions, products, quotients and roots alone is the same everywhere by
//! IEEE 754.
//!
//! Invariant: the names are those of C99, and each function is that of libm. It is for programs: a library that linked it would decide for
//! whoever uses it. A shared library in the place of a program, such as the Python module, has to be linked without exporting these names
//! (`--exclude-libs,ALL` for ELF): exported, its own calls would go to the C library, which was loaded before it.
#![allow(unsafe_code, reason = "the point is to stand in the place of the platform's functions, by their names")]

macro_rules! of_one {
    ($($name:ident),*) => {
        $(
            #[doc = concat!("`", stringify!($name), "` of C.")]
            #[unsafe(no_mangle)]
            pub extern "C" fn $name(x: f64) -> f64 {
                libm::$name(x)
            }
        )*
    };
}

macro_rules! of_two {
    ($($name:ident),*) => {
        $(
            #[doc = concat!("`", stringify!($name), "` of C.")]
            #[unsafe(no_mangle)]
            pub extern "C" fn $name(x: f64, y: f64) -> f64 {
                libm::$name(x, y)
            }
        )*
    };
}

of_one!(acos, asin, atan, cbrt, cos, cosh, exp, exp2, expm1, log, log10, log1p, log2, sin, sinh, tan, tanh);
of_two!(atan2, hypot, pow);

/// `hypotf` of C, by which figures are drawn.
#[unsafe(no_mangle)]
pub extern "C" fn hypotf(x: f32, y: f32) -> f32 {
    libm::hypotf(x, y)
}

/// `sincos` of the GNU C library, which compilers call where both are asked for.
///
/// # Safety
/// Both pointers are valid for writing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sincos(x: f64, sine: *mut f64, cosine: *mut f64) {
    // SAFETY: that is what the caller promises.
    unsafe {
        *sine = libm::sin(x);
        *cosine = libm::cos(x);
    }
}

#[cfg(test)]
mod tests {
    use std::hint::black_box;

    #[test]
    fn the_standard_library_calls_these_functions() {
        for n in 1..20_000 {
            let x = black_box(f64::from(n) * 1.234_567_89e-3);
            let (sine, cosine) = x.sin_cos();
            assert_eq!([sine, cosine].map(f64::to_bits), [libm::sin(x), libm::cos(x)].map(f64::to_bits), "{x}");
            let found = [
                x.sin(),
                x.exp(),
                x.ln(),
                x.tan(),
                x.atan(),
                x.tanh(),
                x.cbrt(),
                x.powf(1.7),
                x.hypot(2.0),
                x.atan2(3.0),
            ];
            let known = [
                libm::sin(x),
                libm::exp(x),
                libm::log(x),
                libm::tan(x),
                libm::atan(x),
                libm::tanh(x),
                libm::cbrt(x),
                libm::pow(x, 1.7),
                libm::hypot(x, 2.0),
                libm::atan2(x, 3.0),
            ];
            assert_eq!((x as f32).hypot(2.0).to_bits(), libm::hypotf(x as f32, 2.0).to_bits(), "{x}");
            assert_eq!(found.map(f64::to_bits), known.map(f64::to_bits), "{x}");
        }
    }
}
