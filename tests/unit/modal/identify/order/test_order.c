/* The order by BIC: right on clean and noisy decays, none in noise alone, a constant told from a
 * slow decay. */
/* Tests as well: order_above.c order_climb.c order_improve.c */
#include "check.h"
#include "modal/identify/linear/exponents.h"
#include "modal/identify/linear/pencil.h"
#include "modal/identify/order/order.h"
#include "signals.h"

static double y[8 * 1200];

struct pencil_source { struct pencil p; double tau; };

static enum modal_status poles(void *context, int r, double complex *lambda, int *count,
                               struct modal_error *err)
{
    struct pencil_source *s = context;
    double complex rho[64];
    enum modal_status rc = pencil_multipliers(&s->p, r, rho, err);

    if (rc == MODAL_OK)
        *count = poles_of_multipliers(rho, r, s->tau, 0, lambda, NULL);
    return rc;
}

static void choose(const struct matrix *Y, double tau, const struct order_options *opt,
                   struct order_choice *out)
{
    struct refine_data data = { .Y = Y, .tau = tau };
    struct pencil_source s = { .tau = tau };
    struct order_source source = { .poles = poles, .context = &s };

    CHECK(pencil_new(Y, NULL, &s.p, NULL) == MODAL_OK);
    source.most = s.p.count;
    CHECK(order_choose(&data, &source, opt, out, NULL) == MODAL_OK);
    pencil_done(&s.p);
}

TEST(on_clean_signals_nothing_spurious_is_added)
{
    for (int k = 0; k < 6; k++) {
        struct random r = { 10 + (uint64_t)k };
        struct order_choice c;
        struct decay d;
        decay_of_case(&decay_cases[k], &r, &d);
        decay_signals(&d, y, (size_t)d.samples);
        struct matrix Y = { d.samples, 3, d.samples, y };
        choose(&Y, d.dt, NULL, &c);
        const struct refined *fit = &c.candidates[c.chosen].fit;
        CHECK(fit->order == 2 * d.modes && refined_converged(fit));
        for (int j = 0; j < d.modes; j++) {
            double best = 1;
            for (int i = 0; i < fit->poles; i++)
                best = fmin(best, cabs(fit->lambda[i] - d.lambda[j]) / cabs(d.lambda[j]));
            CHECK_NEAR(best, 0, 1e-11);
        }
        order_done(&c);
    }
}

/* At 40 dB every draw of every case has its order, and pooled errors follow the bound: sum of
 * e^2/bound^2 over n parameters is chi-square, mean n, deviation sqrt(2 n); 4 deviations. */
TEST(at_40_dB_the_order_is_right_and_the_errors_are_those_of_the_bound)
{
    double sum = 0, n = 0;

    for (int k = 0; k < 6; k++)
        for (int i = 0; i < 5; i++) {
            struct random r = { 1000 + 100 * (uint64_t)k + (uint64_t)i };
            double re[DECAY_MODES], im[DECAY_MODES], sd;
            struct order_choice c;
            struct decay d;
            decay_of_case(&decay_cases[k], &r, &d);
            decay_signals(&d, y, (size_t)d.samples);
            sd = decay_noise(&d, y, (size_t)d.samples, 40, &r);
            decay_bound(&d, sd, re, im);
            struct matrix Y = { d.samples, 3, d.samples, y };
            choose(&Y, d.dt, NULL, &c);
            const struct refined *fit = &c.candidates[c.chosen].fit;
            CHECK(fit->order == 2 * d.modes && fit->end == REFINE_CONVERGED);
            for (int j = 0; j < d.modes; j++) {
                int b = 0;
                for (int m = 1; m < fit->poles; m++)
                    if (cabs(fit->lambda[m] - d.lambda[j]) < cabs(fit->lambda[b] - d.lambda[j]))
                        b = m;
                double complex e = fit->lambda[b] - d.lambda[j];
                sum += pow(creal(e) / re[j], 2) + pow(cimag(e) / im[j], 2), n += 2;
            }
            order_done(&c);
        }
    CHECK(sum < n + 4 * sqrt(2 * n) && sum > n - 4 * sqrt(2 * n));
}

