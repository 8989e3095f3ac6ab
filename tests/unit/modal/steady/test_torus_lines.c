/* Tests as well: torus_sheet.c torus_stand.c
 *
 * Lines of records of several tones. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include "modal/steady/torus_lines.h"

/* Of a sum of lines the lines; those of (1, 0) and (8, -5) are 1.6 turns of the record apart, those
 * of (-7, 5) and (10, -7) 0.67: one told as the other would drift from it by two radians. */
static void test_lines_less_than_a_turn_of_a_record_apart_are_told(void **state)
{
    const double w[2] = { 1, 1.4142135623730951 };
    const struct torus_index k[] = {
        { { 0 } }, { { 1, 0 } }, { { 8, -5 } }, { { 0, 1 } }, { { -7, 5 } }, { { 10, -7 } }
    };
    const double complex X[] = { 0.2, 1, 0.3 * cexp(I), 0.7 * I, 0.4, -0.2 * I };
    struct torus_options opt = { .dofs_count = 0 };
    struct torus_solver s = { .tones = torus_tones_of(w, 2), .q = 1, .opt = &opt };
    bool reported = true;
    struct torus_sheet a = { .s = &s, .settled = true, .outputs = 1, .reported = &reported,
                             .start = 16 * 2 * M_PI / w[1] };
    struct torus_errors e = { 0 };
    double amplitude, most = 0;

    (void)state;
    assert_true(torus_sheet_lay(&a, 64, 32, 1e-8));
    assert_int_equal(torus_sheet_room(&a, NULL), MODAL_OK);
    for (int n = 0; n < 64 * 32; n++)
        for (int m = 0; m < 6; m++)
            a.x[n] += creal(X[m] * cexp(I * torus_frequency(&s.tones, k[m])
                                        * (a.start + 2 * M_PI / w[1] * n / 64)));
    assert_int_equal(torus_sheet_read(&a, &e, &amplitude, NULL), MODAL_OK);
    assert_true(e.truncation < 1e-8 * amplitude);
    for (int m = 0; m < 6; m++) {
        double off = HUGE_VAL;

        for (int l = 0; l < a.count; l++)
            off = torus_equal(a.index[l], k[m]) ? cabs(a.X[l] - X[m]) : off;
        most = fmax(most, off);
    }
    assert_true(most < 1e-8 * amplitude);
    workspace_free(&a.space);
}

/* Of an error of 1e-4: a hundred lines of 9e-7 are 9e-5 together, and none is of any use. */
static void test_lines_far_below_the_error_asked_for_are_not_told_however_many(void **state)
{
    const double w[2] = { 1, 1.4142135623730951 };
    struct torus_options opt = { .dofs_count = 0 };
    struct torus_solver s = { .tones = torus_tones_of(w, 2), .q = 1, .opt = &opt };
    bool reported = true;
    struct torus_sheet a = { .s = &s, .settled = true, .outputs = 1, .reported = &reported };
    struct torus_errors e = { 0 };
    double amplitude;

    (void)state;
    assert_true(torus_sheet_lay(&a, 32, 512, 1e-4));
    assert_int_equal(torus_sheet_room(&a, NULL), MODAL_OK);
    for (int n = 0; n < 32 * 512; n++)
        for (int m = 0; m <= 100; m++) {
            struct torus_index k = { { m == 0 ? 1 : m % 10, m == 0 ? 0 : 1 + m / 10 } };

            a.x[n] += (m == 0 ? 1 : 9e-7) * cos(torus_frequency(&s.tones, k) * 2 * M_PI / w[1] * n
                                                / 32);
        }
    assert_int_equal(torus_sheet_read(&a, &e, &amplitude, NULL), MODAL_OK);
    assert_int_equal(a.count, 2);                  /* that of 1 and the mean */
    assert_true(e.line > 8e-7 && e.line < 1e-6);   /* the largest left out, wherever it is */
    assert_true(e.truncation > 8e-5);
    workspace_free(&a.space);
}

/* Of tones one in 100 apart 100 times the one is 101 times the other, and 50 times their difference
 * half of it: all that a motion of that has is told, and no combination is more of it. */
