/* main.c - modald-worker: one process, one job at a time: fetch, run, report
 *
 * Started by the daemon with posix_spawn, its stderr a pipe of the daemon's; ends with the daemon,
 * whatever it is doing, on SIGTERM, and after STOP.  A job is cancelled by killing the process.
 * With a key file it is one on another host, started by whoever likes: it joins, and leaves on
 * SIGTERM, after --idle or at --until.
 * Exit status: 0 after STOP or a leave, 1 where it could not go on, 2 wrong usage or a key that the
 * daemon does not want, WIRE_WORKER_NO_MEMORY.
 */
#include <getopt.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/json.h"
#include "base/machine.h"
#include "base/utf8.h"
#include "job/blas_core.h"
#include "wire/protocol.h"
#include "worker/confine.h"
#include "worker/descriptors.h"
#include "worker/link.h"
#include "worker/serve.h"

struct arguments {
    struct link_options link;
    struct serve_options serve;
    struct confine_options confine;
    bool inputs;
    const char *keyfile;            /* NULL: the daemon is on this host */
    struct elsewhere_options elsewhere;
    char endpoint[320];             /* a host's number, and a port */
};

static const char usage[] =
    "usage: modald-worker --connect ENDPOINT [--inputs] [--data DIR] [--user NAME] "
    "[--memory BYTES] [--jobs N] [--sandbox on|off]\n"
    "       modald-worker --connect tcp://HOST:PORT --keyfile FILE [--idle S] [--until S] "
    "[--grace S] [--memory BYTES]\n"
    "\n"
    "  --connect ENDPOINT   the daemon's endpoint for workers\n"
    "  --inputs             descriptor 3 is a socket of the daemon's, by which inputs come "
    "as descriptors\n"
    "  --data DIR           its data folder: neither it nor other data can be read "
    "(with Landlock)\n"
    "  --user NAME          become this user, where started by root\n"
    "  --memory BYTES       memory of its own at most: inputs, which are mapped, do not count\n"
    "  --jobs N             end after N jobs, for a fresh process\n"
    "  --sandbox on|off     filter system calls (default on)\n"
    "  --keyfile FILE       keys of role worker, for a daemon on another host (worker_bind)\n"
    "  --idle S             leave after S seconds without a job (default 0: never)\n"
    "  --until S            leave after S seconds (default 0: never)\n"
    "  --grace S            for the job that it has then, before it is given back "
    "(default 20)\n"
    "  --calls              print the system calls that the filter allows\n"
    "  --version\n";

enum {
    GRACE_S = 20,              /* Slurm kills 30 s after SIGTERM (KillWait) */
    SECONDS_MOST = 1000000000, /* thirty years: as good as for ever */
};

static int wrong(const char *what)
{
    fprintf(stderr, "modald-worker: %s\n%s", what, usage);
    return 2;
}

/* A whole number from 0; -1: none. */
static long long number(const char *text)
{
    char *end;
    long long value = strtoll(text, &end, 10);

    return end == text || *end != 0 || value < 0 ? -1 : value;
}

/* 0: go on; else exit with what it returns, less one. */
static int read_arguments(int argc, char **argv, struct arguments *out)
{
    static const struct option options[] = {
        { "connect", required_argument, NULL, 'c' },
        { "data", required_argument, NULL, 'd' },
        { "user", required_argument, NULL, 'u' },
        { "memory", required_argument, NULL, 'm' },
        { "jobs", required_argument, NULL, 'j' },
        { "sandbox", required_argument, NULL, 's' },
        { "inputs", no_argument, NULL, 'i' },
        { "calls", no_argument, NULL, 'C' },
        { "keyfile", required_argument, NULL, 'k' },
        { "idle", required_argument, NULL, 'I' },
        { "until", required_argument, NULL, 'U' },
        { "grace", required_argument, NULL, 'G' },
        { "version", no_argument, NULL, 'V' },
        { "help", no_argument, NULL, 'h' },
        { NULL, 0, NULL, 0 },
    };
    long long value = 0;
    int option;

    *out = (struct arguments) { .confine = { .calls = true },
                                .link.leave.grace_ms = GRACE_S * 1000 };
    while ((option = getopt_long(argc, argv, "", options, NULL)) != -1) {
        switch (option) {
        case 'c': out->link.endpoint = optarg; break;
        case 'd': out->confine.data = optarg; break;
        case 'i': out->inputs = true; out->link.watched = CONFINE_INPUTS; break;
        case 'u': out->confine.user = optarg; break;
        case 'm':
            value = number(optarg);
            out->confine.memory = out->serve.memory = (uint64_t)value;
            break;
        case 'j': value = number(optarg); out->serve.jobs_most = (int)value; break;
        case 's':
            if (strcmp(optarg, "on") != 0 && strcmp(optarg, "off") != 0)
                return wrong("--sandbox is on or off") + 1;
            out->confine.calls = strcmp(optarg, "on") == 0;
            break;
        case 'k': out->keyfile = optarg; break;
        case 'I': out->link.leave.idle_ms = 1000 * (value = number(optarg)); break;
        case 'U': out->link.leave.until_ms = 1000 * (value = number(optarg)); break;
        case 'G': out->link.leave.grace_ms = 1000 * (value = number(optarg)); break;
        case 'C': confine_print(stdout); return 1;
        case 'V': printf("modald-worker %s\n", MODALD_VERSION); return 1;
        case 'h': fputs(usage, stdout); return 1;
        default: fputs(usage, stderr); return 3;
        }
        if (value < 0)
            return wrong("a number from 0 is wanted") + 1;
        if (value > SECONDS_MOST && strchr("IUG", option) != NULL)
            return wrong("--idle, --until and --grace have 1e9 seconds at most") + 1;
    }
    if (out->link.endpoint == NULL || optind < argc)
        return wrong(optind < argc ? "there are no other arguments" : "--connect is missing") + 1;
    if (out->keyfile != NULL && (out->inputs || out->confine.data != NULL))
        return wrong("--inputs and --data are the daemon's, for its own workers") + 1;
    return 0;
}

