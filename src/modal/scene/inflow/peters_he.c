/*
 * peters_he.c - Peters and He's dynamic inflow over a lifting line
 *
 * The symmetric wing is two radii (azimuth 90 and 270 degrees) of a disk of radius R = L in
 * edgewise flow; its sine states stay zero.  With tau' = lift over rho U R,
 *
 *     lambda(y) = sum_(m,n) phi_n^m(y/R) cos(m pi/2) alpha_n^m                                  (1)
 *     (R/U) K alpha' + L^-1 alpha = 1/2 tau                                                     (2)
 *     tau_n^m = s_m sum_g (W_g/R) phi_n^m(r_g) cos(m pi/2) Lc_g / (rho U R),
 *               s_0 = 1/pi, s_m = 2/pi                                                          (3)
 *     H_n^m = (n+m-1)!! (n-m-1)!! / ((n+m)!! (n-m)!!),    K = (2/pi) H_n^m                      (4)
 *     phi_n^m(r) = sqrt((2n+1) H_n^m) sum_{q=m,m+2..n-1} r^q (-1)^((q-m)/2) (n+q)!!
 *                  / ((q-m)!! (q+m)!! (n-q-1)!!)                                                (5)
 *     L[(r,j),(m,n)] = Gamma (r = 0);  [1 + (-1)^min(r,m)] Gamma (r > 0)        (X = 1)         (6)
 *     Gamma = (-1)^((n+j-2r)/2) 2 sqrt((2n+1)(2j+1)) / (sqrt(H_n^m H_j^r) (j+n)(j+n+2)((j-n)^2-1)),
 *             r+m even
 *           = pi sgn(r-m) / (2 sqrt(H_n^m H_j^r) sqrt((2n+1)(2j+1))),
 *             r+m odd and |j-n| = 1
 *
 * Multiplied by U, (2) with Lc = a0 rho U b (v - lambda) of (1) is
 *
 *     R K alpha' = -U (L^-1 + 1/2 (a0 b/R) T Phi) alpha + 1/2 U (a0 b/R) T v,                   (7)
 *
 * T the sums of (3) per lift over rho U R and Phi the values of (1) at the stations; so U = 0 is
 * allowed. Pointwise the downwash oscillates and grows towards the tip; the terms of (5) cancel to
 * about 1e-11 of phi at order 15.
 *
 * [PH95] Peters and He, J. Am. Helicopter Soc. 40 (1995), formulas and checks as in the wing's
 * model document.
 */
#include "modal/scene/inflow/peters_he.h"
#include "modal/scene/inflow/inflow.h"
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>

/* k!! with (-1)!! = 0!! = 1; exact up to 2^53, relative rounding beyond. */
static double double_factorial(int k)
{
    double product = 1;

    for (; k > 1; k -= 2)
        product *= k;
    return product;
}

static double H(struct peters_he_index i)                                              /* (4) */
{
    return double_factorial(i.n + i.m - 1) / double_factorial(i.n + i.m)
           * double_factorial(i.n - i.m - 1) / double_factorial(i.n - i.m);
}

/* cos(m pi/2) without rounding. */
static double azimuth(int m)
{
    return m % 2 ? 0 : m % 4 ? -1 : 1;
}

int peters_he_states(int order, struct peters_he_index index[PETERS_HE_STATES_MOST])
{
    int count = 0;

    for (int m = 0; m <= order; m++)
        for (int n = m + 1; n - 1 <= order; n += 2)
            index[count++] = (struct peters_he_index) { m, n };
    return count;
}

int peters_he_order(int states)
{
    struct peters_he_index index[PETERS_HE_STATES_MOST];

    for (int order = 0; order <= PETERS_HE_ORDER_MOST; order++)
        if (peters_he_states(order, index) == states)
            return order;
    return -1;
}

double peters_he_K(struct peters_he_index i)
{
    return 2 / M_PI * H(i);
}

