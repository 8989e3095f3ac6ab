/* main.c - modalctl: frequencies, damping and steady vibration from the command line; see
 * modalctl(1) */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "outcome.h"
#include "job/blas_core.h"
#include "base/near.h"
#include "option_help.h"
#include "result_help.h"
#include "sbatch.h"
#include "scene_help.h"
#include "schema.h"
#include "sweep_shares.h"
#include "terminal.h"
#include "verbs.h"

#define JOB_TAKES (TAKES_OPTIONS | TAKES_SUBMIT | TAKES_TIMEOUT)

/* A sweep can be long: on a server it is only waited for with --wait.  A share of one is a job like
 * others. */
static int run_sweep(const struct verb *verb, const struct args *args)
{
    if (args->sbatch != NULL)
        return sbatch_sweep(args);
    if (!sweep_is_whole(args) && !args->local && !args->wait && !args->cancel)
        return submit_one("sweep", NULL, args->word[1], args);
    return (args->local || args->wait) && !args->cancel ? run_job(verb, args) : sweep_submit(args);
}

/* With --json the schema of it. */
static enum modal_status print_schema(const struct args *args, cJSON *(*schema)(void),
                                      struct modal_error *err)
{
    cJSON *document;
    enum modal_status rc;

    if (args->words > 2)
        return modal_fail_field(err, MODAL_BAD_INPUT, "json", "the schema is of the whole; "
                                "accepted: --json help %s", args->word[1]);
    document = schema();
    rc = outcome_json(document, err);
    cJSON_Delete(document);
    return rc;
}

static int run_help(const struct verb *verb, const struct args *args)
{
    static const struct topic {
        const char *name;
        enum modal_status (*tell)(FILE *to, const char *what, struct modal_error *err);
        cJSON *(*schema)(void);
    } topics[] = { { "scene", scene_help, schema_scene },
                   { "result", result_help, schema_result } };
    static const char *const names[] = { "scene", "result", NULL };
    struct modal_error err = { 0 };
    const struct topic *topic = NULL;
    char meant[NEAR_TEXT];
    enum modal_status rc;

    (void)verb;
    for (size_t i = 0; i < sizeof topics / sizeof *topics; i++)
        if (strcmp(args->word[1], topics[i].name) == 0)
            topic = &topics[i];
    near_text(args->word[1], names, meant);
    if (topic == NULL)
        rc = modal_fail_field(&err, MODAL_BAD_INPUT, "arguments", "no help on \"%.40s\"%s; "
                              "accepted: help scene [TYPE], help result [MEMBER], or VERB --help",
                              args->word[1], meant);
    else if (args->json)
        rc = print_schema(args, topic->schema, &err);
    else
        rc = topic->tell(stdout, args->words > 2 ? args->word[2] : NULL, &err);
    return rc == MODAL_OK ? 0 : outcome_failure(args->json, &err, NULL);
}

