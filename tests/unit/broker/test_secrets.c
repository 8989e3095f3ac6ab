/* Memory of handshakes: what libsodium is asked for it, counted by what it locks. */
#include "broker/shell/secrets.h"
#include "check.h"
#include <signal.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <zmq.h>

enum { MOST = 64 };

static atomic_int locks, frees;

/* Before the C library's, as libsodium calls them. */
int mlock(const void *at, size_t size)
{
    locks++;
    return (int)syscall(SYS_mlock, at, size);
}

int munlock(const void *at, size_t size)
{
    frees++;
    return (int)syscall(SYS_munlock, at, size);
}

/* A context starts libsodium. */
static void *begin(void)
{
    CHECK(zmq_has("curve") == 1);
    return zmq_ctx_new();
}

TEST(a_thousand_handshakes_lock_memory_once)
{
    void *context = begin(), *first, *second;

    first = sodium_malloc(100);
    sodium_free(sodium_malloc(300));
    sodium_free(first);
    locks = frees = 0;
    for (int i = 0; i < 1000; i++) {
        first = sodium_malloc(100);
        second = sodium_malloc(300);
        CHECK(first != NULL && second != NULL && first != second);
        sodium_free(first);
        sodium_free(second);
    }
    CHECK(locks == 0 && frees == 0);
    zmq_ctx_term(context);
}

TEST(a_secret_is_gone_when_its_memory_is_had_again)
{
    static const unsigned char zero[500];
    void *context = begin();
    unsigned char *secret[MOST];

    for (int round = 0; round < 2; round++) {
        for (int i = 0; i < 4; i++) {
            secret[i] = sodium_malloc(sizeof zero);
            CHECK(memcmp(secret[i], zero, sizeof zero) == 0);
            memset(secret[i], 0x5a, sizeof zero);
        }
        for (int i = 0; i < 4; i++)
            sodium_free(secret[i]);
    }
    zmq_ctx_term(context);
}

TEST(what_is_written_beyond_a_secret_ends_the_process)
{
    static const size_t sizes[] = { 1, 300, 512, 1000 };
    void *context = begin();

    for (int i = 0; i < 4; i++) {
        volatile unsigned char *secret = sodium_malloc(sizes[i]);
        pid_t child = fork();
        int status = 0;

        if (child == 0) {
            signal(SIGSEGV, SIG_DFL);
            secret[sizes[i] - 1] = 1;
            secret[sizes[i]] = 1;
            _exit(0);
        }
        CHECK(waitpid(child, &status, 0) == child);
        CHECK(WIFSIGNALED(status) && WTERMSIG(status) == SIGSEGV);
        sodium_free((void *)secret);
    }
    zmq_ctx_term(context);
}

TEST(as_many_secrets_and_as_large_as_are_asked_for_lie_apart)
{
    static const size_t sizes[] = { 1, 511, 512, 513, 100000 };
    void *context = begin();
    unsigned char *secret[MOST];

    for (int i = 0; i < MOST; i++) {
        secret[i] = sodium_malloc(sizes[i % 5]);
        CHECK(secret[i] != NULL);
        memset(secret[i], i, sizes[i % 5]);
    }
    for (int i = 0; i < MOST; i++)
        for (size_t at = 0; at < sizes[i % 5]; at++)
            CHECK(secret[i][at] == i);
    locks = frees = 0;
    for (int i = 0; i < MOST; i++)
        sodium_free(secret[i]);
    CHECK(locks == 0 && frees > 0);
    sodium_free(NULL);
    sodium_free(sodium_malloc(200));
    CHECK(locks == 0);
    zmq_ctx_term(context);
}
