/* daemon.c - the daemon's beginning, in its order, and its end: signals, store, sockets, workers,
 * threads, replay */
#include "base/sha256.h"
#include "broker/shell/accept.h"
#include "broker/shell/intake.h"
#include "broker/shell/log_out.h"
#include "broker/shell/loop.h"
#include "broker/shell/notify.h"
#include "store/file.h"
#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>
#include <zmq.h>

enum { DESCRIPTORS_MOST = 65536 };    /* chosen: 64 times the usual limit, one a client */

/* Bytes of a frame's box beside its own: name, nonce, flags, authenticator. */
enum { CURVE_COST = 33 };

static bool set_int(void *socket, int option, int value)
{
    return zmq_setsockopt(socket, option, &value, sizeof value) == 0;
}

static void *router(struct daemon *d)
{
    void *socket = zmq_socket(d->context, ZMQ_ROUTER);
    int64_t frame = WIRE_BODY_MOST;
    bool ok = socket != NULL && set_int(socket, ZMQ_ROUTER_MANDATORY, 1)
              && set_int(socket, ZMQ_SNDHWM, 64) && set_int(socket, ZMQ_RCVHWM, INTAKE_WAITING)
              && set_int(socket, ZMQ_HANDSHAKE_IVL, 3000) && set_int(socket, ZMQ_LINGER, 200)
              && set_int(socket, ZMQ_HEARTBEAT_IVL, 10000)
              && set_int(socket, ZMQ_HEARTBEAT_TIMEOUT, 20000) && set_int(socket, ZMQ_BACKLOG, 1024)
              && zmq_setsockopt(socket, ZMQ_MAXMSGSIZE, &frame, sizeof frame) == 0;

    if (!ok && socket != NULL) {
        zmq_close(socket);
        socket = NULL;
    }
    return socket;
}

/* Only by keys that the handler of DOMAIN admits. */
static bool guard(void *socket, const char *secret, const char *domain)
{
    int64_t frame = WIRE_BODY_MOST + CURVE_COST;

    return set_int(socket, ZMQ_CURVE_SERVER, 1)
           && zmq_setsockopt(socket, ZMQ_CURVE_SECRETKEY, secret, 40) == 0
           && zmq_setsockopt(socket, ZMQ_ZAP_DOMAIN, domain, strlen(domain)) == 0
           && zmq_setsockopt(socket, ZMQ_MAXMSGSIZE, &frame, sizeof frame) == 0;
}

static enum modal_status guard_keys(struct daemon *d, struct modal_error *err)
{
    char public[41], secret[41];
    enum modal_status rc;

    if (d->config->server_key[0] == 0)
        return MODAL_OK;
    rc = config_server_keys(d->config, public, secret, err);
    if (rc != MODAL_OK)
        return rc;
    d->zap = zap_open(d->context);
    if (d->zap == NULL || !guard(d->client_socket, secret, ZAP_CLIENTS)
        || (d->remote_socket != NULL && !guard(d->remote_socket, secret, ZAP_WORKERS)))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "server_key", "CURVE cannot be used: %s",
                              zmq_strerror(errno));
    explicit_bzero(secret, sizeof secret);
    return rc;
}

/* libzmq replaces the file of an ipc endpoint without asking: ask whether somebody listens. */
static bool somebody_listens(const char *path)
{
    struct sockaddr_un address = { .sun_family = AF_UNIX };
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    bool yes;

    if (fd < 0 || strlen(path) >= sizeof address.sun_path) {
        if (fd >= 0)
            close(fd);
        return false;
    }
    strcpy(address.sun_path, path);
    yes = connect(fd, (struct sockaddr *)&address, sizeof address) == 0;
    close(fd);
    return yes;
}

static enum modal_status bind_one(void *socket, const char *endpoint, int mode,
                                  struct modal_error *err)
{
    bool ipc = strncmp(endpoint, "ipc://", 6) == 0;
    struct stat there;
    mode_t mask;
    int rc;

