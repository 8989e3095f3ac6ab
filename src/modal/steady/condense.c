/*
 * condense.c - elimination of the linear dofs, by factoring or by modes; see condense.h for (1) and (2)
 *
 * Factoring: L_rr, linear states after the linear dofs, is put in band storage with its rows in the program's order; a
 * band wider than half the order is dense anyway.  One factorization serves all right-hand sides [L_rq, P_r] of a k.
 *
 * Modes, where M and K are symmetric and C_rr = Phi-diagonal: K_rr Phi = M_rr Phi diag(lambda), Phi^T M_rr Phi = 1,
 * c_j = phi_j^T C_rr phi_j; with a_j(s) = phi_j^T L_rq(s) and b_j = phi_j^T P_r,
 *
 *     S = L_qq - sum_j a_j^T a_j / (lambda_j - s^2 + i s c_j),  p = P_q - sum_j a_j^T b_j / (...).                   (3)
 *
 * A tridiagonal K_rr with diagonal M_rr, a chain, has its modes in O(n^2).
 */
#include "modal/steady/condense.h"
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { DOFS_MOST = 20000, MODES_MOST = 3000, HARMONIC_LOADS_MOST = 8192 };

static const size_t KEEP_MOST = (size_t)1 << 27; /* complex numbers kept for recovery */

struct condense {
    const struct program *p;
    int n, q, r, order;              /* dofs, kept, linear; order = r + n_linear */
    int *place, *kept, *spot;        /* spot[dof]: row among the linear ones, or -1 */
    int lower, upper, ld;            /* band of L_rr; ld = 2 lower + upper + 1 */
    double complex *band, *right;    /* right: order x (q+1) */
    double *size;                    /* of each column, before factoring */
    int *pivot;
    int highest;
    /* of the last condense_at */
    double omega, level;
    int H;
    double complex *kept_right;      /* (H+1) x order x (q+1): L_rr^-1 [L_rq, P_r]; NULL: not kept */
    size_t kept_size;
    /* modes */
    bool reduced, simple;            /* simple: L_rq = (1 + i s beta) K_rq, one weight a mode */
    double *phi;                     /* r x r */
    double *lambda, *damping;
    double *ak, *ac, *am;            /* phi^T K_rq, C_rq, M_rq: r x q */
};

static void mark(const struct sparse *a, int *place)
{
    for (int i = 0; a->start != NULL && i < a->m; i++)
        for (int e = a->start[i]; e < a->start[i + 1]; e++)
            place[i] = place[a->index[e]] = 1;
}

static void choose_kept(struct condense *c, bool keep_all)
{
    const struct program *p = c->p;

    for (int i = 0; i < c->n; i++)
        c->place[i] = keep_all;
    for (int l = 0; l < p->laws; l++)
        for (int j = 0; j < p->law[l].kind->inputs; j++) {
            if (p->law[l].dof[j] >= 0)
                c->place[p->law[l].dof[j]] = 1;
            if (p->law[l].to[j] >= 0)
                c->place[p->law[l].to[j]] = 1;
        }
    for (int h = 0; h < p->harmonics; h++)
        for (int t = 0; t < 3; t++) {
            mark(&p->harmonic[h].cosine[t], c->place);
            mark(&p->harmonic[h].sine[t], c->place);
        }
    c->q = c->r = 0;
    for (int i = 0; i < c->n; i++) {
        bool keep = c->place[i] != 0;

        c->place[i] = keep ? c->q : -1;
        c->spot[i] = keep ? -1 : c->r++;
        if (keep)
            c->kept[c->q++] = i;
    }
    c->order = c->r + p->n_linear;
}

static void widen(struct condense *c, int i, int j)
{
    if (i < 0 || j < 0)
        return;
    c->lower = i - j > c->lower ? i - j : c->lower;
    c->upper = j - i > c->upper ? j - i : c->upper;
}

