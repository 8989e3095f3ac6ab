/* front.c - see front.h */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "ctl/field.h"
#include "site.h"
#include "stream_page.h"

enum {
    FRONT_JOBS = 50,             /* a screen or two */
    SAMPLE_S = 10,               /* between the counters that a rate is made of, or more */
    MINUTE_S = 60,               /* over which events are counted */
};

static const double pause_s = 0.1;       /* from one asking to the next */

/* ------------------------------------------------------------------ what the daemon's text says */

/* The value of the line of METRICS that begins with NAME; NAN: there is none. */
static double metric(const char *metrics, const char *name)
{
    size_t length = strlen(name);

    for (const char *line = metrics; line != NULL; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (strncmp(line, name, length) == 0 && line[length] == ' ')
            return strtod(line + length + 1, NULL);
    }
    return NAN;
}

/* The value of a label at TEXT, up to its closing quote, into OUT as it was meant. */
static void read_label(const char *text, char *out, size_t room)
{
    size_t used = 0;

    for (; *text != '"' && *text != '\n' && *text != 0 && used + 1 < room; text++) {
        if (*text == '\\' && text[1] != 0)
            text++;
        out[used++] = *text;
    }
    out[used] = 0;
}

static void show_users(struct html *html, const char *metrics)
{
    static const char *const heads[] = { "user", "CPU today, s", "stored, MB", NULL };
    static const char cpu[] = "modald_user_cpu_seconds{user=\"",
                      stored[] = "modald_user_stored_bytes";
    char name[SERVICE_WORD_MOST + 1], label[2 * SERVICE_WORD_MOST + 64];

    html_section(html, "users", "Users");
    html_table(html, "Users", heads);
    for (const char *line = metrics; (line = strstr(line, cpu)) != NULL;) {
        const char *end = line + strcspn(line, "\n"), *labels = strchr(line, '{'),
                   *space = memrchr(line, ' ', (size_t)(end - line));
        read_label(line + sizeof cpu - 1, name, sizeof name);
        html_raw(html, "<tr><th scope=\"row\">");
        html_text(html, name);
        html_raw(html, "</th><td>");
        html_number(html, space != NULL ? strtod(space, NULL) : NAN);
        html_raw(html, "</td><td>");
        snprintf(label, sizeof label, "%s%.*s", stored, space ? (int)(space - labels) : 0, labels);
        html_number(html, metric(metrics, label) / 1e6);
        html_raw(html, "</td></tr>\n");
        line = end;
    }
    html_table_end(html);
    html_section_end(html);
}

/* ------------------------------------------------------------------ the parts */

/* TERM and a value in words, as one pair of a list. */
static void pair(struct html *html, const char *term)
{
    html_raw(html, "</dd><dt>");
    html_text(html, term);
    html_raw(html, "</dt><dd>");
}

static void show_machine(struct html *html, const struct site *site)
{
    const struct front *f = &site->front;
    const cJSON *workers = field_get(f->stats, "workers");
    double s = f->last.at - f->before.at, since = (double)time(NULL) - MINUTE_S;

    html_section(html, "machine", "Machine");
    html_raw(html, "<dl class=\"facts\"><dt>workers</dt><dd>");
    html_format(html, "%.0f of %.0f busy, %.0f died", field_number(workers, "busy", 0),
                field_number(workers, "total", 0), field_number(workers, "deaths", 0));
    pair(html, "disk");
    html_format(html, "%.6g MB of inputs and results, ledger %.6g MB%s",
                metric(f->metrics, "modald_stored_bytes") / 1e6,
                metric(f->metrics, "modald_ledger_bytes") / 1e6,
                cJSON_IsTrue(field_get(f->stats, "storage_full")) ? ": FULL" : "");
    pair(html, "rates");
    if (s > 0)
        html_format(html, "%.3g attempts/s, %.3g windows/s, in %.3g kB/s, out %.3g kB/s",
                    (f->last.attempts - f->before.attempts) / s,
                    (f->last.windows - f->before.windows) / s,
                    (f->last.received - f->before.received) / s / 1e3,
                    (f->last.sent - f->before.sent) / s / 1e3);
    else
        html_raw(html, "-");
    pair(html, "events");
    html_format(html, "%d windows, %d edges of jobs, %d alarms in the last minute",
                feed_count(site->service.feed, "modes", since),
                feed_count(site->service.feed, "state", since),
                feed_count(site->service.feed, "alarm", since));
    pair(html, "daemon");
    html_format(html, "%s, up %.0f s, user %s, role %s", site->service.server,
                field_real(f->stats, "uptime_s"), site->service.user, site->service.role);
    html_raw(html, "</dd></dl>\n");
    html_section_end(html);
}

