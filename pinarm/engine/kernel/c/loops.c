#include "loops.h"

#include <math.h>

/* The frame of a loop joint in the world, its velocity and the acceleration of its origin, in its own axes. */
typedef struct {
    placement in_world;
    motion velocity;
} frame_state;

static frame_state frame_of(const tree *t, const loop *l, int i) {
    const motion rest = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
    if (l->link[i] < 0)
        return (frame_state){l->frame[i], rest};
    const link_state *s = &t->link_state[l->link[i]];
    return (frame_state){composed(&s->in_world, &l->frame[i]), into_child(&l->frame[i], &s->velocity)};
}

/* The acceleration of a frame's origin, a + w x v, in its own axes, and its angular acceleration; equation 2.48. */
static motion frame_acceleration(const tree *t, const loop *l, int i) {
    const motion world = {scale(-1.0, t->gravity), {0.0, 0.0, 0.0}};
    const link_state *s = l->link[i] < 0 ? 0 : &t->link_state[l->link[i]];
    motion a = into_child(&l->frame[i], s ? &s->acceleration : &world);
    if (s) {
        const motion v = into_child(&l->frame[i], &s->velocity);
        a.linear = add(a.linear, cross(v.angular, v.linear));
    }
    return a;
}

void loop_place(const tree *t, const loop *l, loop_state *s) {
    const frame_state one = frame_of(t, l, 0), two = frame_of(t, l, 1);
    const matrix *r = &one.in_world.rotation;
    s->apart = transposed_times(r, subtract(two.in_world.translation, one.in_world.translation));
    s->axes = transposed_product(r, &two.in_world.rotation);
    const vector slip = subtract(one.velocity.linear, times(&s->axes, two.velocity.linear));
    for (int k = 0; k < l->rows; k++) {
        const vector e = l->along[k], none = {0.0, 0.0, 0.0};
        s->on[0][k] = (force){e, none};
        s->on[1][k] = (force){transposed_times(&s->axes, scale(-1.0, e)), none};
        s->open[k] = dot(e, s->apart);
        s->rate[k] = dot(e, slip);
    }
}

void loop_accelerations(const tree *t, const loop *l, const loop_state *s, double *result) {
    const motion one = frame_acceleration(t, l, 0), two = frame_acceleration(t, l, 1);
    const vector slip = subtract(one.linear, times(&s->axes, two.linear));
    for (int k = 0; k < l->rows; k++)
        result[k] = dot(l->along[k], slip);
}
