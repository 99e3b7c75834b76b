//! What the map from lumped to physical parameters shows.

use std::fmt;

/// What there is to say of physical parameters that were found behind lumped ones.
#[derive(Clone, Debug, PartialEq)]
pub enum PhysicalRemark {
    /// The lumped parameters do not determine a physical one.
    NotDetermined {
        /// The physical parameter.
        parameter: String,
    },
    /// A physical parameter is held at a bound, beyond which the lumped ones ask for it.
    AtBound {
        /// The physical parameter.
        parameter: String,
        /// Its value, the bound, in its unit.
        value: f64,
    },
    /// The deviation of a physical parameter is of the size of its value.
    PoorlyDetermined {
        /// The physical parameter.
        parameter: String,
    },
    /// The search for the physical parameters did not end.
    NotConverged,
    /// The search ended where the lumped parameters have no value.
    Nowhere,
    /// No physical parameters have these lumped ones.
    Inconsistent {
        /// Standard deviations from chance of what the best physical parameters leave.
        deviation: f64,
        /// Relations between lumped parameters that were tested.
        relations: usize,
    },
}

impl PhysicalRemark {
    /// The physical parameter that it is about; nothing for a remark about all of them.
    #[must_use]
    pub fn parameter(&self) -> Option<&String> {
        match self {
            PhysicalRemark::NotDetermined { parameter }
            | PhysicalRemark::AtBound { parameter, .. }
            | PhysicalRemark::PoorlyDetermined { parameter } => Some(parameter),
            PhysicalRemark::NotConverged | PhysicalRemark::Nowhere | PhysicalRemark::Inconsistent { .. } => None,
        }
    }
}

impl fmt::Display for PhysicalRemark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PhysicalRemark::NotDetermined { parameter } => {
                write!(f, "the lumped parameters do not determine {parameter}")
            }
            PhysicalRemark::AtBound { parameter, value } => write!(
                f,
                "{parameter} is held at its bound {value}: the lumped parameters ask for a value beyond it, which no such machine has"
            ),
            PhysicalRemark::PoorlyDetermined { parameter } => write!(f, "{parameter} is poorly determined"),
            PhysicalRemark::NotConverged => f.write_str("the search for the physical parameters did not converge"),
            PhysicalRemark::Nowhere => {
                f.write_str("the physical parameters came to a place where the lumped ones have no value")
            }
            PhysicalRemark::Inconsistent { deviation, relations } => write!(
                f,
                "the lumped parameters are not those of any machine of this structure: what the best physical ones leave is {deviation:.1} standard deviations from chance ({relations} relations tested)"
            ),
        }
    }
}
