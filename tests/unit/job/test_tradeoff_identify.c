/* Error against time through the job: on exact signals errors are those against the truth, settings
 * are options that give them again. */
/* Tests as well: identify_ladder.c tradeoff.c */
#include "job/tradeoff.h"
#include <stdlib.h>
#include "check.h"
#include "signals.h"

static double column[3 * 1200], samples[3 * 1200];

static struct batch batch_of(struct decay *d, double snr_db, uint64_t seed)
{
    struct random r = { seed };

    decay_of_case(&decay_cases[3], &r, d);
    decay_signals(d, column, 1200);
    if (snr_db > 0)
        decay_noise(d, column, 1200, snr_db, &r);
    for (int k = 0; k < 1200; k++)
        for (int c = 0; c < 3; c++)
            samples[3 * k + c] = column[k + 1200 * c];
    return (struct batch) { .samples = 1200, .channels = 3, .signals = samples, .dt = d->dt };
}

static cJSON *run(const char *kind, const struct batch *b, const char *options,
                  enum modal_status expected)
{
    cJSON *o = cJSON_Parse(options);
    struct job_request request = { .kind = kind, .options = o, .batch = b };
    struct job_result result;
    struct modal_error err = { 0 };
    enum modal_status rc = job_run(&request, &result, &err);

    if (rc != expected)
        fprintf(stderr, "%s: %s\n", err.field, err.message);
    CHECK(rc == expected);
    cJSON *doc = result.result;
    result.result = NULL;
    job_result_done(&result);
    cJSON_Delete(o);
    return doc;
}

static double number(const cJSON *o, const char *key)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(o, key);

    return cJSON_IsNumber(item) ? item->valuedouble : NAN;
}

/* The largest relative error of the answer DOC against the decay's own exponents. */
static double distance(const cJSON *doc, const struct decay *d)
{
    double worst = 0;

    for (int j = 0; j < d->modes; j++) {
        double best = 1;
        const cJSON *m;
        cJSON_ArrayForEach(m, cJSON_GetObjectItem(doc, "modes")) {
            const cJSON *e = cJSON_GetObjectItem(m, "exponent");
            double complex z =
                CMPLX(cJSON_GetArrayItem(e, 0)->valuedouble, cJSON_GetArrayItem(e, 1)->valuedouble);
            best = fmin(best, cabs(z - d->lambda[j]) / cabs(d->lambda[j]));
        }
        worst = fmax(worst, best);
    }
    return worst;
}

TEST(with_a_truth_given_each_rungs_settings_pasted_back_give_its_error)
{
    struct decay d;
    struct batch b = batch_of(&d, 40, 1);
    char options[400];
    const cJSON *rung;
    int pareto = 0;

    snprintf(options, sizeof options,
             "{\"of\":\"identify\",\"repetitions\":1,\"truth\":[[%.17g,%.17g],[%.17g,%.17g],"
             "[%.17g,%.17g]]}",
             creal(d.lambda[0]), cimag(d.lambda[0]), creal(d.lambda[1]), cimag(d.lambda[1]),
             creal(d.lambda[2]), -cimag(d.lambda[2]));
    cJSON *doc = run("tradeoff", &b, options, MODAL_OK);
    CHECK_STRING(cJSON_GetObjectItem(doc, "of")->valuestring, "identify");
    CHECK(cJSON_GetArraySize(cJSON_GetObjectItem(doc, "rungs")) >= 6);
    cJSON_ArrayForEach(rung, cJSON_GetObjectItem(doc, "rungs")) {
        char *settings = cJSON_PrintUnformatted(cJSON_GetObjectItem(rung, "settings"));
        cJSON *again = run("identify", &b, settings, MODAL_OK);
        CHECK_NEAR(number(rung, "error"), distance(again, &d), 1e-12);
        CHECK(number(rung, "seconds") > 0);
        pareto += cJSON_IsTrue(cJSON_GetObjectItem(rung, "pareto"));
        cJSON_Delete(again);
        free(settings);
    }
    CHECK(pareto >= 1);
    const cJSON *best =
        cJSON_GetArrayItem(cJSON_GetObjectItem(doc, "rungs"), (int)number(doc, "recommended"));
    CHECK(cJSON_IsTrue(cJSON_GetObjectItem(best, "pareto")));
    cJSON_Delete(doc);
}

/* Without a truth the error joins the distance to the default's answer and the bound, which the
 * test computes apart. */
