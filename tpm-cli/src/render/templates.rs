//! Models to begin with for a log, and the commands that begin.

use crate::render::quoted::command;
use std::path::Path;
use tpm_runtime::report::{Align, TextTable};
use tpm_runtime::session::{Inspection, Proposal, Quantity};

/// The command that identifies a model, which stands in a file, with the columns of a proposal. `read` says how the log is read.
pub(crate) fn identify(proposal: &Proposal, model: &Path, log: &Path, read: &[String]) -> String {
    let mut words = ["tpm", "identify", &model.display().to_string(), "--log", &log.display().to_string()]
        .map(str::to_owned)
        .to_vec();
    words.extend_from_slice(read);
    for placed in &proposal.signals {
        words.extend(["--map".to_owned(), format!("{}={}", placed.signal, placed.column)]);
    }
    command(&words)
}

/// What the columns of a log are, and for every template that fits them the commands that begin with it.
pub(crate) fn shown(found: &Inspection, proposals: &[Proposal], log: &Path, read: &[String]) -> String {
    let mut table = TextTable::new(&[("column", Align::Left), ("unit", Align::Left), ("taken for", Align::Left)]);
    for channel in &found.channels {
        let quantity = Quantity::of(&channel.name, channel.unit.as_deref());
        let constant = if channel.constant { ", which never changes" } else { "" };
        let unit = channel.unit.clone().unwrap_or_else(|| "-".to_owned());
        table.row(&[channel.name.clone(), unit, format!("{quantity}{constant}")]);
    }
    let sampling = &found.sampling;
    let mut text =
        format!("{}: {} samples, {:.4} s\n\n{}", found.log, sampling.samples, sampling.duration, table.finish());
    for proposal in proposals {
        let name = proposal.template.name;
        let words = ["tpm", "init", name, "--log", &log.display().to_string(), "--template", name];
        let words = [&words.map(str::to_owned), read].concat();
        text.push_str(&format!(
            "\n{name}: {}\n  {}\n  {}\n",
            proposal.template.machine,
            command(&words),
            identify(proposal, &Path::new(name).with_extension("tpm"), log, read)
        ));
    }
    if found.may_be_of_an_arm() {
        text.push_str("\narm: joints with an input each, described by a file (URDF or MJCF; here arm.urdf)\n  tpm init arm --from arm.urdf\n");
    }
    text
}
