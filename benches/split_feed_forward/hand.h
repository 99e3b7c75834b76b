/* Feed-forward of the cart-pendulum in two parts, Feng, Eqns 6.6 and 6.7: from (x, theta, x', theta', x'', theta'') and
 * (M + m, m L, m L^2), the forces (F, tau). */
#ifndef HAND_H
#define HAND_H

typedef struct hand_filters {
    /* Per input: the last two samples that came in and that went out, the newest first. */
    double past[2][4];
} hand_filters;

void hand_parts(const double *motion, const double *theta, double *independent, double *dependent);
void hand_split(hand_filters *filters, const double *motion, const double *theta, double *forces);

#endif
