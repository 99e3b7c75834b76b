//! The page of an identification.

use crate::block::{Block, Cell, Notice, SHARE_DIGITS};
use crate::estimates::{Estimated, estimates};
use crate::headline;
use crate::page::{Caution, Document};
use crate::validation::remark;
use tpm_campaign::RunReport;
use tpm_estimate::{ParameterReport, Status};
use tpm_report::{Remedy, cells, combination, digits, number, or_dash};
use tpm_session::{
    About, Concern, Identification, LogReport, Meaning, Severity, Validation, Warning, Way, closed_loop,
};

/// Gives the name of a remedy in a front end, such as that of a flag; nothing where the front end has no name for it.
pub type Spell<'a> = dyn Fn(&Remedy) -> Option<String> + 'a;

/// Heading of the column of tracking errors, one per coordinate.
pub(super) const RMS: &str = "#rms error";
/// Heading of the column of what one run or one log by itself leaves of the force, before a simulation refines what all of them say.
const FORCE_LEFT: &str = "#force left by itself";
/// Largest number of parameters of which the whole matrix of correlations is shown.
const MATRIX: usize = 16;
/// Largest number of parameters whose matrix has room on a narrow screen.
const NARROW_MATRIX: usize = 8;
/// Magnitude from which on correlations are listed where the matrix is too large.
const STRONG: f64 = 0.9;
/// Least and largest number of correlations that are listed.
const LISTED: (usize, usize) = (10, 40);

impl Document {
    /// The page of a result, with validations by the logs or runs that it comes from; `spell` gives the names of
    /// remedies.
    #[must_use]
    pub fn of_identification(result: &Identification, evidence: &[Validation], spell: &Spell<'_>) -> Self {
        let mut document = Document {
            title: result.model.clone(),
            subtitle: headline::subtitle(result),
            issue: None,
            short: "Not complete",
            shortfall: result.shortfall(),
            success: headline::success(result, evidence),
            conclusion: headline::conclusion(result),
            caution: Caution::of_warnings(!result.warnings.is_empty()),
            facts: headline::facts(result),
            sections: Vec::new(),
            figures: Vec::new(),
        };
        document.warnings(result, spell);
        document.parameters(result);
        document.not_shown(result);
        document.evidence(evidence, &[headline::unexplained(result)]);
        document.friction(evidence);
        document.missing(result);
        document.correlations(result);
        document.runs(result);
        document.limits(result);
        document.logs(result);
        document.provenance(result);
        document
    }

    fn warnings(&mut self, result: &Identification, spell: &Spell<'_>) {
        let notice = |warning: &Warning| Notice {
            text: warning.to_string(),
            remedy: warning.remedy().and_then(|remedy| spell(&remedy)),
            grave: warning.is_distrust(),
        };
        // Warnings about single parameters also stand in the table of parameters. For an arm their number would hide
        // the other warnings.
        let place = |warning: &&Warning| {
            let Meaning { severity, about, concern } = warning.meaning();
            match (severity, about, concern) {
                (Severity::Distrust, ..) => 0,
                (_, About::Parameters, Concern::Parameters([_]) | Concern::Nothing) => 2,
                _ => 1,
            }
        };
        let mut ordered: Vec<&Warning> = result.warnings.iter().collect();
        ordered.sort_by_key(place);
        let list: Vec<Notice> = ordered.into_iter().map(notice).collect();
        let blocks = if list.is_empty() { vec![Block::text("None.")] } else { vec![Block::Notices { list }] };
        self.section("warnings", "Warnings", blocks);
    }

    fn parameters(&mut self, result: &Identification) {
        let mut blocks = Vec::new();
        // Where there are physical parameters, the lumped ones are intermediate results.
        let lumped =
            if result.physical.is_empty() { "" } else { "combinations of them, in which the equations are linear" };
        // One that is physical itself stands in the first table.
        let physical = |own: &&ParameterReport| result.physical.iter().any(|other| other.name == own.name);
        let lists: [(&str, Vec<&ParameterReport>); 2] = [
            ("", result.physical.iter().collect()),
            (lumped, result.parameters.iter().filter(|own| !physical(own)).collect()),
        ];
        for (caption, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
            let rows: Vec<Estimated<'_>> = list.into_iter().map(Estimated::from).collect();
            blocks.push(estimates("parameter", &rows, caption));
        }
        if !result.combinations.is_empty() {
            let rows: Vec<Estimated<'_>> = result.combinations.iter().map(Estimated::from).collect();
            blocks.push(estimates("combination", &rows, "combinations of parameters that do not show one by one"));
        }
        let lists = result.parameters.iter().chain(&result.physical);
        let truth = lists.clone().any(|parameter| parameter.truth.is_some())
            || result.combinations.iter().any(|shown| shown.truth.is_some());
        let prior = lists.clone().any(|parameter| parameter.prior.is_some())
            || result.combinations.iter().any(|shown| shown.prior.is_some());
        let mut legend = String::from("The bar is the 95 % interval about the identified value");
        if truth {
            legend.push_str("; the diamond is the true value of the simulated machine, which only a simulation knows");
        }
        if prior {
            legend.push_str("; the triangle is the prior");
        }
        legend.push_str(". A mark in the margin lies beyond the strip.");
        blocks.extend((truth || prior).then(|| Block::text(legend)));
        self.section("parameters", "Parameters", blocks);
    }

