#include "steps.h"

#include <math.h>

static double ulp(double x) { return nextafter(x, INFINITY) - x; }

void flow_slopes(const flow *f, ptrdiff_t rows, const double *times, double *y, double *slopes) {
    for (ptrdiff_t k = 0; k < rows; k++)
        f->rates(f->system, times[k], y + k * f->n, slopes + k * f->n);
}

int course_continues(const course *m, const control *c) {
    return m->t < m->end && !m->handed && m->written < m->room && m->tries > 0 &&
           m->h >= c->shortest * ulp(fmax(fabs(m->t), m->end - m->start));
}

void course_accept(course *m, ptrdiff_t n, double taken, int last, const double *end) {
    const ptrdiff_t k = m->written++;
    m->starts[k] = m->t, m->lengths[k] = taken, m->ends[k] = last ? m->end : m->t + taken;
    m->rejections[k] = m->rejected, m->floored[k] = 0;
    copy(n, m->y, m->states + k * n);
    copy(n, end, m->y);
    m->t = m->ends[k];
}
