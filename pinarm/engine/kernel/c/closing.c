#include "closing.h"

#include <math.h>

#include "steps.h"

/* q moves along s x. */
static void move(const tree *t, double s, const double *x, double *q) {
    for (int i = 0; i < t->links; i++)
        joint_move(t->link[i].kind, s, x + t->link[i].v, q + t->link[i].q);
}

/* Write what closes the rows to `right`, and G v to `multiplier`; return the length of what is open, in the units of
 * the rows. */
static double gap(const constraints *c, const double *v) {
    double square = 0.0;
    constraints_gap(c, v, c->right, c->multiplier);
    for (ptrdiff_t r = 0; r < c->squares.rows; r++) {
        c->right[r] = -c->right[r];
        square += c->right[r] * c->right[r] * c->weight[r] * c->weight[r];
    }
    return sqrt(square);
}

/* Place the bodies and loops in a state y = [q, v]. */
static void place(const closing *c, const double *y) { constraints_place(&c->rows, y, y + c->rows.tree->nq); }

/* Close the placed state: positions by Newton's method, adding w times the changes to `aside`, velocities in one step.
 * A change is the least x, measured by the masses, with G x = `right`. */
static void close_state(const closing *c, double w, double *y) {
    const constraints *r = &c->rows;
    const proximal once = {c->projection, 0.0, 1};
    double before = INFINITY;
    for (int n = 0;; n++) {
        constraints_factorise(r, c->projection);
        tree_unload(r->tree);
        const double size = gap(r, y + r->tree->nq);
        if (n == c->corrections || size <= c->closed || (size < c->stalled && size > 0.5 * before))
            break;
        before = size;
        constraints_solve(r, &once, r->loop[0].end);
        move(r->tree, 1.0, r->response, y);
        add_scaled(r->tree->nv, w, r->response, c->aside);
        place(c, y);
    }
    copy(r->squares.rows, r->multiplier, r->right);
    constraints_solve(r, &once, r->loop[0].end);
    add_scaled(r->tree->nv, -1.0, r->response, y + r->tree->nq);
}

/* Return the square of the largest singular value of G where the state is placed; 0 where there is none. */
static double largest_square(const closing *c) {
    const skyline *s = &c->rows.squares;
    double trace = 0.0;
    constraints_squares(&c->rows);
    for (ptrdiff_t i = 0; i < s->rows; i++)
        trace += s->entry[s->origin[i] + i];
    const double mean = trace / (double)s->rows;
    return mean > 0.0 && mean < INFINITY ? skyline_eigenvalue(s, 0, mean, trace, c->limits.accuracy) : 0.0;
}

/* The number of singular values of G whose square is at least x. */
static ptrdiff_t count_from(const closing *c, double x) {
    return c->rows.squares.rows - skyline_factorise(&c->rows.squares, -x);
}

/* The largest velocity or acceleration in the units of velocities. */
static double largest(const closing *c, const double *x) {
    double size = 0.0;
    for (int k = 0; k < c->rows.tree->nv; k++)
        size = fmax(size, fabs(x[k]) / c->scale[k]);
    return size;
}

static int turns(const closing *c) { return c->open > c->limits.passed; } /* beside a singular position */

/* Write the acceleration at a singular position that is passed, from both sides of it; return how open it is. */
static double across(const closing *c, const double *y, double *a) {
    static const double places[8] = {-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0};
    const tree *t = c->rows.tree;
    const double *v = y + t->nq, fastest = largest(c, v);
    for (int k = 0; k < t->nv; k++)
        c->sum[k] = c->aside[k] = 0.0;
    for (int i = 0; i < 8; i++) {
        copy(t->nq + t->nv, y, c->state);
        move(t, places[i] * c->limits.aside / fastest, v, c->state);
        place(c, c->state);
        close_state(c, c->limits.across[i], c->state);
        place(c, c->state);
        constraints_accelerate(&c->rows, &c->exact, c->part);
        add_scaled(t->nv, c->limits.across[i], c->part, c->sum);
    }
    copy(t->nv, c->sum, a);
    copy(t->nq + t->nv, y, c->state), move(t, 1.0, c->aside, c->state);
    place(c, c->state);
    return gap(&c->rows, c->state + t->nq);
}

/* Write the accelerations, near singular positions of the closed state; return |G a + G' v|^2, 0 where not known. */
static double accelerations(closing *c, const double *y, double *a) {
    const tree *t = c->rows.tree;
    const double blind = c->limits.blind * c->limits.usual;
    place(c, y);
    if (!c->near)
        return constraints_accelerate(&c->rows, &c->tolerant, a);
    if (largest(c, y + t->nq) > 0.0 && !turns(c) && count_from(c, blind * blind * largest_square(c)) < c->limits.rank) {
        c->open = across(c, y, a);
        if (!turns(c))
            return 0.0;
        c->floor = 0.0;
        place(c, y);
    }
    copy(t->nq + t->nv, y, c->state);
    close_state(c, 0.0, c->state);
    place(c, c->state);
    return constraints_accelerate(&c->rows, &c->exact, a);
}

void closing_rates(void *system, double time, double *y, double *slope) {
    const closing *c = system;
    tree_follow(c->rows.tree, time, NULL);
    tree_coordinate_rates(c->rows.tree, y, y + c->rows.tree->nq, slope);
    accelerations(system, y, slope + c->rows.tree->nq);
}

/* Choose how to go on, by how regular the position last closed is; return 0 where the rank has grown. */
static int look(closing *c) {
    const limits *l = &c->limits;
    const double before = c->regular, largest = largest_square(c), least = l->vanished * largest;
    const ptrdiff_t rank = count_from(c, least);
    if (rank > l->rank)
        return 0;
    const double smallest = rank < l->rank ? 0.0 :
        skyline_eigenvalue(&c->rows.squares, l->rank - 1, least, largest, l->accuracy);
    c->regular = sqrt(smallest / largest) / l->usual;
    c->near = c->regular < l->near || c->regular < l->ahead * (before - c->regular);
    c->met |= c->near;
    return 1;
}

int closing_settle(void *system, double time, double *y, double *slope) {
    closing *c = system;
    const closing before = *c;
    const tree *t = c->rows.tree;
    if (c->corrections == 0)
        return 0;
    copy(t->nq + t->nv, y, c->saved);
    tree_follow(t, time, y);
    place(c, y);
    close_state(c, 0.0, y);
    if (look(c)) {
        const int singular = c->regular < c->limits.near;
        c->open = singular ? c->open : 0.0;
        if (c->regular < c->limits.blind && !turns(c)) /* the loops tell too little of the state */
            copy(t->nq + t->nv, c->saved, y);
        c->step = singular || !isfinite(c->t) ? c->step : time - c->t;
        c->floor = singular && !turns(c) ? c->limits.floor * c->step : 0.0;
        c->t = time;
        tree_coordinate_rates(t, y, y + t->nq, slope);
        if ((c->near || c->tolerant.repeats > 0) && accelerations(c, y, slope + t->nq) <= c->torn * c->torn)
            return 1;
    }
    copy(t->nq + t->nv, c->saved, y);
    *c = before;
    return 0;
}