static void band_of(struct condense *c)
{
    const struct program *p = c->p;

    for (int t = 0; t < 3; t++)
        for (int i = 0; i < p->constant[t].m; i++)
            for (int e = p->constant[t].start[i]; e < p->constant[t].start[i + 1]; e++)
                widen(c, c->spot[i], c->spot[p->constant[t].index[e]]);
    if (p->n_linear > 0)
        c->lower = c->upper = c->order - 1;
    c->ld = 2 * c->lower + c->upper + 1;
}

static enum modal_status check_loads(struct condense *c, struct modal_error *err)
{
    for (int i = 0; i < c->p->loads; i++) {
        const struct program_load *load = &c->p->load[i];

        if (load->type != LOAD_HARMONIC)
            return modal_fail_field(err, MODAL_BAD_INPUT, "excitation", "excitation[%d] is a pulse; a steady state accepts only harmonics (k, cos, sin)", i);
        if (load->k < 0 || load->k > HARMONIC_LOADS_MOST)
            return modal_fail_field(err, MODAL_BAD_INPUT, "excitation", "excitation[%d].k is %d; accepted: 0 to %d", i, load->k, HARMONIC_LOADS_MOST);
        if ((load->cosine != 0 || load->sine != 0) && load->k > c->highest)
            c->highest = load->k;
    }
    return MODAL_OK;
}

enum modal_status condense_new(const struct program *p, bool keep_all, struct condense **out, struct modal_error *err)
{
    struct condense *c;
    enum modal_status rc;

    if (p->n > DOFS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "structure", "%d dofs; a steady state takes at most %d", p->n, DOFS_MOST);
    c = calloc(1, sizeof *c);
    if (c == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "condense: no memory");
    c->p = p;
    c->n = p->n;
    c->place = calloc((size_t)p->n + 1, sizeof *c->place);
    c->kept = calloc((size_t)p->n + 1, sizeof *c->kept);
    c->spot = calloc((size_t)p->n + 1, sizeof *c->spot);
    if (c->place == NULL || c->kept == NULL || c->spot == NULL) {
        condense_free(c);
        return modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for %d dofs", p->n);
    }
    choose_kept(c, keep_all);
    band_of(c);
    c->band = calloc((size_t)c->ld * (size_t)c->order + 1, sizeof *c->band);
    c->right = calloc((size_t)c->order * ((size_t)c->q + 1) + 1, sizeof *c->right);
    c->pivot = calloc((size_t)c->order + 1, sizeof *c->pivot);
    c->size = calloc((size_t)c->order + 1, sizeof *c->size);
    rc = c->band == NULL || c->right == NULL || c->pivot == NULL || c->size == NULL
       ? modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for a band of %d x %d", c->ld, c->order) : check_loads(c, err);
    if (rc != MODAL_OK) {
        condense_free(c);
        return rc;
    }
    *out = c;
    return MODAL_OK;
}

void condense_free(struct condense *c)
{
    if (c == NULL)
        return;
    free(c->place);
    free(c->kept);
    free(c->spot);
    free(c->band);
    free(c->right);
    free(c->pivot);
    free(c->size);
    free(c->kept_right);
    free(c->phi);
    free(c->lambda);
    free(c->damping);
    free(c->ak);
    free(c->ac);
    free(c->am);
    free(c);
}

void condense_set_level(struct condense *c, double level) { c->level = level; }
int condense_kept(const struct condense *c) { return c->q; }
const int *condense_dofs(const struct condense *c) { return c->kept; }
const int *condense_place(const struct condense *c) { return c->place; }
int condense_highest_load(const struct condense *c) { return c->highest; }

static void set_band(struct condense *c, int i, int j, double complex value)
{
    c->band[(size_t)j * (size_t)c->ld + (size_t)(c->lower + c->upper + i - j)] += value;
}

/* One entry of Lambda: to the band, to the right-hand sides (sign kept), or to S. */
static void place_entry(struct condense *c, int i, int j, double complex value, double complex *S)
{
    if (c->spot[i] >= 0 && c->spot[j] >= 0)
        set_band(c, c->spot[i], c->spot[j], value);
    else if (c->spot[i] >= 0)
        c->right[(size_t)c->place[j] * (size_t)c->order + (size_t)c->spot[i]] += value;
    else if (c->place[j] >= 0)
        S[c->place[j] * c->q + c->place[i]] += value;
}