static const struct verb verbs[] = {
    { "identify", "BATCH", "modes of a batch of signals; see FILES in modalctl(1)", 1, 1,
      JOB_TAKES | TAKES_SIGNALS | TAKES_PLOT | TAKES_CSV, .run = run_job },
    { "steady", "SCENE.json", "steady-state response of a scene", 1, 1,
      JOB_TAKES | TAKES_CURVE | TAKES_PLOT | TAKES_OUTPUT, .run = run_job },
    { "simulate", "SCENE.json -O OUT", "a scene's motion as a batch of signals", 1, 1,
      JOB_TAKES | TAKES_OUTPUT, .run = run_job },
    { "floquet", "SCENE.json", "exact multipliers of a linear scene", 1, 1, JOB_TAKES | TAKES_PLOT,
      .run = run_job },
    { "tradeoff", "identify|steady|simulate FILE", "error against time over the ladder of settings",
      2, 2, JOB_TAKES | TAKES_SIGNALS | TAKES_PLOT, .run = run_job },
    { "ablate", "SCENE.json", "each effect's cost and influence", 1, 1, JOB_TAKES, .run = run_job },
    { "sweep", "FILE.json", "a scene over a grid of its values", 1, 1,
      JOB_TAKES | TAKES_WAIT | TAKES_PLOT | TAKES_SWEEP | TAKES_CSV | TAKES_SBATCH,
      .run = run_sweep },
    { "export", "FILE|stream:NAME|JOB -O OUT", "signals to a file of HDF5 or CSV", 1, 1,
      TAKES_SIGNALS | TAKES_OUTPUT | TAKES_TIMEOUT, .run = run_export },
    { "submit", "KIND FILE", "put a job on the queue; or many: --from LIST.jsonl", 0, 3,
      JOB_TAKES | TAKES_SIGNALS | TAKES_CURVE | TAKES_WAIT | TAKES_BULK | TAKES_SBATCH,
      .run = run_submit },
    { "status", "JOB", "a job's state now (JOB is an id, or key:K)", 1, 1, TAKES_TIMEOUT,
      .run = run_queue, .asks = "STATUS" },
    { "wait", "JOB", "until it has ended, with its result", 1, 1, TAKES_TIMEOUT, .run = run_wait },
    { "result", "JOB", "a done job's result; -O as HDF5", 1, 1,
      TAKES_TIMEOUT | TAKES_OUTPUT | TAKES_PLOT | TAKES_CSV, .run = run_result },
    { "results", "--from LIST.jsonl", "those of a list that was submitted, a line each", 0, 0,
      TAKES_FROM | TAKES_CSV | TAKES_TIMEOUT, .run = run_results },
    { "gather", "DIR", "results of an array job that --sbatch wrote", 1, 1,
      TAKES_PLOT | TAKES_CSV, .run = run_gather },
    { "task", "DIR N", "one of its tasks, as its script has it run", 2, 2, 0, .run = run_task },
    { "mac", "A B", "how alike the shapes of two results are; each a job or a file", 2, 2,
      TAKES_TIMEOUT, .run = run_mac },
    { "stderr", "JOB", "the last words of a worker that died of it", 1, 1, TAKES_TIMEOUT,
      .run = run_stderr },
    { "cancel", "JOB", "end it, queued or running", 1, 1, TAKES_TIMEOUT,
      .run = run_queue, .asks = "CANCEL" },
    { "retry", "JOB", "a dead job, once more", 1, 1, TAKES_TIMEOUT | TAKES_WAIT,
      .run = run_queue, .asks = "RETRY" },
    { "delete", "JOB", "forget an ended job and its result", 1, 1, TAKES_TIMEOUT,
      .run = run_queue, .asks = "DELETE" },
    { "list", "", "your jobs, a page", 0, 0, TAKES_LIST | TAKES_TIMEOUT | TAKES_QUEUE,
      .run = run_list },
    { "watch", "[JOB|STREAM]", "events as they happen; of a stream: live modes", 0, 1,
      TAKES_LIST | TAKES_TIMEOUT | TAKES_STREAM | TAKES_PLOT | TAKES_LIVE, .run = run_watch },
    { "streams", "[NAME]", "live and recent streams, a page", 0, 1,
      TAKES_PAGE | TAKES_TIMEOUT, .run = run_streams },
    { "top", "", "queue, workers and streams on a live screen; q ends it", 0, 0, TAKES_USER,
      .run = run_top },
    { "stats", "", "counts and sizes of the service", 0, 0, TAKES_TIMEOUT,
      .run = run_service, .asks = "STATS" },
    { "whoami", "", "user, role, limits and use", 0, 0, TAKES_TIMEOUT,
      .run = run_service, .asks = "WHOAMI" },
    { "hello", "", "versions and limits of the daemon", 0, 0, TAKES_TIMEOUT,
      .run = run_service, .asks = "HELLO" },
    { "metrics", "", "Prometheus text", 0, 0, TAKES_TIMEOUT, .run = run_metrics },
    { "drain", "", "take and start no more jobs (admin)", 0, 0, TAKES_TIMEOUT,
      .run = run_service, .asks = "DRAIN" },
    { "undrain", "", "take and start jobs again (admin)", 0, 0, TAKES_TIMEOUT,
      .run = run_service, .asks = "UNDRAIN" },
    { "stream", "FILE|-", "push samples as a simulation would, print what watch prints", 1, 1,
      TAKES_SIGNALS | TAKES_OPTIONS | TAKES_STREAM | TAKES_PUSH | TAKES_TIMEOUT,
      .run = run_stream },
    { "replay", "FILE", "send a spill or ring file a simulation left", 1, 1, TAKES_TIMEOUT,
      .run = run_replay },
    { "help", "scene [TYPE] | result [MEMBER]", "what a scene may hold, and a result", 1, 2, 0,
      .run = run_help },
    { "keygen", "FILE [SERVER-KEY]", "a new pair of CURVE keys", 1, 2, 0, .run = run_keygen },
    { "fsck", "DIR", "read a data folder whole, name what is damaged", 0, 1, TAKES_DATA,
      .run = run_fsck },
    { "dump", "DIR", "every row of its ledger, a JSON object a line", 0, 1, TAKES_DATA,
      .run = run_dump },
    { "backup", "DIR TO", "copy it to a new folder, also beside its daemon", 1, 2, TAKES_DATA,
      .run = run_backup },
};
enum { VERBS = sizeof verbs / sizeof verbs[0] };

