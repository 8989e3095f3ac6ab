/* test_confine.c - what a confined process can no longer do; each attempt is made in a child of its own */
#include "check.h"
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include "worker/confine.h"

enum { SKIPPED = 77 };

static char dir[64];

/* The exit status of ATTEMPT in a confined child; 0 where the attempt was refused as it says. */
static int confined(int (*attempt)(void), bool files, bool calls)
{
    struct confine_options options = { .data = files ? dir : NULL, .calls = calls };
    int status;
    pid_t child = fork();

    CHECK(child >= 0);
    if (child == 0) {
        bool done = true;
        if (confine_limits(&options, NULL) != MODAL_OK)
            _exit(90);
        if (files && confine_files(&options, &done, NULL) != MODAL_OK)
            _exit(91);
        if (done && calls && confine_calls(&done, NULL) != MODAL_OK)
            _exit(92);
        _exit(done ? attempt() : SKIPPED);
    }
    CHECK(waitpid(child, &status, 0) == child);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 100 + WTERMSIG(status);
}

static void check_refused(int (*attempt)(void), bool files, bool calls)
{
    int status = confined(attempt, files, calls);

    if (status == SKIPPED)
        print_message("not possible here: %s\n", files ? "no Landlock in this kernel" : "a sanitizer");
    else if (status != 0)
        fail_msg("the attempt ended with %d", status);
}

static int refused(long result, int error)
{
    return result < 0 && errno == error ? 0 : 1;
}

static int open_socket(void) { return refused(socket(AF_INET, SOCK_STREAM, 0), EPERM) || refused(socket(AF_UNIX, SOCK_STREAM, 0), EPERM); }
static int start_program(void) { return refused(execl("/bin/true", "true", NULL), EPERM); }
static int fork_process(void) { return refused(fork(), EPERM); }
static int make_file(void) { return refused(open("/tmp/modald-test-confined", O_WRONLY | O_CREAT, 0600), EPERM); }
static int write_file(void) { return refused(open("/dev/null", O_RDWR), EPERM); }
static int delete_file(void) { return refused(unlink("/tmp/modald-test-confined"), EPERM); }
static int signal_parent(void) { return refused(kill(getppid(), 0), EPERM); }
static int execute_memory(void) { return mmap(NULL, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) == MAP_FAILED && errno == EPERM ? 0 : 1; }

TEST(a_confined_process_opens_no_socket) { check_refused(open_socket, false, true); }
TEST(a_confined_process_starts_no_program) { check_refused(start_program, false, true); }
TEST(a_confined_process_does_not_fork) { check_refused(fork_process, false, true); }
TEST(a_confined_process_makes_no_file) { check_refused(make_file, false, true); }
TEST(a_confined_process_opens_none_for_writing) { check_refused(write_file, false, true); }
TEST(a_confined_process_deletes_no_file) { check_refused(delete_file, false, true); }
TEST(a_confined_process_signals_no_other) { check_refused(signal_parent, false, true); }
TEST(a_confined_process_maps_nothing_executable) { check_refused(execute_memory, false, true); }

static void *square(void *value)
{
    *(double *)value *= *(double *)value;
    return NULL;
}

/* It can still compute, allocate, use threads, and read. */
static int work(void)
{
    double value = 2.385, *big = malloc(1 << 24);
    pthread_t thread;
    char byte;
    int fd = open("/proc/self/stat", O_RDONLY);

    if (big == NULL || fd < 0 || read(fd, &byte, 1) != 1 || pthread_create(&thread, NULL, square, &value) != 0)
        return 1;
    memset(big, 1, 1 << 24);
    pthread_join(thread, NULL);
    free(big);
    return value == 2.385 * 2.385 ? 0 : 2;
}

TEST(a_confined_process_computes_allocates_starts_threads_and_reads)
{
    check_refused(work, false, true);
    check_refused(work, true, true);
}

static int aborting(void) { abort(); }

TEST(a_confined_process_that_aborts_dies_of_it)
{
    int status = confined(aborting, false, true);

    CHECK(status == SKIPPED || status == 100 + SIGABRT);
}

static int read_secret(void) { return refused(open("/etc/passwd", O_RDONLY), EACCES); }

static int read_spool(void)
{
    char path[96];

    snprintf(path, sizeof path, "%s/spool/1.h5", dir);
    return open(path, O_RDONLY) >= 0 ? 0 : 1;
}

static int read_ledger(void)
{
    char path[96];

    snprintf(path, sizeof path, "%s/ledger.db", dir);
    return refused(open(path, O_RDONLY), EACCES);
}

TEST(where_the_kernel_has_landlock_only_the_spool_can_be_read)
{
    char command[256];

    snprintf(dir, sizeof dir, "/tmp/modald-test-XXXXXX");
    CHECK(mkdtemp(dir) != NULL);
    snprintf(command, sizeof command, "mkdir %s/spool && touch %s/spool/1.h5 %s/ledger.db", dir, dir, dir);
    CHECK(system(command) == 0);
    check_refused(read_secret, true, false);
    check_refused(read_ledger, true, false);
    check_refused(read_spool, true, false);
    snprintf(command, sizeof command, "rm -r %s", dir);
    CHECK(system(command) == 0);
}

static int look_at_limits(void)
{
    struct rlimit core, size, files;

    if (getrlimit(RLIMIT_CORE, &core) < 0 || getrlimit(RLIMIT_FSIZE, &size) < 0 || getrlimit(RLIMIT_NOFILE, &files) < 0)
        return 1;
    return core.rlim_max == 0 && size.rlim_max == 0 && files.rlim_max <= 256 && getpriority(PRIO_PROCESS, 0) >= 10 && getpgrp() == getpid() ? 0 : 2;
}

TEST(the_limits_are_set) { check_refused(look_at_limits, false, false); }

static int use_memory(void) { return malloc((size_t)3 << 30) == NULL ? 0 : 1; }

TEST(the_memory_limit_holds)
{
#ifndef __SANITIZE_ADDRESS__
    struct confine_options options = { .memory = (uint64_t)2 << 30 };
    int status;
    pid_t child = fork();

    if (child == 0)
        _exit(confine_limits(&options, NULL) == MODAL_OK ? use_memory() : 90);
    CHECK(waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
#else
    (void)use_memory;
#endif
}

/* The parent's death is the child's. */
TEST(a_worker_ends_with_its_parent)
{
    int pipes[2], status;
    char byte;
    pid_t parent;

    CHECK(pipe(pipes) == 0);
    parent = fork();
    if (parent == 0) {
        struct confine_options options = { 0 };
        if (fork() == 0) {
            if (confine_limits(&options, NULL) != MODAL_OK || write(pipes[1], "r", 1) != 1)
                _exit(1);
            for (;;)
                pause();
        }
        for (;;)
            pause();
    }
    close(pipes[1]);
    CHECK(read(pipes[0], &byte, 1) == 1);
    kill(parent, SIGKILL);
    CHECK(waitpid(parent, &status, 0) == parent);
    CHECK(read(pipes[0], &byte, 1) == 0);      /* the end: nobody holds the other side any more */
    close(pipes[0]);
}
