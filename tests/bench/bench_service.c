/*
 * bench_service.c - what the daemon's durability costs, beside its peers in the same run
 *
 *   submits   durable SUBMITs a second, 64 in flight, over (a) a raw DEALER-ROUTER pair that writes
 *             and fdatasyncs each message before it answers, (b) Debian's beanstalkd -b -f0 with 64
 *             connections
 *   encrypted the same SUBMITs over tcp under CURVE, over beanstalkd's; then as the clients send
 *   lists: many in a SUBMITS, over the
 *             better of beanstalkd's with one put a write and with several
 *   disk      the same SUBMITs under CURVE, over beanstalkd's, where each sync of either takes 0.2
 *             ms at least: a good SSD's. What a sync takes here is printed too; below some 50 us no
 *             medium is behind it, and beanstalkd, which syncs for each put, gains by it what the
 *             daemon, which syncs for a group, does not
 *   cached    SUBMITs answered from an earlier result, 64 in flight
 *   upload    durable MB/s of chunks, over the least of (a) the same frames through raw ZeroMQ, (b)
 *             write and one fdatasync of the same bytes, (c) their SHA-256
 *   round     SUBMIT and WAIT of the smallest identify job, over job_run of the same job in this
 *             process
 *   idle      CPU share and memory of a daemon that does nothing
 *   restart   from the start of a daemon with 100,000 jobs and MODALD_BENCH_GB (1) of batches to
 *             its first answer
 *
 * Rounds of ours and the peers' alternate; the medians are compared.  Every answer is checked
 * before a time counts.  `bench_service PART alone` leaves the peers' rounds out, so that what it
 * and its daemon take of the processor is the service's: for tests/bench/compare.
 */
#include <fcntl.h>
#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <openssl/sha.h>
#include <zmq.h>
#include "base/crc32c.h"
#include "base/json.h"
#include "base/sha256.h"
#include "job/job.h"
#include "store/identity.h"

extern char **environ;

enum {
    ROUNDS = 5,
    SUBMITS = 2000,
    IN_FLIGHT = 64,
    EACH = 16,
    CHUNK = 262144,
    UPLOAD_CHUNKS = 512,
    ROUND_TRIPS = 100,
    SAMPLES = 64,
    DISK_US = 200,
    RESTARTS = 3,
    RESTART_JOBS = 100000
};

static char folder[] = "/tmp/modald-bench-XXXXXX";
static char endpoint[256], binaries[512];
static void *context;
static int alone;

static void die(const char *what)
{
    fprintf(stderr, "bench_service: %s\n", what);
    exit(1);
}

static double now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

static double median(double *x, int n)
{
    qsort(x, (size_t)n, sizeof *x, compare);
    return n % 2 ? x[n / 2] : (x[n / 2 - 1] + x[n / 2]) / 2;
}

static void print_figure(const char *name, double value, const char *unit, const char *peer,
                         double peer_value, int n)
{
    printf("{\"bench\":\"service\",\"case\":\"%s\",\"value\":%.6g,\"unit\":\"%s\",\"peer\":\"%s\","
           "\"peer_value\":%.6g,\"ratio\":%.4g,\"n\":%d}\n",
           name, value, unit, peer, peer_value, value / peer_value, n);
    fflush(stdout);
}

