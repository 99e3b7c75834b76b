/* The generated monitor of the slider, fed with samples from standard input. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "slider.h"

static slider_monitor_rules rules;
static slider_monitor monitor;

int main(void)
{
    static const double values[3] = {2.0, 30.0, 8.0};
    double given[4];
    char words[4][32];
    int whole, i, ended = 0;
    long count = 0;

    for (i = 0; i < 3; ++i) {
        rules.values[i] = (REAL)values[i];
        rules.spread[i][i] = (REAL)(0.003 * values[i]);
        rules.changes[i] = (REAL)(0.1 * values[i]);
    }
    rules.drifts[2] = (REAL)2.5;
    rules.sample_time = (REAL)0.02;
    rules.false_alarms = (REAL)1e-3;
    rules.block = 50;
    rules.run_in = 20;
    /* A deviation of zero is refused. */
    if (slider_monitor_begin(&monitor, &rules) == SLIDER_OK) {
        return 1;
    }
    for (i = 0; i < (int)(sizeof rules.deviations / sizeof(REAL)); ++i) {
        const REAL one = (REAL)1.0;
        memcpy((char *)&rules.deviations + (size_t)i * sizeof one, &one, sizeof one);
    }
    if (slider_monitor_begin(&monitor, &rules) != SLIDER_OK) {
        return 1;
    }
    while (!ended && scanf("%31s %31s %31s %31s %d", words[0], words[1], words[2], words[3], &whole) == 5) {
        slider_motion motion;
        slider_forces applied;
        REAL q[3], force;
        slider_monitor_state state;
        for (i = 0; i < 4; ++i) {
            given[i] = (double)NAN;
            if (sscanf(words[i], "%lf", &given[i]) != 1) {
                return 1;
            }
        }
        for (i = 0; i < 3; ++i) {
            q[i] = (REAL)given[i];
        }
        force = (REAL)given[3];
        memcpy(&motion, q, sizeof motion);
        memcpy(&applied, &force, sizeof applied);
        if (whole == 2) {
            slider_monitor_rest(&monitor, &motion);
            continue;
        }
        state = slider_monitor_push(&monitor, &motion, &applied, whole);
        /* A sample that is not whole is left out, and says so. */
        if (state != SLIDER_MONITOR_MOVED && state != SLIDER_MONITOR_UNEXPLAINED
            && (state == SLIDER_MONITOR_LEFT_OUT) != (!whole || isnan(given[1]))) {
            return 1;
        }
        ended = state == SLIDER_MONITOR_MOVED || state == SLIDER_MONITOR_UNEXPLAINED;
        ++count;
    }
    if (monitor.state == SLIDER_MONITOR_MOVED) {
        printf("%ld 3 %d %.17g %.17g\n", (count - 1) / 50, (int)monitor.moved, (double)monitor.change,
               (double)monitor.deviation);
    } else if (monitor.state == SLIDER_MONITOR_UNEXPLAINED) {
        printf("%ld 4 %.17g 0 0\n", (count - 1) / 50, (double)monitor.growth);
    } else {
        printf("%ld %d 0 0 0\n", count / 50, (int)monitor.state);
    }
    return 0;
}
