/* test_job_identify.c - identify as a job: options in, the document of the contract out */
/* Tests as well: identify_job.c identify_options.c */
#include "check.h"
#include <stdlib.h>
#include "job/identify_job.h"
#include "job/job.h"

enum { K = 400 };

static double signals[2 * K];
static const char *const names[] = { "tip (m)", "root (m)" };

static struct batch batch(void)
{
    for (int k = 0; k < K; k++) {
        double t = 0.05 * k;
        signals[2 * k] = exp(-0.1 * t) * cos(6.2 * t) + 0.2 * exp(-0.05 * t) * cos(14 * t);
        signals[2 * k + 1] =
            3e-4 * (exp(-0.1 * t) * sin(6.2 * t) - 0.4 * exp(-0.05 * t) * cos(14 * t + 1));
    }
    return (struct batch){
        .samples = K, .channels = 2, .signals = signals, .dt = 0.05, .names = names
    };
}

/* Run with OPTIONS (JSON text, NULL for none); the caller deletes *result. */
static enum modal_status run(const char *options, cJSON **result, struct modal_error *err)
{
    struct batch b = batch();
    cJSON *o = options != NULL ? cJSON_Parse(options) : NULL;
    struct job_request request = {
        .kind = "identify", .options = o, .batch = &b, .input_sha256 = "5eed"
    };
    struct job_result out;
    enum modal_status rc;

    CHECK(options == NULL || o != NULL);
    rc = job_run(&request, &out, err);
    *result = out.result;
    cJSON_Delete(o);
    return rc;
}

static cJSON *at(const cJSON *o, const char *path)
{
    char copy[128], *rest = copy, *part;
    cJSON *found = (cJSON *)o;

    snprintf(copy, sizeof copy, "%s", path);
    while (found != NULL && (part = strsep(&rest, "/")) != NULL)
        found = cJSON_IsArray(found) ? cJSON_GetArrayItem(found, atoi(part))
                                     : cJSON_GetObjectItemCaseSensitive(found, part);
    return found;
}

static double number(const cJSON *o, const char *path)
{
    const cJSON *x = at(o, path);

    return cJSON_IsNumber(x) ? x->valuedouble : NAN;
}

TEST(the_document_has_every_field_of_the_contract)
{
    const char *const paths[] = {
        "kind",
        "modes/0/frequency_hz",
        "modes/0/frequency_rad_s",
        "modes/0/damped_frequency_rad_s",
        "modes/0/damping_ratio",
        "modes/0/exponent/1",
        "modes/0/resolved_exponent/1",
        "modes/0/multiplier/1",
        "modes/0/amplitude",
        "modes/0/energy",
        "modes/0/persistence",
        "modes/0/residual",
        "modes/0/std/frequency_hz",
        "modes/0/std/damping_ratio",
        "modes/0/std/exponent/1",
        "modes/0/std/multiplier",
        "modes/0/shape/1/0",
        "modes/0/mpc",
        "stability/stable",
        "stability/max_multiplier",
        "stability/margin",
        "stability/margin_std",
        "rank/pod",
        "rank/hankel",
        "rank/rule",
        "rank/energy",
        "reconstruction/signals/1/name",
        "reconstruction/signals/1/rms_error",
        "reconstruction/signals/1/relative_error",
        "reconstruction/relative_error",
        "offset",
        "order/rule",
        "order/candidates/0/order",
        "order/candidates/0/bic",
        "stabilisation/0/order",
        "clusters",
        "diagnostics",
        "cost/wall_s",
        "cost/cpu_s",
        "cost/stages/read",
        "cost/stages/pod",
        "cost/stages/svd",
        "cost/stages/synthesis",
        "cost/peak_bytes",
        "provenance/version",
        "provenance/input_sha256",
        "provenance/host",
        "provenance/threads",
        "provenance/blas_core",
        "provenance/options",
    };
    cJSON *r;

    CHECK(run("{\"shapes\":true}", &r, NULL) == MODAL_OK);
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++)
        if (at(r, paths[i]) == NULL)
            fail_msg("no %s", paths[i]);
    CHECK_NEAR(number(r, "modes/0/exponent/0"), -0.1, 1e-12);
    CHECK_NEAR(number(r, "modes/0/exponent/1"), 6.2, 1e-12);
    CHECK_NEAR(number(r, "modes/0/frequency_hz"), hypot(0.1, 6.2) / (2 * M_PI), 1e-12);
    CHECK_NEAR(number(r, "modes/0/damping_ratio"), 0.1 / hypot(0.1, 6.2), 1e-12);
    CHECK_NEAR(hypot(number(r, "modes/0/multiplier/0"), number(r, "modes/0/multiplier/1")),
               exp(-0.005), 1e-13);
    CHECK(cJSON_IsTrue(at(r, "stability/stable")));
    CHECK_NEAR(number(r, "stability/margin"), 0.05, 1e-12);
    CHECK_STRING(at(r, "reconstruction/signals/1/name")->valuestring, "root (m)");
    cJSON_Delete(r);
}