static pid_t start(char *const argv[])
{
    pid_t pid;
    posix_spawn_file_actions_t files;

    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_addopen(&files, 1, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addopen(&files, 2, "/tmp/modald-bench.log",
                                     O_WRONLY | O_CREAT | O_APPEND, 0600);
    if (posix_spawnp(&pid, argv[0], &files, NULL, argv, environ) != 0)
        die("a program could not be started");
    posix_spawn_file_actions_destroy(&files);
    return pid;
}

static void stop(pid_t pid)
{
    if (pid < 0)
        return;
    kill(pid, SIGTERM);
    waitpid(pid, NULL, 0);
}

/* --- the protocol, as far as the benchmark speaks it
 * ------------------------------------------------------------ */

/* Z85 keys of the server and of the one user there is. */
struct keys { char server[41], server_secret[41], user[41], user_secret[41]; };

static void *connect_with(const char *address, const struct keys *keys)
{
    void *socket = zmq_socket(context, ZMQ_DEALER);
    int no_linger = 0, high_water = 0, wait = 30000;

    if (keys != NULL && (zmq_setsockopt(socket, ZMQ_CURVE_SERVERKEY, keys->server, 41) != 0 ||
                         zmq_setsockopt(socket, ZMQ_CURVE_PUBLICKEY, keys->user, 41) != 0 ||
                         zmq_setsockopt(socket, ZMQ_CURVE_SECRETKEY, keys->user_secret, 41) != 0))
        die("no CURVE");

    zmq_setsockopt(socket, ZMQ_LINGER, &no_linger, sizeof no_linger);
    zmq_setsockopt(socket, ZMQ_SNDHWM, &high_water, sizeof high_water);
    zmq_setsockopt(socket, ZMQ_RCVTIMEO, &wait, sizeof wait);
    if (zmq_connect(socket, address) != 0)
        die("connect");
    return socket;
}

static void *connect_to(const char *address)
{
    return connect_with(address, NULL);
}

static void keep(void *data, void *hint)
{
    (void)data;
    (void)hint;
}

/* BODY is sent without a copy where it is large, and must then stay as it is. */
static void request(void *socket, const char *verb, const char *header, const void *body,
                    size_t size)
{
    zmq_msg_t frame;

    zmq_send(socket, "MODALD1", 7, ZMQ_SNDMORE);
    zmq_send(socket, verb, strlen(verb), ZMQ_SNDMORE);
    zmq_send(socket, header, strlen(header), body ? ZMQ_SNDMORE : 0);
    if (body != NULL && size < CHUNK)
        zmq_send(socket, body, size, 0);
    else if (body != NULL) {
        zmq_msg_init_data(&frame, (void *)(uintptr_t)body, size, keep, NULL);
        zmq_msg_send(&frame, socket, 0);
    }
}

struct body { char bytes[1 << 16]; size_t size; };

/* One answer: its header, which the caller frees, and its body.  An ERROR ends the benchmark. */
static cJSON *answer_with(void *socket, struct body *body)
{
    char *part = body->bytes;
    cJSON *header = NULL;
    int more = 1, ok = 0;

    for (int i = 0; more; i++) {
        int n = zmq_recv(socket, part, sizeof body->bytes, 0);
        size_t size = sizeof more;
        body->size = n > 0 ? (size_t)n : 0;
        if (n < 0)
            die("no answer in 30 s");
        zmq_getsockopt(socket, ZMQ_RCVMORE, &more, &size);
        if (i == 1)
            ok = n == 5 && memcmp(part, "REPLY", 5) == 0;
        if (i == 2 && json_read(part, (size_t)n, &header, NULL) != MODAL_OK)
            die("an answer is not JSON");
        if (i == 2 && !ok)
            die(part);
    }
    return header;
}

static cJSON *answer(void *socket)
{
    static struct body dropped;

    return answer_with(socket, &dropped);
}

static const char *text_of(const cJSON *header, const char *key)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(header, key);

    return cJSON_IsString(item) ? item->valuestring : "";
}

static void put_file(const char *name, const char *text)
{
    char path[160];
    FILE *f;

    snprintf(path, sizeof path, "%s/%s", folder, name);
    f = fopen(path, "w");
    if (f == NULL || fputs(text, f) < 0 || fclose(f) != 0 || chmod(path, 0600) != 0)
        die("a file could not be written");
}

static void make_keys(struct keys *keys)
{
    char text[600];

    if (zmq_curve_keypair(keys->server, keys->server_secret) != 0 ||
        zmq_curve_keypair(keys->user, keys->user_secret) != 0)
        die("no CURVE keys");
    snprintf(text, sizeof text, "public-key = \"%s\"\nsecret-key = \"%s\"\n", keys->server,
             keys->server_secret);
    put_file("server.key", text);
    snprintf(text, sizeof text, "%s bench submit\n", keys->user);
    put_file("keys", text);
    snprintf(text, sizeof text, "server_key = %s/server.key\nkeys = %s/keys\n", folder, folder);
    put_file("config", text);
}

/* SECOND: one more endpoint, under CURVE as the first; or NULL, and then without keys. */
static pid_t start_daemon_at(const char *workers, const char *second)
{
    char program[600], data[128], bind[160], config[160];
    struct stat st;

    snprintf(program, sizeof program, "%s/bin/modald", binaries);
    snprintf(data, sizeof data, "%s/data", folder);
    snprintf(bind, sizeof bind, "%s/sock", folder);
    snprintf(endpoint, sizeof endpoint, "ipc://%s", bind);
    unlink(bind);
    snprintf(config, sizeof config, "%s/config", folder);
    pid_t pid = start((char *[]) { program, (char *)"--data", data, (char *)"--bind", endpoint,
                                  (char *)"--workers", (char *)(uintptr_t)workers,
                                  second != NULL ? (char *)"--bind" : NULL,
                                  (char *)(uintptr_t)second, (char *)"--config", config, NULL });
    for (int i = 0; stat(bind, &st) != 0; i++) {
        if (i > 1000 || waitpid(pid, NULL, WNOHANG) != 0)
            die("the daemon does not come up; see /tmp/modald-bench.log");
        poll(NULL, 0, 10);
    }
    return pid;
}

static pid_t start_daemon(const char *workers)
{
    return start_daemon_at(workers, NULL);
}

/* --- what a process takes --- */

static double cpu_seconds(pid_t pid, double *resident_mb)
{
    char path[64], text[1024];
    unsigned long user = 0, system = 0;
    long pages = 0;

    snprintf(path, sizeof path, "/proc/%d/stat", (int)pid);
    FILE *f = fopen(path, "r");
    if (f == NULL || fgets(text, sizeof text, f) == NULL)
        die("no /proc");
    fclose(f);
    sscanf(
        strrchr(text, ')') + 1,
        " %*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %lu %lu %*d %*d %*d %*d %*d %*d %*u %*u %ld",
        &user, &system, &pages);
    *resident_mb = (double)pages * (double)sysconf(_SC_PAGESIZE) / 1e6;
    return (double)(user + system) / (double)sysconf(_SC_CLK_TCK);
}

