//! C code of a campaign, before its names and sizes are filled in.
//!
//! Invariant: the order of a campaign is that of `tpm_controller::support` (`campaign`), in the caller's memory.

/// Declarations.
pub(super) const HEADER: &str = "
/* A stage of a campaign: amplitudes, and the samples of a period, which give the frequency. */
typedef struct STAGE {
    PATTERN pattern;
    uint32_t samples_per_period;
} STAGE;

/* What the caller decides about a campaign. */
typedef struct RULES {
    SAMPLING sampling;
    /* Periods that settle before a run is measured, behind the passage to it. */
    uint32_t settle_periods;
    /* Periods that are measured, an even number and at least four. */
    uint32_t periods;
    /* Runs of every stage. */
    uint32_t runs_per_stage;
    /* Runs of the whole campaign, those that were given up included. */
    uint32_t most_runs;
    /* Share of an input's limit from which on no larger stage is begun. */
    REAL effort;
} RULES;

/* What makes a campaign give up a run. */
typedef struct LIMITS {
    /* The limit of every input. */
    APPLIED inputs;
    /* The largest tracking error of every coordinate. */
    MEASURED tracking;
} LIMITS;

/* What the controller plays at a sample. */
typedef struct COMMAND {
    /* The reference of every measured coordinate. */
    MEASURED reference;
    /* The feed-forward; feedback of the measured less the reference is added to it. */
    APPLIED feed_forward;
} COMMAND;

/* Where a campaign is. */
typedef enum PHASE {
    /* A run passes to its pattern and settles. */
    SETTLING,
    /* The samples of a run are taken in. */
    MEASURING,
    /* The run is whole: an update is due, the pattern goes on. */
    DUE,
    /* The campaign has ended, and the machine comes to rest. */
    ENDED
} PHASE;

/* Why a campaign ended. */
typedef enum END {
    /* It has not. */
    END_NONE,
    /* All stages were played. */
    END_STAGES,
    /* All runs were used. */
    END_RUNS,
    /* An input has reached the stated share of its limit. */
    END_EFFORT,
    /* A limit was met again and again, or on the way from one pattern to the next. */
    END_LIMIT,
    /* A run could not be used: the campaign's status says why. */
    END_FAULT,
    /* The caller stopped it. */
    END_STOPPED
} END;

/* A pattern while it is played. */
typedef struct PLAY {
    size_t stage;
    /* The share of the stage's amplitudes: zero at rest. */
    REAL share;
    uint32_t samples_per_period;
    /* The sample of the period. */
    uint32_t number;
} PLAY;

/*
 * A whole campaign on the controller: the machine identifies itself. At every sample `command` has
 * reference and feed-forward, the controller adds its feedback and applies the sum, and the sample is
 * pushed. When a run is whole, an update is due; all runs are pooled by what they show. Read `phase`,
 * `end`, `status`, `runs`, `command`, `parameters` and, once `estimated` is 1, `estimate`.
 */
typedef struct CAMPAIGN {
    PHASE phase;
    END end;
    STATUS status;
    COMMAND command;
    /* The present estimates: the prior where no run has shown a parameter. */
    PARAMETERS parameters;
    int estimated;
    FOUND estimate;
    uint32_t runs;
    const STAGE *stages;
    size_t stage_count;
    RULES rules;
    LIMITS limits;
    PLAY now;
    PLAY before;
    uint32_t passed;
    uint32_t passage;
    uint32_t settling;
    uint32_t runs_of_stage;
    uint32_t back_offs;
    uint32_t number;
    REAL peak;
    REAL centre[COLUMNS];
    FACTOR pool;
    RUN run;
    WORKSPACE workspace;
} CAMPAIGN;
";

/// The order of a campaign, and the passage from one pattern to the next.
pub(super) const ORDER: &str = "
static void campaign_go_on(PLAY *play)
{
    ++play->number;
    if (play->number >= play->samples_per_period) {
        play->number = 0;
    }
}

static void campaign_pass(CAMPAIGN *campaign, PLAY next)
{
    campaign->before = campaign->now;
    campaign->now = next;
    campaign->passed = 0;
    campaign->passage = campaign->before.samples_per_period > next.samples_per_period
            ? campaign->before.samples_per_period : next.samples_per_period;
}

/* Passes to rest where no passage is played any more. */
static void campaign_come_to_rest(CAMPAIGN *campaign)
{
    if (campaign->passed >= campaign->passage && FABS(campaign->now.share) > ZERO) {
        PLAY rest = campaign->now;
        rest.share = ZERO;
        campaign_pass(campaign, rest);
    }
}

static void campaign_finish(CAMPAIGN *campaign, END end)
{
    if (campaign->phase != ENDED) {
        campaign->phase = ENDED;
        campaign->end = end;
        campaign_come_to_rest(campaign);
    }
}

static void campaign_fail(CAMPAIGN *campaign, STATUS status)
{
    if (campaign->phase != ENDED) {
        campaign->status = status;
        campaign_finish(campaign, END_FAULT);
    }
}

/* Begins a run; a pattern that goes on needs no passage. */
static void campaign_next_run(CAMPAIGN *campaign, PLAY next)
{
    const uint32_t settle = campaign->rules.settle_periods;
    const int same = next.stage == campaign->now.stage && !(next.share < campaign->now.share)
            && !(next.share > campaign->now.share);

    ++campaign->runs;
    campaign->peak = ZERO;
    campaign->phase = SETTLING;
    campaign->settling = settle > UINT32_MAX / next.samples_per_period ? UINT32_MAX
            : settle * next.samples_per_period;
    if (!same) {
        campaign_pass(campaign, next);
    }
}

