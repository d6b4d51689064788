/* A tree of links: its accelerations under gravity and the loads of its joints, by the articulated-body algorithm. */
#ifndef PINARM_TREE_H
#define PINARM_TREE_H

#include "joints.h"

/* A degree of freedom: a velocity in v, its rotor, and tau = effort - stiffness (q - rest) - damping v. */
typedef struct {
    screw s;
    int sprung; /* index in q of the coordinate of the spring */
    double armature, effort, stiffness, damping, rest;
} degree;

/* A spring of a ball joint to its zero: tau = -stiffness w, with the rotation vector w of its quaternion. */
typedef struct {
    int q, v;
    double stiffness;
} rotation_spring;

/* What a link and its joint are at present: buffers of the passes. */
typedef struct {
    placement in_parent;
    motion velocity, product, acceleration; /* v, c = v x S q', a */
    articulated inertia;                    /* I^A */
    force bias;                             /* p^A */
} link_state;

typedef struct {
    force u;                    /* U = I^A S */
    double inverse, unbalanced; /* 1 / D and u */
} degree_state;

typedef struct {
    int links, nq, nv, rotation_springs;
    vector gravity; /* acceleration, in the world's axes */
    const link *link;
    const degree *degree;
    const rotation_spring *rotation_spring;
    link_state *link_state;
    degree_state *degree_state;
    double *tau; /* nv loads */
} tree;

/* Return 0 where all indices of a tree are within its arrays and all its numbers finite, else 1. */
int tree_check(const tree *t);

/* Write the accelerations a, of nv numbers, in the state q, v. */
void tree_accelerations(const tree *t, const double *q, const double *v, double *a);

/* The rates of a state y = [q, v], for the integrator: normalise q within y, and write [q', a]. */
void tree_rates(const void *system, double time, double *y, double *slope);

#endif