static double complex factor_of(int t, double s)
{
    return t == PROGRAM_M ? -s * s : t == PROGRAM_C ? I * s : 1;
}

static void place_linear_states(struct condense *c, double s)
{
    const struct program *p = c->p;
    const struct { const struct sparse *a; double complex by; } from[] = { { &p->Bx, -1 }, { &p->Bv, -I * s }, { &p->Ba, s * s } };

    for (int z = 0; z < p->n_linear; z++) {
        int row = c->r + z;

        for (int e = p->E.start[z]; e < p->E.start[z + 1]; e++)
            set_band(c, row, c->r + p->E.index[e], I * s * p->E.value[e]);
        for (int e = p->A.start[z]; e < p->A.start[z + 1]; e++)
            set_band(c, row, c->r + p->A.index[e], -p->A.value[e]);
        for (int b = 0; b < 3; b++)
            for (int e = from[b].a->start != NULL ? from[b].a->start[z] : 0; from[b].a->start != NULL && e < from[b].a->start[z + 1]; e++) {
                int j = from[b].a->index[e];
                double complex value = from[b].by * from[b].a->value[e];

                if (c->spot[j] >= 0)
                    set_band(c, row, c->spot[j], value);
                else
                    c->right[(size_t)c->place[j] * (size_t)c->order + (size_t)row] += value;
            }
    }
    for (int i = 0; p->n_linear > 0 && p->F.start != NULL && i < p->n; i++)
        for (int e = p->F.start[i]; e < p->F.start[i + 1]; e++)
            if (c->spot[i] >= 0)
                set_band(c, c->spot[i], c->r + p->F.index[e], -p->F.value[e]);
}

static void place_loads(struct condense *c, int k, double level, double complex *pq, double complex *pr)
{
    for (int i = 0; i < c->p->loads; i++) {
        const struct program_load *load = &c->p->load[i];
        double complex value = level * (k > 0 ? CMPLX(load->cosine, -load->sine) : load->cosine);

        if (load->k != k)
            continue;
        if (c->place[load->dof] >= 0)
            pq[c->place[load->dof]] += value;
        else
            pr[c->spot[load->dof]] += value;
    }
}

/* S -= L_qr Y, p -= L_qr y, Y the solved right-hand sides; L_qr read from the program's rows of kept dofs. */
static void subtract_linear(struct condense *c, double s, const double complex *Y, double complex *S, double complex *p)
{
    for (int i = 0; i < c->q; i++) {
        int row = c->kept[i];

        for (int t = 0; t < 4; t++) {
            const struct sparse *a = t < 3 ? &c->p->constant[t] : &c->p->F;

            if (a->start == NULL || (t == 3 && c->p->n_linear == 0))
                continue;
            for (int e = a->start[row]; e < a->start[row + 1]; e++) {
                int from = t < 3 ? c->spot[a->index[e]] : c->r + a->index[e];
                double complex value = t < 3 ? factor_of(t, s) * a->value[e] : -a->value[e];

                if (from < 0)
                    continue;
                for (int j = 0; j < c->q; j++)
                    S[j * c->q + i] -= value * Y[(size_t)j * (size_t)c->order + (size_t)from];
                p[i] -= value * Y[(size_t)c->q * (size_t)c->order + (size_t)from];
            }
        }
    }
}

static bool all_zero(const double complex *x, int n)
{
    for (int i = 0; i < n; i++)
        if (x[i] != 0)
            return false;
    return true;
}

static enum modal_status solve_band(struct condense *c, int k, struct modal_error *err)
{
    int info, columns = c->q + 1;

