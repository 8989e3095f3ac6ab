/*
 * alarms.c - rules over the modes of successive windows
 *
 * Windows overlap, so that what noise put into one is in its neighbours too.  A vibration counts
 * once every window has shown it for as long as a window is: the last of them shares no sample
 * with the first.  Those of the first window count as there from the start; any other is a new
 * mode the moment it counts.  Modes are the same that are on one track
 * (modal/identify/live/track.h).
 *
 *   damping_below  a mode that counts has zeta + SIGMAS std < limit; cleared where
 *                  zeta - SIGMAS std > limit, or no window has shown it for a window's length
 *   growth         the verdict is unstable, which has its own error bars (verdict.c); cleared
 *                  where it is stable, and kept where it is undecided
 *   new_mode       said once
 *
 * An edge is told, never a state again.  Windows without an answer change nothing; over a gap only
 * what counts already is remembered, and nothing where a window ends before the last one.
 */
#include "broker/core/alarms.h"
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

enum { KNOWN_MOST = 256 };    /* modes followed: more than any window of 1 MiB tells */
static const double SIGMAS = 4;       /* standard errors: one window in 30,000 is as far off */

struct known { double track; uint64_t since, last; bool counts, native, low, seen; };

struct alarms {
    double limit;                 /* of the damping ratio; NAN: not asked for */
    bool growth, new_mode;
    uint64_t window;
    bool begun, grows;
    uint64_t first_to, last_to;   /* ends of the first and the last window */
    struct known known[KNOWN_MOST]; int count;
};

static enum modal_status read_rules(const cJSON *rules, struct alarms *a, struct modal_error *err)
{
    static const char *const names[] = { "damping_below", "growth", "new_mode", NULL };
    enum modal_status rc = json_keys(rules, "window.alarms", names, err);

    a->limit = NAN;
    if (rc == MODAL_OK)
        rc = json_get_number(rules, "window.alarms", "damping_below", -1, 1, &a->limit, err);
    if (rc == MODAL_OK)
        rc = json_get_bool(rules, "window.alarms", "growth", &a->growth, err);
    return rc == MODAL_OK ? json_get_bool(rules, "window.alarms", "new_mode", &a->new_mode, err)
                          : rc;
}

enum modal_status alarms_new(const cJSON *rules, uint64_t window, struct alarms **out,
                             struct modal_error *err)
{
    struct alarms *a;
    enum modal_status rc;

    *out = NULL;
    if (rules == NULL)
        return MODAL_OK;
    a = calloc(1, sizeof *a);
    if (a == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "alarms: no memory");
    rc = read_rules(rules, a, err);
    if (rc == MODAL_OK && window == 0)
        rc = modal_fail_field(
            err, MODAL_BAD_INPUT, "window.alarms",
            "window.alarms without windows; accepted: beside `samples` or `periods`");
    a->window = window;
    if (rc == MODAL_OK && (!isnan(a->limit) || a->growth || a->new_mode))
        *out = a;
    else
        free(a);
    return rc;
}

void alarms_free(struct alarms *a)
{
    free(a);
}

void alarms_reset(struct alarms *a)
{
    if (a != NULL)
        a->begun = a->grows = false, a->count = 0;
}

/* ---- which mode is which ---- */

static double number_of(const cJSON *o, const char *name)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(o, name);

    return cJSON_IsNumber(item) ? item->valuedouble : NAN;
}

static double std_of(const cJSON *mode, const char *name)
{
    return number_of(cJSON_GetObjectItemCaseSensitive(mode, "std"), name);
}

static struct known *find(struct alarms *a, double track)
{
    for (struct known *k = a->known; k < a->known + a->count; k++)
        if (k->track == track)
            return k;
    return NULL;
}

static struct known *add_known(struct alarms *a, double track, uint64_t to)
{
    if (a->count == KNOWN_MOST)
        return NULL;
    a->known[a->count] = (struct known) { .track = track, .since = to,
                                           .native = to == a->first_to };
    return &a->known[a->count++];
}

/* What does not count yet must be in every window. */
static void forget_unseen(struct alarms *a)
{
    int kept = 0;

    for (int i = 0; i < a->count; i++)
        if (a->known[i].counts || a->known[i].seen)
            a->known[kept++] = a->known[i];
    a->count = kept;
}

