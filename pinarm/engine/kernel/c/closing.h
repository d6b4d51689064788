/* Motions along loops: states brought back onto the constraints, and singular positions passed.
 * What is decided here, and the numbers, are those of pinarm/engine/motion/systems/loop_motion.py. */
#pragma once

#include "constraints.h"

/* When a position is regular; of squares of singular values relative to the largest, and of the regularity
 * s_r / s_1 / usual, s being the singular values of G in descending order and r the rank along the motion. */
typedef struct {
    double usual;                     /* s_r / s_1 at positions of no special kind */
    double near, ahead, blind;        /* limits of the regularity, and of its fall over a step */
    double vanished, accuracy;        /* squares that are 0, and how well they are known */
    double aside, across[8];          /* how far beside a singular position others are, and their weights */
    double passed;                    /* gap at the position so interpolated up to which it is passed */
    double floor;                     /* least step close to singular positions, relative to a regular one */
    int rank;
} limits;

typedef struct {
    constraints rows;
    proximal exact, tolerant; /* of closed states; of stages in regular steps, 0 repeats where it is not known */
    double projection;        /* proximal term of projections [1/kg] */
    double closed, stalled;   /* gaps that are rounding, and at which the iteration may end */
    double torn;              /* largest length of G a + G' v at accepted states */
    int corrections;          /* most corrections of a position; 0 where states are settled elsewhere */
    limits limits;
    const double *scale;      /* unit of every velocity, nv */
    double *sum, *part, *aside; /* nv */
    double *state, *saved;    /* nq + nv */
    int near, met;            /* whether stages of the next step are closed, and whether those of any were */
    double regular, open;     /* regularity of the last closed position; gap at a singular one that is near */
    double t, step, floor;    /* its time, the length of the last regular step, and the least one now */
} closing;

/* The rates of a state y = [q, v], for the integrator: normalise q within y, and write [q', a]. */
void closing_rates(void *system, double time, double *y, double *slope);

/* Bring an accepted state onto the constraints, write its slope, and return 1.
 * Where the rank has grown, or the accelerations leave the constraints, leave all as it was and return 0. */
int closing_settle(void *system, double time, double *y, double *slope);
