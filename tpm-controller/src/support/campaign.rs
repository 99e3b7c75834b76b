//! The order of a campaign on the controller: which pattern is played, when a run is measured, when an update is due, how far the next run
//! goes, and why the campaign ends (Feng, chapter 3, the five steps).
//!
//! A campaign begins at rest where all amplitudes are zero. Every change of amplitude or frequency is a smooth passage from the one
//! pattern to the other, both played on meanwhile; then the new one settles, is measured for whole periods and goes on until the update
//! is made. A run that meets a limit is given up for one of smaller amplitudes.
//!
//! Invariants: nothing allocates; a campaign ends after a bounded number of samples if updates are made; an ended one comes to rest.

use super::{Real, RunFault, SquareRoot};

/// What a smaller amplitude is after a limit was met.
const BACK_OFF: f64 = 0.7;
/// How often one stage is made smaller before the campaign gives up.
const MOST_BACK_OFFS: u32 = 4;

/// What the caller decides about a campaign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CampaignRules<T> {
    /// Periods that settle before a run is measured, behind the passage to it.
    pub settle_periods: u32,
    /// Periods that are measured, an even number and at least four.
    pub periods: u32,
    /// Runs of every stage.
    pub runs_per_stage: u32,
    /// Runs of the whole campaign, those that were given up included.
    pub most_runs: u32,
    /// Share of an input's limit from which on no larger stage is begun.
    pub effort: T,
}

/// Where a campaign is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CampaignPhase {
    /// A run passes to its pattern and settles.
    Settling,
    /// The samples of a run are taken in.
    Measuring,
    /// The run is whole: an update is due, the pattern goes on.
    Due,
    /// The campaign has ended, and the machine comes to rest.
    Ended(CampaignEnd),
}

/// Why a campaign ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum CampaignEnd {
    /// All stages were played.
    Stages,
    /// All runs were used.
    Runs,
    /// An input has reached the stated share of its limit.
    Effort,
    /// A limit of an input or of a tracking error was met again and again, or on the way from one pattern to the next.
    Limit,
    /// A run could not be used.
    Fault(RunFault),
    /// The caller stopped it.
    Stopped,
}

/// A pattern while it is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Play<T> {
    /// The stage.
    pub stage: usize,
    /// The share of the stage's amplitudes: zero at rest.
    pub share: T,
    /// Samples of a period.
    pub samples_per_period: u32,
    /// The sample of the period.
    pub number: u32,
}

impl<T: Real> Play<T> {
    /// The phase w t in radians.
    #[must_use]
    pub fn phase(&self) -> T {
        let turns = f64::from(self.number) / f64::from(self.samples_per_period.max(1));
        T::from_f64(2.0 * core::f64::consts::PI * turns)
    }

    fn advance(&mut self) {
        self.number += 1;
        if self.number >= self.samples_per_period {
            self.number = 0;
        }
    }
}

/// The order of a campaign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CampaignOrder<T> {
    rules: CampaignRules<T>,
    stages: usize,
    phase: CampaignPhase,
    now: Play<T>,
    before: Play<T>,
    /// Samples of the passage so far, and of the whole.
    passed: u32,
    passage: u32,
    /// Samples that are still to settle behind the passage.
    settling: u32,
    runs: u32,
    runs_of_stage: u32,
    back_offs: u32,
    /// The largest share of its limit that any input reached in this run.
    peak: T,
}

impl<T: Real> CampaignOrder<T> {
    /// A campaign of so many stages, before its first sample; the first stage has so many samples in a period.
    #[must_use]
    pub fn new(rules: CampaignRules<T>, stages: usize, samples_per_period: u32) -> Self {
        let rest = Play { stage: 0, share: T::ZERO, samples_per_period, number: 0 };
        let mut this = Self {
            rules,
            stages,
            phase: CampaignPhase::Settling,
            now: rest,
            before: rest,
            passed: 0,
            passage: 0,
            settling: 0,
            runs: 0,
            runs_of_stage: 0,
            back_offs: 0,
            peak: T::ZERO,
        };
        this.begin(Play { share: T::ONE, ..rest });
        if stages == 0 {
            this.end(CampaignEnd::Stages);
        }
        this
    }

