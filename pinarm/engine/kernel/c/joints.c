#include "joints.h"

#include <math.h>

int joint_coordinates(int kind) {
    static const int coordinates[JOINT_KINDS] = {1, 2, 4, 7, 4, 3};
    return coordinates[kind];
}

int joint_velocities(int kind) {
    static const int velocities[JOINT_KINDS] = {1, 1, 3, 6, 3, 3};
    return velocities[kind];
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

static placement moved(const placement *fixed, vector by) {
    return (placement){fixed->rotation, add(fixed->translation, times(&fixed->rotation, by))};
}

placement joint_placement(const link *l, const screw *s, const double *q) {
    placement x = l->fixed;
    matrix r;
    switch (l->kind) {
    case SCREW:
        if (s->slide != 0.0)
            x = moved(&x, (vector){0.0, 0.0, s->slide * q[0]});
        if (s->turn != 0.0)
            x.rotation = turned(&l->fixed.rotation, cos(s->turn * q[0]), sin(s->turn * q[0]));
        break;
    case CONTINUOUS:
        x.rotation = turned(&l->fixed.rotation, q[0], q[1]);
        break;
    case BALL:
        r = quaternion_rotation(q);
        x.rotation = product(&l->fixed.rotation, &r);
        break;
    case FLOATING:
        r = quaternion_rotation(q + 3);
        x = moved(&x, (vector){q[0], q[1], q[2]});
        x.rotation = product(&l->fixed.rotation, &r);
        break;
    case PLANAR:
        x = moved(&x, (vector){q[0], q[1], 0.0});
        x.rotation = turned(&l->fixed.rotation, q[2], q[3]);
        break;
    case TRANSLATION:
        x = moved(&x, (vector){q[0], q[1], q[2]});
        break;
    default:
        break;
    }
    return x;
}

static void normalise(double *x, int n) {
    double square = 0.0;
    for (int k = 0; k < n; k++)
        square += x[k] * x[k];
    const double length = sqrt(square);
    for (int k = 0; k < n; k++)
        x[k] /= length;
}

void joint_normalise(int kind, double *q) {
    switch (kind) {
    case CONTINUOUS:
        normalise(q, 2);
        break;
    case BALL:
        normalise(q, 4);
        break;
    case FLOATING:
        normalise(q + 3, 4);
        break;
    case PLANAR:
        normalise(q + 2, 2);
        break;
    default:
        break;
    }
}

/* Half the product of a quaternion with an angular velocity in the frame that it turns: Featherstone, equation 4.13. */
static void quaternion_rates(const double *q, const double *w, double *rates) {
    rates[0] = 0.5 * (q[3] * w[0] + q[1] * w[2] - q[2] * w[1]);
    rates[1] = 0.5 * (q[3] * w[1] + q[2] * w[0] - q[0] * w[2]);
    rates[2] = 0.5 * (q[3] * w[2] + q[0] * w[1] - q[1] * w[0]);
    rates[3] = -0.5 * (q[0] * w[0] + q[1] * w[1] + q[2] * w[2]);
}

void joint_rates(int kind, const double *q, const double *v, double *rates) {
    matrix r;
    vector u;
    switch (kind) {
    case SCREW:
        rates[0] = v[0];
        break;
    case CONTINUOUS:
        rates[0] = -q[1] * v[0], rates[1] = q[0] * v[0];
        break;
    case BALL:
        quaternion_rates(q, v, rates);
        break;
    case FLOATING:
        r = quaternion_rotation(q + 3);
        u = times(&r, (vector){v[0], v[1], v[2]});
        rates[0] = u.x, rates[1] = u.y, rates[2] = u.z;
        quaternion_rates(q + 3, v + 3, rates + 3);
        break;
    case PLANAR:
        rates[0] = q[2] * v[0] - q[3] * v[1], rates[1] = q[3] * v[0] + q[2] * v[1];
        rates[2] = -q[3] * v[2], rates[3] = q[2] * v[2];
        break;
    case TRANSLATION:
        rates[0] = v[0], rates[1] = v[1], rates[2] = v[2];
        break;
    default:
        break;
    }
}

/* V u, the way of a frame that moves along and about itself by u and w: exp of (u, w) has the translation
 * u + (1 - cos n) / n^2 w x u + (n - sin n) / n^3 w x (w x u), n = |w|.
 */
static vector way_of(vector u, vector w) {
    const double square = dot(w, w), n = sqrt(square);
    const double half = n > 1e-4 ? (1.0 - cos(n)) / square : 0.5 - square / 24.0;
    const double sixth = n > 1e-2 ? (n - sin(n)) / (n * square) : 1.0 / 6.0 - square / 120.0 + square * square / 5040.0;
    const vector first = cross(w, u);
    return add(u, add(scale(half, first), scale(sixth, cross(w, first))));
}

/* The product of a quaternion and exp(w / 2). */
static void turn_quaternion(double *q, const double *w) {
    const double n = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    const double s = n > 1e-8 ? sin(0.5 * n) / n : 0.5, c = cos(0.5 * n);
    const vector a = {q[0], q[1], q[2]}, b = {s * w[0], s * w[1], s * w[2]};
    const vector sum = add(add(scale(q[3], b), scale(c, a)), cross(a, b));
    q[3] = q[3] * c - dot(a, b);
    q[0] = sum.x, q[1] = sum.y, q[2] = sum.z;
    normalise(q, 4);
}

/* Turn a (cos, sin) pair by an angle. */
static void turn_pair(double *q, double angle) {
    const double c = cos(angle), s = sin(angle), cosine = q[0] * c - q[1] * s;
    q[1] = q[1] * c + q[0] * s;
    q[0] = cosine;
    normalise(q, 2);
}

void joint_move(int kind, double *q, const double *x) {
    matrix r;
    vector u;
    switch (kind) {
    case SCREW:
        q[0] += x[0];
        break;
    case CONTINUOUS:
        turn_pair(q, x[0]);
        break;
    case BALL:
        turn_quaternion(q, x);
        break;
    case FLOATING:
        r = quaternion_rotation(q + 3);
        u = times(&r, way_of((vector){x[0], x[1], x[2]}, (vector){x[3], x[4], x[5]}));
        q[0] += u.x, q[1] += u.y, q[2] += u.z;
        turn_quaternion(q + 3, x + 3);
        break;
    case PLANAR:
        u = way_of((vector){x[0], x[1], 0.0}, (vector){0.0, 0.0, x[2]});
        q[0] += q[2] * u.x - q[3] * u.y, q[1] += q[3] * u.x + q[2] * u.y;
        turn_pair(q + 2, x[2]);
        break;
    case TRANSLATION:
        q[0] += x[0], q[1] += x[1], q[2] += x[2];
        break;
    default:
        break;
    }
}
