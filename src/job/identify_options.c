/* identify_options.c - see identify_options.h; tested by tests/unit/job/test_job_options.c */
#include "job/identify_options.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/near.h"

enum {
    LIST_MOST = 160,                     /* bytes of channels in a message: they share it with its
                                            words */
    THREADS_MOST = 256,                  /* OpenBLAS as Debian builds it knows no more */
    SIZE_MOST = 1000000000,              /* of the Hankel matrix: below INT_MAX, so that one more is
                                            an int still */
};
static const double
    /* "positive": what a double holds with all its digits, and a decade to spare */
    LEAST = 1e-300,
    /* rank.h: what the energy rules keep where nothing is said */
    ENERGY_KEPT = 0.9999;

#define AT(member) .at = offsetof(struct identify_settings, member)
/* What identify looks for at most. */
#define ORDER .low = 1, .high = IDENTIFY_ORDER_MOST

/* WINDOW_AUTO */
static const char *const window_words[] = { "auto", NULL };

const struct key_row identify_option_rows[] = {
    { "response", KEY_CHOICE, AT(opt.response), .words = identify_response_names,
      .initial = "free",
      .meaning = "what the record answers: nothing that lasts, what nobody measured, or inputs",
      .example = "ambient" },
    { "inputs", KEY_OWN, .form = "A,B",
      .meaning = "channels that hold the measured excitation, with response=forced",
      .example = "force" },
    { "starts", KEY_OWN, .unit = "s", .form = "T1,T2",
      .meaning = "where further records begin, one after another, with response=forced",
      .example = "4,8,12" },
    { "azimuth", KEY_OWN, .form = "CH",
      .meaning = "channel of a rotor's angle in place of a period, with response=ambient",
      .example = "Azimuth" },
    { "frf", KEY_TRUTH, AT(opt.frf), .initial = "false",
      .meaning = "frequency responses by the modes found, with response=forced",
      .example = "true" },
    { "method", KEY_CHOICE, AT(opt.method), .words = identify_method_names, .initial = "auto",
      .form = "NAME", .meaning = "which matrix of transition", .example = "partial-floquet" },
    { "signals", KEY_OWN, .form = "pod|all|A,B",
      .meaning = "reduced by proper orthogonal modes (default), all channels, or those named",
      .example = "all" },
    { "pod.energy", KEY_NUMBER, KEY_SHOWN_OR_NULL, AT(opt.pod_energy), .low = LEAST, .high = 1,
      .meaning = "share of the energy that proper orthogonal modes keep", .example = "0.999" },
    { "pod.rank", KEY_WHOLE, KEY_SHOWN_OR_NULL, AT(opt.pod_rank), ORDER,
      .meaning = "or their number", .example = "6" },
    { "rank.rule", KEY_CHOICE, AT(opt.rank.rule), .words = rank_rule_names, .initial = "auto",
      .form = "NAME", .meaning = "how the number of exponents is found", .example = "mdl" },
    { "rank.fixed", KEY_WHOLE, KEY_SHOWN_OR_NULL, AT(opt.rank.fixed), ORDER,
      .meaning = "the number of exponents: two a pair, one a real or constant part",
      .example = "6" },
    { "rank.energy", KEY_NUMBER, KEY_SHOWN_OR_NULL, AT(opt.rank.energy), .low = LEAST, .high = 1,
      .meaning = "share of the singular values that energy rules keep", .example = "0.9999" },
    { "rank.threshold", KEY_NUMBER, KEY_SHOWN_OR_NULL, AT(opt.rank.threshold), .low = LEAST,
      .high = 1, .meaning = "singular values above so much of the largest", .example = "1e-6" },
    { "rank.most", KEY_WHOLE, KEY_SHOWN_OR_NULL, AT(opt.rank.most), ORDER,
      .meaning = "the highest order tried", .example = "40" },
    { "detrend", KEY_CHOICE, AT(opt.detrend), .words = identify_detrend_names, .initial = "none",
      .meaning = "taken off each channel first", .example = "linear" },
    { "scale", KEY_CHOICE, AT(opt.scale), .words = identify_scale_names, .initial = "rms",
      .meaning = "each channel to unit rms, or all by one factor", .example = "common" },
    { "threads", KEY_WHOLE, AT(threads), .low = 1, .high = THREADS_MOST, .initial = "1",
      .meaning = "of BLAS", .example = "2" },
    { "rows", KEY_WHOLE, KEY_SHOWN_OR_NULL, AT(opt.rows), .low = 1, .high = SIZE_MOST,
      .meaning = "of the Hankel matrix, per signal", .example = "200" },
    { "columns", KEY_WHOLE, KEY_SHOWN_OR_NULL, AT(opt.columns), .low = 1, .high = SIZE_MOST,
      .meaning = "of the Hankel matrix", .example = "100" },
    { "stride", KEY_WHOLE, KEY_SHOWN_OR_NULL, AT(opt.stride), .low = 1, .high = SIZE_MOST,
      .unit = "samples", .meaning = "between two columns", .example = "2" },
    { "window", KEY_INTERVAL, AT(opt.window), .low = 0, .high = 1e300, .unit = "s",
      .words = window_words, .form = "auto|T0,T1",
      .meaning = "part of the record to use; auto: the free response in it, as proposed_window; "
                 "used unasked over 32768 rows",
      .example = "3,43" },
    { "band", KEY_INTERVAL, AT(opt.band), .low = 0, .high = 1e300, .unit = "Hz", .form = "F1,F2",
      .meaning = "demodulated, filtered and decimated first", .example = "3500,3700" },
    { "period", KEY_NUMBER, AT(opt.period), .low = 0, .high = 1e300, .unit = "s", .form = "T",
      .meaning = "of a periodic system; 0: constant coefficients, whatever the batch says",
      .example = "0.02" },
    { "difference", KEY_TRUTH, AT(opt.difference), .initial = "false",
      .meaning = "h(t + T) - h(t): takes a periodic orbit off first", .example = "true" },
    { "refine", KEY_TRUTH, AT(refine),
      .meaning = "variable projection after the method (with auto by default); error bars come "
      "from it", .example = "false" },
    { "shapes", KEY_TRUTH, AT(opt.shapes), .initial = "false",
      .meaning = "mode shapes over the channels", .example = "true" },
    { "target.error", KEY_NUMBER, KEY_SHOWN_OR_NULL, AT(opt.target_error), .low = LEAST,
      .high = 1e300, .meaning = "the cheapest settings whose error is below it",
      .example = "1e-3" },
    { "target.seconds", KEY_NUMBER, KEY_SHOWN_OR_NULL, AT(opt.target_seconds), .low = LEAST,
      .high = 1e300, .unit = "s", .form = "S",
      .meaning = "the best settings within so much processor time", .example = "0.5" },
    { 0 },
};

