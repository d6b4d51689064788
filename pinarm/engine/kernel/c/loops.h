/* Joints that close loops: their rows of G, and what these ask of accelerations, from the motions of the links.
 * The rows are those of pinarm/mechanics/loops: row k holds e_k . p' + w_k . omega = 0, in the axes of frame 1. */
#pragma once

#include "tree.h"

enum { MOST_ROWS = 6 };

/* LOWER      e and w are constant: lower pairs, points on lines and planes, screws; a coupling has neither
 * UNIVERSAL  the row with directions u of frame 1 and v of frame 2 in `along` and `about` has e = 0 and w = R v x u
 * ROD        e is the direction of p */
enum { LOWER, UNIVERSAL, ROD, LOOP_KINDS };

typedef struct {
    int kind, rows;
    int link[2];             /* -1 for the world */
    int first;               /* of its rows in G */
    int end;                 /* the last link that moves both frames, or all joints that it couples, or -1 */
    int path, links;         /* first place in `path`, and number, of what its rows pass on their ways there */
    int support, degrees;    /* first place in `unknown`, and number, of the unknowns there, its multipliers too */
    int tail, own;           /* places there of the first multiplier that is eliminated where it ends, and of its own */
    int coupled;             /* first loop joint that shares one of these unknowns with it */
    placement frame[2];      /* of frames 1 and 2 in their links */
    vector along[MOST_ROWS]; /* e */
    vector about[MOST_ROWS]; /* w */
    vector axis;             /* about which frame 2 may turn; 0 where it may not */
    double size;             /* length of a rod; place along the axis at which the angle of a screw is 0 */
} loop;

/* A loop joint at present. Its rows of G are the powers of the forces on the frames, in the frames' own axes. */
typedef struct {
    vector apart;            /* p, the place of frame 2 in frame 1 */
    matrix axes;             /* R, the axes of frame 2 in frame 1, as columns */
    vector along[MOST_ROWS], about[MOST_ROWS];
    force on[2][MOST_ROWS];  /* force of every row on frame 1 and on frame 2 */
    motion velocity[2];      /* of frames 1 and 2, in the axes of frame 1 */
} loop_state;

/* Place a loop joint, whose links are placed in the world and have velocities. */
void loop_place(const tree *t, const loop *l, loop_state *s);

/* Write what is open in every row, to first order where it is closed: e . p, w . rotation, or |p| - length. */
void loop_gap(const loop *l, const loop_state *s, double *result);

/* Write G v, of the velocities that the links have. */
void loop_rates(const loop *l, const loop_state *s, double *result);

/* Write G a + G' v, of the accelerations that the links have. */
void loop_accelerations(const tree *t, const loop *l, const loop_state *s, double *result);
