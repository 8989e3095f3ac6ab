/* torus_stand.c - whether the lines of a march are an answer, and they as one; tested by
 * tests/unit/modal/steady/test_torus.c */
#include "modal/steady/torus_state.h"
#include <math.h>
#include <stdlib.h>
#include "modal/steady/torus_laws.h"

static const double FEW = 1e-2;           /* of a motion that is not the one balanced: where its
                                           * lines leave more of it, it is none of these tones */
static const double AGREE = 3;            /* errors of a balance that its motion may be off */

/* What the balance has of dof I where LINES has line L: of all combinations that it does not tell
 * from that. */
static double complex balanced_at(const struct torus_solver *s, const struct torus_lines *lines,
                                  int i, int l)
{
    double at = torus_frequency(&s->tones, lines->index[l]);
    double complex X = 0;

    for (int m = 0; m < s->count; m++)
        if (fabs(torus_frequency(&s->tones, s->index[m]) - at) < lines->apart)
            X += s->X[(size_t)i * (size_t)s->count + (size_t)m];
    return l == 0 ? creal(X) : X;
}

bool torus_lines_agree(const struct torus_solver *s, const struct torus_lines *lines)
{
    bool agree = lines->count > 0;

    for (int i = 0; i < s->q; i++) {
        double off = 0, beside = 0;

        for (int l = 0; l < lines->count; l++) {
            double complex X = balanced_at(s, lines, i, l),
                           Y = lines->X[(size_t)i * (size_t)lines->count + (size_t)l];

            off += X != 0 ? pow(cabs(Y - X), 2) : 0;
            beside += X == 0 ? pow(cabs(Y), 2) : 0;
        }
        agree = agree && off <= AGREE * AGREE * beside;
    }
    return agree;
}

/* A march may leave an unstable motion for another.  Where its lines explain that well it is the
 * answer, and where all disturbances of one from the scene's start decay, for then it repeats with
 * its loads; else it is none, and more combinations are the way on. */
bool torus_lines_stand(const struct torus_solver *s, const struct torus_lines *lines,
                       const struct torus_point *point)
{
    if (lines->count == 0 || lines->error < FEW * lines->amplitude || s->followed.verdict > 0)
        return lines->count > 0;
    if (point == NULL || !point->converged)
        return false;
    for (int i = 0; i < s->q; i++)
        for (int l = 0; l < lines->count; l++)
            if (cabs(lines->X[(size_t)i * (size_t)lines->count + (size_t)l]
                     - balanced_at(s, lines, i, l)) > AGREE * point->error)
                return false;
    return lines->error < point->error;
}

void torus_lines_done(struct torus_lines *lines)
{
    free(lines->index), free(lines->X), free(lines->acts);
    *lines = (struct torus_lines) { 0 };
}

void torus_adopt(struct torus_solver *s, struct torus_lines *lines, double wanted,
                 struct torus_point *out)
{
    for (int m = 0; s->linear != NULL && m < s->count; m++)
        torus_linear_done(&s->linear[m]);
    free(s->linear), free(s->index), free(s->X);
    s->linear = NULL;
    s->index = lines->index, s->X = lines->X, s->count = lines->count;
    s->marched = lines->samples;
    s->residual = NAN;
    out->converged = true;
    out->amplitude = lines->amplitude;
    out->truncation = lines->e.truncation, out->sampling = lines->e.sampling;
    out->solver = lines->e.solver;
    out->error = lines->error;
    out->line = lines->line;
    out->wanting = out->line > wanted * out->amplitude;
    for (int l = 0; lines->acts != NULL && l < s->p->laws; l++)
        torus_note(s->laws, l, lines->acts[l], lines->asked);
    free(lines->acts);
    *lines = (struct torus_lines) { 0 };
}
