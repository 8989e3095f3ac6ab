/*
 * aft.c - local nonlinear forces, from harmonics to harmonics through time
 *
 * A relative displacement is d(theta) = Re sum_{k=0..H} D_k e^{i k theta}.  Laws that say where
 * their regime changes are exact for it (aft_events.h).
 *
 * Other laws are sampled as in [CG89] (their section 3.1): f at theta_j = 2 pi j / N and back by a
 * discrete transform; a polynomial of degree p is exact once N > (p + 1) H.  A law with memory is
 * marched until its memory repeats: twice around for sliders (their map over a period is one clip),
 * up to SWEEPS_MOST times for others, once where a user's law has kept nothing.  The slopes of a
 * user's law are differences: they are made of the last period, and where they are asked for.
 *
 * [CG89] Cameron and Griffin, J. Appl. Mech. 56 (1989) 149-154.
 */
#include "modal/steady/aft.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/program.h"
#include "modal/steady/aft_events.h"

enum { SWEEPS_MOST = 12 };   /* periods that a memory is given to repeat */
/* Of the largest force, a change from one period to the next: the memory has settled. */
static const double SWEEP_TOLERANCE = 1e-12;

/* Frees what A holds. */
static void law_free(struct aft_law *a)
{
    law_done(&a->soft);
    for (int j = 0; j < LAW_INPUTS_MOST; j++)
        orbit_done(&a->in[j]);
    pieces_done(&a->pieces);
    free(a->ends);
}

void aft_free(struct aft *w)
{
    if (w == NULL)
        return;
    for (int i = 0; w->law != NULL && i < w->laws; i++)
        law_free(&w->law[i]);
    free(w->block);
    workspace_free(&w->space);
    orbit_grid_free(w->grid);
    free(w);
}

/* Room for one law: samples where it is sampled, waves where it has pieces. */
static enum modal_status law_init(struct aft *w, struct aft_law *a, const struct law *law,
                                  const int *place, struct modal_error *err)
{
    int inputs = law->kind->inputs;
    size_t N = (size_t)w->N, n = (size_t)inputs, H = (size_t)w->H;
    enum modal_status rc = MODAL_OK;

    a->law = a->given = law;
    a->exact = w->located && law->kind->pieces != NULL;
    a->memory = law->memory;
    for (int j = 0; rc == MODAL_OK && j < inputs; j++)
        rc = orbit_init(&a->in[j], w->H, w->N, err);
    if (rc != MODAL_OK)
        return rc;
    a->place = workspace_zeros(&w->space, (size_t)law_ends(law), sizeof *a->place);
    for (int e = 0; a->place != NULL && e < law_ends(law); e++)
        a->place[e] = place[law->end[e].dof];
    a->F = workspace_zeros(&w->space, n * (H + 1), sizeof *a->F);
    a->gain = workspace_zeros(&w->space, n * n * (2 * H + 1), sizeof *a->gain);
    a->damp = workspace_zeros(&w->space, n * n * (2 * H + 1), sizeof *a->damp);
    a->level = workspace_zeros(&w->space, n * (2 * H + 1), sizeof *a->level);
    a->cross = workspace_zeros(&w->space, 3 * H, sizeof *a->cross);
    a->z = workspace_zeros(&w->space, 2 * (size_t)a->memory, sizeof *a->z);
    if (!a->exact) {
        a->f = workspace_zeros(&w->space, n * N, sizeof *a->f);
        a->fd = workspace_zeros(&w->space, n * n * N, sizeof *a->fd);
        a->fv = workspace_zeros(&w->space, n * n * N, sizeof *a->fv);
    }
    if (w->space.failed)
        return modal_fail(err, MODAL_NO_MEMORY,
                          "aft: no memory for a law at %d harmonics, %d samples", w->H, w->N);
    return MODAL_OK;
}

enum modal_status aft_new(const struct program *p, const int *place, int q, int H, int N,
                          bool located, struct aft **out, struct modal_error *err)
{
    struct aft *w = calloc(1, sizeof *w);
    enum modal_status rc = MODAL_OK;

    if (w == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "aft: no memory");
    *w = (struct aft) { .q = q, .H = H, .HJ = H, .N = N, .located = located, .laws = p->laws };
    w->room = 8 * H + 8 > N ? 8 * H + 8 : N;
    w->law = workspace_zeros(&w->space, (size_t)p->laws, sizeof *w->law);
    w->mask = workspace_zeros(&w->space, (size_t)w->room, sizeof *w->mask);
    w->wave = workspace_zeros(&w->space, (size_t)w->room, sizeof *w->wave);
    w->product = workspace_zeros(&w->space, (size_t)w->room, sizeof *w->product);
    w->before = workspace_zeros(&w->space, (size_t)w->room, sizeof *w->before);
    w->after = workspace_zeros(&w->space, (size_t)w->room, sizeof *w->after);
    w->samples = workspace_zeros(&w->space, (size_t)N, sizeof *w->samples);
    w->inverse = workspace_zeros(&w->space, (size_t)w->room, sizeof *w->inverse);
    if (w->space.failed)
        rc = modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for %d harmonics", H);
    for (int m = 1; rc == MODAL_OK && m < w->room; m++)
        w->inverse[m] = 1 / (TWO_PI * m);
    for (int i = 0; rc == MODAL_OK && i < p->laws; i++)
        rc = law_init(w, &w->law[i], &p->law[i], place, err);
    if (rc == MODAL_OK && aft_analyzes(w))
        rc = orbit_grid_new(N, &w->grid, err);
    else if (rc == MODAL_OK)
        rc = orbit_grid_to_time(N, &w->grid, err);
    if (rc != MODAL_OK) {
        aft_free(w);
        return rc;
    }
    *out = w;
    return MODAL_OK;
}

