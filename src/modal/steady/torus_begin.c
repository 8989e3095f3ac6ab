/*
 * torus_begin.c - where a motion with a tone of its own is looked for; tested by
 * tests/unit/modal/steady/test_torus.c
 *
 * Alone, without a forced tone, the motion grows from a mode of the motion at rest, that is from
 * where a Hopf point left it: at each amplitude |a| there is a gain g, of a damper of this tone
 * alone (torus_state.h), with which it lasts [K15].  At no amplitude g is what the mode's own
 * damping lacks; the amplitude is raised until g is 0, where the motion lasts by itself.
 *
 * Beside forced tones the program's own motion is marched until it has settled, and the frequency
 * that the forced tones leave unexplained is looked for in its spectrum.
 *
 * [K15] Krack, Computers and Structures 154 (2015) 59-71: the extended periodic motion concept.
 */
#include "modal/steady/torus_state.h"
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "modal/numbers.h"
#include "modal/scene/scene.h"
#include "modal/steady/condense.h"
#include "modal/steady/torus_laws.h"

enum {
    STATES_MOST = 400,         /* of the dense eigenproblem: a second of it */
    MODES_MOST = 6,            /* that are followed from rest */
    FIRST_ORDER = 3,           /* combinations that a search begins with, beside forced tones */
    ALONE_ORDER = 15,          /* harmonics alone, as many as are dense: relaxation has many */
    FALLS_MOST = 15,           /* of the amplitude, tenfold, until its mode is linear: to 1e-18 m */
    RISES_MOST = 200,          /* of it by RISE: from there to more than any machine's */
    SECANTS_MOST = 40,         /* bisections alone would end by then */
    TURNS = 200,               /* of a record: its lines are told to a thousandth of that tone */
    WAIT = 100,                /* turns of a march before its record, the first time */
    WAITS_MOST = 3,            /* twice as long each: what settles slower is not seen */
    FORCED_ORDER = 8,          /* combinations of forced tones that are taken out of a record */
    SAMPLES = 2 * FORCED_ORDER + 1,       /* of a turn of the fastest: of one forced tone all that
                                           * repeats with it is then taken out */
    LOCKED_TURNS_MOST = 8,     /* of a forced tone that a motion locked to it repeats after: the
                                * tongues of more are as narrow as some power of the load */
    NARROWINGS = 40,           /* of a frequency's bracket: to 1e-8 of it */
};
static const double AMPLITUDE = 1e-3;     /* m, where the search begins; it goes both ways */
static const double RISE = 1.6;           /* of the amplitude: some five a decade */
static const double LINEAR = 1e-3;        /* of the gain: what a tenth of the amplitude changes of
                                           * it where the mode is linear */
static const double NEAR = 0.02;          /* of the gains beside it: little enough to let go */
static const double LOCKED = 1e-4;        /* of a record, unexplained by forced tones: march's own
                                           * tolerance */
static const double REPEATS = 1e-3;       /* of it, ten times as much: what is locked takes a step's
                                           * error back slowly where it nearly slips */

/* A mode of the motion at rest: its frequency, rad/s, growth, 1/s, and shape on the kept dofs. */
struct mode { double omega, growth; double complex *shape; };

/* Slopes of all laws at the kept dofs' place X_0, into K and C, n x n by columns. */
static enum modal_status tangents(const struct torus_solver *s, double *K, double *C,
                                  struct modal_error *err)
{
    int n = s->p->n;
    const int *kept = condense_dofs(s->condense[0]);
    double *x = calloc((size_t)n, sizeof *x);
    bool rates = false;
    enum modal_status rc = x == NULL ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                                     : MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < s->q; i++)
        x[kept[i]] = creal(s->X[i]);
    for (int l = 0; rc == MODAL_OK && l < s->p->laws; l++) {
        const struct law *law = &s->p->law[l];
        double d[LAW_INPUTS_MOST];

        for (int j = 0; j < law->kind->inputs; j++)
            d[j] = law_sees(law, j, x);
        rc = law_spread_slopes(law, d, n, K, C, &rates, err);
    }
    free(x);
    return rc;
}

