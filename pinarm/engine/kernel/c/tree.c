#include "tree.h"

#include <float.h>
#include <math.h>

static vector symmetric_row(const symmetric *s, int axis) {
    return axis == 0 ? (vector){s->xx, s->xy, s->xz} : axis == 1 ? (vector){s->xy, s->yy, s->yz} :
                                                                   (vector){s->xz, s->yz, s->zz};
}

/* I S: a column of M and of H, and a row of H and of I */
static force column(const articulated *i, const screw *s) {
    const matrix *h = &i->coupling;
    const int k = s->axis;
    const vector coupled = {component(k, h->x), component(k, h->y), component(k, h->z)};
    const vector moment = k == 0 ? h->x : k == 1 ? h->y : h->z;
    return (force){add(scale(s->slide, symmetric_row(&i->mass, k)), scale(s->turn, moment)),
                   add(scale(s->slide, coupled), scale(s->turn, symmetric_row(&i->inertia, k)))};
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

void tree_place(const tree *t) {
    for (int i = 0; i < t->links; i++) {
        const int parent = t->link[i].parent;
        link_state *s = &t->link_state[i];
        s->in_world = parent < 0 ? s->in_parent : composed(&t->link_state[parent].in_world, &s->in_parent);
    }
}

static vector point(const tree *t, int i, vector place) {
    if (i < 0)
        return place;
    const placement *x = &t->link_state[i].in_world;
    return add(times(&x->rotation, place), x->translation);
}

static vector point_velocity(const tree *t, int i, vector place) {
    if (i < 0)
        return (vector){0.0, 0.0, 0.0};
    const link_state *s = &t->link_state[i];
    return times(&s->in_world.rotation, add(s->velocity.linear, cross(s->velocity.angular, place)));
}

/* Add a force in the world's axes at a point of a link to what acts on the link: p^A -= f. */
static void pull(const tree *t, int i, vector place, vector world) {
    if (i < 0)
        return;
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
            end[i] = point(t, s->link[i], s->place[i]);
            rate[i] = point_velocity(t, s->link[i], s->place[i]);
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

/* Pass 1, from the root: v = X v_p + S q', c = v x S q', I^A = I, p^A = v x* I v. */
static void velocities(const tree *t, const double *q, const double *v) {
    for (int i = 0; i < t->links; i++) {
        const link *l = &t->link[i];
        link_state *s = &t->link_state[i];
        motion joint = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
        for (int k = l->v; k < l->v + joint_velocities(l->kind); k++)
            accumulate_motion(&joint, along(&t->degree[k].s, v[k]));
        s->in_parent = joint_placement(l, &t->degree[l->v].s, q + l->q);
        s->velocity = joint;
        if (l->parent >= 0)
            accumulate_motion(&s->velocity, into_child(&s->in_parent, &t->link_state[l->parent].velocity));
        s->product = motion_cross(&s->velocity, &joint);
        s->inertia = rigid(&l->carried);
        s->bias = gyroscopic(&l->carried, &s->velocity);
    }
}

/* Pass 2, from the tips: for each column S of the joint U = I^A S, D = S' U + armature, u = tau - S' p^A;
 * I^a = I^A - U U' / D, p^a = p^A + I^a c + U u / D, and both are added to those of the parent. */
static void inertias(const tree *t) {
    for (int i = t->links - 1; i >= 0; i--) {
        const link *l = &t->link[i];
        link_state *s = &t->link_state[i];
        for (int k = l->v; k < l->v + joint_velocities(l->kind); k++) {
            const degree *d = &t->degree[k];
            degree_state *e = &t->degree_state[k];
            e->u = column(&s->inertia, &d->s);
            e->inverse = 1.0 / (power(&d->s, &e->u) + d->armature);
            t->tau[k] -= power(&d->s, &s->bias);
            const double gain = t->tau[k] * e->inverse;
            subtract_square(&s->inertia, e->inverse, &e->u);
            accumulate_force(&s->bias, (force){scale(gain, e->u.linear), scale(gain, e->u.angular)});
        }
        if (l->parent < 0)
            continue;
        link_state *p = &t->link_state[l->parent];
        accumulate_force(&s->bias, inertia_times(&s->inertia, &s->product));
        add_into_parent(&p->inertia, &s->in_parent, &s->inertia);
        accumulate_force(&p->bias, into_parent(&s->in_parent, &s->bias));
    }
}

/* Featherstone, section 7.3 and table 7.1, in the frames of the links. The columns of a joint with several velocities
 * are eliminated one after the other, as if massless links were between them: this is Gauss's elimination of D. */
void tree_articulate(const tree *t, const double *q, const double *v) {
    add_loads(t, q, v);
    velocities(t, q, v);
    if (t->point_springs > 0) {
        tree_place(t);
        add_point_springs(t);
    }
    inertias(t);
}

/* The joint's part of pass 3: q'' = (u - U' a') / D and a' + S q'', for its columns in reverse order. */
static void joint_accelerations(const tree *t, int i, const double *u, double *a) {
    const link *l = &t->link[i];
    motion *m = &t->link_state[i].acceleration;
    for (int k = l->v + joint_velocities(l->kind) - 1; k >= l->v; k--) {
        const degree_state *e = &t->degree_state[k];
        a[k] = (u[k] - dot(e->u.linear, m->linear) - dot(e->u.angular, m->angular)) * e->inverse;
        accumulate_motion(m, along(&t->degree[k].s, a[k]));
    }
}

/* Pass 3, from the root: a' = X a_p + c, where c counts, with the acceleration of the world. */
static void accelerate(const tree *t, motion base, int moving, const double *u, double *a) {
    for (int i = 0; i < t->links; i++) {
        link_state *s = &t->link_state[i];
        const int parent = t->link[i].parent;
        s->acceleration = into_child(&s->in_parent, parent < 0 ? &base : &t->link_state[parent].acceleration);
        if (moving)
            accumulate_motion(&s->acceleration, s->product);
        joint_accelerations(t, i, u, a);
    }
}

void tree_accelerate(const tree *t, double *a) { /* gravity is as if the world accelerated */
    accelerate(t, (motion){scale(-1.0, t->gravity), {0.0, 0.0, 0.0}}, 1, t->tau, a);
}

void tree_response(const tree *t, const double *u, double *x) {
    accelerate(t, (motion){{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}}, 0, u, x);
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
    (void)time;
    tree_coordinate_rates(t, y, y + t->nq, slope);
    tree_articulate(t, y, y + t->nq);
    tree_accelerate(t, slope + t->nq);
}
