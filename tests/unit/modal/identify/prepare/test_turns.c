/* test_turns.c - angles unwrapped, and samples at even steps of them */
#include "check.h"
#include <stdlib.h>
#include "modal/identify/prepare/turns.h"

enum { ROWS = 600, STRIDE = 2 };

/* Turns of row k: 13.37 rows each in the mean, the speed wandering by 1 %. */
static double turned(int k)
{
    return k / 13.37 + 0.013 * sin(0.04 * k);
}

static void fill(double *x, double unit, double sign, double least)
{
    for (int k = 0; k < ROWS; k++) {
        double part = sign * turned(k) + 0.3 - least;
        x[k * STRIDE] = unit * (part - floor(part) + least), x[k * STRIDE + 1] = NAN;
    }
}

TEST(an_angle_is_unwrapped_in_degrees_radians_and_turns_both_ways)
{
    static double x[ROWS * STRIDE], turn[ROWS];
    const double units[] = { 1, 2 * M_PI, 360 };
    struct modal_error err;

    for (int i = 0; i < 3; i++)
        for (int sign = -1; sign <= 1; sign += 2)
            for (int half = 0; half < 2; half++) {
                fill(x, units[i], sign, -0.5 * half);
                CHECK(turns_read(x, STRIDE, ROWS, turn, &err) == MODAL_OK);
                for (int k = 0; k < ROWS; k++)
                    CHECK_NEAR(turn[k], turned(k), 1e-11);
                CHECK_NEAR(turns_rows_each(turn, ROWS), (ROWS - 1) / turned(ROWS - 1), 1e-9);
            }
}

TEST(what_is_no_angle_and_what_turns_back_is_refused)
{
    static double x[ROWS * STRIDE], turn[ROWS];
    struct modal_error err;

    for (int k = 0; k < ROWS; k++)
        x[k * STRIDE] = 360 * turned(k);
    CHECK(turns_read(x, STRIDE, ROWS, turn, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "azimuth");
    for (int k = 0; k < ROWS; k++)
        x[k * STRIDE] = 1.7;
    CHECK(turns_read(x, STRIDE, ROWS, turn, &err) == MODAL_BAD_INPUT);
    fill(x, 360, 1, 0);
    x[300 * STRIDE] = x[298 * STRIDE];
    CHECK(turns_read(x, STRIDE, ROWS, turn, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "azimuth");
}

/* A motion of the angle: at even angles it is known. Polynomials through 8 rows, 13 of them a turn,
 * are off by less than 1e-4 of its second harmonic; the angle between rows, taken as linear, by
 * 0.013 0.04^2 / 8. */
TEST(rows_are_at_even_angles)
{
    enum { PHASES = 13 };
    double turn[ROWS];
    struct matrix Y = { ROWS, 1, ROWS, malloc(sizeof(double) * ROWS) };
    struct modal_error err;

    for (int k = 0; k < ROWS; k++) {
        turn[k] = turned(k);
        Y.x[k] = cos(4 * M_PI * turn[k] + 0.2);
    }
    CHECK(turns_resample(&Y, turn, PHASES, TURNS_POINTS, &err) == MODAL_OK);
    CHECK(Y.m == (int)floor(turned(ROWS - 1) * PHASES) + 1);
    for (int i = 4; i < Y.m - 4; i++)
        CHECK_NEAR(Y.x[i], cos(4 * M_PI * i / PHASES + 0.2), 1e-3);
    free(Y.x);
}

/* Turns begin at the angle that the first row has. */
TEST(a_turn_is_as_long_as_its_rows_are_beside_the_mean)
{
    static double turn[ROWS], longer[46];
    double each;

    for (int k = 0; k < ROWS; k++)
        turn[k] = turned(k);
    each = turns_rows_each(turn, ROWS);
    turns_lengths(turn, ROWS, 46, longer);
    /* the rows hold 44.9 turns */
    CHECK(longer[44] == 0 && longer[45] == 0);
    for (int i = 0; i < 44; i++) {
        double begins = 13.37 * i, ends = 13.37 * (i + 1);
        for (int step = 0; step < 50; step++) {     /* k / 13.37 + 0.013 sin(0.04 k) = i */
            begins = 13.37 * (i - 0.013 * sin(0.04 * begins));
            ends = 13.37 * (i + 1 - 0.013 * sin(0.04 * ends));
        }
        /* angles taken as linear between rows are off by 0.013 0.04^2 / 8 */
        CHECK_NEAR(longer[i], (ends - begins) / each - 1, 2 * 0.013 * 0.04 * 0.04 / 8 + 1e-7);
    }
}

TEST(a_coarse_angle_that_stands_where_the_record_ends_gives_its_last_turn_a_length)
{
    const double turn[] = { 0, 0.25, 0.5, 0.75, 1, 1.25, 1.5, 1.75, 2, 2 };
    double longer[2];

    turns_lengths(turn, 10, 2, longer);                   /* 4 rows each; 4.5 in the mean */
    CHECK_NEAR(longer[0], 4 / 4.5 - 1, 1e-15);
    CHECK_NEAR(longer[1], 4 / 4.5 - 1, 1e-15);
}
