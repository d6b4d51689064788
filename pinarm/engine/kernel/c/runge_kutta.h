/* Embedded explicit Runge-Kutta pairs with variable steps, for one motion.
 * Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd edition, chapter II. */
#pragma once

#include "steps.h"

/* The coefficients of a pair of s stages; k_s, behind the stages, is the slope at the end of the step. */
typedef struct {
    ptrdiff_t stages, estimates;     /* s, and number of error estimates */
    ptrdiff_t order;                 /* the error behaves like h^order */
    const double *a;                 /* s rows of s, row 0 not used */
    const double *b, *c;             /* s weights of the step, and s nodes */
    const double *error;             /* a row of s + 1 for each estimate */
} pair;

/* Take steps as long as the course continues. Its `slopes` are k_0 .. k_s of each step, of which the first is given;
 * `scratch` has 2 n numbers. */
void pair_steps(const pair *p, const flow *f, const control *c, course *m);