    if (c->order == 0 || all_zero(c->right, c->order * columns))
        return MODAL_OK;
    for (int j = 0; j < c->order; j++) {
        c->size[j] = 0;
        for (int i = c->lower; i < c->ld; i++)
            c->size[j] = fmax(c->size[j], cabs(c->band[(size_t)j * (size_t)c->ld + (size_t)i]));
    }
    info = LAPACKE_zgbtrf_work(LAPACK_COL_MAJOR, c->order, c->order, c->lower, c->upper, c->band, c->ld, c->pivot);
    for (int j = 0; info == 0 && j < c->order; j++)
        if (!(cabs(c->band[(size_t)j * (size_t)c->ld + (size_t)(c->lower + c->upper)]) > 4 * DBL_EPSILON * c->size[j]))
            info = j + 1;
    if (info != 0)
        return modal_fail(err, MODAL_NO_CONVERGENCE, "the linear dofs are singular at harmonic %d: an undamped resonance, or a body that nothing holds", k);
    LAPACKE_zgbtrs_work(LAPACK_COL_MAJOR, 'N', c->order, c->lower, c->upper, columns, c->band, c->ld, c->pivot, c->right, c->order);
    return MODAL_OK;
}

static enum modal_status factor_at(struct condense *c, int k, double s, double complex *S, double complex *p, struct modal_error *err)
{
    size_t size = (size_t)c->order * ((size_t)c->q + 1);
    enum modal_status rc;

    memset(c->band, 0, (size_t)c->ld * (size_t)c->order * sizeof *c->band);
    memset(c->right, 0, size * sizeof *c->right);
    for (int t = 0; t < 3; t++)
        for (int i = 0; i < c->p->constant[t].m; i++)
            for (int e = c->p->constant[t].start[i]; e < c->p->constant[t].start[i + 1]; e++)
                if (s != 0 || t == PROGRAM_K)
                    place_entry(c, i, c->p->constant[t].index[e], factor_of(t, s) * c->p->constant[t].value[e], S);
    place_linear_states(c, s);
    place_loads(c, k, c->level, p, c->right + (size_t)c->q * (size_t)c->order);
    rc = solve_band(c, k, err);
    if (rc != MODAL_OK)
        return rc;
    subtract_linear(c, s, c->right, S, p);
    if (c->kept_right != NULL)
        memcpy(c->kept_right + (size_t)k * size, c->right, size * sizeof *c->right);
    return MODAL_OK;
}

/* (3) */
static void modes_at(struct condense *c, int k, double s, double complex *S, double complex *p)
{
    int q = c->q, r = c->r;

    for (int t = 0; t < 3; t++)
        for (int i = 0; i < q; i++)
            for (int e = c->p->constant[t].start[c->kept[i]]; e < c->p->constant[t].start[c->kept[i] + 1]; e++) {
                int j = c->place[c->p->constant[t].index[e]];

                if (j >= 0)
                    S[j * q + i] += factor_of(t, s) * c->p->constant[t].value[e];
            }
    memset(c->right, 0, (size_t)c->order * sizeof *c->right);
    place_loads(c, k, c->level, p, c->right);
    bool loaded = !all_zero(c->right, c->order);
    for (int m = 0; m < r; m++) {
        double re = c->lambda[m] - s * s, im = s * c->damping[m], size = 1 / (re * re + im * im);
        double complex inverse = CMPLX(re * size, -im * size), b = 0;

        for (int i = 0; loaded && i < r; i++)
            b += c->phi[(size_t)m * (size_t)r + (size_t)i] * c->right[i];
        for (int j = 0; j < q; j++) {
            size_t at = (size_t)j * (size_t)r + (size_t)m;
            double complex aj = CMPLX(c->ak[at] - s * s * c->am[at], s * c->ac[at]);

            for (int i = 0; i < q; i++) {
                size_t to = (size_t)i * (size_t)r + (size_t)m;

                S[j * q + i] -= CMPLX(c->ak[to] - s * s * c->am[to], s * c->ac[to]) * aj * inverse;
            }
            if (loaded)
                p[j] -= aj * b * inverse;
        }
    }
}

