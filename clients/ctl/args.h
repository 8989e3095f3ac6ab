/* args.h - the command line of modalctl: one table of options, one struct with what was said
 *
 * Options stand anywhere; what does not begin with '-' is positional, the verb first.  `-o
 * KEY=VALUE` may be followed by further KEY=VALUE words.  An option the verb does not take is
 * refused, with those it takes.
 */
#ifndef CTL_ARGS_H
#define CTL_ARGS_H
#include <stdbool.h>
#include <stdio.h>
#include "base/error.h"
#include "base/json.h"

/* Groups of options; a verb takes the union of its groups. */
enum {
    TAKES_ALWAYS  = 1 << 0,    /* --server --local --json --keyfile --help --version */
    TAKES_OPTIONS = 1 << 1,    /* -o */
    TAKES_SIGNALS = 1 << 2,    /* --dt --dataset --ignore-time --scale: of files of signals */
    TAKES_CURVE   = 1 << 3,    /* --sweep --continue */
    TAKES_OUTPUT  = 1 << 4,    /* -O */
    TAKES_SUBMIT  = 1 << 5,    /* --key --priority --run-limit --deadline */
    TAKES_WAIT    = 1 << 6,    /* --wait */
    TAKES_TIMEOUT = 1 << 7,    /* --timeout */
    TAKES_LIST    = 1 << 8,    /* --state --limit --after --kind */
    TAKES_PLOT    = 1 << 9,    /* --plot */
    TAKES_BULK    = 1 << 10,   /* --from --resume --window */
    TAKES_FROM    = 1 << 18,   /* --from alone */
    TAKES_PAGE    = 1 << 19,   /* --limit --after --user */
    TAKES_USER    = 1 << 20,   /* --user alone */
    TAKES_DATA    = 1 << 11,   /* --data */
    TAKES_STREAM  = 1 << 12,   /* --name */
    TAKES_SWEEP   = 1 << 13,   /* --cancel */
    TAKES_PUSH    = 1 << 14,   /* --rate --window --hop */
    TAKES_LIVE    = 1 << 15,   /* --prometheus */
    TAKES_CSV     = 1 << 16,   /* --csv */
    TAKES_QUEUE   = 1 << 17,   /* --newest --user --since, and --key of what is listed */
    TAKES_SBATCH  = 1 << 21,   /* --sbatch --array, and --run-limit of a task */
};

/* Four times what a verb takes. */
enum { ARGS_WORDS_MOST = 16 };

struct args {
    const char *server, *keyfile, *output, *plot, *prometheus, *key, *state, *after, *kind, *sweep,
        *follow, *from, *data, *name, *dataset, *user, *since, *sbatch;
    bool local, json, help, version, wait, resume, cancel, ignore_time, csv, newest;
    double dt, scale, run_limit, deadline, timeout, rate;   /* 0: not given; timeout < 0: not
                                                               given */
    double priority, limit, window, hop, array;             /* whole numbers; priority < 0, others
                                                               0: not given */
    cJSON *options;                                         /* from -o, --sweep, --continue; never
                                                               NULL after args_read */
    const char *word[ARGS_WORDS_MOST];                      /* positional, word[0] the verb */
    int words;
    const char *sha256;                                     /* what the input must be; NULL: all
                                                               is right.  No option says it */
};

/* Fill ARGS from the command line; it borrows argv, args_done frees the options object.  Fails
 * with MODAL_BAD_INPUT naming the option; ARGS is then still valid for args_done, and `json` is
 * right if it stood anywhere. */
enum modal_status args_read(int argc, const char *const *argv, struct args *args,
                            struct modal_error *err);
void args_done(struct args *args);

/* Refuse what was given but is in none of the verb's groups TAKES. */
enum modal_status args_check(const struct args *args, const char *verb, unsigned takes,
                             struct modal_error *err);

/* Print the options in TAKES, one a line. */
void args_help(FILE *to, unsigned takes);

#endif
