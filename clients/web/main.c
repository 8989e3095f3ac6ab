/* main.c - modald-web: a lab's page out of a connection to modald; see modald-web(8)
 *
 * One loop: what the daemon says, what readers are owed, what browsers ask; then it sleeps until
 * one of them has something.
 */
#include <arpa/inet.h>
#include <getopt.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>
#include "base/json.h"
#include "base/near.h"
#include "http.h"
#include "site.h"

static const char usage[] =
    "usage: modald-web [--bind ADDRESS:PORT] [--server ENDPOINT] [--keyfile FILE] [--host NAME]... "
    "[--actions]\n"
    "\n"
    "  --bind ADDRESS:PORT  where browsers find it (default 127.0.0.1:8130; port 0: any)\n"
    "  --server ENDPOINT    the daemon (default as modalctl's: $MODALD_URL, else the local one)\n"
    "  --keyfile FILE       our keys, of role read; $MODALD_KEYFILE\n"
    "  --host NAME          a name by which browsers reach us, beside addresses and localhost\n"
    "  --actions            jobs may be cancelled, retried and deleted; with a key of role submit\n"
    "  --version\n";

static const struct option options[] = {
    { "bind", required_argument, NULL, 'b' }, { "server", required_argument, NULL, 's' },
    { "keyfile", required_argument, NULL, 'k' }, { "host", required_argument, NULL, 'h' },
    { "actions", no_argument, NULL, 'a' }, { "version", no_argument, NULL, 'V' },
    { "help", no_argument, NULL, '?' + 1 }, { NULL, 0, NULL, 0 },
};

enum { OPTIONS = sizeof options / sizeof options[0] - 1, PORT_MOST = 65535 };

struct arguments { const char *server, *keyfile; bool told; };

static volatile sig_atomic_t stopping;

static void stop(int number)
{
    (void)number;
    stopping = 1;
}

/* TEXT, ADDRESS:PORT or [ADDRESS]:PORT, into *AT. */
static enum modal_status read_bind(const char *text, struct sockaddr_storage *at,
                                   struct modal_error *err)
{
    struct sockaddr_in *four = (struct sockaddr_in *)at;
    struct sockaddr_in6 *six = (struct sockaddr_in6 *)at;
    char address[INET6_ADDRSTRLEN + 2] = "", *end = NULL;
    const char *colon = strrchr(text, ':');
    bool brackets = text[0] == '[' && colon != NULL && colon[-1] == ']';
    long port = colon != NULL ? strtol(colon + 1, &end, 10) : -1;
    bool good = colon != NULL && end != colon + 1 && *end == 0 && port >= 0 && port <= PORT_MOST
             && (size_t)(colon - text) < sizeof address;

    *at = (struct sockaddr_storage) { 0 };
    if (good) {
        memcpy(address, text + brackets, (size_t)(colon - text) - 2 * brackets);
        at->ss_family = brackets ? AF_INET6 : AF_INET;
        *(brackets ? &six->sin6_port : &four->sin_port) = htons((uint16_t)port);
        good = inet_pton(at->ss_family, address,
                         brackets ? (void *)&six->sin6_addr : (void *)&four->sin_addr) == 1;
    }
    return good ? MODAL_OK
                : modal_fail_field(err, MODAL_BAD_INPUT, "bind", "%.100s; accepted: ADDRESS:PORT "
                                   "or [ADDRESS]:PORT, in digits", text);
}

static enum modal_status refuse(const char *word, bool unknown, struct modal_error *err)
{
    const char *names[OPTIONS + 1];
    char list[NEAR_ACCEPTED];

    for (int i = 0; i <= OPTIONS; i++)
        names[i] = options[i].name;
    near_accepted(word + strspn(word, "-"), names, list);
    return unknown ? modal_fail_field(err, MODAL_BAD_INPUT, "arguments",
                                      "unknown argument \"%.60s\"%s", word, list)
                   : modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "%.60s needs a value",
                                      word);
}

static enum modal_status read_arguments(int argc, char **argv, struct site *site,
                                        struct arguments *a, struct modal_error *err)
{
    enum modal_status rc = read_bind("127.0.0.1:8130", &site->bind, err);
    int option;

