#include "constraints.h"

#include <math.h>
#include <string.h>

/* What is left of a force f on a link beyond its joint, which takes S' f: the whole of it for the rows of G, and
 * f - U S' f / D for those reduced by the articulated inertias: Featherstone, section 7.3, with forces in place of bias
 * forces. So G M^-1 G' = W' D^-1 W with the reduced rows W, in the columns that both loops have. */
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
    ptrdiff_t row = (ptrdiff_t)l->support * MOST_ROWS;
    for (int n = 0; n < l->links; n++) {
        const int i = c->path[l->path + n], parent = t->link[i].parent;
        const int first = t->link[i].v, count = joint_velocities(t->link[i].kind);
        for (int r = 0; r < l->rows; r++) {
            force f = c->carried[i * MOST_ROWS + r];
            c->carried[i * MOST_ROWS + r] = (force){{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
            for (int k = 0; k < count; k++) {
                const double x = power(&t->degree[first + k].s, &f) + c->weight_of[row + k * MOST_ROWS + r];
                c->reduced[row + k * MOST_ROWS + r] = x;
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

void constraints_delassus(const constraints *c) {
    for (int k = 0; k < c->tree->nv; k++)
        c->weight[k] = c->tree->degree_state[k].inverse;
    for (int i = 0; i < c->loops; i++)
        reduce(c, &c->loop[i], &c->loop_state[i], articulately), multiply(c, i);
}

void constraints_squares(const constraints *c) {
    for (int k = 0; k < c->tree->nv; k++)
        c->weight[k] = 1.0;
    for (int i = 0; i < c->loops; i++)
        reduce(c, &c->loop[i], &c->loop_state[i], rigidly), multiply(c, i);
}

void constraints_place(const constraints *c, const double *q, const double *v) {
    tree_articulate(c->tree, q, v);
    tree_place(c->tree);
    for (int i = 0; i < c->loops; i++)
        loop_place(c->tree, &c->loop[i], &c->loop_state[i]);
}

/* Write G a + G' v of the accelerations a, which the links have; return the square of its length. */
static double torn(const constraints *c, const double *a, double *result) {
    double square = 0.0;
    for (int i = 0; i < c->loops; i++) {
        const loop *l = &c->loop[i];
        loop_accelerations(c->tree, l, &c->loop_state[i], result + l->first);
        for (int n = l->support; n < l->support + l->degrees; n++)
            for (int r = 0; r < l->rows; r++)
                result[l->first + r] += c->weight_of[n * MOST_ROWS + r] * a[c->dof[n]];
    }
    for (ptrdiff_t k = 0; k < c->delassus.rows; k++)
        square += result[k] * result[k];
    return square;
}

void constraints_load(const constraints *c, const double *multiplier, double *u) {
    for (int i = 0; i < c->loops; i++) {
        const loop *l = &c->loop[i];
        for (int n = 0; n < l->degrees; n++)
            for (int r = 0; r < l->rows; r++)
                u[c->dof[l->support + n]] += c->reduced[(l->support + n) * MOST_ROWS + r] * multiplier[l->first + r];
    }
}

/* The multipliers of S lam = b: the proximal iteration of Carpentier, Budhiraja, Mansard, Proximal and sparse
 * resolution of constrained dynamic equations (2021), algorithm 1, as Pinocchio's. It ends at lam of least length. */
static void find_multipliers(const constraints *c, const proximal *p) {
    const ptrdiff_t m = c->delassus.rows;
    memset(c->multiplier, 0, (size_t)m * sizeof *c->multiplier);
    skyline_factorise(&c->delassus, p->term);
    for (int n = 0; n < p->repeats; n++) {
        double largest = 0.0;
        for (ptrdiff_t k = 0; k < m; k++)
            c->before[k] = c->multiplier[k], c->multiplier[k] = p->term * c->multiplier[k] - c->right[k];
        skyline_solve(&c->delassus, c->multiplier);
        for (ptrdiff_t k = 0; k < m; k++)
            largest = fmax(largest, fabs(c->multiplier[k] - c->before[k]));
        if (p->term * largest <= p->accuracy)
            break;
    }
}

/* M a + nle = tau + G' lam and G a + G' v = 0: with a_0 of the free tree S lam = -(G a_0 + G' v); then u + W lam moves
 * the tree: Featherstone, sections 8.3 and 8.5. */
double constraints_accelerate(const constraints *c, const proximal *p, double *a) {
    constraints_delassus(c);
    tree_accelerate(c->tree, a);
    torn(c, a, c->right);
    find_multipliers(c, p);
    constraints_load(c, c->multiplier, c->tree->tau);
    tree_accelerate(c->tree, a);
    return torn(c, a, c->right);
}