    if (ipc && somebody_listens(endpoint + 6))
        return modal_fail_field(err, MODAL_BUSY, "bind", "%s: another daemon listens there",
                                endpoint);
    /* libzmq removes what is there */
    if (ipc && lstat(endpoint + 6, &there) == 0 && !S_ISSOCK(there.st_mode))
        return modal_fail_field(err, MODAL_BAD_INPUT, "bind", "%s: there is something else than a "
                                "socket, which would be lost", endpoint);
    mask = umask(0177);                            /* nobody else, until the mode is set */
    rc = zmq_bind(socket, endpoint);
    umask(mask);
    if (rc != 0)
        return modal_fail_field(err, MODAL_IO, "bind", "%s: %s", endpoint, zmq_strerror(errno));
    if (ipc && chmod(endpoint + 6, (mode_t)mode) != 0)
        return modal_fail_field(err, MODAL_IO, "bind", "%s: %s", endpoint, strerror(errno));
    return MODAL_OK;
}

/* A socket's path has 107 bytes (unix(7)): room for "/workers.ipc" behind the data folder, and for
 * "/modald-XXXXXX" too behind the other. */
enum {
    DATA_MOST = 90,       /* and 12 */
    RUNTIME_MOST = 60,    /* and 14 and 12 */
};

/* Where workers connect: in the data folder; where its path is too long for a socket, in a folder
 * of our own. */
static enum modal_status worker_place(struct daemon *d, struct modal_error *err)
{
    const char *runtime = getenv("XDG_RUNTIME_DIR");

    if (strlen(d->config->data) < DATA_MOST) {
        snprintf(d->worker_endpoint, sizeof d->worker_endpoint, "ipc://%.90s/workers.ipc",
                 d->config->data);
        return MODAL_OK;
    }
    snprintf(d->worker_folder, sizeof d->worker_folder, "%s/modald-XXXXXX",
             runtime != NULL && strlen(runtime) < RUNTIME_MOST ? runtime : "/tmp");
    if (mkdtemp(d->worker_folder) == NULL)
        return modal_fail(err, MODAL_IO, "%s: %s", d->worker_folder, strerror(errno));
    snprintf(d->worker_endpoint, sizeof d->worker_endpoint, "ipc://%.100s/workers.ipc",
             d->worker_folder);
    return MODAL_OK;
}

static enum modal_status open_sockets(struct daemon *d, struct modal_error *err)
{
    enum modal_status rc;

    d->context = zmq_ctx_new();
    if (d->context == NULL || zmq_ctx_set(d->context, ZMQ_MAX_SOCKETS, 65535) != 0)
        return modal_fail(err, MODAL_INTERNAL, "no ZeroMQ context: %s", zmq_strerror(errno));
    d->client_socket = router(d);
    d->worker_socket = router(d);
    if (d->config->worker_bind_count > 0)
        d->remote_socket = router(d);
    if (d->client_socket == NULL || d->worker_socket == NULL
        || (d->config->worker_bind_count > 0 && d->remote_socket == NULL))
        return modal_fail(err, MODAL_INTERNAL, "no socket: %s", zmq_strerror(errno));
    d->clients = (struct peers) { .socket = d->client_socket, .version = WIRE_VERSION };
    d->workers = (struct peers) { .socket = d->worker_socket, .version = WIRE_WORKER };
    d->remotes = (struct peers) { .socket = d->remote_socket, .version = WIRE_WORKER };
    rc = guard_keys(d, err);
    if (rc == MODAL_OK)
        rc = worker_place(d, err);
    if (rc == MODAL_OK)
        rc = bind_one(d->worker_socket, d->worker_endpoint, 0600, err);
    return rc;
}

static enum modal_status bind_all(struct daemon *d, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < d->config->bind_count; i++)
        rc = bind_one(d->client_socket, d->config->bind[i], d->config->ipc_mode, err);
    for (int i = 0; rc == MODAL_OK && i < d->config->worker_bind_count; i++)
        rc = bind_one(d->remote_socket, d->config->worker_bind[i], 0, err);
    return rc;
}

/* OpenBLAS has threads before main runs, so that no mask reaches all threads and a signalfd would
 * miss signals: a handler it is, in whichever thread, and a pipe. */
static int signal_pipe = -1;

static void on_signal(int number)
{
    unsigned char byte = (unsigned char)number;
    int saved = errno;

    if (write(signal_pipe, &byte, 1) < 0)
        errno = saved;                             /* full of signals that are still to be read */
    errno = saved;
}

