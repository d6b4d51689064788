#include "constraints.h"

#include <math.h>

#include "steps.h"

/* Note that row r of a loop joint has x of the unknown at a place of its support. */
static void note(const constraints *c, int place, int r, double x) {
    const int n = c->unknown[place];
    c->reduced[place * MOST_ROWS + r] = x;
    c->spread[n * MOST_ROWS + r] = x * c->tree->degree_state[n].inverse;
}

/* The entry W' D^-1 W of the row r that is spread and of row s of a loop joint. */
static double entry(const constraints *c, int r, const loop *m, int s) {
    double sum = 0.0;
    for (int k = m->support; k < m->support + m->degrees; k++)
        sum += c->spread[c->unknown[k] * MOST_ROWS + r] * c->reduced[k * MOST_ROWS + s];
    return sum;
}

static force *carried(const constraints *c, int i) { return c->carried + (i + 1) * MOST_ROWS; }

/* Let row r pass row s of a loop joint, which ends at the link where row r has the force f. */
static void pass_row(const constraints *c, int place, int r, const loop *m, int s, force *f) {
    const double x = entry(c, r, m, s);
    note(c, place, r, x);
    *f = tree_beyond(c->tree, c->unknown[place], *f, x);
}

/* Let the rows of a loop joint pass the joint of link i, which takes S' f of their forces. */
static void pass_joint(const constraints *c, int place, const loop *l, int i) {
    const tree *t = c->tree;
    const link *passed = &t->link[i];
    for (int r = 0; r < l->rows; r++) {
        force f = carried(c, i)[r];
        carried(c, i)[r] = NO_FORCE;
        for (int k = 0; k < joint_velocities(passed->kind); k++) {
            const double x = power(&t->degree[passed->v + k].s, &f) + c->weight_of[(place + k) * MOST_ROWS + r];
            note(c, place + k, r, x);
            f = tree_beyond(t, passed->v + k, f, x);
        }
        if (passed->parent >= 0)
            accumulate_force(&carried(c, passed->parent)[r], into_parent(&t->link_state[i].in_parent, &f));
    }
}

/* Write the rows of a loop joint in the unknowns that they pass: Featherstone, section 7.3, with forces in place of
 * bias forces. What is left of them acts on the link at which it ends. */
static void reduce(const constraints *c, const loop *l, const loop_state *s) {
    for (int i = 0; i < 2; i++)
        for (int r = 0; r < l->rows && l->link[i] >= 0; r++)
            accumulate_force(&carried(c, l->link[i])[r], into_parent(&l->frame[i], &s->on[i][r]));
    for (int n = l->path, place = l->support; n < l->path + l->links; n++) {
        const int i = c->path[n];
        if (i >= 0) {
            pass_joint(c, place, l, i);
            place += joint_velocities(c->tree->link[i].kind);
            continue;
        }
        const loop *m = &c->loop[~i];
        for (int q = 0; q < m->rows; q++, place++)
            for (int r = 0; r < l->rows; r++)
                pass_row(c, place, r, m, q, &carried(c, m->end)[r]);
    }
}

/* Eliminate the multipliers of reduced rows, which leave the forces K on the link at which they end: K' a + L lam + .. = 0
 * makes lam an unknown with U = -K and D = -(L + term). */
static void eliminate(const constraints *c, const loop *l, double term) {
    force *left = carried(c, l->end);
    for (int r = 0; r < l->rows; r++) {
        degree_state *e = &c->tree->degree_state[c->unknown[l->own + r]];
        e->u = (force){scale(-1.0, left[r].linear), scale(-1.0, left[r].angular)};
        e->inverse = -1.0 / (entry(c, r, l, r) + term);
        subtract_square(&c->tree->link_state[l->end].inertia, e->inverse, &e->u);
        for (int q = r + 1; q < l->rows; q++)
            pass_row(c, l->own + r, q, l, r, &left[q]);
    }
}

