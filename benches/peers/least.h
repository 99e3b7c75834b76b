/* The least CPU time of a piece of work in microseconds, over batches of a millisecond: a virtual machine halves its speed now
   and then. */
#include <time.h>

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e6 * t.tv_sec + 1e-3 * t.tv_nsec;
}

static double batch_of(long batch, void (*work)(void)) {
    double start = now();
    for (long i = 0; i < batch; i++) work();
    return now() - start;
}

static double least(double seconds, void (*work)(void)) {
    long batch = 1;
    while (batch_of(batch, work) < 1000) batch *= 2;
    double found = batch_of(batch, work), end = now() + 1e6 * seconds;
    for (long n = 1; now() < end || n < 5; n++) {
        double once = batch_of(batch, work);
        if (once < found) found = once;
    }
    return found / batch;
}
