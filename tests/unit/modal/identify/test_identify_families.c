/* A search of families whose work is spent midway. */
#include "check.h"
#include "modal/identify/identify_state.h"
#include "signals.h"

enum { ROWS = 3000, WIDTH = 2, FAMILIES = 10 };
static const double period = 8.37;

/* Families of three lines each, at HEADS, in noise of a hundredth. */
static void make(const double complex *head, double *y)
{
    struct random rng = { 77 };

    for (int i = 0; i < ROWS * WIDTH; i++)
        y[i] = 0.01 * random_normal(&rng);
    for (int c = 0; c < WIDTH; c++)
        for (int j = 0; j < FAMILIES; j++)
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
    make(start, y);
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