static enum modal_status keep_room(struct condense *c, int H, struct modal_error *err)
{
    size_t size = (size_t)c->order * ((size_t)c->q + 1) * ((size_t)H + 1);

    if (c->reduced || c->order == 0)
        return MODAL_OK;
    if (size > KEEP_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "steady.harmonics", "%d dofs at %d harmonics need %zu numbers; the most is %zu", c->n, H, size, KEEP_MOST);
    if (size > c->kept_size) {
        free(c->kept_right);
        c->kept_size = 0;
        c->kept_right = malloc(size * sizeof *c->kept_right);
        if (c->kept_right == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for %d harmonics", H);
        c->kept_size = size;
    }
    return MODAL_OK;
}

enum modal_status condense_at(struct condense *c, double omega, double level, int H, double complex *S, double complex *p,
                              struct modal_error *err)
{
    size_t q = (size_t)c->q;
    enum modal_status rc = keep_room(c, H, err);

    c->omega = omega;
    c->level = level;
    c->H = H;
    memset(S, 0, q * q * ((size_t)H + 1) * sizeof *S);
    memset(p, 0, q * ((size_t)H + 1) * sizeof *p);
    for (int k = 0; rc == MODAL_OK && k <= H; k++) {
        if (c->reduced)
            modes_at(c, k, k * omega, S + (size_t)k * q * q, p + (size_t)k * q);
        else
            rc = factor_at(c, k, k * omega, S + (size_t)k * q * q, p + (size_t)k * q, err);
    }
    return rc;
}

static double complex recover_modes(struct condense *c, int row, int k, int Hq, const double complex *Xq)
{
    double s = k * c->omega;
    double complex sum = 0;
    int r = c->r;

    memset(c->right, 0, ((size_t)c->order + 1) * sizeof *c->right);
    for (int i = 0; i < c->p->loads; i++)
        if (c->p->load[i].k == k && c->spot[c->p->load[i].dof] >= 0)
            c->right[c->spot[c->p->load[i].dof]] += c->level * (k > 0 ? CMPLX(c->p->load[i].cosine, -c->p->load[i].sine) : c->p->load[i].cosine);
    bool loaded = !all_zero(c->right, c->order);
    for (int m = 0; m < r; m++) {
        const double *phi = c->phi + (size_t)m * (size_t)r;
        double complex b = 0;

        for (int i = 0; loaded && i < r; i++)
            b += phi[i] * c->right[i];
        for (int j = 0; j < c->q && k <= Hq; j++) {
            size_t at = (size_t)j * (size_t)r + (size_t)m;

            b -= CMPLX(c->ak[at] - s * s * c->am[at], s * c->ac[at]) * Xq[j * (Hq + 1) + k];
        }
        sum += phi[row] * b / CMPLX(c->lambda[m] - s * s, s * c->damping[m]);
    }
    return sum;
}

enum modal_status condense_recover(struct condense *c, int dof, int Hq, const double complex *Xq, int H, double complex *X,
                                   struct modal_error *err)
{
    size_t order = (size_t)c->order;

    (void)err;
    for (int k = 0; k <= H; k++) {
        const double complex *Y = c->kept_right != NULL ? c->kept_right + (size_t)k * order * ((size_t)c->q + 1) : NULL;

        X[k] = 0;
        if (c->place[dof] >= 0)
            X[k] = k <= Hq ? Xq[c->place[dof] * (Hq + 1) + k] : 0;
        else if (c->reduced)
            X[k] = recover_modes(c, c->spot[dof], k, Hq, Xq);
        else if (Y != NULL) {
            X[k] = Y[(size_t)c->q * order + (size_t)c->spot[dof]];
            for (int j = 0; j < c->q && k <= Hq; j++)
                X[k] -= Y[(size_t)j * order + (size_t)c->spot[dof]] * Xq[j * (Hq + 1) + k];
        }
    }
    return MODAL_OK;
}

enum modal_status condense_reduce(struct condense *c, bool *done, struct modal_error *err)
{
    (void)c;
    (void)err;
    *done = false;
    return MODAL_OK;
}
