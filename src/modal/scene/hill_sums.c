/*
 * hill_sums.c - see hill_sums.h
 *
 * The shapes x_i of the constant part's exponents lambda_i are scaled so that x_i^T (2 lambda_i M +
 * C) x_i = 1.  What pulsates with k W, S_k(r) = r C^k + K^k at the rate r of who moves
 * (hill_window.c), couples motions alpha_i x_i next to s = lambda_i and beta_j conj(x_j) next to
 * s - i k W = conj(lambda_j), to first order by (1):
 *
 *     s alpha_i = lambda_i alpha_i - sum_j x_i^T S_k(conj lambda_j) conj(x_j) beta_j,
 *     s beta_j = (conj(lambda_j) + i k W) beta_j - sum_i conj(x_j)^T S_-k(lambda_i) x_i alpha_i;
 *
 * A motion that little holds beside what pulsates, as a rigid one, has lambda^2 moved and not
 * lambda: by s = |x^T S x| and its mass m it grows at sqrt(s / m) at most.  Its scale is held at
 *
 *     |x_i^T (2 lambda_i M + C) x_i|  >=  sqrt(m s),                                            (2)
 *
 * with which (1) says as much, where 0 in its place would move lambda without bound.
 *
 * All i of a stretch of the axis and all j next to what they lack to k W are taken at once, for
 * where motions are damped by more than they are apart many of them act together.
 */
#include "modal/scene/hill_sums.h"
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/dofwise.h"
#include "modal/scene/hill_window.h"

enum {
    STRETCH = 16,                /* exponents of (1) to a side at least, stretches half as far */
                                 /* apart, and */
    STRETCH_MOST = 64,           /* at most: where more overlap the first of them are taken */
};
static const double ACROSS = 2;  /* of both decays: motions farther from a sum do little */

/* The one text of it here. */
static enum modal_status no_memory(struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "sums of frequencies: out of memory");
}

/* Matrix PART of harmonic A: its cosine's, or its sine's. */
static const struct sparse *matrix_of(const struct program_harmonic *a, int part, bool sine)
{
    return sine ? &a->sine[part] : &a->cosine[part];
}

enum modal_status hill_sums_new(const struct program *p, double period, struct hill_sums *out,
                                struct modal_error *err)
{
    struct hill_sums s = { .p = p };

    s.place = workspace_zeros(&s.space, (size_t)p->n, sizeof *s.place);
    s.port = workspace_zeros(&s.space, (size_t)p->n, sizeof *s.port);
    s.weight = workspace_zeros(&s.space, 2 * (size_t)p->n, sizeof *s.weight);
    *out = s;
    if (s.space.failed)
        return no_memory(err);
    dofwise_weights(p, period, s.weight);
    for (int h = 0; h < 4 * p->harmonics; h++) {
        const struct sparse *A = matrix_of(&p->harmonic[h / 4], PROGRAM_C + h / 2 % 2, h % 2);
        for (int i = 0; i < A->m; i++)
            for (int e = A->start[i]; e < A->start[i + 1]; e++)
                s.place[i] = s.place[A->index[e]] = 1;
    }
    for (int i = 0; i < p->n; i++) {
        bool seen = s.place[i] > 0;
        s.place[i] = seen ? s.ports : -1;
        if (seen)
            s.port[s.ports++] = i;
    }
    out->ports = s.ports;
    return MODAL_OK;
}

/* x^T (2 lambda M + C) x */
static double complex norm_of(const struct program *p, double complex lambda,
                              const double complex *x)
{
    double complex sum = 0;

    for (int part = PROGRAM_M; part <= PROGRAM_C; part++) {
        const struct sparse *A = &p->constant[part];
        for (int i = 0; i < A->m; i++)
            for (int e = A->start[i]; e < A->start[i + 1]; e++)
                sum += (part == PROGRAM_M ? 2 * lambda : 1) * x[i] * A->value[e] * x[A->index[e]];
    }
    return sum;
}

/* sum |x_i| |A_ij| |x_j| */
static double size_of(const struct sparse *A, const double complex *x)
{
    double sum = 0;

    for (int i = 0; i < A->m; i++)
        for (int e = A->start[i]; e < A->start[i + 1]; e++)
            sum += cabs(x[i]) * fabs(A->value[e]) * cabs(x[A->index[e]]);
    return sum;
}

/* The norm's root, no less than (2) has it. */
static double complex scale_of(const struct program *p, double complex lambda,
                               const double complex *x)
{
    double complex norm = norm_of(p, lambda, x);
    double pulsates = 0, least;

    for (int h = 0; h < 4 * p->harmonics; h++) {
        int part = PROGRAM_C + h / 2 % 2;
        pulsates += (part == PROGRAM_C ? cabs(lambda) : 1)
                    * size_of(matrix_of(&p->harmonic[h / 4], part, h % 2), x);
    }
    least = sqrt(size_of(&p->constant[PROGRAM_M], x) * pulsates);
    return csqrt(cabs(norm) >= least ? norm : cabs(norm) > 0 ? norm * (least / cabs(norm)) : least);
}

