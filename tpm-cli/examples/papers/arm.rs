//! The closed-loop arm of D. Feng, chapter 5 and appendix A: its linkage, its Taylor coefficients, and the identification of Table 5.1.

use super::Chapter;
use super::failure::Failure;
use super::input::Input;
use super::markdown::{percent, table};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use tpm_runtime::experiment::Experiment;
use tpm_runtime::plant::simulated::{ArmGeometry, ClosedLoopArm};
use tpm_runtime::plot::{Axis, Curve, Figure, Panel, Trace};
use tpm_runtime::report::number;
use tpm_runtime::session::{DeclaredModel, MethodRun, MethodSignal, Session};
use tpm_symbolic::expr::graph::Node;

/// The arm of the experiment file, whose torques are those of Table 5.1.
const ARM: ArmGeometry = ArmGeometry {
    lengths: [0.100_445_980, 0.437_018_273, 0.431_160_162, 0.100_730_344, 0.698_343_839],
    masses: [13.817_110_5, 14.586_060_1, 0.347_198_293, 14.524_360_1],
    centroids: [0.023_255_188_6, 0.472_033_879, -0.008_716_916_43, 0.354_996_550],
    inertias: [0.382_864_809, 0.553_814_730, 0.000_659_058_087, 0.197_504_354],
    torque_scale: 344.359_168,
};
/// The angle at the start, rad.
const START: f64 = 5.421_616_82;
/// Travel of the second joint, rad: twice 8/9 of its amplitude.
const TRAVEL: f64 = 16.0 / 9.0 * 0.199_491_133;
const NAMES: [&str; 9] = ["a10", "a11", "a12", "a20", "a21", "a22", "a30", "a31", "a32"];
/// Feng, Table 5.1: frequency as printed, and the nine coefficients.
const TABLE_5_1: [(&str, [f64; 9]); 4] = [
    ("2", [2281.0, 1003.0, 0.0, 229.0, 109.0, 0.0, -1067.0, -474.0, 0.0]),
    ("2", [2285.0, 837.0, -11.0, 215.0, 173.0, 88.0, -1061.0, -573.0, -46.0]),
    ("2.phi (sic)", [2302.0, 1047.0, 74.0, 178.0, 379.0, -174.0, -1044.0, -497.0, -28.0]),
    ("3.6", [2359.0, 927.0, -189.0, 205.0, 534.0, 52.0, -1085.0, -483.0, 192.0]),
];
/// Step of the differences that check the Taylor coefficients, rad.
const STEP: f64 = 1e-3;

/// A1 to A8 (Feng, Eqns A.3 to A.10), kg m^2.
fn inertias() -> [f64; 8] {
    ClosedLoopArm::new(ARM).lumped_inertias()
}

/// a10 and a11 by the formulas that are printed below Eqn A.11, kg m^2.
fn printed_a1() -> [f64; 2] {
    let [_, l2, l3, l4, l5] = ARM.lengths;
    let a = inertias();
    let (sin, cos) = START.sin_cos();
    let square = l2 * l2 + l4 * l4 - 2.0 * l2 * l4 * cos;
    let (p5, p3) = (square + l5 * l5 - l3 * l3, square + l3 * l3 - l5 * l5);
    let (c5, c3) = (p5 / (2.0 * l5 * square.sqrt()), p3 / (2.0 * l3 * square.sqrt()));
    let turn = (l4 * sin / (l2 - l4 * cos)).atan();
    let a10 = a[0] / 2.0 + a[1] * cos + a[2] * (c5.acos() - turn).cos() - a[3] * (c3.acos() + turn).cos()
        + a[4] * (START - c5.acos() + turn).cos();
    // The part that all three brackets share, and what each has of its own.
    let shared = (-l2 * l4 * cos + l4 * l4) / square;
    let root = |c: f64, l: f64| 2.0 * l * square.powf(1.5) * (1.0 - c * c).sqrt();
    let slope5 = l2 * l4 * p3 * sin / root(c5, l5);
    let slope3 = l2 * l4 * p5 * sin / root(c3, l3);
    let a11 = -a[1] * sin
        + a[2] * (slope5 - shared) * (c5.acos() - turn).sin()
        + a[3] * (-slope3 - shared) * (c3.acos() + turn).sin()
        + a[4] * (-slope5 + shared - 1.0) * (START - c5.acos() + turn).sin();
    [a10, a11]
}

