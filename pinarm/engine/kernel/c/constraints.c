#include "constraints.h"

#include <math.h>
#include <string.h>

/* S' f of the velocities of a link, from the tip to the root, and what is left of f beyond the joint: the whole of it for
 * the rows of G, and f - U S' f / D for those reduced by the articulated inertias: Featherstone, section 7.3, with forces
 * in place of bias forces. So G M^-1 G' = W' D^-1 W with the reduced rows W, in the columns that both loops have.
 */
typedef force (*passage)(const tree *t, int k, force f, double power);

static force rigidly(const tree *t, int k, force f, double power) {
    (void)t, (void)k, (void)power;
    return f;
}

static force articulately(const tree *t, int k, force f, double power) {
    const degree_state *e = &t->degree_state[k];
    const double gain = -power * e->inverse;
    accumulate_force(&f, (force){scale(gain, e->u.linear), scale(gain, e->u.angular)});
    return f;
}

/* Write the rows of a loop joint, each in the velocities that move it. */
static void reduce(const constraints *c, const loop *l, const loop_state *s, passage pass) {
    const tree *t = c->tree;
    for (int i = 0; i < 2; i++)
        for (int r = 0; r < l->rows && l->link[i] >= 0; r++)
            accumulate_force(&c->carried[l->link[i] * MOST_ROWS + r], into_parent(&l->frame[i], &s->on[i][r]));
    double *row = c->reduced + (ptrdiff_t)l->support * MOST_ROWS;
    for (int n = 0; n < l->links; n++) {
        const int i = c->path[l->path + n], parent = t->link[i].parent;
        const int first = t->link[i].v, count = joint_velocities(t->link[i].kind);
        for (int r = 0; r < l->rows; r++) {
            force f = c->carried[i * MOST_ROWS + r];
            c->carried[i * MOST_ROWS + r] = (force){{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
            for (int k = 0; k < count; k++) {
                const double x = power(&t->degree[first + k].s, &f);
                row[k * MOST_ROWS + r] = x;
                f = pass(t, first + k, f, x);
            }
            if (parent >= 0)
                accumulate_force(&c->carried[parent * MOST_ROWS + r], into_parent(&t->link_state[i].in_parent, &f));
        }
        row += (ptrdiff_t)count * MOST_ROWS;
    }
}

/* Write the entries W_i' D^-1 W_j of one loop joint with those before it that share velocities with it. */
static void multiply(const constraints *c, int i) {
    const loop *l = &c->loop[i];
    for (int n = 0; n < l->degrees; n++) {
        const int k = c->dof[l->support + n];
        for (int r = 0; r < l->rows; r++)
            c->spread[k * MOST_ROWS + r] = c->weight[k] * c->reduced[(l->support + n) * MOST_ROWS + r];
    }
    for (int r = 0; r < l->rows; r++) {
        double *a = c->delassus.entry + c->delassus.origin[l->first + r];
        for (int j = l->coupled; j <= i; j++) {
            const loop *m = &c->loop[j];
            for (int s = 0; s < m->rows && m->first + s <= l->first + r; s++) {
                double sum = 0.0;
                for (int n = 0; n < m->degrees; n++)
                    sum += c->spread[c->dof[m->support + n] * MOST_ROWS + r] *
                           c->reduced[(m->support + n) * MOST_ROWS + s];
                a[m->first + s] = sum;
            }
        }
    }
    for (int n = 0; n < l->degrees; n++)
        memset(c->spread + c->dof[l->support + n] * MOST_ROWS, 0, MOST_ROWS * sizeof *c->spread);
}

/* Write W of all loop joints and W' D^-1 W, which is S = G M^-1 G'. */
static void delassus(const constraints *c) {
    for (int k = 0; k < c->tree->nv; k++)
        c->weight[k] = c->tree->degree_state[k].inverse;
    for (int i = 0; i < c->loops; i++) {
        reduce(c, &c->loop[i], &c->loop_state[i], articulately);
        multiply(c, i);
    }
}

/* Write G G'. */
static void squares(const constraints *c) {
    for (int k = 0; k < c->tree->nv; k++)
        c->weight[k] = 1.0;
    for (int i = 0; i < c->loops; i++) {
        reduce(c, &c->loop[i], &c->loop_state[i], rigidly);
        multiply(c, i);
    }
}

static void place(const constraints *c, const double *q, const double *v) {
    tree_articulate(c->tree, q, v);
    tree_place(c->tree);
    for (int i = 0; i < c->loops; i++)
        loop_place(c->tree, &c->loop[i], &c->loop_state[i]);
}

/* Write G a + G' v, of the accelerations that the links have; return the square of its length. */
static double torn(const constraints *c, double *result) {
    double square = 0.0;
    for (int i = 0; i < c->loops; i++)
        loop_accelerations(c->tree, &c->loop[i], &c->loop_state[i], result + c->loop[i].first);
    for (ptrdiff_t k = 0; k < c->delassus.rows; k++)
        square += result[k] * result[k];
    return square;
}

/* u += W lam */
static void add_multipliers(const constraints *c, const double *multiplier, double *u) {
    for (int i = 0; i < c->loops; i++) {
        const loop *l = &c->loop[i];
        for (int n = 0; n < l->degrees; n++)
            for (int r = 0; r < l->rows; r++)
                u[c->dof[l->support + n]] += c->reduced[(l->support + n) * MOST_ROWS + r] * multiplier[l->first + r];
    }
}

/* The multipliers of S lam = b: the proximal iteration of Carpentier, Budhiraja, Mansard, Proximal and sparse resolution
 * of constrained dynamic equations (2021), algorithm 1, as Pinocchio's. It ends at lam of least length.
 */
static void find_multipliers(const constraints *c) {
    const ptrdiff_t m = c->delassus.rows;
    memset(c->multiplier, 0, (size_t)m * sizeof *c->multiplier);
    skyline_factorise(&c->delassus, c->solve.term);
    for (int n = 0; n < c->solve.repeats; n++) {
        double largest = 0.0;
        for (ptrdiff_t k = 0; k < m; k++)
            c->before[k] = c->multiplier[k], c->multiplier[k] = c->solve.term * c->multiplier[k] - c->right[k];
        skyline_solve(&c->delassus, c->multiplier);
        for (ptrdiff_t k = 0; k < m; k++)
            largest = fmax(largest, fabs(c->multiplier[k] - c->before[k]));
        if (c->solve.term * largest <= c->solve.accuracy)
            break;
    }
}

/* M a + nle = tau + G' lam and G a + G' v = 0: with a_0 of the free tree S lam = -(G a_0 + G' v); then u + W lam moves the
 * tree: Featherstone, sections 8.3 and 8.5. The state is placed; return the square of the length of G a + G' v.
 */
static double accelerate(const constraints *c, double *a) {
    delassus(c);
    tree_accelerate(c->tree, a);
    torn(c, c->right);
    find_multipliers(c);
    add_multipliers(c, c->multiplier, c->tree->tau);
    tree_accelerate(c->tree, a);
    return torn(c, c->right);
}

void constraints_rates(const void *system, double time, double *y, double *slope) {
    const constraints *c = system;
    const tree *t = c->tree;
    (void)time;
    tree_coordinate_rates(t, y, y + t->nq, slope);
    place(c, y, y + t->nq);
    accelerate(c, slope + t->nq);
}

/* Write the least x, measured by the masses, for which G x is `right`: x = M^-1 G' S^-1 right. S is factorised. */
static void least_change(const constraints *c) {
    skyline_solve(&c->delassus, c->right);
    memset(c->generalised, 0, (size_t)c->tree->nv * sizeof *c->generalised);
    add_multipliers(c, c->right, c->generalised);
    tree_response(c->tree, c->generalised, c->change);
}

/* Write what is open to `right`; return its length. */
static double gap(const constraints *c) {
    double square = 0.0;
    for (int i = 0; i < c->loops; i++)
        for (int r = 0; r < c->loop[i].rows; r++) {
            const double x = c->loop_state[i].open[r];
            c->right[c->loop[i].first + r] = x, square += x * x;
        }
    return sqrt(square);
}

/* Close positions by Newton's method and velocities in one step, by the least changes. */
static void close_state(const constraints *c, double *q, double *v) {
    const tree *t = c->tree;
    double before = INFINITY;
    for (int n = 0;; n++) {
        place(c, q, v);
        delassus(c);
        skyline_factorise(&c->delassus, c->projection);
        const double size = gap(c);
        if (n == c->corrections || size <= c->closed || (size < c->stalled && size > 0.5 * before))
            break;
        before = size;
        least_change(c);
        for (int i = 0; i < t->links; i++)
            joint_move(t->link[i].kind, q + t->link[i].q, c->change + t->link[i].v);
    }
    for (int i = 0; i < c->loops; i++)
        memcpy(c->right + c->loop[i].first, c->loop_state[i].rate, (size_t)c->loop[i].rows * sizeof *c->right);
    least_change(c);
    for (int k = 0; k < t->nv; k++)
        v[k] -= c->change[k];
}

/* Tell whether the next step may go on without looking at its stages: by the singular values of G at the position, s_r / s_1
 * with the rank r along the motion, and by how they fell over the last step.
 */
static int is_regular(constraints *c) {
    const regularity *l = &c->limits;
    const skyline *s = &c->delassus;
    const double before = c->regular, least = l->near * l->usual;
    double trace = 0.0, diagonal = 0.0;
    squares(c);
    for (ptrdiff_t i = 0; i < s->rows; i++) {
        const double x = s->entry[s->origin[i] + i];
        trace += x, diagonal = fmax(diagonal, x);
    }
    if (!(trace < INFINITY && diagonal > 0.0))
        return 0;
    const double largest = skyline_eigenvalue(s, 0, diagonal, trace, l->accuracy);
    if (s->rows - skyline_factorise(s, -l->vanished * largest) > l->rank ||
        s->rows - skyline_factorise(s, -least * least * largest) < l->rank)
        return 0;
    const double smallest = skyline_eigenvalue(s, l->rank - 1, least * least * largest, largest, l->accuracy);
    const double regular = sqrt(smallest / largest) / l->usual, fall = before - regular;
    if (regular < l->ahead * fall && (fall > l->coarse || regular < l->close))
        return 0;
    c->regular = regular;
    return 1;
}

int constraints_settle(void *system, double time, double *y, double *slope) {
    constraints *c = system;
    const tree *t = c->tree;
    const size_t size = (size_t)(t->nq + t->nv) * sizeof *y;
    const double before = c->regular;
    (void)time;
    memcpy(c->saved, y, size);
    close_state(c, y, y + t->nq);
    if (is_regular(c)) {
        tree_coordinate_rates(t, y, y + t->nq, slope);
        place(c, y, y + t->nq);
        if (accelerate(c, slope + t->nq) <= c->torn * c->torn)
            return 0;
    }
    memcpy(y, c->saved, size);
    c->regular = before;
    return 1;
}

static int loop_is_sound(const constraints *c, int i) {
    enum { IN_PLACEMENTS = 2 * sizeof(placement) / sizeof(double), IN_ROWS = 2 * MOST_ROWS * 3 };
    const tree *t = c->tree;
    const loop *l = &c->loop[i];
    int sound = within(l->kind, 1, LOOP_KINDS) && within(l->rows, 0, MOST_ROWS + 1) && l->links >= 0 &&
                within(l->path, l->links, c->path_length) && l->degrees >= 0 &&
                within(l->support, l->degrees, c->support_length) && within(l->coupled, 1, i + 1) &&
                within(l->first, l->rows, (int)c->delassus.rows) &&
                l->first == (i ? c->loop[i - 1].first + c->loop[i - 1].rows : 0) &&
                all_finite((const double *)l->frame, IN_PLACEMENTS) && all_finite(&l->along[0].x, IN_ROWS);
    for (int k = 0; k < 2; k++)
        sound = sound && (l->link[k] == -1 || within(l->link[k], 1, t->links));
    int degrees = 0;
    for (int n = 0; sound && n < l->links; n++) { /* parents come after their children */
        const int k = c->path[l->path + n];
        sound = within(k, 1, t->links) && (n == 0 || k < c->path[l->path + n - 1]);
        for (int v = 0; sound && v < joint_velocities(t->link[k].kind); v++, degrees++)
            sound = degrees < l->degrees && c->dof[l->support + degrees] == t->link[k].v + v;
    }
    for (int r = 0; sound && r < l->rows; r++)
        sound = c->delassus.first[l->first + r] == c->loop[l->coupled].first;
    return sound && degrees == l->degrees;
}

int constraints_check(const constraints *c) {
    const double numbers[] = {c->solve.term, c->solve.accuracy, c->projection, c->closed, c->stalled, c->torn,
                              c->limits.usual, c->limits.near};
    if (tree_check(c->tree) || c->loops < 1 || skyline_check(&c->delassus) || !all_finite(numbers, 8))
        return 1;
    for (int i = 0; i < c->loops; i++)
        if (!loop_is_sound(c, i))
            return 1;
    const loop *last = &c->loop[c->loops - 1];
    return last->first + last->rows != c->delassus.rows;
}
