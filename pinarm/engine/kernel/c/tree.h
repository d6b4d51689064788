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
typedef struct {
    int q, v;
    double stiffness;
} rotation_spring;

/* A spring, damper and constant pull along the line between two points, of links or of the world (link -1):
 * tension = stiffness (l - rest) + damping l' + pull. */
typedef struct {
    int link[2];
    vector place[2]; /* of the points in their links' frames */
    double stiffness, damping, rest, pull;
} point_spring;

/* What a link and its joint are at present: buffers of the passes. */
typedef struct {
    placement in_parent, in_world;
    motion velocity, product, acceleration; /* v, c = v x S q', a */
    articulated inertia;                    /* I^A */
    force bias;                             /* p^A */
} link_state;

typedef struct {
    force u;        /* U = I^A S */
    double inverse; /* 1 / D */
} degree_state;

typedef struct {
    int links, nq, nv, rotation_springs, point_springs;
    vector gravity; /* acceleration, in the world's axes */
    const link *link;
    const degree *degree;
    const rotation_spring *rotation_spring;
    const point_spring *point_spring;
    link_state *link_state;
    degree_state *degree_state;
    double *tau; /* nv loads, then u = tau - S' p^A */
} tree;

/* The two halves of the accelerations of the free tree in the state q, v: what its links carry, which leaves I^A, U, D
 * and u in its buffers, and the accelerations a, of nv numbers. */
void tree_articulate(const tree *t, const double *q, const double *v);
void tree_accelerate(const tree *t, double *a);

/* Write x = M^-1 f of generalised forces f that leave u at the joints, at rest and without gravity. */
void tree_response(const tree *t, const double *u, double *x);

/* Place the links in the world, from their placements in their parents. */
void tree_place(const tree *t);

/* Normalise the coordinates q, and write q' of the velocities v. */
void tree_coordinate_rates(const tree *t, double *q, const double *v, double *rates);

/* The rates of a state y = [q, v], for the integrator: normalise q within y, and write [q', a]. */
void tree_rates(void *system, double time, double *y, double *slope);