/* SIGN times A into the block of the pencil, N rows, that begins at ROW and COLUMN. */
static void put_block(const struct sparse *a, double sign, double *to, int N, int row, int column)
{
    struct matrix block = { a->m, a->n, N, to + (size_t)column * (size_t)N + (size_t)row };

    if (a->m > 0)
        sparse_add_to_dense(a, sign, &block);
}

/*
 * The motion at rest as A y = lambda B y, y = (x, x', z) of program.h's (1) and (2), N x N, laws as
 * springs and dampers; without dampers where UNDAMPED.
 */
static enum modal_status pencil(const struct torus_solver *s, bool undamped, double *A, double *B,
                                int N, struct modal_error *err)
{
    const struct program *p = s->p;
    size_t n = (size_t)p->n, rows = (size_t)N;
    double *K = calloc(2 * n * n, sizeof *K), *C = K + n * n;
    enum modal_status rc = K == NULL ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                                     : tangents(s, K, C, err);

    for (size_t j = 0; rc == MODAL_OK && j < n; j++) {
        A[(n + j) * rows + j] = B[j * rows + j] = 1;
        for (size_t i = 0; i < n; i++) {
            A[j * rows + n + i] = -K[j * n + i];
            A[(n + j) * rows + n + i] = undamped ? 0 : -C[j * n + i];
        }
    }
    put_block(&p->constant[PROGRAM_K], -1, A, N, p->n, 0);
    if (!undamped)
        put_block(&p->constant[PROGRAM_C], -1, A, N, p->n, p->n);
    put_block(&p->constant[PROGRAM_M], 1, B, N, p->n, p->n);
    if (N > 2 * p->n) {
        put_block(&p->F, 1, A, N, p->n, 2 * p->n);
        put_block(&p->Bx, 1, A, N, 2 * p->n, 0);
        put_block(&p->Bv, 1, A, N, 2 * p->n, p->n);
        put_block(&p->A, 1, A, N, 2 * p->n, 2 * p->n);
        put_block(&p->Ba, -1, B, N, 2 * p->n, p->n);
        put_block(&p->E, 1, B, N, 2 * p->n, 2 * p->n);
    }
    free(K);
    return rc;
}

static int by_growth(const void *a, const void *b)
{
    double x = ((const struct mode *)a)->growth, y = ((const struct mode *)b)->growth;

    return (x < y) - (x > y);
}

/* Oscillating modes of the pencil into LIST, by falling growth; how many. */
static enum modal_status modes(const struct torus_solver *s, bool undamped, struct mode *list,
                               int *count, struct modal_error *err)
{
    int N = 2 * s->p->n + (undamped ? 0 : s->p->n_linear);
    size_t rows = (size_t)N;
    const int *kept = condense_dofs(s->condense[0]);
    double *A = calloc(3 * rows * rows + 3 * rows, sizeof *A), *B = A + rows * rows,
           *V = B + rows * rows, *re = V + rows * rows, *im = re + rows, *scale = im + rows;
    enum modal_status rc = A == NULL ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory")
                                     : pencil(s, undamped, A, B, N, err);

    *count = 0;
    if (rc == MODAL_OK
        && LAPACKE_dggev(LAPACK_COL_MAJOR, 'N', 'V', N, A, N, B, N, re, im, scale, NULL, 1, V, N)
               != 0)
        rc = modal_fail(err, MODAL_NO_CONVERGENCE, "torus: the modes at rest were not found");
    for (size_t j = 0; rc == MODAL_OK && j < rows; j++) {
        struct mode m = { im[j] / scale[j], re[j] / scale[j], NULL };

        if (!(im[j] > 0) || !(scale[j] > 0) || !isfinite(m.omega) || !isfinite(m.growth))
            continue;
        m.shape = malloc((size_t)s->q * sizeof *m.shape + 1);
        if (m.shape == NULL)
            rc = modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
        for (int i = 0; rc == MODAL_OK && i < s->q; i++)
            m.shape[i] = CMPLX(V[j * rows + (size_t)kept[i]],
                               V[(j + 1) * rows + (size_t)kept[i]]);
        if (rc == MODAL_OK)
            list[(*count)++] = m;
    }
    qsort(list, (size_t)*count, sizeof *list, by_growth);
    free(A);
    return rc;
}

