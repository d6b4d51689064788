#include "tree.h"

#include <float.h>
#include <math.h>

/* I m */
static force inertia_times(const articulated *i, motion m) {
    return (force){add(symmetric_times(&i->mass, m.linear), transposed_times(&i->coupling, m.angular)),
                   add(times(&i->coupling, m.linear), symmetric_times(&i->inertia, m.angular))};
}

/* The loads of the joints' springs, dampers and efforts. */
static void add_loads(const tree *t, const double *q, const double *v) {
    for (int k = 0; k < t->nv; k++) {
        const degree *d = &t->degree[k];
        t->tau[k] = d->effort - d->stiffness * (q[d->sprung] - d->rest) - d->damping * v[k];
    }
    for (int k = 0; k < t->rotation_springs; k++) { /* w = 2 atan(n / c) u for the quaternion (n u, c), |w| <= pi */
        const rotation_spring *s = &t->rotation_spring[k];
        const double *x = q + s->q, c = x[3];
        const double n = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
        const double factor = n > 0.0 ? 2.0 * atan2(c < 0.0 ? -n : n, fabs(c)) / fmax(n, DBL_MIN) : 0.0;
        for (int i = 0; i < 3; i++)
            t->tau[s->v + i] -= s->stiffness * factor * x[i];
    }
}

void tree_follow(const tree *t, double time, double *y) {
    for (int i = 0; i < t->laws; i++) {
        const law *l = &t->law[i];
        if (time < l->from || time >= l->until) continue;
        const double x = (time - l->origin) / l->unit;
        double s = 0.0, ds = 0.0, half = 0.0; /* half the second derivative: Horner's rule for a Taylor expansion */
        for (int k = LAW_TERMS - 1; k >= 0; k--)
            half = half * x + ds, ds = ds * x + s, s = s * x + l->c[k];
        const double wave = l->amplitude * sin(x + l->phase);
        s += wave, ds += l->amplitude * cos(x + l->phase), half -= 0.5 * wave;
        const double inertial = t->degree[l->v].armature * 2.0 * l->size * half / (l->unit * l->unit);
        t->degree[l->v].effort = l->steady + (l->q < 0 ? l->start + l->size * s : inertial);
        if (y && l->q >= 0)
            y[l->q] = l->start + l->size * s, y[t->nq + l->v] = l->size * ds / l->unit;
    }
}

void tree_place(const tree *t) {
    for (int i = 0; i < t->links; i++) {
        link_state *s = &t->link_state[i];
        const int parent = t->link[i].parent;
        s->in_world = parent < 0 ? s->in_parent : composed(&t->link_state[parent].in_world, &s->in_parent);
    }
}

/* Add a force in the world's axes at a point of a link to what acts on the link: p^A -= f. */
static void pull(const tree *t, int i, vector place, vector world) {
    link_state *s = &t->link_state[i];
    const vector f = transposed_times(&s->in_world.rotation, world);
    s->bias.linear = subtract(s->bias.linear, f), s->bias.angular = subtract(s->bias.angular, cross(place, f));
}

/* The loads of springs between points; where these meet, that of a spring of length 0 without a pull is 0. */
static void add_point_springs(const tree *t) {
    for (int k = 0; k < t->point_springs; k++) {
        const point_spring *s = &t->point_spring[k];
        vector end[2], rate[2];
        for (int i = 0; i < 2; i++) {
            const link_state *b = &t->link_state[s->link[i]];
            const vector v = add(b->velocity.linear, cross(b->velocity.angular, s->place[i]));
            end[i] = add(times(&b->in_world.rotation, s->place[i]), b->in_world.translation);
            rate[i] = times(&b->in_world.rotation, v);
        }
        const vector apart = subtract(end[1], end[0]), change = subtract(rate[1], rate[0]);
        const double l = sqrt(dot(apart, apart)), beyond = s->pull - s->stiffness * s->rest;
        const int linear = beyond == 0.0 && s->damping == 0.0;
        const double held = linear ? 0.0 : (beyond + s->damping * dot(apart, change) / l) / l;
        const vector tension = scale(s->stiffness + held, apart);
        pull(t, s->link[0], s->place[0], tension);
        pull(t, s->link[1], s->place[1], scale(-1.0, tension));
    }
}

/* Pass 1, from the root: v = X v_p + S q', a = X a_p + v x S q', from -gravity of the world on, I^A = I and
 * p = I a + v x* I v: equations 5.8 to 5.10 at q'' = 0. */
