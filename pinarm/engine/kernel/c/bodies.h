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

/* Write, of n states, for every velocity the virtual power that the links' motion asks for, and the sum of the absolute
 * terms, weights with the full length of their path; and of every state sum |f| |v| + |m| |w|.
 * Given are rotations and origins of the links in the world, their twists and the time derivatives of these in their own
 * frames, and the twists that unit velocities give to what lies beyond, in the world's frame, six rows of nv. */
void bodies_powers(const bodies *b, ptrdiff_t n, const matrix *turns, const vector *places, const motion *twists,
                   const motion *rates, const double *columns, double *asked, double *sizes, double *most);
