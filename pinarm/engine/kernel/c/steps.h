/* What the steps of all methods share: what is integrated, how errors are judged, and where steps are written. */
#pragma once

#include <stddef.h>
#include <string.h>

static inline void copy(ptrdiff_t n, const double *from, double *to) { memcpy(to, from, (size_t)n * sizeof *to); }

/* sum += w x, over n numbers */
static inline void add_scaled(ptrdiff_t n, double w, const double *x, double *sum) {
    for (ptrdiff_t k = 0; k < n; k++)
        sum[k] += w * x[k];
}

/* What is integrated: y of n numbers. `rates` writes its slope, and projects y onto the space it belongs to. `settle`,
 * if there is one, brings an accepted state back onto constraints, writes its slope and returns 1, or returns 0 and
 * leaves the state, where the steps have to end there. */
typedef struct {
    ptrdiff_t n;
    void (*rates)(void *system, double time, double *y, double *slope);
    int (*settle)(void *system, double time, double *y, double *slope);
    const double *floor; /* the smallest useful step: 0, unless rounding is amplified */
    void *system;
} flow;

/* Write the slopes of rows of y at their times, n numbers each. */
void flow_slopes(const flow *f, ptrdiff_t rows, const double *times, double *y, double *slopes);

/* Step control. Its numbers stand in pinarm/engine/integration/runge_kutta.py. */
typedef struct {
    double tolerance, size;                /* errors are relative to tolerance (size + |y|) */
    double safety, gain, slowest, fastest; /* of the next step */
    double lost, huge, tiny;               /* of errors that are infinite, or 0 */
    double shortest, noise; /* least step, in units in the last place of the time; errors that amplified rounding
                             * explains, relative to size + |y| */
} control;

/* A motion on an interval without jumps: where it is, and where its steps are written. */
typedef struct {
    double t, start, end;
    double h, ceiling;       /* next step, and the largest factor by which the one after it may be longer */
    ptrdiff_t tries, room;   /* steps that may be tried, rejected ones included, and that may be written */
    ptrdiff_t written, rejected, handed; /* steps that have been; 1 where they ended as the last state is not settled */
    double *y, *scratch;     /* present state, n; as many numbers as the method says */
    double *starts, *lengths, *ends; /* t, h and t + h of the written steps, room each */
    ptrdiff_t *rejections;   /* steps rejected before each, since the beginning of the call, room */
    int *floored;            /* whether each was accepted as rounding, room */
    double *states, *slopes; /* y at the start of each, room rows of n; rows of n for its stages, room for one more */
} course;

/* Whether a further step may be tried: the interval goes on, there are room and tries left, and the step is not too
 * short. */
int course_continues(const course *m, const control *c);

/* Write an accepted step of the length `taken`, and move to its end, where y is `end`; `last`: it ends the interval. */
void course_accept(course *m, ptrdiff_t n, double taken, int last, const double *end);
