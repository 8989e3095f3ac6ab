/* reach.c - see reach.h */
#include "modal/identify/ambient/reach.h"
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include "modal/linalg/workspace.h"

enum { L = WHITTLE_CHANNELS_MOST };

static double square(int l, const double complex *x)
{
    double size = cblas_dznrm2(l, x, 1);

    return size * size;
}

/* What bin B tells of every mode's exponent, told[k * bins]: of c a b^H and its adjoint, after
 * C^-1, the squares |c|^2 |a|^2 |b|^2. */
static void tell_bin(const struct whittle *m, const double complex *poles, const struct bins *s,
                     int b, double *told)
{
    double complex C[L * L], E[L * L], V[WHITTLE_TRANSFERS * L * L];
    const double complex one = 1, z = cexp(CMPLX(0, whittle_middle(s, b)));
    int l = m->channels;

    if (isnan(whittle_residual(m, poles, s, b, C, E)))
        return;
    whittle_transfers(m, poles, whittle_middle(s, b), V);
    for (int k = 0; k < m->count; k++) {
        const struct whittle_mode *q = &m->mode[k];
        struct whittle_peak p = whittle_peak(poles[k], z);
        double complex v[2 * L] = { 0 };              /* phi, H R of kappa's conjugate */
        for (int i = 0; i < l; i++) {
            v[i] = q->phi[i];
            for (int c = 0; c < l; c++)
                v[l + c] += V[WHITTLE_HR * l * l + c + l * i] * conj(q->kappa[i]);
        }
        cblas_ztrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, l, 2, &one, C,
                    l, v, l);
        told[(size_t)k * s->count] = s->lines[b] * creal(p.slope * conj(p.slope)) * square(l, v)
                                     * square(l, v + l);
    }
}

/* The bins about bin AT that tell enough of a mode's exponent: tells[bin * modes]; how many. */
static int choose_bins(const double *told, int bins, int modes, int at, double loss, bool *tells)
{
    double all = 0, in = told[at];
    int from = at, to = at + 1;

    for (int b = 0; b < bins; b++)
        all += told[b];
    while (in < (1 - loss) * all && (from > 0 || to < bins)) {
        if (from > 0)
            in += told[--from];
        if (to < bins)
            in += told[to++];
    }
    for (int b = from; b < to; b++)
        tells[(size_t)b * modes] = true;
    return to - from;
}

/* The bin that a turn lies in, or the nearest. */
static int bin_of(const struct bins *s, double turn)
{
    int b = 0;

    while (b < s->count - 1 && s->to[b] < turn)
        b++;
    return b;
}

struct rank { double turn; bool wide; int mode; };

static int before(const void *a, const void *b)
{
    const struct rank *p = a, *q = b;

    return p->wide != q->wide ? p->wide - q->wide : (p->turn > q->turn) - (p->turn < q->turn);
}

/* Modes in order, and with them what bins tell of them. */
static enum modal_status sort_modes(struct whittle *m, const int *told, const bool *tells,
                                    int bins, bool *sorted, struct modal_error *err)
{
    struct rank rank[WHITTLE_MODES_MOST];
    struct whittle *copy = malloc(sizeof *copy);

    if (copy == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d modes", m->count);
    *copy = *m;
    for (int k = 0; k < m->count; k++)
        rank[k] = (struct rank) { fabs(cimag(m->mode[k].lambda)), told[k] > bins / 2, k };
    qsort(rank, (size_t)m->count, sizeof *rank, before);
    for (int k = 0; k < m->count; k++) {
        m->mode[k] = copy->mode[rank[k].mode];
        for (int b = 0; b < bins; b++)
            sorted[k + (size_t)m->count * b] = tells[rank[k].mode + (size_t)m->count * b];
    }
    free(copy);
    return MODAL_OK;
}

enum modal_status reach_find(struct whittle *m, const struct bins *s, double loss, bool *tells,
                             struct modal_error *err)
{
    struct workspace room = { 0 };
    size_t n = (size_t)s->count * (size_t)m->count;
    double *told = workspace_zeros(&room, n, sizeof *told);
    bool *unsorted = workspace_zeros(&room, n, sizeof *unsorted);
    double complex poles[WHITTLE_MODES_MOST];
    int chosen[WHITTLE_MODES_MOST];
    enum modal_status rc = workspace_check(&room, "identify: no memory for what bins tell", err);

    whittle_poles(m, poles);
    for (int b = 0; rc == MODAL_OK && b < s->count; b++)
        tell_bin(m, poles, s, b, told + b);
    for (int k = 0; rc == MODAL_OK && k < m->count; k++)
        chosen[k] = choose_bins(told + (size_t)k * s->count, s->count, m->count,
                                bin_of(s, fabs(cimag(m->mode[k].lambda))), loss, unsorted + k);
    if (rc == MODAL_OK)
        rc = sort_modes(m, chosen, unsorted, s->count, tells, err);
    workspace_free(&room);
    return rc;
}