/* The free tone put on a mode, at rest otherwise; REST: the kept dofs' mean. */
static enum modal_status put_on(struct torus_solver *s, const struct mode *mode, const double *rest,
                                struct modal_error *err)
{
    size_t K = (size_t)s->count, q = (size_t)s->q;
    struct torus_tone *t = &s->tone;
    enum modal_status rc;

    t->lead = 0;
    for (int i = 0; i < s->q; i++)
        t->lead = cabs(mode->shape[i]) > cabs(mode->shape[t->lead]) ? i : t->lead;
    t->held = false;
    rc = torus_tone_move(s, mode->omega, 0, err);
    memset(s->X, 0, q * K * sizeof *s->X);
    for (size_t i = 0; rc == MODAL_OK && i < q; i++) {
        t->damping[i] = 0;
        for (size_t m = 0; m < K; m++)
            t->damping[i] = fmax(t->damping[i], cabs(s->linear[m].S[i * q + i]));
        s->X[i * K] = rest[i];
        s->X[i * K + (size_t)t->at] = AMPLITUDE * mode->shape[i] / mode->shape[t->lead];
    }
    t->held = true;
    torus_tone_keep(s);
    return rc;
}

/* The motion that lasts at amplitude A with its gain, from that at another; not *FOUND: as it was.
 */
static enum modal_status hold(struct torus_solver *s, double a, bool *found,
                              struct modal_error *err)
{
    size_t K = (size_t)s->count, n = (size_t)s->q * K;
    double was = creal(s->X[torus_tone_place(s)]), omega = s->tone.omega_kept;
    double gain = s->tone.gain_kept;
    double complex *kept = malloc(n * sizeof *kept + 1);
    enum modal_status rc;

    if (kept == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    memcpy(kept, s->X, n * sizeof *kept);
    for (size_t i = 0; i < n; i++)
        s->X[i] *= i % K > 0 ? a / was : 1;
    rc = torus_solve_set(s, found, err);
    if (rc == MODAL_OK && !*found) {
        memcpy(s->X, kept, n * sizeof *kept);
        rc = torus_tone_move(s, omega, gain, err);
        torus_tone_keep(s);
    }
    free(kept);
    return rc;
}

struct held { double a, gain; };

static struct held held_now(const struct torus_solver *s)
{
    return (struct held) { creal(s->X[torus_tone_place(s)]), s->tone.gain_kept };
}

/* Down in amplitude until the mode is linear, or its gain changes sign on the way: BRACKET[0] the
 * last, [1] the one above it. */
static enum modal_status fall(struct torus_solver *s, struct held bracket[2], bool *found,
                              struct modal_error *err)
{
    enum modal_status rc = hold(s, AMPLITUDE, found, err);
    double a = AMPLITUDE;

    for (int i = 0; rc == MODAL_OK && !*found && i < FALLS_MOST; i++)
        rc = hold(s, a /= 10, found, err);
    bracket[0] = bracket[1] = held_now(s);
    for (int i = 0; rc == MODAL_OK && *found && i < FALLS_MOST; i++) {
        rc = hold(s, bracket[0].a / 10, found, err);
        bracket[1] = bracket[0];
        bracket[0] = held_now(s);
        if (fabs(bracket[0].gain - bracket[1].gain) <= LINEAR * fabs(bracket[0].gain)
            || bracket[0].gain * bracket[1].gain < 0)
            break;
    }
    return rc;
}

/* Up from BRACKET[0] until the gain changes sign between both; *FOUND: it did. */
static enum modal_status rise(struct torus_solver *s, struct held bracket[2], bool *found,
                              struct modal_error *err)
{
    double ratio = RISE;
    bool there = true;
    enum modal_status rc = MODAL_OK;

