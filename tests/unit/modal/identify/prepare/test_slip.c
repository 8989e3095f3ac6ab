/* test_slip.c - turns that are not those of the period given */
#include "check.h"
#include "signals.h"
#include "modal/identify/prepare/slip.h"

enum { EACH = 17, TURNS = 52, ROWS = EACH * TURNS, CHANNELS = 2 };
static double x[ROWS * CHANNELS];
static const double NOISE = 0.013;

/* Two multipliers of five lines each; what has turned by sample k is k / EACH + ENDS u + 4 BOW u
 * (1 - u), u = k / ROWS. */
static void fill(double ends, double bow, uint64_t seed)
{
    const double complex lambda[] = { -0.031 + 1.13 * I, -0.052 + 2.37 * I };
    struct random rng = { seed };

    memset(x, 0, sizeof x);
    for (int c = 0; c < CHANNELS; c++)
        for (int j = 0; j < 2; j++)
            for (int h = -2; h <= 2; h++) {
                double complex g = random_normal(&rng) + I * random_normal(&rng);
                for (int k = 0; k < ROWS; k++) {
                    double u = (double)k / ROWS;
                    double turn = (double)k / EACH + ends * u + 4 * bow * u * (1 - u);
                    x[k + c * ROWS] += creal(g * pow(0.5, abs(h))
                                             * cexp((lambda[j] + 2 * M_PI * I * h) * turn));
                }
            }
    for (int i = 0; i < ROWS * CHANNELS; i++)
        x[i] += NOISE * random_normal(&rng);
}

static struct slip find(int order)
{
    static const double noise[CHANNELS] = { NOISE, NOISE };
    struct matrix Y = { ROWS, CHANNELS, ROWS, x };
    struct slip_record r = { &Y, EACH, noise, order };
    struct slip s;

    CHECK(slip_find(&r, &s, NULL) == MODAL_OK);
    return s;
}

/* Who slips a turn shows a multiplier for each of ten lines.  N is a turn less than the record has,
 * (1) is of whole turns: what is found is what was made, over N.
 * Five standard errors of 12 numbers are none by chance. */
TEST(a_slip_is_found_within_its_errors)
{
    const struct { double ends, bow; } made[] = {
        { 0.041, 0 }, { -0.93, 0 }, { 0.11, -0.027 }, { -0.37, 0.083 }, { 0, 0.012 }, { 1.61, 0 }
    };

    for (size_t i = 0; i < sizeof made / sizeof *made; i++) {
        struct slip s;
        double share, ends, bow;
        fill(made[i].ends, made[i].bow, 1470 + i);
        s = find(fabs(made[i].ends) < 1 ? 8 : 20);
        share = s.turns / TURNS;
        bow = made[i].bow * share * share;
        ends = (made[i].ends + 4 * made[i].bow) * share - 4 * bow;
        CHECK(s.gain > 1);
        CHECK_NEAR(s.ends, ends, 5 * s.std_ends + 4 * fabs(bow - s.bow));
        CHECK_NEAR(s.bow, bow, 5 * s.std_bow);
        CHECK(s.std_ends < 0.01 && s.std_bow < 0.01);
    }
}

TEST(turns_that_keep_their_period_do_not_slip)
{
    for (uint64_t seed = 0; seed < 8; seed++) {
        fill(0, 0, seed);
        CHECK(find(4).gain < 0.75);
    }
}

/* Half-way of 51.4 turns: 0.37 / 2 - 0.083. */
TEST(a_slip_is_added_to_what_the_period_counts)
{
    const struct slip s = { .ends = 0.37, .bow = -0.083, .turns = 51.4 };
    double turn[258];

    slip_turns(&s, 5, 258, turn);
    CHECK_NEAR(turn[0], 0, 0);
    CHECK_NEAR(turn[257], 51.4 + 0.37, 1e-13);
    CHECK_NEAR((turn[128] + turn[129]) / 2, 25.7 + 0.37 / 2 - 0.083, 1e-5);
}
