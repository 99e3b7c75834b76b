//! The order of a campaign on the controller: which pattern is played, when a run is measured, when an update is due, how far the next run
//! goes, and why the campaign ends (Feng, chapter 3, the five steps).
//!
//! A campaign begins at rest where all amplitudes are zero. Every change of amplitude or frequency is a smooth passage from the one
//! pattern to the other, both played on meanwhile; then the new one settles, is measured for whole periods and goes on until the update
//! is made. A run that meets a limit is given up for one of smaller amplitudes.
//!
//! Invariants: nothing allocates; a campaign ends after a bounded number of samples if updates are made; an ended one comes to rest.

use super::run_lines::angle;
use super::{Real, RunEstimate, RunFault, Solution, SquareRoot};

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

/// Where an order is, without why it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CampaignState {
    /// A run passes to its pattern and settles.
    Settling,
    /// The samples of a run are taken in.
    Measuring,
    /// The run is whole: an update is due, the pattern goes on.
    Due,
    /// The campaign has ended, and the machine comes to rest.
    Ended,
}

/// Why an order ended, without the fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CampaignReason {
    /// It has not.
    None,
    /// All stages were played.
    Stages,
    /// All runs were used.
    Runs,
    /// An input has reached the stated share of its limit.
    Effort,
    /// A limit was met again and again, or on the way from one pattern to the next.
    Limit,
    /// A run could not be used: the campaign's status says why.
    Fault,
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
        angle(self.number, self.samples_per_period.max(1))
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
    /// Where the campaign is, why it ended, and the fault of a run where that is the reason.
    state: CampaignState,
    reason: CampaignReason,
    status: Result<(), RunFault>,
    rules: CampaignRules<T>,
    stages: usize,
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
            state: CampaignState::Settling,
            reason: CampaignReason::None,
            status: Ok(()),
            rules,
            stages,
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
        this.start(&rules, stages, samples_per_period);
        this
    }

    /// Begins a campaign of so many stages; the first one has so many samples in a period.
    pub fn start(&mut self, rules: &CampaignRules<T>, stages: usize, samples_per_period: u32) {
        let mut play = Play { stage: 0, share: T::ZERO, samples_per_period, number: 0 };
        self.state = CampaignState::Settling;
        self.reason = CampaignReason::None;
        self.status = Ok(());
        self.rules = *rules;
        self.stages = stages;
        self.now = play;
        self.before = play;
        self.passed = 0;
        self.passage = 0;
        self.runs = 0;
        self.runs_of_stage = 0;
        self.back_offs = 0;
        play.share = T::ONE;
        self.begin(play);
        if stages == 0 {
            self.finish(CampaignReason::Stages);
        }
    }

    /// Where the campaign is.
    #[must_use]
    pub fn phase(&self) -> CampaignPhase {
        let end = match (self.reason, self.status) {
            (CampaignReason::None, _) => {
                return match self.state {
                    CampaignState::Measuring => CampaignPhase::Measuring,
                    CampaignState::Due => CampaignPhase::Due,
                    CampaignState::Settling | CampaignState::Ended => CampaignPhase::Settling,
                };
            }
            (CampaignReason::Fault, Err(fault)) => CampaignEnd::Fault(fault),
            (CampaignReason::Stages, _) => CampaignEnd::Stages,
            (CampaignReason::Runs, _) => CampaignEnd::Runs,
            (CampaignReason::Effort, _) => CampaignEnd::Effort,
            (CampaignReason::Limit, _) => CampaignEnd::Limit,
            (CampaignReason::Fault | CampaignReason::Stopped, _) => CampaignEnd::Stopped,
        };
        CampaignPhase::Ended(end)
    }

    /// Runs that were begun.
    #[must_use]
    pub fn runs(&self) -> u32 {
        self.runs
    }

    /// The pattern that is played, and the one before it.
    #[must_use]
    pub fn plays(&self) -> (Play<T>, Play<T>) {
        (self.now, self.before)
    }

    /// The share of the way between the patterns in radians, from 0 to pi; pi behind the passage.
    #[must_use]
    pub fn passage_at(&self) -> T {
        if self.passed < self.passage {
            T::PI * T::from_f64(f64::from(self.passed)) / T::from_f64(f64::from(self.passage))
        } else {
            T::PI
        }
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
        if self.state == CampaignState::Ended {
            self.come_to_rest();
        } else if beyond {
            self.give_up(passing);
        } else if self.state == CampaignState::Settling && self.passed >= self.passage {
            if self.settling == 0 && self.now.number == 0 {
                self.state = CampaignState::Measuring;
                return true;
            }
            self.settling = self.settling.saturating_sub(1);
        }
        false
    }

    /// All samples of the run were taken in: an update is due.
    pub fn run_is_whole(&mut self) {
        if self.state == CampaignState::Measuring {
            self.state = CampaignState::Due;
        }
    }

    /// Goes on behind an update. The next stage has so many samples in a period, if there is one.
    pub fn updated(&mut self, samples_per_period: u32) {
        if self.state != CampaignState::Due {
            return;
        }
        let stage = self.now.stage + 1;
        self.runs_of_stage += 1;
        if self.runs >= self.rules.most_runs {
            self.finish(CampaignReason::Runs);
        } else if self.runs_of_stage < self.rules.runs_per_stage {
            let same = self.now;
            self.begin(same);
        } else if stage >= self.stages {
            self.finish(CampaignReason::Stages);
        } else if self.peak >= self.rules.effort {
            self.finish(CampaignReason::Effort);
        } else {
            let next = Play { stage, share: T::ONE, samples_per_period, number: 0 };
            self.runs_of_stage = 0;
            self.back_offs = 0;
            self.begin(next);
        }
    }

    /// Ends the campaign by the caller's wish: the machine passes to rest.
    pub fn stop(&mut self) {
        self.finish(CampaignReason::Stopped);
    }

    /// Ends the campaign by a fault of a run: the machine passes to rest.
    pub fn fail(&mut self, fault: RunFault) {
        if self.state != CampaignState::Ended {
            self.status = Err(fault);
            self.finish(CampaignReason::Fault);
        }
    }

    fn finish(&mut self, reason: CampaignReason) {
        if self.state != CampaignState::Ended {
            self.state = CampaignState::Ended;
            self.reason = reason;
            self.come_to_rest();
        }
    }

    /// Begins a run; a pattern that goes on needs no passage.
    fn begin(&mut self, next: Play<T>) {
        let same = next.stage == self.now.stage && next.share >= self.now.share && next.share <= self.now.share;
        self.runs += 1;
        self.peak = T::ZERO;
        self.state = CampaignState::Settling;
        self.settling = self.rules.settle_periods.saturating_mul(next.samples_per_period);
        if !same {
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
    #[allow(clippy::manual_swap, reason = "of the subset that is printed as C")]
    fn give_up(&mut self, passing: bool) {
        self.back_offs += 1;
        if passing {
            let now = self.now;
            self.now = self.before;
            self.before = now;
            self.passed = self.passage - self.passed;
            self.finish(CampaignReason::Limit);
        } else if self.back_offs > MOST_BACK_OFFS {
            self.finish(CampaignReason::Limit);
        } else if self.runs >= self.rules.most_runs {
            self.finish(CampaignReason::Runs);
        } else {
            let mut next = self.now;
            next.share *= T::from_f64(BACK_OFF);
            self.begin(next);
        }
    }

    /// Passes to rest where no passage is played any more.
    fn come_to_rest(&mut self) {
        if self.passed >= self.passage && self.now.share.abs() > T::ZERO {
            let mut rest = self.now;
            rest.share = T::ZERO;
            self.pass(rest);
        }
    }
}

/// A derivative of the way: `(1 - p)/2` with the rest-to-rest pattern p of three harmonics, five of whose derivatives are zero at both ends;
/// `cos a - 1/6 cos 3a + 1/50 cos 5a` is 64/75 at 0.
fn way<T: Real>(at: T, step: T, order: usize) -> T {
    let mut sum = if order == 0 { T::from_f64(0.5) } else { T::ZERO };
    for term in 0..3 {
        let number = 2 * term + 1;
        let harmonic = T::from_f64(number as f64);
        let mut size = T::from_f64(75.0 / 128.0);
        if term == 1 {
            size = T::from_f64(-75.0 / 128.0 / 6.0);
        }
        if term == 2 {
            size = T::from_f64(75.0 / 128.0 / 50.0);
        }
        for _ in 0..order {
            size *= harmonic * step;
        }
        sum -= size * (harmonic * at + T::PI / T::from_f64(2.0) * T::from_f64(order as f64)).cos();
    }
    sum
}

/// A motion on its way from one to another, in the place of the latter: derivative n of entry c stands at `n * entries + c`, and `step` has
/// the radians of the passage in a second.
pub fn passing<T: Real, const M: usize>(before: &[T; M], now: &mut [T; M], entries: usize, at: T, step: T) {
    if at >= T::PI || entries == 0 {
        return;
    }
    let mut apart = [T::ZERO; M];
    for place in 0..M {
        apart[place] = now[place] - before[place];
    }
    for place in 0..M {
        let order = place / entries;
        let mut binomial = T::ONE;
        now[place] = before[place];
        for k in 0..=order {
            let (left, next) = (order - k, k + 1);
            let at_order = left * entries + place % entries;
            now[place] += binomial * way(at, step, k) * apart[at_order];
            binomial = binomial * T::from_f64(left as f64) / T::from_f64(next as f64);
        }
    }
}

/// What the runs of a campaign say together, as equations for the step from `centre`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunPool<T, const P: usize> {
    pub(super) factor: SquareRoot<T, P>,
    pub(super) centre: [T; P],
}

