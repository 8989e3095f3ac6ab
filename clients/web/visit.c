/* visit.c - see visit.h */
#include "visit.h"
#include <stdlib.h>
#include <string.h>
#include "link.h"

#define RETRY_AFTER_S "2"        /* a restart of the daemon takes about as long */

struct visit *visit_new(struct site *site, struct MHD_Connection *connection)
{
    struct visit *visit = calloc(1, sizeof *visit);

    if (visit != NULL) {
        visit->site = site;
        visit->connection = connection;
    }
    return visit;
}

void visit_free(struct visit *visit)
{
    if (visit == NULL)
        return;
    cJSON_Delete(visit->doc);
    free(visit->body);
    free(visit);
}

bool visit_argument(const struct visit *visit, const char *key, char out[URL_NAME_MOST + 1])
{
    const char *text = MHD_lookup_connection_value(visit->connection, MHD_GET_ARGUMENT_KIND, key);

    if (text != NULL && url_decode(text, strlen(text), out))
        return true;
    out[0] = 0;
    return false;
}

const char *visit_header(const struct visit *visit, const char *key)
{
    return MHD_lookup_connection_value(visit->connection, MHD_HEADER_KIND, key);
}

void visit_end(struct visit *visit, unsigned status, const char *type, char *body, size_t length)
{
    visit->status = body != NULL ? status : MHD_HTTP_INTERNAL_SERVER_ERROR;
    visit->type = type;
    visit->body = body;
    visit->length = body != NULL ? length : 0;
    visit->ready = true;
    if (visit->waiting)
        MHD_resume_connection(visit->connection);
    visit->waiting = false;
}

void visit_end_page(struct visit *visit, unsigned status, struct html *html)
{
    size_t length;
    char *text = html_end(html, &length);

    visit_end(visit, status, "text/html; charset=utf-8", text, length);
}

void visit_fail(struct visit *visit, unsigned status, const char *title, const char *text)
{
    bool away = status == MHD_HTTP_SERVICE_UNAVAILABLE;
    struct html html;

    if (!html_begin(&html)) {
        visit_end(visit, status, "text/plain", NULL, 0);
        return;
    }
    html_head(&html, &(struct html_head) { .title = title, .poll = away ? 2 : 0 });
    html_raw(&html, "<p>");
    html_text(&html, text);
    html_raw(&html, "</p>\n");
    html_foot(&html);
    visit_end_page(visit, status, &html);
}

void visit_fail_by(struct visit *visit, const struct link_message *answer)
{
    static const struct { enum modal_status rc; unsigned status; const char *title; } table[] = {
        { MODAL_NOT_FOUND, MHD_HTTP_NOT_FOUND, "Not found" },
        { MODAL_BAD_INPUT, MHD_HTTP_NOT_FOUND, "Not found" },
        { MODAL_EXPIRED, MHD_HTTP_GONE, "Gone" },
        { MODAL_CONFLICT, MHD_HTTP_CONFLICT, "Not now" },
        { MODAL_DENIED, MHD_HTTP_FORBIDDEN, "Not allowed" },
    };
    struct modal_error err = { 0 };

    if (answer == NULL) {
        visit_fail(visit, MHD_HTTP_SERVICE_UNAVAILABLE, "The daemon is away",
                   "modald does not answer. This page tries again by itself.");
        return;
    }
    link_error(answer, NULL, &err);
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++)
        if (table[i].rc == err.status) {
            visit_fail(visit, table[i].status, table[i].title, err.message);
            return;
        }
    visit_fail(visit, MHD_HTTP_SERVICE_UNAVAILABLE, "Not now", err.message);
}

void visit_wait(struct visit *visit)
{
    visit->waiting = visit->waited = true;
    MHD_suspend_connection(visit->connection);
}

void visit_guard(struct MHD_Response *response)
{
    static const struct { const char *name, *value; } headers[] = {
        { "Content-Security-Policy",
          "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
          "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'" },
        { "X-Content-Type-Options", "nosniff" },
        { "X-Frame-Options", "DENY" },
        { "Referrer-Policy", "no-referrer" },
        { "Cross-Origin-Opener-Policy", "same-origin" },
        { "Cross-Origin-Resource-Policy", "same-origin" },
        { "Cache-Control", "no-store" },
    };

    for (size_t i = 0; i < sizeof headers / sizeof headers[0]; i++)
        MHD_add_response_header(response, headers[i].name, headers[i].value);
}

enum MHD_Result visit_send(struct visit *visit)
{
    enum MHD_ResponseMemoryMode whose = visit->body != NULL ? MHD_RESPMEM_MUST_FREE
                                                            : MHD_RESPMEM_PERSISTENT;
    struct MHD_Response *response = MHD_create_response_from_buffer(visit->length, visit->body,
                                                                    whose);
    enum MHD_Result rc;

    if (response == NULL)
        return MHD_NO;
    visit->body = NULL;                              /* the response's now */
    visit_guard(response);
    MHD_add_response_header(response, "Content-Type", visit->type);
    if (visit->status == MHD_HTTP_SERVICE_UNAVAILABLE)
        MHD_add_response_header(response, "Retry-After", RETRY_AFTER_S);
    if (visit->status == MHD_HTTP_METHOD_NOT_ALLOWED)
        MHD_add_response_header(response, "Allow", "GET, HEAD");
    rc = MHD_queue_response(visit->connection, visit->status, response);
    MHD_destroy_response(response);
    return rc;
}