    bracket[1] = bracket[0];
    *found = false;
    for (int i = 0; rc == MODAL_OK && !*found && i < RISES_MOST && !budget_spent(s->work); i++) {
        rc = hold(s, bracket[1].a * ratio, &there, err);
        if (there) {
            bracket[0] = bracket[1];
            bracket[1] = held_now(s);
            ratio = fmin(RISE, ratio * ratio);
            *found = bracket[0].gain * bracket[1].gain <= 0;
        } else if ((ratio = sqrt(ratio)) < 1 + NEAR)
            break;
    }
    return rc;
}

/* Between BRACKET's amplitudes to a gain of nearly nothing, by regula falsi in log a. */
static enum modal_status narrow(struct torus_solver *s, struct held bracket[2],
                                struct modal_error *err)
{
    double enough = NEAR * fmax(fabs(bracket[0].gain), fabs(bracket[1].gain));
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < SECANTS_MOST; i++) {
        struct held now, *low = &bracket[0], *high = &bracket[1];
        double share = i % 3 == 2 ? 0.5 : low->gain / (low->gain - high->gain);
        bool found;

        rc = hold(s, low->a * pow(high->a / low->a, share), &found, err);
        now = held_now(s);
        if (!found || fabs(now.gain) <= enough)
            break;
        *(now.gain * low->gain > 0 ? low : high) = now;
    }
    return rc;
}

/* From MODE to the motion that lasts by itself. */
static enum modal_status follow(struct torus_solver *s, const struct mode *mode, const double *rest,
                                bool *begun, struct modal_error *err)
{
    struct held bracket[2];
    bool found = false;
    enum modal_status rc = put_on(s, mode, rest, err);

    *begun = false;
    if (rc == MODAL_OK)
        rc = fall(s, bracket, &found, err);
    if (rc == MODAL_OK && found && bracket[0].gain * bracket[1].gain >= 0)
        rc = rise(s, bracket, &found, err);
    if (rc != MODAL_OK || !found)
        return rc;
    rc = narrow(s, bracket, err);
    s->tone.held = false;
    if (rc == MODAL_OK)
        rc = torus_tone_move(s, s->tone.omega_kept, 0, err);
    torus_tone_keep(s);
    return rc == MODAL_OK ? torus_solve_set(s, begun, err) : rc;
}

/* Where the set stands the free tone, alone: the first beside the mean. */
static void find_tone(struct torus_solver *s)
{
    struct torus_index k = { { 0 } };

    k.k[s->tone.index] = 1;
    for (int m = 0; m < s->count; m++)
        if (torus_equal(s->index[m], k))
            s->tone.at = m;
}

/* The place at rest, of the kept dofs: the mean balanced alone. */
static enum modal_status rest_at(struct torus_solver *s, double *rest, bool *found,
                                 struct modal_error *err)
{
    int index = s->tone.index;
    enum modal_status rc = torus_grow_to_order(s, 0, err);

    s->tone.index = -1;
    if (rc == MODAL_OK)
        rc = torus_grid_for(s, 0, 0, &s->grid, err);
    if (rc == MODAL_OK)
        rc = torus_solve_set(s, found, err);
    s->tone.index = index;
    for (int i = 0; rc == MODAL_OK && i < s->q; i++)
        rest[i] = creal(s->X[i]);
    return rc;
}

/* A motion of one tone, the system's own. */
static enum modal_status begin_alone(struct torus_solver *s, bool *begun, struct modal_error *err)
{
    int states = 2 * s->p->n + s->p->n_linear, counts[2] = { 0 }, followed = 0;
    int order = (TORUS_CORE_MOST / (s->q + 1) - 1) / 2;
    struct mode *list[2];
    double *rest = calloc((size_t)s->q + 1, sizeof *rest);
    bool found = false;
    enum modal_status rc = MODAL_OK;

