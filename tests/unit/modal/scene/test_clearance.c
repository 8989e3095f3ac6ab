/* test_clearance.c - contact in a circular race: the journal with mass, and the massless one by its
 * scalar balance */
/* Tests as well: journal_contact.c law.c */
#include "check.h"
#include <float.h>
#include "modal/scene/law.h"

static const double still[2] = { 0, 0 };

static struct law_force at(const struct law *law, const double d[2], const double v[2])
{
    struct law_force f = { .memory = NULL };
    struct law_point p = { .d = d, .v = v, .memory_before = still };

    CHECK(law->kind->force(law, &p, &f, NULL) == MODAL_OK);
    return f;
}

TEST(inside_the_gap_nothing_acts)
{
    const double shaft[2] = { 2374, 4200 }, d[2] = { 0.5e-3, -0.62e-3 }, v[2] = { 3, 4 };

    for (int massless = 0; massless < 2; massless++) {
        struct law law;

        CHECK(law_clearance(0.8e-3, 15e6, 1e-3, massless ? shaft : NULL, &law, NULL) == MODAL_OK);
        struct law_force f = at(&law, d, v);
        CHECK(f.f[0] == 0 && f.f[1] == 0 && !f.acts && f.regime == 0);
        law_done(&law);
    }
}

/* N = k a (1 + mu a') along d: a 3-4-5 triangle by hand. */
TEST(a_journal_with_mass_is_pushed_back_along_its_radius)
{
    const double d[2] = { 3e-3, 4e-3 }, v[2] = { 0.6, 0.8 };
    struct law law;

    CHECK(law_clearance(1e-3, 2e6, 0.1, NULL, &law, NULL) == MODAL_OK);
    struct law_force f = at(&law, d, v);
    double N = 2e6 * 4e-3 * (1 + 0.1 * 1);
    CHECK_NEAR(f.f[0], 0.6 * N, 1e-12 * N);
    CHECK_NEAR(f.f[1], 0.8 * N, 1e-12 * N);
    CHECK(f.acts && f.regime == 1);
    const double out[2] = { -6.6, -8.8 };              /* 1 + mu a' = -0.1: it would pull */
    f = at(&law, d, out);
    CHECK(f.f[0] == 0 && f.f[1] == 0 && f.acts && f.regime == 2);
    law_done(&law);
}

/* The balance itself, put back: K (r - d) + k (|r| - gap) r/|r| = 0 with f = K (d - r). */
TEST(a_massless_journal_balances_contact_against_the_shaft)
{
    const double shaft[2] = { 2374, 4200 }, gaps[3] = { 0.8e-3, 1e-9, 0 },
                 ks[3] = { 15e6, 1e3, 1e12 };

    for (int g = 0; g < 3; g++)
        for (int s = 0; s < 3; s++)
            for (int i = 0; i < 40; i++) {
                double angle = 0.157 * i, far = gaps[g] * 1.0001 + pow(10, -6 + 0.12 * i);
                double d[2] = { far * cos(angle), far * sin(angle) };
                struct law law;

                CHECK(law_clearance(gaps[g], ks[s], 0, shaft, &law, NULL) == MODAL_OK);
                struct law_force f = at(&law, d, still);
                double r[2] = { d[0] - f.f[0] / shaft[0], d[1] - f.f[1] / shaft[1] },
                       radius = hypot(r[0], r[1]);
                double along = hypot(f.f[0], f.f[1]);
                CHECK(radius >= gaps[g] * (1 - 1e-12));
                /* radial: f x r = 0; r carries the rounding of d and of f/K */
                CHECK_NEAR(f.f[0] * r[1] - f.f[1] * r[0], 0, 40 * DBL_EPSILON * along * far);
                CHECK_NEAR(along, ks[s] * (radius - gaps[g]),
                           40 * DBL_EPSILON * (ks[s] * far + along));
                law_done(&law);
            }
}

/* fd against central differences, whose own error is about (eps f/h + h^2 f''') ~ 1e-7 of fd. */
TEST(the_jacobian_is_the_derivative_of_the_force)
{
    const double shaft[2] = { 2374, 4200 }, d[2] = { 1.1e-3, -0.7e-3 }, v[2] = { 0.3, -0.2 },
                 h = 1e-8;

    for (int massless = 0; massless < 2; massless++) {
        struct law law;

        CHECK(law_clearance(0.8e-3, 15e6, 1e-3, massless ? shaft : NULL, &law, NULL) == MODAL_OK);
        struct law_force f = at(&law, d, v);
        double scale = fabs(f.fd[0][0]) + fabs(f.fd[1][1]);
        for (int j = 0; j < 2; j++) {
            double up[2] = { d[0], d[1] }, down[2] = { d[0], d[1] }, vup[2] = { v[0], v[1] };

            up[j] += h;
            down[j] -= h;
            vup[j] += 1e-3;
            struct law_force a = at(&law, up, v), b = at(&law, down, v), c = at(&law, d, vup);
            for (int i = 0; i < 2; i++) {
                CHECK_NEAR((a.f[i] - b.f[i]) / (2 * h), f.fd[i][j], 1e-6 * scale);
                CHECK_NEAR((c.f[i] - f.f[i]) / 1e-3, f.fv[i][j],
                           1e-9 * (fabs(f.f[0]) + fabs(f.f[1])));
            }
        }
        law_done(&law);
    }
}

/* A rigid race: |r| = gap up to the compliance gap/k, whatever the shaft. */
TEST(a_stiff_race_keeps_the_journal_on_its_circle)
{
    const double shaft[2] = { 3000, 3000 }, d[2] = { 5e-3, 0 };
    struct law law;

    CHECK(law_clearance(1e-3, 3e12, 0, shaft, &law, NULL) == MODAL_OK);
    struct law_force f = at(&law, d, still);
    CHECK_NEAR(f.f[0], 4e-3 / (1 / 3000.0 + 1 / 3e12), 1e-12);        /* two springs in series */
    CHECK_NEAR(f.fd[0][0], 3000, 1e-5);                 /* radially the shaft gives alone */
    CHECK_NEAR(f.fd[1][1], f.f[0] / 5e-3, 1e-6);        /* across, f turns with d */
    law_done(&law);
}
