/* law.c - what all laws share; each kind is a file of laws/
 *
 * A law is its class, the places where it acts, and the numbers that the class lays out in `data`;
 * copying the struct moves it, law_done ends it.
 */
#include "modal/scene/law.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

void law_clear(struct law *law, const struct law_class *kind)
{
    memset(law, 0, sizeof *law);
    law->kind = kind;
}

enum modal_status law_rest(const struct law *law, struct law_force *out, struct modal_error *err)
{
    const double zero[LAW_TERMS_MOST] = { 0 };
    double after[LAW_TERMS_MOST];
    struct law_point at = { .d = zero, .v = zero, .memory_before = zero };

    memset(out, 0, sizeof *out);
    out->memory = after;
    enum modal_status rc = law->kind->force(law, &at, out, err);
    out->memory = NULL;  /* gone with this call */
    return rc;
}

bool law_add_ends(struct law *law, int input, const struct law_end *end, int count)
{
    int before = law->start[input];
    struct law_end *more = realloc(law->end, ((size_t)before + (size_t)count + 1) * sizeof *more);

    if (more == NULL)
        return false;
    law->end = more;
    if (count > 0)
        memcpy(more + before, end, (size_t)count * sizeof *end);
    for (int i = input + 1; i <= LAW_INPUTS_MOST; i++)
        law->start[i] = before + count;  /* later inputs have none yet */
    return true;
}

int law_ends(const struct law *law) { return law->start[law->kind->inputs]; }

double law_sees(const struct law *law, int input, const double *x)
{
    double sum = 0;

    for (int e = law->start[input]; e < law->start[input + 1]; e++)
        sum += law->end[e].weight * x[law->end[e].dof];
    return sum;
}

void law_spread(const struct law *law, int i, int j, double gain, int n, double *K)
{
    for (int c = law->start[j]; c < law->start[j + 1]; c++)
        law_push(law, i, gain * law->end[c].weight, K + (size_t)law->end[c].dof * (size_t)n);
}

enum modal_status law_spread_slopes(const struct law *law, const double *d, int n, double *K,
                                    double *C, bool *rates, struct modal_error *err)
{
    double zero[LAW_TERMS_MOST] = { 0 }, after[LAW_TERMS_MOST];
    struct law_point at = { .d = d, .v = zero, .memory_before = zero };
    struct law_force f = { .memory = after };
    enum modal_status rc = law->kind->force(law, &at, &f, err);

    for (int i = 0; rc == MODAL_OK && i < law->kind->inputs; i++)
        for (int j = 0; j < law->kind->inputs; j++) {
            law_spread(law, i, j, f.fd[i][j], n, K);
            law_spread(law, i, j, f.fv[i][j], n, C);
            *rates = *rates || f.fv[i][j] != 0;
        }
    return rc;
}

void law_push(const struct law *law, int input, double force, double *out)
{
    for (int e = law->start[input]; e < law->start[input + 1]; e++)
        out[law->end[e].dof] += law->end[e].weight * force;
}

enum modal_status law_check(const char *what, double value, double low, struct modal_error *err)
{
    if (isfinite(value) && value >= low)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, what,
                            "%s is %g; accepted: finite and at least %g", what, value, low);
}

void law_done(struct law *law)
{
    if (law->kind != NULL && law->kind->free != NULL)
        law->kind->free(law);
    else
        free(law->data);
    free(law->end);
    memset(law, 0, sizeof *law);
}