    fn not_shown(&mut self, result: &Identification) {
        let directions: Vec<String> = result.unobservable.iter().map(combination).collect();
        // Physical parameters behind lumped ones have no directions of their own.
        let apart = |own: &&ParameterReport| {
            own.status == Status::Unobservable
                && !result.unobservable.iter().any(|direction| direction.contains_key(&own.name))
        };
        let lists = result.parameters.iter().chain(&result.physical);
        let alone: Vec<&str> = lists.filter(apart).map(|parameter| parameter.name.as_str()).collect();
        let mut list: Vec<Notice> = (directions.iter())
            .map(|direction| remark(format!("the data do not show the direction {direction}")))
            .collect();
        list.extend(
            (!alone.is_empty())
                .then(|| remark(format!("the data do not show {}: no value follows from them", alone.join(", ")))),
        );
        let mut blocks = if list.is_empty() {
            vec![Block::text("Nothing: the data show every parameter by itself.")]
        } else {
            vec![Block::Notices { list }]
        };
        blocks.extend((!directions.is_empty()).then(|| {
            Block::text(
                "Along these directions every value explains the data alike. A parameter that takes part in one has no value of its own; \
                 combinations that the data do show stand in the table above.",
            )
        }));
        let limits: Vec<Notice> = result.log.iter().flat_map(LogReport::limits).map(remark).collect();
        blocks.extend((!limits.is_empty()).then_some(Block::Notices { list: limits }));
        self.section("not-shown", "What the data do not show", blocks);
    }

    fn missing(&mut self, result: &Identification) {
        let mut blocks = Vec::new();
        for (path, missing) in headline::lacking(result) {
            if missing.is_empty() {
                continue;
            }
            let rows = missing.iter().map(|term| {
                let [value, std] = cells(Some(term.value), Some(term.std));
                vec![
                    Cell::text(term.term.clone()),
                    Cell::text(term.row.clone().unwrap_or_else(|| "a reading".to_owned())),
                    Cell::shown(value, Some(term.value)),
                    Cell::shown(std, Some(term.std)),
                    Cell::percent(Some(term.gain)),
                    Cell::text(term.meaning.clone()),
                ]
            });
            let caption = format!("terms that would take what the model leaves unexplained{path}");
            let columns = ["term", "acts on", "#factor", "#std. dev.", "#of the unexplained", "meaning"];
            blocks.push(Block::table(&columns, rows.collect(), &caption));
            let whole: f64 = missing.iter().map(|term| term.gain).sum();
            blocks.extend((whole > 1.0).then(|| {
                Block::text(
                    "Each share is of what would be left without that term, beside the others: terms that look alike take the same part, so that \
                     the shares add up to more than all.",
                )
            }));
        }
        self.section("missing", "What the model lacks", blocks);
    }

    fn correlations(&mut self, result: &Identification) {
        let physical = Correlations::of(&result.physical, &result.physical_covariance);
        let lumped = Correlations::of(&result.parameters, &result.covariance);
        let mut blocks = physical.blocks();
        // Lumped parameters that are all physical themselves were shown already.
        blocks.extend((!lumped.are_within(&physical)).then(|| lumped.blocks()).into_iter().flatten());
        self.section("correlations", "Correlations", blocks);
    }

    fn runs(&mut self, result: &Identification) {
        if result.runs.is_empty() {
            return;
        }
        let rows = result.runs.iter().map(run_row).collect();
        let frequency = format!("#{} [rad/s]", result.frequency_name);
        let columns =
            ["#run", "amplitudes", frequency.as_str(), "#periods", RMS, "#effort", "#condition", FORCE_LEFT, "ending"];
        self.section("runs", "Runs", vec![Block::table(&columns, rows, "what was played, in order")]);
    }