TEST(a_constant_under_a_decay_is_an_offset_and_not_a_slow_mode)
{
    struct decay d = {
        .modes = 1, .channels = 2, .samples = 400, .dt = 0.05, .lambda = { decay_pole(1.3, 0.02) }
    };
    struct random r = { 4 };
    struct matrix Y = { 400, 2, 400, y };
    struct order_choice c;

    decay_amplitudes(&d, &r);
    decay_signals(&d, y, 400);
    for (int i = 0; i < 800; i++)
        y[i] += 0.7 + 1e-3 * random_normal(&r);
    choose(&Y, d.dt, NULL, &c);
    const struct refined *fit = &c.candidates[c.chosen].fit;
    CHECK(c.offset && fit->poles == 2 && fit->lambda[0] == 0 && fit->order == 3);
    CHECK(fabs(cimag(fit->lambda[1] - d.lambda[0])) < 5 * fit->std_im[1]);
    order_done(&c);
}

/* A decay of 1/(40 records) is 4 standard errors from none at this noise and must not be called a
 * constant. */
TEST(a_slow_decay_that_the_data_can_tell_from_a_constant_is_kept)
{
    struct matrix Y = { 400, 1, 400, y };
    struct random r = { 5 };
    struct order_choice c;

    for (int k = 0; k < 400; k++)
        y[k] = exp(-k / 16000.0) + 1e-4 * random_normal(&r);
    choose(&Y, 1, NULL, &c);
    CHECK(!c.offset && c.candidates[c.chosen].fit.poles == 1);
    CHECK_NEAR(creal(c.candidates[c.chosen].fit.lambda[0]), -1 / 16000.0,
               5 * c.candidates[c.chosen].fit.std_re[0]);
    order_done(&c);
}

TEST(a_fixed_order_is_taken_as_told)
{
    struct random r = { 6 };
    struct order_options opt = { .fixed = 4 };
    struct order_choice c;
    struct decay d;

    decay_of_case(&decay_cases[0], &r, &d);
    decay_signals(&d, y, 1200);
    struct matrix Y = { 100, 3, 1200, y };
    choose(&Y, d.dt, &opt, &c);
    CHECK(c.candidates[c.chosen].fit.order == 4);
    order_done(&c);
}

static bool yes(void *context) { (void)context; return true; }

TEST(a_cancel_is_heard_and_a_source_without_poles_has_no_choice)
{
    struct matrix Y = { 200, 3, 200, y };
    struct refine_data data = { .Y = &Y, .tau = 0.05 };
    struct order_options opt = { .cancelled = yes };
    struct order_source source = { .poles = poles };
    struct pencil_source s = { .tau = 0.05 };
    struct order_choice c;

    CHECK(order_choose(&data, &source, NULL, &c, NULL) == MODAL_OK);
    CHECK(c.chosen == -1 && c.count == 0);
    order_done(&c);
    CHECK(pencil_new(&Y, NULL, &s.p, NULL) == MODAL_OK);
    source = (struct order_source) { .most = s.p.count, .poles = poles, .context = &s };
    CHECK(order_choose(&data, &source, &opt, &c, NULL) == MODAL_CANCELLED);
    pencil_done(&s.p);
}

/* L rows and q + S columns of one QR: 100 (4 + 3)^2; in long records 2 q a number (doubling.h), and
 * what the small factors take. */
TEST(the_work_of_a_look_is_rows_times_columns_squared_and_in_long_records_times_columns)
{
    struct random r = { 7 };
    struct refine_options look = { .iterations = -1 };
    struct refined fit;
    struct decay d;

    decay_of_case(&decay_cases[0], &r, &d);
    decay_signals(&d, y, 1200);
    struct matrix Y = { 100, 3, 1200, y };
    struct refine_data data = { .Y = &Y, .tau = d.dt };
    CHECK(refine_poles(&data, (double complex[]) { CMPLX(-0.1, 3), CMPLX(-0.2, 7) }, 2, NULL, &look,
                       &fit, NULL) == MODAL_OK);
    CHECK_NEAR(fit.work, 100 * 49, 0);
    refined_done(&fit);
    Y.m = 1200;
    CHECK(refine_poles(&data, (double complex[]) { CMPLX(-0.1, 3), CMPLX(-0.2, 7) }, 2, NULL, &look,
                       &fit, NULL) == MODAL_OK);
    CHECK(fit.work > 1200 * 3 * 2 * 4 && fit.work < 1.5 * 1200 * 3 * 2 * 4);
    refined_done(&fit);
}