static void show_stream(struct html *html, const struct board_stream *s)
{
    const struct board_mode *least = NULL;

    for (int i = 0; i < s->modes; i++)
        if (least == NULL || s->mode[i].zeta < least->zeta)
            least = &s->mode[i];
    html_raw(html, s->alarms > 0 ? "<tr class=\"alarm\"><th scope=\"row\">"
                                 : "<tr><th scope=\"row\">");
    html_link(html, "/streams/", s->name);
    html_raw(html, "</th><td>");
    stream_page_verdict(html, s);
    html_raw(html, "</td><td>");
    if (least != NULL)
        html_format(html, "%.6g Hz, \xce\xb6 %.5g \xc2\xb1 %.1e [%.0f]", least->hertz, least->zeta,
                    least->zeta_std, least->track);
    html_raw(html, "</td><td>");
    html_format(html, "%.0f", s->mode_count);
    html_raw(html, "</td><td>");
    stream_page_alarms(html, s);
    html_raw(html, "</td><td>");
    html_number(html, s->lag);
    html_raw(html, "</td><td>");
    html_number(html, s->skipped);
    html_raw(html, "</td><td>");
    html_number(html, s->gaps);
    html_raw(html, "</td><td>");
    html_instant(html, s->heard);
    html_raw(html, "</td></tr>\n");
}

static void show_streams(struct html *html, const struct board *board)
{
    static const char *const heads[] = { "stream", "verdict", "least damped [track]", "modes",
                                         "alarms", "lag", "skipped", "gaps", "heard", NULL };

    html_section(html, "streams", "Streams");
    if (board->streams == 0)
        html_raw(html, "<p>No windows of streams were told of late.</p>\n");
    else {
        html_table(html, "Live streams", heads);
        for (int i = 0; i < board->streams; i++)
            show_stream(html, board->stream[i]);
        html_table_end(html);
    }
    html_section_end(html);
    if (board->edges > 0) {
        html_section(html, "alarms", "Alarms");
        stream_page_edges(html, board, "");
        html_section_end(html);
    }
}

static void show_job(struct html *html, const cJSON *doc)
{
    const char *state = field_word(doc, "state", "-");
    const cJSON *error = field_get(doc, "error");

    html_raw(html, "<tr><th scope=\"row\">");
    html_link(html, "/jobs/", field_word(doc, "job", "-"));
    html_raw(html, "</th><td>");
    html_text(html, field_word(doc, "key", ""));
    html_raw(html, "</td><td>");
    html_text(html, field_word(doc, "user", ""));
    html_raw(html, "</td><td>");
    html_text(html, field_word(doc, "kind", "-"));
    html_raw(html, "</td><td class=\"");
    html_text(html, state);
    html_raw(html, "\">");
    html_text(html, state);
    if (error != NULL)
        html_format(html, ": %s", field_word(error, "code", "-"));
    html_raw(html, "</td><td>");
    html_number(html, field_real(doc, "attempts"));
    html_raw(html, "</td><td>");
    html_instant(html, field_real(doc, "submitted"));
    html_raw(html, "</td><td>");
    html_number(html, field_real(doc, "finished") - field_real(doc, "started"));
    html_raw(html, "</td></tr>\n");
}