/* ---- edges ---- */

static void tell(cJSON **edges, const char *rule, bool raised, double limit, const cJSON *mode)
{
    static const char *const parts[] = { "track", "frequency_hz", "damping_ratio", "std" };
    cJSON *edge = cJSON_CreateObject(), *of;

    cJSON_AddStringToObject(edge, "rule", rule);
    cJSON_AddStringToObject(edge, "state", raised ? "raised" : "cleared");
    if (!isnan(limit))
        json_set_number(edge, "limit", limit);
    if (mode != NULL) {
        of = cJSON_AddObjectToObject(edge, "mode");
        for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
            cJSON_AddItemToObject(of, parts[i],
                                  cJSON_Duplicate(cJSON_GetObjectItemCaseSensitive(mode, parts[i]),
                                                  true));
    }
    if (*edges == NULL)
        *edges = cJSON_CreateArray();
    cJSON_AddItemToArray(*edges, edge);
}

static void judge_mode(struct alarms *a, struct known *k, uint64_t to, const cJSON *mode,
                       cJSON **edges)
{
    double zeta = number_of(mode, "damping_ratio"), bar = SIGMAS * std_of(mode, "damping_ratio");

    if (!k->counts && to - k->since >= a->window) {
        k->counts = true;
        if (a->new_mode && !k->native)
            tell(edges, "new_mode", true, NAN, mode);
    }
    if (!k->counts || isnan(a->limit) || !(bar >= 0))
        return;
    if ((!k->low && zeta + bar < a->limit) || (k->low && zeta - bar > a->limit)) {
        k->low = !k->low;
        tell(edges, "damping_below", k->low, a->limit, mode);
    }
}

static const cJSON *least_damped(const cJSON *modes)
{
    const cJSON *mode, *least = NULL;
    double most = -HUGE_VAL;

    cJSON_ArrayForEach(mode, modes) {
        double re = cJSON_GetNumberValue(
            cJSON_GetArrayItem(cJSON_GetObjectItemCaseSensitive(mode, "exponent"), 0));
        if (re > most)
            most = re, least = mode;
    }
    return least;
}

static void judge_growth(struct alarms *a, const cJSON *document, cJSON **edges)
{
    const cJSON *stable =
        cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItemCaseSensitive(document, "stability"),
                                         "stable");

    if (!a->growth || !(a->grows ? cJSON_IsTrue(stable) : cJSON_IsFalse(stable)))
        return;
    a->grows = !a->grows;
    tell(edges, "growth", a->grows, NAN,
         least_damped(cJSON_GetObjectItemCaseSensitive(document, "modes")));
}

cJSON *alarms_judge(struct alarms *a, uint64_t from, uint64_t to, const cJSON *document)
{
    const cJSON *modes = cJSON_GetObjectItemCaseSensitive(document, "modes"), *mode;
    cJSON *edges = NULL;

    if (a == NULL || !cJSON_IsArray(modes))
        return NULL;
    /* what a full disk refused came again: other samples under the same numbers */
    if (a->begun && to <= a->last_to)
        alarms_reset(a);
    if (!a->begun)
        a->first_to = to;
    for (int i = 0; i < a->count; i++)
        a->known[i].seen = false;
    /* a gap, or windows left out: nothing says that it was there all the time */
    if (a->begun && from > a->last_to + 1)
        forget_unseen(a);
    a->begun = true, a->last_to = to;
    cJSON_ArrayForEach(mode, modes) {
        double track = number_of(mode, "track");
        struct known *k;
        if (!(number_of(mode, "damped_frequency_rad_s") > 0))
            continue;                              /* a real exponent is no vibration */
        k = find(a, track);
        if (k == NULL)
            k = add_known(a, track, to);
        if (k == NULL)
            continue;
        k->last = to, k->seen = true;
        judge_mode(a, k, to, mode, &edges);
    }
    forget_unseen(a);
    for (struct known *k = a->known; k < a->known + a->count; k++)
        if (k->low && !k->seen && to - k->last >= a->window) {
            k->low = false;
            tell(&edges, "damping_below", false, a->limit, NULL);
        }
    judge_growth(a, document, &edges);
    return edges;
}