impl<T: Real, const P: usize> RunPool<T, P> {
    /// Forgets all runs.
    pub fn clear(&mut self, centre: &[T; P]) {
        self.factor.clear();
        self.centre = *centre;
    }

    /// No run yet.
    #[must_use]
    pub fn new(centre: [T; P]) -> Self {
        Self { factor: SquareRoot::default(), centre }
    }

    /// What all runs show, as one run would.
    #[must_use]
    pub fn shown<const Q: usize>(&self, noise: [T; Q]) -> RunEstimate<T, Q, P> {
        RunEstimate::of(&self.factor, &self.centre, T::ONE, noise)
    }

    /// The parameters that all runs show: what they show in combinations alone moves the parameters in them as little as it can, and what
    /// they do not show stays.
    #[must_use]
    pub fn moved(&self) -> [T; P] {
        let mut found = Solution::default();
        self.factor.solve(&mut found);
        let mut moved = self.centre;
        for place in 0..P {
            moved[place] += found.steps[place];
        }
        moved
    }

    /// Takes in the equations of a run for the step from `about`, which count by `1 / max(chi_squared, 1)` and are faded by it.
    pub fn add(&mut self, run: &mut SquareRoot<T, P>, about: &[T; P], chi_squared: T) {
        let mut by = [T::ZERO; P];
        for place in 0..P {
            by[place] = about[place] - self.centre[place];
            self.centre[place] = about[place];
        }
        self.factor.move_by(&by);
        run.fade(T::ONE / chi_squared.max(T::ONE));
        self.factor.pool(run);
    }
}
