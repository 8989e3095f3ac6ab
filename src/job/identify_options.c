/* identify_options.c - see identify_options.h */
#include "job/identify_options.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { THREADS_MOST = 256 };

static const char *const keys[] = {
    "method", "signals", "pod.energy", "pod.rank", "rank.energy", "rank.fixed", "rank.rule", "rank.threshold", "rank.most", "detrend", "scale",
    "threads", "rows", "columns", "stride", "window", "band", "period", "difference", "refine", "shapes", "target.error", "target.seconds",
    NULL,
};

/* {"rank": {"fixed": 6}} -> {"rank.fixed": 6}; the rest is shared by reference. */
static cJSON *flatten(const cJSON *options)
{
    cJSON *flat = cJSON_CreateObject();

    for (const cJSON *item = options != NULL ? options->child : NULL; flat != NULL && item != NULL; item = item->next) {
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

/* [low, high] in seconds or hertz. */
static enum modal_status read_interval(const cJSON *o, const char *key, double out[2], struct modal_error *err)
{
    double *x = NULL;
    size_t count = 0;
    enum modal_status rc = json_get_numbers(o, "", key, 0, 1e300, &x, &count, err);

    if (rc == MODAL_BAD_INPUT && err != NULL)
        snprintf(err->field, sizeof err->field, "%s", key);     /* the option; the message says which number of it */
    if (rc == MODAL_OK && x != NULL && count != 2)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, key, "%s has %zu numbers; accepted: two, the first below the second", key, count);
    else if (rc == MODAL_OK && x != NULL && !(x[1] > x[0]))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, key, "%s is [%.6g, %.6g]; accepted: two numbers, the first below the second", key, x[0], x[1]);
    if (rc == MODAL_OK && x != NULL)
        out[0] = x[0], out[1] = x[1];
    free(x);
    return rc;
}

/* "Q_TFA1" for a channel called "Q_TFA1 (m)", where no other begins so. */
static int find_without_unit(const struct batch *b, const char *name)
{
    size_t length = strlen(name);
    int found = -1;

    for (size_t c = 0; b->names != NULL && c < b->channels; c++)
        if (b->names[c] != NULL && strncmp(b->names[c], name, length) == 0 && strncmp(b->names[c] + length, " (", 2) == 0) {
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
        return name->valuedouble >= 0 && name->valuedouble < (double)b->channels && name->valuedouble == floor(name->valuedouble) ? (int)name->valuedouble : -1;
    for (size_t c = 0; c < b->channels && cJSON_IsString(name); c++) {
        snprintf(own, sizeof own, "ch%zu", c);
        if (strcmp(name->valuestring, b->names != NULL && b->names[c] != NULL ? b->names[c] : own) == 0)
            return (int)c;
    }
    return cJSON_IsString(name) ? find_without_unit(b, name->valuestring) : -1;
}

static enum modal_status no_such_channel(const struct batch *b, const cJSON *name, struct modal_error *err)
{
    char list[256] = "";

    for (size_t c = 0; b->names != NULL && c < b->channels && strlen(list) < 160; c++)
        snprintf(list + strlen(list), sizeof list - strlen(list), ", \"%.40s\"", b->names[c] != NULL ? b->names[c] : "");
    if (cJSON_IsString(name))
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "signals: no channel \"%.60s\"; accepted: \"pod\", \"all\", indices below %zu%s", name->valuestring, b->channels, list);
    return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "signals: accepted: \"pod\", \"all\", or channels by name or index below %zu%s", b->channels, list);
}

