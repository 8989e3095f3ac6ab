/* url.h - what a request asks for, read from its path; and whom its Host header names
 *
 * Bytes of anybody's: nothing is believed of them.  A path names no file: it is one of a few, with
 * one name in it at most.
 */
#ifndef WEB_URL_H
#define WEB_URL_H
#include <stdbool.h>
#include <stddef.h>

enum {
    URL_MOST = 2048,          /* bytes of a path: a name of 128, each byte escaped, is 384 */
    URL_NAME_MOST = 132,      /* of a job or a stream: "key:" and a key */
    URL_HOST_MOST = 253,      /* of a name in the DNS */
};

enum url_page {
    URL_NONE,                 /* no such page */
    URL_FRONT,                /* / */
    URL_JOB,                  /* /jobs/ID */
    URL_PICTURE,              /* /jobs/ID.svg */
    URL_STREAM,               /* /streams/NAME */
    URL_EVENTS,               /* /events */
    URL_METRICS,              /* /metrics */
    URL_ACTION,               /* /jobs/ID/cancel, retry or delete */
    URL_FILE,                 /* any other single word: one of the page's own files, perhaps */
};

struct url {
    enum url_page page;
    char name[URL_NAME_MOST + 1];         /* of the job, stream or file; UTF-8, no control signs */
    const char *verb;                     /* of an action, as the protocol has it; else NULL */
};

/* Read PATH, as it was sent, escapes and all. */
struct url url_read(const char *path);

/* LENGTH bytes of TEXT, their escapes undone, into OUT; false: nothing, too long, a broken escape,
 * a control sign, or no UTF-8. */
bool url_decode(const char *text, size_t length, char out[URL_NAME_MOST + 1]);

/* NAME escaped for a path, into OUT. */
void url_escape(const char *name, char out[3 * URL_NAME_MOST + 1]);

/*
 * Does the Host header HOST (NULL: there is none) name this page: an address, localhost, or one of
 * COUNT NAMES, with any port?  A name that somebody else points at this address is none of them:
 * his page cannot read ours.
 */
bool url_host_is_ours(const char *host, const char *const *names, size_t count);

/* Is ORIGIN, as a browser sends it, a page of HOST?  The scheme is the proxy's affair. */
bool url_origin_is(const char *origin, const char *host);
#endif