/* One sweep over the samples, of the force ALONE or with its slopes; memory in and out at a->z. */
static enum modal_status sweep(struct aft *w, struct aft_law *a, bool alone,
                               struct modal_error *err)
{
    int inputs = a->law->kind->inputs, N = w->N;
    double d[LAW_INPUTS_MOST], v[LAW_INPUTS_MOST];
    enum modal_status rc = MODAL_OK;

    struct law_force out = { .alone = alone, .memory = a->z + a->memory };

    a->acts = false;
    for (int n = 0; rc == MODAL_OK && n < N; n++) {
        struct law_point at = { .t = TWO_PI / w->omega * n / N,
                                .d = d,
                                .v = v,
                                .memory_before = a->z };

        for (int j = 0; j < inputs; j++) {
            d[j] = a->in[j].d[n];
            v[j] = w->omega * a->in[j].v[n];            /* d/dt = omega d/dtheta */
        }
        rc = a->law->kind->force(a->law, &at, &out, err);
        for (int i = 0; rc == MODAL_OK && i < inputs; i++) {
            a->f[i * N + n] = out.f[i];
            for (int j = 0; !alone && j < inputs; j++) {
                a->fd[(i * inputs + j) * N + n] = out.fd[i][j];
                a->fv[(i * inputs + j) * N + n] = out.fv[i][j];
            }
        }
        /* what the law remembers after this sample */
        memcpy(a->z, a->z + a->memory, (size_t)a->memory * sizeof *a->z);
        a->acts |= out.acts;
    }
    a->evaluations += N;                                /* one a sample */
    a->sloped = !alone;
    /* a motion too large, as where the laws built in overflow: one that was tried, no fault */
    return rc == MODAL_ELEMENT_FAILED && out.beyond ? MODAL_OVERFLOW : rc;
}

/* Whether the last sweep left something that the next begins with. */
static bool remembers(const struct aft_law *a)
{
    const struct law_class *kind = a->law->kind;

    return a->memory > 0
           || (kind->restart != NULL && (kind->remembers == NULL || kind->remembers(a->law)));
}

/* Before the first sweep: nothing is remembered. */
static void forget(struct aft_law *a)
{
    memset(a->z, 0, (size_t)a->memory * sizeof *a->z);
    if (a->law->kind->restart != NULL)                  /* a user's law keeps its own memory */
        a->law->kind->restart(a->law);
}

enum modal_status aft_make_slopes(struct aft *w, struct aft_law *a, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (a->exact || a->sloped)
        return MODAL_OK;
    forget(a);  /* others have asked the law since, and it remembers those */
    for (int round = 1; rc == MODAL_OK && round <= a->rounds; round++)
        rc = sweep(w, a, round < a->rounds, err);
    return rc;
}

/* Sweep until the force at the end of a period repeats (laws without memory: once). */
static enum modal_status sample_law(struct aft *w, struct aft_law *a, struct modal_error *err)
{
    bool alone = a->law->kind->restart != NULL;
    double scale = 0, *last = NULL, change;
    enum modal_status rc;

    forget(a);
    rc = sweep(w, a, alone, err);
    a->rounds = 1;
    /* A memory repeats once the motion has gone through all it forgets; the first period begins
     * from none. */
    while (rc == MODAL_OK && remembers(a) && a->rounds < SWEEPS_MOST) {
        if (last == NULL && (last = malloc((size_t)w->N * sizeof *last)) == NULL) {
            rc = modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for a sweep");
            break;
        }
        memcpy(last, a->f, (size_t)w->N * sizeof *last);
        rc = sweep(w, a, alone, err);
        a->rounds++;
        change = scale = 0;
        for (int n = 0; n < w->N; n++) {
            /* of the first output: all share one memory */
            change = fmax(change, fabs(a->f[n] - last[n]));
            scale = fmax(scale, fabs(a->f[n]));
        }
        if (change <= SWEEP_TOLERANCE * scale)
            break;
    }
    free(last);
    return rc;
}

/* No NaN and no infinity. */
static bool finite_motion(const double complex *X, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!isfinite(creal(X[i])) || !isfinite(cimag(X[i])))
            return false;
    return true;
}

