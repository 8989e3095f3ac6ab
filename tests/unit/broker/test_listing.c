/* LIST in a core of 5000 jobs: what a step looks at, whose turn it is, and what comes of it. */
#include "broker/core/state.h"
#include "check.h"
#include "wire/frame.h"
#include <stdlib.h>
#include <string.h>

enum { JOBS = 5000, PEERS = 8, ONES = 7 };   /* ONES: the connection of one, an admin */

static struct core *core;
static const struct moment now = { 1000 * SECOND, INT64_C(1790000000) * SECOND };
static struct account accounts[] = {
    { .key = "", .user = "one", .role = WIRE_ROLE_ADMIN, .weight = 1 },
    { .key = "second", .user = "two", .role = WIRE_ROLE_SUBMIT, .weight = 1 },
};
static struct settings settings;

/* What each peer was told since `forget`. */
static struct { int replies, errors; char code[16]; cJSON *page; } told[PEERS];

static void forget(void)
{
    for (int i = 0; i < PEERS; i++)
        cJSON_Delete(told[i].page);
    memset(told, 0, sizeof told);
}

static void tell(const struct action *a)
{
    cJSON *header = cJSON_Parse(a->header);

    if (strcmp(a->verb, "ERROR") == 0) {
        told[a->peer].errors++;
        snprintf(told[a->peer].code, sizeof told[a->peer].code, "%s",
                 cJSON_GetObjectItem(cJSON_GetObjectItem(header, "error"), "code")->valuestring);
    } else
        told[a->peer].replies++;
    if (a->body != NULL) {
        cJSON_Delete(told[a->peer].page);
        told[a->peer].page = cJSON_ParseWithLength(a->body->data, a->body->size);
    }
    cJSON_Delete(header);
}

static void carry_out(const struct actions *all)
{
    for (size_t i = 0; i < all->count; i++) {
        const struct action *a = &all->items[i];
        if (a->type == ACT_SEND)
            tell(a);
        CHECK(a->type != ACT_COMMIT && a->type != ACT_TASK);
        free(a->header);
        blob_drop(a->body);
    }
}

static void run(struct event e)
{
    carry_out(core_step(core, &e, now));
}

/* Of PEER, who is two but for one. */
static void ask(uint64_t peer, const char *verb, const char *header)
{
    struct wire_frame frames[] = { { WIRE_VERSION, 7 }, { verb, strlen(verb) },
                                   { header, strlen(header) } };
    struct wire_message m;

    CHECK(wire_open(frames, 3, WIRE_VERSION, true, &m, NULL) == MODAL_OK);
    run((struct event) { .type = EVENT_REQUEST, .peer = peer, .key = peer == ONES ? "" : "second",
                         .message = &m, .verb = m.verb, .id = m.id });
    wire_close(&m);
}

/* Steps until nothing is due. */
static int rest(void)
{
    int steps = 0;

    for (; core_next_ns(core) == 0 && steps < 100000; steps++)
        run((struct event) { .type = EVENT_TIME });
    return steps;
}

/* Jobs of two, cancelled, "k0000" and so on; every seventh is "m..." and done. */
static void open_core(void)
{
    struct ledger_visitor v;
    char key[16];

    settings = (struct settings) { .accounts = accounts, .account_count = 2, .queue_jobs = 20,
                                   .result_age_ns = 86400 * SECOND, .events_kept = 1024,
                                   .jobs_kept = 1 << 20, .result_bytes = 1 << 30, .secret = 77 };
    core = core_new(&settings, now);
    core_visitor(core, &v);
    for (int i = 0; i < JOBS; i++) {
        const struct job_record job = {
            .id = i + 1, .user = "two", .key = key, .kind = "steady", .options = "{}",
            .state = i % 7 == 0 ? JOB_DONE : JOB_CANCELLED, .submitted_ns = now.utc_ns,
            .finished_ns = now.utc_ns, .result_bytes = i % 7 == 0 };
        snprintf(key, sizeof key, "%c%04d", i % 7 == 0 ? 'm' : 'k', i);
        CHECK(v.job(v.context, &job) == MODAL_OK);
    }
    carry_out(core_loaded(core, now));
    rest();
    forget();
}

static void close_core(void)
{
    forget();
    core_free(core);
}

