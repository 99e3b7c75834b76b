/* What a careful engineer writes. */
#include <math.h>

#include "hand.h"

void hand_parts(const double *motion, const double *theta, double *independent, double *dependent)
{
    const double sine = sin(motion[1]), cosine = cos(motion[1]);
    const double speed = motion[3], xdd = motion[4], thdd = motion[5];
    const double ml = theta[1];

    independent[0] = ml * (cosine * thdd - speed * speed * sine);
    independent[1] = ml * cosine * xdd;
    dependent[0] = theta[0] * xdd;
    dependent[1] = theta[2] * thdd;
}

/* 100 rad/s, Q = 1, 1 kHz: bilinear, warped. */
static double low_pass(double *past, double input)
{
    const double output = 0.0023791576428724326 * (input + 2.0 * past[0] + past[1]) + 1.8953963821890656 * past[2] -
                          0.9049130127605554 * past[3];

    past[1] = past[0];
    past[0] = input;
    past[3] = past[2];
    past[2] = output;
    return output;
}

void hand_split(hand_filters *filters, const double *motion, const double *theta, double *forces)
{
    double independent[2], dependent[2];

    hand_parts(motion, theta, independent, dependent);
    forces[0] = independent[0] + low_pass(filters->past[0], dependent[0]);
    forces[1] = independent[1] + low_pass(filters->past[1], dependent[1]);
}