static double own_cpu(void)
{
    struct timespec t;

    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* --- submits
 * -------------------------------------------------------------------------------------------------
 */

static double signal_of(int k)
{
    return exp(-0.01 * k) * cos(0.7 * k);
}

static size_t submit_header(char *header, size_t room, long id, const char *extra)
{
    return (size_t)snprintf(
        header, room,
        "{\"id\":%ld,\"kind\":\"identify\",\"options\":{\"rank.fixed\":2},\"input\":"
        "{\"content\":\"batch\",\"samples\":%d,\"channels\":1,\"dt\":0.1},\"key\":\"k%ld\"%s}",
        id, SAMPLES, id, extra);
}

static double submit_round(void *socket, long *next)
{
    double body[SAMPLES], from = now();
    char header[512];
    int sent = 0, got = 0;

    while (got < SUBMITS) {
        while (sent < SUBMITS && sent - got < IN_FLIGHT) {
            for (int k = 0; k < SAMPLES; k++)
                /* each its own input: nothing is answered from the cache */
                body[k] = signal_of(k) + 1e-9 * (double)*next;
            /* stays queued: only the submit is timed */
            submit_header(header, sizeof header, (*next)++, ",\"not_before\":4e9");
            request(socket, "SUBMIT", header, body, sizeof body);
            sent++;
        }
        cJSON *doc = answer(socket);
        if (strcmp(text_of(doc, "state"), "queued") != 0)
            die("a submitted job is not queued");
        cJSON_Delete(doc);
        got++;
    }
    return SUBMITS / (now() - from);
}

/* A SUBMITS of EACH_JOBS, and what it carries. */
static void send_many(void *socket, long *next, int each_jobs)
{
    static double body[4 * EACH * SAMPLES];
    static char header[4 * EACH * 256];
    size_t used = (size_t)snprintf(header, sizeof header, "{\"id\":%ld,\"jobs\":[", *next);

    for (int i = 0; i < each_jobs; i++, ++*next) {
        for (int k = 0; k < SAMPLES; k++)
            body[i * SAMPLES + k] = signal_of(k) + 1e-9 * (double)*next;
        used +=
            (size_t)snprintf(header + used, sizeof header - used,
                             "%s{\"kind\":\"identify\",\"options\":{\"rank.fixed\":2},\"input\":"
                             "{\"content\":\"batch\",\"samples\":%d,\"channels\":1,\"dt\":0.1},"
                             "\"key\":\"k%ld\",\"not_before\":4e9}",
                             i > 0 ? "," : "", SAMPLES, *next);
    }
    snprintf(header + used, sizeof header - used, "]}");
    request(socket, "SUBMITS", header, body, (size_t)each_jobs * SAMPLES * sizeof *body);
}

/* Jobs that the answer to a SUBMITS says are queued; any other ends the benchmark. */
static int count_queued(void *socket)
{
    struct body list = { 0 };
    cJSON *doc = NULL, *job;
    int count = 0;

    cJSON_Delete(answer_with(socket, &list));
    if (json_read(list.bytes, list.size, &doc, NULL) != MODAL_OK)
        die("a list of answers is not JSON");
    cJSON_ArrayForEach(job, cJSON_GetObjectItemCaseSensitive(doc, "jobs")) {
        if (strcmp(text_of(job, "state"), "queued") != 0)
            die(list.bytes);
        count++;
    }
    cJSON_Delete(doc);
    return count;
}

static double submits_round(void *socket, long *next, int each_jobs, int in_flight)
{
    double from = now();
    int sent = 0, got = 0;

    while (got < SUBMITS) {
        for (; sent < SUBMITS && sent - got <= in_flight - each_jobs; sent += each_jobs)
            send_many(socket, next, each_jobs);
        got += count_queued(socket);
    }
    return got / (now() - from);
}

struct raw { void *socket; int file; long bytes; int sync_each; };

/* The raw peer: every message is written (and synced, where asked) before it is answered. */
static void *raw_server(void *argument)
{
    struct raw *raw = argument;
    static _Thread_local char part[CHUNK + 64];
    char identity[64], header[512];

    for (;;) {
        int n_identity = zmq_recv(raw->socket, identity, sizeof identity, 0), more = 1,
            n_header = 0;
        if (n_identity < 0)
            return NULL;
        for (int i = 0; more; i++) {
            size_t size = sizeof more;
            int n = zmq_recv(raw->socket, part, sizeof part, 0);
            zmq_getsockopt(raw->socket, ZMQ_RCVMORE, &more, &size);
            if (raw->file >= 0 && pwrite(raw->file, part, (size_t)n, raw->bytes) != n)
                die("raw write");
            raw->bytes += n;
            if (i == 2) {
                n_header = n < (int)sizeof header ? n : (int)sizeof header;
                memcpy(header, part, (size_t)n_header);
            }
        }
        if (raw->sync_each && fdatasync(raw->file) != 0)
            die("raw sync");
        zmq_send(raw->socket, identity, (size_t)n_identity, ZMQ_SNDMORE);
        zmq_send(raw->socket, "MODALD1", 7, ZMQ_SNDMORE);
        zmq_send(raw->socket, "REPLY", 5, ZMQ_SNDMORE);
        zmq_send(raw->socket, header, (size_t)n_header, 0);
    }
}

struct raw_peer { struct raw raw; pthread_t thread; void *socket; };

static void raw_start(struct raw_peer *peer, const char *name, int sync_each, int to_disk)
{
    char address[160], path[160];
    int high_water = 0;

    snprintf(address, sizeof address, "ipc://%s/%s", folder, name);
    snprintf(path, sizeof path, "%s/%s.log", folder, name);
    peer->raw = (struct raw) { .socket = zmq_socket(context, ZMQ_ROUTER),
                              .file = to_disk ? open(path, O_RDWR | O_CREAT | O_TRUNC, 0600) : -1,
                              .sync_each = sync_each };
    zmq_setsockopt(peer->raw.socket, ZMQ_RCVHWM, &high_water, sizeof high_water);
    if (zmq_bind(peer->raw.socket, address) != 0)
        die("raw bind");
    pthread_create(&peer->thread, NULL, raw_server, &peer->raw);
    peer->socket = connect_to(address);
}

static double raw_submit_round(struct raw_peer *peer)
{
    double body[SAMPLES] = { 0 }, from = now();
    char header[512];
    int sent = 0, got = 0;

    if (alone)
        return 1;
    while (got < SUBMITS) {
        while (sent < SUBMITS && sent - got < IN_FLIGHT) {
            submit_header(header, sizeof header, sent++, "");
            request(peer->socket, "SUBMIT", header, body, sizeof body);
        }
        cJSON_Delete(answer(peer->socket));
        got++;
    }
    return SUBMITS / (now() - from);
}

/* --- beanstalkd
 * -------------------------------------------------------------------------------------------------
 */

/* A port that was free a moment ago. */
static int free_port(void)
{
    struct sockaddr_in at = { .sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK) };
    socklen_t size = sizeof at;
    int probe = socket(AF_INET, SOCK_STREAM, 0);

    bind(probe, (struct sockaddr *)&at, sizeof at);
    getsockname(probe, (struct sockaddr *)&at, &size);
    close(probe);
    return ntohs(at.sin_port);
}

