/* test_ambient_wander.c - multipliers of the mean turn where turns differ, against a recursion of
 * one state a mode whose multipliers are known */
#include "check.h"
#include "signals.h"
#include <complex.h>
#include <stdlib.h>
#include "modal/identify/ambient/ambient_wander.h"

enum { TURNS = 1500, CHANNELS = 3, DRAWS = 10 };
static const double complex LAMBDA = CMPLX(-0.03, 1.1), NU = CMPLX(-0.2, 8);
/* nearly locked with its own conjugate, which COUPLED lets move it */
static const double complex LOCKED = CMPLX(-0.05, 3), LOCKED_NU = CMPLX(-0.1, 2),
                            COUPLED = CMPLX(3.2, 2.4);
static double z[CHANNELS * TURNS], longer[TURNS];
static bool meet[WHITTLE_MODES_MOST][WHITTLE_MODES_MOST]; /* of the last fit */

static struct whittle model_at(double complex lambda)
{
    struct whittle m = { .channels = CHANNELS, .count = 1 };

    m.mode[0].lambda = lambda;
    for (int i = 0; i < CHANNELS; i++) {
        m.root[i + CHANNELS * i] = 1;
        m.mode[0].phi[i] = CMPLX(1 - 0.4 * i, 0.3 * i);
        /* so that what predicts the next turn dies away */
        m.mode[0].kappa[i] = 0.15 * conj(m.mode[0].phi[i]) * cexp(lambda);
    }
    return m;
}

static struct whittle model(void)
{
    return model_at(LAMBDA);
}

/* Turns whose lengths wander by SHARE within 50 of them, noise of unit variance; each moves the
 * modes of M by their nu, and by eta what the first one's conjugate adds to it. */
static void draw_modes(const struct whittle *m, const double complex *nu, double complex eta,
                       uint64_t seed, double share)
{
    struct random r = { seed };
    double keep = exp(-1. / 50), mean = 0;
    double complex q[2] = { 0, 0 };

    longer[0] = share * random_normal(&r);
    for (int t = 1; t < TURNS; t++)
        longer[t] = keep * longer[t - 1] + share * sqrt(1 - keep * keep) * random_normal(&r);
    for (int t = 0; t < TURNS; t++)
        mean += longer[t] / TURNS;
    for (int t = 0; t < TURNS; t++)
        longer[t] -= mean;
    for (int t = 0; t < TURNS; t++) {
        double complex next[2];
        for (int k = 0; k < m->count; k++)
            next[k] = q[k] * cexp(m->mode[k].lambda);
        for (int i = 0; i < CHANNELS; i++) {
            double e = random_normal(&r);
            z[t + TURNS * i] = e;
            for (int k = 0; k < m->count; k++) {
                z[t + TURNS * i] += 2 * creal(m->mode[k].phi[i] * q[k]);
                next[k] += m->mode[k].kappa[i] * e;
            }
        }
        next[0] += longer[t] * eta * conj(next[0]);
        for (int k = 0; k < m->count; k++)
            q[k] = next[k] * cexp(nu[k] * longer[t]);
    }
}

static void draw_of(struct whittle m, double complex nu, double complex eta, uint64_t seed,
                    double share)
{
    draw_modes(&m, &nu, eta, seed, share);
}

static void draw(uint64_t seed, double share)
{
    draw_of(model(), NU, 0, seed, share);
}

static struct whittle fitted_of(int phases, const double *lengths, struct whittle m)
{
    struct matrix Z = { TURNS, CHANNELS, TURNS, z };
    struct ambient_wander in = { &Z, lengths, phases, 40, false, NULL, NULL };
    struct modal_error err;

    CHECK(ambient_wander_fit(&in, &m, meet, &err) == MODAL_OK && m.converged);
    return m;
}

static struct whittle fitted(const double *lengths, struct whittle m)
{
    return fitted_of(8, lengths, m);
}

/* Mean squares of the errors of decay and turn over the standard errors: of DRAWS 1 to 0.45. */
static void pool(double share, bool told, double square[2])
{
    static const double even[TURNS];

    square[0] = square[1] = 0;
    for (int seed = 0; seed < DRAWS; seed++) {
        struct whittle m;
        draw(100 + (uint64_t)seed, share);
        m = fitted(told ? longer : even, model());
        CHECK(m.count == 1);
        double complex off = whittle_exponent(&m.mode[0], TURNS) - LAMBDA;
        square[0] += pow(creal(off) / m.mode[0].std_decay, 2) / DRAWS;
        square[1] += pow(cimag(off) / m.mode[0].std_turn, 2) / DRAWS;
    }
}

TEST(multipliers_that_each_turn_moves_are_those_of_the_mean_turn_within_their_errors)
{
    double square[2];

    /* 0.8 % of 8 rad: twice the decay */
    pool(0.008, true, square);
    CHECK(square[0] < 3 && square[1] < 3);
    pool(0.008, false, square);
    CHECK(square[0] > 4);
}

TEST(even_turns_have_the_errors_that_they_have)
{
    double square[2];

    pool(0, true, square);
    CHECK(square[0] < 3 && square[1] < 3);
}

