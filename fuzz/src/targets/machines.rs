//! Machines of several coordinates: linear models and regulators at rest, trajectories, robot descriptions. Most texts are valid.

use super::models::within_budget;
use super::mutated::mutated;
use super::random::Random;
use super::{Verdict, refused};
use std::fmt::Write as _;
use tpm_codegen::import::{Options, import_description};
use tpm_codegen::{Parsed, Source, parse_model};
use tpm_runtime::numerics::Matrix;
use tpm_runtime::physical::MotorizedMachine;
use tpm_runtime::plant::regulator::{Rates, RegulatorWeights, design};
use tpm_runtime::study::trajectories;
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::linear::linearize::{OperatingPoint, StateSpace, linearize};
use tpm_symbolic::linear::transfer::transfer_functions;
use tpm_symbolic::number::rational::{Rational, ratio, to_f64};
use tpm_symbolic::plan::split::split;

/// Masses in a chain, a ring or a tree, one in three of them changed.
pub(super) fn machine_text(random: &mut Random) -> String {
    let text = machine(random, 6);
    if random.below(3) == 0 { mutated(&text, random.next()) } else { text }
}

/// The same of one or two masses: the laws of a stroke have thousands of samples.
pub(super) fn small_text(random: &mut Random) -> String {
    let text = machine(random, 2);
    if random.below(3) == 0 { mutated(&text, random.next()) } else { text }
}

/// At most so many masses in a chain, a ring or a tree, with springs, dampers and pendulums. The first line declares everything.
pub(super) fn machine(random: &mut Random, most: u64) -> String {
    let count = random.below(most) + 1;
    let shape = random.below(3);
    let driven = if random.below(4) == 0 { random.below(count) + 1 } else { count };
    let names = |letter: &str, count: u64| (0..count).map(|i| format!("{letter}{i}")).collect::<Vec<_>>().join(", ");
    let mut text = String::new();
    for i in 0..count {
        let beside = match shape {
            0 => i.saturating_sub(1),
            1 => (i + 1) % count,
            _ => random.below(i.max(1)),
        };
        let of = |random: &mut Random| 1 + random.below(9);
        let _ = write!(text, "{}*m*ddot(x{i})", of(random));
        if random.below(3) > 0 {
            let from = if i == beside { String::new() } else { format!(" - x{beside}") };
            let _ = write!(text, " + {}*k*(x{i}{from})", of(random));
        }
        for (term, odds) in [
            (format!("c*dot(x{i})"), 2),
            (format!("b*sin(x{i})"), 3),
            (format!("b*x{i}^3"), 4),
            (format!("c*dot(x{i})*dot(x{beside})"), 5),
            (format!("m*cos(x{i} - x{beside})*ddot(x{beside})/20"), 4),
        ] {
            if random.below(odds) == 0 {
                let _ = write!(text, " + {term}");
            }
        }
        text.push_str(" = ");
        text.push_str(&if i < driven { format!("u{i}") } else { "0".to_owned() });
        text.push_str(";\n");
    }
    // A parameter that nothing uses is a fault.
    let used: Vec<&str> = ["m", "k", "c", "b"].into_iter().filter(|name| text.contains(&format!("{name}*"))).collect();
    let head = format!("coordinate {}; input {}; parameter {}", names("x", count), names("u", driven), used.join(", "));
    let mut text = format!("model M {{ {head};\n{text}");
    text.push_str("pattern { amplitude A; frequency w;");
    for i in 0..count {
        let moves = ["A*cos(w*t)", "A*cos(2*w*t)", "rest_to_rest(A, w, 3)"];
        let _ = write!(text, " x{i} = {};", random.of::<&str>(&moves));
    }
    text.push_str(" } }\n");
    text
}

/// Values for every symbol, none of them a round number.
fn value(symbol: Symbol) -> Rational {
    ratio(13 + 5 * i64::from(symbol.0 % 100), 11)
}

/// A and B at rest in the origin, and what follows from them.
fn at_rest(parsed: &Parsed) -> Result<StateSpace<Rational>, String> {
    let mut model = parsed.model.clone();
    let linear = linearize(&mut model, &OperatingPoint::default()).map_err(|fault| fault.to_string())?;
    let transfers = transfer_functions(&mut model, &linear);
    let space = linear.evaluate_exact(&model, |symbol| Some(value(symbol)));
    let space = space.ok_or_else(|| "an entry is not rational".to_owned())?;
    let resolvent = space.resolvent();
    for (coordinate, row) in transfers.iter().enumerate() {
        for (input, written) in row.iter().enumerate() {
            let output: Vec<Rational> =
                (0..space.a.len()).map(|state| ratio(i64::from(state == coordinate), 1)).collect();
            let found = resolvent.transfer_function(&output, input).ok_or("no such channel")?;
            // The symbols and the numbers say the same at a point that is no pole.
            let s = ratio(17, 7);
            let of = |coefficients: &[tpm_symbolic::expr::graph::ExprId]| {
                let mut values = coefficients.iter().rev().map(|c| {
                    model.graph.evaluate_exact(*c, |node| match node {
                        tpm_symbolic::expr::graph::Node::Symbol(symbol) => Some(known(&model, *symbol)),
                        _ => None,
                    })
                });
                values.try_fold(ratio(0, 1), |sum, c| Some(sum * &s + c?))
            };
            let (above, below) = (of(&written.numerator), of(&written.denominator));
            if let (Some(above), Some(below), Some(number)) = (above, below, found.evaluate(&s))
                && below != ratio(0, 1)
            {
                assert_eq!(above / below, number, "the transfer function from {input} to {coordinate}");
            }
        }
    }
    Ok(space)
}

