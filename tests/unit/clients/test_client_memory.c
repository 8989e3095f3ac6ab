/* test_client_memory.c - the client library, and the reader of text, where the n-th allocation
 * fails
 *
 * Tests as well: csv.c modald.c
 * The allocations are those of our own code, this program's (tests.cmake) and cJSON's: libzmq ends
 * the process where its own fail.  The server is a thread that knows its answers by heart. */
#include "check.h"
#include <pthread.h>
#include <sys/wait.h>
#include <unistd.h>
#include <zmq.h>
#include "base/json.h"
#include "ctl/csv.h"
#include "modald.h"

void *__real_malloc(size_t size), *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *block, size_t size);
char *__real_strdup(const char *text), *__real_strndup(const char *text, size_t most);
void *__wrap_malloc(size_t size), *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *block, size_t size);
char *__wrap_strdup(const char *text), *__wrap_strndup(const char *text, size_t most);

static _Thread_local long left;                 /* allocations until one fails; 0: none does */
static _Thread_local bool failed;

static bool fails(void)
{
    if (left == 0 || --left > 0)
        return false;
    return failed = true;
}

void *__wrap_malloc(size_t size)
{
    return fails() ? NULL : __real_malloc(size);
}

void *__wrap_calloc(size_t count, size_t size)
{
    return fails() ? NULL : __real_calloc(count, size);
}

void *__wrap_realloc(void *block, size_t size)
{
    return fails() ? NULL : __real_realloc(block, size);
}

char *__wrap_strdup(const char *text)
{
    return fails() ? NULL : __real_strdup(text);
}

char *__wrap_strndup(const char *text, size_t most)
{
    return fails() ? NULL : __real_strndup(text, most);
}

/* -- the server -------------------------------------------------------------------------------- */

static void *context, *router;
static char endpoint[64], last_submit[65536];    /* its header, but for the id at its end */

/* Its members behind the id; BODY NULL: none. */
static void answer(const zmq_msg_t *peer, long id, const char *members, const char *body)
{
    char header[1024];

    snprintf(header, sizeof header, "{\"id\":%ld,%s}", id, members);
    zmq_send(router, zmq_msg_data((zmq_msg_t *)peer), zmq_msg_size(peer), ZMQ_SNDMORE);
    zmq_send(router, "MODALD1", 7, ZMQ_SNDMORE);
    zmq_send(router, "REPLY", 5, ZMQ_SNDMORE);
    zmq_send(router, header, strlen(header), body != NULL ? ZMQ_SNDMORE : 0);
    if (body != NULL)
        zmq_send(router, body, strlen(body), 0);
}

#define DONE "\"job\":\"abcdefgh\",\"key\":\"mine\",\"kind\":\"identify\",\"state\":\"done\""
#define RESULT "{\"kind\":\"identify\",\"modes\":[{\"frequency_hz\":2.5,\"damping_ratio\":0.03}]}"

static void serve_one(const zmq_msg_t *peer, const char *verb, const char *header)
{
    const char *at = strstr(header, "\"id\":"), *offset = strstr(header, "\"offset\":");
    long id = at != NULL ? atol(at + 5) : 0;

    if (strcmp(verb, "SUBMIT") == 0 && at != NULL) {
        size_t length = (size_t)(at - header) < sizeof last_submit - 1 ? (size_t)(at - header) : 0;
        memcpy(last_submit, header, length);
        last_submit[length] = 0;
    }
    if (strcmp(verb, "RESULT") == 0)
        answer(peer, id, "\"part\":\"document\",\"offset\":0,\"bytes\":71,\"total\":71", RESULT);
    else if (strcmp(verb, "UPLOAD") != 0)
        answer(peer, id, "\"verb\":\"JOB\"," DONE, NULL);
    else if (strstr(header, "\"op\":\"begin\"") != NULL)
        answer(peer, id, "\"verb\":\"UPLOAD\",\"upload\":\"u\",\"state\":\"open\",\"present\":0,"
               "\"credit\":1048576", NULL);
    else if (offset != NULL)
        answer(peer, id, "\"verb\":\"UPLOAD\",\"upload\":\"u\",\"state\":\"open\","
               "\"present\":160000,\"credit\":1048576", NULL);
    else
        answer(peer, id, "\"verb\":\"UPLOAD\",\"upload\":\"u\",\"state\":\"sealed\"", NULL);
}