/* What a result says it used gives the same result when it is handed back. */
TEST(the_options_written_back_can_be_pasted_in_again)
{
    cJSON *first, *second, *options, *item;
    char *text;
    const char *const keys[] = { "method",      "signals",    "pod.energy",   "pod.rank",
                                 "rank.energy", "rank.fixed", "rank.rule",    "detrend",
                                 "threads",     "rows",       "columns",      "stride",
                                 "window",      "band",       "period",       "difference",
                                 "refine",      "shapes",     "target.error", "target.seconds" };

    CHECK(run("{\"rank.fixed\":4,\"window\":[1,15]}", &first, NULL) == MODAL_OK);
    options = at(first, "provenance/options");
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        if (cJSON_GetObjectItemCaseSensitive(options, keys[i]) == NULL)
            fail_msg("no option %s", keys[i]);
    options = cJSON_Duplicate(options, true);
    for (item = options->child; item != NULL; ) {
        cJSON *next = item->next;
        if (cJSON_IsNull(item))
            cJSON_Delete(cJSON_DetachItemViaPointer(options, item));
        item = next;
    }
    text = json_print(options);
    CHECK(run(text, &second, NULL) == MODAL_OK);
    CHECK(number(first, "modes/0/exponent/0") == number(second, "modes/0/exponent/0"));
    CHECK(cJSON_Compare(at(first, "provenance/options"), at(second, "provenance/options"), true));
    free(text);
    cJSON_Delete(options), cJSON_Delete(first), cJSON_Delete(second);
}

TEST(every_wrong_option_is_refused_by_its_name)
{
    const struct { const char *options, *field;
    } cases[] = {
        { "{\"metod\":\"auto\"}", "metod" },
        { "{\"method\":\"prony\"}", "method" },
        { "{\"method\":3}", "method" },
        { "{\"rank.fixed\":0}", "rank.fixed" },
        { "{\"rank.fixed\":2.5}", "rank.fixed" },
        { "{\"rank.fixed\":401}", "rank.fixed" },
        { "{\"rank.fixed\":300}", "rank.fixed" },
        { "{\"rank\":{\"fixed\":\"six\"}}", "rank.fixed" },
        { "{\"rank\":{\"fixd\":6}}", "rank.fixd" },
        { "{\"rank.energy\":1.5}", "rank.energy" },
        { "{\"rank.rule\":\"fixed\"}", "rank.fixed" },
        { "{\"rank.rule\":\"best\"}", "rank.rule" },
        { "{\"rank.fixed\":2,\"rank.rule\":\"mdl\"}", "rank.fixed" },
        { "{\"pod.rank\":0}", "pod.rank" },
        { "{\"pod.energy\":0}", "pod.energy" },
        { "{\"rows\":400}", "rows" },
        { "{\"columns\":400}", "columns" },
        { "{\"stride\":0}", "stride" },
        { "{\"stride\":300}", "stride" },
        { "{\"window\":[3]}", "window" },
        { "{\"window\":[5,4]}", "window" },
        { "{\"window\":[100,101]}", "window" },
        { "{\"window\":\"all\"}", "window" },
        { "{\"band\":[1,11]}", "band" },
        { "{\"band\":[2,1]}", "band" },
        { "{\"period\":-1}", "period" },
        { "{\"period\":11}", "period" },
        { "{\"difference\":true}", "difference" },
        { "{\"difference\":1}", "difference" },
        { "{\"signals\":\"nose\"}", "signals" },
        { "{\"signals\":[0,0]}", "signals" },
        { "{\"signals\":[2]}", "signals" },
        { "{\"signals\":[]}", "signals" },
        { "{\"detrend\":\"cubic\"}", "detrend" },
        { "{\"threads\":0}", "threads" },
        { "{\"target.error\":-1}", "target.error" },
        { "{\"refine\":\"yes\"}", "refine" },
        { "{\"shapes\":1}", "shapes" },
        { "{\"scale\":\"none\"}", "scale" },
        { "{\"band\":[0,1e-300]}", "band" },
        { "{\"band\":[0,1e-320]}", "band" },
        { "{\"band\":[3,3.0000001]}", "band" },
        { "{\"period\":0.049}", "period" },
        { "{\"period\":1e-300}", "period" },
        { "{\"pod.rank\":3}", "pod.rank" },
        { "{\"signals\":[0],\"pod.rank\":2}", "pod.rank" },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct modal_error err = { .field = "" };
        cJSON *r;
        enum modal_status rc = run(cases[i].options, &r, &err);
        if (rc != MODAL_BAD_INPUT || strcmp(err.field, cases[i].field) != 0 || r != NULL)
            fail_msg("%s: status %d, field \"%s\" (%s)", cases[i].options, rc, err.field,
                     err.message);
    }
}