/* Room for MORE exponents. */
static enum modal_status widen(struct hill_sums *s, int more, struct modal_error *err)
{
    int room = s->room;
    double complex *exponent, *shape;

    while (room < s->count + more)
        room = 2 * room + STRETCH;
    if (room == s->room)
        return MODAL_OK;
    if ((double)room * s->ports > HILL_SUMS_NUMBERS)
        return modal_fail(err, MODAL_TOO_LARGE, "shapes of %d motions at %d dofs take more than %d "
                          "numbers", room, s->ports, HILL_SUMS_NUMBERS);
    exponent = realloc(s->exponent, (size_t)room * sizeof *exponent);
    s->exponent = exponent != NULL ? exponent : s->exponent;
    shape = realloc(s->shape, ((size_t)room * (size_t)s->ports + 1) * sizeof *shape);
    s->shape = shape != NULL ? shape : s->shape;
    if (exponent == NULL || shape == NULL)
        return no_memory(err);
    s->room = room;
    return MODAL_OK;
}

/* Exponent LAMBDA whose start is START, at its place; X: n numbers. */
static void insert(struct hill_sums *s, double complex lambda, const double complex *start,
                   double complex *x)
{
    size_t ports = (size_t)s->ports, at = (size_t)s->count++;
    double complex root;

    for (int i = 0; i < s->p->n; i++)
        x[i] = start[i] / s->weight[i];
    root = scale_of(s->p, lambda, x);
    for (; at > 0 && cimag(s->exponent[at - 1]) > cimag(lambda); at--) {
        s->exponent[at] = s->exponent[at - 1];
        memcpy(s->shape + at * ports, s->shape + (at - 1) * ports, ports * sizeof *s->shape);
    }
    s->exponent[at] = lambda;
    for (size_t i = 0; i < ports; i++)
        s->shape[i + at * ports] = x[s->port[i]] / root;
}

enum modal_status hill_sums_add(struct hill_sums *s, const struct hill_window *constant,
                                double from, double to, struct modal_error *err)
{
    size_t n = (size_t)s->p->n;
    double complex *x = calloc(n + 1, sizeof *x);
    enum modal_status rc = x != NULL ? widen(s, constant->count, err) : no_memory(err);

    for (int i = 0; rc == MODAL_OK && i < constant->count; i++)
        if (cimag(constant->exponent[i]) > from && cimag(constant->exponent[i]) <= to)
            insert(s, constant->exponent[i], constant->start + 2 * n * (size_t)i, x);
    free(x);
    return rc;
}

/* x^T S_k(RATE) conj(y) of (1) at the ports; BACK: conj(x)^T S_-k(RATE) y. */
static double complex coupled(const struct hill_sums *s, const struct program_harmonic *a,
                              bool back, double complex rate, const double complex *x,
                              const double complex *y)
{
    double complex sum = 0;

    for (int h = 0; h < 4; h++) {
        int part = h < 2 ? PROGRAM_C : PROGRAM_K;
        const struct sparse *A = matrix_of(a, part, h % 2);
        double complex factor = (part == PROGRAM_C ? rate : 1) / 2
                                * (h % 2 == 0 ? 1 : back ? I : -I);
        for (int i = 0; A->m > 0 && i < s->ports; i++)
            for (int e = A->start[s->port[i]]; e < A->start[s->port[i] + 1]; e++) {
                double complex to = x[i], from = y[s->place[A->index[e]]];
                sum += factor * A->value[e] * (back ? conj(to) * from : to * conj(from));
            }
    }
    return sum;
}