static void *serve(void *unused)
{
    static char frame[4][1 << 20];
    zmq_msg_t peer;

    zmq_msg_init(&peer);
    while (zmq_msg_recv(&peer, router, 0) >= 0) {
        int more = zmq_msg_more(&peer);
        for (int i = 0; more; i++) {
            int size = zmq_recv(router, frame[i & 3], sizeof *frame - 1, 0);
            frame[i & 3][size < 0 ? 0 : size] = 0;
            zmq_getsockopt(router, ZMQ_RCVMORE, &more, &(size_t) { sizeof more });
        }
        serve_one(&peer, frame[1], frame[2]);
    }
    zmq_msg_close(&peer);
    zmq_close(router);
    return unused;
}

/* -- what is asked ----------------------------------------------------------------------------- */

static double samples[2][10000 * 2];             /* inside SUBMIT, and uploaded */
static const char *const names[] = { "a", "b" };
static const struct modald_batch small = { samples[0], 50, 2, 0.1, 0, names, "m" };
static const struct modald_batch large = { samples[1], 10000, 2, 0.1, 0, names, "m" };
static const struct modald_job job = { .options = "{\"rank.fixed\":2,\"window\":[0,1]}",
                                       .key = "mine", .priority = 7 };

static int ask_submit(struct modald *m, char **out, struct modald_error *error)
{
    return modald_submit(m, &job, &small, 100, out, error);
}

static int ask_submit_large(struct modald *m, char **out, struct modald_error *error)
{
    return modald_submit(m, &job, &large, 100, out, error);
}

static int ask_submit_scene(struct modald *m, char **out, struct modald_error *error)
{
    return modald_submit_scene(m, &job, "{\"omega\":1}", 100, out, error);
}

static int ask_upload(struct modald *m, char **out, struct modald_error *error)
{
    char sha256[65];
    int rc = modald_upload(m, &large, 100, sha256, error);

    *out = rc == 0 ? __real_strdup(sha256) : NULL;
    return rc;
}

static int ask_status(struct modald *m, char **out, struct modald_error *error)
{
    return modald_status(m, "key:mine", 100, out, error);
}

static int ask_cancel(struct modald *m, char **out, struct modald_error *error)
{
    return modald_cancel(m, "key:mine", 100, out, error);
}

static int ask_wait(struct modald *m, char **out, struct modald_error *error)
{
    return modald_wait(m, "key:mine", 100, out, error);
}

static int ask_result(struct modald *m, char **out, struct modald_error *error)
{
    return modald_result(m, "key:mine", 100, out, error);
}

static int ask_run(struct modald *m, char **out, struct modald_error *error)
{
    return modald_run(m, &job, &small, 100, out, error);
}

static int ask_connect(struct modald *m, char **out, struct modald_error *error)
{
    struct modald *other = NULL;
    int rc = modald_connect(endpoint, NULL, &other, error);

    (void)m;
    *out = rc == 0 ? __real_strdup("connected") : NULL;
    modald_disconnect(other);
    return rc;
}

static struct modald *begin(pthread_t *server)
{
    struct modald *m = NULL;
    struct modald_error error = { 0 };

    snprintf(endpoint, sizeof endpoint, "ipc:///tmp/modald-test-memory-%d", (int)getpid());
    context = zmq_ctx_new();
    router = zmq_socket(context, ZMQ_ROUTER);
    CHECK(zmq_bind(router, endpoint) == 0);
    CHECK(pthread_create(server, NULL, serve, NULL) == 0);
    CHECK(modald_connect(endpoint, NULL, &m, &error) == MODALD_DONE);
    return m;
}

static void end(struct modald *m, pthread_t server)
{
    modald_disconnect(m);
    zmq_ctx_shutdown(context);
    pthread_join(server, NULL);
    zmq_ctx_term(context);
    unlink(endpoint + strlen("ipc://"));
}