    order = order < ALONE_ORDER ? order : ALONE_ORDER;
    for (int u = 0; u < 2; u++)
        list[u] = calloc((size_t)states + 1, sizeof *list[u]);
    if (rest == NULL || list[0] == NULL || list[1] == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    if (rc == MODAL_OK && states > STATES_MOST)
        rc = modal_fail_field(err, MODAL_TOO_LARGE, "tones",
                              "tones: a free tone alone is looked for from the modes at rest, of "
                              "%d states; at most %d", states, STATES_MOST);
    if (rc == MODAL_OK)
        rc = rest_at(s, rest, &found, err);
    for (int u = 0; rc == MODAL_OK && found && u < 2; u++)
        rc = modes(s, u > 0, list[u], &counts[u], err);
    if (rc == MODAL_OK)
        rc = torus_grow_to_order(s, order > FIRST_ORDER ? order : FIRST_ORDER, err);
    torus_grid_free(s->grid);
    s->grid = NULL;
    if (rc == MODAL_OK)
        rc = torus_grid_for(s, 0, 0, &s->grid, err);
    find_tone(s);
    /* those of the damped motion first; where it creeps, the undamped one tells a frequency */
    for (int u = 0; u < 2; u++)
        for (int j = 0; rc == MODAL_OK && j < counts[u] && !*begun && followed < MODES_MOST; j++) {
            followed++;
            rc = follow(s, &list[u][j], rest, begun, err);
        }
    if (!*begun)
        s->reason = found ? "from none of the modes at rest a motion grows that lasts by itself"
                          : "no place of rest was found";
    for (int u = 0; u < 2; u++)
        for (int j = 0; list[u] != NULL && j < counts[u]; j++)
            free(list[u][j].shape);
    free(list[0]), free(list[1]), free(rest);
    return rc;
}

/* Combinations without the free tone up to FORCED_ORDER into OUT, the mean first; how many. */
static int forced_set(const struct torus_solver *s, struct torus_index *out)
{
    int side = 2 * FORCED_ORDER + 1, third = s->tones.count > 2 ? side : 1, count = 1;

    out[0] = (struct torus_index) { { 0 } };
    for (int i = 0; i < side * side * third; i++) {
        struct torus_index k = { { i % side - FORCED_ORDER, i / side % side - FORCED_ORDER,
                                   third > 1 ? i / side / side - FORCED_ORDER : 0 } };

        if (torus_order(k) > 0 && torus_order(k) <= FORCED_ORDER && k.k[s->tone.index] == 0
            && torus_told(&s->tones, k))
            out[count++] = k;
    }
    return count;
}

/* sum over channels of |sum_r w_r x_r e^{-i omega r dt}|^2, w Hann's window. */
static double power_at(const struct scene_time *time, int q, const double *x, double omega)
{
    double sum = 0;

    for (int i = 0; i < q; i++) {
        double complex at = 0, turn = cexp(-I * omega * time->dt), wave = 1;

        for (int r = 0; r < time->samples; r++) {
            at += (1 - cos(2 * M_PI * r / time->samples)) * x[(size_t)r * (size_t)q + (size_t)i]
                * wave;
            wave *= turn;
        }
        sum += numbers_square(at);
    }
    return sum;
}

/* The strongest line of a record without what the forced tones explain; 0: there is none. */
static enum modal_status strongest(const struct torus_solver *s, const struct scene_time *time,
                                   const double *signals, double *omega, struct modal_error *err)
{
    struct torus_index set[(2 * FORCED_ORDER + 1) * (2 * FORCED_ORDER + 1)
                           * (2 * FORCED_ORDER + 1)];
    size_t q = (size_t)s->q, rows = (size_t)time->samples;
    int count = forced_set(s, set);
    double *x = malloc(rows * q * sizeof *x + 1), left, all = 0, best = 0;
    double complex *X = calloc(q * (size_t)count + 1, sizeof *X);
    enum modal_status rc = x == NULL || X == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a record")
                               : torus_fit(&s->tones, count, set, time, s->q, signals, X, &left,
                                           err);

    *omega = 0;
    for (size_t e = 0; rc == MODAL_OK && e < rows * q; e++) {
        all += signals[e] * signals[e];
        x[e] = signals[e];
        for (int m = 0; m < count; m++)
            x[e] -= creal(X[e % q * (size_t)count + (size_t)m]
                          * cexp(I * torus_frequency(&s->tones, set[m])
                                 * (time->start + (double)(e / q) * time->dt)));
    }
    for (int b = 2; rc == MODAL_OK && left > LOCKED * sqrt(all) && b < time->samples; b++) {
        double at = b * M_PI / ((double)rows * time->dt), power = power_at(time, s->q, x, at);

        if (power > best) {
            best = power;
            *omega = at;
        }
    }
    free(x), free(X);
    return rc;
}

/* s->X of a record, its free tone near OMEGA and narrowed by golden sections of what is left. */
static enum modal_status explain(struct torus_solver *s, const struct scene_time *time,
                                 const double *signals, double omega, struct modal_error *err)
{
    static const double GOLDEN = 0.6180339887498949;
    double bin = M_PI / ((double)time->samples * time->dt), low = omega - bin, high = omega + bin;
    double left[2], at[2] = { high - GOLDEN * (high - low), low + GOLDEN * (high - low) };
    size_t K = (size_t)s->count, q = (size_t)s->q;
    double complex turn;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < NARROWINGS; i++) {
        for (int e = 0; rc == MODAL_OK && e < 2; e++) {
            torus_tones_move(&s->tones, s->tone.index, at[e]);
            rc = torus_fit(&s->tones, s->count, s->index, time, s->q, signals, NULL, &left[e],
                           err);
        }
        *(left[0] < left[1] ? &high : &low) = at[left[0] < left[1]];
        at[0] = high - GOLDEN * (high - low), at[1] = low + GOLDEN * (high - low);
    }
    if (rc == MODAL_OK)
        rc = torus_tone_move(s, 0.5 * (low + high), 0, err);
    if (rc == MODAL_OK)
        rc = torus_fit(&s->tones, s->count, s->index, time, s->q, signals, s->X, left, err);
    torus_tone_keep(s);
    for (size_t i = 0; rc == MODAL_OK && i < q; i++)
        if (cabs(s->X[i * K + (size_t)s->tone.at]) > cabs(s->X[torus_tone_place(s)]))
            s->tone.lead = (int)i;
    turn = rc == MODAL_OK ? conj(s->X[torus_tone_place(s)]) : 1;
    turn /= cabs(turn) > 0 ? cabs(turn) : 1;
    for (size_t e = 0; rc == MODAL_OK && e < q * K; e++)
        s->X[e] *= cpow(turn, s->index[e % K].k[s->tone.index]);
    return rc;
}

