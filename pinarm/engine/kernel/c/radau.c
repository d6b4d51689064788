#include "radau.h"

#include <float.h>
#include <math.h>

static double size_of(double complex a) { return fabs(creal(a)) + fabs(cimag(a)); }

static void exchange(ptrdiff_t n, double complex *a, double complex *b) {
    for (ptrdiff_t k = 0; k < n; k++) {
        const double complex kept = a[k];
        a[k] = b[k], b[k] = kept;
    }
}

/* P A = L U with rows exchanged for the largest pivot, whose reciprocal is stored; return 0 where A is singular. */
static int factorise(ptrdiff_t n, double complex *a, ptrdiff_t *pivot) {
    for (ptrdiff_t k = 0; k < n; k++) {
        ptrdiff_t p = k;
        for (ptrdiff_t i = k + 1; i < n; i++)
            if (size_of(a[i * n + k]) > size_of(a[p * n + k]))
                p = i;
        if (!(size_of(a[p * n + k]) > 0.0)) /* NaN included */
            return 0;
        pivot[k] = p;
        if (p != k)
            exchange(n, a + k * n, a + p * n);
        const double complex inverse = a[k * n + k] = 1.0 / a[k * n + k];
        for (ptrdiff_t i = k + 1; i < n; i++)
            if (size_of(a[i * n + k]) != 0.0) {
                const double complex l = a[i * n + k] *= inverse;
                for (ptrdiff_t j = k + 1; j < n; j++)
                    a[i * n + j] -= l * a[k * n + j];
            }
    }
    return 1;
}

/* x = A^-1 x of a factorised A */
static void substitute(ptrdiff_t n, const double complex *a, const ptrdiff_t *pivot, double complex *x) {
    for (ptrdiff_t k = 0; k < n; k++)
        exchange(1, x + k, x + pivot[k]);
    for (ptrdiff_t i = 0; i < n; i++)
        for (ptrdiff_t k = 0; k < i; k++)
            x[i] -= a[i * n + k] * x[k];
    for (ptrdiff_t i = n - 1; i >= 0; i--) {
        for (ptrdiff_t k = i + 1; k < n; k++)
            x[i] -= a[i * n + k] * x[k];
        x[i] *= a[i * n + i];
    }
}

/* The root of the mean square of values over tolerance (size + max(|y|, |end|)), over s rows of n. */
static double relative(const control *c, ptrdiff_t s, ptrdiff_t n, const double *values, const double *y,
                       const double *end) {
    double sum = 0.0;
    for (ptrdiff_t i = 0; i < s; i++)
        for (ptrdiff_t k = 0; k < n; k++) {
            const double e = values[i * n + k] / (c->tolerance * (c->size + fmax(fabs(y[k]), fabs(end[k]))));
            sum += e * e;
        }
    return sqrt(sum / (double)(s * n));
}

/* slope = f(t, y); y is normalised. */
static void evaluate(const flow *f, newton *x, double t, double *y, double *slope) {
    f->rates(f->system, t, y, slope);
    x->evaluations++;
}

/* J at the present state, by forward differences with steps of the root of rounding. */
static void differentiate(const flow *f, const course *m, newton *x) {
    const ptrdiff_t n = f->n;
    double *at = m->scratch, *slope = m->scratch + n;
    for (ptrdiff_t j = 0; j < n; j++) {
        copy(n, m->y, at);
        at[j] += sqrt(DBL_EPSILON * fmax(1e-5, fabs(at[j])));
        const double apart = at[j] - m->y[j];
        evaluate(f, x, m->t, at, slope);
        for (ptrdiff_t i = 0; i < n; i++)
            x->jacobian[i * n + j] = (slope[i] - x->slope[i]) / apart;
    }
}

/* The systems lambda_i / h - J of a step; return 0 where one is singular. */
static int prepare(const radau *p, ptrdiff_t n, double h, newton *x) {
    x->factorised = 0.0;
    for (ptrdiff_t i = 0; i < p->systems; i++) {
        double complex *a = x->system + i * n * n;
        for (ptrdiff_t k = 0; k < n * n; k++)
            a[k] = -x->jacobian[k];
        for (ptrdiff_t k = 0; k < n; k++)
            a[k * n + k] += p->eigenvalue[i] / h;
        if (!factorise(n, a, x->pivot + i * n))
            return 0;
    }
    x->factorised = h;
    return 1;
}

