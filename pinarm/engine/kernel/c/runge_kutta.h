/* Embedded explicit Runge-Kutta pairs with variable steps and dense output, for one motion.
 * Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd edition, chapter II. */
#pragma once

#include "steps.h"

/* The coefficients of a pair of s stages; k_s, behind the stages, is the slope at the end of the step. */
typedef struct {
    ptrdiff_t stages, estimates;     /* s, and number of error estimates */
    ptrdiff_t dense_stages;          /* e, further stages that only the dense output needs */
    ptrdiff_t dense_terms;           /* d, its terms beyond the first three */
    ptrdiff_t order;                 /* the error behaves like h^order */
    const double *a;                 /* s rows of s, row 0 not used */
    const double *b, *c;             /* s weights of the step, and s nodes */
    const double *error;             /* a row of s + 1 for each estimate */
    const double *dense_a, *dense_c; /* e rows of s + 1 + e, and e */
    const double *dense_d;           /* d rows of s + 1 + e */
} pair;

/* Take steps as long as the course continues. Its `slopes` are k_0 .. k_s of each step, of which the first is given;
 * `scratch` has 2 n numbers. */
void pair_steps(const pair *p, const flow *f, const control *c, course *m);

/* Write the terms of the dense output of m steps, 3 + d rows of n for each; `scratch` has (s + 2 + e) n numbers. */
void pair_terms(const pair *p, const flow *f, ptrdiff_t m, const double *starts, const double *lengths,
                const double *states, const double *slopes, double *scratch, double *terms);