static pid_t beanstalkd_start(int *port)
{
    char data[160], number[16];

    *port = free_port();
    if (alone)
        return -1;
    snprintf(number, sizeof number, "%d", *port);
    snprintf(data, sizeof data, "%s/beanstalkd", folder);
    mkdir(data, 0700);
    return start((char *[]) { (char *)"beanstalkd", (char *)"-l", (char *)"127.0.0.1", (char *)"-p",
                             number, (char *)"-b", data, (char *)"-f0", NULL });
}

/* `read` the answers that have come: how many, each "INSERTED <id>\r\n". */
static int answers_of(int fd)
{
    char reply[64 * IN_FLIGHT];
    ssize_t n = read(fd, reply, sizeof reply);
    int count = 0;

    if (n < 8 || (reply[0] == 'I' && memcmp(reply, "INSERTED", 8) != 0) ||
        memchr(reply, '_', (size_t)n) != NULL)
        die("beanstalkd refused a put");
    for (ssize_t i = 0; i < n; i++)
        count += reply[i] == '\n';
    return count;
}

/* IN_FLIGHT connections, each with EACH_PUTS puts in one write. */
static double beanstalkd_round(int port, int each_puts)
{
    struct pollfd at[IN_FLIGHT];
    static char puts[16 * 1024];
    int waits[IN_FLIGHT], n_puts = 0, sent = 0, got = 0;
    struct sockaddr_in to = { .sin_family = AF_INET,
                              .sin_port = htons((uint16_t)port),
                              .sin_addr.s_addr = htonl(INADDR_LOOPBACK) };

    if (alone)
        return 1;
    for (int i = 0; i < each_puts; i++) {
        n_puts += snprintf(puts + n_puts, sizeof puts - (size_t)n_puts, "put 100 0 60 %d\r\n",
                           (int)(SAMPLES * sizeof(double)));
        memset(puts + n_puts, 'x', SAMPLES * sizeof(double));
        n_puts += (int)(SAMPLES * sizeof(double));
        n_puts += snprintf(puts + n_puts, sizeof puts - (size_t)n_puts, "\r\n");
    }
    for (int i = 0; i < IN_FLIGHT; i++) {
        at[i] = (struct pollfd) { .fd = socket(AF_INET, SOCK_STREAM, 0), .events = POLLIN };
        for (int tries = 0; connect(at[i].fd, (struct sockaddr *)&to, sizeof to) != 0; tries++) {
            if (tries > 500)
                die("beanstalkd does not come up");
            poll(NULL, 0, 10);
        }
    }
    double from = now();
    for (int i = 0; i < IN_FLIGHT; i++, sent += each_puts)
        if (write(at[i].fd, puts, (size_t)n_puts) != n_puts || (waits[i] = each_puts) == 0)
            die("beanstalkd write");
    while (got < SUBMITS) {
        poll(at, IN_FLIGHT, 30000);
        for (int i = 0; i < IN_FLIGHT; i++) {
            if (!(at[i].revents & POLLIN))
                continue;
            int came = answers_of(at[i].fd);
            got += came;
            waits[i] -= came;
            if (waits[i] == 0 && sent < SUBMITS &&
                write(at[i].fd, puts, (size_t)n_puts) == n_puts) {
                sent += each_puts;
                waits[i] = each_puts;
            }
        }
    }
    double rate = got / (now() - from);
    for (int i = 0; i < IN_FLIGHT; i++)
        close(at[i].fd);
    return rate;
}

