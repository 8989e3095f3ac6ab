/* test_confine.c - what a confined process can no longer do; each attempt is made in a child of its
 * own */
#include "check.h"
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/un.h>
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
        for (int number = 1; number < 32; number++)
            signal(number, SIG_DFL);             /* of the test's own handlers */
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
        print_message("not possible here: %s\n",
                      files ? "no Landlock in this kernel" : "a sanitizer");
    else if (status != 0)
        fail_msg("the attempt ended with %d", status);
}

static int refused(long result, int error)
{
    return result < 0 && errno == error ? 0 : 1;
}

static int open_socket(void)
{
    return refused(socket(AF_INET, SOCK_STREAM, 0), EPERM) ||
           refused(socket(AF_UNIX, SOCK_STREAM, 0), EPERM);
}
static int start_program(void) { return refused(execl("/bin/true", "true", NULL), EPERM); }
static int fork_process(void) { return refused(fork(), EPERM); }
static int make_file(void)
{
    return refused(open("/tmp/modald-test-confined", O_WRONLY | O_CREAT, 0600), EPERM);
}
static int write_file(void) { return refused(open("/dev/null", O_RDWR), EPERM); }
static int delete_file(void) { return refused(unlink("/tmp/modald-test-confined"), EPERM); }
static int signal_parent(void) { return refused(kill(getppid(), 0), EPERM); }
static int execute_memory(void)
{
    return mmap(NULL, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) ==
                       MAP_FAILED &&
                   errno == EPERM
               ? 0
               : 1;
}

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

    if (big == NULL || fd < 0 || read(fd, &byte, 1) != 1 ||
        pthread_create(&thread, NULL, square, &value) != 0)
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
    return refused(open(path, O_RDONLY), EACCES);
}

static int read_ledger(void)
{
    char path[96];

    snprintf(path, sizeof path, "%s/ledger.db", dir);
    return refused(open(path, O_RDONLY), EACCES);
}

TEST(where_the_kernel_has_landlock_nothing_of_the_daemons_folder_can_be_read)
{
    char command[256];

    snprintf(dir, sizeof dir, "/tmp/modald-test-XXXXXX");
    CHECK(mkdtemp(dir) != NULL);
    snprintf(command, sizeof command, "mkdir %s/spool && touch %s/spool/1.h5 %s/ledger.db", dir,
             dir, dir);
    CHECK(system(command) == 0);
    check_refused(read_secret, true, false);
    check_refused(read_ledger, true, false);
    check_refused(read_spool, true, false);
    snprintf(command, sizeof command, "rm -r %s", dir);
    CHECK(system(command) == 0);
}

static int open_anything(void)
{
    bool done;

    if (confine_opening(&done, NULL) != MODAL_OK)
        return 2;
    return done && (refused(open("/proc/self/stat", O_RDONLY), EPERM)
                    || refused(openat(AT_FDCWD, "/dev/null", O_RDONLY), EPERM));
}

TEST(where_it_has_none_nothing_can_be_opened_at_all) { check_refused(open_anything, false, false); }

/* ---- every system call ----------------------------------------------------------------------- */

#if defined(__x86_64__)
#define NUMBER(name) { #name, SYS_##name }
/* The names of modald-worker(8) that stand without conditions. */
static const struct { const char *name; long number; } expected[] = {
    NUMBER(brk), NUMBER(clock_getres), NUMBER(clock_gettime), NUMBER(clock_nanosleep),
    NUMBER(close), NUMBER(epoll_create1), NUMBER(epoll_ctl), NUMBER(epoll_pwait),
    NUMBER(epoll_wait), NUMBER(eventfd2), NUMBER(exit), NUMBER(exit_group), NUMBER(fstat),
    NUMBER(futex), NUMBER(getcpu), NUMBER(getegid), NUMBER(geteuid), NUMBER(getgid), NUMBER(getpid),
    NUMBER(getppid), NUMBER(getrandom), NUMBER(getrlimit), NUMBER(getrusage), NUMBER(gettid),
    NUMBER(gettimeofday), NUMBER(getuid), NUMBER(lseek), NUMBER(madvise), NUMBER(mremap),
    NUMBER(munmap), NUMBER(nanosleep), NUMBER(poll), NUMBER(ppoll), NUMBER(pread64),
    NUMBER(pselect6), NUMBER(read), NUMBER(readv), NUMBER(recvfrom), NUMBER(restart_syscall),
    NUMBER(rseq), NUMBER(rt_sigaction), NUMBER(rt_sigprocmask), NUMBER(rt_sigreturn),
    NUMBER(sched_getaffinity), NUMBER(sched_getparam), NUMBER(sched_getscheduler),
    NUMBER(sched_yield), NUMBER(select), NUMBER(set_robust_list), NUMBER(sigaltstack),
    NUMBER(sysinfo), NUMBER(time), NUMBER(uname), NUMBER(write), NUMBER(writev),
};
enum { EXPECTED = sizeof expected / sizeof *expected, X32 = 0x40000000, URETPROBE = 335 };

