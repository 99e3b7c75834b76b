//! What to tell whoever states the limits: which of them, were it larger, would show more.

use crate::plan::known::Known;
use crate::plan::room::Room;
use crate::plan::{Candidate, MULTIPLES, Scene, WORTH};
use serde::Serialize;
use tpm_estimate::Status;
use tpm_report::number;

/// Factor on a limit by which advice asks what more of it would show.
const RAISED: f64 = 1.5;

/// Which limit, if it were larger, would show a parameter better.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Advice {
    /// The parameter that is known least, beside what is wanted of it.
    pub parameter: String,
    /// Its standard deviation as a share of its value; nothing where it is not shown at all.
    pub deviation: Option<f64>,
    /// What is wanted of it.
    pub wanted: Option<f64>,
    /// The limit, as one writes it: `x`, `dot(x)` or an input; nothing where no larger limit would help.
    pub limit: Option<String>,
    /// Factor on the limit that was tried.
    pub raised: f64,
    /// The deviation that one more run would then leave, as a share of what one more run leaves now.
    pub left: Option<f64>,
}

impl std::fmt::Display for Advice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = |share: f64| number(100.0 * share);
        write!(f, "known least: {}, ", self.parameter)?;
        match self.deviation {
            Some(deviation) => write!(f, "to {} %", percent(deviation))?,
            None => f.write_str("which nothing shows by itself")?,
        }
        if let Some(wanted) = self.wanted {
            write!(f, " ({} % wanted)", percent(wanted))?;
        }
        match (&self.limit, self.left) {
            (Some(limit), Some(left)) => write!(
                f,
                "; with {} times the limit of {limit} one more run would leave {} % of the deviation that it leaves now",
                number(self.raised),
                percent(left)
            ),
            _ => write!(f, "; no limit alone, raised by {} %, would help much", percent(self.raised - 1.0)),
        }
    }
}

impl Scene<'_> {
    /// What to raise for the parameter that is known least; nothing where all is known as well as is wanted.
    pub(crate) fn advice(&self) -> Option<Advice> {
        let free = self.free();
        let worst = match self.unmet() {
            Some(unmet) => unmet.into_iter().max_by(|&a, &b| self.missed(a).total_cmp(&self.missed(b)))?,
            None => free.iter().copied().max_by(|&a, &b| self.relative(a).total_cmp(&self.relative(b)))?,
        };
        let at = free.iter().position(|&j| j == worst)?;
        let coordinates = self.model.dims().coordinates;
        let own = Room::of(self.setup, coordinates);
        let mut tried: Vec<(Option<String>, Room)> = vec![(None, own.clone())];
        let name = |c: usize| self.model.coordinate(c).name;
        for c in (0..coordinates).filter(|_| coordinates <= MULTIPLES.len()) {
            let mut wider = own.clone();
            let (low, high) = wider.positions[c];
            let more = (RAISED - 1.0) / 2.0 * (high - low);
            wider.positions[c] = (low - more, high + more);
            let mut faster = own.clone();
            faster.velocities[c] *= RAISED;
            tried.extend([(Some(name(c).to_string()), wider), (Some(format!("dot({})", name(c))), faster)]);
        }
        let inputs = (0..self.model.dims().inputs).map(|i| self.model.input(i).name).collect::<Vec<_>>().join(", ");
        tried.push((Some(inputs), Room { effort: RAISED, ..own }));
        let all: Vec<(Option<String>, Vec<Candidate>)> =
            tried.into_iter().map(|(limit, room)| (limit, self.candidates(&room, false))).collect();
        let roots = all.iter().flat_map(|(_, list)| list).map(|one| &one.root);
        let known = Known::by_estimate(self.estimate, &free, roots);
        let least = |list: &[Candidate]| {
            list.iter().map(|one| known.deviation_with(at, &one.root, 1.0)).fold(f64::INFINITY, f64::min)
        };
        let now = least(&all.first()?.1);
        let best = all[1..].iter().map(|(limit, list)| (limit, least(list))).min_by(|a, b| a.1.total_cmp(&b.1));
        let helps = best.filter(|(_, left)| *left < (1.0 - WORTH) * now);
        let shown = self.estimate.status.get(worst) != Some(&Status::Unobservable);
        Some(Advice {
            parameter: self.model.parameter(worst).name.to_string(),
            deviation: shown.then(|| self.relative(worst)),
            wanted: self.plan.goals.get(worst).copied().flatten(),
            limit: helps.as_ref().and_then(|(limit, _)| (*limit).clone()),
            raised: RAISED,
            left: helps.map(|(_, left)| left / now),
        })
    }
}