static void show_jobs(struct html *html, const cJSON *page, const char *state)
{
    static const char *const heads[] = { "job", "key", "user", "kind", "state", "attempts",
                                         "submitted, UTC", "took, s", NULL };
    const cJSON *doc;
    const char *next = field_word(page, "next", NULL);
    char cursor[3 * URL_NAME_MOST + 1];

    html_table(html, "Jobs, the newest first", heads);
    cJSON_ArrayForEach(doc, field_get(page, "jobs"))
        show_job(html, doc);
    html_table_end(html);
    if (next == NULL)
        return;
    url_escape(next, cursor);
    html_raw(html, "<p><a href=\"/?after=");
    html_text(html, cursor);
    if (state[0] != 0) {
        html_raw(html, "&amp;state=");
        html_text(html, state);
    }
    html_raw(html, "\">earlier jobs</a></p>\n");
}

static void show_queue(struct html *html, const struct front *f)
{
    static const char *const states[] = { "queued", "running", "done", "failed", "cancelled",
                                          "dead" };
    const cJSON *counts = field_get(f->stats, "jobs");

    html_section(html, "queue", "Queue");
    html_raw(html, "<ul class=\"counts\">");
    for (size_t i = 0; i < sizeof states / sizeof states[0]; i++) {
        fprintf(html->file, "<li><a href=\"/?state=%s\">%s <b>%.0f</b></a></li>", states[i],
                states[i], field_real(counts, states[i]));
    }
    html_raw(html, "</ul>\n<p>");
    html_format(html, "The oldest that may start waits %.3g s%s.",
                field_number(field_get(f->stats, "queue"), "oldest_s", 0),
                cJSON_IsTrue(field_get(f->stats, "draining")) ? "; the daemon drains" : "");
    html_raw(html, "</p>\n");
    show_jobs(html, f->jobs, "");
    html_section_end(html);
}

static void show(struct visit *visit)
{
    struct site *site = visit->site;
    struct html html;

    if (!html_begin(&html)) {
        visit_end(visit, MHD_HTTP_INTERNAL_SERVER_ERROR, "text/plain", NULL, 0);
        return;
    }
    html_head(&html, &(struct html_head) { .title = "At a glance",
                                           .poll = site->service.board.streams > 0 ? 2 : 5,
                                           .events = "/events?kinds=state,track,alarm" });
    show_streams(&html, &site->service.board);
    show_queue(&html, &site->front);
    show_machine(&html, site);
    show_users(&html, site->front.metrics);
    html_foot(&html);
    visit_end_page(visit, MHD_HTTP_OK, &html);
}

/* ------------------------------------------------------------------ the answers it is made of */

void front_done(struct front *front)
{
    cJSON_Delete(front->stats);
    cJSON_Delete(front->jobs);
    free(front->metrics);
}

static void take_sample(struct front *f)
{
    struct front_sample now = { link_now(), metric(f->metrics, "modald_attempts_total"),
                                metric(f->metrics, "modald_windows_total"),
                                metric(f->metrics, "modald_received_bytes_total"),
                                metric(f->metrics, "modald_sent_bytes_total") };

    if (f->last.at == 0 || now.attempts < f->last.attempts)
        f->before = f->last = now;                   /* the first, or a daemon that began anew */
    else if (now.at > f->last.at + SAMPLE_S) {
        f->before = f->last;
        f->last = now;
    }
}

/* Answer ALL of a list. */
static void tell(struct visit **all, bool failed)
{
    while (*all != NULL) {
        struct visit *visit = *all;
        *all = visit->next;
        if (failed)
            visit_fail_by(visit, NULL);
        else
            show(visit);
    }
}

void front_fail(struct front *front)
{
    tell(&front->waiting, true);
}

/* One answer more is here, or will not come. */
static void on_part(struct front *f, bool good)
{
    f->failed |= !good;
    if (--f->due > 0)
        return;
    if (!f->failed)
        take_sample(f);
    tell(&f->served, f->failed);
}