/* {"rank": {"fixed": 6}} -> {"rank.fixed": 6}; the rest is shared by reference. */
static cJSON *flatten(const cJSON *options)
{
    cJSON *flat = cJSON_CreateObject();

    for (const cJSON *item = options != NULL ? options->child : NULL; flat != NULL && item != NULL;
         item = item->next) {
        if (!cJSON_IsObject(item)) {
            cJSON_AddItemToObject(flat, item->string, cJSON_Duplicate(item, true));
            continue;
        }
        for (const cJSON *inner = item->child; inner != NULL; inner = inner->next) {
            char key[128];
            json_path(key, item->string, inner->string);
            cJSON_AddItemToObject(flat, key, cJSON_Duplicate(inner, true));
        }
    }
    return flat;
}

/* "Q_TFA1" for a channel called "Q_TFA1 (m)", where no other begins so. */
static int find_without_unit(const struct batch *b, const char *name)
{
    size_t length = strlen(name);
    int found = -1;

    for (size_t c = 0; b->names != NULL && c < b->channels; c++)
        if (b->names[c] != NULL && strncmp(b->names[c], name, length) == 0
            && strncmp(b->names[c] + length, " (", 2) == 0) {
            if (found >= 0)
                return -1;
            found = (int)c;
        }
    return found;
}

