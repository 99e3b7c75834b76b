/* What a careful engineer writes; benches/src/by_hand.rs in C. */
#include "peers.h"

void hand_arm(const double *motion, const double *theta, const double *constants, double *tau, double *phi)
{
    const double *const t = theta;
    const double s = motion[1] - constants[1];
    const double d1 = motion[2], d2 = motion[3], dd1 = motion[4], dd2 = motion[5];
    const double s2 = s * s, ts = 2.0 * s;
    const double d11 = d1 * d1, d12 = d1 * d2, d22 = d2 * d2;
    const double a1 = 2.0 * dd1, a2 = 2.0 * dd2, c12 = 2.0 * d12;
    const double p1 = s * a1 + c12, p2 = s2 * a1 + ts * c12;
    const double p7 = s * dd2 + d22, p8 = s2 * dd2 + ts * d22;
    const double q1 = -d11, q2 = -(ts * d11);
    const double q4 = s * a2 + d22, q5 = s2 * a2 + ts * d22, q7 = s * dd1, q8 = s2 * dd1;

    tau[0] = a1 * t[0] + p1 * t[1] + p2 * t[2] + dd2 * t[6] + p7 * t[7] + p8 * t[8];
    tau[1] = q1 * t[1] + q2 * t[2] + a2 * t[3] + q4 * t[4] + q5 * t[5] + dd1 * t[6] + q7 * t[7] + q8 * t[8];
    phi[0] = a1;
    phi[1] = p1;
    phi[2] = p2;
    phi[3] = phi[4] = phi[5] = 0.0;
    phi[6] = dd2;
    phi[7] = p7;
    phi[8] = p8;
    phi[9] = 0.0;
    phi[10] = q1;
    phi[11] = q2;
    phi[12] = a2;
    phi[13] = q4;
    phi[14] = q5;
    phi[15] = dd1;
    phi[16] = q7;
    phi[17] = q8;
}