/* "pod", "all", one channel, or a list of channels. */
static enum modal_status read_signals(const cJSON *o, const struct batch *b, struct identify_options *opt, int **channels, struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(o, "signals");
    int count = cJSON_IsArray(item) ? cJSON_GetArraySize(item) : 1, *list;

    if (item == NULL || (cJSON_IsString(item) && strcmp(item->valuestring, "pod") == 0 && find_channel(b, item) < 0))
        return MODAL_OK;
    if (cJSON_IsString(item) && strcmp(item->valuestring, "all") == 0 && find_channel(b, item) < 0) {
        opt->signals_all = true;
        return MODAL_OK;
    }
    if (count < 1 || (size_t)count > b->channels)
        return no_such_channel(b, NULL, err);
    *channels = list = calloc(count, sizeof *list);
    if (list == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for %d channels", count);
    for (int i = 0; i < count; i++) {
        const cJSON *name = cJSON_IsArray(item) ? cJSON_GetArrayItem(item, i) : item;
        list[i] = find_channel(b, name);
        if (list[i] < 0)
            return no_such_channel(b, name, err);
        for (int j = 0; j < i; j++)
            if (list[j] == list[i])
                return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "signals: channel %d is named twice", list[i]);
    }
    opt->channels = list;
    opt->channel_count = count;
    return MODAL_OK;
}

static enum modal_status read_numbers(const cJSON *o, struct identify_options *opt, int *threads, struct modal_error *err)
{
    const struct { const char *key; double low, high, *to; } numbers[] = {
        { "pod.energy", 1e-300, 1, &opt->pod_energy }, { "rank.energy", 1e-300, 1, &opt->rank.energy },
        { "rank.threshold", 1e-300, 1, &opt->rank.threshold }, { "period", 0, 1e300, &opt->period },
        { "target.error", 1e-300, 1e300, &opt->target_error }, { "target.seconds", 1e-300, 1e300, &opt->target_seconds },
    };
    const struct { const char *key; int low, high, *to; } integers[] = {
        { "pod.rank", 1, IDENTIFY_ORDER_MOST, &opt->pod_rank }, { "rank.fixed", 1, IDENTIFY_ORDER_MOST, &opt->rank.fixed },
        { "rank.most", 1, IDENTIFY_ORDER_MOST, &opt->rank.most }, { "rows", 1, 1000000000, &opt->rows },
        { "columns", 1, 1000000000, &opt->columns }, { "stride", 1, 1000000000, &opt->stride }, { "threads", 1, THREADS_MOST, threads },
    };
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; i < sizeof numbers / sizeof *numbers && rc == MODAL_OK; i++)
        rc = json_get_number(o, "", numbers[i].key, numbers[i].low, numbers[i].high, numbers[i].to, err);
    for (size_t i = 0; i < sizeof integers / sizeof *integers && rc == MODAL_OK; i++)
        rc = json_get_int(o, "", integers[i].key, integers[i].low, integers[i].high, integers[i].to, err);
    return rc;
}

/* What was given decides the rule where it was not named: a fixed rank, an energy, a threshold. */
static enum modal_status read_rule(const cJSON *o, struct identify_options *opt, struct modal_error *err)
{
    int rule = RANK_AUTO;
    bool fixed = cJSON_HasObjectItem(o, "rank.fixed");
    enum modal_status rc;

    if (fixed)
        rule = RANK_FIXED;
    else if (cJSON_HasObjectItem(o, "rank.energy"))
        rule = RANK_ENERGY;
    else if (cJSON_HasObjectItem(o, "rank.threshold"))
        rule = RANK_THRESHOLD;
    rc = json_get_choice(o, "", "rank.rule", rank_rule_names, &rule, err);
    opt->rank.rule = rule;
    if (rc == MODAL_OK && fixed && rule != RANK_FIXED)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rank.fixed", "rank.fixed beside rank.rule \"%s\"; accepted: one of the two", rank_rule_names[rule]);
    if (rc == MODAL_OK && rule == RANK_FIXED && !fixed)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rank.fixed", "rank.rule \"fixed\" needs rank.fixed: 1 to %d", IDENTIFY_ORDER_MOST);
    return rc;
}