static int find_channel(const struct batch *b, const cJSON *name)
{
    char own[24];

    if (cJSON_IsNumber(name))
        return name->valuedouble >= 0 && name->valuedouble < (double)b->channels
                       && name->valuedouble == floor(name->valuedouble)
                   ? (int)name->valuedouble
                   : -1;
    for (size_t c = 0; c < b->channels && cJSON_IsString(name); c++) {
        snprintf(own, sizeof own, "ch%zu", c);
        if (strcmp(name->valuestring, b->names != NULL && b->names[c] != NULL ? b->names[c] : own)
            == 0)
            return (int)c;
    }
    return cJSON_IsString(name) ? find_without_unit(b, name->valuestring) : -1;
}

static enum modal_status no_such_channel(const struct batch *b, const char *key,
                                         const cJSON *name, struct modal_error *err)
{
    const char *words = strcmp(key, "signals") == 0 ? "\"pod\", \"all\", " : "";
    char list[256] = "", meant[NEAR_TEXT];

    for (size_t c = 0; b->names != NULL && c < b->channels && strlen(list) < LIST_MOST; c++)
        snprintf(list + strlen(list), sizeof list - strlen(list), ", \"%.40s\"",
                 b->names[c] != NULL ? b->names[c] : "");
    if (cJSON_IsString(name)) {
        near_given(name->valuestring, b->names, b->names != NULL ? b->channels : 0, meant);
        return modal_fail_field(
            err, MODAL_BAD_INPUT, key,
            "%s: no channel \"%.60s\"%s; accepted: %sindices below %zu%s",
            key, name->valuestring, meant, words, b->channels, list);
    }
    return modal_fail_field(
        err, MODAL_BAD_INPUT, key,
        "%s: accepted: %s%schannels by name or index below %zu%s",
        key, words, *words != 0 ? "or " : "", b->channels, list);
}