    while (rc == MODAL_OK && (option = getopt_long(argc, argv, ":", options, NULL)) != -1)
        switch (option) {
        case 'b': rc = read_bind(optarg, &site->bind, err); break;
        case 's': a->server = optarg; break;
        case 'k': a->keyfile = optarg; break;
        case 'a': site->actions = true; break;
        case 'h':
            if (site->name_count == SITE_NAMES)
                return modal_fail_field(err, MODAL_BAD_INPUT, "host", "accepted: at most %d names",
                                        SITE_NAMES);
            site->names[site->name_count++] = optarg;
            break;
        case 'V': printf("modald-web %s\n", MODALD_VERSION); a->told = true; break;
        case '?' + 1: fputs(usage, stdout); a->told = true; break;
        default: return refuse(argv[optind - 1], option == '?', err);
        }
    if (rc == MODAL_OK && optind < argc)
        rc = refuse(argv[optind], true, err);
    return rc;
}

static enum modal_status make_token(struct site *site, struct modal_error *err)
{
    unsigned char bytes[SITE_TOKEN / 2];

    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes)
        return modal_fail(err, MODAL_INTERNAL, "the system gives no random bytes");
    for (size_t i = 0; i < sizeof bytes; i++)
        snprintf(site->token + 2 * i, 3, "%02x", bytes[i]);
    return MODAL_OK;
}

static void on_changed(void *context)
{
    struct site *site = context;

    readers_wake(&site->readers);
}

static void say_where(const struct site *site)
{
    struct sockaddr_storage at;
    socklen_t length = sizeof at;
    char address[INET6_ADDRSTRLEN] = "";
    bool six = site->bind.ss_family == AF_INET6;
    const void *in = six ? (const void *)&((struct sockaddr_in6 *)&at)->sin6_addr
                         : (const void *)&((struct sockaddr_in *)&at)->sin_addr;

    if (getsockname(MHD_get_daemon_info(site->http, MHD_DAEMON_INFO_LISTEN_FD)->listen_fd,
                    (struct sockaddr *)&at, &length) != 0
        || inet_ntop(site->bind.ss_family, in, address, sizeof address) == NULL)
        return;
    fprintf(stderr, "level=info event=listening at=http://%s%s%s:%u/\n", six ? "[" : "", address,
            six ? "]" : "", ntohs(((struct sockaddr_in *)&at)->sin_port));
}

static void run(struct site *site)
{
    const double rest = 0.5, soon = 0.05;    /* s at most: for what is due at some time; soon */

    while (!stopping) {
        service_step(&site->service);
        readers_step(&site->readers);
        http_step(site);
        front_step(site);
        link_sleep(site->service.ask.link, http_descriptor(site),
                   http_wait(site, site->front.waiting != NULL ? soon : rest));
    }
}

static enum modal_status serve(struct site *site, const struct arguments *a,
                               struct modal_error *err)
{
    struct link *link = NULL;
    enum modal_status rc = make_token(site, err);

    if (rc == MODAL_OK)
        rc = link_open(a->server, a->keyfile, &link, err);
    if (rc == MODAL_OK && !service_init(&site->service, link))
        rc = modal_fail(err, MODAL_NO_MEMORY, "no memory for events");
    if (rc == MODAL_OK)
        rc = http_start(site, err);
    if (rc == MODAL_OK) {
        say_where(site);
        run(site);
    }
    if (site->service.feed != NULL) {
        ask_fail(&site->service.ask);
        front_fail(&site->front);
        http_stop(site);
        service_done(&site->service);
    }
    front_done(&site->front);
    link_close(link);
    return rc;
}

/* What is left out of a document would be shown as not there. */
static void *allocate_or_end(size_t size)
{
    static const char text[] = "modald-web: no memory for a document\n";
    void *block = malloc(size);

    if (block != NULL)
        return block;
    (void)!write(STDERR_FILENO, text, sizeof text - 1);
    _exit(modal_status_exit(MODAL_NO_MEMORY));
}

int main(int argc, char **argv)
{
    struct site *site = calloc(1, sizeof *site);
    struct arguments arguments = { 0 };
    struct modal_error err = { 0 };
    enum modal_status rc = site == NULL ? modal_fail(&err, MODAL_NO_MEMORY, "no memory")
                                        : read_arguments(argc, argv, site, &arguments, &err);

    json_memory_by(allocate_or_end);
    signal(SIGPIPE, SIG_IGN);
    sigaction(SIGTERM, &(struct sigaction) { .sa_handler = stop }, NULL);
    sigaction(SIGINT, &(struct sigaction) { .sa_handler = stop }, NULL);
    if (rc == MODAL_OK && !arguments.told) {
        site->service.changed = on_changed;
        site->service.context = site;
        rc = serve(site, &arguments, &err);
    }
    if (rc != MODAL_OK)
        fprintf(stderr, "modald-web: %s%s%s\n", err.field, err.field[0] ? ": " : "", err.message);
    free(site);
    return modal_status_exit(rc);
}
