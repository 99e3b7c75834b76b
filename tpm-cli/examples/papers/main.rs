//! Every table and figure of both papers, computed again, on one page:
//! `cargo run --release -p tpm-cli --example papers -- -o DIR`.
//!
//! Printed values stand beside computed ones, with the reason of every difference; figures are drawn from what the program computes. The
//! page ends with a list of everything that the papers show, and of what is not here and why. It writes `papers.html`, which needs
//! nothing else, and `papers.md`, the same with its figures as files. Exit codes: 0 done, 1 something differs that no known slip of a
//! paper explains, 2 the page could not be made.

mod actuators;
mod arm;
#[path = "../pendulum_study/failure.rs"]
#[allow(dead_code, reason = "the study of the pendulum has more ways to fail")]
mod failure;
#[path = "../pendulum_study/input.rs"]
#[allow(dead_code, reason = "the study of the pendulum reads files too")]
mod input;
#[path = "../pendulum_study/linear.rs"]
mod linear;
#[path = "../pendulum_study/machine.rs"]
#[allow(dead_code, reason = "the study of the pendulum identifies and balances too")]
mod machine;
#[path = "../pendulum_study/markdown.rs"]
mod markdown;
mod page;
mod pendulum;
#[path = "../pendulum_study/response.rs"]
mod response;
mod tables;

use clap::Parser;
use failure::Failure;
use markdown::table;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use tpm_runtime::plot::Figure;

/// Compute every table and figure of both papers again, and write them as one page.
#[derive(Parser)]
struct Args {
    /// Length of the record for the frequency response, s; the paper's is 180.
    #[arg(long, value_name = "SECONDS", default_value_t = 180.0)]
    duration: f64,
    /// Folder for papers.html, papers.md and the figures; made when it is not there.
    #[arg(short, long, value_name = "DIR", default_value = "papers")]
    output: PathBuf,
}

/// A chapter of the page.
struct Chapter {
    /// Its text as Markdown, with the places of its figures.
    text: String,
    /// Name of the file, and the figure.
    figures: Vec<(&'static str, Figure)>,
    /// What agrees with the paper, and what does not.
    findings: Vec<String>,
}

/// What a paper shows under a name: computed again, or not, with the reason.
struct Shown {
    name: &'static str,
    what: &'static str,
    here: Result<&'static str, &'static str>,
}

const fn here(name: &'static str, what: &'static str, place: &'static str) -> Shown {
    Shown { name, what, here: Ok(place) }
}

const fn absent(name: &'static str, what: &'static str, why: &'static str) -> Shown {
    Shown { name, what, here: Err(why) }
}

const SKETCH: &str = "a drawing without numbers; what it shows is the model";
const PHOTO: &str = "a photograph or a screen of the apparatus; there is nothing to compute";

/// Tables, figures and equations with numbers of D. Feng's dissertation, in its order.
const FENG: &[Shown] = &[
    here("Eqns 2.16 to 2.21", "the pattern of lowest harmonics", "1"),
    here("Eqn 2.28", "the highest harmonic of the force", "1"),
    absent("Figure 3.1", "block diagram of feed-forward and feedback", SKETCH),
    here("Eqn 3.26", "harmonics of mass, spring and drag", "2"),
    here("Eqns 3.27, 3.29", "the matrix, and the square one", "2"),
    absent("Figure 4.1", "two carts", SKETCH),
    here("Eqns 4.35 to 4.41", "lumped parameters of the two carts", "3"),
    here("Eqn 4.42", "the pattern of order 5", "1"),
    here("Eqn 4.44", "harmonics of the two carts", "3"),
    here("Figure 5.1", "the linkage, drawn to the lengths of the simulated arm", "4"),
    absent("Figure 5.2", "the built arm", PHOTO),
    absent("Figure 5.3", "wiring of the controller", SKETCH),
    absent("Figure 5.4", "window of the controller's program", PHOTO),
    here("Table 5.1", "parameters run by run", "4"),
    here("Figure 5.5", "tracking error before and after", "4"),
    here("Figure 5.6", "torque and its feed-forward", "4"),
    absent("Figures 6.1, 6.2", "cart and pendulum, and their forces", SKETCH),
    here("Eqns 6.2, 6.3", "harmonics of force and torque", "6"),
    here("Eqns 6.4 to 6.7", "the two parts of force and torque", "6"),
    absent("Figures 6.3, 6.4", "block diagrams of both feed-forwards", SKETCH),
    here("Figure 6.5", "error of the cart with both feed-forwards", "6"),
    here("Eqns A.3 to A.10", "A1 to A8 from masses and lengths", "4"),
    here("Eqn A.11", "Taylor coefficients of f1, f2 and f3", "4"),
    here("Eqns B.1, B.2", "harmonics of the arm", "5"),
    absent("Figure C.1", "circuit of the motor", SKETCH),
    here("Eqns C.11 to C.16", "cut-off frequency and voltage of the motors", "6"),
];

/// Tables, figures and equations with numbers of the paper on the rotary pendulum, in its order.
const FONG: &[Shown] = &[
    absent("Figures 1, 2", "the apparatus and its wiring", PHOTO),
    absent("Figure 3", "flow chart of the method", SKETCH),
    absent("Figure 4", "the pendulum", SKETCH),
    here("Table 1", "values of the pendulum", "7"),
    here("Eqn 24", "linear model, upright", "8"),
    here("Eqn 28", "linear model, hanging", "8"),
    here("Eqn 29", "the parametric model", "8"),
    here("Figure 5", "the input", "7"),
    here("Figure 6", "frequency response, Eqns 28 and 29, the fit", "9"),
];

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(code) => code,
        Err(failure) => {
            // A closed standard error is no reason to fail differently.
            let _ = writeln!(std::io::stderr(), "{}", failure.to_string().trim_end());
            ExitCode::from(failure.exit_code())
        }
    }
}