/* One channel, or a list of channels, that ITEM names under KEY; *OUT is the caller's. */
static enum modal_status read_channels(const char *key, const cJSON *item, const struct batch *b,
                                       int **out, int *count, struct modal_error *err)
{
    int *list;

    *count = cJSON_IsArray(item) ? cJSON_GetArraySize(item) : 1;
    if (*count < 1 || (size_t)*count > b->channels)
        return no_such_channel(b, key, NULL, err);
    *out = list = calloc((size_t)*count, sizeof *list);
    if (list == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d channels", *count);
    for (int i = 0; i < *count; i++) {
        const cJSON *name = cJSON_IsArray(item) ? cJSON_GetArrayItem(item, i) : item;
        list[i] = find_channel(b, name);
        if (list[i] < 0)
            return no_such_channel(b, key, name, err);
        for (int j = 0; j < i; j++)
            if (list[j] == list[i])
                return modal_fail_field(err, MODAL_BAD_INPUT, key, "%s: channel %d is named twice",
                                        key, list[i]);
    }
    return MODAL_OK;
}

/* "pod", "all", one channel, or a list of channels. */
static enum modal_status read_signals(const cJSON *o, const struct batch *b,
                                      struct identify_settings *out, struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(o, "signals");
    enum modal_status rc;

    if (item == NULL
        || (cJSON_IsString(item) && strcmp(item->valuestring, "pod") == 0
            && find_channel(b, item) < 0))
        return MODAL_OK;
    if (cJSON_IsString(item) && strcmp(item->valuestring, "all") == 0
        && find_channel(b, item) < 0) {
        out->opt.signals_all = true;
        return MODAL_OK;
    }
    rc = read_channels("signals", item, b, &out->channels, &out->opt.channel_count, err);
    out->opt.channels = out->channels;
    return rc;
}

/* Which go with response=forced, and only with it. */
static enum modal_status read_inputs(const cJSON *o, const struct batch *b,
                                     struct identify_settings *out, struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(o, "inputs");
    const char *alone = item != NULL ? "inputs" : out->opt.frf ? "frf" : NULL;
    enum modal_status rc;

    if (alone != NULL && out->opt.response != RESPONSE_FORCED)
        return modal_fail_field(err, MODAL_BAD_INPUT, alone, "%s beside response=%s says nothing; "
                                "accepted with response=forced", alone,
                                identify_response_names[out->opt.response]);
    if (item == NULL)
        return MODAL_OK;                          /* the numerics say what is missing */
    rc = read_channels("inputs", item, b, &out->inputs, &out->opt.input_count, err);
    out->opt.inputs = out->inputs;
    return rc;
}

/* One time, or a list of times, of records of a forced response. */
static enum modal_status read_starts(const cJSON *o, struct identify_settings *out,
                                     struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(o, "starts");
    int count = cJSON_IsArray(item) ? cJSON_GetArraySize(item) : item != NULL;

    if (item == NULL)
        return MODAL_OK;
    if (out->opt.response != RESPONSE_FORCED)
        return modal_fail_field(err, MODAL_BAD_INPUT, "starts", "starts beside response=%s says "
                                "nothing; accepted with response=forced",
                                identify_response_names[out->opt.response]);
    if (count < 1 || count >= IDENTIFY_RECORDS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "starts", "starts: %d times; accepted: 1 to "
                                "%d, in s", count, IDENTIFY_RECORDS_MOST - 1);
    out->starts = calloc((size_t)count, sizeof *out->starts);
    if (out->starts == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d times", count);
    for (int i = 0; i < count; i++) {
        const cJSON *t = cJSON_IsArray(item) ? cJSON_GetArrayItem(item, i) : item;
        if (!cJSON_IsNumber(t) || !(t->valuedouble >= 0))
            return modal_fail_field(err, MODAL_BAD_INPUT, "starts", "starts: accepted: times in s, "
                                    "0 and above, as starts=4,8,12");
        out->starts[i] = t->valuedouble;
    }
    out->opt.starts = out->starts, out->opt.start_count = count;
    return MODAL_OK;
}

static enum modal_status read_azimuth(const cJSON *o, const struct batch *b,
                                      struct identify_settings *out, struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(o, "azimuth");
    int count = 1;
    enum modal_status rc;

    if (item == NULL)
        return MODAL_OK;
    if (out->opt.response != RESPONSE_AMBIENT)
        return modal_fail_field(err, MODAL_BAD_INPUT, "azimuth", "azimuth beside response=%s says "
                                "nothing; accepted with response=ambient",
                                identify_response_names[out->opt.response]);
    rc = read_channels("azimuth", item, b, &out->azimuth, &count, err);
    out->opt.azimuth = out->azimuth;
    return rc == MODAL_OK && count > 1
               ? modal_fail_field(err, MODAL_BAD_INPUT, "azimuth", "azimuth names %d channels; "
                                  "accepted: one", count)
               : rc;
}

/* What was given decides the rule where it was not named: a fixed rank, an energy, a threshold. */
static enum rank_rule rule_given(const cJSON *o)
{
    return cJSON_HasObjectItem(o, "rank.fixed") ? RANK_FIXED
         : cJSON_HasObjectItem(o, "rank.energy") ? RANK_ENERGY
         : cJSON_HasObjectItem(o, "rank.threshold") ? RANK_THRESHOLD : RANK_AUTO;
}

static enum modal_status check_rule(const cJSON *o, enum rank_rule rule, struct modal_error *err)
{
    bool fixed = cJSON_HasObjectItem(o, "rank.fixed");

    if (fixed && rule != RANK_FIXED)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rank.fixed",
                                "rank.fixed beside rank.rule \"%s\"; accepted: one of the two",
                                rank_rule_names[rule]);
    if (rule == RANK_FIXED && !fixed)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rank.fixed",
                                "rank.rule \"fixed\" needs rank.fixed: 1 to %d",
                                IDENTIFY_ORDER_MOST);
    return MODAL_OK;
}

