/*
 * jones.c - R.T. Jones' two lags of the indicial lift, a station
 *
 *     Lc = a0 rho U b [ v/2 + sum_i A_i B_i (U/b) z_i ],     z_i' = -B_i (U/b) z_i + v          (1)
 *
 * A = (0.165, 0.335), B = (0.0455, 0.3): Wagner's function is 1 - A_1 e^{-B_1 s} - A_2 e^{-B_2 s},
 * s = U t / b.
 *
 * [J40] R.T. Jones, NACA Report 681 (1940), as restated in the wing's model document.
 */
#include "modal/scene/inflow/inflow.h"
#include <stddef.h>

static const double lag_share[2] = { 0.165, 0.335 }, lag_rate[2] = { 0.0455, 0.3 };

/* One state a lag of (1). */
static int two(int states)
{
    return states == 2;
}

/* (1) station by station: the states of one do not feel another's. */
static enum modal_status fill(const struct inflow_wing *wing, int states, struct inflow *out,
                              struct modal_error *err)
{
    size_t ns = (size_t)wing->stations, lags = (size_t)states, nz = ns * lags;
    enum modal_status rc = inflow_allocate(wing, (int)nz, out, err);

    if (rc != MODAL_OK)
        return rc;
    out->direct = 1 - lag_share[0] - lag_share[1];  /* 1/2: Wagner's function at 0 */
    for (size_t i = 0; i < nz; i++) {
        size_t s = i / lags, lag = i % lags;
        double rate = lag_rate[lag] * wing->speed / wing->semichord;  /* B_i U/b of (1) */

        out->E[i * nz + i] = 1;  /* the states stand alone */
        out->A[i * nz + i] = -rate;
        out->P[i * ns + s] = 1;
        /* (1); (1) of inflow.h has it with minus */
        out->Lambda[s * nz + i] = -lag_share[lag] * rate;
    }
    return MODAL_OK;
}

const struct inflow_kind inflow_jones = { "jones", 2, "2, the lags of each station", two, fill };
