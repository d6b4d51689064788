#include "joints.h"

#include <math.h>

/* A joint with several coordinates: some are lengths along x, y and z, then come those of a rotation. */
typedef struct { int slides, coordinates; } layout; /* how many lengths, and numbers of a pair, a quaternion or 0 */

enum { NONE, PAIR = 2, QUATERNION = 4 };

static const layout LAYOUTS[JOINT_KINDS] = {
    [CONTINUOUS] = {0, PAIR}, [BALL] = {0, QUATERNION},  [FLOATING] = {3, QUATERNION},
    [PLANAR] = {2, PAIR},     [TRANSLATION] = {3, NONE},
};

int joint_velocities(int kind) {
    const int turned = LAYOUTS[kind].coordinates;
    return kind == SCREW ? 1 : LAYOUTS[kind].slides + (turned == QUATERNION ? 3 : turned == PAIR);
}

/* R Rz, where Rz turns by an angle about z. */
static matrix turned(const matrix *r, double cosine, double sine) {
    const vector rows[3] = {r->x, r->y, r->z};
    vector of[3];
    for (int k = 0; k < 3; k++)
        of[k] = (vector){cosine * rows[k].x + sine * rows[k].y, cosine * rows[k].y - sine * rows[k].x, rows[k].z};
    return (matrix){of[0], of[1], of[2]};
}

/* The rotation of a unit quaternion x, y, z, w: Featherstone, equation 4.12. */
static matrix quaternion_rotation(const double *q) {
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    return (matrix){
        {1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)},
        {2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)},
        {2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)},
    };
}

/* The rotation of a joint's coordinates, behind its lengths. */
static matrix rotation_of(const layout *p, const double *x) {
    static const matrix identity = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
    if (p->coordinates == PAIR)
        return turned(&identity, x[0], x[1]);
    return p->coordinates == QUATERNION ? quaternion_rotation(x) : identity;
}

/* The lengths among the numbers of a joint, as a vector. */
static vector slid(const layout *p, const double *x) {
    return (vector){p->slides > 0 ? x[0] : 0.0, p->slides > 1 ? x[1] : 0.0, p->slides > 2 ? x[2] : 0.0};
}

/* The rotations among its velocities, as a vector. */
static vector spun(const layout *p, const double *v) {
    const double *w = v + p->slides;
    if (p->coordinates == QUATERNION)
        return (vector){w[0], w[1], w[2]};
    return (vector){0.0, 0.0, p->coordinates == PAIR ? w[0] : 0.0};
}

static void add_slides(const layout *p, vector by, double *x) {
    const double each[3] = {by.x, by.y, by.z};
    for (int k = 0; k < p->slides; k++)
        x[k] += each[k];
}

placement joint_placement(const link *l, const screw *s, const double *q) {
    placement x = l->fixed;
    if (l->kind == SCREW) {
        if (s->slide != 0.0)
            x.translation = add(x.translation, times(&x.rotation, (vector){0.0, 0.0, s->slide * q[0]}));
        if (s->turn != 0.0)
            x.rotation = turned(&l->fixed.rotation, cos(s->turn * q[0]), sin(s->turn * q[0]));
        return x;
    }
    const layout *p = &LAYOUTS[l->kind];
    const matrix r = rotation_of(p, q + p->slides);
    return (placement){product(&x.rotation, &r), add(x.translation, times(&x.rotation, slid(p, q)))};
}

void joint_normalise(int kind, double *q) {
    double square = 0.0, *x = q + LAYOUTS[kind].slides;
    for (int k = 0; k < LAYOUTS[kind].coordinates; k++)
        square += x[k] * x[k];
    for (int k = 0; k < LAYOUTS[kind].coordinates; k++)
        x[k] /= sqrt(square);
}

/* How many times the angle of a rotation its coordinates hold. */
static double share(const layout *p) { return p->coordinates == QUATERNION ? 0.5 : 1.0; }

/* The product of a (cos, sin) pair or a quaternion and one with the sine b and the cosine c: equations 4.12, 4.13. */
static void multiply(const layout *p, const double *x, vector b, double c, double *result) {
    if (p->coordinates == PAIR) {
        const double cosine = x[0] * c - x[1] * b.z;
        result[1] = x[1] * c + x[0] * b.z, result[0] = cosine;
    }
    if (p->coordinates == QUATERNION) {
        const vector a = {x[0], x[1], x[2]};
        const vector sum = add(add(scale(x[3], b), scale(c, a)), cross(a, b));
        result[3] = x[3] * c - dot(a, b);
        result[0] = sum.x, result[1] = sum.y, result[2] = sum.z;
    }
}

void joint_rates(int kind, const double *q, const double *v, double *rates) {
    const layout *p = &LAYOUTS[kind];
    const double *x = q + p->slides;
    if (kind == SCREW)
        rates[0] = v[0];
    if (p->slides) {
        const matrix r = rotation_of(p, x);
        for (int k = 0; k < p->slides; k++)
            rates[k] = 0.0;
        add_slides(p, times(&r, slid(p, v)), rates);
    }
    multiply(p, x, scale(share(p), spun(p, v)), 0.0, rates + p->slides);
}

/* V u, the way of a frame that moves along and about itself by u and w: exp of (u, w) has the translation
 * u + (1 - cos n) / n^2 w x u + (n - sin n) / n^3 w x (w x u), n = |w|. */
static vector way_of(vector u, vector w) {
    const double square = dot(w, w), n = sqrt(square);
    const double half = n > 1e-4 ? (1.0 - cos(n)) / square : 0.5 - square / 24.0;
    const double sixth = n > 1e-2 ? (n - sin(n)) / (n * square) : 1.0 / 6.0 - square / 120.0 + square * square / 5040.0;
    const vector first = cross(w, u);
    return add(u, add(scale(half, first), scale(sixth, cross(w, first))));
}

void joint_move(int kind, double s, const double *x, double *q) {
    const layout *p = &LAYOUTS[kind];
    const vector w = scale(s, spun(p, x));
    const double n = share(p) * sqrt(dot(w, w)), sine = n > 1e-8 ? sin(n) / n : 1.0;
    if (kind == SCREW)
        q[0] += s * x[0];
    if (p->slides) {
        const matrix r = rotation_of(p, q + p->slides);
        add_slides(p, times(&r, way_of(scale(s, slid(p, x)), w)), q);
    }
    multiply(p, q + p->slides, scale(share(p) * sine, w), cos(n), q + p->slides);
    joint_normalise(kind, q);
}
