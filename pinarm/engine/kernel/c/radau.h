/* Radau IIA methods with variable steps, for one stiff motion that needs no settling.
 * Source: Hairer, Wanner, Solving Ordinary Differential Equations II, 2nd edition, section IV.8.
 * What is decided here, and the numbers, are those of pinarm/engine/integration/methods/stiff.py. */
#pragma once

#include <complex.h>

#include "steps.h"

/* A method of s stages. A^-1 has m = (s + 1) / 2 eigenvalues: the first, which is real, and one of each pair. */
typedef struct {
    ptrdiff_t stages, systems;        /* s, m */
    const double *c;                  /* s nodes */
    const double *inverse;            /* A^-1, s rows of s */
    const double *powers;             /* values at the nodes to coefficients of x .. x^s, s rows of s */
    const double *error;              /* weights of Z in the error estimate, s */
    const double complex *eigenvalue; /* lambda_i, m */
    const double complex *forth;      /* into the eigenvectors: m rows of s */
    const double complex *back;       /* out of them, x = Re(back forth x): s rows of m */
    ptrdiff_t iterations;             /* most iterations of Newton's method */
    double enough;                    /* its error over the tolerance */
    double contraction;               /* rate of convergence below which a Jacobian serves the next step too */
    double kept;                      /* factor up to which a step is kept, so that its systems serve again */
} radau;

/* What is kept from step to step; at the beginning of a motion `known`, `before` and `promise` are 0, 0 and 1, and at
 * that of an interval `known` and `length` are 0. */
typedef struct {
    double *slope;          /* f(y), n */
    double *jacobian;       /* J, df_i / dy_j in row i, n rows of n */
    double complex *system; /* L and U of lambda_i / h - J, m blocks of n rows of n */
    ptrdiff_t *pivot;       /* rows that were exchanged, m rows of n */
    double complex *right;  /* right sides and solutions, m rows of n */
    double *last, *change;  /* Z of the last step, and what is added to Z: s rows of n each */
    double length, factorised; /* of the last step in the interval, and of that whose systems these are; 0 of none */
    double rate, promise;   /* of Newton's convergence, and rate / (1 - rate) */
    double before, worst;   /* length and error of the last accepted step */
    ptrdiff_t iterations;   /* that the last step took */
    ptrdiff_t evaluations;  /* of f, in this call */
    ptrdiff_t *spent;       /* of these, up to the end of each written step, room */
    int known, fresh;       /* whether J is that of a state nearby, and that of the present one */
} newton;

/* Take steps as long as the course continues. Its `slopes` are Z_i = Y_i - y of the stages of each step; `scratch` has
 * 3 n numbers. */
void radau_steps(const radau *p, const flow *f, const control *c, course *m, newton *x);