static void test_combinations_of_one_frequency_hide_nothing_of_each_other(void **state)
{
    const double w[2] = { 0.7840357304881012, 0.7918760877929821 };
    struct torus_options opt = { .dofs_count = 0 };
    struct torus_solver s = { .tones = torus_tones_of(w, 2), .q = 1, .opt = &opt };
    bool reported = true;
    struct torus_sheet a = { .s = &s, .settled = true, .outputs = 1, .reported = &reported };
    struct torus_errors e = { 0 };
    double amplitude;

    (void)state;
    for (int turns = 256; turns <= 2048; turns *= 2) {
        assert_true(torus_sheet_lay(&a, 64, turns, 1e-6));
        assert_int_equal(torus_sheet_room(&a, NULL), MODAL_OK);
        for (int n = 0; n < 64 * turns; n++) {
            double phase = w[0] * 2 * M_PI / w[1] * n / 64;

            a.x[n] = cos(phase) + 0.05 * cos(1.5 * phase) + 0.01 * sin(0.5 * phase);
        }
        assert_int_equal(torus_sheet_read(&a, &e, &amplitude, NULL), MODAL_OK);
        assert_true(e.truncation < 1e-8 * amplitude);
        workspace_free(&a.space);
        a.x = NULL;
        e = (struct torus_errors) { 0 };
    }
}

/* What decays and what drifts has no lines: those told of it would have rates, of which a march
 * that begins with them knows. */
static void test_what_decays_and_drifts_in_a_record_leaves_its_rates_alone(void **state)
{
    const double w[2] = { 1, 1.4142135623730951 }, T = 256 * 2 * M_PI / 1.4142135623730951;
    struct torus_options opt = { .dofs_count = 0 };
    struct torus_solver s = { .tones = torus_tones_of(w, 2), .q = 1, .opt = &opt };
    bool reported = true;
    struct torus_sheet a = { .s = &s, .outputs = 1, .reported = &reported };
    struct torus_errors e = { 0 };
    double amplitude, off = 0, rates = 0;

    (void)state;
    assert_true(torus_sheet_lay(&a, 64, 256, 1e-6));
    assert_int_equal(torus_sheet_room(&a, NULL), MODAL_OK);
    for (int n = 0; n < 64 * 256; n++) {
        double t = T * n / (64 * 256);

        a.x[n] = 0.2 * cos(w[0] * t) + 0.3 * sin(w[1] * t) + 1e-3 * exp(-0.02 * t) + 1e-4 * t / T;
    }
    assert_int_equal(torus_sheet_read(&a, &e, &amplitude, NULL), MODAL_OK);
    for (int l = 0; l < a.count; l++) {
        int order = torus_order(a.index[l]), first = a.index[l].k[0];
        double complex X = order != 1 ? 0 : first != 0 ? 0.2 : -0.3 * I;

        off = fmax(off, order == 1 ? cabs(a.X[l] - X) : 0);
        rates += torus_frequency(&s.tones, a.index[l]) * cabs(a.X[l] - X);
    }
    assert_true(off < 1e-8 && rates < 1e-5);
    workspace_free(&a.space);
}

/* The record of COUNT lines X at K, N samples a turn, into A->x. */
static void record_lines(struct torus_sheet *a, int count, const struct torus_index *k,
                         const double complex *X)
{
    const struct torus_tones *t = &a->s->tones;

    for (int n = 0; n < a->N * a->turns; n++)
        for (int m = 0; m < count; m++)
            a->x[n] += creal(X[m] * cexp(I * torus_frequency(t, k[m]) * 2 * M_PI
                                         / t->omega[t->lead] * n / a->N));
}

/* Of a tone that no load has and twice one that has, 1e-5 of each other apart, no record of 64
 * turns tells which it was. */
static void test_a_line_beside_a_tone_without_load_is_told_as_one_of_the_loaded_tones(void **state)
{
    const double w[3] = { 1, 0.31415926, 2 * 0.31415926 * (1 + 1e-5) };
    const struct torus_index k[] = { { { 1, 0, 0 } }, { { 0, 1, 0 } }, { { 0, 2, 0 } } };
    const double complex X[] = { 1, 0.5 * I, 0.3 };
    struct torus_options opt = { .dofs_count = 0 };
    struct torus_solver s = { .tones = torus_tones_of(w, 3), .q = 1, .opt = &opt };
    bool reported = true, found = false;
    struct torus_sheet a = { .s = &s, .settled = true, .outputs = 1, .reported = &reported,
                             .idle = { false, false, true } };
    struct torus_errors e = { 0 };
    double amplitude;

    (void)state;
    assert_true(torus_sheet_lay(&a, 32, 64, 1e-6));
    assert_int_equal(torus_sheet_room(&a, NULL), MODAL_OK);
    record_lines(&a, 3, k, X);
    assert_int_equal(torus_sheet_read(&a, &e, &amplitude, NULL), MODAL_OK);
    assert_true(e.change < 1e-8 * amplitude);
    for (int l = 0; l < a.count; l++) {
        assert_int_equal(a.index[l].k[2], 0);
        found = found || (torus_equal(a.index[l], k[2]) && cabs(a.X[l] - X[2]) < 1e-8);
    }
    assert_true(found);
    workspace_free(&a.space);
}

/* Two columns in three turns explain two thirds of what is no line; were there as many columns as
 * turns, nothing would be left, and a record would vouch for anything. */