/* The first Z of a step: the collocation polynomial of the last one, beyond its end. */
static void extrapolate(const radau *p, ptrdiff_t n, double h, const newton *x, double *z) {
    const ptrdiff_t s = p->stages;
    memset(z, 0, (size_t)(s * n) * sizeof *z);
    if (x->length == 0.0)
        return;
    for (ptrdiff_t i = 0; i < s; i++) {
        const double at = 1.0 + p->c[i] * h / x->length;
        for (ptrdiff_t j = 0; j < s; j++) {
            double weight = 0.0; /* sum_k at^(k + 1) powers_kj, by Horner's rule */
            for (ptrdiff_t k = s - 1; k >= 0; k--)
                weight = at * (weight + p->powers[k * s + j]);
            add_scaled(n, weight, x->last + j * n, z + i * n);
        }
        add_scaled(n, -1.0, x->last + (s - 1) * n, z + i * n);
    }
}

/* One iteration: (lambda_i / h - J) w_i = (forth (f(y + Z) - A^-1 Z / h))_i, then Z += Re(back w). */
static void correct(const radau *p, const flow *f, const course *m, double h, newton *x, double *z) {
    const ptrdiff_t s = p->stages, n = f->n;
    double *at = m->scratch, *left = x->change;
    for (ptrdiff_t i = 0; i < s; i++) {
        copy(n, m->y, at);
        add_scaled(n, 1.0, z + i * n, at);
        evaluate(f, x, m->t + p->c[i] * h, at, left + i * n);
        for (ptrdiff_t j = 0; j < s; j++)
            add_scaled(n, -p->inverse[i * s + j] / h, z + j * n, left + i * n);
    }
    for (ptrdiff_t i = 0; i < p->systems; i++) {
        double complex *right = x->right + i * n;
        memset(right, 0, (size_t)n * sizeof *right);
        for (ptrdiff_t j = 0; j < s; j++)
            for (ptrdiff_t k = 0; k < n; k++)
                right[k] += p->forth[i * s + j] * left[j * n + k];
        substitute(n, x->system + i * n * n, x->pivot + i * n, right);
    }
    memset(x->change, 0, (size_t)(s * n) * sizeof *x->change);
    for (ptrdiff_t j = 0; j < s; j++)
        for (ptrdiff_t i = 0; i < p->systems; i++)
            for (ptrdiff_t k = 0; k < n; k++)
                x->change[j * n + k] += creal(p->back[j * p->systems + i] * x->right[i * n + k]);
    add_scaled(s * n, 1.0, x->change, z);
}

/* Simplified Newton iterations for Z; return whether they converged, fast enough to be worth them. */
static int solve(const radau *p, const flow *f, const control *c, const course *m, double h, newton *x, double *z) {
    double before = 0.0;
    extrapolate(p, f->n, h, x, z);
    x->promise = pow(fmax(x->promise, 1e-16), 0.8);
    for (ptrdiff_t k = 0; k < p->iterations; k++) {
        correct(p, f, m, h, x, z);
        const double size = relative(c, p->stages, f->n, x->change, m->y, m->y);
        x->rate = before > 0.0 ? size / before : 0.0;
        if (!(x->rate < 1.0) || !isfinite(size))
            return 0;
        if (k)
            x->promise = x->rate / (1.0 - x->rate);
        if (x->promise * size <= p->enough) {
            x->iterations = k + 1;
            return 1;
        }
        if (k && x->promise * pow(x->rate, (double)(p->iterations - 2 - k)) * size > p->enough)
            return 0;
        before = size;
    }
    return 0;
}