static bool is_reply(const struct link_message *answer)
{
    return answer != NULL && answer->type == LINK_REPLY;
}

static void on_stats(void *context, const struct link_message *answer)
{
    struct site *site = context;

    if (is_reply(answer)) {
        cJSON_Delete(site->front.stats);
        site->front.stats = cJSON_Duplicate(answer->header, true);
    }
    on_part(&site->front, is_reply(answer) && site->front.stats != NULL);
}

static void on_list(void *context, const struct link_message *answer)
{
    struct site *site = context;
    cJSON *page = NULL;
    bool good = is_reply(answer) && answer->body != NULL
             && json_read(answer->body, answer->length, &page, NULL) == MODAL_OK;

    if (good) {
        cJSON_Delete(site->front.jobs);
        site->front.jobs = page;
    }
    on_part(&site->front, good);
}

static void on_metrics(void *context, const struct link_message *answer)
{
    struct site *site = context;
    char *text = is_reply(answer) && answer->body != NULL ? strdup(answer->body) : NULL;

    if (text != NULL) {
        free(site->front.metrics);
        site->front.metrics = text;
    }
    on_part(&site->front, text != NULL);
}

static cJSON *list_header(const char *after, const char *state)
{
    cJSON *header = cJSON_CreateObject();

    cJSON_AddNumberToObject(header, "limit", FRONT_JOBS);
    cJSON_AddTrueToObject(header, "newest");
    if (after[0] != 0)
        cJSON_AddStringToObject(header, "after", after);
    if (state[0] != 0)
        cJSON_AddStringToObject(header, "state", state);
    return header;
}

/* Ask for all parts; those that cannot be asked for now are told so at once. */
static void ask_all(struct site *site)
{
    struct ask *a = &site->service.ask;

    site->front.due = 3;
    site->front.failed = false;
    site->front.asked = link_now();
    site->front.served = site->front.waiting;
    site->front.waiting = NULL;
    if (!ask(a, "STATS", cJSON_CreateObject(), on_stats, site))
        on_part(&site->front, false);
    if (!ask(a, "LIST", list_header("", ""), on_list, site))
        on_part(&site->front, false);
    if (!ask(a, "METRICS", cJSON_CreateObject(), on_metrics, site))
        on_part(&site->front, false);
}

static void on_page(void *context, const struct link_message *answer)
{
    struct visit *visit = context;
    char state[URL_NAME_MOST + 1];
    cJSON *page = NULL;
    struct html html;

    if (!is_reply(answer) || answer->body == NULL
        || json_read(answer->body, answer->length, &page, NULL) != MODAL_OK
        || !html_begin(&html)) {
        cJSON_Delete(page);
        visit_fail_by(visit, answer);
        return;
    }
    visit_argument(visit, "state", state);
    html_head(&html, &(struct html_head) { .title = state[0] != 0 ? state : "Earlier jobs" });
    html_section(&html, "queue", "Jobs");
    show_jobs(&html, page, state);
    html_section_end(&html);
    html_foot(&html);
    cJSON_Delete(page);
    visit_end_page(visit, MHD_HTTP_OK, &html);
}

void front_show(struct visit *visit)
{
    struct site *site = visit->site;
    struct front *f = &site->front;
    char after[URL_NAME_MOST + 1], state[URL_NAME_MOST + 1];

    if (visit_argument(visit, "after", after) | visit_argument(visit, "state", state)) {
        if (ask(&site->service.ask, "LIST", list_header(after, state), on_page, visit))
            visit_wait(visit);
        else
            visit_fail_by(visit, NULL);
        return;
    }
    visit->next = f->waiting;
    f->waiting = visit;
    visit_wait(visit);
    front_step(site);
}

void front_step(struct site *site)
{
    const struct front *f = &site->front;

    if (f->waiting != NULL && f->due == 0 && link_now() >= f->asked + pause_s)
        ask_all(site);
}