static void velocities(const tree *t, const double *q, const double *v) {
    for (int i = 0; i < t->links; i++) {
        const link *l = &t->link[i];
        const link_state *p = &t->link_state[l->parent];
        link_state *s = &t->link_state[i];
        motion joint = NO_MOTION;
        for (int k = l->v; k < l->v + joint_velocities(l->kind); k++)
            accumulate_motion(&joint, along(&t->degree[k].s, v[k]));
        s->in_parent = joint_placement(l, &t->degree[l->v].s, q + l->q);
        s->velocity = l->parent < 0 ? NO_MOTION : into_child(&s->in_parent, &p->velocity);
        accumulate_motion(&s->velocity, joint);
        s->acceleration = into_child(&s->in_parent, &p->acceleration);
        accumulate_motion(&s->acceleration, motion_cross(&s->velocity, &joint));
        s->inertia = rigid(&l->carried);
        s->bias = gyroscopic(&l->carried, &s->velocity);
        accumulate_force(&s->bias, body_times(&l->carried, &s->acceleration));
    }
}

void tree_move(const tree *t, const double *q, const double *v) {
    add_loads(t, q, v);
    velocities(t, q, v);
    if (t->point_springs > 0) {
        tree_place(t);
        add_point_springs(t);
    }
}

void tree_unload(const tree *t) {
    for (int k = 0; k < t->nv; k++)
        t->tau[k] = 0.0;
    for (int i = 0; i < t->links; i++)
        t->link_state[i].bias = NO_FORCE;
}

/* Pass 2 and 3 of Featherstone, section 7.3 and table 7.1, in the frames of the links; as a and p have their parts of
 * q'' = 0 beforehand, c stands in neither. The columns of a joint with several velocities are eliminated one after the
 * other, as if massless links were between them: this is Gauss's elimination of D. */
void tree_reduce(const tree *t, int i) {
    const link *l = &t->link[i];
    link_state *s = &t->link_state[i];
    for (int k = l->v; k < l->v + joint_velocities(l->kind); k++) {
        const degree *d = &t->degree[k];
        degree_state *e = &t->degree_state[k];
        e->u = inertia_times(&s->inertia, along(&d->s, 1.0));
        e->inverse = 1.0 / (power(&d->s, &e->u) + d->armature);
        subtract_square(&s->inertia, e->inverse, &e->u);
    }
    if (l->parent >= 0)
        add_into_parent(&t->link_state[l->parent].inertia, &s->in_parent, &s->inertia);
}

void tree_load(const tree *t, int i) {
    const link *l = &t->link[i];
    link_state *s = &t->link_state[i];
    for (int k = l->v; k < l->v + joint_velocities(l->kind); k++) {
        t->tau[k] -= power(&t->degree[k].s, &s->bias);
        s->bias = tree_beyond(t, k, s->bias, -t->tau[k]);
    }
    if (l->parent >= 0)
        accumulate_force(&t->link_state[l->parent].bias, into_parent(&s->in_parent, &s->bias));
}

/* a' = X a_p, then q'' = (u - U' a') / D and a' + S q'', for the columns of the joint in reverse order. */
void tree_accelerate(const tree *t, int i, double *a) {
    const link *l = &t->link[i];
    motion *m = &t->link_state[i].change;
    *m = l->parent < 0 ? NO_MOTION : into_child(&t->link_state[i].in_parent, &t->link_state[l->parent].change);
    for (int k = l->v + joint_velocities(l->kind) - 1; k >= l->v; k--) {
        a[k] = tree_unknown(t, k, m);
        accumulate_motion(m, along(&t->degree[k].s, a[k]));
    }
}

void tree_coordinate_rates(const tree *t, double *q, const double *v, double *rates) {
    for (int i = 0; i < t->links; i++) {
        const link *l = &t->link[i];
        joint_normalise(l->kind, q + l->q);
        joint_rates(l->kind, q + l->q, v + l->v, rates + l->q);
    }
}

void tree_rates(void *system, double time, double *y, double *slope) {
    const tree *t = system;
    tree_follow(t, time, y);
    tree_coordinate_rates(t, y, y + t->nq, slope);
    tree_move(t, y, y + t->nq);
    for (int i = t->links - 1; i >= 0; i--)
        tree_reduce(t, i), tree_load(t, i);
    for (int i = 0; i < t->links; i++)
        tree_accelerate(t, i, slope + t->nq);
}
