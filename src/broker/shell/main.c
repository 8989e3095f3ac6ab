/* main.c - modald: the daemon in the foreground */
#include <getopt.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include "base/near.h"
#include "broker/kit/memory.h"
#include "broker/shell/daemon.h"
#include "broker/shell/config.h"

static const char usage[] =
    "usage: modald --data DIR [--bind ENDPOINT...]... [--workers N] [--config FILE] "
    "[--check-config]\n"
    "\n"
    "  --data DIR         the data folder; made where it is not there\n"
    "  --bind ENDPOINT    ipc://PATH or tcp://HOST:PORT, one or more; up to 16\n"
    "                     (default ipc://$XDG_RUNTIME_DIR/modald/modald.ipc; where that is not set "
    "ipc:///run/modald/modald.ipc)\n"
    "  --workers N        worker processes (default: the processors, one less where there are more "
    "than two)\n"
    "  --config FILE      settings, one `key = value` a line; what stands here goes over it\n"
    "  --check-config     check all of it, say what is wrong, and end\n"
    "  --version\n"
    "\n"
    "SIGTERM drains and stops, a second one stops at once; SIGHUP reads the configuration again.\n";

struct arguments { int argc; char **argv; bool check; };

enum { OPTIONS_MOST = 16 };          /* twice what there are */

/* WORD is no option, or, where it is not UNKNOWN, lacks its value. */
static enum modal_status refuse(const char *word, bool unknown, const struct option *options,
                                struct modal_error *err)
{
    const char *names[OPTIONS_MOST + 1];
    char list[NEAR_ACCEPTED];
    int count = 0;

    if (!unknown)
        return modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "%.60s needs a value", word);
    for (; options[count].name != NULL && count < OPTIONS_MOST; count++)
        names[count] = options[count].name;
    names[count] = NULL;
    near_accepted(word + strspn(word, "-"), names, list);
    return modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "unknown argument \"%.60s\"%s", word,
                            list);
}

/* The configuration from file and arguments, as at the start, so at each reload. */
static enum modal_status read_all(struct config *out, void *context, struct modal_error *err)
{
    static const struct option options[] = {
        { "data", required_argument, NULL, 'd' },    { "bind", required_argument, NULL, 'b' },
        { "workers", required_argument, NULL, 'w' }, { "config", required_argument, NULL, 'c' },
        { "check-config", no_argument, NULL, 'k' },  { "version", no_argument, NULL, 'V' },
        { "help", no_argument, NULL, 'h' },          { NULL, 0, NULL, 0 },
    };
    struct arguments *a = context;
    enum modal_status rc = MODAL_OK;
    bool first_bind = true;
    int option;

    config_init(out);
    for (optind = 0;
         rc == MODAL_OK && (option = getopt_long(a->argc, a->argv, ":", options, NULL)) != -1;) {
        if (option == 'c')
            rc = config_read(out, optarg, err);
        if (option == '?' || option == ':')
            return refuse(a->argv[optind - 1], option == '?', options, err);
    }
    for (optind = 0;
         rc == MODAL_OK && (option = getopt_long(a->argc, a->argv, "", options, NULL)) != -1;) {
        if (option == 'b' && first_bind)
            out->bind_count = 0;
        first_bind = first_bind && option != 'b';
        if (option == 'd' || option == 'b' || option == 'w')
            rc = config_set(out,
                            option == 'd'   ? "data"
                            : option == 'b' ? "bind"
                                            : "workers",
                            optarg, err);
        a->check = a->check || option == 'k';
    }
    for (; rc == MODAL_OK && !first_bind && optind < a->argc
           && strstr(a->argv[optind], "://") != NULL;
         optind++)
        rc = config_set(out, "bind", a->argv[optind], err);     /* --bind ONE OTHER */
    if (rc == MODAL_OK && optind < a->argc)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "\"%.60s\" is not an argument",
                              a->argv[optind]);
    return rc == MODAL_OK ? config_finish(out, err) : rc;
}

int main(int argc, char **argv)
{
    static struct config config;
    struct arguments arguments = { argc, argv, false };
    struct modal_error err = { 0 };

    grab_documents();
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--version") == 0) {
            printf("modald %s\n", MODALD_VERSION);
            return 0;
        }
        if (strcmp(argv[i], "--help") == 0) {
            fputs(usage, stdout);
            return 0;
        }
    }
    umask(umask(0) | 027);             /* what it makes is for its user, and its group to read */
    if (read_all(&config, &arguments, &err) != MODAL_OK) {
        fprintf(stderr, "modald: %s: %s\n", err.field, err.message);
        if (strcmp(err.field, "arguments") == 0)
            fputs(usage, stderr);
        return 2;
    }
    if (arguments.check) {
        printf("modald: the configuration is good\n");
        return 0;
    }
    return daemon_run(&config, read_all, &arguments);
}
