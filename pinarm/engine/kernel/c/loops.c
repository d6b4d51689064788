#include "loops.h"

#include <math.h>

static const vector ZERO = {0.0, 0.0, 0.0};

static placement frame_placement(const tree *t, const loop *l, int i) {
    return l->link[i] < 0 ? l->frame[i] : composed(&t->link_state[l->link[i]].in_world, &l->frame[i]);
}

/* The velocity of frame 1 or 2, in the axes of frame 1. */
static motion frame_velocity(const tree *t, const loop *l, const loop_state *s, int i) {
    if (l->link[i] < 0)
        return (motion){ZERO, ZERO};
    const motion v = into_child(&l->frame[i], &t->link_state[l->link[i]].velocity);
    return i ? (motion){times(&s->axes, v.linear), times(&s->axes, v.angular)} : v;
}

/* The acceleration of its origin, a + w x v, and its angular acceleration; equation 2.48. */
static motion frame_acceleration(const tree *t, const loop *l, const loop_state *s, int i) {
    const motion world = {scale(-1.0, t->gravity), ZERO};
    motion a = into_child(&l->frame[i], l->link[i] < 0 ? &world : &t->link_state[l->link[i]].acceleration);
    if (i)
        a = (motion){times(&s->axes, a.linear), times(&s->axes, a.angular)};
    const motion v = frame_velocity(t, l, s, i);
    a.linear = add(a.linear, cross(v.angular, v.linear));
    return a;
}

void loop_place(const tree *t, const loop *l, loop_state *s) {
    const placement one = frame_placement(t, l, 0), two = frame_placement(t, l, 1);
    const double points = l->kind == POINT ? -1.0 : 1.0;
    s->apart = transposed_times(&one.rotation, subtract(two.translation, one.translation));
    s->axes = transposed_product(&one.rotation, &two.rotation);
    for (int k = 0; k < l->rows; k++) {
        vector e = l->along[k], w = l->about[k];
        if (l->kind == UNIVERSAL && k == l->rows - 1)
            w = cross(times(&s->axes, w), e), e = ZERO;
        if (l->kind == ROD)
            e = scale(1.0 / sqrt(dot(s->apart, s->apart)), s->apart);
        s->along[k] = e, s->about[k] = w;
        s->on[1][k] = (force){transposed_times(&s->axes, scale(points, e)), transposed_times(&s->axes, w)};
        s->on[0][k] = (force){scale(-points, e), l->kind == POINT ? ZERO : scale(-1.0, add(w, cross(s->apart, e)))};
    }
}

/* e' . p' + w' . omega: what the change of the directions does. */
static double bend(const loop *l, const loop_state *s, int k, vector dp, vector omega) {
    if (l->kind == UNIVERSAL && k == l->rows - 1)
        return dot(cross(cross(omega, times(&s->axes, l->about[k])), l->along[k]), omega);
    if (l->kind == ROD)
        return (dot(dp, dp) - dot(s->along[k], dp) * dot(s->along[k], dp)) / sqrt(dot(s->apart, s->apart));
    return 0.0;
}

/* Of points the difference of their accelerations; else e . p'' + w . omega', seen from frame 1, where
 * p'' = a_2 - a_1 - alpha_1 x p - w_1 x (w_1 x p) - 2 w_1 x p' and omega' = alpha_2 - alpha_1 - w_1 x omega. */
void loop_accelerations(const tree *t, const loop *l, const loop_state *s, double *result) {
    const motion a = frame_acceleration(t, l, s, 0), b = frame_acceleration(t, l, s, 1);
    if (l->kind == POINT) {
        for (int k = 0; k < l->rows; k++)
            result[k] = dot(s->along[k], subtract(a.linear, b.linear));
        return;
    }
    const motion v = frame_velocity(t, l, s, 0), u = frame_velocity(t, l, s, 1);
    const vector carried = cross(v.angular, s->apart), omega = subtract(u.angular, v.angular);
    const vector dp = subtract(subtract(u.linear, v.linear), carried);
    const vector turning = add(cross(a.angular, s->apart), cross(v.angular, add(carried, scale(2.0, dp))));
    const vector ddp = subtract(subtract(b.linear, a.linear), turning);
    const vector domega = subtract(subtract(b.angular, a.angular), cross(v.angular, omega));
    for (int k = 0; k < l->rows; k++)
        result[k] = dot(s->along[k], ddp) + dot(s->about[k], domega) + bend(l, s, k, dp, omega);
}

void loop_gap(const tree *t, const loop *l, const loop_state *s, double *open, double *rate) {
    const vector slip = subtract(frame_velocity(t, l, s, 0).linear, frame_velocity(t, l, s, 1).linear);
    for (int k = 0; k < l->rows; k++)
        open[k] = dot(s->along[k], s->apart), rate[k] = dot(s->along[k], slip);
}