TEST(where_the_nth_allocation_of_the_client_library_fails_it_says_so_or_says_all)
{
    static int (*const asks[])(struct modald *, char **, struct modald_error *) = {
        ask_connect, ask_submit, ask_submit_large, ask_submit_scene, ask_upload, ask_status,
        ask_cancel, ask_wait, ask_result, ask_run,
    };
    pthread_t server;
    struct modald *m = begin(&server);
    struct modald_error error;
    long reached = 0;

    cJSON_InitHooks(&(cJSON_Hooks) { .malloc_fn = __wrap_malloc, .free_fn = free });
    for (size_t i = 0; i < sizeof asks / sizeof *asks; i++) {
        char *whole = NULL, *out, submit[sizeof last_submit] = "";
        if (asks[i](m, &whole, &error) != MODALD_DONE || whole == NULL)
            fail_msg("question %zu: %s: %s", i, error.code, error.message);
        strcpy(submit, last_submit);
        for (long n = 1; n == 1 || failed; n++) {
            out = NULL;
            failed = false;
            left = n;
            error = (struct modald_error) { 0 };
            int rc = asks[i](m, &out, &error);
            left = 0;
            reached += failed;
            /* a text is shortened to its length where there is memory for that */
            if (rc == MODALD_DONE)
                CHECK_STRING(out, whole);
            else if (strcmp(error.code, "no_memory") != 0)
                fail_msg("question %zu, allocation %ld: %s: %s", i, n, error.code, error.message);
            if (rc != MODALD_DONE)
                CHECK(rc == MODALD_FAILED && failed && error.message[0] != 0);
            /* whatever reached the server says all */
            CHECK_STRING(last_submit, submit);
            modald_free(out);
        }
        modald_free(whole);
    }
    cJSON_InitHooks(NULL);
    print_message("%ld allocations failed\n", reached);
    CHECK(reached > 300);
    end(m, server);
}

/* As modalctl, which ends. */
static void *allocate_or_end(size_t size)
{
    void *block = __wrap_malloc(size);

    if (block == NULL)
        _exit(2);
    return block;
}

static const char text[] = "made by nobody\nno table\nTime,tip,root\ns,m,m\n0,1,2\n0.1,3,4\n"
                           "0.2,5,6.5\n";

static bool is_whole(const struct signals *s)
{
    return s->samples == 3 && s->channels == 2 && fabs(s->dt - 0.1) < 1e-15
        && strcmp(s->names[0], "tip") == 0 && strcmp(s->names[1], "root") == 0
        && strcmp(s->units, "m") == 0 && s->preamble == 2 && s->x[5] == 6.5;
}

/* How a process ends that reads the text where its Nth allocation fails: 0, it was none; 1, all was
 * there; 2, by allocate_or_end; 3, with MODAL_NO_MEMORY; 4, with anything else. */
static int read_without(long n)
{
    int status = 0;
    pid_t pid = fork();

    if (pid == 0) {
        struct signals s = { 0 };
        struct modal_error err;
        char copy[sizeof text];
        json_memory_by(allocate_or_end);
        memcpy(copy, text, sizeof text);
        left = n;
        enum modal_status rc = csv_read(copy, "x.csv", &(struct signals_options) { 0 }, &s, NULL,
                                        &err);
        left = 0;
        if (rc == MODAL_NO_MEMORY)
            signals_done(&s);
        _exit(rc == MODAL_NO_MEMORY ? 3 : rc != MODAL_OK || !is_whole(&s) ? 4 : failed);
    }
    CHECK(pid > 0 && waitpid(pid, &status, 0) == pid && WIFEXITED(status));
    return WEXITSTATUS(status);
}

TEST(where_the_nth_allocation_of_the_reader_of_text_fails_no_table_is_another)
{
    int ends[5] = { 0 };

    for (long n = 1; ends[0] == 0 && ends[4] == 0; n++)
        ends[read_without(n)]++;
    print_message("%d whole, %d ended, %d refused\n", ends[1], ends[2], ends[3]);
    CHECK(ends[4] == 0 && ends[2] > 0 && ends[3] > 0);
}