static bool is_expected(long number)
{
    for (int i = 0; i < EXPECTED; i++)
        if (expected[i].number == number)
            return true;
    return false;
}

static long tried;

/* With arguments that no call takes: one that is let through fails of them, or ends the process. */
static int try_call(void)
{
    return syscall(tried, -1L, -1L, -1L, -1L, -1L, -1L) == -1 && errno == EPERM ? 1 : 0;
}

TEST(of_all_system_calls_those_of_the_list_alone_are_let_through)
{
    for (int x32 = 0; x32 < 2; x32++)
        for (long number = 0; number < 600; number++) {
            bool refused_it;
            int status;
            tried = number + x32 * X32;
            status = confined(try_call, false, true);
            if (status == SKIPPED)
                return;
            /* sched_setscheduler: answered, and not done, see below. */
            refused_it = status == 1 || number == SYS_clone3 || number == SYS_sched_setscheduler;
            if (!x32 && (number == URETPROBE || number == URETPROBE + 1))
                continue;                        /* of Linux's own trampolines: it asks no filter,
                                                    and does nothing for others */
            if (refused_it == (!x32 && is_expected(number)))
                fail_msg("system call %ld%s: status %d", number, x32 ? " of x32" : "", status);
        }
}

static int call_clone3(void)
{
    return refused(syscall(SYS_clone3, NULL, 0), ENOSYS)
        || refused(syscall(X32 | SYS_clone3, NULL, 0), EPERM);
}

TEST(clone3_is_a_call_that_this_kernel_does_not_have) { check_refused(call_clone3, false, true); }

static int set_scheduler(void)
{
    const struct sched_param zero = { 0 };

    return sched_setscheduler(0, SCHED_IDLE, &zero) == 0
        && sched_getscheduler(0) == SCHED_OTHER ? 0 : 1;
}

TEST(a_scheduler_is_said_to_be_set_and_is_not) { check_refused(set_scheduler, false, true); }

/* The lines between .nf and .fi of the manual. */
static char *manual_list(void)
{
    static char text[65536];
    FILE *file = fopen(TEST_DATA "/../../systemd/modald-worker.8", "r");
    char *from, *to;

    CHECK(file != NULL);
    text[fread(text, 1, sizeof text - 1, file)] = 0;
    fclose(file);
    from = strstr(text, "\n.nf\n");
    to = from != NULL ? strstr(from, "\n.fi\n") : NULL;
    CHECK(to != NULL);
    to[1] = 0;
    return from + 5;
}

TEST(the_list_is_what_the_manual_says)
{
    char *printed = NULL, *manual = manual_list();
    size_t size = 0;
    FILE *out = open_memstream(&printed, &size);
    int unconditional = 0;

    confine_print(out);
    fclose(out);
    if (strcmp(printed, manual) != 0)
        fail_msg("printed:\n%s\nthe manual:\n%s", printed, manual);
    for (char *line = strtok(manual, "\n"); line != NULL; line = strtok(NULL, "\n")) {
        bool known = strchr(line, ':') != NULL;
        for (int i = 0; i < EXPECTED && !known; i++)
            known = strcmp(line, expected[i].name) == 0;
        if (!known)
            fail_msg("the manual has %s", line);
        unconditional += strchr(line, ':') == NULL;
    }
    CHECK(unconditional == EXPECTED);
    free(printed);
}
#endif

/* ---- what arguments could do ----------------------------------------------------------------- */

static int ours[2], pair[2];                   /* a pipe and sockets from before the walls */

static int signal_by_fcntl(void)
{
    return refused(fcntl(ours[0], F_SETOWN, getppid()), EPERM)
        || refused(fcntl(ours[0], F_SETSIG, SIGKILL), EPERM)
        || refused(fcntl(ours[0], F_SETFL, O_ASYNC), EPERM)
        || refused(fcntl(ours[0], F_SETFL, O_ASYNC | O_NONBLOCK), EPERM)
        || refused(fcntl(ours[0], 15 /* F_SETOWN_EX */, (int[]) { 1, getppid() }), EPERM);
}