/// The nine Taylor coefficients from the model of the links, exact until they are evaluated, kg m^2.
fn series() -> Result<[f64; 9], Failure> {
    let mut text = include_str!("../../../models/linkages/closed_loop_arm_links.tpm").to_owned();
    for (at, name) in ["f1", "f2", "f3"].into_iter().enumerate() {
        let coefficients = NAMES[3 * at..3 * at + 3].join(", ");
        let start =
            text.find(&format!("let {name} = ")).ok_or_else(|| Failure::Input(format!("{name} is not there")))?;
        let end = start + text[start..].find(';').unwrap_or(0);
        text.insert_str(end, &format!(" about th20 order 2 as {coefficients}"));
        text = text.replacen(&format!("let {name} ="), &format!("series {name}(th2) ="), 1);
    }
    let (_, parsed) = Input::shipped("the arm with its links, f1 to f3 as series", &text).model()?;
    let model = &parsed.model;
    let mut values: BTreeMap<String, f64> = [("th20".to_owned(), START), ("th10".to_owned(), 0.0)].into();
    values.extend((1..=5).zip(ARM.lengths).map(|(i, value)| (format!("l{i}"), value)));
    values.extend((1..=8).zip(inertias()).map(|(i, value)| (format!("A{i}"), value)));
    let mut found = [f64::NAN; 9];
    for (slot, name) in found.iter_mut().zip(NAMES) {
        if let Some(lump) = model.lumps.iter().find(|lump| lump.name == name) {
            *slot = model.graph.evaluate(lump.expr, |leaf| match leaf {
                Node::Symbol(symbol) => values.get(model.quantity(*symbol).name.as_str()).copied().unwrap_or(f64::NAN),
                _ => f64::NAN,
            });
        }
    }
    Ok(found)
}

/// The nine coefficients by differences of the simulated machine's functions, which have their own derivation, in its units.
fn differences(arm: &ClosedLoopArm) -> [f64; 9] {
    let at = |angle: f64| arm.functions(angle);
    let (below, here, above) = (at(START - STEP), at(START), at(START + STEP));
    let of = |i: usize| {
        let ((low, middle), high) = ((below[i].0, here[i].0), above[i].0);
        [middle, (high - low) / (2.0 * STEP), (high - 2.0 * middle + low) / (2.0 * STEP * STEP)]
    };
    let [first, second, third] = [0, 1, 2].map(of);
    let mut all = [0.0; 9];
    for (slot, value) in all.iter_mut().zip(first.into_iter().chain(second).chain(third)) {
        *slot = value;
    }
    all
}

/// Figure 5.1: the links at the start and at the end of the stroke.
fn linkage(arm: &ClosedLoopArm) -> Figure {
    let [l1, l2, l3, l4, l5] = ARM.lengths;
    let links = |th2: f64| {
        let (th3, th4) = arm.loop_angles(th2);
        let (elbow, far) = ((l1 + l4 * th2.cos(), l4 * th2.sin()), (l1 + l2, 0.0));
        let tip = (elbow.0 + l5 * th3.cos(), elbow.1 + l5 * th3.sin());
        let closed = (far.0 + l3 * th4.cos(), far.1 + l3 * th4.sin());
        vec![(0.0, 0.0), (l1, 0.0), elbow, tip, closed, far, (l1, 0.0)]
    };
    let traces = vec![
        Trace::new("start of the stroke", 0, Curve::Line(links(START))),
        Trace::new("", 0, Curve::Points(links(START))),
        Trace::new("end of the stroke", 1, Curve::Dashed(links(START - TRAVEL))),
        Trace::new("", 1, Curve::Points(links(START - TRAVEL))),
    ];
    let panel = Panel {
        x: Axis::linear("along link 12 [m]").from_to(-0.1, 0.9),
        y: Axis::linear("across link 12 [m]").from_to(-0.15, 0.55),
        traces,
    };
    Figure { height: 640, ..Figure::new("Links of the simulated arm, th1 = 0 (Feng, Figure 5.1)", vec![panel]) }
}

/// A signal over one period from its harmonics.
fn wave(signal: &MethodSignal) -> Vec<f64> {
    let at = |i: u32| {
        let angle = TAU * f64::from(i) / 400.0;
        signal
            .lines
            .iter()
            .map(|line| line.measured.size * (line.harmonic as f64 * angle + line.measured.phase).cos())
            .sum()
    };
    (0..=400).map(at).collect()
}

fn over_period(values: &[f64]) -> Vec<(f64, f64)> {
    let last = (values.len().max(2) - 1) as f64;
    values.iter().enumerate().map(|(i, value)| (i as f64 / last, *value)).collect()
}

