/* Symmetric matrices whose rows are stored from their first entry on, such as those of loops along a chain.
 * Source: George, Liu, Computer Solution of Large Sparse Positive Definite Systems (1981), chapter 4. */
#pragma once

#include <stddef.h>

typedef struct {
    ptrdiff_t rows;
    const ptrdiff_t *first;  /* column of the first entry of each row */
    const ptrdiff_t *origin; /* entry (i, j) stands at origin[i] + j */
    double *entry;           /* of the matrix A */
    double *factor;          /* L and D of the factorisation */
} skyline;

/* Factorise A + shift 1 = L D L'; return how many entries of D are negative, as many eigenvalues of A are < -shift. */
ptrdiff_t skyline_factorise(const skyline *s, double shift);

/* Return an eigenvalue of the positive semidefinite A to a relative accuracy, by bisection of its bracket from `low` to
 * `high`: the one above which there are `above` others. */
double skyline_eigenvalue(const skyline *s, ptrdiff_t above, double low, double high, double accuracy);