/* After how many turns of the leading tone a record repeats, 2 to LOCKED_TURNS_MOST; 0: it does
 * not.  Half of it apart, so that a tone a millionth beside that frequency is none of it. */
static int repeats_after(const struct scene_time *time, int q, const double *signals)
{
    size_t all = (size_t)time->samples * (size_t)q;
    double most = 0;

    for (size_t e = 0; e < all; e++)
        most = fmax(most, fabs(signals[e]));
    for (int turns = 2; turns <= LOCKED_TURNS_MOST; turns++) {
        size_t later = (size_t)(TURNS / (2 * turns) * turns * SAMPLES) * (size_t)q;
        double off = 0;

        for (size_t e = 0; e + later < all; e++)
            off = fmax(off, fabs(signals[e + later] - signals[e]));
        if (off <= REPEATS * most)
            return turns;
    }
    return 0;
}

/* What is said of a motion that repeats after TURNS. */
static const char *locked_after(int turns)
{
#define AFTER(n) \
    "marched from the scene's initial state, the motion repeats after " #n " turns of the " \
    "forced tone: it is locked to it, a motion of one tone, omega that one's, subharmonic " #n
    static const char *const text[LOCKED_TURNS_MOST + 1] = {
        [2] = AFTER(2), AFTER(3), AFTER(4), AFTER(5), AFTER(6), AFTER(7), AFTER(8)
    };
#undef AFTER

    return text[turns];
}

