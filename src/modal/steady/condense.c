/*
 * condense.c - elimination of the linear dofs, by factoring; by modes, (3), in condense_modes.c;
 * see condense.h for (1) and (2)
 *
 * Factoring: L_rr, linear states after the linear dofs, is put in band storage with its rows in the
 * program's order; a band wider than half the order is dense anyway.  One factorization serves all
 * right-hand sides [L_rq, P_r] of a k.
 *
 * The motion of linear dofs is recovered by factoring, only when asked for.
 *
 * From SPARSE_LEAST linear dofs on L_rr has sparse factors in place of a band.  Of the solutions
 * only the rows that condense_want names are kept, with S_k and p_k, until another omega: each
 * harmonic is factored once, whatever orders are tried.
 *
 * A load fixed in space, Re P e^{i k omega t}, on axes that turn at m omega, is on them Re P e^{i k
 * omega t} cos(m omega t) on its dof and `turn` times the like with sin on the other transverse
 * one, so
 *
 *     P/2 at k + m and k - m,     P/2i at k + m and -P/2i at k - m,                             (4)
 *
 * where Re Z e^{-i j omega t} = Re conj(Z) e^{i j omega t}.
 */
#include <float.h>
#include <lapacke.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "modal/linalg/sparse_lu.h"
#include "modal/steady/budget.h"
#include "modal/steady/condense_state.h"
#include "modal/steady/pattern.h"

enum {
    SPARSE_LEAST = 2000,         /* a full band of as many is factored in seconds */
    SOLVE_WORK = 40,             /* operations an entry of L_rr in a solution: its factors' fill */
    HARMONIC_LOADS_MOST = 8192   /* past any number of harmonics that is solved for */
};
/* Complex numbers kept for recovery: 2 GB. */
static const size_t KEEP_MOST = (size_t)1 << 27;
/* A speed off a multiple of omega by less than this, relative, is one: both come from texts. */
static const double MULTIPLE = 1e-12;
/* Of the terms of an entry of S_0 or p_0, what is left of them where they cancel: hundreds of
 * roundings, as OPEN of balance.c. */
static const double CANCELLED = 1e-13;
/* A pivot below so many roundings of its column's size may be 0. */
static const double PIVOT = 4;
/* The least pivot over the largest, of sparse factors, below which one may be 0. */
static const double PIVOT_RATIO = 64 * DBL_EPSILON;

/* The dofs of laws and of periodic matrices are not 0 in PLACE, which was. */
static void mark_nonlinear(const struct program *p, int *place)
{
    for (int l = 0; l < p->laws; l++)
        for (int e = 0; e < law_ends(&p->law[l]); e++)
            place[p->law[l].end[e].dof] = 1;
    for (int h = 0; h < p->harmonics; h++)
        for (int t = 0; t < 3; t++) {
            sparse_mark(&p->harmonic[h].cosine[t], place);
            sparse_mark(&p->harmonic[h].sine[t], place);
        }
}

int condense_nonlinear(const struct program *p)
{
    int *place = calloc((size_t)p->n + 1, sizeof *place), count = 0;

    if (place != NULL)
        mark_nonlinear(p, place);
    for (int i = 0; place != NULL && i < p->n; i++)
        count += place[i];
    free(place);
    return count;
}

bool condense_many(const struct program *p)
{
    return p->n_linear == 0 && p->n - condense_nonlinear(p) >= SPARSE_LEAST;
}

/* q and r, and where each dof is among the kept or the linear. */
static void choose_kept(struct condense *c, enum condense_keep which)
{
    const struct program *p = c->p;

    for (int i = 0; i < c->n; i++)
        c->place[i] = which != CONDENSE_LINEAR;
    mark_nonlinear(p, c->place);
    c->q = c->r = 0;
    for (int i = 0; i < c->n; i++) {
        bool keep = c->place[i] != 0;                   /* marked above */

        c->place[i] = keep ? c->q : -1;                 /* ascending, as the program has them */
        c->spot[i] = keep ? -1 : c->r++;
        if (keep)
            c->kept[c->q++] = i;
    }
    c->order = c->r + p->n_linear;                      /* linear states after the linear dofs */
}

/* The band holds (i, j), rows among the linear dofs (negative: kept). */
static void widen(struct condense *c, int i, int j)
{
    if (i < 0 || j < 0)
        return;
    c->lower = i - j > c->lower ? i - j : c->lower;
    c->upper = j - i > c->upper ? j - i : c->upper;
}