/* Six modes in noise as strong as a tenth of them.  The last evaluation may overrun the limit, and
 * has 2 q + S columns at most. */
TEST(a_ladder_ends_where_its_work_is_spent_with_the_best_so_far_and_says_so)
{
    struct decay d = { .modes = 6, .channels = 3, .samples = 1200, .dt = 0.02 };
    struct random r = { 8 };
    struct matrix Y = { 1200, 3, 1200, y };
    struct order_choice all, part, again;

    for (int j = 0; j < 6; j++)
        d.lambda[j] = decay_pole(2 + 3.1 * j, 0.004);
    decay_amplitudes(&d, &r);
    decay_signals(&d, y, 1200);
    decay_noise(&d, y, 1200, 20, &r);
    choose(&Y, d.dt, NULL, &all);
    CHECK(!all.limited && all.candidates[all.chosen].fit.order == 12);
    for (double share = 0.05; share < 1; share += 0.15) {
        struct order_options opt = { .work = share * all.work };
        double least = HUGE_VAL, q = 0;
        choose(&Y, d.dt, &opt, &part);
        choose(&Y, d.dt, &opt, &again);
        for (int i = 0; i < part.count; i++) {
            least = fmin(least, part.candidates[i].fit.bic);
            q = fmax(q, part.candidates[i].fit.order);
        }
        CHECK(part.limited && part.chosen >= 0);
        CHECK(part.work <= opt.work + 2 * 1200 * pow(2 * q + 3, 2));
        CHECK_NEAR(part.candidates[part.chosen].fit.bic, least, 0);
        CHECK(again.chosen == part.chosen && again.work == part.work);
        CHECK(again.candidates[again.chosen].fit.bic == part.candidates[part.chosen].fit.bic);
        order_done(&part), order_done(&again);
    }
    order_done(&all);
}

/* Looking may take a quarter of the limit, so five times the need is enough for either. */
TEST(a_limit_above_the_ladders_need_changes_nothing)
{
    struct random r = { 9 };
    struct order_choice all, same;
    struct decay d;

    decay_of_case(&decay_cases[2], &r, &d);
    decay_signals(&d, y, (size_t)d.samples);
    decay_noise(&d, y, (size_t)d.samples, 40, &r);
    struct matrix Y = { d.samples, 3, d.samples, y };
    choose(&Y, d.dt, NULL, &all);
    choose(&Y, d.dt, &(struct order_options) { .work = 5 * all.work }, &same);
    const struct refined *a = &all.candidates[all.chosen].fit,
                         *b = &same.candidates[same.chosen].fit;
    CHECK(!same.limited && same.work == all.work && same.count == all.count &&
          same.chosen == all.chosen);
    CHECK(a->bic == b->bic && a->lambda[0] == b->lambda[0]);
    order_done(&all), order_done(&same);
}

/* Where a larger source is to come, the least looked at is chosen as it is. */
TEST(a_ladder_near_the_end_of_its_source_is_cut_before_it_is_refined)
{
    struct random r = { 11 };
    struct order_choice c;
    struct decay d;

    decay_of_case(&decay_cases[0], &r, &d);
    decay_signals(&d, y, 1200);
    struct matrix Y = { 100, 3, 1200, y };
    choose(&Y, d.dt, &(struct order_options) { .cut = 1 }, &c);
    int r_least = c.candidates[c.chosen].r;
    CHECK(c.cut && !c.candidates[c.chosen].refined);
    order_done(&c);
    choose(&Y, d.dt, &(struct order_options) { .cut = r_least + ORDER_AHEAD - 1 }, &c);
    CHECK(c.cut && !c.candidates[c.chosen].refined);
    order_done(&c);
    choose(&Y, d.dt, &(struct order_options) { .cut = r_least + ORDER_AHEAD }, &c);
    CHECK(!c.cut && c.candidates[c.chosen].refined &&
          c.candidates[c.chosen].fit.order == 2 * d.modes);
    order_done(&c);
}
