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

void loop_place(const tree *t, const loop *l, loop_state *s) {
    const placement one = composed(&t->link_state[l->link[0]].in_world, &l->frame[0]);
    const placement two = composed(&t->link_state[l->link[1]].in_world, &l->frame[1]);
    const double points = l->kind == POINT ? -1.0 : 1.0;
    s->apart = transposed_times(&one.rotation, subtract(two.translation, one.translation));
    s->axes = transposed_product(&one.rotation, &two.rotation);
    for (int i = 0; i < 2; i++)
        s->velocity[i] = of_frame(l, s, i, &t->link_state[l->link[i]].velocity);
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
    const motion v = s->velocity[0], u = s->velocity[1];
    const vector carried = cross(v.angular, s->apart), omega = subtract(u.angular, v.angular);
    const vector dp = subtract(subtract(u.linear, v.linear), carried);
    const vector turning = add(cross(a.angular, s->apart), cross(v.angular, add(carried, scale(2.0, dp))));
    const vector ddp = subtract(subtract(b.linear, a.linear), turning);
    const vector domega = subtract(subtract(b.angular, a.angular), cross(v.angular, omega));
    for (int k = 0; k < l->rows; k++)
        result[k] = dot(s->along[k], ddp) + dot(s->about[k], domega) + bend(l, s, k, dp, omega);
}