static const char *member(int at, const char *name)
{
    const cJSON *jobs = cJSON_GetObjectItem(told[1].page, "jobs");

    return cJSON_GetObjectItem(cJSON_GetArrayItem(jobs, at), name)->valuestring;
}

TEST(a_list_that_looks_at_all_jobs_takes_many_steps_and_others_are_answered_between)
{
    open_core();
    for (int newest = 0; newest < 2; newest++) {
        ask(1, "LIST", newest ? "{\"id\":1,\"key\":\"k2500\",\"newest\":true}"
                              : "{\"id\":1,\"key\":\"k2500\"}");
        CHECK(told[1].replies == 0 && core_next_ns(core) == 0);
        ask(2, "HELLO", "{\"id\":2}");
        CHECK(told[1].replies == 0 && told[2].replies == 1);
        CHECK(rest() >= 2 && told[1].replies == 1 && told[1].errors == 0);
        CHECK(cJSON_GetArraySize(cJSON_GetObjectItem(told[1].page, "jobs")) == 1);
        CHECK_STRING(member(0, "key"), "k2500");
        CHECK(cJSON_IsNull(cJSON_GetObjectItem(told[1].page, "next")));
        forget();
    }
    ask(1, "LIST", "{\"id\":1,\"limit\":1000}");
    CHECK(told[1].replies == 1);
    close_core();
}

TEST(pages_of_a_filter_have_each_job_once_in_order)
{
    char header[120], next[16] = "", key[16];
    int seen = 0, pages = 0;

    open_core();
    do {
        snprintf(header, sizeof header, "{\"id\":1,\"state\":\"done\",\"limit\":200%s%s%s}",
                 next[0] != 0 ? ",\"after\":\"" : "", next, next[0] != 0 ? "\"" : "");
        ask(1, "LIST", header);
        rest();
        CHECK(told[1].replies == ++pages);
        for (int i = 0; i < cJSON_GetArraySize(cJSON_GetObjectItem(told[1].page, "jobs")); i++) {
            snprintf(key, sizeof key, "m%04d", 7 * seen++);
            CHECK_STRING(member(i, "key"), key);
        }
        snprintf(next, sizeof next, "%s",
                 cJSON_IsNull(cJSON_GetObjectItem(told[1].page, "next"))
                     ? "" : cJSON_GetObjectItem(told[1].page, "next")->valuestring);
    } while (next[0] != 0);
    CHECK(seen == (JOBS + 6) / 7 && pages == (seen + 199) / 200);
    close_core();
}

TEST(who_is_gone_or_admitted_no_more_is_told_no_page)
{
    struct settings fewer;

    open_core();
    ask(1, "LIST", "{\"id\":1,\"key\":\"none\"}");
    ask(2, "LIST", "{\"id\":1,\"key\":\"none\"}");
    run((struct event) { .type = EVENT_PEER_GONE, .peer = 1 });
    rest();
    CHECK(told[1].replies + told[1].errors == 0 && told[2].replies == 1);
    ask(1, "LIST", "{\"id\":1,\"key\":\"none\"}");
    fewer = settings;
    fewer.account_count = 1;
    run((struct event) { .type = EVENT_SETTINGS, .settings = &fewer });
    rest();
    CHECK(told[1].replies == 0 && told[1].errors == 1);
    CHECK_STRING(told[1].code, "denied");
    close_core();
}

/* One, an admin, asks for what two has. */
TEST(a_thousand_lists_of_one_user_keep_another_s_one_as_long_as_two_would)
{
    enum { MOST = 1024 };
    int alone, steps = 0;

    open_core();
    ask(ONES, "LIST", "{\"id\":1,\"user\":\"two\",\"key\":\"none\"}");
    alone = 1 + rest();
    CHECK(alone > 1 && told[ONES].replies == 1);
    forget();
    for (int i = 0; told[1].errors == 0 && i < 2 * MOST; i++)
        ask(1, "LIST", "{\"id\":1,\"key\":\"none\"}");
    CHECK(told[1].errors == 1);
    CHECK_STRING(told[1].code, "busy");
    ask(ONES, "LIST", "{\"id\":1,\"user\":\"two\",\"key\":\"none\"}");
    for (; told[ONES].replies == 0 && steps < 10 * alone; steps++)
        run((struct event) { .type = EVENT_TIME });
    CHECK(told[ONES].replies == 1 && steps <= 2 * alone + 2);
    rest();
    CHECK(told[1].errors == 1);
    close_core();
}
