//! The macro, `tpm generate` and a build script make code that computes alike.

use super::{dyadic, runner};
use crate::support::root;
use proptest::prelude::*;
use std::path::Path;
use tpm_models as models;
use tpm_tests::goldens;

/// The file that `tpm generate` writes computes what the macro's code computes, bit by bit.
#[test]
fn a_generated_file_is_the_macros_code() {
    use crate::generated::mass_spring_drag as file;
    use models::mass_spring_drag as code;
    assert_eq!(
        (file::MODEL_HASH, file::PARAMETERS.map(|p| (p.name, p.unit))),
        (code::MODEL_HASH, code::PARAMETERS.map(|p| (p.name, p.unit)))
    );
    let result = runner(128).run(&(dyadic(2), dyadic(3), -3.0..3.0f64), |(pattern, theta, phase)| {
        let pattern: [f64; 2] = pattern.try_into().expect("two symbols");
        let theta: [f64; 3] = theta.try_into().expect("three parameters");
        let (ours, theirs) = (file::Pattern::from_array(pattern), code::Pattern::from_array(pattern));
        prop_assert_eq!(ours.estimator_matrix(), theirs.estimator_matrix());
        let (motion, other) = (ours.reference_at(phase), theirs.reference_at(phase));
        prop_assert_eq!(motion.into_array(), other.into_array());
        prop_assert_eq!(file::regressor(&motion), code::regressor(&other));
        prop_assert_eq!(file::known(&motion).into_array(), code::known(&other).into_array());
        let force = file::feed_forward(&motion, &file::Parameters::from_array(theta)).u;
        prop_assert_eq!(force, code::feed_forward(&other, &code::Parameters::from_array(theta)).u);
        let (mut sums, mut others) = (file::Accumulator::new(), code::Accumulator::new());
        sums.push(phase, &file::Forces { u: force });
        others.push(phase, &code::Forces { u: force });
        let bits = |harmonics: [f64; 6]| harmonics.map(f64::to_bits);
        prop_assert_eq!(
            sums.harmonics().map(|harmonics| bits(harmonics.into_array())),
            others.harmonics().map(|harmonics| bits(harmonics.into_array()))
        );
        Ok(())
    });
    result.expect("the same numbers");
}

#[test]
fn a_build_script_makes_the_same_module() {
    use crate::built::mass_spring_drag as built;
    use models::mass_spring_drag as code;
    let (ours, theirs) = (built::Pattern { lambda: 0.3, w: 2.0 }, code::Pattern { lambda: 0.3, w: 2.0 });
    assert_eq!(ours.estimator_matrix(), theirs.estimator_matrix());
    assert_eq!(ours.reference(0.4).into_array(), theirs.reference(0.4).into_array());
    assert_eq!(built::MODEL_HASH, code::MODEL_HASH);
}

/// The sources that these tests compile and run are those that are kept, though the build script generated them in another profile.
#[test]
fn compiled_sources_are_those_that_are_kept() {
    let compiled =
        goldens::read(Path::new(concat!(env!("OUT_DIR"), "/generated"))).expect("the build script wrote them");
    let stale = goldens::Kept::read(&root()).expect("texts and hashes").stale(&compiled);
    assert!(stale.is_empty(), "{stale:?}");
}