static void bench_submits(void)
{
    double ours[ROUNDS], raw[ROUNDS], beans[ROUNDS], took = 0, before, resident;
    long next = 1;
    int port;
    pid_t daemon = start_daemon("1"), beanstalkd = beanstalkd_start(&port);
    void *socket = connect_to(endpoint);
    struct raw_peer peer;

    raw_start(&peer, "raw-submit", 1, 1);
    for (int r = 0; r < ROUNDS; r++) {
        before = cpu_seconds(daemon, &resident);
        ours[r] = submit_round(socket, &next);
        took += cpu_seconds(daemon, &resident) - before;
        raw[r] = raw_submit_round(&peer);
        beans[r] = beanstalkd_round(port, 1);
    }
    double rate = median(ours, ROUNDS);
    print_figure("durable submits, 64 in flight", rate, "1/s",
                 "raw DEALER-ROUTER, one fdatasync a message", median(raw, ROUNDS), ROUNDS);
    print_figure("durable submits, 64 in flight", rate, "1/s", "beanstalkd -f0, 64 connections",
                 median(beans, ROUNDS), ROUNDS);
    print_figure("durable submits, the daemon's CPU for each", 1e6 * took / ROUNDS / SUBMITS, "us",
                 "goal", 100, ROUNDS);
    zmq_close(socket);
    zmq_close(peer.socket);
    stop(beanstalkd);
    stop(daemon);
}

/* Microseconds of an fdatasync after a write of 1 kB, behind the end of a file. */
static double sync_us(void)
{
    double took[200];
    char path[160], block[1024] = "";
    int file;

    snprintf(path, sizeof path, "%s/sync", folder);
    file = open(path, O_RDWR | O_CREAT | O_TRUNC, 0600);
    for (int i = 0; i < 200; i++) {
        double from = now();
        if (write(file, block, sizeof block) != sizeof block || fdatasync(file) != 0)
            die("sync");
        took[i] = 1e6 * (now() - from);
    }
    close(file);
    return median(took, 200);
}

/* ON: where; "" or ", and what a sync takes there". */
static void compare_encrypted(const char *on)
{
    double ours[ROUNDS], many[ROUNDS], most[ROUNDS], beans[ROUNDS], pipelined[ROUNDS], peer;
    char second[64], name[160];
    const char *which;
    struct keys keys;
    static long next = 2000001;                    /* a key is used once */
    int port;
    pid_t daemon, beanstalkd = beanstalkd_start(&port);

    make_keys(&keys);
    snprintf(second, sizeof second, "tcp://127.0.0.1:%d", free_port());
    daemon = start_daemon_at("1", second);
    void *socket = connect_with(second, &keys);
    for (int r = 0; r < ROUNDS; r++) {
        ours[r] = submit_round(socket, &next);
        many[r] = submits_round(socket, &next, EACH, IN_FLIGHT);
        most[r] = submits_round(socket, &next, 4 * EACH, 4 * IN_FLIGHT);
        beans[r] = beanstalkd_round(port, 1);
        pipelined[r] = beanstalkd_round(port, 4);
    }
    peer = median(beans, ROUNDS);
    snprintf(name, sizeof name, "durable submits under CURVE over tcp, 64 in flight%s", on);
    print_figure(name, median(ours, ROUNDS), "1/s", "beanstalkd -f0, 64 connections", peer, ROUNDS);
    snprintf(name, sizeof name, "the same by SUBMITS, 16 in a message, 64 in flight%s", on);
    print_figure(name, median(many, ROUNDS), "1/s", "beanstalkd -f0, 64 connections", peer, ROUNDS);
    which = median(pipelined, ROUNDS) > peer ? "beanstalkd -f0, 64 connections, 4 puts a write"
                                             : "beanstalkd -f0, 64 connections";
    peer = fmax(peer, median(pipelined, ROUNDS));
    snprintf(name, sizeof name,
             "the same by SUBMITS as the clients send lists, 64 in a message, 256 in flight%s", on);
    print_figure(name, median(most, ROUNDS), "1/s", which, peer, ROUNDS);
    zmq_close(socket);
    stop(beanstalkd);
    stop(daemon);
}

