/* Inputs and 2 x 9 regressor of the closed-loop arm from (th1, th2, th1', th2', th1'', th2''), a10 to a32, (th10, th20). */
#ifndef PEERS_H
#define PEERS_H

void hand_arm(const double *motion, const double *theta, const double *constants, double *tau, double *phi);
void sympy_arm(const double *motion, const double *theta, const double *constants, double *tau, double *phi);

#endif