    /// Where the campaign is.
    #[must_use]
    pub fn phase(&self) -> CampaignPhase {
        self.phase
    }

    /// Runs that were begun.
    #[must_use]
    pub fn runs(&self) -> u32 {
        self.runs
    }

    /// The pattern that is played, the one before it, and the share of the way between them in radians, from 0 to pi; pi behind the passage.
    #[must_use]
    pub fn plays(&self) -> (Play<T>, Play<T>, T) {
        let share = if self.passed < self.passage { f64::from(self.passed) / f64::from(self.passage) } else { 1.0 };
        (self.now, self.before, T::from_f64(core::f64::consts::PI * share))
    }

    /// Radians of the passage in a sample; zero behind the passage.
    #[must_use]
    pub fn passage_step(&self) -> T {
        if self.passed < self.passage { T::PI / T::from_f64(f64::from(self.passage)) } else { T::ZERO }
    }

    /// Goes on by a sample in which the inputs reached this share of their limits and `beyond` says whether a limit was met. Says whether
    /// the next sample is the first of those that are measured.
    pub fn advance(&mut self, effort: T, beyond: bool) -> bool {
        self.peak = self.peak.max(effort);
        self.now.advance();
        self.before.advance();
        let passing = self.passed < self.passage;
        if passing {
            self.passed += 1;
        }
        if matches!(self.phase, CampaignPhase::Ended(_)) {
            self.come_to_rest();
            return false;
        }
        if beyond {
            self.give_up(passing);
            return false;
        }
        if self.phase == CampaignPhase::Settling && self.passed >= self.passage {
            if self.settling == 0 && self.now.number == 0 {
                self.phase = CampaignPhase::Measuring;
                return true;
            }
            self.settling = self.settling.saturating_sub(1);
        }
        false
    }

    /// All samples of the run were taken in: an update is due.
    pub fn run_is_whole(&mut self) {
        if self.phase == CampaignPhase::Measuring {
            self.phase = CampaignPhase::Due;
        }
    }

    /// Goes on behind an update. `samples_per_period` has that of a stage.
    pub fn updated(&mut self, samples_per_period: impl Fn(usize) -> u32) {
        if self.phase != CampaignPhase::Due {
            return;
        }
        self.runs_of_stage += 1;
        let repeated = self.runs_of_stage < self.rules.runs_per_stage;
        if self.runs >= self.rules.most_runs {
            return self.end(CampaignEnd::Runs);
        }
        if repeated {
            return self.begin(self.now);
        }
        let stage = self.now.stage + 1;
        if stage >= self.stages {
            return self.end(CampaignEnd::Stages);
        }
        if self.peak >= self.rules.effort {
            return self.end(CampaignEnd::Effort);
        }
        self.runs_of_stage = 0;
        self.back_offs = 0;
        self.begin(Play { stage, share: T::ONE, samples_per_period: samples_per_period(stage), number: 0 });
    }

    /// Ends the campaign: the machine passes to rest.
    pub fn end(&mut self, end: CampaignEnd) {
        if !matches!(self.phase, CampaignPhase::Ended(_)) {
            self.phase = CampaignPhase::Ended(end);
            self.come_to_rest();
        }
    }

    /// Begins a run; a pattern that goes on needs no passage.
    fn begin(&mut self, next: Play<T>) {
        self.runs += 1;
        self.peak = T::ZERO;
        self.phase = CampaignPhase::Settling;
        self.settling = next.samples_per_period.saturating_mul(self.rules.settle_periods);
        if next != self.now {
            self.pass(next);
        }
    }

    fn pass(&mut self, next: Play<T>) {
        self.before = self.now;
        self.now = next;
        self.passed = 0;
        self.passage = self.before.samples_per_period.max(next.samples_per_period);
    }

