/* A search of families whose work is spent midway, and where one begins. */
/* Tests as well: identify_even.c */
#include "check.h"
#include "modal/identify/identify_state.h"
#include "signals.h"

enum { ROWS = 3000, WIDTH = 2, FAMILIES = 10, MANY = 28 };
static const double period = 8.37;

/* COUNT families of three lines each, at HEAD, in noise of a hundredth. */
static void make(const double complex *head, int count, double *y)
{
    struct random rng = { 77 };

    for (int i = 0; i < ROWS * WIDTH; i++)
        y[i] = 0.01 * random_normal(&rng);
    for (int c = 0; c < WIDTH; c++)
        for (int j = 0; j < count; j++)
            for (int k = -1; k <= 1; k++) {
                double complex b = CMPLX(random_normal(&rng), random_normal(&rng));
                double complex z = CMPLX(creal(head[j]), cimag(head[j]) + k * 2 * M_PI / period);
                for (int l = 0; l < ROWS; l++)
                    y[l + c * ROWS] += creal(b * cexp(z * l));
            }
}

/* A search that begins with one family too many, of WORK; 0: of all there may be. */
static void search(double work, struct order_choice *choice, bool *fewer)
{
    static double y[ROWS * WIDTH];
    double complex start[FAMILIES + 1];
    double zeros[FAMILIES + 1] = { 0 };
    struct refined known = { .poles = FAMILIES + 1, .lambda = start, .std_re = zeros,
                             .std_im = zeros, .bic = HUGE_VAL };
    struct work w = { .refine = true, .shift = 1, .tau = 1,
                      .rec = { .Y = { ROWS, WIDTH, ROWS, y }, .period = period, .step = 1,
                               .channels = WIDTH } };

    for (int j = 0; j < FAMILIES; j++)
        start[j] = CMPLX(-0.001 - 0.0001 * j, 0.02 + 0.033 * j);
    make(start, FAMILIES, y);
    start[FAMILIES] = CMPLX(-0.002, 0.037);
    w.data = (struct refine_data) { .Y = &w.rec.Y, .tau = 1 };
    w.spent = work > 0 ? work_left(&w, false, false) - work : 0;
    CHECK(work_choose_families(&w, &known, choice, fewer, NULL) == MODAL_OK);
}

/* It is to leave once the fit of all has converged; of its work there is what that fit takes,
 * 8.5e8, and as much as the looks without each family, 1e8: the fit of the others ends at its
 * start. */
TEST(a_fit_that_converged_stays_where_the_work_ends_that_of_one_family_less)
{
    struct order_choice choice = { .chosen = -1 };
    bool fewer;

    search(9.4e8, &choice, &fewer);
    CHECK(choice.count == 1 && refined_converged(&choice.candidates[0].fit) && !fewer);
    order_done(&choice);
}

TEST(where_the_work_of_families_is_spent_before_all_was_tried_it_is_told_and_nowhere_else)
{
    struct order_choice choice = { .chosen = -1 };
    bool fewer;

    search(9.4e8, &choice, &fewer);
    CHECK(choice.limited);
    order_done(&choice);
    search(0, &choice, &fewer);
    CHECK(!choice.limited && fewer && choice.candidates[0].fit.poles == 3 * FAMILIES);
    order_done(&choice);
}

TEST(even_phases_of_an_uneven_period_have_its_multipliers_to_an_eighth_of_a_line)
{
    static double y[ROWS * WIDTH];
    double complex head[FAMILIES];
    struct work w = { .refine = true, .shift = 1, .tau = 1,
                      .rec = { .Y = { ROWS, WIDTH, ROWS, y }, .period = period, .step = 1,
                               .channels = WIDTH } };
    struct order_choice found = { .chosen = -1 };

    for (int j = 0; j < FAMILIES; j++)
        head[j] = CMPLX(-0.001 - 0.0001 * j, 0.02 + 0.033 * j);
    make(head, FAMILIES, y);
    w.data = (struct refine_data) { .Y = &w.rec.Y, .tau = 1 };
    CHECK(work_choose_even(&w, &w.rec.Y, &found, NULL) == MODAL_OK && found.chosen >= 0);
    for (int j = 0; j < FAMILIES && found.chosen >= 0; j++) {
        const struct refined *fit = &found.candidates[found.chosen].fit;
        double nearest = HUGE_VAL;
        for (int i = 0; i < fit->poles; i++)
            nearest = fmin(nearest, cabs(fit->lambda[i] - head[j]));
        CHECK(nearest < M_PI / 4 / ROWS);
    }
    order_done(&found);
}

/* The order of many families, which even phases find, of WORK, or of all there may be where that is
 * 0; the work that it took. */
static double choose(double work, struct diagnose_facts *facts)
{
    static double y[ROWS * WIDTH];
    double complex head[MANY];
    struct identify_result out = { 0 };
    struct work w = { .refine = true, .shift = 1, .tau = 1, .facts = { .converged = true },
                      .X = &w.rec.Y,
                      .rec = { .Y = { ROWS, WIDTH, ROWS, y }, .period = period, .step = 1,
                               .channels = WIDTH } };
    double all;

    for (int j = 0; j < MANY; j++)
        head[j] = CMPLX(-0.001 - 0.00005 * j, 0.02 + 0.0125 * j);
    make(head, MANY, y);
    w.data = (struct refine_data) { .Y = &w.rec.Y, .tau = 1 };
    all = work_left(&w, false, false);
    w.spent = work > 0 ? all - work : 0;
    CHECK(work_choose_order(&w, &out, NULL) == MODAL_OK && w.choice.chosen >= 0);
    CHECK(refined_converged(&w.choice.candidates[w.choice.chosen].fit));
    *facts = w.facts;
    all = w.spent;
    order_done(&w.choice);
    free(out.singular);
    return all;
}

TEST(families_whose_search_the_work_ended_have_no_errors_and_others_have)
{
    struct diagnose_facts facts;
    double work = choose(0, &facts);

    CHECK(facts.converged && !facts.work_limit);
    choose(0.45 * work, &facts);
    CHECK(!facts.converged && facts.work_limit);
}