TEST(a_second_pair_that_drew_a_line_as_wide_as_turns_differ_leaves)
{
    struct whittle two = model();

    draw(7, 0.008);
    two.count = 2;
    two.mode[1] = two.mode[0];
    two.mode[0].lambda += CMPLX(0, 0.05), two.mode[1].lambda -= CMPLX(0, 0.05);
    for (int i = 0; i < CHANNELS; i++)
        two.mode[0].kappa[i] /= 2, two.mode[1].kappa[i] /= 2;
    two = fitted(longer, two);
    CHECK(two.count == 1);
    CHECK_NEAR(creal(whittle_exponent(&two.mode[0], TURNS)), -0.03, 4 * two.mode[0].std_decay);
}

TEST(of_noise_alone_the_pair_leaves_and_none_is_an_answer)
{
    struct random r = { 11 };
    struct whittle m = model();

    draw(3, 0.008);                                       /* how turns differ */
    for (int i = 0; i < CHANNELS * TURNS; i++)
        z[i] = random_normal(&r);
    m = fitted(longer, m);
    CHECK(m.count == 0 && m.converged);
    m = fitted(longer, m);                                /* as it does where none was found */
    CHECK(m.count == 0 && m.converged);
}

/* 250,000 phases: to try the harmonics that so many may tell is all the work there is. */
TEST(of_as_many_phases_as_there_may_be_the_multiplier_is_that_of_few)
{
    struct whittle few, many;

    draw(100, 0.008);
    few = fitted(longer, model());
    many = fitted_of(250000, longer, model());
    CHECK(few.count == 1 && many.count == 1);
    CHECK_NEAR(creal(many.mode[0].lambda), creal(few.mode[0].lambda), 0.1 * few.mode[0].std_decay);
    CHECK_NEAR(cimag(many.mode[0].lambda), cimag(few.mode[0].lambda), 0.1 * few.mode[0].std_turn);
}

TEST(a_pair_nearly_locked_with_its_conjugate_has_the_decay_of_the_mean_turn)
{
    double square = 0, mean = 0;

    for (int seed = 0; seed < DRAWS; seed++) {
        struct whittle m = model_at(LOCKED);
        draw_of(m, LOCKED_NU, COUPLED, 300 + (uint64_t)seed, 0.015);
        m = fitted(longer, m);
        CHECK(m.count == 1);
        double off = (creal(whittle_exponent(&m.mode[0], TURNS)) - creal(LOCKED))
            / m.mode[0].std_decay;
        square += off * off / DRAWS, mean += off / DRAWS;
    }
    CHECK(square < 3);
    CHECK(fabs(mean) < 3 / sqrt(DRAWS));
}

/* rho and its conjugate are 2 e^-0.05 sin(pi - 3) = 0.268 apart and approach by 2 e^-0.05 times
 * 2 cos(pi - 3) + 0.1 sin(pi - 3), 3.79, a unit of d: they meet at d = 0.071. */
TEST(errors_are_called_wrong_where_a_twentieth_of_the_turns_have_multipliers_that_meet)
{
    static const struct { double share; bool meet; } CASE[] = { { 0.024, false }, { 0.048, true } };

    for (size_t i = 0; i < sizeof CASE / sizeof *CASE; i++) {
        draw_of(model_at(LOCKED), LOCKED_NU, 0, 21, CASE[i].share);
        CHECK(fitted(longer, model_at(LOCKED)).count == 1);
        CHECK(meet[0][0] == CASE[i].meet);
    }
}

/* A mode and a second pair, of a shape of its own, that nothing couples; fitted as two. */
static struct whittle fitted_beside(double complex lambda, double complex nu, uint64_t seed)
{
    struct matrix Z = { TURNS, CHANNELS, TURNS, z };
    struct ambient_wander in = { &Z, longer, 8, 40, true, NULL, NULL };
    double complex both[2] = { NU, nu };
    struct whittle m = model();
    struct modal_error err;

    m.count = 2, m.mode[1].lambda = lambda;
    for (int i = 0; i < CHANNELS; i++) {
        m.mode[1].phi[i] = 0.6 + 0.2 * i;
        m.mode[1].kappa[i] = 0.15 * m.mode[1].phi[i] * cexp(lambda);
    }
    draw_modes(&m, both, 0, seed, 0.01);
    CHECK(ambient_wander_fit(&in, &m, meet, &err) == MODAL_OK && m.count == 2);
    return m;
}

TEST(a_mode_beside_a_pole_near_the_real_axis_whose_slope_is_chance_is_told_to_meet_nothing)
{
    for (uint64_t seed = 100; seed < 104; seed++) {
        fitted_beside(CMPLX(-0.5, 0.02), 0, seed);
        CHECK(!meet[0][0] && !meet[0][1] && !meet[1][0] && !meet[1][1]);
    }
}

/* 0.1 apart where turns 2 % longer move one of them by 0.16. */
TEST(multipliers_of_two_modes_that_nothing_couples_pass_each_other)
{
    struct whittle m = fitted_beside(CMPLX(-0.05, 1.2), 0, 100);

    CHECK(m.converged && !meet[0][1] && !meet[1][0]);
    CHECK_NEAR(creal(m.mode[0].lambda), creal(LAMBDA), 4 * m.mode[0].std_decay);
}