/* A worker on another host: what it says of itself, and where the daemon is. */
static enum modal_status go_elsewhere(struct arguments *a, struct modal_error *err)
{
    const int64_t machine = machine_memory();
    const uint64_t most = a->confine.memory > 0 ? a->confine.memory : (uint64_t)machine;
    enum modal_status rc = elsewhere_find(a->link.endpoint, a->endpoint, sizeof a->endpoint, err);

    if (rc == MODAL_OK)
        rc = elsewhere_keys(a->keyfile, &a->elsewhere, err);
    elsewhere_name(&a->elsewhere);
    a->elsewhere.memory = most / 2;        /* work arrays are as large as the input, and less */
    a->link.endpoint = a->endpoint;
    a->link.elsewhere = &a->elsewhere;
    a->confine.elsewhere = true;
    a->confine.data = "";                  /* no data of others is read here either */
    return rc == MODAL_OK ? confine_survive(err) : rc;
}

/* The walls go up from the outside in: what needs files or sockets is done before they are shut
 * off. */
static enum modal_status work(const struct arguments *arguments, struct modal_error *err)
{
    const struct confine_options *confine = &arguments->confine;
    struct link *link = NULL;
    bool done, walled = false;
    enum modal_status rc = confine_limits(confine, err);

    if (rc == MODAL_OK && arguments->inputs)
        rc = descriptors_open(err);
    if (rc == MODAL_OK && confine->calls && confine->user == NULL)
        rc = confine_files(confine, &walled, err);
    if (rc == MODAL_OK)
        rc = link_open(&arguments->link, &link, err);
    if (rc == MODAL_OK)
        rc = confine_user(confine, err);
    if (rc == MODAL_OK && confine->calls && confine->user != NULL)
        rc = confine_files(confine, &walled, err);
    if (rc == MODAL_OK && confine->calls && !walled)
        rc = confine_opening(&done, err);
    if (rc == MODAL_OK && confine->calls)
        rc = confine_calls(&done, err);
    if (rc == MODAL_OK)
        rc = serve(link, &arguments->serve, err);
    link_close(link);
    return rc;
}

/* Is it in vain to come again? */
static bool is_final(enum modal_status status)
{
    return status == MODAL_DENIED || status == MODAL_BAD_VERSION || status == MODAL_BAD_INPUT;
}

/* Nobody is told by a message, which is a document too: the daemon knows it by the status. */
static void *allocate_or_end(size_t size)
{
    static const char text[] = "modald-worker: no memory for a document\n";
    void *block = malloc(size);

    if (block != NULL)
        return block;
    (void)!write(STDERR_FILENO, text, sizeof text - 1);
    _exit(WIRE_WORKER_NO_MEMORY);
}

int main(int argc, char **argv)
{
    struct arguments arguments;
    struct modal_error err;
    int wanted;

    /* First of all, and held over the execution of itself: whatever follows,
     * a worker whose daemon ends does so too. */
    if (confine_death(&err) != MODAL_OK) {
        fprintf(stderr, "modald-worker: %s\n", err.message);
        return 1;
    }
    json_memory_by(allocate_or_end);
    blas_core_ensure(argv);
    wanted = read_arguments(argc, argv, &arguments);
    if (wanted != 0)
        return wanted - 1;
    signal(SIGPIPE, SIG_IGN);
    if ((arguments.keyfile == NULL || go_elsewhere(&arguments, &err) == MODAL_OK)
        && work(&arguments, &err) == MODAL_OK)
        return 0;
    fputs("modald-worker: ", stderr);
    utf8_put(stderr, err.message, strlen(err.message));     /* a server may have written it */
    fputc('\n', stderr);
    return arguments.keyfile != NULL && is_final(err.status) ? 2 : 1;
}
