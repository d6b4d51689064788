/* What the motion of rigid bodies demands, as virtual powers along the velocities of a tree.
 * Where the links are, and how they move, is given: in the checks of a run Pinocchio says it. */
#pragma once

#include <stddef.h>

#include "spatial.h"

/* The bodies of a tree, in the frames of its joints; the world is link 0. */
typedef struct {
    ptrdiff_t links, nv;
    const ptrdiff_t *parent;        /* of each link, smaller than its own index */
    const ptrdiff_t *first, *count; /* first velocity of its joint, and number of these */
    const body *body;
    vector gravity;
} bodies;

typedef struct { double force, moment; } wrench_size;

/* Write, of n states, for every velocity the virtual power that the links' motion asks for beside that of what acts on
 * them, and what wrenches of their sizes could do at most; and of every state sum |f| |v| + |m| |w| of the motion.
 * Given are rotations and origins of the links in the world, their twists and the time derivatives of these in their own
 * frames, the twists that unit velocities give to what lies beyond, in the world's frame, six rows of nv; and what acts
 * on the links, negative, about their origins in world axes, with its sizes; both end as sums with the links beyond. */
void bodies_powers(const bodies *b, ptrdiff_t n, const matrix *turns, const vector *places, const motion *twists,
                   const motion *rates, const double *columns, force *wrenches, wrench_size *sizes, double *asked,
                   double *terms, double *most);