static int help(FILE *to, const struct verb *only)
{
    fprintf(to, "usage: modalctl [--server ENDPOINT | --local] [--json] VERB ...\n\n");
    for (int i = 0; i < VERBS; i++)
        if (only == NULL || only == &verbs[i])
            fprintf(to, "  %-10s %-30s %s\n", verbs[i].name, verbs[i].words, verbs[i].help);
    fprintf(to, "\noptions:\n");
    args_help(to, TAKES_ALWAYS | (only ? only->takes : 0));
    if (only != NULL)
        option_help(to, only->name);
    if (only == NULL)
        fprintf(to, "\n`modalctl VERB --help` lists the options of a verb.  Exit status: 0 done; 1 "
                    "the job failed; 2 bad usage or input;\n"
                    "3 no server; 4 refused; 5 not finished in --timeout.\n");
    return 0;
}

static const struct verb *find(const struct args *args, struct modal_error *err)
{
    const char *names[VERBS + 1], *word = args->words > 0 ? args->word[0] : "";
    char list[NEAR_ACCEPTED];

    for (int i = 0; i < VERBS; i++) {
        if (strcmp(verbs[i].name, word) == 0)
            return &verbs[i];
        names[i] = verbs[i].name;
    }
    names[VERBS] = NULL;
    near_accepted(word, names, list);
    modal_fail_field(err, MODAL_BAD_INPUT, "verb",
                     args->words ? "no verb \"%.40s\"%s" : "%sa verb is needed%s", word, list);
    return NULL;
}

static enum modal_status check(const struct verb *verb, const struct args *args,
                               struct modal_error *err)
{
    int given = args->words - 1;

    if (given < verb->least || given > verb->most)
        return modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "%s takes %s, not %d argument%s",
                                verb->name, verb->words[0] != 0 ? verb->words : "none", given,
                                given == 1 ? "" : "s");
    return args_check(args, verb->name, verb->takes, err);
}

static int dispatch(const struct args *args, char **argv)
{
    struct modal_error err = { 0 };
    const struct verb *verb;

    if (args->version)
        return printf(args->json ? "{\"version\":\"%s\"}\n" : "modalctl %s\n", MODALD_VERSION) < 0;
    if (args->words == 0 && (args->help || !args->json)) {
        help(args->help ? stdout : stderr, NULL);
        return args->help ? 0 : modal_status_exit(MODAL_BAD_INPUT);
    }
    verb = find(args, &err);
    if (verb != NULL && args->help)
        return help(stdout, verb);
    if (verb == NULL || check(verb, args, &err) != MODAL_OK)
        return outcome_failure(args->json, &err, NULL);
    if (args->local) {
        setenv("OPENBLAS_NUM_THREADS", "1", 0);     /* as workers begin: jobs ask for more */
        blas_core_ensure(argv);
    }
    return verb->run(verb, args);
}

int main(int argc, char **argv)
{
    struct modal_error err = { 0 };
    struct args args = { 0 };
    int status;

    signal(SIGPIPE, SIG_IGN);
    outcome_begin(&args.json);
    terminal_guard();
    status = args_read(argc, (const char *const *)argv, &args, &err) == MODAL_OK
                 ? dispatch(&args, argv)
                 : outcome_failure(args.json, &err, NULL);
    args_done(&args);
    return outcome_end(status);
}
