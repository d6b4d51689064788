#include "runge_kutta.h"

#include <math.h>

/* y + h sum_j w_j k_j over m slopes, rows of n numbers: a stage, or the step */
static void stage(ptrdiff_t n, ptrdiff_t m, double h, const double *w, const double *y, const double *slopes,
                  double *result) {
    copy(n, y, result);
    for (ptrdiff_t j = 0; j < m; j++)
        if (w[j] != 0.0)
            add_scaled(n, h * w[j], slopes + j * n, result);
}

/* The stages k_1 .. k_s of a step from y, and its end: Hairer, Norsett, Wanner, section II.1, equation 1.8. */
static void advance(const pair *p, const flow *f, double t, double h, const double *y, double *slopes, double *at,
                    double *end) {
    const ptrdiff_t s = p->stages, n = f->n;
    for (ptrdiff_t i = 1; i < s; i++) {
        stage(n, i, h, p->a + i * s, y, slopes, at);
        f->rates(f->system, t + p->c[i] * h, at, slopes + i * n);
    }
    stage(n, s, h, p->b, y, slopes, end);
    f->rates(f->system, t + h, end, slopes + s * n);
}

/* The error of a step over the tolerance: section II.10, equation 10.17. With the estimates e_i,
 * |h| rms(e_0) / sqrt(|e_0|^2 + 0.01 |e_1|^2) |e_0|, where e_i is relative to tolerance (size + max(|y|, |end|)). */
static double error_of(const pair *p, const flow *f, const control *c, double h, const double *y, const double *end,
                       const double *slopes) {
    const ptrdiff_t s = p->stages, n = f->n;
    double first = 0.0, lower = 0.0, last = 0.0;
    for (ptrdiff_t i = 0; i < p->estimates; i++) {
        const double *w = p->error + i * (s + 1);
        double square = 0.0;
        for (ptrdiff_t k = 0; k < n; k++) {
            double e = 0.0;
            for (ptrdiff_t j = 0; j <= s; j++)
                e += w[j] * slopes[j * n + k];
            e /= c->size + fmax(fabs(y[k]), fabs(end[k]));
            square += e * e;
        }
        first = i ? first : square, lower += i ? square : 0.0, last = square;
    }
    const double factor = fabs(h) / c->tolerance / sqrt((double)n);
    if (first == 0.0)
        return factor * sqrt(last);
    return factor * first / fmax(sqrt(first + 0.01 * lower), c->tiny);
}

/* The factor of the next step after an accepted one. */
static double growth(const pair *p, const control *c, double error, double ceiling) {
    return fmin(ceiling, c->safety * pow(fmax(error, c->tiny), -c->gain / (double)p->order));
}

/* The factor of the next try after a rejected step; an error that is no number is a large one. */
static double shrinkage(const pair *p, const control *c, double error) {
    return error < c->huge ? fmax(c->slowest, c->safety * pow(error, -1.0 / (double)p->order)) : c->lost;
}

void pair_steps(const pair *p, const flow *f, const control *c, course *m) {
    const ptrdiff_t n = f->n, block = (p->stages + 1) * n;
    double *at = m->scratch, *end = m->scratch + n;
    while (course_continues(m, c)) {
        const int last = m->t + 1.01 * m->h >= m->end;
        const double taken = last ? m->end - m->t : m->h;
        double *slopes = m->slopes + m->written * block;
        advance(p, f, m->t, taken, m->y, slopes, at, end);
        const double error = error_of(p, f, c, taken, m->y, end, slopes);
        const double floor = error < c->noise / c->tolerance ? *f->floor : 0.0;
        const int floored = error > 1.0 && taken <= 1.001 * floor;
        m->tries--;
        if (error <= 1.0 || floored) {
            const double following = taken * growth(p, c, fmin(error, 1.0), m->ceiling);
            copy(n, slopes + block - n, slopes + block); /* k_s is k_0 of the next step */
            course_accept(m, n, taken, last, end);
            m->floored[m->written - 1] = floored;
            m->handed = f->settle && !f->settle(f->system, m->t, m->y, slopes + block);
            const double next = floored ? fmax(following, *f->floor) : following;
            m->h = last ? fmax(m->h, next) : next;
            m->ceiling = c->fastest;
        } else { /* NaN included */
            m->rejected++;
            m->h = fmax(taken * shrinkage(p, c, error), floor);
            m->ceiling = 1.0;
        }
    }
}
