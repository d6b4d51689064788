/* A tree with loops: its accelerations, and its states brought back onto the constraints. */
#ifndef PINARM_CONSTRAINTS_H
#define PINARM_CONSTRAINTS_H

#include "loops.h"
#include "skyline.h"

/* How multipliers are found where rows may be redundant: (S + term 1) lam_(k+1) = b + term lam_k. */
typedef struct {
    double term;     /* [1/kg] */
    double accuracy; /* it ends where term |lam_(k+1) - lam_k| is no larger */
    int repeats;     /* most iterations */
} proximal;

/* When a closed position is regular; the numbers stand in pinarm/engine/motion/systems/point_constrained.py. */
typedef struct {
    double usual;                              /* regularity of positions of no special kind */
    double near, ahead, coarse, close;         /* limits of the regularity relative to that, and of its fall */
    double vanished;                           /* square of a singular value that is 0, relative to the largest */
    double accuracy;                           /* of the squares of singular values */
    int rank;                                  /* of G along the motion */
} regularity;

typedef struct {
    const tree *tree;
    int loops, path_length, support_length;
    const loop *loop;
    const int *path, *dof;   /* links and velocities that move each loop joint, links in descending order */
    loop_state *loop_state;
    skyline delassus;        /* rows of all loop joints */
    force *carried;          /* MOST_ROWS for each link: forces of the rows on their way to the root; 0 between uses */
    double *reduced;         /* MOST_ROWS for each entry of `dof` */
    double *spread;          /* MOST_ROWS for each velocity; 0 between uses */
    double *weight;          /* nv */
    double *generalised, *change; /* nv */
    double *right, *multiplier, *before; /* as many as there are rows */
    double *saved;           /* nq + nv */
    proximal solve;
    double projection;       /* the same term of projections [1/kg] */
    double closed, stalled;  /* gaps that are rounding, and at which the iteration may end [m] */
    double torn;             /* largest length of G a + G' v at accepted states */
    int corrections;         /* most corrections of a position */
    regularity limits;
    double regular;          /* regularity of the last closed position */
} constraints;

/* Return 0 where all indices are within their arrays and all numbers finite, else 1. */
int constraints_check(const constraints *c);

/* The rates of a state y = [q, v], for the integrator: normalise q within y, and write [q', a]. */
void constraints_rates(const void *system, double time, double *y, double *slope);

/* Bring an accepted state onto the constraints and write its slope; return 0.
 *
 * Where the position is not regular, or the accelerations leave the constraints, leave the state as it was and return 1.
 */
int constraints_settle(void *system, double time, double *y, double *slope);

#endif
