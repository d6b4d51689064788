#include "bodies.h"

#include <math.h>
#include <string.h>

static double length(vector a) { return sqrt(dot(a, a)); }

/* Column v of six rows of nv. */
static motion column(const double *columns, ptrdiff_t nv, ptrdiff_t v) {
    const double *c = columns + v;
    return (motion){{c[0], c[nv], c[2 * nv]}, {c[3 * nv], c[4 * nv], c[5 * nv]}};
}

/* Add the powers of link i along the velocities that move it: I V', V x* I V and the wrench against its weight, by
 * Newton's and Euler's equations, and m g times the way of its mass centre. Return sum |f| |v| + |m| |w| of the three. */
static double add_powers(const bodies *b, ptrdiff_t i, const placement *x, const motion *twist, const motion *rate,
                         const double *columns, double *asked, double *sizes) {
    const body *m = &b->body[i];
    const motion against = {transposed_times(&x->rotation, scale(-1.0, b->gravity)), ZERO};
    const force parts[3] = {body_times(m, rate), gyroscopic(m, twist), body_times(m, &against)};
    const vector moment = add(scale(m->mass, x->translation), times(&x->rotation, m->moment));
    const double g = length(b->gravity);
    double forces = 0.0, moments = 0.0;
    force acting[3];
    for (int k = 0; k < 3; k++) {
        forces += length(parts[k].linear), moments += length(parts[k].angular);
        acting[k] = into_parent(x, &parts[k]);
    }
    for (ptrdiff_t j = i; j > 0; j = b->parent[j])
        for (ptrdiff_t v = b->first[j]; v < b->first[j] + b->count[j]; v++) {
            const motion s = column(columns, b->nv, v);
            for (int k = 0; k < 3; k++) {
                const double power = dot(acting[k].linear, s.linear) + dot(acting[k].angular, s.angular);
                asked[v] += power, sizes[v] += fabs(power);
            }
            sizes[v] += g * length(add(scale(m->mass, s.linear), cross(s.angular, moment)));
        }
    return forces * length(twist->linear) + moments * length(twist->angular);
}

void bodies_powers(const bodies *b, ptrdiff_t n, const matrix *turns, const vector *places, const motion *twists,
                   const motion *rates, const double *columns, double *asked, double *sizes, double *most) {
    memset(asked, 0, (size_t)(n * b->nv) * sizeof *asked), memset(sizes, 0, (size_t)(n * b->nv) * sizeof *sizes);
    for (ptrdiff_t s = 0; s < n; s++) {
        most[s] = 0.0;
        for (ptrdiff_t i = 1; i < b->links; i++) {
            const ptrdiff_t k = s * b->links + i;
            const placement x = {turns[k], places[k]};
            most[s] += add_powers(b, i, &x, &twists[k], &rates[k], columns + 6 * s * b->nv, asked + s * b->nv,
                                  sizes + s * b->nv);
        }
    }
}