/// The value of a symbol: that of a constant, or that which is given to all others.
fn known(model: &tpm_symbolic::mechanics::model::ExactModel, symbol: Symbol) -> Rational {
    match &model.quantity(symbol).kind {
        tpm_symbolic::mechanics::model::Kind::Constant { value: Some(value) } => value.clone(),
        _ => value(symbol),
    }
}

/// The linear model, its transfer functions in symbols and in numbers, which must agree.
pub(super) fn linear(text: &str) -> Verdict {
    within_budget(text, |parsed| at_rest(parsed).map(|_| ()))
}

/// A regulator, which must hold what it says: its poles lie within the circle, and its margins about one.
pub(super) fn regulator(text: &str) -> Verdict {
    within_budget(text, |parsed| {
        let space = at_rest(parsed)?;
        let matrix = |rows: &[Vec<Rational>]| {
            let rows: Vec<Vec<f64>> = rows.iter().map(|row| row.iter().map(to_f64).collect()).collect();
            Matrix::from_rows(&rows).ok_or("no matrix")
        };
        let (states, inputs) = (space.a.len(), space.b.first().map_or(0, Vec::len));
        let weights = RegulatorWeights { state: vec![1.0; states], input: vec![1.0; inputs] };
        let rates = if text.len().is_multiple_of(2) { Rates::Measured } else { Rates::Differences(0.01) };
        let found = design(&matrix(&space.a)?, &matrix(&space.b)?, 1e-3, rates, &weights);
        let found = found.map_err(|fault| fault.to_string())?;
        assert!(found.poles.iter().all(|pole| pole.norm() < 1.0), "a loop that is not stable");
        for margins in &found.margins {
            assert!(margins.gain.0 <= 1.0 && margins.gain.1 >= 1.0, "{margins:?}");
            assert!(margins.phase >= 0.0 && margins.delay >= 0.0, "{margins:?}");
        }
        Ok(())
    })
}

/// The pattern beside the laws of a stroke.
pub(super) fn strokes(text: &str) -> Verdict {
    within_budget(text, |parsed| {
        let pattern = parsed.model.patterns.first().ok_or("no pattern")?;
        let symbolic = split(&parsed.model, &[]).map_err(|fault| fault.to_string())?;
        let machine = MotorizedMachine::new(&symbolic, pattern, |symbol| Some(to_f64(&value(symbol))));
        let machine = machine.map_err(|fault| fault.to_string())?;
        let trajectory = machine.trajectory(&vec![0.3; pattern.amplitudes.len()], 2.0);
        let demand = machine.demand();
        let found = trajectories(&demand, &trajectory, std::f64::consts::PI, machine.highest_derivative());
        let found = found.map_err(|fault| fault.to_string())?;
        let pattern = found.motions.first().ok_or("no motion")?;
        let used = pattern.inputs.iter().flatten();
        assert!(used.into_iter().all(|input| input.peak.is_finite() && input.rms <= input.peak * 1.000_001));
        Ok(())
    })
}

/// A robot of links in a chain or a tree, one in two of them changed.
pub(super) fn description_text(random: &mut Random) -> String {
    let links = random.below(6) + 1;
    let mut text = "<robot name=\"r\">\n".to_owned();
    let number = |random: &mut Random| {
        let sign = if random.below(2) == 0 { "" } else { "-" };
        format!("{sign}{}.{}", random.below(2), random.below(1000))
    };
    for i in 0..=links {
        let _ = write!(text, "<link name=\"b{i}\">");
        if random.below(8) > 0 {
            let (mass, ixx) = (1 + random.below(20), 1 + random.below(50));
            let _ = write!(
                text,
                "<inertial><origin xyz=\"{} {} {}\" rpy=\"0 0 {}\"/><mass value=\"{mass}\"/>\
                 <inertia ixx=\"{ixx}\" iyy=\"{ixx}\" izz=\"{ixx}\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial>",
                number(random),
                number(random),
                number(random),
                number(random)
            );
        }
        text.push_str("</link>\n");
    }
    for i in 0..links {
        let kinds = ["revolute", "revolute", "continuous", "prismatic", "fixed"];
        let axes = ["0 0 1", "0 1 0", "1 0 0", "0 0 -1", "0.6 0.8 0"];
        let turns = ["0 0 0", "1.5707963267948966 0 0", "0 -1.5707963 0", "0.3 0.2 0.1"];
        let parent = if random.below(4) == 0 { random.below(i + 1) } else { i };
        let _ = writeln!(
            text,
            "<joint name=\"j{i}\" type=\"{}\"><parent link=\"b{parent}\"/><child link=\"b{}\"/><origin xyz=\"{} {} {}\" rpy=\"{}\"/>\
             <axis xyz=\"{}\"/><limit effort=\"10\" velocity=\"3\" lower=\"-2\" upper=\"2\"/>\
             <dynamics damping=\"{}\" friction=\"{}\"/></joint>",
            random.of::<&str>(&kinds),
            i + 1,
            number(random),
            number(random),
            number(random),
            random.of::<&str>(&turns),
            random.of::<&str>(&axes),
            random.below(3),
            random.below(2)
        );
    }
    text.push_str("</robot>\n");
    if random.below(2) == 0 { mutated(&text, random.next()) } else { text }
}

/// A robot description to a model, which the language reads.
pub(super) fn description(text: &str) -> Verdict {
    let source = Source::new("r.urdf", text);
    match import_description(&source, &Options::default()) {
        Ok(imported) => {
            let model = Source::new("r.tpm", imported.model.as_str());
            if let Err(diagnostics) = parse_model(&model) {
                panic!("an imported model that is refused: {}\n{}", diagnostics.render(&model), imported.model);
            }
            Verdict::Answered
        }
        Err(diagnostics) => refused(&diagnostics.render(&source).chars().take(3000).collect::<String>()),
    }
}