/* SQLite has ledger.db-shm mapped, and the thread that reads what it was made shorter by can go on
 * nowhere.  Nothing is lost: it is made anew from the log at the next start. */
static void on_bus(int number, siginfo_t *info, void *context)
{
    (void)number;
    (void)context;
    if (info->si_code != BUS_ADRERR)
        return;                                    /* it comes again, and the default is back */
    log_out_last("level=error event=storage code=io message=\"a file that is mapped, as "
                 "ledger.db-shm of the data folder is, was made shorter by another program: start "
                 "again\"\n");
    _exit(1);
}

static enum modal_status open_signals(struct daemon *d, struct modal_error *err)
{
    /* the latter end a process by default: a stray one is told and ends nothing */
    static const int numbers[] = { SIGTERM, SIGINT, SIGHUP, SIGCHLD,
                                   SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGIO, SIGPWR,
                                   SIGSTKFLT, SIGXCPU };
    struct sigaction action = { .sa_handler = on_signal, .sa_flags = SA_RESTART };
    const struct sigaction bus = { .sa_sigaction = on_bus, .sa_flags = SA_SIGINFO | SA_RESETHAND };
    int fds[2];

    if (pipe2(fds, O_CLOEXEC | O_NONBLOCK) != 0)
        return modal_fail(err, MODAL_IO, "pipe: %s", strerror(errno));
    d->signals = fds[0];
    signal_pipe = fds[1];
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN);                      /* a file's limit is a full disk: EFBIG */
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        sigaction(numbers[i], &action, NULL);
    for (int number = SIGRTMIN; number <= SIGRTMAX; number++)
        sigaction(number, &action, NULL);
    sigaction(SIGBUS, &bus, NULL);
    return MODAL_OK;
}

/* Descriptors without which a daemon answers nobody, or ends at its first read of the ledger. */
enum {
    FEW_OWN      = 24,    /* counted: stdin to stderr, lock, ledger, tape, sockets' own, pipes */
    FEW_A_WORKER = 3,     /* its stderr, what is handed to it, its connection */
    FEW_A_THREAD = 4,     /* of the spool: the ledger's three files, and one that it reads */
    FEW_SPARE    = 5,     /* the pipes of a worker that begins, and one client */
};

/* As many as the system grants, enough of them. */
static enum modal_status raise_descriptors(const struct config *config, struct modal_error *err)
{
    rlim_t needed = (rlim_t)(FEW_OWN + config->bind_count + config->worker_bind_count
                             + FEW_A_WORKER * config->workers
                             + FEW_A_THREAD * config->spool_threads + FEW_SPARE);
    struct rlimit limit;

    if (getrlimit(RLIMIT_NOFILE, &limit) != 0)
        return MODAL_OK;
    if (limit.rlim_cur < limit.rlim_max) {
        limit.rlim_cur = limit.rlim_max < DESCRIPTORS_MOST ? limit.rlim_max : DESCRIPTORS_MOST;
        setrlimit(RLIMIT_NOFILE, &limit);
    }
    if (limit.rlim_cur >= needed)
        return MODAL_OK;
    return modal_fail(err, MODAL_BUSY, "%llu files may be open at once (ulimit -n, LimitNOFILE=); "
                      "%d workers and one client need %llu, each further client one more",
                      (unsigned long long)limit.rlim_cur, config->workers,
                      (unsigned long long)needed);
}

/* A folder that was there before we came keeps its mode; whoever made it is told what it lets
 * others see. */
static void warn_of_others(const char *folder)
{
    struct stat known;

    if (stat(folder, &known) != 0 || (known.st_mode & 07) == 0)
        return;
    loop_log("level=warning event=data_open mode=%04o data=%s "
             "message=\"the data folder is open to other users; accepted: 0750 or less\"",
             (unsigned)known.st_mode & 07777, folder);
}

/* Identifiers are mixed by the ledger's id; what HELLO tells of it is a way that does not lead
 * back, or a client could number his jobs and so count others'. */