enum modal_status identify_options_read(const cJSON *options, const struct batch *batch,
                                        struct identify_settings *out, struct modal_error *err)
{
    cJSON *o = flatten(options);
    enum modal_status rc = o != NULL ? key_table_check(identify_option_rows, NULL, o, "", err)
                                     : modal_fail(err, MODAL_NO_MEMORY,
                                                  "identify: no memory for the options");

    *out = (struct identify_settings) { 0 };
    key_table_defaults(identify_option_rows, out);
    if (rc == MODAL_OK) {
        out->opt.rank.rule = rule_given(o);
        rc = key_table_read(identify_option_rows, o, "", out, err);
    }
    if (rc == MODAL_OK)
        rc = check_rule(o, out->opt.rank.rule, err);
    if (rc == MODAL_OK)
        rc = read_signals(o, batch, out, err);
    if (rc == MODAL_OK)
        rc = read_inputs(o, batch, out, err);
    if (rc == MODAL_OK)
        rc = read_starts(o, out, err);
    if (rc == MODAL_OK)
        rc = read_azimuth(o, batch, out, err);
    if (cJSON_HasObjectItem(o, "refine"))
        out->opt.refine = out->refine ? CHOICE_YES : CHOICE_NO;
    if (cJSON_HasObjectItem(o, "period") && out->opt.period == 0)
        /* 0: constant coefficients, whatever the batch says */
        out->opt.period = -1;
    cJSON_Delete(o);
    if (rc != MODAL_OK)
        identify_settings_done(out);
    return rc;
}

void identify_settings_done(struct identify_settings *s)
{
    free(s->channels), free(s->inputs), free(s->starts), free(s->azimuth);
    *s = (struct identify_settings) { 0 };
}

cJSON *identify_options_write(const struct identify_options *used, const cJSON *asked, int threads)
{
    const cJSON *signals = cJSON_GetObjectItemCaseSensitive(asked, "signals");
    const cJSON *inputs = cJSON_GetObjectItemCaseSensitive(asked, "inputs");
    const cJSON *starts = cJSON_GetObjectItemCaseSensitive(asked, "starts");
    const cJSON *azimuth = cJSON_GetObjectItemCaseSensitive(asked, "azimuth");
    struct identify_settings s = { .opt = *used, .threads = threads,
                                   .refine = used->refine == CHOICE_YES };
    struct rank_options *rank = &s.opt.rank;
    bool by_energy = rank->rule == RANK_ENERGY || rank->rule == RANK_ENERGY_SQUARED;
    cJSON *o = cJSON_CreateObject();

    s.opt.period = used->period > 0 ? used->period : 0;
    rank->fixed = rank->rule == RANK_AUTO ? 0 : rank->fixed;
    rank->energy = !by_energy ? 0 : rank->energy > 0 ? rank->energy : ENERGY_KEPT;
    rank->threshold = rank->rule == RANK_THRESHOLD ? rank->threshold : 0;
    cJSON_AddItemToObject(o, "signals",
                          signals != NULL ? cJSON_Duplicate(signals, true)
                                          : cJSON_CreateString("pod"));
    if (inputs != NULL)
        cJSON_AddItemToObject(o, "inputs", cJSON_Duplicate(inputs, true));
    if (starts != NULL)
        cJSON_AddItemToObject(o, "starts", cJSON_Duplicate(starts, true));
    if (azimuth != NULL)
        cJSON_AddItemToObject(o, "azimuth", cJSON_Duplicate(azimuth, true));
    key_table_write(identify_option_rows, &s, o);
    return o;
}