    fn limits(&mut self, result: &Identification) {
        let mut list: Vec<Notice> = (result.runs.iter())
            .filter_map(|run| run.limit.as_ref().map(|limit| remark(format!("run {}: {limit}", run.run))))
            .collect();
        list.extend(result.stop.as_ref().map(|limit| remark(format!("the campaign ended at a limit: {limit}"))));
        if let Some(stability) = &result.stability {
            let text = closed_loop(stability).trim().to_owned();
            list.extend((!text.is_empty()).then(|| remark(text)));
        }
        let blocks = if list.is_empty() { Vec::new() } else { vec![Block::Notices { list }] };
        self.section("limits", "Limits", blocks);
    }

    fn logs(&mut self, result: &Identification) {
        let mut blocks = Vec::new();
        if let Some(pool) = &result.pool {
            let rows = pool.logs.iter().map(|part| {
                let told = part.deviations.iter().filter_map(|(name, deviations)| Some((name, (*deviations)?)));
                let farthest = told.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
                vec![
                    Cell::text(part.log.path.clone()),
                    Cell::percent(Some(part.share)),
                    Cell::percent(Some(part.residual)),
                    Cell::text(or_dash(farthest, |(name, deviations)| {
                        let left_out = if part.left_out { "; left out" } else { "" };
                        format!("{name}, {deviations:+.1} deviations{left_out}")
                    })),
                ]
            });
            let columns = ["log", "#information", FORCE_LEFT, "farthest from the others"];
            blocks.push(Block::table(&columns, rows.collect(), "logs that were used together"));
        }
        let all = result.log.iter().chain(result.pool.iter().flat_map(|pool| pool.logs.iter().map(|part| &part.log)));
        blocks.extend(all.flat_map(log));
        self.section("logs", "Logs", blocks);
    }

    fn provenance(&mut self, result: &Identification) {
        let own = &result.provenance;
        let mut rows = vec![("program".to_owned(), own.tool.clone())];
        rows.extend(own.model.clone().map(|hash| ("fingerprint of the model".to_owned(), hash)));
        rows.extend(own.experiment.clone().map(|hash| ("fingerprint of the experiment".to_owned(), hash)));
        rows.extend(own.seed.map(|seed| ("seed of the simulated noise".to_owned(), seed.to_string())));
        rows.extend(own.logs.iter().map(|log| (log.path.clone(), log.hash.clone())));
        rows.extend(own.options.iter().map(|(name, value)| {
            (format!("option {name}"), value.as_str().map_or_else(|| value.to_string(), ToOwned::to_owned))
        }));
        self.section("provenance", "Provenance", vec![Block::Facts { rows }]);
    }
}

/// Correlations of the parameters that have a deviation.
struct Correlations<'a> {
    names: Vec<&'a str>,
    rows: Vec<Vec<Option<f64>>>,
}

impl<'a> Correlations<'a> {
    fn of(list: &'a [ParameterReport], covariance: &[Vec<Option<f64>>]) -> Self {
        let entry = |r: usize, c: usize| covariance.get(r).and_then(|row| row.get(c)).copied().flatten();
        let correlation = |r: usize, c: usize| {
            let scale = (entry(r, r)? * entry(c, c)?).sqrt();
            (scale > 0.0).then_some(entry(r, c)? / scale)
        };
        let shown: Vec<usize> = (0..list.len()).filter(|&j| correlation(j, j).is_some()).collect();
        Correlations {
            names: shown.iter().map(|&j| list[j].name.as_str()).collect(),
            rows: shown.iter().map(|&r| shown.iter().map(|&c| correlation(r, c)).collect()).collect(),
        }
    }

    /// Whether others are of all these parameters.
    fn are_within(&self, others: &Self) -> bool {
        self.names.iter().all(|name| others.names.contains(name))
    }

    /// The matrix, and a list of the strongest where the matrix is large; nothing for one parameter.
    fn blocks(&self) -> Vec<Block> {
        match self.names.len() {
            0 | 1 => Vec::new(),
            few if few <= NARROW_MATRIX => vec![self.matrix(false)],
            some if some <= MATRIX => vec![self.matrix(true), self.strongest().for_narrow()],
            _ => vec![self.strongest()],
        }
    }

    fn matrix(&self, wide: bool) -> Block {
        Block::Matrix { names: self.names.iter().map(|&name| name.to_owned()).collect(), rows: self.rows.clone(), wide }
    }

