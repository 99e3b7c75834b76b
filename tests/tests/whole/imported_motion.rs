//! The pattern and the experiment that `import` writes: the gains follow from the inertia that each joint feels, and limits are kept.

use crate::robots::{ROBOTS, at_rest, imported, mass_matrix, parsed};
use crate::support::skipped;
use tpm_codegen::Parsed;
use tpm_codegen::import::{Imported, Options, import_description};
use tpm_codegen::source::Source;
use tpm_runtime::experiment::Experiment;
use tpm_symbolic::mechanics::tree::mechanism::Loss;
use tpm_symbolic::number::rational::to_f64;

/// A sliding joint that carries a turning one, about an axis that is none of the frame's; names that the pattern would like to have.
const SLIDING: &str = r#"<robot name="sliding">
  <link name="base"/>
  <link name="w"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="3"/>
    <inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.2" iyz="0" izz="0.2"/></inertial></link>
  <link name="A_turn"><inertial><origin xyz="0.2 0.1 0.4"/><mass value="2"/>
    <inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.2" iyz="0" izz="0.2"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="w"/><origin rpy="0.3 0.2 0.1"/>
    <axis xyz="0.6 0 0.8"/><limit lower="0.1" upper="0.5" velocity="0" effort="100"/></joint>
  <joint name="turn" type="continuous"><parent link="w"/><child link="A_turn"/><origin xyz="0.1 0 0.2" rpy="0.1 0.5 0"/>
    <axis xyz="0 0.6 0.8"/></joint>
</robot>"#;

fn sliding() -> Imported {
    let source = Source::new("sliding.urdf", SLIDING.to_owned());
    import_description(&source, &Options::default()).unwrap_or_else(|faults| panic!("{}", faults.render(&source)))
}

/// All descriptions at hand.
fn descriptions() -> Vec<Imported> {
    let mut all = vec![sliding()];
    for (fixture, file, locked) in ROBOTS {
        match imported(fixture, file, locked) {
            Some(imported) => all.push(imported),
            None => skipped("TPM_DATA has no robots"),
        }
    }
    all
}

/// The middle of every joint's motion, as it stands in the model.
fn centres(imported: &Imported, parsed: &Parsed) -> Vec<f64> {
    let of = |name: &str| {
        let start = format!("        {name} = ");
        let series =
            imported.model.lines().find_map(|line| line.strip_prefix(&start)).expect("a motion for every joint");
        let centre = series.split_once(" + ").map_or("0", |(centre, _)| centre);
        let constant = imported.model.lines().find_map(|line| line.strip_prefix(&format!("    constant {centre} = ")));
        constant.map_or(centre, |value| value.split(' ').next().unwrap_or("")).parse().expect("a number")
    };
    parsed.model.coordinates.iter().map(|coordinate| of(&coordinate.name)).collect()
}

#[test]
fn gains_follow_from_what_the_joints_feel_in_the_middle_of_the_motion() {
    for imported in descriptions() {
        let (parsed, experiment) = (parsed(&imported), Experiment::parse(&imported.experiment).expect("an experiment"));
        let q = centres(&imported, &parsed);
        let mass = mass_matrix(&imported, &q);
        let inverse = nalgebra::DMatrix::from_fn(q.len(), q.len(), |i, j| mass[i][j]).try_inverse().expect("inertias");
        assert_eq!(q.len(), experiment.control.feedback.len());
        for (joint, feedback) in experiment.control.feedback.iter().enumerate() {
            // Force over acceleration while the other joints are free. With the natural frequency 20 rad/s and the damping ratio 0.7,
            // kd^2 = 4 0.7^2 kp m; three digits are written.
            let inertia = 1.0 / inverse[(joint, joint)];
            let damped = feedback.kd * feedback.kd / (1.96 * feedback.kp);
            assert!((damped - inertia).abs() <= 0.02 * inertia, "{feedback:?} {inertia} {damped}");
            // What is left holds the weight.
            let moved = |step: f64| {
                let mut q = q.clone();
                q[joint] += step;
                at_rest(&imported, &q)[joint]
            };
            let weight = (moved(1e-4) - moved(-1e-4)) / 2e-4;
            assert!(feedback.kp * 1.01 >= 400.0 * inertia + weight.abs(), "{feedback:?} {inertia} {weight}");
        }
    }
}

#[test]
fn names_of_the_description_go_before_those_of_the_pattern() {
    let imported = sliding();
    assert!(imported.model.contains("slide = c_slide + A_slide*(cos(w_*t) - 1/9*cos(3*w_*t));"), "{}", imported.model);
    assert!(imported.model.contains("turn = A_turn_*(sin(w_*t) - 1/2*sin(2*w_*t));"), "{}", imported.model);
    let experiment = Experiment::parse(&imported.experiment).expect("an experiment");
    assert!(!experiment.limits.velocities.contains_key("slide"), "a velocity of zero is none");
}

/// Friction that falls with the rate is a force beside the losses; its rate is looked for within shares of the joint's largest rate, or of
/// twice that of the motion to begin with.
#[test]
fn friction_that_falls_with_the_rate_is_a_force() {
    let turn = "velocity=\"0\"";
    for (text, [slides, turns]) in [
        (SLIDING.to_owned(), ["0.00053 to 0.13", "0.008 to 2"]),
        (SLIDING.replace(turn, "velocity=\"0.8\""), ["0.0016 to 0.4", "0.008 to 2"]),
    ] {
        let source = Source::new("sliding.urdf", text);
        let options = Options { losses: Some(vec![Loss::Coulomb]), stribeck: true, ..Options::default() };
        let imported =
            import_description(&source, &options).unwrap_or_else(|faults| panic!("{}", faults.render(&source)));
        for words in [
            "    parameter fs_slide [N], fs_turn [N*m];\n".to_owned(),
            format!("    nonlinear parameter vs_slide [m/s] from {slides}, vs_turn [rad/s] from {turns};\n"),
            "    force turn = -fs_turn*exp(-(dot(turn)/vs_turn)^2)*sign(dot(turn));\n".to_owned(),
            "with coulomb;".to_owned(),
        ] {
            assert!(imported.model.contains(&words), "{words}{}", imported.model);
        }
        let model = parsed(&imported).model;
        let constants = Experiment::parse(&imported.experiment).expect("an experiment").constants;
        assert_eq!(model.nonlinear.len(), constants.len());
        for own in &model.nonlinear {
            let value = constants[&model.quantity(own.symbol).name.to_string()];
            assert!(to_f64(&own.from) < value && value < to_f64(&own.to), "{value}");
        }
    }
}
