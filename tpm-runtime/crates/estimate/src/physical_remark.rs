//! What the map from lumped to physical parameters shows.

use std::fmt;
use tpm_report::listed;

/// What there is to say of physical parameters that were found behind lumped ones.
#[derive(Clone, Debug, PartialEq)]
pub enum PhysicalRemark {
    /// The lumped parameters do not determine these physical ones.
    NotDetermined {
        /// The physical parameters, in the model's order.
        parameters: Vec<String>,
    },
    /// A physical parameter is held at a bound, beyond which the lumped ones ask for it.
    AtBound {
        /// The physical parameter.
        parameter: String,
        /// Its value, the bound, in its unit.
        value: f64,
    },
    /// The deviations of these physical parameters are of the size of their values.
    PoorlyDetermined {
        /// The physical parameters, in the model's order.
        parameters: Vec<String>,
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
    /// The physical parameters that it is about; none for a remark about all of them.
    #[must_use]
    pub fn parameters(&self) -> &[String] {
        match self {
            PhysicalRemark::NotDetermined { parameters } | PhysicalRemark::PoorlyDetermined { parameters } => {
                parameters
            }
            PhysicalRemark::AtBound { parameter, .. } => std::slice::from_ref(parameter),
            PhysicalRemark::NotConverged | PhysicalRemark::Nowhere | PhysicalRemark::Inconsistent { .. } => &[],
        }
    }
}

impl fmt::Display for PhysicalRemark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PhysicalRemark::NotDetermined { parameters } => {
                write!(f, "the lumped parameters do not determine {}", listed(parameters))
            }
            PhysicalRemark::AtBound { parameter, value } => write!(
                f,
                "{parameter} is held at its bound {value}: the lumped parameters ask for a value beyond it, which no such machine has"
            ),
            PhysicalRemark::PoorlyDetermined { parameters } => {
                let are = if parameters.len() == 1 { "is" } else { "are" };
                write!(f, "{} {are} poorly determined", listed(parameters))
            }
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
