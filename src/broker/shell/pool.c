/* pool.c - see pool.h; never fork: copying the page tables of a large daemon takes longer than
 * many jobs */
#include "broker/shell/pool.h"
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

extern char **environ;

enum { INPUTS_AT = 3 };         /* in the worker */

/* Environment of a worker: nothing of the daemon's but what the numerics need. */
static char **worker_environment(void)
{
    static const char *const names[] = {
        "PATH", "LANG", "TZ", "OPENBLAS_CORETYPE", "MODALD_FAULT", "MODALD_WORKER_FAULT",
        "ASAN_OPTIONS", "UBSAN_OPTIONS", NULL };
    char **out = grab(24 * sizeof *out);
    int count = 0;

    for (int i = 0; names[i] != NULL; i++)
        if (getenv(names[i]) != NULL && strcmp(names[i], "MODALD_FAULT") != 0)
            out[count++] = grab_format("%s=%s", names[i], getenv(names[i]));
    out[count++] = grab_text("OPENBLAS_NUM_THREADS=1");
    return out;
}

static void free_environment(char **e)
{
    for (int i = 0; e[i] != NULL; i++)
        free(e[i]);
    free(e);
}

static int start(struct pool *pool, int out_fd, int inputs, pid_t *pid)
{
    char memory[32], *argv[16];
    char **environment = worker_environment();
    int argc = 0, error;
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t none, all;

    snprintf(memory, sizeof memory, "%lld", (long long)pool->memory);
    argv[argc++] = (char *)pool->program;
    argv[argc++] = (char *)"--connect", argv[argc++] = (char *)pool->endpoint;
    argv[argc++] = (char *)"--data", argv[argc++] = (char *)pool->data;
    if (pool->user[0] != 0)
        argv[argc++] = (char *)"--user", argv[argc++] = (char *)pool->user;
    if (pool->memory > 0)
        argv[argc++] = (char *)"--memory", argv[argc++] = memory;
    argv[argc++] = (char *)"--inputs";
    argv[argc++] = (char *)"--sandbox", argv[argc++] = (char *)(pool->sandbox ? "on" : "off");
    argv[argc] = NULL;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions, 1, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, out_fd, 2);
    posix_spawn_file_actions_adddup2(&actions, inputs, INPUTS_AT);
    posix_spawnattr_init(&attributes);
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF
                                              | POSIX_SPAWN_SETPGROUP);
    error = posix_spawn(pid, pool->program, &actions, &attributes, argv, environment);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    free_environment(environment);
    return error;
}

static void close_end(int *fd)
{
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
}

bool pool_spawn(struct pool *pool, int slot)
{
    struct process *p = &pool->slots[slot];
    int says[2] = { -1, -1 }, inputs[2] = { -1, -1 }, error = 0;

    free(p->tail);
    *p = (struct process) { .stderr_fd = -1, .inputs = -1 };
    if (pipe2(says, O_CLOEXEC) != 0
        || socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, inputs) != 0)
        error = errno;
    if (error == 0) {
        fcntl(says[0], F_SETFL, O_NONBLOCK);
        error = start(pool, says[1], inputs[1], &p->pid);
    }
    close_end(&says[1]);
    close_end(&inputs[1]);
    if (error != 0) {
        close_end(&says[0]);
        close_end(&inputs[0]);
        p->pid = 0;
        errno = error;
        return false;
    }
    p->stderr_fd = says[0];
    p->inputs = inputs[0];
    return true;
}

void pool_hand(struct pool *pool, int slot, const char *text, int descriptor)
{
    union { char room[CMSG_SPACE(sizeof(int))]; struct cmsghdr align; } control = { { 0 } };
    struct iovec part = { .iov_base = (void *)(uintptr_t)text, .iov_len = strlen(text) };
    struct msghdr message = { .msg_iov = &part, .msg_iovlen = 1, .msg_control = &control,
                              .msg_controllen = sizeof control };
    struct cmsghdr *with = CMSG_FIRSTHDR(&message);

    with->cmsg_level = SOL_SOCKET;
    with->cmsg_type = SCM_RIGHTS;
    with->cmsg_len = CMSG_LEN(sizeof descriptor);
    memcpy(CMSG_DATA(with), &descriptor, sizeof descriptor);
    while (sendmsg(pool->slots[slot].inputs, &message, MSG_DONTWAIT | MSG_NOSIGNAL) < 0
           && errno == EINTR)
        ;
}