/* What is asked for is said back with the limit: 400 samples, 0.05 s apart, of 2 channels. */
TEST(a_period_below_a_sample_and_a_rank_above_the_channels_are_told_with_their_limits)
{
    const struct { const char *options, *told; } cases[] = {
        { "{\"period\":0.049}", "a period of 0.049 s, shorter than the 0.05 s from one sample to "
                                "the next; accepted: 0.05 to 10 s" },
        { "{\"pod.rank\":3}", "pod.rank is 3 of 2 channels and 400 samples; accepted: 1 to 2" },
        { "{\"band\":[0,1e-300]}", "band [0, 1e-300] Hz, 1e-300 Hz wide" },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct modal_error err = { .field = "" };
        cJSON *r;
        CHECK(run(cases[i].options, &r, &err) == MODAL_BAD_INPUT);
        if (strstr(err.message, cases[i].told) == NULL)
            fail_msg("%s: %s", cases[i].options, err.message);
    }
}

/* From 0 to half the sampling rate there is nothing to filter out. */
TEST(a_band_of_all_frequencies_is_the_whole_record)
{
    cJSON *whole, *banded;

    CHECK(run(NULL, &whole, NULL) == MODAL_OK);
    CHECK(run("{\"band\":[0,10]}", &banded, NULL) == MODAL_OK);
    CHECK(number(whole, "modes/1/exponent/0") == number(banded, "modes/1/exponent/0"));
    CHECK(number(whole, "modes/0/exponent/1") == number(banded, "modes/0/exponent/1"));
    cJSON_Delete(whole), cJSON_Delete(banded);
}

TEST(channels_are_chosen_by_name_by_name_without_unit_and_by_index)
{
    const char *const ways[] = { "{\"signals\":[\"root (m)\"]}", "{\"signals\":\"root\"}",
                                 "{\"signals\":1}", "{\"signals\":[1]}" };

    for (int i = 0; i < 4; i++) {
        cJSON *r;
        CHECK(run(ways[i], &r, NULL) == MODAL_OK);
        CHECK(cJSON_GetArraySize(at(r, "reconstruction/signals")) == 1);
        CHECK_STRING(at(r, "reconstruction/signals/0/name")->valuestring, "root (m)");
        cJSON_Delete(r);
    }
}

TEST(naming_a_method_is_the_papers_procedure_and_says_so)
{
    cJSON *r;

    CHECK(run("{\"method\":\"autoregressive\",\"rank.fixed\":4}", &r, NULL) == MODAL_OK);
    CHECK(cJSON_IsFalse(at(r, "provenance/options/refine")));
    CHECK(cJSON_IsNull(at(r, "modes/0/std/frequency_hz")));
    CHECK(number(r, "modes/0/bar") < 1e-10);
    CHECK_NEAR(number(r, "modes/0/exponent/0"), -0.1, 1e-11);
    cJSON_Delete(r);
}

static bool cancelled(void *context)
{
    (void)context;
    return true;
}

TEST(a_cancelled_job_has_no_result)
{
    struct batch b = batch();
    struct job_request request = { .kind = "identify", .batch = &b, .cancelled = cancelled };
    struct job_result out;

    CHECK(job_run(&request, &out, NULL) == MODAL_CANCELLED);
    CHECK(out.result == NULL);
}