static int other_fcntl(void)
{
    static const int commands[] = { F_DUPFD, F_GETLK, F_SETLK, F_SETLKW, F_GETOWN, F_GETSIG,
                                    F_SETLEASE, F_NOTIFY, F_SETPIPE_SZ, F_ADD_SEALS };

    for (size_t i = 0; i < sizeof commands / sizeof *commands; i++)
        if (refused(fcntl(ours[0], commands[i], 0), EPERM))
            return 1;
    return fcntl(ours[0], F_GETFD) < 0 || fcntl(ours[0], F_SETFD, FD_CLOEXEC) < 0
        || fcntl(ours[0], F_GETFL) < 0 || fcntl(ours[0], F_SETFL, O_NONBLOCK) < 0
        || fcntl(ours[0], F_DUPFD_CLOEXEC, 5) < 0 ? 2 : 0;
}

static int signal_by_ioctl(void)
{
    return refused(ioctl(ours[0], FIOASYNC, &(int) { 1 }), EPERM)
        || refused(ioctl(ours[0], FIOSETOWN, &(int) { getppid() }), EPERM)
        || refused(ioctl(0, TIOCSTI, "x"), EPERM);
}

static int limit_others(void)
{
    const struct rlimit one = { 1, 1 };
    struct rlimit got;

    return refused(prlimit(getppid(), RLIMIT_NOFILE, &one, NULL), EPERM)
        || refused(prlimit(getppid(), RLIMIT_CPU, &one, NULL), EPERM)
        || refused(prlimit(getppid(), RLIMIT_FSIZE, NULL, &got), EPERM)
        || refused(prlimit(0, RLIMIT_NOFILE, &one, NULL), EPERM)
        || refused(prlimit(getpid(), RLIMIT_NOFILE, &one, NULL), EPERM)
        /* a pointer whose lower half is 0 */
        || refused(syscall(SYS_prlimit64, 0, RLIMIT_NOFILE, 0x100000000, NULL), EPERM)
        || prlimit(0, RLIMIT_NOFILE, NULL, &got) < 0
        || prlimit(getpid(), RLIMIT_NOFILE, NULL, &got) < 0;
}

static int signal_others(void)
{
    siginfo_t info = { .si_code = SI_QUEUE };

    return refused(syscall(SYS_tgkill, getppid(), getppid(), 0), EPERM)
        || refused(syscall(SYS_tkill, getppid(), 0), EPERM)
        || refused(syscall(SYS_rt_sigqueueinfo, getppid(), SIGTERM, &info), EPERM)
        || refused(kill(0, 0), EPERM)
        || refused(syscall(SYS_rt_tgsigqueueinfo, getppid(), getppid(), SIGTERM, &info), EPERM)
        || refused(syscall(SYS_pidfd_open, getppid(), 0), EPERM)
        || refused(syscall(SYS_pidfd_send_signal, 0, 0, NULL, 0), EPERM);
}

static int schedule_others(void)
{
    unsigned long first = 1;

    return refused(setpriority(PRIO_PROCESS, getppid(), 19), EPERM)
        || refused(syscall(SYS_sched_setaffinity, getppid(), sizeof first, &first), EPERM)
        || refused(syscall(SYS_ioprio_set, 1, getppid(), 0), EPERM)
        || refused(syscall(SYS_sched_setattr, getppid(), NULL, 0), EPERM);
}

static int look_into_others(void)
{
    struct iovec here = { &(char) { 0 }, 1 };
    struct stat known;

    return refused(process_vm_readv(getppid(), &here, 1, &here, 1, 0), EPERM)
        || refused(process_vm_writev(getppid(), &here, 1, &here, 1, 0), EPERM)
        || refused(syscall(SYS_ptrace, 16, getppid(), 0, 0), EPERM)
        || refused(stat("/etc/passwd", &known), EPERM)
        || refused(access("/etc/passwd", F_OK), EPERM)
        || refused(syscall(SYS_kcmp, getppid(), getpid(), 0, 0, 0), EPERM)
        || refused(syscall(SYS_pidfd_getfd, 0, 0, 0), EPERM);
}

