/* Alarm rules: on documents written by hand, where every edge is known, and on live windows of
 * synthetic signals, where the truth is. */
/* Tests as well: live.c */
#include "broker/core/alarms.h"
#include "check.h"
#include "job/live.h"
#include "signals.h"

enum { WINDOW = 200, HOP = 100 };
static const double DT = 0.05;

static struct alarms *rules(const char *text)
{
    cJSON *o = cJSON_Parse(text);
    struct alarms *a = NULL;

    CHECK(alarms_new(o, WINDOW, &a, NULL) == MODAL_OK && a != NULL);
    cJSON_Delete(o);
    return a;
}

/* The edges of window number I that shows COUNT vibrations, as one line: "rule+hz;" raised,
 * "rule-;" cleared. */
static const char *edges_of(struct alarms *a, int i, int count, const double *hz,
                            const double *zeta, double std, const char *stable)
{
    static char line[256];
    char text[1024] = "";
    int at = snprintf(text, sizeof text, "{\"stability\":{\"stable\":%s},\"modes\":[", stable);
    cJSON *document, *edges, *e;

    for (int k = 0; k < count; k++)
        at += snprintf(text + at, sizeof text - (size_t)at,
                       "%s{\"track\":%d,\"frequency_hz\":%g,"
                       "\"damped_frequency_rad_s\":6,\"damping_ratio\":%g,"
                       "\"exponent\":[%g,6],\"std\":{\"frequency_hz\":0.001,\"damping_ratio\":%g}}",
                       k > 0 ? "," : "", (int)hz[k], hz[k], zeta[k], -6 * zeta[k], std);
    snprintf(text + at, sizeof text - (size_t)at, "]}");
    document = cJSON_Parse(text);
    edges = alarms_judge(a, (uint64_t)(i * HOP), (uint64_t)(i * HOP + WINDOW - 1), document);
    line[0] = 0;
    cJSON_ArrayForEach(e, edges) {
        const cJSON *mode = cJSON_GetObjectItem(e, "mode");
        at = (int)strlen(line);
        snprintf(line + at, sizeof line - (size_t)at, "%s%s",
                 cJSON_GetObjectItem(e, "rule")->valuestring,
                 strcmp(cJSON_GetObjectItem(e, "state")->valuestring, "raised") == 0 ? "+" : "-");
        at = (int)strlen(line);
        if (mode != NULL)
            snprintf(line + at, sizeof line - (size_t)at, "%g",
                     cJSON_GetObjectItem(mode, "frequency_hz")->valuedouble);
        strcat(line, ";");
    }
    cJSON_Delete(edges);
    cJSON_Delete(document);
    return line;
}

/* Limit 0.01, error 0.001, so that below 0.006 is low and above 0.014 no longer; a mode counts in
 * the third window, 200 samples after the first. */
TEST(damping_is_low_from_four_errors_below_the_limit_to_four_above_it)
{
    static const double zeta[] = { 0.005,  0.005,  0.0061, 0.0059, 0.005,
                                   0.0139, 0.0141, 0.0141, 0.005 };
    static const char *const told[] = {
        "", "", "", "damping_below+1;", "", "", "damping_below-1;", "", "damping_below+1;"
    };
    struct alarms *a = rules("{\"damping_below\":0.01}");
    const double hz = 1;

    for (int i = 0; i < 9; i++)
        CHECK(strcmp(edges_of(a, i, 1, &hz, &zeta[i], 0.001, "true"), told[i]) == 0);
    CHECK(strcmp(edges_of(a, 9, 0, &hz, zeta, 0, "null"), "") == 0);   /* gone for one hop */
    CHECK(strcmp(edges_of(a, 10, 0, &hz, zeta, 0, "null"), "damping_below-;") == 0);
    alarms_free(a);
}

TEST(a_mode_is_new_once_no_sample_is_shared_with_the_window_that_showed_it_first)
{
    const double hz[] = { 1, 3 }, zeta[] = { 0.01, 0.01 };
    struct alarms *a = rules("{\"new_mode\":true}");

    for (int i = 0; i < 3; i++)
        CHECK(strcmp(edges_of(a, i, 1, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 3, 2, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 4, 1, hz, zeta, 0.001, "true"), "") == 0); /* a flicker begins again */
    CHECK(strcmp(edges_of(a, 5, 2, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 6, 2, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 7, 2, hz, zeta, 0.001, "true"), "new_mode+3;") == 0);
    CHECK(strcmp(edges_of(a, 8, 1, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 9, 2, hz, zeta, 0.001, "true"), "") == 0);   /* and is not new again */
    alarms_reset(a);
    for (int i = 0; i < 4; i++)
        /* another epoch: there from the start */
        CHECK(strcmp(edges_of(a, i, 2, hz, zeta, 0.001, "true"), "") == 0);
    alarms_free(a);
}