/* Begins a smaller run, or ends the campaign. The passage to a pattern that meets a limit is played backwards. */
static void campaign_give_up(CAMPAIGN *campaign, int passing)
{
    ++campaign->back_offs;
    if (passing) {
        const PLAY now = campaign->now;
        campaign->now = campaign->before;
        campaign->before = now;
        campaign->passed = campaign->passage - campaign->passed;
        campaign_finish(campaign, END_LIMIT);
    } else if (campaign->back_offs > BACK_OFFS) {
        campaign_finish(campaign, END_LIMIT);
    } else if (campaign->runs >= campaign->rules.most_runs) {
        campaign_finish(campaign, END_RUNS);
    } else {
        PLAY next = campaign->now;
        next.share *= SMALLER;
        campaign_next_run(campaign, next);
    }
}

/* Goes on by a sample; 1 when the next sample is the first of those that are measured. */
static int campaign_advance(CAMPAIGN *campaign, REAL effort, int beyond)
{
    const int passing = campaign->passed < campaign->passage;

    if (effort > campaign->peak) {
        campaign->peak = effort;
    }
    campaign_go_on(&campaign->now);
    campaign_go_on(&campaign->before);
    if (passing) {
        ++campaign->passed;
    }
    if (campaign->phase == ENDED) {
        campaign_come_to_rest(campaign);
    } else if (beyond) {
        campaign_give_up(campaign, passing);
    } else if (campaign->phase == SETTLING && campaign->passed >= campaign->passage) {
        if (campaign->settling == 0 && campaign->now.number == 0) {
            campaign->phase = MEASURING;
            return 1;
        }
        if (campaign->settling > 0) {
            --campaign->settling;
        }
    }
    return 0;
}

/* Goes on behind an update. */
static void campaign_updated(CAMPAIGN *campaign)
{
    const size_t stage = campaign->now.stage + 1;

    ++campaign->runs_of_stage;
    if (campaign->runs >= campaign->rules.most_runs) {
        campaign_finish(campaign, END_RUNS);
    } else if (campaign->runs_of_stage < campaign->rules.runs_per_stage) {
        campaign_next_run(campaign, campaign->now);
    } else if (stage >= campaign->stage_count) {
        campaign_finish(campaign, END_STAGES);
    } else if (campaign->peak >= campaign->rules.effort) {
        campaign_finish(campaign, END_EFFORT);
    } else {
        PLAY next;
        next.stage = stage;
        next.share = ONE;
        next.samples_per_period = campaign->stages[stage].samples_per_period;
        next.number = 0;
        campaign->runs_of_stage = 0;
        campaign->back_offs = 0;
        campaign_next_run(campaign, next);
    }
}

/* A derivative of the share of the way: (1 - p)/2 with the rest-to-rest pattern p of three harmonics. */
static REAL campaign_way(REAL at, REAL step, size_t order)
{
    const REAL terms[3] = {ONE, -ONE / SIX, ONE / FIFTY};
    REAL sum = order == 0 ? HALF : ZERO;
    size_t i, k;

    for (i = 0; i < 3; ++i) {
        const REAL harmonic = (REAL)(2 * i + 1);
        REAL size = terms[i] * SCALE;
        for (k = 0; k < order; ++k) {
            size *= harmonic * step;
        }
        sum -= size * COS(harmonic * at + QUARTER * (REAL)order);
    }
    return sum;
}

/* A motion on its way from one to another, in the place of the latter. */
static void campaign_passing(const REAL before[PLACES], REAL now[PLACES], REAL at, REAL step)
{
    REAL apart[PLACES];
    size_t place, k;

    for (place = 0; place < PLACES; ++place) {
        apart[place] = now[place] - before[place];
    }
    for (place = 0; place < PLACES; ++place) {
        const size_t order = place / MOVED;
        REAL binomial = ONE;
        now[place] = before[place];
        for (k = 0; k <= order; ++k) {
            now[place] += binomial * campaign_way(at, step, k) * apart[(order - k) * MOVED + place % MOVED];
            binomial = binomial * (REAL)(order - k) / (REAL)(k + 1);
        }
    }
}

/* Takes the equations of the last run into the pool; the solution is in the workspace. */
static void campaign_take(CAMPAIGN *campaign, REAL chi_squared)
{
    const REAL share = chi_squared > ONE ? ONE / SQRT(chi_squared) : ONE;
    FACTOR *const pool = &campaign->pool;
    FACTOR *const run = &campaign->workspace.factor;
    const REAL rows = pool->rows + run->rows * share * share;
    size_t i, j;

    for (i = 0; i < COLUMNS; ++i) {
        for (j = 0; j < COLUMNS; ++j) {
            pool->right[i] -= pool->factor[i][j] * (campaign->workspace.about[j] - campaign->centre[j]);
        }
    }
    for (i = 0; i < COLUMNS; ++i) {
        campaign->centre[i] = campaign->workspace.about[i];
        for (j = 0; j < COLUMNS; ++j) {
            run->factor[i][j] *= share;
        }
        rotate_in(pool, run->factor[i], run->right[i] * share);
    }
    pool->residual = hypotenuse(pool->residual, run->residual * share);
    pool->rows = rows;
    run_solution_of(pool, &campaign->workspace.solution, &campaign->workspace.shown);
}
";