/* error = (lambda_0 / h - J)^-1 (lambda_0 / h (weights Z) + slope) */
static void filter(const radau *p, ptrdiff_t n, double h, newton *x, const double *z, const double *slope,
                   double *error) {
    for (ptrdiff_t k = 0; k < n; k++) {
        double sum = 0.0;
        for (ptrdiff_t j = 0; j < p->stages; j++)
            sum += p->error[j] * z[j * n + k];
        x->right[k] = creal(p->eigenvalue[0]) / h * sum + slope[k];
    }
    substitute(n, x->system, x->pivot, x->right);
    for (ptrdiff_t k = 0; k < n; k++)
        error[k] = creal(x->right[k]);
}

/* The error of a step over the tolerance. Where it is large after a rejected step, or in the first one, it is filtered
 * once more, with the slope at y + error: fast transients decay. */
static double estimate(const radau *p, const flow *f, const control *c, const course *m, double h, newton *x,
                       const double *z) {
    const ptrdiff_t n = f->n;
    double *at = m->scratch, *end = m->scratch + n, *error = m->scratch + 2 * n;
    copy(n, m->y, end);
    add_scaled(n, 1.0, z + (p->stages - 1) * n, end);
    filter(p, n, h, x, z, x->slope, error);
    double size = relative(c, 1, n, error, m->y, end);
    if (size > 1.0 && (m->ceiling == 1.0 || x->length == 0.0)) {
        copy(n, m->y, at);
        add_scaled(n, 1.0, error, at);
        evaluate(f, x, m->t, at, error);
        filter(p, n, h, x, z, error, error);
        size = relative(c, 1, n, error, m->y, end);
    }
    return size < 1e-10 ? 1e-10 : size;
}

/* Compute a step; return its error over the tolerance, NaN without convergence. */
static double attempt(const radau *p, const flow *f, const control *c, const course *m, double h, newton *x,
                      double *z) {
    if (!x->known) {
        differentiate(f, m, x);
        x->known = x->fresh = 1, x->factorised = 0.0;
    }
    if (h != x->factorised && !prepare(p, f->n, h, x))
        return NAN;
    return solve(p, f, c, m, h, x, z) ? estimate(p, f, c, m, h, x, z) : NAN;
}

/* The factor that brings the error to the tolerance, times a safety factor that is smaller after more iterations. */
static double suited(const radau *p, const control *c, const newton *x, double error) {
    const double most = 2.0 * (double)p->iterations;
    const double safety = c->safety * (most + 1.0) / (most + (double)x->iterations);
    return safety * pow(error, -1.0 / (double)(p->stages + 1));
}

/* The next step after an accepted one, by Gustafsson's predictive controller. */
static double following(const radau *p, const control *c, const course *m, double h, double error, newton *x) {
    double factor = suited(p, c, x, error);
    if (x->before > 0.0)
        factor = fmin(factor, factor * h / x->before * pow(x->worst / error, 1.0 / (double)(p->stages + 1)));
    x->before = h, x->worst = fmax(error, 1e-2);
    factor = fmin(fmin(m->ceiling, c->fastest), fmax(c->slowest, factor));
    return 1.0 <= factor && factor <= p->kept ? h : h * factor;
}

void radau_steps(const radau *p, const flow *f, const control *c, course *m, newton *x) {
    const ptrdiff_t n = f->n, block = p->stages * n;
    x->evaluations = 0;
    while (course_continues(m, c)) {
        const int last = m->t + 1.01 * m->h >= m->end;
        const double taken = last ? m->end - m->t : m->h;
        double *z = m->slopes + m->written * block;
        const double error = attempt(p, f, c, m, taken, x, z);
        m->tries--;
        if (error <= 1.0) {
            const double next = following(p, c, m, taken, error, x);
            copy(block, z, x->last);
            x->length = taken;
            course_accept(m, n, taken, last, m->scratch + n);
            evaluate(f, x, m->t, m->y, x->slope);
            x->spent[m->written - 1] = x->evaluations;
            x->fresh = 0, x->known = x->rate <= p->contraction;
            m->h = last ? fmax(m->h, next) : next;
            m->ceiling = c->fastest;
        } else { /* NaN included */
            m->rejected++;
            x->known = x->fresh;
            m->h = taken * (isfinite(error) ? fmax(c->slowest, suited(p, c, x, error)) : c->lost);
            m->ceiling = 1.0;
        }
    }
}
