/* A tree of links: its accelerations under gravity and the loads of its joints, by the articulated-body algorithm. */
#pragma once

#include "joints.h"

/* A degree of freedom: a velocity in v, its rotor, and tau = effort - stiffness (q - rest) - damping v. */
typedef struct {
    screw s;
    int sprung; /* index in q of the coordinate of the spring */
    double armature, effort, stiffness, damping, rest;
} degree;

/* A spring of a ball joint to its zero: tau = -stiffness w, with the rotation vector w of its quaternion. */
typedef struct { int q, v; double stiffness; } rotation_spring;

/* A spring, damper and constant pull along the line between two points, of links or of the world (link -1):
 * tension = stiffness (l - rest) + damping l' + pull. */
typedef struct {
    int link[2];
    vector place[2]; /* of the points in their links' frames */
    double stiffness, damping, rest, pull;
} point_spring;

enum { LAW_TERMS = 8 };

/* Something that follows s = start + size (sum_k c_k x^k + amplitude sin(x + phase)), x = (t - origin) / unit, where
 * from <= t < until: the effort of a velocity v, s beside a steady one; or, where q is no -1, a coordinate q, whose
 * armature outweighs the tree, so that an effort of armature s'' moves it. Each cubic of a spline is one. */
typedef struct { int v, q; double from, until, steady, start, size, origin, unit, amplitude, phase, c[LAW_TERMS]; } law;

/* What a link and its joint are at present: buffers of the passes. */
typedef struct {
    placement in_parent, in_world;
    motion velocity, acceleration, change; /* v, a, and X a_p + S q'' of one solution */
    articulated inertia;                   /* I^A */
    force bias;                            /* p^A */
} link_state;

typedef struct { force u; double inverse; } degree_state; /* U = I^A S and 1 / D */

typedef struct {
    int links, nq, nv, rotation_springs, point_springs, laws;
    const link *link;
    degree *degree; /* laws write their efforts */
    const rotation_spring *rotation_spring;
    const point_spring *point_spring;
    const law *law;
    link_state *link_state; /* the world, link -1, has the acceleration -gravity; nobody reads its inertia and bias */
    degree_state *degree_state;
    double *tau; /* nv loads, then u = tau - S' p^A */
} tree;

/* Write what follows laws at an instant: efforts, and coordinates and velocities to y = [q, v] where it is given. */
void tree_follow(const tree *t, double time, double *y);

/* Bring the links into the state q, v: with the accelerations that they have while their joints do not accelerate, the
 * forces p that these and the velocities need, and the loads tau, so that M q'' = tau - sum S' p. */
void tree_move(const tree *t, const double *q, const double *v);

/* Place the links in the world, from their placements in their parents. */
void tree_place(const tree *t);

/* Take the loads off: tau and p are 0. */
void tree_unload(const tree *t);

/* From the tips: what the joint of link i leaves for its parent of the inertia, U = I^A S, D = S' U + armature and
 * I^A - U U' / D, and of the loads, u = tau - S' p^A and p^A + U u / D. */
void tree_reduce(const tree *t, int i);
void tree_load(const tree *t, int i);

/* From the root: write q'' of the joint of link i, and `change`. */
void tree_accelerate(const tree *t, int i, double *a);

/* Unknown n of a link that accelerates by m: (u - U' m) / D; and what is left of a force f, of which it takes the part
 * x: f - U x / D. */
static inline double tree_unknown(const tree *t, int n, const motion *m) {
    const degree_state *e = &t->degree_state[n];
    return (t->tau[n] - dot(e->u.linear, m->linear) - dot(e->u.angular, m->angular)) * e->inverse;
}
static inline force tree_beyond(const tree *t, int n, force f, double x) {
    const degree_state *e = &t->degree_state[n];
    const double gain = -x * e->inverse;
    return (force){add(f.linear, scale(gain, e->u.linear)), add(f.angular, scale(gain, e->u.angular))};
}

/* Normalise the coordinates q, and write q' of the velocities v. */
void tree_coordinate_rates(const tree *t, double *q, const double *v, double *rates);

/* The rates of a state y = [q, v], for the integrator: normalise q and bring it onto laws within y, write [q', a]. */
void tree_rates(void *system, double time, double *y, double *slope);
