//! Lists of names and values as maps in JSON.

use serde::{Serialize, Serializer};

/// Serialises pairs as a map in their order, for `serialize_with`.
pub(crate) fn by_name<N: Serialize, T: Serialize, S: Serializer>(
    pairs: &[(N, T)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(pairs.iter().map(|(name, value)| (name, value)))
}
