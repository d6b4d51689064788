#include "loops.h"

#include <math.h>

/* A motion of the link of frame 1 or 2, as that of the frame in the axes of frame 1. */
static motion of_frame(const loop *l, const loop_state *s, int i, const motion *of_link) {
    const motion m = into_child(&l->frame[i], of_link);
    return i ? (motion){times(&s->axes, m.linear), times(&s->axes, m.angular)} : m;
}

/* The acceleration of its origin, a + w x v, and its angular acceleration; equation 2.48. */
static motion frame_acceleration(const tree *t, const loop *l, const loop_state *s, int i) {
    const motion *v = &s->velocity[i];
    motion a = of_frame(l, s, i, &t->link_state[l->link[i]].acceleration);
    a.linear = add(a.linear, cross(v->angular, v->linear));
    return a;
}

/* Whether row k holds the axes of a universal joint at right angles. */
static int is_cross(const loop *l, int k) { return l->kind == UNIVERSAL && dot(l->about[k], l->about[k]) > 0.0; }

void loop_place(const tree *t, const loop *l, loop_state *s) {
    const placement one = composed(&t->link_state[l->link[0]].in_world, &l->frame[0]);
    const placement two = composed(&t->link_state[l->link[1]].in_world, &l->frame[1]);
    s->apart = transposed_times(&one.rotation, subtract(two.translation, one.translation));
    s->axes = transposed_product(&one.rotation, &two.rotation);
    for (int i = 0; i < 2; i++)
        s->velocity[i] = of_frame(l, s, i, &t->link_state[l->link[i]].velocity);
    for (int k = 0; k < l->rows; k++) {
        vector e = l->along[k], w = l->about[k];
        if (is_cross(l, k))
            w = cross(times(&s->axes, w), e), e = ZERO;
        if (l->kind == ROD)
            e = scale(1.0 / sqrt(dot(s->apart, s->apart)), s->apart);
        s->along[k] = e, s->about[k] = w;
        s->on[1][k] = (force){transposed_times(&s->axes, e), transposed_times(&s->axes, w)};
        s->on[0][k] = (force){scale(-1.0, e), scale(-1.0, add(w, cross(s->apart, e)))};
    }
}

/* e' . p' + w' . omega: what the change of the directions does. */
static double bend(const loop *l, const loop_state *s, int k, vector dp, vector omega) {
    if (is_cross(l, k))
        return dot(cross(cross(omega, times(&s->axes, l->about[k])), l->along[k]), omega);
    if (l->kind == ROD)
        return (dot(dp, dp) - dot(s->along[k], dp) * dot(s->along[k], dp)) / sqrt(dot(s->apart, s->apart));
    return 0.0;
}

/* e . p'' + w . omega', seen from frame 1, where
 * p'' = a_2 - a_1 - alpha_1 x p - w_1 x (w_1 x p) - 2 w_1 x p' and omega' = alpha_2 - alpha_1 - w_1 x omega. */
void loop_accelerations(const tree *t, const loop *l, const loop_state *s, double *result) {
    const motion a = frame_acceleration(t, l, s, 0), b = frame_acceleration(t, l, s, 1);
    const motion v = s->velocity[0], u = s->velocity[1];
    const vector carried = cross(v.angular, s->apart), omega = subtract(u.angular, v.angular);
    const vector dp = subtract(subtract(u.linear, v.linear), carried);
    const vector turning = add(cross(a.angular, s->apart), cross(v.angular, add(carried, scale(2.0, dp))));
    const vector ddp = subtract(subtract(b.linear, a.linear), turning);
    const vector domega = subtract(subtract(b.angular, a.angular), cross(v.angular, omega));
    for (int k = 0; k < l->rows; k++)
        result[k] = dot(s->along[k], ddp) + dot(s->about[k], domega) + bend(l, s, k, dp, omega);
}

/* Twice the vector of a rotation of small angle, from the antisymmetric part of its matrix. */
static vector twist(const matrix *r) { return (vector){r->z.y - r->y.z, r->x.z - r->z.x, r->y.x - r->x.y}; }

static const double TURN = 6.283185307179586;

/* What a screw has advanced beyond its angle, but for whole leads: w = -h e, lead 2 pi h. */
static double thread(const loop *l, const loop_state *s, int k) {
    const matrix *r = &s->axes;
    const vector e = s->along[k], turning = twist(r);
    const double pitch = -dot(s->about[k], e), cosine = r->x.x + r->y.y + r->z.z - dot(e, times(r, e));
    const double gap = dot(e, s->apart) - l->size - pitch * atan2(dot(e, turning), cosine), lead = TURN * pitch;
    return gap - lead * round(gap / lead);
}

static double open_angle(const loop *l, const loop_state *s, int k) {
    if (is_cross(l, k))
        return dot(l->along[k], times(&s->axes, l->about[k]));
    const int turns = dot(l->axis, l->axis) > 0.0;
    return dot(s->about[k], turns ? cross(l->axis, times(&s->axes, l->axis)) : scale(0.5, twist(&s->axes)));
}

void loop_gap(const loop *l, const loop_state *s, double *result) {
    for (int k = 0; k < l->rows; k++) {
        const int slides = dot(s->along[k], s->along[k]) > 0.0, turns = dot(s->about[k], s->about[k]) > 0.0;
        if (slides && turns)
            result[k] = thread(l, s, k);
        else
            result[k] = slides ? dot(s->along[k], s->apart) - (l->kind == ROD ? l->size : 0.0) : open_angle(l, s, k);
    }
}

void loop_rates(const loop *l, const loop_state *s, double *result) {
    const motion v = s->velocity[0], u = s->velocity[1];
    const vector dp = subtract(subtract(u.linear, v.linear), cross(v.angular, s->apart));
    const vector omega = subtract(u.angular, v.angular);
    for (int k = 0; k < l->rows; k++)
        result[k] = dot(s->along[k], dp) + dot(s->about[k], omega);
}
