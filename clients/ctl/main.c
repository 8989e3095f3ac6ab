/* main.c - modalctl: frequencies, damping and steady vibration from the command line; see modalctl(1) */
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include "answer.h"
#include "job/blas_core.h"
#include "verbs.h"

#define JOB_TAKES (TAKES_OPTIONS | TAKES_SUBMIT | TAKES_TIMEOUT)

static const struct verb verbs[] = {
    { "identify", "BATCH",             "modes of a batch of signals (HDF5, CSV, WAV, FLAC)",  1, 1, JOB_TAKES | TAKES_SIGNALS | TAKES_PLOT, run_job },
    { "steady",   "SCENE.json",        "steady-state response of a scene",                    1, 1, JOB_TAKES | TAKES_CURVE | TAKES_PLOT, run_job },
    { "simulate", "SCENE.json -O OUT", "a scene's motion as a batch of signals",              1, 1, JOB_TAKES | TAKES_OUTPUT, run_job },
    { "floquet",  "SCENE.json",        "exact multipliers of a linear scene",                 1, 1, JOB_TAKES | TAKES_PLOT, run_job },
    { "tradeoff", "identify|steady|simulate FILE", "error against time over the ladder of settings", 2, 2, JOB_TAKES | TAKES_SIGNALS | TAKES_PLOT, run_job },
    { "ablate",   "SCENE.json",        "each effect's cost and influence",                    1, 1, JOB_TAKES, run_job },
    { "sweep",    "FILE.json",         "a scene over a grid of its values",                   1, 1, JOB_TAKES | TAKES_WAIT | TAKES_PLOT, run_job },
};
enum { VERBS = sizeof verbs / sizeof verbs[0] };

static int help(const struct verb *only)
{
    printf("usage: modalctl [--server ENDPOINT | --local] [--json] VERB ...\n\n");
    for (int i = 0; i < VERBS; i++)
        if (only == NULL || only == &verbs[i])
            printf("  %-10s %-30s %s\n", verbs[i].name, verbs[i].words, verbs[i].help);
    printf("\noptions:\n");
    args_help(TAKES_ALWAYS | (only ? only->takes : 0));
    if (only == NULL)
        printf("\n`modalctl VERB --help` lists the options of a verb.  Exit status: 0 done; 1 the job failed; 2 bad usage or input;\n"
               "3 no server; 4 refused; 5 not finished in --timeout.\n");
    return 0;
}

static const struct verb *find(const struct args *args, struct modal_error *err)
{
    char list[512] = "";

    for (int i = 0; args->words > 0 && i < VERBS; i++)
        if (strcmp(verbs[i].name, args->word[0]) == 0)
            return &verbs[i];
    for (int i = 0; i < VERBS; i++)
        snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", i ? ", " : "", verbs[i].name);
    modal_fail_field(err, MODAL_BAD_INPUT, "verb", args->words ? "no verb \"%.40s\"; accepted: %s" : "%sa verb is needed: %s",
                     args->words ? args->word[0] : "", list);
    return NULL;
}

static enum modal_status check(const struct verb *verb, const struct args *args, struct modal_error *err)
{
    int given = args->words - 1;

    if (given < verb->least || given > verb->most)
        return modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "%s takes %s, not %d arguments", verb->name, verb->words, given);
    return args_check(args, verb->name, verb->takes, err);
}

static int dispatch(const struct args *args, char **argv)
{
    struct modal_error err = { 0 };
    const struct verb *verb;

    if (args->version)
        return printf("modalctl " MODALD_VERSION "\n") < 0;
    if (args->words == 0 && args->help)
        return help(NULL);
    verb = find(args, &err);
    if (verb != NULL && args->help)
        return help(verb);
    if (verb == NULL || check(verb, args, &err) != MODAL_OK)
        return answer_failure(args->json, &err, NULL);
    if (args->local)
        blas_core_ensure(argv);
    return verb->run(verb, args);
}

int main(int argc, char **argv)
{
    struct modal_error err = { 0 };
    struct args args;
    int status;

    signal(SIGPIPE, SIG_IGN);
    status = args_read(argc, (const char *const *)argv, &args, &err) == MODAL_OK ? dispatch(&args, argv) : answer_failure(args.json, &err, NULL);
    args_done(&args);
    return status;
}
