#include "bodies.h"

#include <math.h>

static double length(vector a) { return sqrt(dot(a, a)); }

/* Column v of six rows of nv. */
static motion column(const double *columns, ptrdiff_t nv, ptrdiff_t v) {
    const double *c = columns + v;
    return (motion){{c[0], c[nv], c[2 * nv]}, {c[3 * nv], c[4 * nv], c[5 * nv]}};
}

/* Add what the motion of link i demands by Newton's and Euler's equations, I V', V x* I V and the wrench against its
 * weight, and the sizes of these, forces with the centre of mass as an arm. Return sum |f| |v| + |m| |w| of the three. */
static double add_demand(const bodies *b, ptrdiff_t i, const matrix *turn, const motion *twist, const motion *rate,
                         force *wrench, wrench_size *size) {
    const body *m = &b->body[i];
    const motion against = {transposed_times(turn, scale(-1.0, b->gravity)), ZERO};
    const force parts[3] = {body_times(m, rate), gyroscopic(m, twist), body_times(m, &against)};
    double forces = 0.0, moments = 0.0;
    for (int k = 0; k < 3; k++) {
        const force part = {times(turn, parts[k].linear), times(turn, parts[k].angular)};
        accumulate_force(wrench, part);
        forces += length(part.linear), moments += length(part.angular);
    }
    size->force += forces, size->moment += moments + (m->mass > 0.0 ? length(m->moment) / m->mass : 0.0) * forces;
    return forces * length(twist->linear) + moments * length(twist->angular);
}

/* Write the powers along the joint of link i, and add its sums to those of its parent, whose origin is an arm away. */
static void carry(const bodies *b, ptrdiff_t i, const vector *places, const double *columns, force *wrenches,
                  wrench_size *sizes, double *asked, double *terms) {
    const ptrdiff_t parent = b->parent[i];
    const force f = wrenches[i];
    const wrench_size size = sizes[i];
    for (ptrdiff_t v = b->first[i]; v < b->first[i] + b->count[i]; v++) {
        const motion s = column(columns, b->nv, v);
        const vector own = add(s.linear, cross(s.angular, places[i]));
        asked[v] = dot(f.linear, own) + dot(f.angular, s.angular);
        terms[v] = size.force * length(own) + size.moment * length(s.angular);
    }
    const vector arm = subtract(places[i], places[parent]);
    const force moved = {f.linear, add(f.angular, cross(arm, f.linear))};
    accumulate_force(&wrenches[parent], moved);
    sizes[parent].force += size.force, sizes[parent].moment += size.moment + length(arm) * size.force;
}

void bodies_powers(const bodies *b, ptrdiff_t n, const matrix *turns, const vector *places, const motion *twists,
                   const motion *rates, const double *columns, force *wrenches, wrench_size *sizes, double *asked,
                   double *terms, double *most) {
    for (ptrdiff_t s = 0, k = 0; s < n; s++, k += b->links) {
        most[s] = 0.0;
        for (ptrdiff_t i = 1; i < b->links; i++)
            most[s] += add_demand(b, i, &turns[k + i], &twists[k + i], &rates[k + i], &wrenches[k + i], &sizes[k + i]);
        for (ptrdiff_t i = b->links - 1; i > 0; i--)
            carry(b, i, places + k, columns + 6 * s * b->nv, wrenches + k, sizes + k, asked + s * b->nv,
                  terms + s * b->nv);
    }
}
