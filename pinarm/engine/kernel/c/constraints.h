/* A tree with loops: the rows of its loop joints together, and its accelerations. */
#pragma once

#include "loops.h"
#include "skyline.h"

/* How multipliers are found where rows may be redundant: (S + term 1) lam_(k+1) = b + term lam_k. */
typedef struct {
    double term;     /* [1/kg] */
    double accuracy; /* it ends where term |lam_(k+1) - lam_k| is no larger */
    int repeats;     /* most iterations */
} proximal;

typedef struct {
    const tree *tree;
    int loops, path_length, support_length;
    const loop *loop;
    const int *path, *dof; /* links and velocities that move each loop joint, links in descending order */
    const double *weight_of; /* MOST_ROWS for each entry of `dof`: what rows of couplings have of velocities */
    loop_state *loop_state;
    skyline delassus;      /* rows of all loop joints */
    force *carried;        /* MOST_ROWS for each link: forces of the rows on their way to the root; 0 between uses */
    double *reduced;       /* MOST_ROWS for each entry of `dof` */
    double *spread;        /* MOST_ROWS for each velocity; 0 between uses */
    double *weight;        /* nv */
    double *right, *multiplier, *before; /* as many as there are rows */
} constraints;

/* Bring the tree and its loop joints into a state. */
void constraints_place(const constraints *c, const double *q, const double *v);

/* Write the reduced rows W and S = W' D^-1 W = G M^-1 G', or the rows of G and G G', where the state is placed. */
void constraints_delassus(const constraints *c);
void constraints_squares(const constraints *c);

/* u += W lam */
void constraints_load(const constraints *c, const double *multiplier, double *u);

/* Write the accelerations a where the state is placed; return the square of the length of G a + G' v. */
double constraints_accelerate(const constraints *c, const proximal *p, double *a);