static void test_of_noise_under_three_tones_a_third_is_left(void **state)
{
    const double w[3] = { 1, 0.6180339887, 0.4142135624 };
    struct torus_options opt = { .dofs_count = 0 };
    struct torus_solver s = { .tones = torus_tones_of(w, 3), .q = 1, .opt = &opt };
    bool reported = true;
    struct torus_sheet a = { .s = &s, .settled = true, .outputs = 1, .reported = &reported };
    struct torus_errors e = { 0 };
    double amplitude, all = 0, left = 0;
    uint32_t seed = 1;

    (void)state;
    assert_true(torus_sheet_lay(&a, 32, 64, 1e-9));
    assert_int_equal(torus_sheet_room(&a, NULL), MODAL_OK);
    for (int n = 0; n < 32 * 64; n++) {
        seed = seed * 1664525u + 1013904223u;
        a.x[n] = seed / 4294967296.0 - 0.5;
        all += a.x[n] * a.x[n];
    }
    assert_int_equal(torus_sheet_read(&a, &e, &amplitude, NULL), MODAL_OK);
    for (int n = 0; n < 32 * 64; n++)
        left += a.left[n] * a.left[n];
    assert_true(left > 0.28 * all && left < 0.5 * all);
    workspace_free(&a.space);
}

/* Of a record of 64 turns that two lines make, 1e-9 of each other apart, one is told; it is off by
 * the other as soon as they have gone apart.  No longer record would know it. */
static void test_a_line_whose_beat_no_record_sees_is_off_by_what_it_may_hide(void **state)
{
    const double w[2] = { 1, 1 + 1e-9 };
    const struct torus_index k[] = { { { 1, 0 } }, { { 0, 1 } } };
    const double complex X[] = { 1, 0.5 * I };
    struct torus_options opt = { .dofs_count = 0 };
    struct torus_solver s = { .tones = torus_tones_of(w, 2), .q = 1, .opt = &opt };
    bool reported = true;
    struct torus_sheet a = { .s = &s, .settled = true, .outputs = 1, .reported = &reported };
    struct torus_errors e = { 0 };
    double amplitude, off = 0;

    (void)state;
    assert_true(torus_sheet_lay(&a, 32, 64, 1e-6));
    assert_int_equal(torus_sheet_room(&a, NULL), MODAL_OK);
    record_lines(&a, 2, k, X);
    assert_int_equal(torus_sheet_read(&a, &e, &amplitude, NULL), MODAL_OK);
    for (int m = 0; m < 2; m++) {
        double complex told = 0;

        for (int l = 0; l < a.count; l++)
            told = torus_equal(a.index[l], k[m]) ? a.X[l] : told;
        off = fmax(off, cabs(told - X[m]));
    }
    assert_true(off > 0.5);
    assert_true(e.truncation >= off && e.line >= off);
    workspace_free(&a.space);
}

/* A tenth is left out by a balance of two lines: one of them may be off by as much, three times,
 * and not by the two of a motion on the other side; where nothing is left out, by nothing. */
static void test_lines_of_another_motion_do_not_agree_with_a_balance(void **state)
{
    const double w[2] = { 1, 1.4142135623730951 };
    struct torus_index k[] = { { { 0 } }, { { 1, 0 } }, { { 0, 1 } }, { { 1, 1 } } };
    double complex X[] = { 0, 1, 0.3 * I, 0.1 }, balance[] = { 0, 1.05, 0.28 * I };
    struct torus_solver s = { .tones = torus_tones_of(w, 2), .q = 1, .count = 3, .index = k,
                              .X = balance };
    struct torus_lines lines = { .count = 4, .index = k, .X = X, .apart = 1e-3 };

    (void)state;
    assert_true(torus_lines_agree(&s, &lines));
    balance[1] = -1;
    assert_false(torus_lines_agree(&s, &lines));
    balance[1] = 1.05;
    X[3] = 0;
    assert_false(torus_lines_agree(&s, &lines));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lines_less_than_a_turn_of_a_record_apart_are_told),
        cmocka_unit_test(test_lines_far_below_the_error_asked_for_are_not_told_however_many),
        cmocka_unit_test(test_combinations_of_one_frequency_hide_nothing_of_each_other),
        cmocka_unit_test(test_what_decays_and_drifts_in_a_record_leaves_its_rates_alone),
        cmocka_unit_test(test_a_line_beside_a_tone_without_load_is_told_as_one_of_the_loaded_tones),
        cmocka_unit_test(test_of_noise_under_three_tones_a_third_is_left),
        cmocka_unit_test(test_a_line_whose_beat_no_record_sees_is_off_by_what_it_may_hide),
        cmocka_unit_test(test_lines_of_another_motion_do_not_agree_with_a_balance),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
