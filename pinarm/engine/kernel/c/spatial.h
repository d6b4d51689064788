/* Spatial algebra: motions, forces, placements and inertias of links, in components about the origin of a link frame.
 * Source: Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 2, appendix A. As in Pinocchio the linear part
 * stands first. With a placement (R, r) of a child frame in its parent's, a vector x of the child is R x in the parent. */
#pragma once

typedef struct { double x, y, z; } vector;
typedef struct { vector x, y, z; } matrix; /* rows */
typedef struct { double xx, xy, xz, yy, yz, zz; } symmetric;
typedef struct { vector linear, angular; } motion; /* velocity or acceleration of the frame's origin, and angular */
typedef struct { vector linear, angular; } force; /* force, and moment about the frame's origin */
typedef struct { matrix rotation; vector translation; } placement;

/* A rigid body: mass m, m c with the centre of mass c, and the inertia about the origin of the frame. */
typedef struct { double mass; vector moment; symmetric inertia; } body;

/* An articulated inertia: f = M a + H' alpha, n = H a + I alpha; section 7.1. */
typedef struct { symmetric mass; matrix coupling; symmetric inertia; } articulated; /* M, H, I */

static const vector ZERO = {0.0, 0.0, 0.0};
static const motion NO_MOTION = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
static const force NO_FORCE = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};