static void name_store(struct settings *s, const char *ledger_id)
{
    char text[64];
    uint8_t digest[32];
    int length = snprintf(text, sizeof text, "modald/store/1 %s", ledger_id);

    sha256_of(ledger_id, strlen(ledger_id), digest);
    memcpy(&s->secret, digest, sizeof s->secret);
    sha256_of(text, (size_t)length, digest);
    for (size_t i = 0; i < 16; i++)
        snprintf(s->store_id + 2 * i, 3, "%02x", digest[i]);
}

static enum modal_status open_store(struct daemon *d, struct modal_error *err)
{
    struct settings *s = &d->config->settings;
    uint8_t start[8];
    char *path;
    enum modal_status rc = ledger_open(d->config->data, &d->ledger, err);

    if (rc != MODAL_OK)
        return rc;
    path = realpath(d->config->data, NULL);
    if (path == NULL)
        return modal_fail(err, MODAL_IO, "%s: %s", d->config->data, strerror(errno));
    snprintf(d->config->data, sizeof d->config->data, "%s", path);
    snprintf(s->dir, sizeof s->dir, "%s", path);
    free(path);
    warn_of_others(s->dir);
    gethostname(s->node, sizeof s->node - 1);
    name_store(s, ledger_store_id(d->ledger));
    if (getrandom(start, sizeof start, 0) != sizeof start)
        return modal_fail(err, MODAL_IO, "getrandom: %s", strerror(errno));
    for (size_t i = 0; i < sizeof start; i++)
        snprintf(s->start_id + 2 * i, 3, "%02x", start[i]);
    rc = reserve_hold(s->dir, RESERVE_BYTES, err);
    return rc == MODAL_STORAGE_FULL ? MODAL_OK : rc;     /* it is taken again once there is room */
}

/* Left by a crash between a file and its row, or a row's end and its file's: nobody was told of
 * it, or it was to go. */
static void remove_orphan(void *context, enum spool_file what, int64_t id, uint64_t bytes,
                          const char *path)
{
    struct daemon *d = context;

    if (what == SPOOL_OTHER || core_has_file(d->core, what, id)
        || file_unlink(path, NULL) != MODAL_OK)
        return;
    loop_log("level=notice event=orphan_removed bytes=%llu file=%s", (unsigned long long)bytes,
             path);
}

static enum modal_status replay(struct daemon *d, struct modal_error *err)
{
    struct ledger_visitor visitor;
    enum modal_status rc;

    d->core = core_new(&d->config->settings, loop_now());
    core_visitor(d->core, &visitor);
    rc = ledger_load(d->ledger, &visitor, err);
    return rc == MODAL_OK ? spool_list(d->config->settings.dir, remove_orphan, d, err) : rc;
}

static enum modal_status start_threads(struct daemon *d, struct modal_error *err)
{
    if (!done_open(&d->done))
        return modal_fail(err, MODAL_IO, "eventfd: %s", strerror(errno));
    /* not settings.dir, which a reload writes while they read it */
    d->ledger_thread = ledger_thread_start(d->ledger, d->config->data, &d->done);
    d->spool = spool_threads_start(d->config->data, d->config->spool_threads, &d->done);
    if (d->ledger_thread == NULL || d->spool == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "the threads could not be started");
    return MODAL_OK;
}

static enum modal_status start_pool(struct daemon *d, struct modal_error *err)
{
    const struct config *c = d->config;

    for (int slot = 0; slot < SLOTS_MOST; slot++)
        d->pool.slots[slot].stderr_fd = d->pool.slots[slot].inputs = -1;
    if (c->worker_path[0] != 0)
        snprintf(d->program, sizeof d->program, "%s", c->worker_path);
    else if (!pool_find_program(d->program))
        return modal_fail_field(err, MODAL_BAD_INPUT, "worker_path",
                                "no program modald-worker beside modald, nor in ../libexec/modald");
    d->pool.program = d->program;
    d->pool.endpoint = d->worker_endpoint;
    d->pool.data = c->settings.dir;
    d->pool.user = c->worker_user;
    d->pool.memory = c->settings.worker_memory;
    d->pool.sandbox = c->sandbox;
    return MODAL_OK;
}