TEST(a_gap_interrupts_what_does_not_count_yet)
{
    const double hz[] = { 1, 3 }, zeta[] = { 0.01, 0.01 };
    struct alarms *a = rules("{\"new_mode\":true}");

    for (int i = 0; i < 3; i++)
        edges_of(a, i, 1, hz, zeta, 0.001, "true");
    CHECK(strcmp(edges_of(a, 3, 2, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 50, 2, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 51, 2, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 52, 2, hz, zeta, 0.001, "true"), "new_mode+3;") == 0);
    alarms_free(a);
}

/* As after a full disk that took samples back: what windows 10 and 11 showed is not known of the
 * samples that come under the numbers of window 3. */
TEST(windows_that_go_back_begin_anew)
{
    const double hz[] = { 1, 3, 5 }, zeta[] = { 0.01, 0.01, 0.01 };
    struct alarms *a = rules("{\"new_mode\":true}");

    CHECK(strcmp(edges_of(a, 10, 1, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 11, 2, hz, zeta, 0.001, "true"), "") == 0);
    for (int i = 3; i < 6; i++)
        /* there from the start */
        CHECK(strcmp(edges_of(a, i, 2, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 6, 3, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 7, 3, hz, zeta, 0.001, "true"), "") == 0);
    CHECK(strcmp(edges_of(a, 8, 3, hz, zeta, 0.001, "true"), "new_mode+5;") == 0);
    alarms_free(a);
}

TEST(growth_is_told_when_the_verdict_turns_and_not_while_it_is_undecided)
{
    static const char *const verdicts[] = { "true",  "null", "false", "null",
                                            "false", "true", "null",  "false" };
    static const char *const told[] = { "", "", "growth+1;", "", "", "growth-1;", "", "growth+1;" };
    struct alarms *a = rules("{\"growth\":true}");
    const double hz = 1, zeta = -0.01;

    for (int i = 0; i < 8; i++)
        CHECK(strcmp(edges_of(a, i, 1, &hz, &zeta, 0.001, verdicts[i]), told[i]) == 0);
    alarms_free(a);
}

TEST(rules_that_are_none_name_their_field_and_no_rules_are_no_alarms)
{
    static const struct { const char *text, *field;
    } bad[] = {
        { "[]", "window.alarms" },
        { "{\"damping\":0.1}", "window.alarms.damping" },
        { "{\"damping_below\":\"x\"}", "window.alarms.damping_below" },
        { "{\"damping_below\":2}", "window.alarms.damping_below" },
        { "{\"growth\":1}", "window.alarms.growth" },
        { "{\"new_mode\":null}", "window.alarms.new_mode" },
    };
    struct modal_error err;
    struct alarms *a = NULL;
    cJSON *o;

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        o = cJSON_Parse(bad[i].text);
        CHECK(alarms_new(o, WINDOW, &a, &err) == MODAL_BAD_INPUT && a == NULL &&
              strcmp(err.field, bad[i].field) == 0);
        cJSON_Delete(o);
    }
    o = cJSON_Parse("{\"growth\":true}");
    CHECK(alarms_new(o, 0, &a, &err) == MODAL_BAD_INPUT && a == NULL);
    cJSON_Delete(o);
    o = cJSON_Parse("{\"growth\":false}");
    CHECK(alarms_new(o, WINDOW, &a, &err) == MODAL_OK && a == NULL &&
          alarms_judge(a, 0, 199, o) == NULL);
    cJSON_Delete(o);
    CHECK(alarms_new(NULL, WINDOW, &a, &err) == MODAL_OK && a == NULL);
}

/* ---- on live windows ---- */

struct told { int raised[3], cleared[3]; int at[3]; /* the window of the first raised */ };
static const char *const names[] = { "damping_below", "growth", "new_mode" };

