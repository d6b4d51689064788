/* Embedded explicit Runge-Kutta pairs with variable steps and dense output, for one motion.
 * Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd edition, chapter II. */
#pragma once

#include <stddef.h>

/* The coefficients of a pair of s stages; k_s, behind the stages, is the slope at the end of the step. */
typedef struct {
    ptrdiff_t stages;                /* s */
    ptrdiff_t estimates;             /* number of error estimates */
    ptrdiff_t dense_stages;          /* e, further stages that only the dense output needs */
    ptrdiff_t dense_terms;           /* d, its terms beyond the first three */
    ptrdiff_t order;                 /* the error behaves like h^order */
    const double *a;                 /* s rows of s, row 0 not used */
    const double *b;                 /* s weights of the step */
    const double *c;                 /* s */
    const double *error;             /* a row of s + 1 for each estimate */
    const double *dense_a, *dense_c; /* e rows of s + 1 + e, and e */
    const double *dense_d;           /* d rows of s + 1 + e */
} pair;

/* What is integrated: y of n numbers. `rates` writes its slope, and projects y onto the space it belongs to. `settle`,
 * if there is one, brings an accepted state back onto constraints, writes its slope and returns 1, or returns 0 and
 * leaves the state, where the steps have to end there. */
typedef struct {
    ptrdiff_t n;
    void (*rates)(void *system, double time, double *y, double *slope);
    int (*settle)(void *system, double time, double *y, double *slope);
    const double *floor; /* the smallest useful step: 0, unless rounding is amplified */
    void *system;
} flow;

/* Step control. Its numbers stand in pinarm/engine/integration: step_control.py and driver.py. */
typedef struct {
    double tolerance, size;                /* errors are relative to tolerance (size + |y|) */
    double safety, gain, slowest, fastest; /* of the next step */
    double lost, huge, tiny;               /* of errors that are infinite, or 0 */
    double shortest;                       /* least step, in units in the last place of the time */
    double noise;                          /* errors, relative to size + |y|, that amplified rounding explains */
} control;

/* A motion on an interval without jumps: where it is, and where its steps are written. */
typedef struct {
    double t, start, end;
    double h, ceiling;       /* next step, and the largest factor by which the one after it may be longer */
    ptrdiff_t tries, room;   /* steps that may be tried, rejected ones included, and that may be written */
    ptrdiff_t written, rejected; /* steps that have been */
    ptrdiff_t handed;        /* 1 where the steps ended because the last state is not settled */
    double *y;               /* present state, n */
    double *scratch;         /* 2 n */
    double *starts, *lengths, *ends; /* t, h and t + h of the written steps, room each */
    ptrdiff_t *rejections;   /* steps rejected before each, since the beginning of the call, room */
    int *floored;            /* whether each was accepted as rounding, room */
    double *states;          /* y at the start of each, room rows of n */
    double *slopes;          /* k_0 .. k_s of each, room + 1 blocks of s + 1 rows of n; the first k_0 is given */
} course;

/* Take steps until the end of the interval, or until there is no room or no try left, or the step is too short. */
void pair_steps(const pair *p, const flow *f, const control *c, course *m);

/* Numbers of a system that were others in each step: `count` of them, `stride` apart from `place` on. */
typedef struct {
    double *place;
    ptrdiff_t stride, count;
    const double *values; /* a row of `count` for each step */
} held;

/* Write the terms of the dense output of m steps, 3 + d rows of n for each; `scratch` has (s + 2 + e) n numbers. */
void pair_terms(const pair *p, const flow *f, const held *x, ptrdiff_t m, const double *starts, const double *lengths,
                const double *states, const double *slopes, double *scratch, double *terms);
