/*
 * torus_open.c - whether anything holds the mean of a motion of tones; tested by
 * tests/system/test_tones.py
 *
 * The motion x may be moved by a constant w where the structure does not resist, S_0 w = 0, and no
 * law does: each force is the same along x and along x + w, once what sliders remember of their
 * start is forgotten.  Then x is one of many, and which follows from history.
 */
#include <lapacke.h>
#include <complex.h>
#include <float.h>
#include <math.h>
#include <string.h>
#include "modal/linalg/svd.h"
#include "modal/linalg/workspace.h"
#include "modal/scene/law.h"
#include "modal/scene/program.h"
#include "modal/steady/condense.h"
#include "modal/steady/torus_laws.h"
#include "modal/steady/torus_state.h"

enum {
    STEPS = 64,                /* of a turn of the fastest tone, as torus_stability.c has */
    TURNS = 64,                /* that are compared, after as many that sliders forget in */
};
static const double LOOSE = 1e-9;         /* of the dynamic stiffness at the leading tone: between
                                           * rounding of a long chain and a soft spring */
static const double APART = 1e-6;         /* of the motion: so rarely another regime */
static const double HOLDS = 1e-6;         /* of that stiffness, in the mean square: a difference
                                           * quotient's rounding is 1e-10 */

struct walk {
    struct torus_solver *s;
    struct workspace space;
    double complex *wave, *turn;          /* e^{i Omega_k t}, and over a step */
    double eigen[3 * TORUS_WAYS_MOST];
    double gram[TORUS_WAYS_MOST * TORUS_WAYS_MOST];   /* of what laws answer to each */
};

/* s->way: the null space of S_0 in units of the leading tone's stiffness. */
enum modal_status torus_find_ways(struct torus_solver *s, struct modal_error *err)
{
    size_t q = (size_t)s->q;
    struct torus_index lead = { { 0 } };
    struct torus_linear mean = { 0 }, first = { 0 };
    struct workspace space = { 0 };
    double *A = workspace_numbers(&space, q, q), *VT = workspace_numbers(&space, q, q),
           *U = workspace_numbers(&space, q, q), *value = workspace_numbers(&space, q, 1);
    struct matrix a = { (int)q, (int)q, (int)q, A }, u = { (int)q, (int)q, (int)q, U },
                  v = { (int)q, (int)q, (int)q, VT };
    enum modal_status rc = workspace_check(&space, "torus: no memory", err);

    s->unit = calloc(q + 1, sizeof *s->unit);
    s->way = calloc(TORUS_WAYS_MOST * q + 1, sizeof *s->way);
    if (rc == MODAL_OK && (s->unit == NULL || s->way == NULL))
        rc = modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    lead.k[s->tones.lead] = 1;
    if (rc == MODAL_OK)
        rc = torus_linear_at(s, (struct torus_index) { { 0 } }, &mean, err);
    if (rc == MODAL_OK)
        rc = torus_linear_at(s, lead, &first, err);
    for (size_t i = 0; rc == MODAL_OK && i < q; i++)
        s->unit[i] = sqrt(fmax(cabs(first.S[i * q + i]) + cabs(mean.S[i * q + i]), DBL_MIN));
    for (size_t e = 0; rc == MODAL_OK && e < q * q; e++)
        A[e] = creal(mean.S[e]) / (s->unit[e % q] * s->unit[e / q]);
    torus_linear_done(&mean);
    torus_linear_done(&first);
    if (rc == MODAL_OK)
        rc = svd_thin(&a, value, &u, &v, err);
    while (rc == MODAL_OK && s->ways < TORUS_WAYS_MOST && (size_t)s->ways < q
           && value[q - 1 - (size_t)s->ways] < LOOSE) {
        for (size_t i = 0; i < q; i++)
            s->way[(size_t)s->ways * q + i] = VT[i * q + q - 1 - (size_t)s->ways] / s->unit[i];
        s->ways++;
    }
    workspace_free(&space);
    return rc;
}

/* What law L sees of way R, of input J; R < 0: of the motion, whose rate is *RATE. */
static double sees(const struct walk *w, const struct law *law, const int *place, int j, int r,
                   double *rate)
{
    const struct torus_solver *s = w->s;
    double d = 0;

    *rate = 0;
    for (int e = law->start[j]; e < law->start[j + 1]; e++) {
        size_t i = (size_t)place[law->end[e].dof];
        double weight = law->end[e].weight;

        if (r >= 0)
            d += weight * s->way[(size_t)r * (size_t)s->q + i];
        for (int k = 0; r < 0 && k < s->count; k++) {
            double complex X = s->X[i * (size_t)s->count + (size_t)k] * w->wave[k];

            d += weight * creal(X);
            *rate -= weight * torus_frequency(&s->tones, s->index[k]) * cimag(X);
        }
    }
    return d;
}

/* Where a law stands on the motion moved by a way, or by none. */
struct trace { double z[LAW_TERMS_MOST], f[LAW_INPUTS_MOST]; };

