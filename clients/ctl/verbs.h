/* verbs.h - the verbs of modalctl: a table, in the order of the help */
#ifndef CTL_VERBS_H
#define CTL_VERBS_H
#include "args.h"

struct verb {
    const char *name, *words, *help;      /* words: what stands behind the verb, for the help */
    int least, most;                      /* how many of them */
    unsigned takes;                       /* groups of args.h */
    int (*run)(const struct verb *verb, const struct args *args);   /* gives the exit status, everything said */
};

/* The kinds of jobs as verbs (run.c): read the input, run it here or on the server, show the result. */
int run_job(const struct verb *verb, const struct args *args);

#endif