/* Radial function phi_n^m(r), 0 <= r <= 1, times cos(m pi/2). */
static double peters_he_phi(struct peters_he_index i, double r)                        /* (5) */
{
    double sum = 0;

    for (int q = i.m; q <= i.n - 1; q += 2) {
        double term = double_factorial(i.n + q)
                      / (double_factorial(q - i.m) * double_factorial(q + i.m)
                         * double_factorial(i.n - q - 1));
        sum += ((q - i.m) / 2 % 2 ? -term : term) * pow(r, q);
    }
    return azimuth(i.m) * sqrt((2 * i.n + 1) * H(i)) * sum;
}

/* Gamma of (6), without the factor of its row. */
static double gamma_of(struct peters_he_index row, struct peters_he_index column)
{
    int r = row.m, j = row.n, m = column.m, n = column.n;
    double root = sqrt(H(column) * H(row)), odd = sqrt((2.0 * n + 1) * (2.0 * j + 1));

    if ((r + m) % 2 == 0)
        return (abs((n + j - 2 * r) / 2) % 2 ? -2 : 2) * odd
               / (root * (j + n) * (j + n + 2) * ((j - n) * (j - n) - 1.0));
    if (abs(j - n) == 1)
        return (r > m ? M_PI : -M_PI) / (2 * root * odd);
    return 0;
}

double peters_he_L(struct peters_he_index row, struct peters_he_index column)          /* (6) */
{
    int least = row.m < column.m ? row.m : column.m;
    double factor = row.m == 0 ? 1 : least % 2 ? 0 : 2;

    return factor * gamma_of(row, column);
}

/* inflow_kind.valid: no part of an order. */
static int whole_order(int states)
{
    return peters_he_order(states) >= 0;
}

/* L^-1, n x n by rows, into out->A (zero before). */
static enum modal_status inverse_of_L(const struct peters_he_index *index, int n, double *A,
                                      struct modal_error *err)
{
    double *L = malloc((size_t)n * (size_t)n * sizeof *L);
    lapack_int *pivot = malloc((size_t)n * sizeof *pivot), info = -1;

    if (L == NULL || pivot == NULL)
        goto out;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++)
            L[i * n + j] = peters_he_L(index[i], index[j]);
        A[i * n + i] = 1;
    }
    info = LAPACKE_dgesv(LAPACK_ROW_MAJOR, n, n, L, n, pivot, A, n);
out:
    free(L);
    free(pivot);
    return info == 0
               ? MODAL_OK
               : modal_fail(err, MODAL_NO_MEMORY, "peters_he: out of memory for %d states", n);
}

/* (7), the sums of (3) and the values of (5) at the stations. */
static enum modal_status fill(const struct inflow_wing *wing, int states, struct inflow *out,
                              struct modal_error *err)
{
    struct peters_he_index index[PETERS_HE_STATES_MOST];
    int ns = wing->stations, nz = peters_he_states(peters_he_order(states), index);
    double R = wing->length, U = wing->speed, slope = wing->lift_slope * wing->semichord / R;
    enum modal_status rc = inflow_allocate(wing, nz, out, err);

    if (rc == MODAL_OK)
        rc = inverse_of_L(index, nz, out->A, err);
    if (rc != MODAL_OK)
        return rc;
    out->direct = 1;
    for (int i = 0; i < nz; i++) {
        out->E[i * nz + i] = R * peters_he_K(index[i]);
        for (int g = 0; g < ns; g++) {
            double phi = peters_he_phi(index[i], wing->position[g] / R);
            double T = (index[i].m == 0 ? 1 : 2) / M_PI * wing->weight[g] / R * phi;   /* (3) */

            out->Lambda[g * nz + i] = phi;
            out->P[i * ns + g] = U * slope * T / 2;
        }
    }
    for (int i = 0; i < nz; i++)                                                       /* (7) */
        for (int j = 0; j < nz; j++) {
            double sum = U * out->A[i * nz + j];
            for (int g = 0; g < ns; g++)
                sum += out->P[i * ns + g] * out->Lambda[g * nz + j];
            out->A[i * nz + j] = -sum;
        }
    return MODAL_OK;
}

const struct inflow_kind inflow_peters_he = {
    "peters_he",
    30,
    "cosine states of a whole order: 1, 2, 4, 6, 9, 12, 16, 20, 25, 30, 36, 42, 49, 56, 64 or 72 "
    "(order 0 .. 15)",
    whole_order,
    fill
};
