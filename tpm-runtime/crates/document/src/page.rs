//! A page: its head, and its conversion to HTML.

use crate::block::{Block, Cell, Named, Section};
use crate::error::DocumentError;
use minijinja::{Environment, context};
use serde::Serialize;
use tpm_plot::Figure;

const TEMPLATE: &str = include_str!("page.html");
/// Width of a figure on a wide and on a narrow screen, in pixels.
const WIDTHS: (u32, u32) = (960, 460);
/// A correlation below this size is shown as zero, without a sign.
const NO_CORRELATION: f64 = 5e-4;
/// Opacity of the colour behind a correlation of one, in percent.
const MOST_TINT: f64 = 60.0;

/// A result as one page for a browser, including its figures.
#[derive(Clone, Debug)]
pub struct Document {
    pub(super) title: String,
    pub(super) subtitle: String,
    /// Who wrote it, when, and for what; nothing where that is not known.
    pub(super) issue: Option<Issue>,
    /// What is missing of the requested result; nothing when the result is complete.
    pub(super) shortfall: Option<String>,
    /// What a shortfall is, before it is told.
    pub(super) short: &'static str,
    /// The sentence for a complete result.
    pub(super) success: String,
    /// What the result comes to in plain words, a sentence each.
    pub(super) conclusion: Vec<String>,
    /// What to read before the numbers are used.
    pub(super) caution: Option<Caution>,
    /// The most important values, by name.
    pub(super) facts: Vec<(String, Cell)>,
    pub(super) sections: Vec<Section>,
    pub(super) figures: Vec<Named>,
}

/// What to read before the numbers of a page are used.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Caution {
    /// The section that tells of it.
    pub(super) section: &'static str,
    /// A sentence behind the headline, which leads there.
    pub(super) text: &'static str,
}

impl Caution {
    /// Where there are warnings: to read them.
    pub(super) fn of_warnings(there: bool) -> Option<Self> {
        there.then_some(Caution { section: "warnings", text: "There are warnings." })
    }
}

/// Who wrote a page, when, and for what.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Issue {
    /// What is reported on, such as the name of a machine; stands above the name of the model.
    pub title: Option<String>,
    /// Who reports.
    pub author: Option<String>,
    /// The day, such as `2026-03-01`.
    pub date: Option<String>,
}

/// A figure as drawn into the page, for wide and for narrow screens. It is divided into panels, so that a printed page
/// may break between two of them.
#[derive(Serialize)]
struct Drawn {
    wide: Vec<String>,
    narrow: Vec<String>,
}

impl Document {
    /// The page with what is known of who wrote it, when, and for what.
    #[must_use]
    pub fn issued(mut self, issue: Issue) -> Self {
        self.issue = Some(issue);
        self
    }

    /// Stores a figure and gives the block that shows it.
    pub(super) fn figure(&mut self, name: &str, figure: Figure, caption: &str) -> Block {
        let taken = self.figures.iter().filter(|other| other.name.split('-').next() == Some(name)).count();
        let name = if taken == 0 { name.to_owned() } else { format!("{name}-{}", taken + 1) };
        self.figures.push(Named { name, figure });
        Block::Figure { number: self.figures.len() - 1, caption: caption.to_owned() }
    }

    /// Adds a section, unless it is empty.
    pub(super) fn section(&mut self, id: &'static str, title: &'static str, blocks: Vec<Block>) {
        if !blocks.is_empty() {
            self.sections.push(Section { id, title, blocks });
        }
    }

    /// The figures of the page with their names.
    pub fn figures(&self) -> impl Iterator<Item = (&str, &Figure)> {
        self.figures.iter().map(|named| (named.name.as_str(), &named.figure))
    }

    /// The page as HTML.
    ///
    /// # Errors
    /// [`DocumentError`] where a figure cannot be drawn.
    pub fn html(&self) -> Result<String, DocumentError> {
        let drawn = |named: &Named| {
            let height = named.figure.height / named.figure.panels.len().max(1) as u32;
            let at = |width: u32| {
                let alone = named.figure.panels.iter().map(|panel| {
                    let own = Figure { title: String::new(), width, height, panels: vec![panel.clone()] };
                    own.svg().map_err(|source| DocumentError::Figure { name: named.name.clone(), source })
                });
                alone.collect::<Result<Vec<_>, _>>()
            };
            Ok(Drawn { wide: at(WIDTHS.0)?, narrow: at(WIDTHS.1)? })
        };
        let figures: Vec<Drawn> = self.figures.iter().map(drawn).collect::<Result<_, DocumentError>>()?;
        let refused = |error: minijinja::Error| DocumentError::Template { reason: error.to_string() };
        let mut environment = Environment::new();
        environment.add_filter("correlation", |value: f64| {
            if value.abs() < NO_CORRELATION { "0.000".to_owned() } else { format!("{value:+.3}") }
        });
        environment.add_filter("tint", |value: f64| format!("{:.0}", MOST_TINT * value.abs()));
        // The template engine escapes all values in templates with this extension.
        environment.add_template("page.html", TEMPLATE).map_err(refused)?;
        let page = environment.get_template("page.html").map_err(refused)?;
        page.render(context! {
            title => self.title,
            subtitle => self.subtitle,
            issue => self.issue,
            conclusion => self.conclusion,
            short => self.short,
            shortfall => self.shortfall,
            success => self.success,
            caution => self.caution,
            facts => self.facts,
            sections => self.sections,
            figures => figures,
            version => env!("CARGO_PKG_VERSION"),
        })
        .map_err(refused)
    }
}
