#include "skyline.h"

#include <float.h>
#include <math.h>

/* L D L' by rows: g_ij = a_ij - sum_k g_ik l_jk for j < i, l_ij = g_ij / d_j, d_i = a_ii - sum_j g_ij l_ij, where sums
 * begin at the later first entry of both rows; George and Liu, section 4.2. A pivot that is 0 becomes a tiny one. */
ptrdiff_t skyline_factorise(const skyline *s, double shift) {
    ptrdiff_t negative = 0;
    for (ptrdiff_t i = 0; i < s->rows; i++) {
        const double *a = s->entry + s->origin[i];
        double *g = s->factor + s->origin[i], pivot = a[i] + shift;
        for (ptrdiff_t j = s->first[i]; j < i; j++) {
            const double *l = s->factor + s->origin[j];
            double sum = a[j];
            for (ptrdiff_t k = s->first[i] > s->first[j] ? s->first[i] : s->first[j]; k < j; k++)
                sum -= g[k] * l[k];
            g[j] = sum;
        }
        for (ptrdiff_t j = s->first[i]; j < i; j++) {
            const double l = g[j] / s->factor[s->origin[j] + j];
            pivot -= g[j] * l;
            g[j] = l;
        }
        g[i] = pivot != 0.0 ? pivot : DBL_MIN;
        negative += g[i] < 0.0;
    }
    return negative;
}

double skyline_eigenvalue(const skyline *s, ptrdiff_t above, double low, double high, double accuracy) {
    while (high > low * (1.0 + accuracy)) {
        const double middle = sqrt(low) * sqrt(high);
        if (!(middle > low && middle < high))
            break;
        if (skyline_factorise(s, -middle) < s->rows - above)
            low = middle;
        else
            high = middle;
    }
    return sqrt(low) * sqrt(high);
}
