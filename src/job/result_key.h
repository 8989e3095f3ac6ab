/* result_key.h - what a result holds: a row for each member and for each diagnostic code
 *
 * The help, modald-result(5) and the schema of results are made of these rows; they write nothing
 * themselves.  tests/system/test_manual.py holds them against what the sources write, and against
 * real results: a new member or code is a new row.
 */
#ifndef JOB_RESULT_KEY_H
#define JOB_RESULT_KEY_H
#include <stdbool.h>

enum result_type {
    RESULT_NUMBER,
    RESULT_WHOLE,
    RESULT_TRUTH,
    RESULT_TEXT,
    RESULT_COMPLEX,                  /* [re, im] */
    RESULT_SPAN,                     /* [t0, t1] */
    RESULT_OBJECT,                   /* of `members`, and of those of the kinds `as` */
    RESULT_OWN                       /* as somebody else gave it: options, attributes */
};

enum { RESULT_KINDS_LIKE = 4 };      /* a NULL at the end included */

struct result_key {
    const char *name;                /* "<word>": one member for each word; NULL: the end */
    enum result_type type;
    const char *list;                /* it is a list, of what: "one a channel"; NULL: it is not */
    const char *unit;                /* SI; NULL: none */
    const char *null;                /* when it, or one of a list, is null; NULL: never */
    const char *absent;              /* when it is not there; NULL: never */
    const struct result_key *members;
    const char *as[RESULT_KINDS_LIKE];   /* may have the members of these kinds' results too */
    const char *means;               /* a line */
};

struct result_document {
    const char *kind;                /* its "kind"; of what is no result: what it is called */
    bool result;                     /* else an event's */
    const struct result_key *keys;
    const char *means;
};

/* What is told of a record and its modes (mode_key.c). */
extern const struct result_key identify_mode_keys[], identify_verdict_keys[],
    identify_rank_keys[], identify_rebuilt_keys[], identify_frf_keys[], identify_order_keys[],
    identify_pole_keys[], identify_cluster_keys[], identify_trend_keys[], identify_input_keys[];

/* What is told of the live windows of a stream (live_key.c): of a window, a track, an alarm. */
extern const struct result_key live_window_keys[], live_track_keys[], live_alarm_keys[];

struct result_code {
    const char *code, *kind, *means, *advice;
};

/* Both end with a row of NULL. */
extern const struct result_document result_documents[];
extern const struct result_code result_codes[];
#endif