static void bench_encrypted(void)
{
    compare_encrypted("");
}

/* The part `encrypted` on a disk whose syncs cost what a medium's do. */
static void bench_disk(void)
{
    char library[600], number[16];

    snprintf(library, sizeof library, "%s/fault/libslow.so", binaries);
    snprintf(number, sizeof number, "%d", DISK_US);
    if (access(library, R_OK) != 0)
        die("no fault/libslow.so in the build folder");
    print_figure("fdatasync after 1 kB", sync_us(), "us", "taken at least in the next line",
                 DISK_US, 200);
    setenv("SYNC_US", number, 1);
    setenv("LD_PRELOAD", library, 1);
    compare_encrypted(", each sync 0.2 ms or more");
    unsetenv("LD_PRELOAD");
}

/* The same input and options again and again, each under a key of its own. */
static double cached_round(void *socket, long *next)
{
    double body[SAMPLES], from = now();
    char header[512];
    int sent = 0, got = 0;

    for (int k = 0; k < SAMPLES; k++)
        body[k] = signal_of(k);
    while (got < SUBMITS) {
        while (sent < SUBMITS && sent - got < IN_FLIGHT) {
            submit_header(header, sizeof header, (*next)++, "");
            request(socket, "SUBMIT", header, body, sizeof body);
            sent++;
        }
        cJSON *doc = answer(socket);
        if (!cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(doc, "cached")) ||
            strcmp(text_of(doc, "state"), "done") != 0)
            die("a repeated job is not answered from its result");
        cJSON_Delete(doc);
        got++;
    }
    return SUBMITS / (now() - from);
}

static void bench_cached(void)
{
    double ours[ROUNDS], body[SAMPLES];
    char header[512];
    long next = 3000001;
    pid_t daemon = start_daemon("1");
    void *socket = connect_to(endpoint);

    for (int k = 0; k < SAMPLES; k++)
        body[k] = signal_of(k);
    submit_header(header, sizeof header, 3000000, "");
    request(socket, "SUBMIT", header, body, sizeof body);
    cJSON_Delete(answer(socket));
    request(socket, "WAIT", "{\"id\":1,\"job\":\"key:k3000000\",\"timeout_s\":30}", NULL, 0);
    cJSON_Delete(answer(socket));
    for (int r = 0; r < ROUNDS; r++)
        ours[r] = cached_round(socket, &next);
    print_figure("answers from an earlier result, 64 in flight over ipc", median(ours, ROUNDS),
                 "1/s", "goal", 10000, ROUNDS);
    zmq_close(socket);
    stop(daemon);
}

/* --- upload
 * -------------------------------------------------------------------------------------------------
 */

/* Send all chunks under the credit the server gives; what RAW answers is the header itself, so
 * there the credit is ours. */
static void send_chunks(void *socket, const char *upload, const char *data, long credit)
{
    long sent = 0, got = 0;
    char header[256];

    while (got < UPLOAD_CHUNKS) {
        while (sent < UPLOAD_CHUNKS && (sent - got) * CHUNK < credit) {
            const char *chunk = data + sent * CHUNK;
            snprintf(header, sizeof header,
                     "{\"id\":%ld,\"op\":\"chunk\",\"upload\":\"%s\",\"offset\":%ld,\"crc32c\":%u}",
                     sent, upload, sent * CHUNK, crc32c(0, chunk, CHUNK));
            request(socket, "UPLOAD", header, chunk, CHUNK);
            sent++;
        }
        cJSON *reply = answer(socket);
        const cJSON *window = cJSON_GetObjectItemCaseSensitive(reply, "credit");
        if (cJSON_IsNumber(window) && window->valuedouble >= CHUNK)
            credit = (long)window->valuedouble;
        cJSON_Delete(reply);
        got++;
    }
}

/* The daemon hashes what arrives and compares at the seal; the client's own hash is not part of the
 * time. */
static double upload_round(void *socket, const char *data, int round)
{
    char header[256], upload[128], hex[65];
    uint8_t sha256[32];
    struct input_shape shape = { .type = INPUT_BATCH,
                                 .samples = UPLOAD_CHUNKS * CHUNK / 512,
                                 .channels = 64,
                                 .dt = 0.001 * (round + 1) };

    identity_of(&shape, data, (size_t)UPLOAD_CHUNKS * CHUNK, sha256);
    sha256_hex(sha256, hex);
    double from = now();

    snprintf(header, sizeof header,
             "{\"id\":1,\"op\":\"begin\",\"content\":\"batch\",\"samples\":%d,\"channels\":64,"
             "\"dt\":%.17g}",
             UPLOAD_CHUNKS * CHUNK / 512, 0.001 * (round + 1));
    request(socket, "UPLOAD", header, NULL, 0);
    cJSON *begun = answer(socket);
    long credit = (long)cJSON_GetNumberValue(cJSON_GetObjectItemCaseSensitive(begun, "credit"));
    snprintf(upload, sizeof upload, "%s", text_of(begun, "upload"));
    cJSON_Delete(begun);
    send_chunks(socket, upload, data, credit);
    snprintf(header, sizeof header,
             "{\"id\":2,\"op\":\"seal\",\"upload\":\"%s\",\"sha256\":\"%s\"}", upload, hex);
    request(socket, "UPLOAD", header, NULL, 0);
    cJSON *sealed = answer(socket);
    if (strcmp(text_of(sealed, "state"), "sealed") != 0)
        die("the upload is not sealed");
    cJSON_Delete(sealed);
    return UPLOAD_CHUNKS * (double)CHUNK / 1e6 / (now() - from);
}

