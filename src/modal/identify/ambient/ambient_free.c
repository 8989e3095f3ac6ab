/* ambient_free.c - a pencil of the record, its poles fitted to it */
#include "modal/identify/ambient/ambient_free.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/identify/ambient/whittle.h"
#include "modal/identify/fit/synthesis.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/pencil.h"
#include "modal/identify/prepare/pod.h"
#include "modal/linalg/svd.h"

static const double FLOOR = 1e-300;      /* of a multiplier: zero to rounding */

/* Y, and ORDER poles of its pencil. */
static enum modal_status fit(const struct matrix *Y, double step, int order, double *left,
                             struct modal_error *err)
{
    struct pencil p = { 0 };
    struct synthesis f = { 0 };
    size_t n = (size_t)order;
    double complex *rho = malloc(2 * sizeof *rho * n);
    enum modal_status rc = rho == NULL
        ? modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d poles", order)
        : pencil_new(Y, &(struct pencil_options) { .wanted = order }, &p, err);
    int count = order < p.count ? order : p.count;

    if (rc == MODAL_OK && count > 0)
        rc = pencil_multipliers(&p, count, rho, err);
    if (rc == MODAL_OK && count > 0) {
        int poles = poles_of_multipliers(rho, count, step, FLOOR, rho + n, NULL);
        if (poles > 0)
            rc = synthesis_fit(rho + n, poles, step, Y, NULL, &f, err);
        *left = rc == MODAL_OK && poles > 0 ? f.residual / safe_matrix_norm(Y) : 1;
    }
    synthesis_done(&f);
    pencil_done(&p);
    free(rho);
    return rc == MODAL_NO_CONVERGENCE ? MODAL_OK : rc;
}

enum modal_status ambient_free_left(const struct matrix *Y, double step, int order, double *left,
                                    struct modal_error *err)
{
    struct pod pod = { 0 };
    enum modal_status rc;

    *left = 1;
    if (order == 0)
        return MODAL_OK;
    rc = pod_reduce(Y, &(struct pod_options) { .most = WHITTLE_CHANNELS_MOST }, &pod, err);
    if (rc == MODAL_OK && pod.count > 0)
        rc = fit(&pod.signals, step, order, left, err);
    pod_done(&pod);
    return rc;
}