/* The first exponent of Im >= PLACE. */
static int first_from(const struct hill_sums *s, double place)
{
    int low = 0, high = s->count;

    while (low < high) {
        int middle = (low + high) / 2;
        if (cimag(s->exponent[middle]) < place)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

struct stretch {                 /* of (1): i from I on, j from J on */
    const struct program_harmonic *a;
    int i, j, is, js;
    double least_damped;         /* the largest real part of all of them */
};

/* The stretch of harmonic A from exponent FIRST on.  False: nothing makes up its sums. */
static bool stretch_of(const struct hill_sums *s, const struct program_harmonic *a, int first,
                       struct stretch *out)
{
    int last = first + STRETCH < s->count ? first + STRETCH : s->count;
    double sum = a->k * s->p->omega, decay = 0, other = 0, from, to;

    for (int pass = 0; pass < 2; pass++) {       /* as wide as what decays there */
        decay = other = 0;
        for (int i = first; i < last; i++)
            decay = fmax(decay, -creal(s->exponent[i]));
        from = sum - cimag(s->exponent[last - 1]);
        to = sum - cimag(s->exponent[first]);
        for (int j = first_from(s, from); j < s->count && cimag(s->exponent[j]) <= to; j++)
            other = fmax(other, -creal(s->exponent[j]));
        while (last < s->count && last - first < STRETCH_MOST
               && cimag(s->exponent[last] - s->exponent[first]) < 2 * ACROSS * (decay + other))
            last++;
    }
    from = sum - cimag(s->exponent[last - 1]) - ACROSS * (decay + other);
    to = sum - cimag(s->exponent[first]) + ACROSS * (decay + other);
    *out = (struct stretch){ a, first, first_from(s, from), last - first, 0, -HUGE_VAL };
    while (out->j + out->js < s->count && out->js < 2 * STRETCH_MOST
           && cimag(s->exponent[out->j + out->js]) <= to)
        out->js++;
    for (int i = 0; i < out->is + out->js; i++)
        out->least_damped = fmax(out->least_damped, creal(s->exponent[i < out->is ? out->i + i
                                                               : out->j + i - out->is]));
    return out->js > 0;
}

/* (1) of T into A, order by order. */
static void fill(const struct hill_sums *s, const struct stretch *t, double complex *A)
{
    size_t ports = (size_t)s->ports, order = (size_t)(t->is + t->js);

    memset(A, 0, order * order * sizeof *A);
    for (size_t i = 0; i < order; i++) {
        size_t at = (int)i < t->is ? (size_t)t->i + i : (size_t)t->j + i - (size_t)t->is;
        A[i + i * order] = (int)i < t->is ? s->exponent[at]
                                          : conj(s->exponent[at]) + I * (t->a->k * s->p->omega);
    }
    for (size_t i = 0; i < (size_t)t->is; i++)
        for (size_t j = 0; j < (size_t)t->js; j++) {
            size_t at = (size_t)t->i + i, of = (size_t)t->j + j, row = (size_t)t->is + j;
            const double complex *x = s->shape + at * ports, *y = s->shape + of * ports;
            A[i + row * order] = -coupled(s, t->a, false, conj(s->exponent[of]), x, y);
            A[row + i * order] = -coupled(s, t->a, true, s->exponent[at], y, x);
        }
}

/* Descending in real part. */
static int compare(const void *a, const void *b)
{
    double x = creal(((const struct hill_sum *)a)->exponent),
           y = creal(((const struct hill_sum *)b)->exponent);

    return (x < y) - (x > y);
}

/* What of T may reach LEAST, among OUT. */
static enum modal_status find_in(const struct hill_sums *s, const struct stretch *t, double least,
                                 double margin, struct hill_sum **out, int *count, int *room,
                                 struct modal_error *err)
{
    int order = t->is + t->js;
    size_t size = (size_t)order;
    struct workspace space = { 0 };
    double complex *A = workspace_zeros(&space, size * size, sizeof *A),
                   *w = workspace_zeros(&space, size, sizeof *w);
    enum modal_status rc = space.failed ? no_memory(err) : MODAL_OK;

    if (rc == MODAL_OK) {
        fill(s, t, A);
        if (LAPACKE_zgeev(LAPACK_COL_MAJOR, 'N', 'N', order, A, order, w, NULL, 1, NULL, 1) != 0)
            rc = modal_fail(err, MODAL_NO_CONVERGENCE, "sums of frequencies: no eigenvalues");
    }
    for (int i = 0; rc == MODAL_OK && i < order; i++) {
        double raised = creal(w[i]) - t->least_damped;
        if (!(creal(w[i]) + margin * fmax(raised, 0) >= least))
            continue;
        if (*count == *room) {
            struct hill_sum *more = realloc(*out, (2 * (size_t)*room + STRETCH) * sizeof *more);
            if (more == NULL) {
                rc = no_memory(err);
                break;
            }
            *out = more;
            *room = 2 * *room + STRETCH;
        }
        (*out)[(*count)++] = (struct hill_sum){ w[i], raised };
    }
    workspace_free(&space);
    return rc;
}

enum modal_status hill_sums_find(const struct hill_sums *s, double least, double margin,
                                 struct hill_sum **out, int *count, struct modal_error *err)
{
    int room = 0;
    enum modal_status rc = MODAL_OK;

    *out = NULL;
    *count = 0;
    for (int h = 0; h < s->p->harmonics; h++) {
        const struct program_harmonic *a = &s->p->harmonic[h];
        /* of each pair the lower one: the other shows where it is */
        int last = first_from(s, a->k * s->p->omega / 2);
        struct stretch t;
        for (int i = 0; rc == MODAL_OK && i < last; i += STRETCH / 2)
            if (stretch_of(s, a, i, &t))
                rc = find_in(s, &t, least, margin, out, count, &room, err);
    }
    if (rc == MODAL_OK && *count > 0)
        qsort(*out, (size_t)*count, sizeof **out, compare);
    if (rc != MODAL_OK) {
        free(*out);
        *out = NULL;
    }
    return rc;
}

void hill_sums_done(struct hill_sums *s)
{
    free(s->exponent);
    free(s->shape);
    workspace_free(&s->space);
    memset(s, 0, sizeof *s);
}
