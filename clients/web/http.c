/* http.c - see http.h */
#include "http.h"
#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "ctl/field.h"
#include "files.h"
#include "job_page.h"
#include "site.h"
#include "stream_page.h"

static void show_file(struct visit *visit)
{
    const struct file *file = file_find(visit->url.name);
    size_t length = file != NULL ? (size_t)(file->end - file->text) : 0;
    char *copy = file != NULL ? malloc(length + 1) : NULL;

    if (file == NULL) {
        visit_fail(visit, MHD_HTTP_NOT_FOUND, "Not found", "There is no such page.");
        return;
    }
    if (copy != NULL)
        memcpy(copy, file->text, length);
    visit_end(visit, MHD_HTTP_OK, file->type, copy, length);
}

static void on_metrics(void *context, const struct link_message *answer)
{
    struct visit *visit = context;
    const struct site *site = visit->site;
    char *text = NULL;
    int length;

    if (answer == NULL || answer->type != LINK_REPLY || answer->body == NULL) {
        visit_fail_by(visit, answer);
        return;
    }
    length = asprintf(&text, "%s# HELP modald_web_readers Who hears events.\n"
                      "# TYPE modald_web_readers gauge\nmodald_web_readers %d\n"
                      "# HELP modald_web_readers_dropped_total Readers who were too slow.\n"
                      "# TYPE modald_web_readers_dropped_total counter\n"
                      "modald_web_readers_dropped_total %lu\n"
                      "# HELP modald_web_requests_total Requests.\n"
                      "# TYPE modald_web_requests_total counter\nmodald_web_requests_total %lu\n"
                      "# HELP modald_web_hung_up_total Connections without a whole request that "
                      "made room for others.\n"
                      "# TYPE modald_web_hung_up_total counter\nmodald_web_hung_up_total %lu\n",
                      answer->body, site->readers.count, site->readers.dropped, site->requests,
                      site->places.closed);
    visit_end(visit, MHD_HTTP_OK, "text/plain; version=0.0.4; charset=utf-8",
              length >= 0 ? text : NULL, length >= 0 ? (size_t)length : 0);
}

static void show_metrics(struct visit *visit)
{
    if (ask(&visit->site->service.ask, "METRICS", cJSON_CreateObject(), on_metrics, visit))
        visit_wait(visit);
    else
        visit_fail_by(visit, NULL);
}

static void show_nothing(struct visit *visit)
{
    visit_fail(visit, MHD_HTTP_NOT_FOUND, "Not found", "There is no such page.");
}

/* Two strings of our own length, without saying by the time it takes where they differ. */
static bool is_token(const char *text, const char *token)
{
    unsigned char differ = 0;

    if (text == NULL || strlen(text) != SITE_TOKEN)
        return false;
    for (size_t i = 0; i < SITE_TOKEN; i++)
        differ |= (unsigned char)(text[i] ^ token[i]);
    return differ == 0;
}

/* Did a page of ours send it, and not another's, or a form there? */
static bool is_from_here(const struct visit *visit)
{
    const char *site = visit_header(visit, "Sec-Fetch-Site"),
               *origin = visit_header(visit, "Origin");

    if (!is_token(visit_header(visit, "X-Modald-Token"), visit->site->token))
        return false;
    if (site != NULL)
        return strcmp(site, "same-origin") == 0;
    return origin != NULL && url_origin_is(origin, visit_header(visit, "Host"));
}

static void act(struct visit *visit)
{
    if (!is_from_here(visit))
        visit_fail(visit, MHD_HTTP_FORBIDDEN, "Refused",
                   "An action is taken from this page's own buttons only.");
    else
        job_page_act(visit);
}

static void show(struct visit *visit)
{
    static void (*const pages[])(struct visit *) = {
        [URL_NONE] = show_nothing, [URL_FRONT] = front_show, [URL_JOB] = job_page_show,
        [URL_PICTURE] = job_page_show, [URL_STREAM] = stream_page_show,
        [URL_METRICS] = show_metrics, [URL_FILE] = show_file, [URL_ACTION] = act,
    };

    if (!visit->site->service.here && visit->url.page != URL_FILE && visit->url.page != URL_NONE)
        visit_fail_by(visit, NULL);
    else
        pages[visit->url.page](visit);
}

