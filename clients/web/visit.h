/* visit.h - one request from its headers to its answer, which may have to be waited for */
#ifndef WEB_VISIT_H
#define WEB_VISIT_H
#include <microhttpd.h>
#include "base/json.h"
#include "html.h"
#include "url.h"

struct link_message;
struct site;

struct visit {
    struct MHD_Connection *connection;
    struct site *site;
    struct url url;
    struct visit *next;          /* of those who wait for the same */
    cJSON *doc;                  /* what is known so far of what was asked for */
    bool waiting, ready;         /* suspended until it is ready */
    bool begun;                  /* its page is made, or is being made */
    bool waited;                 /* it was suspended: its answer is asked for by itself */
    unsigned status;
    const char *type;
    char *body;
    size_t length;
};

/* A visit; NULL: no memory. */
struct visit *visit_new(struct site *site, struct MHD_Connection *connection);
void visit_free(struct visit *visit);

/* The argument KEY of the address into OUT; false, and OUT "": none, or none that can be read. */
bool visit_argument(const struct visit *visit, const char *key, char out[URL_NAME_MOST + 1]);
/* The header KEY; NULL: none. */
const char *visit_header(const struct visit *visit, const char *key);

/* The answer: BODY, LENGTH bytes of TYPE, which becomes the visit's; NULL: no memory for it. */
void visit_end(struct visit *visit, unsigned status, const char *type, char *body, size_t length);
/* The page that HTML has become. */
void visit_end_page(struct visit *visit, unsigned status, struct html *html);
/* A page that says what is wrong. */
void visit_fail(struct visit *visit, unsigned status, const char *title, const char *text);
/* The same of a daemon that is away, or of its error: ANSWER, or NULL where none came. */
void visit_fail_by(struct visit *visit, const struct link_message *answer);

/* Until visit_end: nothing is done with its connection. */
void visit_wait(struct visit *visit);
/* Send what is ready. */
enum MHD_Result visit_send(struct visit *visit);
/* Give RESPONSE the headers that all have. */
void visit_guard(struct MHD_Response *response);
#endif
