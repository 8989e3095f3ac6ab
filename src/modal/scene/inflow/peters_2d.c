/*
 * peters_2d.c - Peters' finite-state inflow of a section, N states a station
 *
 * The induced velocity at a station is lambda = 1/2 sum_n b_n l_n, its states
 *
 *     A l' + (U/b) l = c v',      A = D + d b' + c d' + 1/2 c b',                              (1)
 *     b_n = (-1)^(n-1) (N+n-1)! / ((N-n-1)! n!^2) for n < N,  b_N = (-1)^(N-1),                (2)
 *     c_n = 2/n,  d_1 = 1/2 (others 0),  D_nm = 1/(2n) for n = m+1, -1/(2n) for n = m-1        (3)
 *
 * [PKC95] Peters, Karunamoorthy and Cao, J. Aircraft 32 (1995) 313-322, as restated in the wing's
 * model document. |b_n| grows like 6^N, and with it the rounding of (1): N <= 10.
 */
#include "modal/scene/inflow/inflow.h"
#include <stddef.h>

enum { STATES_MOST = 10 };   /* rounding of (2), see above */

/* inflow_kind.valid: rounding of (2) sets the most. */
static int few(int states)
{
    return states >= 1 && states <= STATES_MOST;
}

/* (2) by b_n / b_(n-1) = -(N + n - 1)(N - n) / n^2, b_1 = N (N - 1) (1 where N = 1): whole
 * numbers, so exact. */
static void fill_b(int N, double b[STATES_MOST])
{
    double next = (double)N * (N - 1);

    for (int n = 1; n < N; n++) {
        b[n - 1] = next;
        next = -next * (N + n) * (N - n - 1) / ((n + 1.0) * (n + 1.0));
    }
    b[N - 1] = N % 2 ? 1 : -1;
}

/* A of (1), N x N by rows. */
static void fill_A(int N, const double *b, double *A)
{
    for (int n = 1; n <= N; n++)
        for (int m = 1; m <= N; m++) {
            double c = 2.0 / n, a = c * b[m - 1] / 2;

            if (n == m + 1)
                a += 1 / (2.0 * n);
            if (n == m - 1)
                a -= 1 / (2.0 * n);
            if (n == 1)
                a += b[m - 1] / 2;
            if (m == 1)
                a += c / 2;
            A[(n - 1) * N + m - 1] = a;
        }
}

/* (1) for each station; c_n v' enters by Q, lambda by Lambda = b / 2. */
static enum modal_status fill(const struct inflow_wing *wing, int N, struct inflow *out,
                              struct modal_error *err)
{
    double b[STATES_MOST], A[STATES_MOST * STATES_MOST];
    size_t ns = (size_t)wing->stations, nz = ns * (size_t)N;
    enum modal_status rc = inflow_allocate(wing, (int)nz, out, err);

    if (rc != MODAL_OK)
        return rc;
    fill_b(N, b);  /* (2) */
    fill_A(N, b, A);  /* (1), the same for every station */
    out->direct = 1;
    for (size_t s = 0; s < ns; s++)
        for (int n = 0; n < N; n++) {
            size_t i = s * (size_t)N + (size_t)n;

            for (int m = 0; m < N; m++)
                out->E[i * nz + s * (size_t)N + (size_t)m] = A[n * N + m];
            out->A[i * nz + i] = -wing->speed / wing->semichord;  /* -U/b of (1) */
            out->Q[i * ns + s] = 2.0 / (n + 1);  /* c_n of (3) */
            out->Lambda[s * nz + i] = b[n] / 2;  /* lambda */
        }
    return MODAL_OK;
}

const struct inflow_kind inflow_peters_2d = {
    .name = "peters_2d", .standard = 6,            /* as the wing's model document has it */
    .accepted = "1 .. 10, states of each station", .valid = few, .fill = fill,
};
