//! A regression as the file that programs for continuous integration read (JUnit).

use crate::error::DocumentError;
use minijinja::{Environment, context};
use tpm_session::{CheckOutcome, Regression};

const TEMPLATE: &str = include_str!("junit.xml");

/// The checks of a regression as a JUnit file, a test case each. What cannot be said is a skipped one.
///
/// # Errors
/// [`DocumentError`] where the file cannot be made.
pub fn junit(found: &Regression) -> Result<String, DocumentError> {
    let refused = |error: minijinja::Error| DocumentError::Template { reason: error.to_string() };
    let mut environment = Environment::new();
    environment.set_keep_trailing_newline(true);
    // XML knows fewer characters than texts have; the others have no way into it.
    let shown = |text: &str| text.replace(|c: char| c.is_control() && !"\t\n\r".contains(c), "\u{fffd}");
    let checks: Vec<minijinja::Value> = (found.checks.iter())
        .map(|check| {
            let (outcome, why) = match &check.outcome {
                CheckOutcome::Failed(why) => ("failed", shown(why)),
                CheckOutcome::Skipped(why) => ("skipped", shown(why)),
                _ => ("passed", String::new()),
            };
            context! { name => shown(&check.name), outcome => outcome, why => why }
        })
        .collect();
    let skipped = found.checks.iter().filter(|check| matches!(check.outcome, CheckOutcome::Skipped(_))).count();
    // The template engine escapes all values in templates with this extension.
    environment.add_template("junit.xml", TEMPLATE).map_err(refused)?;
    let page = environment.get_template("junit.xml").map_err(refused)?;
    page.render(context! {
        model => shown(&found.model),
        log => shown(&found.log),
        checks => checks,
        failed => found.failed().count(),
        skipped => skipped,
    })
    .map_err(refused)
}