TEST(without_a_truth_the_bound_is_that_of_the_data_and_no_rung_is_below_it)
{
    struct decay d;
    struct batch b = batch_of(&d, 40, 2);
    double sum = 0, sd, re[3], im[3], bound = 0;
    const cJSON *rung;

    decay_signals(&d, column, 1200);
    for (int i = 0; i < 3600; i++)
        sum += column[i] * column[i];
    sd = sqrt(sum / 3600) * 1e-2;
    decay_bound(&d, sd, re, im);
    for (int j = 0; j < 3; j++)
        bound = fmax(bound, hypot(re[j], im[j]) / cabs(d.lambda[j]));
    cJSON *doc = run("tradeoff", &b, "{\"repetitions\":1}", MODAL_OK);
    CHECK_NEAR(number(doc, "bound") / bound, 1, 0.06);      /* the noise is estimated to 1.2 % */
    cJSON_ArrayForEach(rung, cJSON_GetObjectItem(doc, "rungs")) {
        CHECK(number(rung, "error") >= number(doc, "bound") * (1 - 1e-12));
        CHECK_NEAR(pow(number(rung, "error"), 2),
                   pow(number(rung, "algorithm_error"), 2) + pow(number(doc, "bound"), 2), 1e-12);
    }
    cJSON_Delete(doc);
}

TEST(a_mode_that_no_rung_could_find_counts_as_a_hundred_per_cent)
{
    struct decay d;
    struct batch b = batch_of(&d, 0, 3);
    const cJSON *rung;
    cJSON *doc = run("tradeoff", &b,
                     "{\"repetitions\":1,\"truth\":[[-0.1,1],[-0.1,2],[-0.1,3],[-0.1,4]]}",
                     MODAL_OK);

    cJSON_ArrayForEach(rung, cJSON_GetObjectItem(doc, "rungs")) {
        CHECK(number(rung, "error") == 1);
        CHECK(number(rung, "unmatched") >= 1);
    }
    cJSON_Delete(doc);
}

TEST(what_is_not_a_truth_or_cannot_be_traded_off_is_bad_input)
{
    struct decay d;
    struct batch b = batch_of(&d, 40, 4);

    run("tradeoff", &b, "{\"truth\":[[1]]}", MODAL_BAD_INPUT);
    run("tradeoff", &b, "{\"of\":\"steady\"}", MODAL_BAD_INPUT);
    run("tradeoff", &b, "{\"repetitions\":0}", MODAL_BAD_INPUT);
    run("tradeoff", &b, "{\"rank.fixed\":-1}", MODAL_BAD_INPUT);
}

/* The bound of all the record at 40 dB is 3e-5; a quarter of it holds nearly all of these decays.
 */
TEST(an_ordinary_identify_stops_at_the_first_rung_within_the_target_and_tells_its_neighbours)
{
    struct decay d;
    struct batch b = batch_of(&d, 40, 5);
    cJSON *doc = run("identify", &b, "{\"target.error\":0.01}", MODAL_OK),
          *ladder = cJSON_GetObjectItem(doc, "ladder");
    const cJSON *rungs = cJSON_GetObjectItem(ladder, "rungs");

    CHECK(number(ladder, "chosen") == 0 && cJSON_GetArraySize(rungs) == 3);
    CHECK_STRING(cJSON_GetObjectItem(ladder, "stop")->valuestring, "target.error");
    CHECK(number(cJSON_GetArrayItem(rungs, 0), "error") <= 0.01);
    CHECK(cJSON_IsFalse(cJSON_GetObjectItem(cJSON_GetArrayItem(rungs, 1), "ran")));
    CHECK(distance(doc, &d) < 0.01);
    cJSON_Delete(doc);
    doc = run("identify", &b, "{\"target.error\":1e-12}", MODAL_OK);
    ladder = cJSON_GetObjectItem(doc, "ladder");
    CHECK(number(ladder, "chosen") == 2);
    CHECK_STRING(cJSON_GetObjectItem(ladder, "stop")->valuestring, "exhausted");
    cJSON_Delete(doc);
    doc = run("identify", &b, "{}", MODAL_OK);
    ladder = cJSON_GetObjectItem(doc, "ladder");
    CHECK(number(ladder, "chosen") == 2 && cJSON_IsNull(cJSON_GetObjectItem(ladder, "stop")));
    CHECK(number(cJSON_GetArrayItem(cJSON_GetObjectItem(ladder, "rungs"), 2), "error") < 1e-4);
    cJSON_Delete(doc);
}
