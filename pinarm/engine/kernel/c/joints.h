/* Joints: where their coordinates put the child link, and how fast coordinates change with velocities.
 * The motion subspace S of every kind is constant in the frame of the child link, so that its velocity product term is
 * v x S q' alone (Featherstone, section 4.4), and each of its columns is a screw about an axis of that frame.
 * The frame of a link whose joint has one velocity is turned so that the joint's axis is its z axis. */
#pragma once

#include "spatial.h"

/*                  q                               v, in the frame of the child link
 * SCREW            angle or length                 its rate: revolute, prismatic and helical joints
 * CONTINUOUS       cos, sin                        angular velocity
 * BALL             quaternion x, y, z, w           angular velocity
 * FLOATING         position, quaternion            velocity, angular velocity
 * PLANAR           x, y, cos, sin                  velocity x and y, angular velocity
 * TRANSLATION      position                        velocity */
enum { SCREW, CONTINUOUS, BALL, FLOATING, PLANAR, TRANSLATION, JOINT_KINDS };

/* A column of S: the velocity of the child link is `slide` along, and `turn` about, an axis of its frame. */
typedef struct {
    int axis; /* 0, 1, 2: x, y, z */
    double slide, turn;
} screw;

/* A component of a vector. */
static inline double component(int axis, vector a) { return axis == 0 ? a.x : axis == 1 ? a.y : a.z; }

/* S s, of one column of the motion subspace */
static inline motion along(const screw *s, double rate) {
    const vector axis = {s->axis == 0, s->axis == 1, s->axis == 2};
    return (motion){scale(s->slide * rate, axis), scale(s->turn * rate, axis)};
}

/* S' f */
static inline double power(const screw *s, const force *f) {
    return s->slide * component(s->axis, f->linear) + s->turn * component(s->axis, f->angular);
}

/* A link, its joint and the frame in which the joint starts. */
typedef struct {
    int parent;      /* index of the parent link, smaller than its own; -1 for the world */
    int kind;        /* of the joint */
    int q, v;        /* the joint's first coordinate in q, and first velocity in v */
    placement fixed; /* of the child link in its parent where the joint is at zero */
    body carried;
} link;

/* Number of velocities of a kind of joint. */
int joint_velocities(int kind);

/* Return the placement of a link in its parent at the coordinates q of its joint, with the joint's first screw. */
placement joint_placement(const link *l, const screw *s, const double *q);

/* Bring quaternions and (cos, sin) pairs among the coordinates of a joint to unit length. */
void joint_normalise(int kind, double *q);

/* Move the coordinates of a joint along s x of its velocities: by exp, as Pinocchio's `integrate`. */
void joint_move(int kind, double s, const double *x, double *q);

/* Write q' of a joint's coordinates and velocities: Featherstone, section 4.5. */
void joint_rates(int kind, const double *q, const double *v, double *rates);
