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