/* The band of L_rr; linear states lie past all dofs, so that with them it is full. */
static void band_of(struct condense *c)
{
    const struct program *p = c->p;

    for (int t = 0; t < 3; t++)
        for (int i = 0; i < p->constant[t].m; i++)
            for (int e = p->constant[t].start[i]; e < p->constant[t].start[i + 1]; e++)
                widen(c, c->spot[i], c->spot[p->constant[t].index[e]]);
    if (p->n_linear > 0)
        c->lower = c->upper = c->order - 1;
    c->ld = 2 * c->lower + c->upper + 1;                /* LAPACK's room for pivots */
}

/* A harmonic load on the program's axes; of k < 0 the conjugate at -k. */
static void add_load(struct condense *c, int dof, int k, double complex value)
{
    if (value == 0)
        return;
    c->load[c->loads++] = (struct condense_load){ dof, abs(k),
                                                  k > 0   ? value
                                                  : k < 0 ? conj(value)
                                                          : creal(value) };
    c->highest = abs(k) > c->highest ? abs(k) : c->highest;
}

/* How often the axes turn in a period, for a load that does not turn with them. */
static enum modal_status turns_a_period(const struct condense *c, double omega, int *m,
                                        struct modal_error *err)
{
    double speed = c->p->frame_speed, turns = round(speed / omega);

    for (int i = 0; i < c->p->loads; i++)
        if (c->p->load[i].dof_sine >= 0
            && (!(fabs(turns * omega - speed) <= MULTIPLE * speed)
                || turns > HARMONIC_LOADS_MOST)) {
            char field[48];
            snprintf(field, sizeof field, "excitation[%d].frame", i);
            return modal_fail_field(err, MODAL_BAD_INPUT, field,
                                    "excitation[%d] is fixed in space, and is periodic on axes "
                                    "turning at %.17g rad/s where that "
                                    "is a whole multiple (at most %d) of omega = %.17g",
                                    i, speed, HARMONIC_LOADS_MOST, omega);
        }
    *m = (int)turns;
    return MODAL_OK;
}

/* (4). */
static void split_load(struct condense *c, const struct program_load *load, int m)
{
    double complex P = load->k > 0 ? CMPLX(load->cosine, -load->sine) : load->cosine;

    if (load->dof_sine < 0) {
        add_load(c, load->dof, load->k, P);
        return;
    }
    for (int side = -1; side <= 1; side += 2) {
        add_load(c, load->dof, load->k + side * m, P / 2);  /* (4), cos */
        /* (4), sin: 1/2i at k + m, -1/2i at k - m */
        add_load(c, load->dof_sine, load->k + side * m, side * load->turn * P / (2 * I));
    }
}

/* The program's loads as harmonics: those at once, the fixed ones by (4). */
static enum modal_status read_loads(struct condense *c, struct modal_error *err)
{
    int m = 0;
    enum modal_status rc = turns_a_period(c, c->p->omega, &m, err);

    for (int i = 0; rc == MODAL_OK && i < c->p->loads; i++) {
        const struct program_load *load = &c->p->load[i];

        if (load->type != LOAD_HARMONIC)
            return modal_fail_field(err, MODAL_BAD_INPUT, "excitation", "excitation[%d] is no "
                                    "harmonic (k, cos, sin), and a steady state takes only those; "
                                    "simulate takes all", i);
        if (load->tones > 0)
            return modal_fail_field(err, MODAL_BAD_INPUT, "excitation",
                                    "excitation[%d].k names tones, of which there are none; give "
                                    "steady.tones (or -o tones=W1,W2)", i);
        if (load->k < 0 || load->k > HARMONIC_LOADS_MOST)
            return modal_fail_field(err, MODAL_BAD_INPUT, "excitation",
                                    "excitation[%d].k is %d; accepted: 0 to %d", i, load->k,
                                    HARMONIC_LOADS_MOST);
        split_load(c, load, m);
    }
    return rc;
}

/* Room for sparse factors of L_rr, when the first is made: who inherits all harmonics makes none,
 * and on many dofs the pattern alone takes a part of a factorization. */
static enum modal_status sparse_begin(struct condense *c, struct modal_error *err)
{
    enum modal_status rc = pattern_new(c->p, c->spot, c->r, false, &c->linear, err);