    /// Begins a smaller run, or ends the campaign. The passage to a pattern that meets a limit is played backwards.
    fn give_up(&mut self, passing: bool) {
        self.back_offs += 1;
        if passing {
            core::mem::swap(&mut self.now, &mut self.before);
            self.passed = self.passage - self.passed;
            return self.end(CampaignEnd::Limit);
        }
        if self.back_offs > MOST_BACK_OFFS || self.runs >= self.rules.most_runs {
            return self.end(if self.back_offs > MOST_BACK_OFFS { CampaignEnd::Limit } else { CampaignEnd::Runs });
        }
        self.begin(Play { share: self.now.share * T::from_f64(BACK_OFF), ..self.now });
    }

    /// Passes to rest where no passage is played any more.
    fn come_to_rest(&mut self) {
        if self.passed >= self.passage && self.now.share.abs() > T::ZERO {
            self.pass(Play { share: T::ZERO, ..self.now });
        }
    }
}

/// A motion on its way from one to another: derivative n of entry c stands at `n * entries + c`, and `step` has the radians of the
/// passage in a second. The way is `(1 - p)/2` with the rest-to-rest pattern p of three harmonics, five of whose derivatives are zero at both
/// ends.
pub fn passing<T: Real, const N: usize>(before: &[T; N], now: &[T; N], entries: usize, at: T, step: T) -> [T; N] {
    if at >= T::PI {
        return *now;
    }
    let entries = entries.max(1);
    let way = |order: u32| -> T {
        // cos a - 1/6 cos 3a + 1/50 cos 5a is 64/75 at 0.
        let terms = [(1.0, 1.0), (3.0, -1.0 / 6.0), (5.0, 1.0 / 50.0)];
        let turned = T::PI / T::from_f64(2.0) * T::from_f64(f64::from(order));
        let sum = terms.iter().fold(T::ZERO, |sum, &(harmonic, share)| {
            let harmonic = T::from_f64(harmonic);
            sum + T::from_f64(share) * (harmonic * step).powi(order) * (harmonic * at + turned).cos()
        });
        let half = T::from_f64(if order == 0 { 0.5 } else { 0.0 });
        half - sum * T::from_f64(75.0 / 128.0)
    };
    core::array::from_fn(|place| {
        let (order, entry) = (place / entries, place % entries);
        let mut sum = before.get(place).copied().unwrap_or(T::ZERO);
        let mut binomial = 1.0;
        for k in 0..=order {
            let at = (order - k) * entries + entry;
            let apart = now.get(at).copied().unwrap_or(T::ZERO) - before.get(at).copied().unwrap_or(T::ZERO);
            sum += T::from_f64(binomial) * way(k as u32) * apart;
            binomial = binomial * (order - k) as f64 / (k + 1) as f64;
        }
        sum
    })
}

/// The parameters that all runs show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pooled<T, const P: usize> {
    /// The parameters; nothing for those that no run shows.
    pub values: [Option<T>; P],
    /// Their standard deviations.
    pub deviations: [Option<T>; P],
    /// Their covariance; zero for those that no run shows.
    pub covariance: [[T; P]; P],
}

/// What the runs of a campaign say together, as equations for the step from `centre`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunPool<T, const P: usize> {
    factor: SquareRoot<T, P>,
    centre: [T; P],
}

impl<T: Real, const P: usize> RunPool<T, P> {
    /// No run yet.
    #[must_use]
    pub fn new(centre: [T; P]) -> Self {
        Self { factor: SquareRoot::default(), centre }
    }

    /// Takes in the equations of a run for the step from `about`, which count by `1 / max(chi_squared, 1)`; gives what all
    /// runs show.
    pub fn take(&mut self, run: &SquareRoot<T, P>, about: &[T; P], chi_squared: T) -> Pooled<T, P> {
        let mut by = [T::ZERO; P];
        for ((by, about), centre) in by.iter_mut().zip(about).zip(&mut self.centre) {
            *by = *about - *centre;
            *centre = *about;
        }
        self.factor.move_by(&by);
        let mut run = *run;
        run.fade(T::ONE / chi_squared.max(T::ONE));
        self.factor.pool(&run);
        let shown = self.factor.solution();
        let mut values = [None; P];
        for ((value, step), centre) in values.iter_mut().zip(shown.solution).zip(self.centre) {
            *value = step.map(|step| centre + step);
        }
        Pooled { values, deviations: shown.deviations, covariance: shown.covariance }
    }
}
