#include "tree.h"

#include <float.h>
#include <math.h>

/* S s, of one column of the motion subspace */
static motion along(const screw *s, double rate) {
    const double slide = s->slide * rate, turn = s->turn * rate;
    switch (s->axis) {
    case 0:
        return (motion){{slide, 0.0, 0.0}, {turn, 0.0, 0.0}};
    case 1:
        return (motion){{0.0, slide, 0.0}, {0.0, turn, 0.0}};
    default:
        return (motion){{0.0, 0.0, slide}, {0.0, 0.0, turn}};
    }
}

/* S' f */
static double power(const screw *s, const force *f) {
    switch (s->axis) {
    case 0:
        return s->slide * f->linear.x + s->turn * f->angular.x;
    case 1:
        return s->slide * f->linear.y + s->turn * f->angular.y;
    default:
        return s->slide * f->linear.z + s->turn * f->angular.z;
    }
}

/* I S: a column of M and of H, and a row of H and of I */
static force column(const articulated *i, const screw *s) {
    const matrix *h = &i->coupling;
    const symmetric *m = &i->mass, *j = &i->inertia;
    vector mass, moment, coupled, inertia;
    switch (s->axis) {
    case 0:
        mass = (vector){m->xx, m->xy, m->xz}, moment = h->x;
        coupled = (vector){h->x.x, h->y.x, h->z.x}, inertia = (vector){j->xx, j->xy, j->xz};
        break;
    case 1:
        mass = (vector){m->xy, m->yy, m->yz}, moment = h->y;
        coupled = (vector){h->x.y, h->y.y, h->z.y}, inertia = (vector){j->xy, j->yy, j->yz};
        break;
    default:
        mass = (vector){m->xz, m->yz, m->zz}, moment = h->z;
        coupled = (vector){h->x.z, h->y.z, h->z.z}, inertia = (vector){j->xz, j->yz, j->zz};
        break;
    }
    return (force){add(scale(s->slide, mass), scale(s->turn, moment)),
                   add(scale(s->slide, coupled), scale(s->turn, inertia))};
}

static void accumulate_motion(motion *sum, motion m) {
    sum->linear = add(sum->linear, m.linear), sum->angular = add(sum->angular, m.angular);
}

static void accumulate_force(force *sum, force f) {
    sum->linear = add(sum->linear, f.linear), sum->angular = add(sum->angular, f.angular);
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
 * I^a = I^A - U U' / D, p^a = p^A + I^a c + U u / D, and both are added to those of the parent.
 */
static void inertias(const tree *t) {
    for (int i = t->links - 1; i >= 0; i--) {
        const link *l = &t->link[i];
        link_state *s = &t->link_state[i];
        for (int k = l->v; k < l->v + joint_velocities(l->kind); k++) {
            const degree *d = &t->degree[k];
            degree_state *e = &t->degree_state[k];
            e->u = column(&s->inertia, &d->s);
            e->inverse = 1.0 / (power(&d->s, &e->u) + d->armature);
            e->unbalanced = t->tau[k] - power(&d->s, &s->bias);
            const double gain = e->unbalanced * e->inverse;
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

/* Pass 3, from the root: a' = X a_p + c; q'' = (u - U' a') / D and a' + S q'', for the columns in reverse order. */
static void accelerations(const tree *t, double *a) {
    const motion base = {scale(-1.0, t->gravity), {0.0, 0.0, 0.0}}; /* gravity, as if the world accelerated */
    for (int i = 0; i < t->links; i++) {
        const link *l = &t->link[i];
        link_state *s = &t->link_state[i];
        const motion *parent = l->parent < 0 ? &base : &t->link_state[l->parent].acceleration;
        s->acceleration = into_child(&s->in_parent, parent);
        accumulate_motion(&s->acceleration, s->product);
        for (int k = l->v + joint_velocities(l->kind) - 1; k >= l->v; k--) {
            const degree_state *e = &t->degree_state[k];
            const motion *m = &s->acceleration;
            a[k] = (e->unbalanced - dot(e->u.linear, m->linear) - dot(e->u.angular, m->angular)) * e->inverse;
            accumulate_motion(&s->acceleration, along(&t->degree[k].s, a[k]));
        }
    }
}

/* Featherstone, section 7.3 and table 7.1, in the frames of the links. The columns of a joint with several velocities
 * are eliminated one after the other, as if massless links were between them: this is Gauss's elimination of D.
 */
void tree_accelerations(const tree *t, const double *q, const double *v, double *a) {
    add_loads(t, q, v);
    velocities(t, q, v);
    inertias(t);
    accelerations(t, a);
}

void tree_rates(const void *system, double time, double *y, double *slope) {
    const tree *t = system;
    (void)time;
    for (int i = 0; i < t->links; i++) {
        const link *l = &t->link[i];
        joint_normalise(l->kind, y + l->q);
        joint_rates(l->kind, y + l->q, y + t->nq + l->v, slope + l->q);
    }
    tree_accelerations(t, y, y + t->nq, slope + t->nq);
}

static int within(int first, int count, int size) {
    return 0 <= first && first <= size - count;
}

static int all_finite(const double *x, int n) {
    for (int k = 0; k < n; k++)
        if (!isfinite(x[k]))
            return 0;
    return 1;
}

static int link_is_sound(const tree *t, int i) {
    enum { IN_PLACEMENT = sizeof(placement) / sizeof(double), IN_BODY = sizeof(body) / sizeof(double) };
    const link *l = &t->link[i];
    return within(l->kind, 1, JOINT_KINDS) && -1 <= l->parent && l->parent < i &&
           within(l->q, joint_coordinates(l->kind), t->nq) && within(l->v, joint_velocities(l->kind), t->nv) &&
           all_finite((const double *)&l->fixed, IN_PLACEMENT) && all_finite((const double *)&l->carried, IN_BODY);
}

static int degree_is_sound(const tree *t, int k) {
    const degree *d = &t->degree[k];
    const double numbers[] = {d->s.slide, d->s.turn, d->armature, d->effort, d->stiffness, d->damping, d->rest};
    return within(d->s.axis, 1, 3) && within(d->sprung, 1, t->nq) && all_finite(numbers, 7);
}

static int rotation_spring_is_sound(const tree *t, int k) {
    const rotation_spring *s = &t->rotation_spring[k];
    return within(s->q, 4, t->nq) && within(s->v, 3, t->nv) && isfinite(s->stiffness);
}

int tree_check(const tree *t) {
    int sound = t->links > 0 && t->nq > 0 && t->nv > 0 && t->rotation_springs >= 0, nq = 0, nv = 0;
    for (int i = 0; sound && i < t->links; i++) {
        sound = link_is_sound(t, i);
        nq += sound ? joint_coordinates(t->link[i].kind) : 0, nv += sound ? joint_velocities(t->link[i].kind) : 0;
    }
    for (int k = 0; sound && k < t->nv; k++)
        sound = degree_is_sound(t, k);
    for (int k = 0; sound && k < t->rotation_springs; k++)
        sound = rotation_spring_is_sound(t, k);
    return !(sound && nq == t->nq && nv == t->nv);
}