static double disk_round(const char *data)
{
    char path[160];
    double from = now();

    snprintf(path, sizeof path, "%s/disk", folder);
    int file = open(path, O_RDWR | O_CREAT | O_TRUNC, 0600);
    for (int i = 0; i < UPLOAD_CHUNKS; i++)
        if (write(file, data + (long)i * CHUNK, CHUNK) != CHUNK)
            die("disk write");
    if (fdatasync(file) != 0)
        die("disk sync");
    double rate = UPLOAD_CHUNKS * (double)CHUNK / 1e6 / (now() - from);
    close(file);
    unlink(path);
    return rate;
}

static double hash_round(const char *data)
{
    unsigned char digest[SHA256_DIGEST_LENGTH];
    double from = now();

    SHA256((const unsigned char *)data, (size_t)UPLOAD_CHUNKS * CHUNK, digest);
    return UPLOAD_CHUNKS * (double)CHUNK / 1e6 / (now() - from);
}

static void bench_upload(void)
{
    double ours[ROUNDS], raw[ROUNDS], disk[ROUNDS], hash[ROUNDS], cpu[ROUNDS], before, resident;
    char *data = malloc((size_t)UPLOAD_CHUNKS * CHUNK);
    pid_t daemon = start_daemon("1");
    void *socket = connect_to(endpoint);
    struct raw_peer peer;

    for (size_t i = 0; i < (size_t)UPLOAD_CHUNKS * CHUNK / sizeof(double); i++)
        ((double *)(void *)data)[i] = sin(1e-3 * (double)i);
    raw_start(&peer, "raw-upload", 0, 0);
    before = cpu_seconds(daemon, &resident);
    for (int r = 0; r < ROUNDS; r++) {
        double from = now();
        ours[r] = upload_round(socket, data, r);
        raw[r] = disk[r] = hash[r] = cpu[r] = 1;
        if (alone)
            continue;
        from = now();
        send_chunks(peer.socket, "u", data, 16 * CHUNK);
        raw[r] = UPLOAD_CHUNKS * (double)CHUNK / 1e6 / (now() - from);
        disk[r] = disk_round(data);
        cpu[r] = own_cpu();
        hash[r] = hash_round(data);
        cpu[r] = own_cpu() - cpu[r];
    }
    double rate = median(ours, ROUNDS), least = median(raw, ROUNDS);
    const char *which = "raw ZeroMQ, same frames";
    if (median(disk, ROUNDS) < least)
        least = median(disk, ROUNDS), which = "disk, write and one fdatasync";
    if (median(hash, ROUNDS) < least)
        least = median(hash, ROUNDS), which = "SHA-256";
    print_figure("durable upload, 134 MB in 256 kB chunks", rate, "MB/s", which, least, ROUNDS);
    print_figure("durable upload, the daemon's CPU for 1 GB",
                 (cpu_seconds(daemon, &resident) - before) * 1e9 / ROUNDS / UPLOAD_CHUNKS / CHUNK,
                 "s", "SHA-256 of it", median(cpu, ROUNDS) * 1e9 / UPLOAD_CHUNKS / CHUNK, ROUNDS);
    zmq_close(socket);
    zmq_close(peer.socket);
    stop(daemon);
    free(data);
}

/* --- round trip and idleness
 * ------------------------------------------------------------------------------------ */

