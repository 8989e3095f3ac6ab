/* Which lines stay: of lines that the record does not resolve, and of such as are not there; what
 * families are worth. */
/* Tests as well: lines_seen.c */
#include "check.h"
#include "modal/identify/order/choose_lines.h"
#include "modal/identify/order/lines_seen.h"
#include "signals.h"

enum { L = 300, MOST = 8 };

static double y[L];

/* COUNT lines of amplitude 1, the first of SIZE, in noise of 0.1. */
static struct refine_data record(struct matrix *Y, const double complex *lambda, int count,
                                 double size)
{
    struct random rng = { 7 };

    *Y = (struct matrix) { L, 1, L, y };
    for (int l = 0; l < L; l++) {
        y[l] = 0.1 * random_normal(&rng);
        for (int j = 0; j < count; j++)
            y[l] += (j == 0 ? size : 1) * creal(cexp(lambda[j] * l));
    }
    return (struct refine_data) { .Y = Y, .tau = 1 };
}

/* Lines of L nearer than 0.02 rad to IM. */
static int near(const struct lines *l, double im)
{
    int count = 0;

    for (int i = 0; i < l->count; i++)
        count += fabs(cimag(l->lambda[i]) - im) < 0.02;
    return count;
}

TEST(of_two_lines_that_the_record_does_not_resolve_one_stays)
{
    const double complex there[] = { CMPLX(-0.002, 0.5), CMPLX(-0.002, 1.2), CMPLX(-0.003, 1.9) };
    double complex lambda[MOST] = { CMPLX(-0.002, 0.5), CMPLX(-0.002, 1.2),
                                    /* a fifth of what turns by one more over the record */
                                    CMPLX(-0.003, 0.5 + 0.2 * 2 * M_PI / L), CMPLX(-0.003, 1.9) };
    int family[MOST] = { 0, 0, 1, 1 };
    struct lines l = { 4, lambda, family };
    struct matrix Y;
    /* ten times what noise makes of it, nothing like that beside the other */
    struct refine_data d = record(&Y, there, 3, 0.15);

    CHECK(lines_choose(&d, &l, NULL) == MODAL_OK);
    CHECK(l.count == 3);
    CHECK(near(&l, 0.5) == 1 && near(&l, 1.2) == 1 && near(&l, 1.9) == 1);
}

TEST(lines_that_are_not_there_leave_but_the_best_of_each_family)
{
    const double complex there[] = { CMPLX(-0.002, 1.2) };
    double complex lambda[MOST] = { CMPLX(-0.002, 0.3), CMPLX(-0.002, 1.2), CMPLX(-0.002, 2.1),
                                    CMPLX(-0.01, 0.6), CMPLX(-0.01, 1.5), CMPLX(-0.01, 2.4) };
    int family[MOST] = { 0, 0, 0, 1, 1, 1 };
    struct lines l = { 6, lambda, family };
    struct matrix Y;
    struct refine_data d = record(&Y, there, 1, 1);

    CHECK(lines_choose(&d, &l, NULL) == MODAL_OK);
    CHECK(l.count == 2);
    CHECK(near(&l, 1.2) == 1 && l.family[0] == 0 && l.family[1] == 1);
}

TEST(lines_that_coincide_are_refused)
{
    const double complex there[] = { CMPLX(-0.002, 1.2) };
    double complex lambda[MOST] = { there[0], there[0] };
    int family[MOST] = { 0, 1 };
    struct lines l = { 2, lambda, family };
    struct matrix Y;
    struct refine_data d = record(&Y, there, 1, 1);

    CHECK(lines_choose(&d, &l, NULL) == MODAL_NO_CONVERGENCE);
}

TEST(without_a_family_the_criterion_is_that_of_the_fit_of_the_others)
{
    const double complex there[] = { CMPLX(-0.002, 0.5), CMPLX(-0.002, 0.52), CMPLX(-0.003, 1.9) };
    double complex lambda[MOST] = { there[0], there[1], there[2] }, others[MOST];
    int family[MOST] = { 0, 1, 2 };
    struct lines l = { 3, lambda, family };
    struct lines_family each[3];
    struct matrix Y;
    struct refine_data d = record(&Y, there, 3, 1);
    struct refine_options look = { .iterations = -1 };

    for (int j = 0; j < 3; j++)
        each[j] = (struct lines_family) { 2, 0.25, 0, 0 };
    CHECK(lines_without(&d, &l, 3, each, NULL) == MODAL_OK);
    for (int j = 0; j < 3; j++) {
        struct refined fit;
        for (int i = 0, n = 0; i < 3; i++)
            if (i != j)
                others[n++] = lambda[i];
        CHECK(refine_poles(&d, others, 2, NULL, &look, &fit, NULL) == MODAL_OK);
        CHECK_NEAR(each[j].alone, fit.bic, 1e-6 * fabs(fit.bic));
        CHECK(each[j].least < each[j].alone);
        refined_done(&fit);
    }
}

TEST(a_family_has_what_others_beside_it_cannot_stand_in_for_and_conjugates_are_beside_it_too)
{
    /* undamped, whole turns apart: orthogonal; the third is a tenth of a turn from the conjugate
     * of the second */
    const double turn = 2 * M_PI / L, omega = 60 * turn;
    const double complex head[] = { CMPLX(0, 10 * turn), CMPLX(0, 29 * turn),
                                    CMPLX(0, 30.9 * turn) };
    struct heads h = { head, 3, omega, 1, L };
    double share[3];

    /* 31 turns is omega less 29 */
    CHECK(lines_shares(&h, share, NULL) == MODAL_OK);
    CHECK(share[0] > 0.99 && share[0] <= 1 + 1e-12);
    /* of two lines a tenth of a turn apart 1 - sinc^2(0.1) */
    CHECK(share[1] < 0.04 && share[2] < 0.04 && share[1] > 0.01);
}

TEST(of_many_lines_those_are_seen_that_a_remainder_has_and_those_known_are_not_doubled)
{
    enum { FAR = 3 };
    const double omega = 0.31234;
    const double complex head[] = { CMPLX(-0.002, 0.05), CMPLX(-0.004, 0.12) };
    /* line 7 of the first, the conjugate's line 4 of the second, and a line that is known */
    const double complex there[FAR] = { CMPLX(-0.002, 0.05 + 7 * omega),
                                        CMPLX(-0.004, 4 * omega - 0.12),
                                        CMPLX(-0.002, 0.05 + 2 * omega) };
    double complex every[64], kept[64] = { there[2] };
    int family[64], of[64] = { 0 };
    struct lines all = { 0, every, family }, l = { 1, kept, of };
    struct heads h = { head, 2, omega, 1, L };
    struct matrix Y;

    record(&Y, there, FAR, 1);
    for (int i = 0; i < L; i++)
        y[i] *= 10;                             /* of unit noise */
    for (int j = 0; j < 2; j++)
        for (int k = -9; k <= 9; k++)
            if (fabs(cimag(head[j]) + k * omega) < M_PI) {
                all.lambda[all.count] = CMPLX(creal(head[j]), fabs(cimag(head[j]) + k * omega));
                all.family[all.count++] = j;
            }
    CHECK(lines_seen(&h, &Y, 2000, &all, &l, NULL) == MODAL_OK);
    CHECK(l.count == 3 && l.family[1] == 0 && l.family[2] == 1);
    CHECK_NEAR(cimag(l.lambda[1]), cimag(there[0]), 1e-12);
    CHECK_NEAR(cimag(l.lambda[2]), cimag(there[1]), 1e-12);
}