static int make_ways_out(void)
{
    return refused(syscall(SYS_io_uring_setup, 1, NULL), EPERM)
        || refused(syscall(SYS_memfd_create, "x", 0), EPERM)
        || refused(syscall(SYS_userfaultfd, 0), EPERM)
        || refused(syscall(SYS_bpf, 0, NULL, 0), EPERM)
        || refused(syscall(SYS_perf_event_open, NULL), EPERM)
        || refused(syscall(SYS_unshare, CLONE_NEWUSER), EPERM)
        || refused(syscall(SYS_keyctl, 0), EPERM)
        || refused(syscall(SYS_open_tree, 0, "/", 0), EPERM)
        || refused(syscall(SYS_openat2, AT_FDCWD, "/", NULL, 0), EPERM)
        || refused(syscall(SYS_name_to_handle_at, 0), EPERM)
        || refused(prctl(PR_SET_PDEATHSIG, 0), EPERM) || refused(prctl(PR_SET_DUMPABLE, 1), EPERM)
        || refused(prctl(PR_SET_PTRACER, -1), EPERM)
        || refused(syscall(SYS_seccomp, 0, 0, NULL), EPERM)
        || refused(mprotect(&ours, 1, PROT_EXEC), EPERM)
        || refused(syscall(SYS_clone, CLONE_VM | CLONE_VFORK | SIGCHLD, 0, 0, 0, 0), EPERM)
        || refused(syscall(SYS_clone, CLONE_NEWUSER, 0, 0, 0, 0), EPERM)
        || refused(syscall(SYS_clone, CLONE_THREAD | CLONE_SIGHAND | CLONE_VM | CLONE_PARENT,
                           0, 0, 0, 0), EPERM);
}

/* Memory that RLIMIT_DATA does not count. */
static int share_memory(void)
{
    return mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0)
               == MAP_FAILED && errno == EPERM
        && mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED_VALIDATE | MAP_ANONYMOUS, -1, 0)
               == MAP_FAILED && errno == EPERM
        && mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0)
               != MAP_FAILED ? 0 : 1;
}

/* Messages to other addresses, descriptors to others and from others than the daemon. */
static int speak_elsewhere(void)
{
    struct sockaddr_un other = { .sun_family = AF_UNIX, .sun_path = "/tmp/modald-test-nobody" };
    char byte = 'x', room[64];
    struct iovec part = { &byte, 1 };
    struct msghdr message = { .msg_iov = &part, .msg_iovlen = 1, .msg_control = room,
                              .msg_controllen = sizeof room };

    return refused(sendto(pair[0], &byte, 1, 0, (struct sockaddr *)&other, sizeof other), EPERM)
        || refused(sendmsg(pair[0], &message, 0), EPERM)
        || refused(recvmsg(pair[0], &message, MSG_DONTWAIT), EPERM)
        || refused(connect(pair[0], (struct sockaddr *)&other, sizeof other), EPERM)
        || refused(setsockopt(pair[0], SOL_SOCKET, SO_SNDBUF, &byte, 1), EPERM)
        || send(pair[0], &byte, 1, 0) != 1 || recv(pair[1], &byte, 1, 0) != 1;
}

static void check_walls(int (*attempt)(void))
{
    CHECK(pipe2(ours, O_CLOEXEC) == 0
          && socketpair(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0, pair) == 0);
    if (pair[0] == CONFINE_INPUTS) {               /* the one that may receive descriptors */
        int held = pair[0];
        pair[0] = dup(held);
        close(held);
    }
    check_refused(attempt, false, true);
    close(ours[0]), close(ours[1]), close(pair[0]), close(pair[1]);
}

TEST(a_confined_process_sends_no_signal_by_fcntl) { check_walls(signal_by_fcntl); }
TEST(of_fcntl_five_commands_are_left) { check_walls(other_fcntl); }
TEST(a_confined_process_sends_no_signal_by_ioctl) { check_walls(signal_by_ioctl); }
TEST(a_confined_process_sets_no_limit_and_reads_its_own_alone) { check_walls(limit_others); }
TEST(a_confined_process_signals_no_other_by_any_call) { check_walls(signal_others); }
TEST(a_confined_process_schedules_no_other) { check_walls(schedule_others); }
TEST(a_confined_process_looks_into_no_other_and_at_no_file) { check_walls(look_into_others); }
TEST(a_confined_process_makes_no_way_out) { check_walls(make_ways_out); }
TEST(a_confined_process_has_no_memory_that_is_not_counted) { check_walls(share_memory); }
TEST(a_confined_process_speaks_to_nobody_else) { check_walls(speak_elsewhere); }

static int look_at_limits(void)
{
    struct rlimit core, size, files;

    if (getrlimit(RLIMIT_CORE, &core) < 0 || getrlimit(RLIMIT_FSIZE, &size) < 0 ||
        getrlimit(RLIMIT_NOFILE, &files) < 0)
        return 1;
    return core.rlim_max == 0 && size.rlim_max == 0 && files.rlim_max <= 256 &&
                   getpriority(PRIO_PROCESS, 0) >= 10 && getpgrp() == getpid()
               ? 0
               : 2;
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