static void bench_round_trip(void)
{
    double ours[ROUND_TRIPS], local[ROUND_TRIPS], body[SAMPLES];
    char header[512];
    pid_t daemon = start_daemon("1");
    void *socket = connect_to(endpoint);

    for (int i = 0; i < ROUND_TRIPS; i++) {
        for (int k = 0; k < SAMPLES; k++)
            body[k] = signal_of(k) + 1e-7 * i;
        double from = now();
        submit_header(header, sizeof header, 1000000 + i, "");
        request(socket, "SUBMIT", header, body, sizeof body);
        cJSON *doc = answer(socket);
        snprintf(header, sizeof header,
                 "{\"id\":\"w\",\"job\":\"%s\",\"timeout_s\":30,\"result\":true}",
                 text_of(doc, "job"));
        cJSON_Delete(doc);
        request(socket, "WAIT", header, NULL, 0);
        doc = answer(socket);
        if (strcmp(text_of(doc, "state"), "done") != 0)
            die("the smallest job is not done");
        cJSON_Delete(doc);
        ours[i] = local[i] = now() - from;
        if (alone)
            continue;

        struct batch batch = { .samples = SAMPLES, .channels = 1, .signals = body, .dt = 0.1 };
        cJSON *options = cJSON_CreateObject();
        cJSON_AddNumberToObject(options, "rank.fixed", 2);
        struct job_result result;
        from = now();
        if (job_run(
                &(struct job_request) { .kind = "identify", .options = options, .batch = &batch },
                &result, NULL) != MODAL_OK)
            die("the smallest job fails in process");
        free(json_print(result.result));
        local[i] = now() - from;
        job_result_done(&result);
        cJSON_Delete(options);
    }
    print_figure("round trip of the smallest identify", 1e3 * median(ours, ROUND_TRIPS), "ms",
                 "the same job in process", 1e3 * median(local, ROUND_TRIPS), ROUND_TRIPS);
    zmq_close(socket);
    stop(daemon);
}

static void bench_idle(void)
{
    double resident, before, share;
    pid_t daemon = start_daemon("1");

    poll(NULL, 0, 2000);
    before = cpu_seconds(daemon, &resident);
    poll(NULL, 0, 20000);
    share = (cpu_seconds(daemon, &resident) - before) / 20;
    print_figure("idle daemon, CPU share over 20 s", 100 * share, "%", "goal", 0.1, 1);
    print_figure("idle daemon, resident memory", resident, "MB", "goal", 30, 1);
    stop(daemon);
}

/* A folder of its own with JOBS queued jobs, each with its input, and GIGABYTES in batches. */
static void lay_out(double gigabytes, long jobs)
{
    char command[160];
    char *data = calloc((size_t)UPLOAD_CHUNKS, CHUNK);
    long next = 1;
    int rounds = (int)ceil(gigabytes * 1e9 / UPLOAD_CHUNKS / CHUNK);

    snprintf(command, sizeof command, "rm -rf %s/data", folder);
    if (data == NULL || system(command) != 0)
        die("no room");
    pid_t daemon = start_daemon("1");
    void *socket = connect_to(endpoint);
    for (size_t i = 0; i < (size_t)UPLOAD_CHUNKS * CHUNK / sizeof(double); i++)
        ((double *)(void *)data)[i] = sin(1e-3 * (double)i);
    for (int r = 0; r < rounds; r++)
        upload_round(socket, data, r);
    while (next <= jobs)
        submits_round(socket, &next, 50, 250);     /* no more than a queue holds */
    zmq_close(socket);
    stop(daemon);
    free(data);
}

static void bench_restart(void)
{
    const char *asked = getenv("MODALD_BENCH_GB");
    double gigabytes = asked != NULL ? strtod(asked, NULL) : 1, took[RESTARTS], resident, cpu = 0;
    char name[96];

    lay_out(gigabytes, RESTART_JOBS);
    for (int r = 0; r < RESTARTS; r++) {
        double from = now();
        pid_t daemon = start_daemon("1");
        void *socket = connect_to(endpoint);
        request(socket, "STATUS", "{\"id\":1,\"job\":\"key:k100000\"}", NULL, 0);
        cJSON *doc = answer(socket);
        took[r] = now() - from;
        if (strcmp(text_of(doc, "state"), "queued") != 0)
            die("a job is not there after the restart");
        cJSON_Delete(doc);
        cpu = cpu_seconds(daemon, &resident);
        zmq_close(socket);
        stop(daemon);
    }
    snprintf(name, sizeof name,
             "restart with 100000 jobs and %g GB of batches, to the first answer", gigabytes);
    print_figure(name, median(took, RESTARTS), "s", "goal", 5, RESTARTS);
    print_figure("the same, the daemon's CPU", cpu, "s", "goal", 5, 1);
    print_figure("the same, resident memory", resident, "MB",
                 "its jobs and their inputs at 1 kB each, beside 17 MB", 17 + RESTART_JOBS / 1e3,
                 1);
}

static const struct { const char *name; void (*run)(void);
} parts[] = {
    { "submits", bench_submits }, { "encrypted", bench_encrypted }, { "disk", bench_disk },
    { "cached", bench_cached },   { "upload", bench_upload },       { "round", bench_round_trip },
    { "idle", bench_idle },       { "restart", bench_restart },
};

/* bench_service [PART [alone]]: all parts, or one. */
int main(int argc, char **argv)
{
    const char *build = getenv("MODALD_BUILD");

    snprintf(binaries, sizeof binaries, "%s", build ? build : "build");
    alone = argc > 2 && strcmp(argv[2], "alone") == 0;
    if (mkdtemp(folder) == NULL || (context = zmq_ctx_new()) == NULL)
        die("no temporary folder");
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
        if (argc < 2 || strcmp(argv[1], parts[i].name) == 0)
            parts[i].run();
    char command[160];
    snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command) == 0 ? 0 : 1;
}