static struct told judge(const double *y, int samples, const char *text)
{
    struct batch shape = { .samples = WINDOW, .channels = 1, .dt = DT };
    struct alarms *a = rules(text);
    struct told t = { .at = { -1, -1, -1 } };
    struct live *live = NULL;

    CHECK(live_new(NULL, &shape, HOP, &live, NULL) == MODAL_OK);
    for (int i = 0; i * HOP + WINDOW <= samples; i++) {
        cJSON *document = NULL, *edges, *e;
        if (live_next(live, 0, (uint64_t)(i * HOP + WINDOW - 1),
                      y + (i == 0 ? 0 : WINDOW + (i - 1) * HOP), i == 0 ? WINDOW : HOP,
                      &document, NULL) != MODAL_OK)
            continue;
        edges = alarms_judge(a, (uint64_t)(i * HOP), (uint64_t)(i * HOP + WINDOW - 1), document);
        cJSON_ArrayForEach(e, edges)
            for (int k = 0; k < 3; k++) {
                bool up = strcmp(cJSON_GetObjectItem(e, "state")->valuestring, "raised") == 0;
                if (strcmp(cJSON_GetObjectItem(e, "rule")->valuestring, names[k]) != 0)
                    continue;
                t.raised[k] += up, t.cleared[k] += !up;
                t.at[k] = up && t.at[k] < 0 ? i : t.at[k];
            }
        cJSON_Delete(edges);
        cJSON_Delete(document);
    }
    live_free(live);
    alarms_free(a);
    return t;
}

static const char *const all = "{\"damping_below\":0.005,\"growth\":true,\"new_mode\":true}";

/* White noise has no modes; what an identification finds in it must not be low, grow, or be new. */
TEST(noise_alone_raises_nothing_in_two_hundred_seeds)
{
    enum { N = 900 };
    double y[N];
    int raised = 0;

    for (uint64_t seed = 0; seed < 200; seed++) {
        struct random r = { 1000 + seed };
        struct told t;
        for (int k = 0; k < N; k++)
            y[k] = random_normal(&r);
        t = judge(y, N, all);
        for (int k = 0; k < 3; k++)
            raised += t.raised[k];
    }
    CHECK(raised == 0);
}

static void vibrate(double *y, int samples, int from, double hz, double zeta, double size)
{
    double w = 2 * M_PI * hz, t;

    for (int k = from; k < samples; k++) {
        t = (k - from) * DT;
        y[k] += size * exp(-zeta * w * t) * cos(w * t);
    }
}

/* zeta = 0.002 under a limit of 0.005, in noise of a hundredth; a second one begins at sample 400,
 * so that the first window that may show it is number 3, 300 .. 499, and it counts two hops after
 * the first that does. */
TEST(what_is_due_is_told_and_nothing_else)
{
    enum { N = 1400 };

    for (uint64_t seed = 0; seed < 20; seed++) {
        double low[N] = { 0 }, high[N] = { 0 }, two[N] = { 0 }, grows[N] = { 0 };
        struct random r = { 5000 + seed };
        struct told t;
        vibrate(low, N, 0, 1.0, 0.002, 1), vibrate(high, N, 0, 1.0, 0.008, 1),
            vibrate(two, N, 0, 1.0, 0.001, 1), vibrate(two, N, 400, 2.7, 0.001, 1);
        vibrate(grows, N, 0, 1.0, -0.002, 0.3);
        for (int k = 0; k < N; k++)
            low[k] += 0.01 * random_normal(&r), high[k] += 0.01 * random_normal(&r),
                two[k] += 0.01 * random_normal(&r), grows[k] += 0.01 * random_normal(&r);
        t = judge(low, N, all);
        CHECK(t.raised[0] == 1 && t.cleared[0] == 0 && t.at[0] == 2 && t.raised[1] == 0 &&
              t.raised[2] == 0);
        t = judge(high, N, "{\"damping_below\":0.005,\"growth\":true}");
        CHECK(t.raised[0] == 0 && t.raised[1] == 0);
        t = judge(two, N, "{\"new_mode\":true}");
        CHECK(t.raised[2] == 1 && t.at[2] >= 5 && t.at[2] <= 6);
        t = judge(grows, N, "{\"growth\":true}");
        CHECK(t.raised[1] == 1 && t.at[1] <= 1);
    }
}
