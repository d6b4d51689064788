/* Joints that close loops: what is open between their two frames, and how the rows of G follow from the links' motions.
 *
 * The rows are those of pinarm/mechanics/loops: row k holds e_k . p' + w_k . omega = 0, in the axes of frame 1.
 */
#ifndef PINARM_LOOPS_H
#define PINARM_LOOPS_H

#include "tree.h"

enum { MOST_ROWS = 6 };

/* POINT  the origins coincide: rows e . (v_1 - v_2), the difference of their velocities; those of Pinocchio
 */
enum { POINT, LOOP_KINDS };

typedef struct {
    int kind, rows;
    int link[2];             /* -1 for the world */
    int first;               /* of its rows in G */
    int path, links;         /* first place in `path`, and number, of the links that move either frame */
    int support, degrees;    /* first place in `dof`, and number, of the velocities of these links */
    int coupled;             /* first loop that shares one of these velocities with it */
    placement frame[2];      /* of frames 1 and 2 in their links */
    vector along[MOST_ROWS]; /* e */
    vector about[MOST_ROWS]; /* w */
} loop;

/* A loop joint at present. Its rows of G are the powers of the forces on the frames, in the frames' own axes. */
typedef struct {
    vector apart;            /* p, the place of frame 2 in frame 1 */
    matrix axes;             /* R, the axes of frame 2 in frame 1, as columns */
    force on[2][MOST_ROWS];  /* force of every row on frame 1 and on frame 2 */
    double open[MOST_ROWS];  /* what G x has to be so that x closes it */
    double rate[MOST_ROWS];  /* G v */
} loop_state;

/* Place a loop joint: what is open, its rows and their rates; links are placed in the world and have velocities. */
void loop_place(const tree *t, const loop *l, loop_state *s);

/* Write G a + G' v, of the accelerations that the links have. */
void loop_accelerations(const tree *t, const loop *l, const loop_state *s, double *result);

#endif
