/* inflow.c - what inflow models are made of, and the model without any
 *
 * Each model fills (1) and (2) of inflow.h for all stations at once; which stations feel each
 * other's states is then the model's affair, dense matrices standing for any.
 */
#include "modal/scene/inflow/inflow.h"
#include <stdlib.h>

/* inflow_kind.valid of the model without any. */
static int no_states(int states)
{
    return states == 0;
}

/* Quasi-steady: (1) of inflow.h with direct = 1 and no z. */
static enum modal_status fill_none(const struct inflow_wing *wing, int states, struct inflow *out,
                                   struct modal_error *err)
{
    enum modal_status rc = inflow_allocate(wing, states, out, err);

    if (rc == MODAL_OK)
        out->direct = 1;  /* all of the normalwash */
    return rc;
}

const struct inflow_kind inflow_none = { "none", 0, "0", no_states, fill_none };

enum modal_status inflow_allocate(const struct inflow_wing *wing, int states, struct inflow *out,
                                  struct modal_error *err)
{
    size_t nz = (size_t)states, ns = (size_t)wing->stations;

    *out = (struct inflow) { .states = states };
    out->E = calloc(nz * nz + 1, sizeof *out->E);
    out->A = calloc(nz * nz + 1, sizeof *out->A);
    out->P = calloc(nz * ns + 1, sizeof *out->P);
    out->Q = calloc(nz * ns + 1, sizeof *out->Q);
    out->Lambda = calloc(nz * ns + 1, sizeof *out->Lambda);
    if (out->E == NULL || out->A == NULL || out->P == NULL || out->Q == NULL
        || out->Lambda == NULL) {
        inflow_done(out);
        return modal_fail(err, MODAL_NO_MEMORY, "inflow: out of memory for %d states", states);
    }
    return MODAL_OK;
}

enum modal_status inflow_new(const struct inflow_kind *kind, const struct inflow_wing *wing,
                             int states, struct inflow *out, struct modal_error *err)
{
    struct inflow made = { 0 };
    enum modal_status rc = kind->fill(wing, states, &made, err);

    if (rc != MODAL_OK)
        inflow_done(&made);
    else
        *out = made;
    return rc;
}

void inflow_done(struct inflow *f)
{
    free(f->E);
    free(f->A);
    free(f->P);
    free(f->Q);
    free(f->Lambda);
    *f = (struct inflow) { 0 };
}
