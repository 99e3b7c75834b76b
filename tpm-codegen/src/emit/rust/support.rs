//! The code of `tpm-controller` that a self-contained file includes.
//!
//! Invariant: the included text is unchanged; every module imports its names from the surrounding module, which is
//! written here.

use tpm_controller::source::SUPPORT;

/// The items of `tpm-controller` that the code needs in addition to scalars and labels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Needs {
    /// Least squares of harmonics, which a pattern with a table needs.
    pub(super) solves: bool,
    /// The hyperbolic tangent.
    pub(super) hyperbolic: bool,
    /// The solution of a mass matrix.
    pub(super) accelerations: bool,
    /// Least squares sample by sample.
    pub(super) square_root: bool,
    /// The watch over base parameters, beside least squares sample by sample.
    pub(super) monitor: bool,
    /// The estimator of a run.
    pub(super) run: bool,
    /// The order of a campaign.
    pub(super) campaign: bool,
}

/// The module `support`.
pub(super) fn text(needs: Needs) -> String {
    let Needs { solves, hyperbolic, accelerations, square_root, monitor, run, campaign } = needs;
    let square_root = square_root || run;
    let mut text = String::from(
        "\n/// What the functions above need beside `core` and the crate `libm`.\n#[allow(dead_code, unused_imports, clippy::needless_range_loop, reason = \"no model needs all of it; an index reads as in the mathematics\")]\npub mod support {\n    pub use self::label::Label;\n    pub use self::real::Real;\n",
    );
    if solves {
        text.push_str(
            "    pub use self::error::AccumulatorError;\n    pub use self::least_squares::{LeastSquares, SolveError, least_squares, weighted_least_squares};\n",
        );
    }
    if accelerations {
        text.push_str("    pub use self::accelerations::{SingularMass, accelerations, factors_hold};\n");
    }
    if square_root {
        text.push_str("    pub use self::square_root::{SampleFault, Shown, Solution, SquareRoot};\n");
    }
    if monitor {
        text.push_str(
            "    pub use self::monitor::{MonitorFault, MonitorPhase, MonitorRules, MonitorState, Monitoring, Moved};\n",
        );
    }
    if campaign {
        text.push_str(
            "    pub use self::campaign::{CampaignEnd, CampaignOrder, CampaignPhase, CampaignReason, CampaignRules, CampaignState, Play, RunPool, passing};\n",
        );
    }
    if run {
        text.push_str(
            "    pub use self::phasor::Phasor;\n    pub use self::run_estimate::RunEstimate;\n    pub use self::run_linearised::{RunLinearisation, RunReference};\n    pub use self::run_lines::{RunFault, RunLines, RunSampling};\n    pub use self::run_means::RunPassed;\n    pub use self::run_numerical::RunNumerical;\n    pub use self::run_physical::{RunIteration, RunLumping, RunPhysical};\n    pub use self::run_weigh::RunMeans;\n    pub use self::run_workspace::{RunModel, RunWorkspace};\n",
        );
    }
    if hyperbolic {
        text.push_str("    pub use self::hyperbolic::Hyperbolic;\n");
    }
    for (name, source) in SUPPORT {
        let needed = match name {
            "error" | "least_squares" => solves,
            "hyperbolic" => hyperbolic,
            "accelerations" => accelerations,
            "square_root" => square_root,
            "monitor" => monitor,
            "campaign" => campaign,
            "phasor" => run,
            name if name.starts_with("run_") => run,
            _ => true,
        };
        if !needed {
            continue;
        }
        text.push_str(&format!("\n    mod {name} {{\n"));
        for line in source.trim_end().lines() {
            if !line.is_empty() {
                text.push_str("        ");
                text.push_str(line);
            }
            text.push('\n');
        }
        text.push_str("    }\n");
    }
    text.push_str("}\n");
    text
}

#[cfg(test)]
mod tests {
    use super::{Needs, text};

    #[test]
    fn nothing_of_the_runtime_is_left() {
        for (solves, hyperbolic) in [(true, false), (false, true)] {
            let text = text(Needs {
                solves,
                hyperbolic,
                accelerations: hyperbolic,
                square_root: solves,
                monitor: solves,
                run: hyperbolic,
                campaign: false,
            });
            assert_eq!(text.contains("least_squares"), solves);
            assert_eq!(text.contains("tanh"), hyperbolic);
            assert_eq!(text.contains("SingularMass"), hyperbolic);
            assert!(text.contains("SquareRoot"));
            assert_eq!(text.contains("RunWorkspace"), hyperbolic);
            assert!(!text.contains("crate::") && !text.contains("cfg(test)"), "{text}");
            assert!(syn::parse_file(&text).is_ok());
        }
    }
}