/* From a march of WAIT turns: its strongest line, and the motion that it begins; *ENDED: to
 * march on is of no use, as no line but those of forced tones is left, it repeats with one of
 * these, or it failed. */
static enum modal_status begin_march(struct torus_solver *s, double wait, bool *begun,
                                     bool *ended, struct modal_error *err)
{
    double dt = 2 * M_PI / s->tones.omega[s->tones.lead] / SAMPLES, omega[TORUS_TONES_MOST];
    struct scene_time time = { .dt = dt, .start = wait * SAMPLES * dt, .samples = SAMPLES * TURNS,
                               .duration = (SAMPLES * TURNS - 1) * dt };
    double *signals = calloc((size_t)time.samples * (size_t)s->q + 1, sizeof *signals);
    int tone = s->tone.index, turns = 0;
    bool alone = s->tones.count == 2 && s->tones.lead != tone;    /* the forced tone leads */
    struct modal_error own = { 0 };
    enum modal_status rc = signals == NULL
                               ? modal_fail(err, MODAL_NO_MEMORY, "torus: no memory for a record")
                               : torus_record(s, &time, signals, &own);

    *ended = true;
    if (rc != MODAL_OK && signals != NULL) {
        if (rc == MODAL_CANCELLED)
            *err = own;
        s->reason = "the scene's own motion could not be marched as far as where it settles";
        free(signals);
        return rc == MODAL_CANCELLED ? rc : MODAL_OK;
    }
    memcpy(omega, s->tones.omega, sizeof omega);
    if (rc == MODAL_OK)
        rc = strongest(s, &time, signals, &omega[tone], err);
    if (rc == MODAL_OK && omega[tone] > 0 && alone)
        turns = repeats_after(&time, s->q, signals);
    if (turns > 0) {
        omega[tone] = 0;
        s->reason = locked_after(turns);
    } else if (rc == MODAL_OK && !(omega[tone] > 0))
        s->reason = "marched from the scene's initial state, the motion settles on forced tones "
                    "alone: it is locked to them, or brings none of its own";
    if (rc == MODAL_OK && omega[tone] > 0) {
        s->tones = torus_tones_of(omega, s->tones.count);
        torus_grid_free(s->grid);
        s->grid = NULL;
        rc = explain(s, &time, signals, omega[tone], err);
        if (rc == MODAL_OK)
            rc = torus_grid_for(s, 0, 0, &s->grid, err);
        if (rc == MODAL_OK)
            rc = torus_solve_set(s, begun, err);
    }
    *ended = !(omega[tone] > 0);
    free(signals);
    return rc;
}

/* A motion of forced tones and the system's own. */
static enum modal_status begin_forced(struct torus_solver *s, bool *begun, struct modal_error *err)
{
    double wait = WAIT;
    bool ended = false;
    enum modal_status rc = torus_grow_to_order(s, FIRST_ORDER, err);

    find_tone(s);
    for (int i = 0; rc == MODAL_OK && i < WAITS_MOST && !*begun && !ended; i++) {
        rc = begin_march(s, wait, begun, &ended, err);
        wait *= 2;
    }
    return rc;
}

enum modal_status torus_begin(struct torus_solver *s, bool *begun, struct modal_error *err)
{
    enum modal_status rc;

    *begun = false;
    s->tone.damping = calloc((size_t)s->q + 1, sizeof *s->tone.damping);
    if (s->tone.damping == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "torus: no memory");
    rc = s->tones.count > 1 ? begin_forced(s, begun, err) : begin_alone(s, begun, err);
    torus_grid_free(s->grid);
    s->grid = NULL;
    return rc;
}