/* Write the entries of a reduced loop joint with those before it that share unknowns with it. */
static void multiply(const constraints *c, const loop *l) {
    for (int r = 0; r < l->rows; r++) {
        double *a = c->squares.entry + c->squares.origin[l->first + r];
        for (const loop *m = &c->loop[l->coupled]; m <= l; m++)
            for (int q = 0; q < m->rows && m->first + q <= l->first + r; q++)
                a[m->first + q] = entry(c, r, m, q) * c->weight[l->first + r] * c->weight[m->first + q];
    }
}

static void clear(const constraints *c, const loop *l) {
    for (int k = l->support; k < l->support + l->degrees; k++)
        memset(c->spread + c->unknown[k] * MOST_ROWS, 0, MOST_ROWS * sizeof *c->spread);
    memset(carried(c, l->end), 0, MOST_ROWS * sizeof *c->carried);
}

void constraints_factorise(const constraints *c, double term) {
    for (int i = c->tree->links - 1, k = 0; i >= -1; i--) {
        for (; k < c->loops && c->loop[k].end == i; k++) {
            reduce(c, &c->loop[k], &c->loop_state[k]);
            eliminate(c, &c->loop[k], term);
            clear(c, &c->loop[k]);
        }
        if (i >= 0)
            tree_reduce(c->tree, i);
    }
}

void constraints_squares(const constraints *c) { /* joints take S' f and leave f; multipliers are no unknowns */
    for (int n = 0; n < c->tree->nv + (int)c->squares.rows; n++)
        c->tree->degree_state[n] = (degree_state){NO_FORCE, n < c->tree->nv ? c->unit[n] : 0.0};
    for (int k = 0; k < c->loops; k++) {
        reduce(c, &c->loop[k], &c->loop_state[k]);
        multiply(c, &c->loop[k]);
        clear(c, &c->loop[k]);
    }
}

void constraints_place(const constraints *c, const double *q, const double *v) {
    tree_move(c->tree, q, v);
    tree_place(c->tree);
    for (int i = 0; i < c->loops; i++)
        loop_place(c->tree, &c->loop[i], &c->loop_state[i]);
}

/* What unknowns at some places of its support ask of the multiplier of a row, sum W u / D, and get of it, u + W lam. */
static double asked(const constraints *c, int r, int place, int end) {
    double sum = 0.0;
    for (int k = place; k < end; k++)
        sum += c->reduced[k * MOST_ROWS + r] * c->tree->tau[c->unknown[k]] *
               c->tree->degree_state[c->unknown[k]].inverse;
    return sum;
}
static void give(const constraints *c, int r, double lam, int place, int end) {
    for (int k = place; k < end; k++)
        c->tree->tau[c->unknown[k]] += c->reduced[k * MOST_ROWS + r] * lam;
}

/* u = sum W u / D - right of each row, which loads the link at which it ends. */
static void load_rows(const constraints *c, const loop *l) {
    const tree *t = c->tree;
    for (int r = 0; r < l->rows; r++) {
        const int n = t->nv + l->first + r;
        t->tau[n] = asked(c, r, l->support, l->own + r) - c->right[l->first + r];
        t->link_state[l->end].bias = tree_beyond(t, n, t->link_state[l->end].bias, -t->tau[n]);
    }
}

/* lam = (u - U' a) / D of each row of an inner loop joint, the last one first. */
static void release_rows(const constraints *c, const loop *l) {
    for (int r = l->rows - 1; r >= 0; r--) {
        const int n = c->tree->nv + l->first + r;
        c->part[l->first + r] = tree_unknown(c->tree, n, &c->tree->link_state[l->end].change);
        give(c, r, c->part[l->first + r], l->support, l->own + r);
    }
}

/* The multipliers of loop joints from k on, which end at the world, by the proximal iteration: each solves for what the
 * term has left of the last one. */