/* TO of LAW, on its way from where it was, now at D and V. */
static enum modal_status follow(const struct law *law, const double *d, const double *v,
                                struct trace *to, struct modal_error *err)
{
    double after[LAW_TERMS_MOST];
    struct law_force out = { .alone = true, .memory = after };
    struct law_point at = { .d = d, .v = v, .memory_before = to->z };
    enum modal_status rc = law->kind->force(law, &at, &out, err);

    memcpy(to->z, after, (size_t)law->memory * sizeof *after);
    memcpy(to->f, out.f, (size_t)law->kind->inputs * sizeof *to->f);
    return rc;
}

/* What LAW answers to each way, APART of the motion, where the traces stand: into the Gram
 * matrix. */
static void compare(struct walk *w, const struct law *law, const int *place, double apart,
                    const struct trace *trace)
{
    const struct torus_solver *s = w->s;

    for (int j = 0; j < law->kind->inputs; j++) {
        double unit = 0;

        for (int e = law->start[j]; e < law->start[j + 1]; e++)
            unit = fmax(unit, fabs(law->end[e].weight) / s->unit[place[law->end[e].dof]]);
        for (int a = 0; a < s->ways; a++)
            for (int b = 0; b < s->ways; b++)
                w->gram[a * TORUS_WAYS_MOST + b] += pow(unit / apart, 2) / (STEPS * TURNS)
                    * (trace[1 + a].f[j] - trace[0].f[j]) * (trace[1 + b].f[j] - trace[0].f[j]);
    }
}

/* LAW along the motion and along what each way makes of it. */
static enum modal_status walk_law(struct walk *w, const struct law *law, double apart,
                                  struct modal_error *err)
{
    const struct torus_solver *s = w->s;
    const int *place = condense_place(s->condense[0]);
    double h = 2 * M_PI / s->tones.omega[s->tones.lead] / STEPS;
    struct trace trace[1 + TORUS_WAYS_MOST] = { 0 };
    enum modal_status rc = MODAL_OK;

    for (int n = 0; rc == MODAL_OK && n < 2 * STEPS * TURNS; n++) {
        double d[LAW_INPUTS_MOST], v[LAW_INPUTS_MOST], none;

        for (int k = 0; k < s->count; k++)           /* afresh each turn: no rounding gathers */
            w->wave[k] = n % STEPS == 0 ? cexp(I * torus_frequency(&s->tones, s->index[k]) * n * h)
                                        : w->wave[k] * w->turn[k];
        for (int j = 0; j < law->kind->inputs; j++)
            d[j] = sees(w, law, place, j, -1, &v[j]);
        rc = follow(law, d, v, &trace[0], err);
        for (int r = 0; rc == MODAL_OK && r < s->ways; r++) {
            double moved[LAW_INPUTS_MOST];

            for (int j = 0; j < law->kind->inputs; j++)
                moved[j] = d[j] + apart * sees(w, law, place, j, r, &none);
            rc = follow(law, moved, v, &trace[1 + r], err);
        }
        if (n >= STEPS * TURNS)
            compare(w, law, place, apart, trace);
    }
    return rc;
}

/* All laws: s->open. */
static enum modal_status walk_all(struct walk *w, struct modal_error *err)
{
    struct torus_solver *s = w->s;
    size_t K = (size_t)s->count;
    double h = 2 * M_PI / s->tones.omega[s->tones.lead] / STEPS, most = 0, value[TORUS_WAYS_MOST];
    enum modal_status rc;

    w->wave = workspace_zeros(&w->space, 2 * K, sizeof *w->wave);
    w->turn = w->wave + K;
    rc = workspace_check(&w->space, "torus: no memory", err);
    for (size_t k = 0; rc == MODAL_OK && k < K; k++)
        w->turn[k] = cexp(I * torus_frequency(&s->tones, s->index[k]) * h);
    for (size_t e = 0; rc == MODAL_OK && e < (size_t)s->q * K; e++)
        most = fmax(most, cabs(s->X[e]) * s->unit[e / K]);
    for (int l = 0; rc == MODAL_OK && most > 0 && l < s->p->laws; l++)
        rc = walk_law(w, &s->p->law[l], APART * most, err);
    if (rc == MODAL_OK && most > 0
        && LAPACKE_dsyev_work(LAPACK_COL_MAJOR, 'N', 'L', s->ways, w->gram, TORUS_WAYS_MOST, value,
                              w->eigen, 3 * TORUS_WAYS_MOST) == 0)
        while (s->open < s->ways && value[s->open] < HOLDS * HOLDS)
            s->open++;
    return rc;
}

enum modal_status torus_open(struct torus_solver *s, struct modal_error *err)
{
    struct walk w = { .s = s };
    enum modal_status rc = MODAL_OK;

    s->open = 0;
    if (s->ways > 0)
        rc = walk_all(&w, err);
    workspace_free(&w.space);
    return rc;
}