    if (rc == MODAL_OK)
        rc = sparse_lu_new(c->r, c->linear->start, c->linear->index, true, &c->factors, err);
    if (rc == MODAL_OK) {
        c->value = workspace_zeros(&c->space, (size_t)pattern_entries(c->linear),
                                   sizeof *c->value);
        c->column = workspace_zeros(&c->space, (size_t)c->order, sizeof *c->column);
        rc = workspace_check(&c->space, "condense: no memory for sparse factors", err);
    }
    if (rc == MODAL_OK)
        return MODAL_OK;
    pattern_free(c->linear);
    sparse_lu_free(c->factors);
    c->linear = NULL;
    c->factors = NULL;
    return rc;
}

void condense_want(struct condense *c, const int *dofs, int count)
{
    if (c->seat == NULL)
        return;
    condense_forget(c, 0);
    c->seats = 0;
    for (int i = 0; i < c->n; i++)
        c->seat[i] = -1;
    for (int i = 0; i < count; i++) {
        int dof = dofs != NULL ? dofs[i] : i;

        if (c->spot[dof] >= 0 && c->seat[dof] < 0)
            c->seat[dof] = c->seats++;
    }
}

enum modal_status condense_new(const struct program *p, enum condense_keep keep,
                               struct condense **out, struct modal_error *err)
{
    struct condense *c;
    enum modal_status rc = MODAL_OK;

    if (p->seen_fixed)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "structure.frame",
            "the damped ends of a massless shaft are states on turning axes: a steady state "
            "of it is found with structure.frame \"rotating\"");
    c = calloc(1, sizeof *c);
    if (c == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "condense: no memory");
    c->p = p;
    c->n = p->n;
    c->place = workspace_zeros(&c->space, (size_t)p->n, sizeof *c->place);
    c->kept = workspace_zeros(&c->space, (size_t)p->n, sizeof *c->kept);
    c->spot = workspace_zeros(&c->space, (size_t)p->n, sizeof *c->spot);
    if (c->space.failed) {
        condense_free(c);
        return modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for %d dofs", p->n);
    }
    choose_kept(c, keep);
    c->sparse = keep == CONDENSE_LINEAR && condense_many(p);
    if (!c->sparse)
        band_of(c);
    else if ((c->seat = workspace_zeros(&c->space, (size_t)c->n, sizeof *c->seat)) != NULL)
        condense_want(c, NULL, c->n);
    c->band = workspace_zeros(&c->space, (size_t)c->ld * (size_t)c->order, sizeof *c->band);
    c->right = workspace_zeros(&c->space, (size_t)c->order * ((size_t)c->q + 1), sizeof *c->right);
    c->pivot = workspace_zeros(&c->space, (size_t)c->order, sizeof *c->pivot);
    c->size = workspace_zeros(&c->space, (size_t)c->order, sizeof *c->size);
    c->terms = workspace_zeros(&c->space, (size_t)c->q + 1, sizeof *c->terms);
    c->load = workspace_zeros(&c->space, 4 * (size_t)p->loads, sizeof *c->load);
    rc = c->space.failed
             ? modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for a band of %d x %d", c->ld,
                          c->order)
             : read_loads(c, err);
    if (rc == MODAL_OK)
        rc = pattern_new(p, c->place, c->q, keep != CONDENSE_SPARSE, &c->pattern, err);
    if (rc == MODAL_OK)
        *out = c;
    else
        condense_free(c);
    return rc;
}

void condense_free(struct condense *c)
{
    if (c == NULL)
        return;
    condense_forget(c, 0);
    condense_lanczos_free(c);
    condense_basis_free(c);
    free(c->harmonic);
    pattern_free(c->linear);
    sparse_lu_free(c->factors);
    pattern_free(c->pattern);
    free(c->kept_right);
    workspace_free(&c->space);
    free(c);
}

void condense_set_level(struct condense *c, double level) { c->level = level; }
int condense_kept(const struct condense *c) { return c->q; }
const int *condense_dofs(const struct condense *c) { return c->kept; }
const int *condense_place(const struct condense *c) { return c->place; }
const struct pattern *condense_pattern(const struct condense *c) { return c->pattern; }
double condense_work(const struct condense *c) { return c->work; }
bool condense_factors(const struct condense *c) { return c->sparse; }
int condense_highest_load(const struct condense *c) { return c->highest; }

