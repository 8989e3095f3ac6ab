/*
 * rk4_stepper.c - the classical Runge-Kutta steps of every class of program: what accuracy costs
 * without knowing the scene
 *
 *     k1 = F(t, y), k2 = F(t + h/2, y + h k1/2), k3 = F(t + h/2, y + h k2/2),
 *     k4 = F(t + h, y + h k3),
 *     y + h (k1 + 2 k2 + 2 k3 + k4) / 6,   error O(h^4),                                        (1)
 *
 * F = A(t) y + B P w(t) + U f: every effect is evaluated four times a step, none is exact, and
 * steps longer than 2.8 over the highest frequency grow without bound.  It is the peer that the
 * trade-off is measured against; laws with memory are asked from the step's start, rigid sliders
 * take the sign of their rate.
 */
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/ports.h"
#include "modal/scene/stepper.h"

static const double LOST = 1e300;      /* past it sums of squares overflow */
/* Entries of a matrix below which BLAS's calls take longer than its products. */
enum { ENTRIES_FEW = 256 };

struct rk4_stepper {
    struct stepper face;  /* first: a stepper is cast to its own */
    const struct statespace *ss;  /* borrowed */
    const struct sources *src;  /* borrowed */
    struct ports *ports;
    double step, *BP, *w, *k, *y, *probe, *memory, *after, *force;
    double asked;  /* w is of this time */
    struct workspace space;  /* of the arrays */
};

/* OUT += A x, of ROWS and COLUMNS. */
static void multiply_add(int rows, int columns, const double *A, const double *x, double *out)
{
    if (rows * columns > ENTRIES_FEW) {
        cblas_dgemv(CblasColMajor, CblasNoTrans, rows, columns, 1, A, rows, x, 1, 1, out, 1);
        return;
    }
    for (int j = 0; j < columns; j++, A += rows)
        for (int i = 0; i < rows; i++)
            out[i] += A[i] * x[j];
}

/* Loads at t added to OUT: half a step's are asked once. */
static void add_loads(struct rk4_stepper *s, double t, double *out)
{
    if (t != s->asked)
        sources_at(s->src, t, s->w);
    s->asked = t;
    multiply_add(s->ss->N, s->src->nw, s->BP, s->w, out);
}

/* U f of the laws at (t, y) added to OUT; AFTER (or NULL) gets their memory. */
static enum modal_status add_laws(struct rk4_stepper *s, double t, const double *y, double *after,
                                  double *out, struct modal_error *err)
{
    struct ports *p = s->ports;
    int r = 2 * p->probes, N = s->ss->N;
    enum modal_status rc;

    if (p->channels == 0)
        return MODAL_OK;
    memset(s->probe, 0, (size_t)r * sizeof *s->probe);
    multiply_add(r, N, p->R, y, s->probe);
    for (int l = 0; l < p->laws; l++)
        if (p->law[l].law->kind->set_valued)
            p->law[l].held = (s->probe[p->probes + p->law[l].channel] > 0)
                             - (s->probe[p->probes + p->law[l].channel] < 0);
    rc = ports_force(p, t, s->probe, s->memory, s->force, NULL, after, err);
    multiply_add(N, p->channels, p->U, s->force, out);
    return rc;
}

/* F of (1). */
static enum modal_status derivative(struct rk4_stepper *s, double t, const double *y, double *out,
                                    struct modal_error *err)
{
    int N = s->ss->N;

    memset(out, 0, (size_t)N * sizeof *out);
    multiply_add(N, N, s->ss->A, y, out);
    add_loads(s, t, out);
    return add_laws(s, t, y, NULL, out, err);
}

/* The four stages of one substep. */
static enum modal_status one_step(struct rk4_stepper *s, double t, double h, double *y,
                                  struct modal_error *err)
{
    /* of (1): where k_i is asked, and its weight / 6 */
    static const double reach[4] = { 0, 0.5, 0.5, 1 }, weight[4] = { 1, 2, 2, 1 };
    int N = s->ss->N;
    double *k = s->k, *sum = s->k + N;
    enum modal_status rc = MODAL_OK;

