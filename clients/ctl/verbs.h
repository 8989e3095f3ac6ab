/* verbs.h - the verbs of modalctl: a table, in the order of the help */
#ifndef CTL_VERBS_H
#define CTL_VERBS_H
#include "args.h"
#include "wire/protocol.h"

struct verb {
    const char *name, *words, *help;      /* words: what stands behind the verb, for the help */
    int least, most;                      /* how many of them */
    unsigned takes;                       /* groups of args.h */
    int (*run)(const struct verb *verb, const struct args *args); /* gives the exit status,
                                                                     everything said */
    const char *asks;                     /* run_queue, run_service: the verb of PROTOCOL.md */
};

/* The kinds of jobs as verbs (run.c): read the input, run it here or on the server, show the
 * result. */
int run_job(const struct verb *verb, const struct args *args);

/* The queue (queue_verbs.c). */
int run_submit(const struct verb *verb, const struct args *args);
int run_wait(const struct verb *verb, const struct args *args);
int run_result(const struct verb *verb, const struct args *args);
int run_mac(const struct verb *verb, const struct args *args);            /* mac.c */
int run_stderr(const struct verb *verb, const struct args *args);
int run_list(const struct verb *verb, const struct args *args);
/* The question that VERB asks: of one job, whose state is the answer (with --wait its end), or of
 * the service. */
int run_queue(const struct verb *verb, const struct args *args);
int run_service(const struct verb *verb, const struct args *args);
int run_metrics(const struct verb *verb, const struct args *args);

/* Submit PATH as a job of KIND (OF: of a tradeoff, or NULL), say its document; the exit status. */
int submit_one(const char *kind, const char *of, const char *path, const struct args *args);

int run_export(const struct verb *verb, const struct args *args);        /* export.c */
int run_bulk(const struct args *args);                      /* bulk.c: submit --from */
/* Is LINE, number NUMBER, a submission?  MODAL_BAD_INPUT says what is wrong. */
enum modal_status bulk_check_line(const cJSON *line, long number, struct modal_error *err);
/* What the submission of LINE, number NUMBER of the list FROM, is called where it does not say. */
void bulk_key(const char *from, long number, const char *line, char key[WIRE_KEY_MOST + 1]);
int run_results(const struct verb *verb, const struct args *args);        /* bulk_results.c */
int run_task(const struct verb *verb, const struct args *args);           /* task.c */
int run_gather(const struct verb *verb, const struct args *args);         /* gather.c */
int run_watch(const struct verb *verb, const struct args *args);          /* watch.c */
int run_streams(const struct verb *verb, const struct args *args);        /* streams.c */
int run_top(const struct verb *verb, const struct args *args);            /* top.c */
int run_keygen(const struct verb *verb, const struct args *args);         /* keygen.c */

/* A data folder on this machine (folder.c). */
int run_fsck(const struct verb *verb, const struct args *args);
int run_dump(const struct verb *verb, const struct args *args);
int run_backup(const struct verb *verb, const struct args *args);

int run_stream(const struct verb *verb, const struct args *args);         /* stream.c */
int run_replay(const struct verb *verb, const struct args *args);

#endif