/// The torque of the feed-forward over one period, by the model with the parameters that were played.
fn feed_forward(run: &MethodRun, input: usize) -> Result<Vec<f64>, Failure> {
    let prepared = super::tables::prepared("closed_loop_arm.tpm", include_str!("../../../models/closed_loop_arm.tpm"))?;
    let exact = super::tables::table_of(&prepared)?;
    let mut values: BTreeMap<&str, f64> = run.amplitudes.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    values.insert("w", run.frequency);
    let symbols: Vec<f64> =
        exact.symbols.iter().map(|name| values.get(name.as_str()).copied().unwrap_or(f64::NAN)).collect();
    Ok((0..=400)
        .map(|i| {
            let angle = TAU * f64::from(i) / 400.0;
            let terms = exact.entries().filter(|entry| entry.equation == input).map(|entry| {
                let parameter =
                    entry.column.and_then(|column| run.update.get(column)).map_or(1.0, |update| update.before);
                let harmonic = entry.harmonic as f64;
                let wave =
                    if entry.function.name() == "cos" { (harmonic * angle).cos() } else { (harmonic * angle).sin() };
                parameter * wave * exact.evaluate(&entry, &symbols)
            });
            terms.sum()
        })
        .collect())
}

pub(super) fn chapter(unexplained: &mut Vec<String>) -> Result<Chapter, Failure> {
    let arm = ClosedLoopArm::new(ARM);
    let model = include_str!("../../../models/closed_loop_arm.tpm");
    let declared = DeclaredModel::parse("closed_loop_arm", model).map_err(|error| Failure::Input(error.to_string()))?;
    let experiment = Experiment::parse(include_str!("../../../models/closed_loop_arm_thesis.toml"))
        .map_err(|error| Failure::Input(format!("closed_loop_arm_thesis.toml: {error}")))?;
    let session = Session::new(declared, experiment, None, BTreeMap::new())
        .map_err(|error| Failure::Input(error.to_string()))?
        .showing_method();
    let result = session.identify(None, &mut |_, _, _| true).map_err(|error| Failure::Input(error.to_string()))?;
    let method = result.method.as_ref().ok_or_else(|| Failure::Input("the campaign has no runs".to_owned()))?;

    let inertia_rows: Vec<Vec<String>> = (1..=8)
        .zip(inertias())
        .zip(3..)
        .map(|((i, value), equation)| vec![format!("A.{equation}"), format!("A{i}"), number(value)])
        .collect();
    let (exact, numeric, printed) = (series()?, differences(&arm), printed_a1());
    let mut coefficient_rows = Vec::new();
    let mut largest = 0.0_f64;
    for (at, name) in NAMES.iter().enumerate() {
        let scaled = ARM.torque_scale * exact[at];
        let shown = printed.get(at).map_or_else(|| "not printed".to_owned(), |value| number(ARM.torque_scale * value));
        if let Some(value) = printed.get(at) {
            largest = largest.max((value / exact[at] - 1.0).abs());
        }
        // Second differences of functions of this size are good to some 1e-5.
        if (numeric[at] / scaled - 1.0).abs() > 1e-4 {
            unexplained.push(format!("Eqn A.11: {name} is {scaled}, by differences {}", numeric[at]));
        }
        coefficient_rows.push(vec![(*name).to_owned(), number(scaled), shown, number(numeric[at])]);
    }
    if largest > 1e-9 {
        unexplained.push(format!("Eqn A.11: the printed a10 and a11 differ from the series by {largest:e}"));
    }

    let head: Vec<&str> = ["w [rad/s]", ""].into_iter().chain(NAMES).collect();
    let mut rows = Vec::new();
    for (at, update) in method.updates.iter().enumerate() {
        let frequency = update.frequency.or(method.updates.get(1).and_then(|first| first.frequency));
        let mut row = vec![frequency.map_or_else(|| "-".to_owned(), number), "computed".to_owned()];
        row.extend(update.values.iter().map(|value| format!("{value:.0}")));
        rows.push(row);
        if let Some((frequency, printed)) = TABLE_5_1.get(at) {
            let mut row = vec![(*frequency).to_owned(), "printed".to_owned()];
            row.extend(printed.iter().map(|value| format!("{value:.0}")));
            rows.push(row);
        }
    }
    let (Some(first), Some(last)) = (method.runs.first(), method.runs.last()) else {
        return Err(Failure::Input("the campaign has no runs".to_owned()));
    };
    let rms = |run: &MethodRun, signal: usize| {
        let values = run.signals.get(signal).map(wave).unwrap_or_default();
        (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
    };
    let panel = |label: &str, traces: Vec<Trace>| Panel {
        x: Axis::linear("time, in periods").from_to(0.0, 1.0),
        y: Axis::linear(label),
        traces,
    };
    let error = |signal: usize, label: &str| {
        let of = |run: &MethodRun| over_period(&run.signals.get(signal).map(wave).unwrap_or_default());
        panel(
            label,
            vec![
                Trace::new("first run", 1, Curve::Dashed(of(first))),
                Trace::new("last run", 0, Curve::Line(of(last))),
            ],
        )
    };
    let errors = Figure::new(
        "Tracking error of the first and the last run (Feng, Figure 5.5)",
        vec![error(0, "error of th1 [rad]"), error(1, "error of th2 [rad]")],
    );
    let mut torques = Vec::new();
    let mut feedback = Vec::new();
    for (input, label) in ["tau1 [commanded units]", "tau2 [commanded units]"].into_iter().enumerate() {
        let whole = last.signals.get(2 + input).map(wave).unwrap_or_default();
        let forward = feed_forward(last, input)?;
        let size = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>().sqrt();
        let rest = size(&mut whole.iter().zip(&forward).map(|(whole, part)| whole - part));
        feedback.push(rest / size(&mut whole.iter().copied()));
        torques.push(panel(
            label,
            vec![
                Trace::new("whole torque", 0, Curve::Line(over_period(&whole))),
                Trace::new("feed-forward", 1, Curve::Dashed(over_period(&forward))),
            ],
        ));
    }
    let torques = Figure::new("Torque of the last run (Feng, Figure 5.6)", torques);
    let text = format!(
        "## 4. The closed-loop arm (Feng, chapter 5 and appendix A)\n\nThe built arm is not known; this one, whose torques are those of \
         Table 5.1, stands for it.\n\n![Figure 5.1: links 12, 3, 4 and 5 with the loop closed](linkage.svg)\n\nEqns A.3 to A.10, kg m^2:\n\n{}\n\
         Eqn A.11 and its like for f1, f2 and f3, in commanded units ({} per N m): exact Taylor coefficients of the model with its links, \
         evaluated; the printed formulas of a10 and a11; and differences of the simulated machine's own functions:\n\n{}\n\
         The printed formulas agree within {:.0e} of the value. In print a radical has l_(l^2) for l3 and l_l for l2, and cos th20^2 means the square of \
         the cosine.\n\nTable 5.1, from its first row, on the simulated arm:\n\n{}\n\
         The rows differ because the table is not unique: with both joints on one pattern and a fixed ratio of amplitudes the runs show \
         {} combinations of nine coefficients at any frequency; along (lambda2^2, lambda1^2, -2 lambda1 lambda2) in (a1k, a2k, a3k) every \
         estimate keeps what it began with, and another machine begins elsewhere. The gains are read as units per degree, and have \
         damping that the thesis does not mention: without it the loop is not asymptotically stable.\n\n\
         ![Figure 5.5: harmonics of the tracking error, over one period](tracking.svg)\n\n\
         ![Figure 5.6: harmonics of the torque of the last run, and its feed-forward](torque.svg)\n\n\
         The error falls from {} to {} rad (th1) and from {} to {} rad (th2), rms, while the frequency rises from {} to {} rad/s. Feedback \
         makes {} and {} of the torque of the last run.\n",
        table(&["equation", "", "value"], &inertia_rows),
        number(ARM.torque_scale),
        table(&["", "series", "printed formula", "differences"], &coefficient_rows),
        largest,
        table(&head, &rows),
        result.rank,
        number(rms(first, 0)),
        number(rms(last, 0)),
        number(rms(first, 1)),
        number(rms(last, 1)),
        number(first.frequency),
        number(last.frequency),
        percent(feedback[0]),
        percent(feedback[1]),
    );
    let findings = vec![
        format!("Eqn A.11: the printed a10 and a11 are the exact series within {largest:.0e} of the value."),
        format!(
            "Table 5.1 cannot be a unique solution: its runs show {} combinations of nine parameters. On a simulated arm the error falls as \
             Figure 5.5 says.",
            result.rank
        ),
    ];
    Ok(Chapter { text, figures: vec![("linkage", linkage(&arm)), ("tracking", errors), ("torque", torques)], findings })
}

#[cfg(test)]
mod tests {
    use super::{printed_a1, series};

    #[test]
    fn the_printed_coefficients_are_those_of_the_series() {
        let exact = series().expect("the shipped links");
        for (printed, exact) in printed_a1().iter().zip(exact) {
            assert!((printed / exact - 1.0).abs() < 1e-9, "{printed} {exact}");
        }
    }
}
