/*
 * periodic_stepper.c - steps of a linear periodic program by Magnus maps, repeated
 *
 * If r periods hold q sample steps (r <= 64), the map of step j serves steps j + q, j + 2 q, ...:
 * after r periods a step is one product.  Sources ride along as extra states (S and P do not depend
 * on time), so maps are the same under any load.  Steps that fit no slot (to and from corners,
 * incommensurate dt) are mapped as they come.
 */
#include <cblas.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/magnus.h"
#include "modal/scene/stepper.h"

enum {
    /* r: a dt of so odd a share of the period is mapped as it comes */
    PERIODS_MOST = 64,
    KEPT_DOUBLES_MOST = 30000000,     /* 240 MB of maps: a quarter of what a worker may have */
};
static const double DIVIDES = 1e-10;  /* relative: r T over dt is whole, both of some ten digits */
/* of a step: t is a sum of steps, and off by their rounding */
static const double ON_GRID = 1e-9;

struct periodic_stepper {
    struct stepper face;  /* first: a stepper is cast to its own */
    const struct statespace *ss;  /* borrowed */
    const struct sources *src;  /* borrowed */
    struct magnus *magnus;
    double tolerance, dt;
    int slots, substeps;  /* q; of the last map */
    double **kept;                    /* N x (N + nw) each */
    double origin;                    /* the first full step's time; < 0: none yet */
    double *BP, *w, *next, *map;  /* B P; sources now; y next; with their rows */
    struct workspace space;           /* of these four */
};

/* The period of A(t): 2 pi / Omega over the greatest common divisor of its harmonics. */
static double period_of(const struct statespace *ss)
{
    int divisor = ss->harmonic[0].k;

    for (int h = 1; h < ss->harmonics; h++)
        for (int a = divisor, b = ss->harmonic[h].k; (divisor = a) != 0 && b != 0;) {
            int rest = a % b;
            a = b;
            b = rest;
            divisor = a;
        }
    return 2 * M_PI / (divisor * ss->p->omega);
}

/* Maps repeat after r periods if dt divides them: kept where they fit, one a slot. */
static void choose_slots(struct periodic_stepper *s)
{
    double T = period_of(s->ss);

    for (int r = 1; r <= PERIODS_MOST && s->dt > 0; r++) {
        double q = r * T / s->dt;  /* steps in r periods */
        if (q < 0.5 || fabs(q - round(q)) > DIVIDES * q)
            continue;
        if (round(q) * s->ss->N * s->magnus->size > KEPT_DOUBLES_MOST)
            return;
        s->kept = calloc((size_t)round(q), sizeof *s->kept);
        s->slots = s->kept != NULL ? (int)round(q) : 0;
        return;
    }
}

/* The slot of the full step at t; -1: none. */
static int slot_of(struct periodic_stepper *s, double t, double h)
{
    if (s->slots == 0 || h != s->dt)
        return -1;
    if (s->origin < 0)
        s->origin = t;  /* slots count from the first full step */
    double phase = (t - s->origin) / s->dt, whole = round(phase);
    if (fabs(phase - whole) > ON_GRID * fmax(1, fabs(phase)) || whole < 0)
        return -1;
    return (int)fmod(whole, s->slots);
}

/* Rows 0..N-1 of the converged map over [t, t + h] into OUT. */
static enum modal_status compute(struct periodic_stepper *s, double t, double h, double *out,
                                 struct modal_error *err)
{
    size_t N = (size_t)s->ss->N, size = (size_t)s->magnus->size;
    double error;
    enum modal_status rc;

    /* begin low: maps of the next place may need fewer */
    s->substeps = s->substeps / 4 > 0 ? s->substeps / 4 : 1;
    rc = magnus_converge(s->magnus, t, h, s->tolerance, &s->substeps, s->map, &error, err);
    for (size_t j = 0; rc == MODAL_OK && j < size; j++)
        /* the sources' own rows are known in closed form */
        memcpy(out + j * N, s->map + j * size, N * sizeof *out);
    s->face.maps++;
    return rc;
}

/* One product by the slot's map, or by a map of this step alone. */
static enum modal_status advance(struct stepper *face, double t, double h, double *y,
                                 struct modal_error *err)
{
    struct periodic_stepper *s = (struct periodic_stepper *)face;
    int N = s->ss->N, slot = slot_of(s, t, h);
    size_t count = (size_t)N * (size_t)s->magnus->size;
    double *map = slot >= 0 ? s->kept[slot] : NULL, *fresh = NULL;
    enum modal_status rc = MODAL_OK;

    if (map == NULL) {
        if ((fresh = malloc(count * sizeof *fresh)) == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "stepping: out of memory");
        rc = compute(s, t, h, fresh, err);
        map = fresh;
        if (rc == MODAL_OK && slot >= 0) {
            s->kept[slot] = fresh;
            fresh = NULL;
        }
    }
    if (rc == MODAL_OK) {
        cblas_dgemv(CblasColMajor, CblasNoTrans, N, N, 1, map, N, y, 1, 0, s->next, 1);
        /* the map's last columns are G of linear_stepper.c (1) */
        stepper_add_loads(s->src, map + (size_t)N * (size_t)N, N, t, s->w, s->next);
        memcpy(y, s->next, (size_t)N * sizeof *y);
        face->products++;
    }
    free(fresh);
    return rc;
}

/* A linear program's loads alone. */
static enum modal_status force(struct stepper *face, double t, const double *y, double *F,
                               struct modal_error *err)
{
    struct periodic_stepper *s = (struct periodic_stepper *)face;

    (void)y;
    (void)err;
    memset(F, 0, (size_t)s->ss->N * sizeof *F);
    stepper_add_loads(s->src, s->BP, s->ss->N, t, s->w, F);
    return MODAL_OK;
}

/* stepper.free; also of one half made. */
static void periodic_free(struct stepper *face)
{
    struct periodic_stepper *s = (struct periodic_stepper *)face;

    for (int i = 0; i < s->slots; i++)
        free(s->kept[i]);
    free(s->kept);
    magnus_free(s->magnus);
    workspace_free(&s->space);
    free(s);
}

enum modal_status periodic_stepper_new(const struct statespace *ss, const struct sources *src,
                                       const struct stepper_options *opt, struct stepper **out,
                                       struct modal_error *err)
{
    struct periodic_stepper *s = calloc(1, sizeof *s);
    enum modal_status rc;

    if (s == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "stepping: out of memory");
    s->face = (struct stepper){ .name = "magnus-maps",
                                .advance = advance,
                                .force = force,
                                .free = periodic_free };
    s->ss = ss;
    s->src = src;
    s->dt = opt->dt;
    s->tolerance = opt->tolerance > 0 ? opt->tolerance : 1e-13;
    s->origin = -1;
    s->BP = stepper_source_matrix(ss, src, &s->space);
    s->w = workspace_zeros(&s->space, (size_t)src->nw, sizeof *s->w);
    s->next = workspace_zeros(&s->space, (size_t)ss->N, sizeof *s->next);
    rc = magnus_new(ss, src, &s->magnus, err);
    if (rc == MODAL_OK) {
        size_t size = (size_t)s->magnus->size;

        s->map = workspace_zeros(&s->space, size * size, sizeof *s->map);
        rc = workspace_check(&s->space, "stepping: out of memory", err);
    }
    if (rc == MODAL_OK) {
        choose_slots(s);
        *out = &s->face;
    } else {
        periodic_free(&s->face);
    }
    return rc;
}