fn run(args: &Args) -> Result<ExitCode, Failure> {
    if !(args.duration.is_finite() && (100.0..=3600.0).contains(&args.duration)) {
        return Err(Failure::Input(format!(
            "--duration {}: two halves of two segments of 32.8 s are needed, so give 100 to 3600 s",
            args.duration
        )));
    }
    let (chapters, unexplained) = chapters(args.duration)?;
    write(&args.output, &chapters)?;
    let text = format!("page: {}\n", args.output.join("papers.html").display());
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            return Err(Failure::write(Path::new("standard output"), error));
        }
        _ => {}
    }
    if unexplained.is_empty() {
        return Ok(ExitCode::SUCCESS);
    }
    Err(Failure::Incomplete(format!("differences without a known reason:\n{}", unexplained.join("\n"))))
}

/// All chapters, and differences from what is printed for which no reason is known.
fn chapters(duration: f64) -> Result<(Vec<Chapter>, Vec<String>), Failure> {
    let values = input::Input::table_1();
    let upright = machine::Machine::load(&input::Input::upright(), &values)?;
    let down = machine::Machine::load(&input::Input::down(), &values)?;
    let mut unexplained = Vec::new();
    let mut list = tables::chapters(&mut unexplained)?;
    // The arm stands between the tables of chapters 4 and B, as the thesis has it.
    list.insert(3, arm::chapter(&mut unexplained)?);
    list.push(actuators::chapter()?);
    list.push(pendulum::chapter(&values)?);
    list.push(numbered(linear::chapter(&upright, &down)?, "## 1. ", "## 8. Fong: "));
    list.push(numbered(response::chapter(&down, duration)?, "## 2. ", "## 9. Fong: "));
    Ok((list, unexplained))
}

/// A chapter under another number.
fn numbered(chapter: Chapter, from: &str, to: &str) -> Chapter {
    Chapter { text: chapter.text.replacen(from, to, 1), ..chapter }
}

/// The list of what a paper shows.
fn inventory(list: &[Shown]) -> String {
    let rows: Vec<Vec<String>> = list
        .iter()
        .map(|shown| {
            let (place, why) = match shown.here {
                Ok(chapter) => (format!("chapter {chapter}"), String::new()),
                Err(why) => ("not here".to_owned(), why.to_owned()),
            };
            vec![shown.name.to_owned(), shown.what.to_owned(), place, why]
        })
        .collect();
    table(&["printed as", "what it shows", "here", "why not"], &rows)
}

fn write(folder: &Path, chapters: &[Chapter]) -> Result<(), Failure> {
    let count = |list: &[Shown]| list.iter().filter(|shown| shown.here.is_ok()).count();
    let mut text = format!(
        "# Both papers, computed again\n\nD. Feng, *On the Dynamics of Non-Linear Systems and Actuation Devices*, and T. Teng Fong, Z. \
         Jamaludin, L. Abdullah, *System Identification and Modelling of Rotary Inverted Pendulum*: what they print beside what `tpm` \
         computes. Of {} tables, figures and equations with numbers {} are here; the others are drawings and photographs. Machines are \
         simulated: the apparatus of neither paper is at hand, and measurements on it cannot be repeated.\n\n## What agrees, and what does \
         not\n\n",
        FENG.len() + FONG.len(),
        count(FENG) + count(FONG),
    );
    for finding in chapters.iter().flat_map(|chapter| &chapter.findings) {
        text.push_str(&format!("- {finding}\n"));
    }
    for chapter in chapters {
        text.push('\n');
        text.push_str(&chapter.text);
    }
    text.push_str("\n## What the papers show, and where it is\n\nD. Feng:\n\n");
    text.push_str(&inventory(FENG));
    text.push_str("\nT. Teng Fong, Z. Jamaludin, L. Abdullah:\n\n");
    text.push_str(&inventory(FONG));

    std::fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
    let save = |name: &str, bytes: &str| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).map_err(|error| Failure::write(&path, error))
    };
    let mut drawn = Vec::new();
    for (name, figure) in chapters.iter().flat_map(|chapter| &chapter.figures) {
        let svg = figure.svg().map_err(|error| Failure::Input(format!("{name}: {error}")))?;
        save(&format!("{name}.svg"), &svg)?;
        drawn.push((format!("{name}.svg"), svg));
    }
    save("papers.md", &text)?;
    save("papers.html", &page::html(&text, &drawn))
}