void pool_kill(struct pool *pool, int slot)
{
    if (pool->slots[slot].pid > 0) {
        kill(-pool->slots[slot].pid, SIGKILL);
        kill(pool->slots[slot].pid, SIGKILL);      /* it may not lead its group yet */
    }
}

void pool_kill_all(struct pool *pool)
{
    for (int slot = 0; slot < SLOTS_MOST; slot++)
        pool_kill(pool, slot);
    for (int slot = 0; slot < SLOTS_MOST; slot++) {
        struct process *p = &pool->slots[slot];
        if (p->pid > 0)
            waitpid(p->pid, NULL, 0);
        if (p->pid > 0) {
            close_end(&p->stderr_fd);
            close_end(&p->inputs);
        }
        free(p->tail);
        *p = (struct process) { .stderr_fd = -1, .inputs = -1 };
    }
}

static void append_tail(struct process *p, const char *data, size_t size)
{
    if (p->tail == NULL)
        p->tail = grab(STDERR_KEPT + 1);
    if (size > STDERR_KEPT) {
        data += size - STDERR_KEPT;
        size = STDERR_KEPT;
    }
    if (p->tail_size + size > STDERR_KEPT) {
        size_t drop = p->tail_size + size - STDERR_KEPT;
        memmove(p->tail, p->tail + drop, p->tail_size - drop);
        p->tail_size -= drop;
    }
    memcpy(p->tail + p->tail_size, data, size);
    p->tail_size += size;
    p->tail[p->tail_size] = 0;
}

bool pool_read(struct pool *pool, int slot)
{
    struct process *p = &pool->slots[slot];
    char buffer[4096];
    ssize_t n;

    if (p->stderr_fd < 0)
        return false;
    for (int rounds = 0; rounds < 16 && (n = read(p->stderr_fd, buffer, sizeof buffer)) > 0;
         rounds++)
        append_tail(p, buffer, (size_t)n);
    if (n == 0) {
        close(p->stderr_fd);
        p->stderr_fd = -1;
        return false;
    }
    return true;
}

int pool_reap(struct pool *pool, int *status, const char **text)
{
    for (int slot = 0; slot < SLOTS_MOST; slot++) {
        struct process *p = &pool->slots[slot];

        if (p->pid <= 0 || waitpid(p->pid, status, WNOHANG) != p->pid)
            continue;
        kill(-p->pid, SIGKILL);                    /* children it may have left */
        pool_read(pool, slot);
        close_end(&p->stderr_fd);
        close_end(&p->inputs);
        p->pid = 0;
        p->peer = 0;
        if (p->tail != NULL)
            text_clean(p->tail, p->tail_size);
        *text = p->tail != NULL ? p->tail : "";
        return slot;
    }
    return -1;
}

int pool_slot_of_pid(const struct pool *pool, pid_t pid)
{
    for (int slot = 0; pid > 0 && slot < SLOTS_MOST; slot++)
        if (pool->slots[slot].pid == pid)
            return slot;
    return -1;
}

int pool_slot_of_peer(const struct pool *pool, uint64_t peer)
{
    for (int slot = 0; peer > 0 && slot < SLOTS_MOST; slot++)
        if (pool->slots[slot].pid > 0 && pool->slots[slot].peer == peer)
            return slot;
    return -1;
}

bool pool_find_program(char path[4096])
{
    static const char *const places[] = {
        "modald-worker", "../libexec/modald/modald-worker", "../libexec/modald-worker", NULL };
    char self[4096];
    ssize_t n = readlink("/proc/self/exe", self, sizeof self - 1);
    char *slash;

    if (n <= 0)
        return false;
    self[n] = 0;
    slash = strrchr(self, '/');
    if (slash == NULL)
        return false;
    slash[1] = 0;
    for (int i = 0; places[i] != NULL; i++) {
        if ((size_t)snprintf(path, sizeof self, "%s%s", self, places[i]) < sizeof self
            && access(path, X_OK) == 0)
            return true;
    }
    return false;
}