/* Is the request one that is looked at further?  Else it has its answer. */
static bool is_fit(struct visit *visit, const char *path, const char *method)
{
    const struct site *site = visit->site;
    const char *host = visit_header(visit, "Host");
    bool get = strcmp(method, "GET") == 0 || strcmp(method, "HEAD") == 0,
         post = strcmp(method, "POST") == 0 && visit->url.page == URL_ACTION && site_acts(site);

    if (!url_host_is_ours(host, site->names, (size_t)site->name_count))
        visit_fail(visit, MHD_HTTP_MISDIRECTED_REQUEST, "Another host",
                   "The Host header names neither an address, nor localhost, nor a name given "
                   "with --host.");
    else if (strlen(path) > URL_MOST)
        visit_fail(visit, MHD_HTTP_URI_TOO_LONG, "Too long", "Accepted: at most 2048 bytes.");
    else if (visit->url.page == URL_ACTION ? !post : !get)
        visit_fail(visit, MHD_HTTP_METHOD_NOT_ALLOWED, "Not allowed",
                   "This page is for looking: GET and HEAD.");
    else
        return true;
    return false;
}

/* Answer VISIT now, or as soon as it can be. */
static enum MHD_Result begin(struct visit *visit)
{
    struct site *site = visit->site;

    visit->begun = true;
    places_work(&site->places, visit->connection);
    if (visit->url.page == URL_EVENTS && site->service.here)
        return readers_add(&site->readers, site->service.feed, visit);
    show(visit);
    return visit->ready && !visit->waited ? visit_send(visit) : MHD_YES;
}

/* Told of a request's headers, of each part of its body, of its end, and once more when what it
 * waits for is there.  An answer before the end closes the connection: what is refused has it. */
static enum MHD_Result handle(void *context, struct MHD_Connection *connection, const char *path,
                              const char *method, const char *version, const char *body,
                              size_t *body_length, void **state)
{
    struct visit *visit = *state;
    struct site *site = context;

    (void)version, (void)body;
    if (visit == NULL) {
        visit = *state = visit_new(site, connection);
        if (visit == NULL)
            return MHD_NO;
        site->requests++;
        visit->url = url_read(path);
        return is_fit(visit, path, method) ? MHD_YES : visit_send(visit);
    }
    if (*body_length > 0) {                    /* no page takes any */
        *body_length = 0;
        return MHD_YES;
    }
    if (!visit->begun)
        return begin(visit);
    return visit->ready ? visit_send(visit) : MHD_YES;
}

static void on_completed(void *context, struct MHD_Connection *connection, void **state,
                         enum MHD_RequestTerminationCode code)
{
    struct site *site = context;

    (void)code;
    places_rest(&site->places, connection);
    visit_free(*state);
    *state = NULL;
}

/* Escapes stay as they were sent: url.c reads them, of paths. */
static size_t leave_escapes(void *context, struct MHD_Connection *connection, char *text)
{
    (void)context, (void)connection;
    return strlen(text);
}

enum modal_status http_start(struct site *site, struct modal_error *err)
{
    const struct sockaddr_storage *at = &site->bind;
    unsigned flags = MHD_USE_EPOLL | MHD_ALLOW_SUSPEND_RESUME
                   | (at->ss_family == AF_INET6 ? MHD_USE_IPv6 : 0u);

    site->http = MHD_start_daemon(
        flags, 0, NULL, NULL, handle, site, MHD_OPTION_SOCK_ADDR, at,
        MHD_OPTION_CONNECTION_LIMIT, (unsigned)HTTP_CONNECTIONS,
        MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)HTTP_MEMORY,
        MHD_OPTION_CONNECTION_TIMEOUT, (unsigned)HTTP_IDLE_S,
        MHD_OPTION_LISTENING_ADDRESS_REUSE, 1u,
        MHD_OPTION_UNESCAPE_CALLBACK, leave_escapes, NULL,
        MHD_OPTION_NOTIFY_COMPLETED, on_completed, site,
        MHD_OPTION_NOTIFY_CONNECTION, places_note, &site->places, MHD_OPTION_END);
    if (site->http == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "bind", "cannot listen there: %s",
                                strerror(errno));
    return MODAL_OK;
}

void http_step(struct site *site)
{
    MHD_run(site->http);
}

int http_descriptor(const struct site *site)
{
    return MHD_get_daemon_info(site->http, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd;
}

double http_wait(const struct site *site, double most)
{
    MHD_UNSIGNED_LONG_LONG ms;

    return MHD_get_timeout(site->http, &ms) == MHD_YES ? fmin(1e-3 * (double)ms, most) : most;
}

void http_stop(struct site *site)
{
    readers_wake(&site->readers);
    if (site->http != NULL)
        MHD_stop_daemon(site->http);
    site->http = NULL;
}