    memset(sum, 0, (size_t)N * sizeof *sum);
    for (int i = 0; i < 4 && rc == MODAL_OK; i++) {
        double end = t + reach[i] * h;
        for (int j = 0; j < N; j++)
            s->y[j] = y[j] + (i > 0 ? reach[i] * h * k[j] : 0);  /* y + h reach k_(i-1) */
        /* a corner at the end is the next step's */
        rc = derivative(s, i == 3 ? nextafter(end, t) : end, s->y, k, err);
        for (int j = 0; j < N; j++)
            sum[j] += weight[i] * k[j];  /* k1 + 2 k2 + 2 k3 + k4 */
    }
    for (int j = 0; j < N; j++)
        y[j] += h / 6 * sum[j];  /* (1) */
    if (rc == MODAL_OK && s->ports->memory > 0) {
        memset(k, 0, (size_t)N * sizeof *k);
        rc = add_laws(s, t + h, y, s->after, k, err);  /* memory moves once a step */
        memcpy(s->memory, s->after, (size_t)s->ports->memory * sizeof *s->memory);
    }
    return rc;
}

/* As many equal substeps as the options say. */
static enum modal_status advance(struct stepper *face, double t, double h, double *y,
                                 struct modal_error *err)
{
    struct rk4_stepper *s = (struct rk4_stepper *)face;
    /* whole substeps of h, rounding apart */
    int steps = (int)fmin(1e9, fmax(1, ceil(h / s->step - 1e-9)));
    enum modal_status rc = MODAL_OK;

    for (int k = 0; k < steps && rc == MODAL_OK; k++) {
        rc = one_step(s, t + k * (h / steps), h / steps, y, err);
        face->steps++;
        if (!(fabs(y[cblas_idamax(s->ss->N, y, 1)]) < LOST))
            return modal_fail(err, MODAL_OVERFLOW, "overflow");
    }
    return rc;
}

/* What the stages themselves use, asked once more at (t, y). */
static enum modal_status force(struct stepper *face, double t, const double *y, double *F,
                               struct modal_error *err)
{
    struct rk4_stepper *s = (struct rk4_stepper *)face;
    int N = s->ss->N;

    memset(F, 0, (size_t)N * sizeof *F);
    add_loads(s, t, F);
    return add_laws(s, t, y, NULL, F, err);
}

/* stepper.report */
static void report(struct stepper *face, struct program *p)
{
    ports_report(((struct rk4_stepper *)face)->ports, p);
}

/* stepper.free; also of one half made. */
static void rk4_free(struct stepper *face)
{
    struct rk4_stepper *s = (struct rk4_stepper *)face;

    workspace_free(&s->space);
    ports_free(s->ports);
    free(s);
}

enum modal_status rk4_stepper_new(const struct statespace *ss, const struct sources *src,
                                  const struct stepper_options *opt, struct stepper **out,
                                  struct modal_error *err)
{
    struct rk4_stepper *s = calloc(1, sizeof *s);
    enum modal_status rc = s != NULL ? ports_new(ss, &s->ports, err)
                                     : modal_fail(err, MODAL_NO_MEMORY, "stepping: out of memory");

    if (rc == MODAL_OK) {
        size_t N = (size_t)ss->N, r = 2 * (size_t)s->ports->probes, m = (size_t)s->ports->memory;
        struct {
            double **x;
            size_t count;
        } all[] = { { &s->w, (size_t)src->nw },
                    { &s->k, 2 * N },
                    { &s->y, N },
                    { &s->probe, r },
                    { &s->memory, m },
                    { &s->after, m },
                    { &s->force, (size_t)s->ports->channels } };
        s->face = (struct stepper){ .name = "rk4",
                                    .advance = advance,
                                    .force = force,
                                    .report = report,
                                    .free = rk4_free };
        s->ss = ss;
        s->src = src;
        s->asked = NAN;
        s->step = opt->dt / (opt->substeps > 0 ? opt->substeps : 1);
        s->BP = stepper_source_matrix(ss, src, &s->space);
        for (size_t i = 0; i < sizeof all / sizeof *all; i++)
            *all[i].x = workspace_zeros(&s->space, all[i].count, sizeof **all[i].x);
        rc = workspace_check(&s->space, "stepping: out of memory", err);
        s->face.memory = s->memory;
        s->face.memories = s->ports->memory;
    }
    if (rc == MODAL_OK)
        *out = &s->face;
    else if (s != NULL)
        rk4_free(&s->face);
    return rc;
}