static void find_multipliers(const constraints *c, const proximal *p, int k) {
    const tree *t = c->tree;
    const loop *first = &c->loop[k], *end = &c->loop[c->loops];
    for (const loop *l = first; l < end; l++)
        for (int r = 0; r < l->rows; r++)
            c->right[l->first + r] -= asked(c, r, l->support, l->tail), c->part[l->first + r] = 0.0;
    double largest = INFINITY;
    for (int n = 0; n < p->repeats && p->term * largest > p->accuracy; n++) {
        largest = 0.0;
        for (const loop *l = first; l < end; l++)
            for (int r = 0; r < l->rows; r++)
                t->tau[t->nv + l->first + r] = asked(c, r, l->tail, l->own + r) - c->right[l->first + r];
        for (const loop *l = end - 1; l >= first; l--)
            for (int r = l->rows - 1; r >= 0; r--) {
                const double x = tree_unknown(t, t->nv + l->first + r, &NO_MOTION);
                give(c, r, x, l->tail, l->own + r);
                c->part[l->first + r] += x, c->right[l->first + r] = p->term * x, largest = fmax(largest, fabs(x));
            }
    }
    for (const loop *l = first; l < end; l++)
        for (int r = 0; r < l->rows; r++)
            give(c, r, c->part[l->first + r], l->support, l->tail);
}

void constraints_solve(const constraints *c, const proximal *p, int from) {
    const tree *t = c->tree;
    int k = 0;
    for (int i = from; i >= 0; i--) {
        for (; k < c->loops && c->loop[k].end == i; k++)
            load_rows(c, &c->loop[k]);
        tree_load(t, i);
    }
    find_multipliers(c, p, k);
    for (int i = 0; i < t->links; i++) {
        tree_accelerate(t, i, c->response);
        for (; k > 0 && c->loop[k - 1].end == i; k--)
            release_rows(c, &c->loop[k - 1]);
    }
}

/* Add to the rows of a coupling what velocities, or their rates, do by its weights. */
static void add_coupled(const constraints *c, const loop *l, const double *v, double *result) {
    for (int n = l->support; n < l->support + l->degrees; n++)
        for (int r = 0; r < l->rows && c->unknown[n] < c->tree->nv; r++)
            result[r] += c->weight_of[n * MOST_ROWS + r] * v[c->unknown[n]];
}

void constraints_gap(const constraints *c, const double *v, double *gap, double *rates) {
    for (int i = 0; i < c->loops; i++) {
        const loop *l = &c->loop[i];
        loop_gap(l, &c->loop_state[i], gap + l->first);
        loop_rates(l, &c->loop_state[i], rates + l->first);
        add_coupled(c, l, v, rates + l->first);
    }
}

/* Write what G a + G' v lacks, of the accelerations a, which the links have; return the square of its length. */
static double torn(const constraints *c, const double *a) {
    double square = 0.0;
    for (int i = 0; i < c->loops; i++) {
        const loop *l = &c->loop[i];
        double *result = c->right + l->first;
        loop_accelerations(c->tree, l, &c->loop_state[i], result);
        add_coupled(c, l, a, result);
        for (int r = 0; r < l->rows; r++)
            result[r] = -result[r], square += result[r] * result[r];
    }
    return square;
}

/* M a + nle = tau + G' lam and G a + G' v = 0, from a = 0 and lam = 0 on: each iteration solves for what is lacking.
 * This is the proximal iteration of Carpentier, Budhiraja, Mansard, Proximal and sparse resolution of constrained dynamic
 * equations (2021), algorithm 1, as Pinocchio's; it ends at lam of least length. Rows are eliminated at links as in
 * Sathya, Carpentier, Constrained articulated body dynamics algorithms (2024). */
double constraints_accelerate(const constraints *c, const proximal *p, double *a) {
    const tree *t = c->tree;
    const ptrdiff_t m = c->squares.rows;
    constraints_factorise(c, p->term);
    memset(a, 0, (size_t)t->nv * sizeof *a), memset(c->multiplier, 0, (size_t)m * sizeof *c->multiplier);
    double square = torn(c, a), largest = INFINITY;
    for (int n = 0; n < p->repeats && p->term * largest > p->accuracy; n++) {
        constraints_solve(c, p, n ? c->loop[0].end : t->links - 1);
        tree_unload(t);
        add_scaled(t->nv, 1.0, c->response, a);
        for (int i = 0; i < t->links; i++)
            accumulate_motion(&t->link_state[i].acceleration, t->link_state[i].change);
        largest = 0.0;
        for (int r = 0; r < (int)m; r++)
            c->multiplier[r] += c->part[r], largest = r < c->inner ? fmax(largest, fabs(c->part[r])) : largest;
        square = torn(c, a);
    }
    return square;
}
