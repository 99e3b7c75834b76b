//! Workloads by name.

use crate::chain::chain;
use crate::workloads::{Workload, closed_loop_arm, mass_spring_drag, monomials, serial_arm, two_carts};

/// The workload of a name such as `w1` or `w4:32`; `None` for an unknown name.
#[must_use]
pub fn by_name(name: &str) -> Option<Workload> {
    let (kind, size) = name.split_once(':').unwrap_or((name, ""));
    match (kind, size.parse::<u32>()) {
        ("w1", _) => Some(mass_spring_drag()),
        ("w2", _) => Some(two_carts()),
        ("w3", _) => Some(closed_loop_arm()),
        ("w4", Ok(degree)) => Some(monomials(degree)),
        ("w5b", Ok(carts @ 2..)) => Some(chain(carts)),
        ("w6", Ok(order)) => Some(serial_arm(order)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::by_name;
    use crate::chain::Cube;
    use crate::workloads::listing;
    use tpm_symbolic::number::rational::integer;

    #[test]
    fn workloads_have_the_expected_tables() {
        let table = |name: &str| by_name(name).expect("known").expand();
        assert_eq!(listing(&table("w1"))[0], "u k2 cos 0 5/9 lambda^2 w^2");
        assert_eq!(table("w2").len(), 41);
        assert_eq!(table("w4:4").len(), 69);
        assert!(listing(&table("w3")).contains(&"tau1 a12 cos 9 1/54 lambda1^1 lambda2^2 w^2".to_owned()));
        assert!(!table("w6:4").is_empty());
        for name in ["w1", "w2", "w3", "w4:4", "w6:2"] {
            let workload = by_name(name).expect("known");
            assert_eq!(workload.derive().map(|table| listing(&table)), Some(listing(&workload.expand())), "{name}");
        }
        // The chain of two carts is W2, derived; its names come in the order of Feng, Eqn 4.34.
        assert_eq!(listing(&table("w5b:2")), listing(&table("w2")));
        assert!(by_name("w9").is_none());
    }

    #[test]
    fn cube_of_the_first_cart() {
        // (x + m2/g1 x'')^3.
        let mut lines = Cube::new(2).listing();
        lines.sort();
        let expected =
            ["1 g1^-3 k2^1 m2^3 x2^3", "1 k2^1 x0^3", "3 g1^-1 k2^1 m2^1 x0^2 x2^1", "3 g1^-2 k2^1 m2^2 x0^1 x2^2"];
        assert_eq!(lines, expected);
        // At 1 for every symbol x1 is a Fibonacci number of carts: 1, 2, 5, 13, 34.
        for (carts, first) in [(2, 2), (3, 5), (4, 13), (5, 34)] {
            let value = Cube::new(carts).expand().evaluate(|_| integer(1));
            assert_eq!(value, Some(integer(first * first * first)), "{carts} carts");
        }
    }
}