static enum modal_status begin(struct daemon *d, struct modal_error *err)
{
    enum modal_status rc = notify_watchdog(&d->watchdog_ns, err);

    if (rc == MODAL_OK)
        rc = open_signals(d, err);
    if (rc == MODAL_OK)
        rc = raise_descriptors(d->config, err);
    accept_most(d->config->connections);
    if (rc == MODAL_OK)
        rc = open_store(d, err);
    if (rc == MODAL_OK)
        rc = open_sockets(d, err);
    if (rc == MODAL_OK)
        rc = start_pool(d, err);
    if (rc == MODAL_OK)
        rc = replay(d, err);
    if (rc == MODAL_OK)
        rc = start_threads(d, err);
    if (rc != MODAL_OK)
        return rc;
    accept_wake(d->done.wake);
    loop_carry_out(d, core_loaded(d->core, loop_now()));
    return bind_all(d, err);
}

static void free_tasks(struct task *tasks)
{
    struct task *task;

    while ((task = tasks) != NULL) {
        tasks = task->next;
        task_free(task);
    }
}

/* What the threads gave back too late: it is on disk, and the next start finds it there. */
static void drop_done(struct daemon *d)
{
    struct transaction *transactions, *t;
    struct task *tasks;
    bool pinged, stuck, fatal;

    if (d->done.wake < 0)
        return;
    done_take(&d->done, &transactions, &tasks, &pinged, &stuck, &fatal);
    while ((t = transactions) != NULL) {
        transactions = t->next;
        transaction_free(t);
    }
    free_tasks(d->tasks);
    free_tasks(tasks);
    done_close(&d->done);
}

static void end(struct daemon *d)
{
    pool_kill_all(&d->pool);
    if (d->client_socket != NULL)
        zmq_close(d->client_socket);
    if (d->worker_socket != NULL)
        zmq_close(d->worker_socket);
    if (d->remote_socket != NULL)
        zmq_close(d->remote_socket);
    if (d->zap != NULL)
        zmq_close(d->zap);
    if (d->context != NULL)
        zmq_ctx_term(d->context);
    if (d->worker_folder[0] != 0) {
        unlink(d->worker_endpoint + 6);
        rmdir(d->worker_folder);
    }
    spool_threads_stop(d->spool);
    ledger_thread_stop(d->ledger_thread);
    drop_done(d);
    if (d->core != NULL)
        core_free(d->core);
    if (d->ledger != NULL)
        ledger_close(d->ledger);
    door_done(&d->door);
    peers_done(&d->clients);
    peers_done(&d->workers);
    peers_done(&d->remotes);
}

static void log_ready(const struct config *config)
{
    char *endpoints = grab_text(config->bind[0]);

    for (int i = 1; i < config->bind_count; i++) {
        char *longer = grab_format("%s,%s", endpoints, config->bind[i]);
        free(endpoints);
        endpoints = longer;
    }
    loop_log("level=notice event=ready version=%s endpoint=%s data=%s workers=%d",
             MODALD_VERSION, endpoints, config->settings.dir, config->workers);
    free(endpoints);
}

int daemon_run(struct config *config, config_again *again, void *context)
{
    struct daemon *d = grab(sizeof *d);
    struct modal_error err;
    int status = 1;

    log_out_begin();
    /* malloc_trim gives back the top of the first arena alone (glibc 2.36): up to the threshold
     * below stayed in any other */
    mallopt(M_ARENA_MAX, 1);
    /* frames come from the heap again and again, not from fresh zeroed pages */
    mallopt(M_MMAP_THRESHOLD, 4 << 20);
    mallopt(M_TRIM_THRESHOLD, 64 << 20);
    *d = (struct daemon) {
        .config = config, .again = again, .again_context = context, .signals = -1 };
    d->done.wake = -1;
    if (begin(d, &err) != MODAL_OK) {
        loop_log_error("start", &err);
        status = modal_status_exit(err.status) == 2 ? 2 : 1;
    } else {
        log_ready(config);
        notify_manager("READY=1\nSTATUS=serving");
        loop_run(d);
        status = d->status;
        loop_log("level=notice event=stopped");
    }
    end(d);
    log_out_end();
    free(d);
    config_done(config);
    return status;
}
