/* A program whose laws are series: its matrices, entry by entry. */
#include "check.h"
#include "modal/scene/period_map.h"
#include "modal/steady/linearised.h"
#include "scene_text.h"

/* Entry (i, j) of A. */
static double entry(const struct sparse *a, int i, int j)
{
    for (int k = a->m > 0 ? a->start[i] : 0; a->m > 0 && k < a->start[i + 1]; k++)
        if (a->index[k] == j)
            return a->value[k];
    return 0;
}

/* Two masses; 3 + 2 cos 2t + sin 2t between them by place, 5 on the second by rate; 0.5 cos t on
 * the first is the program's own. */
TEST(slopes_are_added_to_the_mean_and_to_the_harmonics_that_are_there)
{
    struct program *p = program_text(
        "{'structure':{'type':'chain','masses':[1,1],'springs':[10,20,0],'dampers':[0,0,0.25]},"
        "'omega':1,'effects':[{'type':'parametric_stiffness','dof':'x1','stiffness':0.5}]}");
    struct law_end between[] = { { 0, 1 }, { 1, -1 } }, second = { 1, 2 };
    struct period_channel place = { .in = between, .out = between, .ins = 2, .outs = 2 },
                          rate = { .in = &second, .out = &second, .ins = 1, .outs = 1,
                                   .rate = true };
    double complex spring[] = { 3, 0, CMPLX(2, -1) }, damper[] = { 5 };
    struct linearised_slope slope[] = { { &place, 2, spring }, { &rate, 0, damper } };
    struct linearised l;
    const struct program *q = &l.program;

    CHECK(linearised_make(p, slope, 2, &l, NULL) == MODAL_OK);
    CHECK(q->laws == 0 && q->loads == 0 && q->harmonics == 2);
    CHECK_NEAR(entry(&q->constant[PROGRAM_K], 0, 0), 33, 1e-13);
    CHECK_NEAR(entry(&q->constant[PROGRAM_K], 0, 1), -23, 1e-13);
    CHECK_NEAR(entry(&q->constant[PROGRAM_K], 1, 1), 23, 1e-13);
    CHECK_NEAR(entry(&q->constant[PROGRAM_C], 1, 1), 20.25, 1e-13);
    CHECK(q->harmonic[0].k == 1 && q->harmonic[1].k == 2);
    CHECK_NEAR(entry(&q->harmonic[0].cosine[PROGRAM_K], 0, 0), 0.5, 1e-13);
    CHECK(q->harmonic[0].sine[PROGRAM_K].m == 0 && q->harmonic[1].cosine[PROGRAM_C].m == 0);
    CHECK_NEAR(entry(&q->harmonic[1].cosine[PROGRAM_K], 1, 0), -2, 1e-13);
    CHECK_NEAR(entry(&q->harmonic[1].sine[PROGRAM_K], 1, 0), -1, 1e-13);
    CHECK_NEAR(entry(&q->harmonic[1].sine[PROGRAM_K], 0, 0), 1, 1e-13);
    linearised_done(&l);
    CHECK(p->harmonics == 1 && entry(&p->constant[PROGRAM_K], 0, 0) == 30);
    program_free(p);
}
