/* Which lines stay: of lines that the record does not resolve, and of such as are not there. */
#include "check.h"
#include "modal/identify/order/choose_lines.h"
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