enum modal_status identify_options_read(const cJSON *options, const struct batch *batch, struct identify_options *opt, int *threads,
                                        int **channels, struct modal_error *err)
{
    cJSON *o = flatten(options);
    int method = IDENTIFY_AUTO, detrend = DETREND_NONE, scale = SCALE_RMS;
    bool refine = false;
    enum modal_status rc;

    *opt = (struct identify_options) { 0 };
    *channels = NULL;
    *threads = 1;
    if (o == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for the options");
    if ((rc = json_keys(o, "", keys, err)) != MODAL_OK
        || (rc = json_get_choice(o, "", "method", identify_method_names, &method, err)) != MODAL_OK
        || (rc = json_get_choice(o, "", "detrend", identify_detrend_names, &detrend, err)) != MODAL_OK
        || (rc = json_get_choice(o, "", "scale", identify_scale_names, &scale, err)) != MODAL_OK
        || (rc = json_get_bool(o, "", "difference", &opt->difference, err)) != MODAL_OK
        || (rc = json_get_bool(o, "", "shapes", &opt->shapes, err)) != MODAL_OK
        || (rc = json_get_bool(o, "", "refine", &refine, err)) != MODAL_OK
        || (rc = read_numbers(o, opt, threads, err)) != MODAL_OK
        || (rc = read_rule(o, opt, err)) != MODAL_OK
        || (rc = read_interval(o, "window", opt->window, err)) != MODAL_OK
        || (rc = read_interval(o, "band", opt->band, err)) != MODAL_OK
        || (rc = read_signals(o, batch, opt, channels, err)) != MODAL_OK)
        goto out;
    opt->method = method;
    opt->detrend = detrend;
    opt->scale = scale;
    if (cJSON_HasObjectItem(o, "refine"))
        opt->refine = refine ? CHOICE_YES : CHOICE_NO;
    if (cJSON_HasObjectItem(o, "period") && opt->period == 0)
        opt->period = -1;                     /* 0: constant coefficients, whatever the batch says */
out:
    cJSON_Delete(o);
    if (rc != MODAL_OK) {
        free(*channels);
        *channels = NULL;
    }
    return rc;
}

/* A number, or null where the option was left to its default and none applies. */
static void write_number(cJSON *o, const char *key, double value)
{
    if (value > 0)
        cJSON_AddNumberToObject(o, key, value);
    else
        cJSON_AddNullToObject(o, key);
}

static void write_interval(cJSON *o, const char *key, const double x[2])
{
    if (x[1] > 0)
        cJSON_AddItemToObject(o, key, json_numbers(x, 2));
    else
        cJSON_AddNullToObject(o, key);
}

cJSON *identify_options_write(const struct identify_options *u, const cJSON *asked, int threads)
{
    cJSON *o = cJSON_CreateObject(), *signals = cJSON_GetObjectItemCaseSensitive(asked, "signals");

    cJSON_AddStringToObject(o, "method", identify_method_names[u->method]);
    cJSON_AddItemToObject(o, "signals", signals != NULL ? cJSON_Duplicate(signals, true) : cJSON_CreateString("pod"));
    write_number(o, "pod.energy", u->pod_energy);
    write_number(o, "pod.rank", u->pod_rank);
    cJSON_AddStringToObject(o, "rank.rule", rank_rule_names[u->rank.rule]);
    write_number(o, "rank.fixed", u->rank.rule == RANK_AUTO ? 0 : u->rank.fixed);
    write_number(o, "rank.energy", u->rank.rule == RANK_ENERGY || u->rank.rule == RANK_ENERGY_SQUARED ? (u->rank.energy > 0 ? u->rank.energy : 0.9999) : 0);
    write_number(o, "rank.threshold", u->rank.rule == RANK_THRESHOLD ? u->rank.threshold : 0);
    write_number(o, "rank.most", u->rank.most);
    cJSON_AddStringToObject(o, "detrend", identify_detrend_names[u->detrend]);
    cJSON_AddStringToObject(o, "scale", identify_scale_names[u->scale]);
    cJSON_AddNumberToObject(o, "threads", threads);
    write_number(o, "rows", u->rows);
    write_number(o, "columns", u->columns);
    write_number(o, "stride", u->stride);
    write_interval(o, "window", u->window);
    write_interval(o, "band", u->band);
    cJSON_AddNumberToObject(o, "period", u->period > 0 ? u->period : 0);
    cJSON_AddBoolToObject(o, "difference", u->difference);
    cJSON_AddBoolToObject(o, "refine", u->refine == CHOICE_YES);
    cJSON_AddBoolToObject(o, "shapes", u->shapes);
    write_number(o, "target.error", u->target_error);
    write_number(o, "target.seconds", u->target_seconds);
    return o;
}