    fn strongest(&self) -> Block {
        let mut pairs: Vec<(usize, usize, f64)> = Vec::new();
        for (r, row) in self.rows.iter().enumerate() {
            pairs.extend(row[..r].iter().enumerate().filter_map(|(c, value)| Some((c, r, (*value)?))));
        }
        pairs.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()));
        let strong = pairs.iter().filter(|pair| pair.2.abs() >= STRONG).count();
        let rows = pairs.iter().take(strong.clamp(LISTED.0, LISTED.1)).map(|&(a, b, value)| {
            vec![Cell::text(self.names[a]), Cell::text(self.names[b]), Cell::shown(format!("{value:+.4}"), Some(value))]
        });
        let caption = format!("the strongest of {} correlations, {strong} of which are {STRONG} or more", pairs.len());
        Block::table(&["parameter", "with", "#correlation"], rows.collect(), &caption)
    }
}

fn run_row(run: &RunReport) -> Vec<Cell> {
    let amplitudes = run.amplitudes.iter().map(|(name, value)| format!("{name}\u{a0}=\u{a0}{}", number(*value)));
    let amplitudes: Vec<String> = run.pattern.clone().into_iter().chain(amplitudes).collect();
    let errors: Vec<String> = run.tracking_rms.iter().map(|rms| digits(*rms, SHARE_DIGITS)).collect();
    let pooled = if run.contradicts.is_some() { ", not pooled" } else { "" };
    vec![
        Cell::text(run.run.to_string()),
        Cell::text(amplitudes.join(", ")),
        Cell::number(Some(run.frequency)),
        Cell::text(run.periods.to_string()),
        Cell::text(errors.join(", ")),
        Cell::shown(or_dash(run.effort_share, |share| format!("{:.1} %", 100.0 * share)), run.effort_share),
        Cell::size(run.condition),
        Cell::percent(run.residual),
        Cell::text(format!("{}{pooled}", run.ending)),
    ]
}

/// How one log was used, and the assumptions made in reading it.
fn log(log: &LogReport) -> Vec<Block> {
    let mut rows = vec![
        ("log".to_owned(), log.path.clone()),
        ("samples".to_owned(), format!("{} every {} s", log.samples, number(log.sample_time))),
    ];
    match &log.way {
        Way::Harmonics(found) => {
            let (periods, period) = (found.periods, number(found.period));
            rows.push((
                "used".to_owned(),
                format!("{periods} periods of {period} s from sample {} (line {})", found.from_sample, found.from_line),
            ));
            rows.push(("window".to_owned(), found.window.clone()));
            rows.push((
                "last two periods differ by".to_owned(),
                format!("{} % of the motion", digits(100.0 * found.mismatch, SHARE_DIGITS)),
            ));
        }
        Way::Samples(found) => rows.push(("used".to_owned(), format!("{} samples one by one", found.samples))),
        Way::Recorded(found) => {
            let (readings, of, blocks) = (found.readings, found.of, found.blocks);
            rows.push(("simulated between stamps".to_owned(), format!("{readings} of {of} readings, {blocks} blocks")));
            for own in &found.sensors {
                let share = digits(100.0 * own.share, SHARE_DIGITS);
                rows.push((format!("left of {}", own.signal), format!("{share} % of its deviation")));
            }
            if !found.unmeasured.is_empty() {
                rows.push(("not measured".to_owned(), found.unmeasured.join(", ")));
            }
        }
        Way::Spectral(found) => {
            let lines: usize = found.lines.lines.iter().sum();
            let used = found.lines.used.iter().copied().fold(0.0, f64::max);
            let periods =
                found.period.map_or(String::new(), |period| format!(", whole periods of {} s", number(period)));
            rows.push(("used".to_owned(), format!("{} samples{periods}", found.lines.samples)));
            rows.push(("lines of the rows".to_owned(), format!("{lines}, up to {} Hz", number(used))));
        }
    }
    let hold = |residual: Option<f64>| or_dash(residual, |share| format!("{} %", digits(100.0 * share, SHARE_DIGITS)));
    let holds =
        format!("{} as recorded, {} held between samples", hold(log.hold_residuals.none), hold(log.hold_residuals.zoh));
    rows.push(("unexplained force with either hold".to_owned(), holds));
    if let Some(refined) = log.refinement.as_ref().filter(|refined| refined.used) {
        rows.push((
            "refined by a simulation of".to_owned(),
            format!("{} of {} samples, {} steps", refined.samples, refined.of, refined.steps),
        ));
    }
    let list: Vec<Notice> = log.reading.remarks().into_iter().map(remark).collect();
    let mut blocks = vec![Block::Facts { rows }];
    blocks.extend((!list.is_empty()).then_some(Block::Notices { list }));
    blocks
}