/* L_rr(i, j) += value: in LAPACK's band storage, with room for fill above, or sparse. */
static void set_band(struct condense *c, int i, int j, double complex value)
{
    if (c->sparse)
        c->value[pattern_find(c->linear, i, j)] += value;
    else
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
        S[pattern_find(c->pattern, c->place[i], c->place[j])] += value;
}

/* The rows of z, (i s E - A) z - (Bx + i s Bv - s^2 Ba) x = 0, and -F z in the rows of linear
 * dofs. */
static void place_linear_states(struct condense *c, double s)
{
    const struct program *p = c->p;
    const struct {
        const struct sparse *a;
        double complex by;
    } from[] = { { &p->Bx, -1 }, { &p->Bv, -I * s }, { &p->Ba, s * s } };

    for (int z = 0; z < p->n_linear; z++) {
        int row = c->r + z;

        for (int e = p->E.start[z]; e < p->E.start[z + 1]; e++)
            set_band(c, row, c->r + p->E.index[e], I * s * p->E.value[e]);  /* i s E */
        for (int e = p->A.start[z]; e < p->A.start[z + 1]; e++)
            set_band(c, row, c->r + p->A.index[e], -p->A.value[e]);  /* - A */
        for (int b = 0; b < 3; b++)
            for (int e = from[b].a->start != NULL ? from[b].a->start[z] : 0;
                 from[b].a->start != NULL && e < from[b].a->start[z + 1]; e++) {
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

/* P of harmonic k: p_q of the kept dofs, P_r of the others. */
static void place_loads(struct condense *c, int k, double level, double complex *pq,
                        double complex *pr)
{
    for (int i = 0; i < c->loads; i++) {
        const struct condense_load *load = &c->load[i];
        double complex value = level * load->value;

        if (load->k != k)
            continue;
        if (c->place[load->dof] >= 0)
            pq[c->place[load->dof]] += value;
        else
            pr[c->spot[load->dof]] += value;
    }
}

/* What TERMS of row I of S and p leave, at rest: 0 where that is rounding beside them.  Nothing
 * holds a mean that S_0 takes to 0, and what rounding held it by would be all that its row has. */
static void clear_rounding(const struct condense *c, int i, double complex *S, double complex *p)
{
    for (int j = 0; j <= c->q; j++) {
        double complex *entry = j < c->q ? &S[j * c->q + i] : &p[i];

        if (cabs(*entry) <= CANCELLED * c->terms[j])
            *entry = 0;
    }
}

/* S -= L_qr Y, p -= L_qr y, Y the solved right-hand sides; L_qr read from the program's rows of
 * kept dofs. */
static void subtract_linear(struct condense *c, double s, const double complex *Y,
                            double complex *S, double complex *p)
{
    for (int i = 0; i < c->q; i++) {
        int row = c->kept[i];

        memset(c->terms, 0, ((size_t)c->q + 1) * sizeof *c->terms);
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
                    /* (2), S */
                    S[j * c->q + i] -= value * Y[(size_t)j * (size_t)c->order + (size_t)from];
                p[i] -= value * Y[(size_t)c->q * (size_t)c->order + (size_t)from];  /* (2), p */
                for (int j = 0; s == 0 && j <= c->q; j++)
                    c->terms[j] += cabs(value * Y[(size_t)j * (size_t)c->order + (size_t)from]);
            }
        }
        if (s == 0)
            clear_rounding(c, i, S, p);
    }
}

/* Whether there is nothing to solve for. */
static bool all_zero(const double complex *x, int n)
{
    for (int i = 0; i < n; i++)
        if (x[i] != 0)
            return false;
    return true;
}

/* The same by sparse factors; false where they are singular to rounding. */
static bool solve_sparse(struct condense *c)
{
    if (!sparse_lu_factor(c->factors, c->value) || sparse_lu_rcond(c->factors) < PIVOT_RATIO)
        return false;
    c->work += sparse_lu_work(c->factors) / BUDGET_DENSE;
    for (int j = 0; j <= c->q; j++) {
        double complex *b = c->right + (size_t)j * (size_t)c->order;

        if (all_zero(b, c->order))
            continue;
        sparse_lu_solve(c->factors, b, c->column);
        memcpy(b, c->column, (size_t)c->order * sizeof *b);
        c->work += (double)SOLVE_WORK * pattern_entries(c->linear);
    }
    return true;
}

/* L_rr^-1 [L_rq, P_r] into c->right; a pivot that is rounding is told by its harmonic. */
static enum modal_status solve_band(struct condense *c, int k, struct modal_error *err)
{
    int info = 0, columns = c->q + 1;

    if (c->order == 0 || all_zero(c->right, c->order * columns))
        return MODAL_OK;
    if (c->sparse) {
        info = !solve_sparse(c);
        goto out;
    }
    for (int j = 0; j < c->order; j++) {
        c->size[j] = 0;                                /* the scale that a pivot is compared with */
        for (int i = c->lower; i < c->ld; i++)
            c->size[j] = fmax(c->size[j], cabs(c->band[(size_t)j * (size_t)c->ld + (size_t)i]));
    }
    info = LAPACKE_zgbtrf_work(LAPACK_COL_MAJOR, c->order, c->order, c->lower, c->upper, c->band,
                               c->ld, c->pivot);
    for (int j = 0; info == 0 && j < c->order; j++)
        if (!(cabs(c->band[(size_t)j * (size_t)c->ld + (size_t)(c->lower + c->upper)])
              > PIVOT * DBL_EPSILON * c->size[j]))
            info = j + 1;
    if (info == 0)
        LAPACKE_zgbtrs_work(LAPACK_COL_MAJOR, 'N', c->order, c->lower, c->upper, columns, c->band,
                            c->ld, c->pivot, c->right, c->order);
out:
    return info == 0 ? MODAL_OK
        : modal_fail(err, MODAL_NO_CONVERGENCE,
                     "the linear dofs are singular at harmonic %d: an undamped resonance, or "
                     "a body that nothing holds",
                     k);
}

enum modal_status condense_factor_at(struct condense *c, int k, double s, double complex *S,
                                     double complex *p, struct modal_error *err)
{
    size_t size = (size_t)c->order * ((size_t)c->q + 1);
    bool whole;
    enum modal_status rc;

    if (c->sparse && c->factors == NULL && (rc = sparse_begin(c, err)) != MODAL_OK)
        return rc;
    /* dgbtrf destroyed the last one; sparse values are added up in place */
    memset(c->band, 0, (size_t)c->ld * (size_t)c->order * sizeof *c->band);
    if (c->sparse)
        memset(c->value, 0, (size_t)pattern_entries(c->linear) * sizeof *c->value);
    memset(c->right, 0, size * sizeof *c->right);
    whole = condense_whole(c, s, S);
    for (int t = 0; !whole && t < 3; t++)
        for (int i = 0; i < c->p->constant[t].m; i++)
            for (int e = c->p->constant[t].start[i]; e < c->p->constant[t].start[i + 1]; e++)
                if (s != 0 || t == PROGRAM_K)
                    place_entry(c, i, c->p->constant[t].index[e],
                                factor_of(t, s) * c->p->constant[t].value[e], S);
    /* Then what linear states add, and the loads. */
    place_linear_states(c, s);
    place_loads(c, k, c->level, p, c->right + (size_t)c->q * (size_t)c->order);
    if (c->order == 0)
        /* every dof is kept: nothing to take out */
        return MODAL_OK;
    /* (2): one factorization for L_rq and P_r together. */
    rc = solve_band(c, k, err);
    if (rc != MODAL_OK)
        return rc;
    subtract_linear(c, s, c->right, S, p);
    if (c->kept_right != NULL)
        memcpy(c->kept_right + (size_t)k * size, c->right, size * sizeof *c->right);
    return MODAL_OK;
}

/* Harmonic k of c->omega is known: S_k, p_k at level 1, and the rows wanted. */
static enum modal_status learn(struct condense *c, int k, struct modal_error *err)
{
    size_t q = (size_t)c->q, entries = (size_t)pattern_entries(c->pattern);
    double level = c->level;
    struct condense_harmonic *h = &c->harmonic[k];
    bool rough = c->force != NULL && k > c->exact;
    enum modal_status rc;

    h->stale = (c->lanczos == NULL || !condense_lanczos_answer(c, k, rough, h))
               && (c->basis == NULL || !condense_basis_answer(c, k, rough, h));
    if (!h->stale)
        return MODAL_OK;
    memset(h->S, 0, entries * sizeof *h->S);
    memset(h->p, 0, q * sizeof *h->p);
    h->doubt = 0;
    h->rough = false;
    c->level = 1;
    rc = condense_factor_at(c, k, k * c->omega, h->S, h->p, err);
    c->level = level;
    for (int i = 0; rc == MODAL_OK && i < c->n; i++)
        for (size_t j = 0; c->seat[i] >= 0 && j <= q; j++)
            h->row[j * (size_t)c->seats + (size_t)c->seat[i]] =
                c->right[j * (size_t)c->order + (size_t)c->spot[i]];
    h->stale = rc != MODAL_OK;
    if (rc == MODAL_OK && c->lanczos != NULL)
        condense_lanczos_missed(c, rough);
    if (rc == MODAL_OK && c->basis != NULL)
        condense_basis_join(c);
    return rc;
}

void condense_rough(struct condense *c, int H, const double complex *F, int top)
{
    c->exact = H;
    c->force = F;
    c->top = top;
    c->moved = 0;
    c->left = F != NULL ? 0 : c->left;
}

double condense_left(const struct condense *c) { return c->left; }

double condense_doubt(const struct condense *c, int k)
{
    return c->sparse && k < c->known ? c->harmonic[k].doubt : 0;
}

/* The least power of two above H. */
static int stride_over(int H)
{
    int step = 1;

    while (step <= H)
        step *= 2;
    return step;
}

/* Whether harmonic K is of an estimate that goes about its own way. */
static bool is_rough(const struct condense *c, int k)
{
    return c->force != NULL && c->lanczos != NULL && k > c->exact;
}

/* Of harmonics 0 .. H, all of them places, those to be learnt that are no estimate's. */
static int lacking(const struct condense *c, int H)
{
    int count = 0;

    for (int k = 0; k <= H; k++)
        count += condense_lacks(c, k) && !is_rough(c, k);
    return count;
}

/* S and p of harmonics 0 .. H from those known, the others learnt. */
static enum modal_status recall(struct condense *c, int H, double complex *S, double complex *p,
                                struct modal_error *err)
{
    size_t q = (size_t)c->q, entries = (size_t)pattern_entries(c->pattern);
    enum modal_status rc = MODAL_OK;

    if (c->known_at != c->omega)
        condense_forget(c, 1);                          /* at rest there is no omega */
    c->known_at = c->omega;
    while (rc == MODAL_OK && c->known <= H)
        rc = condense_add_harmonic(c, err);
    /* What the lowest move is the most, and others' digits are counted against that. */
    for (int k = c->exact + 1; rc == MODAL_OK && c->force != NULL && c->lanczos != NULL && k <= H;
         k++)
        if (condense_lacks(c, k) && !condense_lanczos_leaves(c, k))
            rc = learn(c, k, err);
    if (rc == MODAL_OK && c->lanczos != NULL)
        condense_lanczos_expect(c, lacking(c, H));
    /* H, its half, their quarters: a basis serves best between what it was made of. */
    for (int step = stride_over(H); rc == MODAL_OK && step > 0; step /= 2)
        for (int k = H; rc == MODAL_OK && k >= 0; k -= step)
            if (condense_lacks(c, k) && !is_rough(c, k))
                rc = learn(c, k, err);
    if (rc != MODAL_OK)
        condense_forget(c, 0);
    for (int k = 0; rc == MODAL_OK && k <= H; k++) {
        memcpy(S + (size_t)k * entries, c->harmonic[k].S, entries * sizeof *S);
        for (size_t i = 0; i < q; i++)
            p[(size_t)k * q + i] = c->level * c->harmonic[k].p[i];
    }
    return rc;
}

/* Room for the solved right-hand sides of harmonics 0 .. H. */
static enum modal_status need_room(struct condense *c, int H, struct modal_error *err)
{
    size_t size = (size_t)c->order * ((size_t)c->q + 1) * ((size_t)H + 1);

    if (c->order == 0)
        return MODAL_OK;
    if (size > KEEP_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "steady.harmonics",
                                "%d dofs at %d harmonics need %zu numbers; the most is %zu", c->n,
                                H, size, KEEP_MOST);
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

/* S_0 and p_0, both 0 before, which no frequency changes: factored once, beside modes. */
static enum modal_status recall_rest(struct condense *c, double complex *S, double complex *p,
                                     struct modal_error *err)
{
    double complex *kept = c->kept_right;
    double level = c->level;
    size_t q = (size_t)c->q;
    enum modal_status rc = MODAL_OK;

    if (c->rest == NULL)
        c->rest = workspace_room(&c->space, q * (q + 1), sizeof *c->rest);
    if (c->rest == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "condense: no memory for rest");
    if (!c->rested) {
        memset(c->rest, 0, q * (q + 1) * sizeof *c->rest);
        c->kept_right = NULL;                           /* recovery makes its own */
        c->level = 1;
        rc = condense_factor_at(c, 0, 0, c->rest, c->rest + q * q, err);
        c->level = level;
        c->kept_right = kept;
        c->rested = rc == MODAL_OK;
    }
    if (rc != MODAL_OK)
        return rc;
    memcpy(S, c->rest, q * q * sizeof *S);
    for (size_t i = 0; i < q; i++)
        p[i] = level * c->rest[q * q + i];
    return MODAL_OK;
}

enum modal_status condense_at(struct condense *c, double omega, double level, int H,
                              double complex *S, double complex *p, struct modal_error *err)
{
    size_t q = (size_t)c->q, entries = (size_t)pattern_entries(c->pattern);
    int m;
    enum modal_status rc = turns_a_period(c, omega, &m, err);

    if (rc == MODAL_OK && !c->reduced && !c->sparse)
        rc = need_room(c, H, err);
    c->omega = omega;
    c->level = level;
    c->H = H;
    c->solved = !c->reduced;                     /* modes leave recovery for when it is asked for */
    memset(S, 0, entries * ((size_t)H + 1) * sizeof *S);
    memset(p, 0, q * ((size_t)H + 1) * sizeof *p);
    if (c->reduced && rc == MODAL_OK)
        rc = recall_rest(c, S, p, err);
    if (c->reduced)
        condense_reduced_at(c, H, S, p);
    else if (rc == MODAL_OK && c->sparse)
        return recall(c, H, S, p, err);
    for (int k = 0; rc == MODAL_OK && !c->reduced && k <= H; k++)
        rc = condense_factor_at(c, k, k * c->omega, S + (size_t)k * entries, p + (size_t)k * q,
                                err);
    if (rc != MODAL_OK && c->kept_right != NULL)         /* who recovers all the same has rest */
        memset(c->kept_right, 0, c->kept_size * sizeof *c->kept_right);
    return rc;
}

enum modal_status condense_solve_for_recovery(struct condense *c, struct modal_error *err)
{
    size_t q = (size_t)c->q, entries = (size_t)pattern_entries(c->pattern);
    double complex *S = calloc(entries + q + 1, sizeof *S);
    enum modal_status rc = S == NULL ? modal_fail(err, MODAL_NO_MEMORY, "condense: no memory")
                                     : need_room(c, c->H, err);

    for (int k = 0; rc == MODAL_OK && k <= c->H; k++)
        rc = condense_factor_at(c, k, k * c->omega, S, S + entries, err);
    c->solved = rc == MODAL_OK;
    free(S);
    return rc;
}

enum modal_status condense_recover(struct condense *c, int dof, int Hq, const double complex *Xq,
                                   int H, double complex *X, struct modal_error *err)
{
    bool sparse = c->sparse;
    size_t order = (size_t)(sparse ? c->seats : c->order);
    int row = sparse ? c->seat[dof] : c->spot[dof];
    enum modal_status rc;

    if (!c->solved && c->place[dof] < 0 && (rc = condense_solve_for_recovery(c, err)) != MODAL_OK)
        return rc;
    /* Past Hq the kept dofs rest and only loads move the others. */
    for (int k = 0; k <= H; k++) {
        const double complex *Y = sparse && k < c->known ? c->harmonic[k].row
            : c->kept_right != NULL ? c->kept_right + (size_t)k * order * ((size_t)c->q + 1) : NULL;

        X[k] = 0;                                       /* no linear dofs: nothing was kept */
        if (c->place[dof] >= 0)
            X[k] = k <= Hq ? Xq[c->place[dof] * (Hq + 1) + k] : 0;
        else if (Y != NULL && row >= 0) {
            /* L_rr^-1 P_r */
            X[k] = (sparse ? c->level : 1) * Y[(size_t)c->q * order + (size_t)row];
            for (int j = 0; j < c->q && k <= Hq; j++)
                /* - L_rr^-1 L_rq X_q */
                X[k] -= Y[(size_t)j * order + (size_t)row] * Xq[j * (Hq + 1) + k];
        }
    }
    return MODAL_OK;
}
