/* A tree with loops: the rows of its loop joints together, and its accelerations.
 * A loop joint ends at the last link that moves both of its frames, or at the world: no joint before this link moves it.
 * There its multipliers are eliminated as the velocities of joints are, which leaves a tree. */
#pragma once

#include "loops.h"
#include "skyline.h"

/* How multipliers are found where rows may be redundant: (S + term 1) lam_(k+1) = b + term lam_k, S = G M^-1 G'. */
typedef struct {
    double term;     /* [1/kg] */
    double accuracy; /* it ends where term |lam_(k+1) - lam_k| is no larger */
    int repeats;     /* most iterations */
} proximal;

/* Unknowns are the velocities of the tree, then the multipliers of the rows, which have U, D and u in its buffers too. */
typedef struct {
    const tree *tree;
    int loops, inner;        /* loop joints, and rows of those that end at links */
    const loop *loop;        /* in the order of the links at which they end, from the tips */
    const int *path;         /* what a row passes, in this order: a link, or ~k for a loop joint k before it */
    const int *unknown;      /* the unknowns there, and behind them its own multipliers */
    const double *weight_of; /* MOST_ROWS for each entry of `unknown`: what rows of couplings have of velocities */
    loop_state *loop_state;
    skyline squares;         /* G G', velocities in their units */
    const double *unit;      /* squares of the units of the velocities, nv; 0 of those that follow laws */
    const double *weight;    /* of every row: 1 over the unit of its gap */
    force *carried;          /* MOST_ROWS for the world and each link: forces of rows on their ways; 0 between uses */
    double *reduced;         /* MOST_ROWS for each entry of `unknown`: W, what rows have of the unknowns they pass */
    double *spread;          /* MOST_ROWS for each unknown; 0 between uses */
    double *response;        /* q'' of one solution */
    double *right, *multiplier, *part; /* as many as there are rows */
} constraints;

/* Bring the tree and its loop joints into a state. */
void constraints_place(const constraints *c, const double *q, const double *v);

/* Once where a state is placed: eliminate joints and rows, to whose pivots a term is added. */
void constraints_factorise(const constraints *c, double term);

/* Write q'' to `response` and lam to `part`, with M q'' = tau - sum S' p + G' lam and G q'' + term lam = `right`. Links
 * behind `from` have no loads: where none has, it is the first at which a loop joint ends. */
void constraints_solve(const constraints *c, const proximal *p, int from);

/* Write what is open in every row, and G v, where the state is placed; of couplings nothing is open. */
void constraints_gap(const constraints *c, const double *v, double *gap, double *rates);

/* Write G G', where the state is placed; what was factorised is lost. */
void constraints_squares(const constraints *c);

/* Write the accelerations a where the state is placed; return the square of the length of G a + G' v. */
double constraints_accelerate(const constraints *c, const proximal *p, double *a);
