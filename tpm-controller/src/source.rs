//! The source text of [`support`](crate::support), for emitters of files that do not depend on this crate.

/// Module name and source text of every file of [`support`](crate::support), in alphabetical order.
///
/// Each file imports its names from its parent module, which must re-export the names that `support` re-exports.
pub const SUPPORT: [(&str, &str); 19] = [
    ("accelerations", include_str!("support/accelerations.rs")),
    ("campaign", include_str!("support/campaign.rs")),
    ("error", include_str!("support/error.rs")),
    ("hyperbolic", include_str!("support/hyperbolic.rs")),
    ("label", include_str!("support/label.rs")),
    ("least_squares", include_str!("support/least_squares.rs")),
    ("monitor", include_str!("support/monitor.rs")),
    ("phasor", include_str!("support/phasor.rs")),
    ("real", include_str!("support/real.rs")),
    ("run_estimate", include_str!("support/run_estimate.rs")),
    ("run_linearised", include_str!("support/run_linearised.rs")),
    ("run_lines", include_str!("support/run_lines.rs")),
    ("run_means", include_str!("support/run_means.rs")),
    ("run_noise", include_str!("support/run_noise.rs")),
    ("run_numerical", include_str!("support/run_numerical.rs")),
    ("run_physical", include_str!("support/run_physical.rs")),
    ("run_weigh", include_str!("support/run_weigh.rs")),
    ("run_workspace", include_str!("support/run_workspace.rs")),
    ("square_root", include_str!("support/square_root.rs")),
];