/* The displacements of a law's inputs, along their directions, with their samples. */
static void set_motion(struct aft *w, struct aft_law *a, const double complex *X)
{
    int K = w->H + 1;

    for (int j = 0; j < a->law->kind->inputs; j++) {
        double complex *D = a->in[j].D;

        memset(D, 0, (size_t)K * sizeof *D);
        for (int e = a->law->start[j]; e < a->law->start[j + 1]; e++)
            for (int k = 0; k < K; k++)
                D[k] += a->law->end[e].weight * X[a->place[e] * K + k];
        orbit_sample(&a->in[j], w->grid, w->omega);
    }
}

/* Harmonics of a law's forces into a->F: of its pieces, exact, or of its samples. */
static enum modal_status law_forces(struct aft *w, struct aft_law *a, struct modal_error *err)
{
    enum modal_status rc = a->exact ? aft_find_pieces(w, a, err) : sample_law(w, a, err);
    size_t N = (size_t)w->N, K = (size_t)w->H + 1;

    if (rc != MODAL_OK)
        return rc;
    if (a->exact)
        aft_waves(w, a);
    for (size_t i = 0; i < (size_t)a->law->kind->inputs; i++)
        if (a->exact)
            aft_waves_force(w, a, (int)i, a->F + i * K, w->product + 3 * w->H + 2);
        else
            orbit_analyze(w->grid, a->f + i * N, w->H, a->F + i * K);
    return MODAL_OK;
}

/* A law's forces onto its dofs. */
static void scatter_force(const struct aft_law *a, const double complex *f, int K,
                          double complex *F)
{
    for (int i = 0; i < a->law->kind->inputs; i++)
        for (int e = a->law->start[i]; e < a->law->start[i + 1]; e++)
            for (int k = 0; k < K; k++)
                F[a->place[e] * K + k] += a->law->end[e].weight * f[i * K + k];
}

enum modal_status aft_force(struct aft *w, double omega, const double complex *X, double complex *F,
                            struct modal_error *err)
{
    size_t count = (size_t)w->q * ((size_t)w->H + 1);
    enum modal_status rc = MODAL_OK;

    if (!finite_motion(X, count))
        return modal_fail(err, MODAL_OVERFLOW, "aft: the motion is not finite");
    w->omega = omega;                                /* for rates, of which samples have d/dtheta */
    for (int i = 0; rc == MODAL_OK && i < w->laws; i++) {
        set_motion(w, &w->law[i], X);
        /* into its own F: a failure leaves the caller's alone */
        rc = law_forces(w, &w->law[i], err);
    }
    if (rc != MODAL_OK)
        return rc;
    memset(F, 0, count * sizeof *F);
    for (int i = 0; i < w->laws; i++)
        scatter_force(&w->law[i], w->law[i].F, w->H + 1, F);
    return finite_motion(F, count) ? MODAL_OK
                                   : modal_fail(err, MODAL_OVERFLOW, "aft: a force is not finite");
}

double aft_stiffest(const struct aft *w)
{
    double most = 0;

    for (int l = 0; l < w->laws; l++) {
        const struct law *law = w->law[l].given;

        most = fmax(most, law->kind->stiffest != NULL ? law->kind->stiffest(law) : 0);
    }
    return most;
}

/* Of law A, with ends of its own. */
static enum modal_status soften_law(struct aft_law *a, double most, struct modal_error *err)
{
    const struct law *law = a->given;
    enum modal_status rc;

    law_done(&a->soft);
    a->law = law;
    if (law->kind->soften == NULL || law->kind->stiffest(law) <= most)
        return MODAL_OK;
    rc = law->kind->soften(law, most, &a->soft, err);
    for (int i = 0; rc == MODAL_OK && i < law->kind->inputs; i++)
        if (!law_add_ends(&a->soft, i, law->end + law->start[i],
                          law->start[i + 1] - law->start[i]))
            rc = modal_fail(err, MODAL_NO_MEMORY, "aft: no memory for a law");
    if (rc == MODAL_OK)
        a->law = &a->soft;
    return rc;
}

enum modal_status aft_soften(struct aft *w, double most, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int l = 0; rc == MODAL_OK && l < w->laws; l++)
        rc = soften_law(&w->law[l], most, err);
    return rc;
}

void aft_set_order(struct aft *w, int HJ) { w->HJ = HJ; }
int aft_samples(const struct aft *w) { return w->N; }
long aft_transforms(const struct aft *w) { return orbit_grid_transforms(w->grid); }
double aft_summed(const struct aft *w) { return w->summed; }

long aft_events(const struct aft *w)
{
    long count = 0;

    for (int l = 0; l < w->laws; l++) {
        count += w->law[l].exact ? w->law[l].pieces.count : 0;
        for (int j = 0; w->law[l].exact && j < w->law[l].law->kind->inputs; j++)
            count += w->law[l].in[j].turns > 0 ? w->law[l].in[j].turns : 0;
    }
    return count;
}

long aft_evaluations(const struct aft *w, int law) { return w->law[law].evaluations; }
bool aft_acts(const struct aft *w, int law) { return w->law[law].acts; }
bool aft_undetermined(const struct aft *w, int law) { return w->law[law].undetermined; }