static inline vector add(vector a, vector b) { return (vector){a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline vector subtract(vector a, vector b) { return (vector){a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline vector scale(double s, vector a) { return (vector){s * a.x, s * a.y, s * a.z}; }
static inline double dot(vector a, vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline vector cross(vector a, vector b) {
    return (vector){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline void accumulate_motion(motion *sum, motion m) {
    sum->linear = add(sum->linear, m.linear), sum->angular = add(sum->angular, m.angular);
}
static inline void accumulate_force(force *sum, force f) {
    sum->linear = add(sum->linear, f.linear), sum->angular = add(sum->angular, f.angular);
}

/* A x */
static inline vector times(const matrix *a, vector x) { return (vector){dot(a->x, x), dot(a->y, x), dot(a->z, x)}; }

/* A' x */
static inline vector transposed_times(const matrix *a, vector x) {
    return add(add(scale(x.x, a->x), scale(x.y, a->y)), scale(x.z, a->z));
}

/* S x */
static inline vector symmetric_times(const symmetric *s, vector x) {
    return (vector){
        s->xx * x.x + s->xy * x.y + s->xz * x.z,
        s->xy * x.x + s->yy * x.y + s->yz * x.z,
        s->xz * x.x + s->yz * x.y + s->zz * x.z,
    };
}

/* A B */
static inline matrix product(const matrix *a, const matrix *b) {
    return (matrix){transposed_times(b, a->x), transposed_times(b, a->y), transposed_times(b, a->z)};
}

/* A' B */
static inline matrix transposed_product(const matrix *a, const matrix *b) {
    const matrix t = {{a->x.x, a->y.x, a->z.x}, {a->x.y, a->y.y, a->z.y}, {a->x.z, a->y.z, a->z.z}};
    return product(&t, b);
}

/* R S R' */
static inline symmetric rotated(const matrix *r, const symmetric *s) {
    const vector x = symmetric_times(s, r->x), y = symmetric_times(s, r->y), z = symmetric_times(s, r->z);
    return (symmetric){dot(x, r->x), dot(x, r->y), dot(x, r->z), dot(y, r->y), dot(y, r->z), dot(z, r->z)};
}

/* The placement of a frame that is placed by b in a frame that is placed by a. */
static inline placement composed(const placement *a, const placement *b) {
    return (placement){product(&a->rotation, &b->rotation),
                       add(times(&a->rotation, b->translation), a->translation)};
}

/* A motion of the parent as the child sees it: w = R' w_p, v = R' (v_p + w_p x r); equation 2.24. */
static inline motion into_child(const placement *x, const motion *m) {
    return (motion){transposed_times(&x->rotation, add(m->linear, cross(m->angular, x->translation))),
                    transposed_times(&x->rotation, m->angular)};
}

/* A force on the child as the parent feels it: f_p = R f, n_p = R n + r x R f; equation 2.25. */
static inline force into_parent(const placement *x, const force *f) {
    const vector linear = times(&x->rotation, f->linear);
    return (force){linear, add(times(&x->rotation, f->angular), cross(x->translation, linear))};
}

/* v x m; equation 2.31. */
static inline motion motion_cross(const motion *v, const motion *m) {
    return (motion){add(cross(v->angular, m->linear), cross(v->linear, m->angular)), cross(v->angular, m->angular)};
}

/* I m; equation 2.63. */
static inline force body_times(const body *b, const motion *m) {
    return (force){add(scale(b->mass, m->linear), cross(m->angular, b->moment)),
                   add(symmetric_times(&b->inertia, m->angular), cross(b->moment, m->linear))};
}

/* v x* (I v), the force that a body needs to go on with the velocity v; equations 2.32 and 2.68. */
static inline force gyroscopic(const body *b, const motion *v) {
    const force i = body_times(b, v);
    return (force){cross(v->angular, i.linear), add(cross(v->angular, i.angular), cross(v->linear, i.linear))};
}

/* The inertia of a rigid body as an articulated one: M = m 1, H = [m c]; equation 2.63. */
static inline articulated rigid(const body *b) {
    const vector c = b->moment;
    return (articulated){
        {b->mass, 0.0, 0.0, b->mass, 0.0, b->mass},
        {{0.0, -c.z, c.y}, {c.z, 0.0, -c.x}, {-c.y, c.x, 0.0}},
        b->inertia,
    };
}

static inline void add_symmetric(symmetric *sum, const symmetric *s) {
    sum->xx += s->xx, sum->xy += s->xy, sum->xz += s->xz;
    sum->yy += s->yy, sum->yz += s->yz, sum->zz += s->zz;
}

static inline void add_matrix(matrix *sum, const matrix *m) {
    sum->x = add(sum->x, m->x), sum->y = add(sum->y, m->y), sum->z = add(sum->z, m->z);
}

/* Add an inertia of the child to that of its parent. With the inertia turned into the parent's axes, M, H and I:
 * H_p = H + [r] M, I_p = I + [r] H_p' + ([r] H')'; equation 2.66 for articulated inertias, section A.4. */
static inline void add_into_parent(articulated *parent, const placement *x, const articulated *child) {
    const matrix *r = &x->rotation;
    const vector t = x->translation;
    const symmetric m = rotated(r, &child->mass), i = rotated(r, &child->inertia);
    const matrix rh = product(r, &child->coupling);
    const matrix h = {times(r, rh.x), times(r, rh.y), times(r, rh.z)};
    const vector mx = cross(t, (vector){m.xx, m.xy, m.xz}), my = cross(t, (vector){m.xy, m.yy, m.yz}),
                 mz = cross(t, (vector){m.xz, m.yz, m.zz}); /* the columns of [r] M */
    const matrix hp = {add(h.x, (vector){mx.x, my.x, mz.x}), add(h.y, (vector){mx.y, my.y, mz.y}),
                       add(h.z, (vector){mx.z, my.z, mz.z})};
    const vector px = cross(t, hp.x), py = cross(t, hp.y), pz = cross(t, hp.z); /* the columns of [r] H_p' */
    const vector cx = cross(t, h.x), cy = cross(t, h.y), cz = cross(t, h.z);    /* the columns of [r] H' */
    const symmetric ip = {
        i.xx + px.x + cx.x, i.xy + py.x + cx.y, i.xz + pz.x + cx.z,
        i.yy + py.y + cy.y, i.yz + pz.y + cy.z, i.zz + pz.z + cz.z,
    };
    add_symmetric(&parent->mass, &m);
    add_matrix(&parent->coupling, &hp);
    add_symmetric(&parent->inertia, &ip);
}

/* a b', of which the upper triangle is taken */
static inline symmetric outer(vector a, vector b) {
    return (symmetric){a.x * b.x, a.x * b.y, a.x * b.z, a.y * b.y, a.y * b.z, a.z * b.z};
}

/* I - s U U', where U is a force. */
static inline void subtract_square(articulated *i, double s, const force *u) {
    const vector f = scale(-s, u->linear), n = scale(-s, u->angular);
    const symmetric ff = outer(f, u->linear), nn = outer(n, u->angular);
    add_symmetric(&i->mass, &ff);
    add_symmetric(&i->inertia, &nn);
    const matrix nf = {scale(n.x, u->linear), scale(n.y, u->linear), scale(n.z, u->linear)};
    add_matrix(&i->coupling, &nf);
}
