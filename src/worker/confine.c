/*
 * confine.c - a worker shut in; see confine.h
 *
 * A job computes on data a user chose, some of it in a language of the user's own (Lua).  Should
 * that take over the process, it finds: no new sockets, programs, files or mappings that can be
 * executed; nothing to read but the input of its job, whose descriptor the daemon handed over;
 * nobody to signal or to set limits to; one connection, on which the daemon believes only what fits
 * the job it gave.
 *
 * The filter is a list of what computing, ZeroMQ's threads and glibc need.  Everything else fails
 * with EPERM rather than ending the process, so that a library that only asks in vain goes on;
 * clone3 says ENOSYS, since its flags cannot be seen and glibc then uses clone; and
 * sched_setscheduler says that it was done, since each thread of ZeroMQ's asks for the scheduling
 * that it has and aborts where that fails, and some begin only after the walls are up.
 */
#include "worker/confine.h"
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <pwd.h>
#include <sched.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
#include "base/sanitized.h"

#if SANITIZED
enum { MEMORY_LIMITED = false };        /* its shadow is larger than any limit */
#else
enum { MEMORY_LIMITED = true };
#endif

enum {
    NICE       = 10,     /* the daemon and a simulation beside it come first */
    SAID_MOST  = 1 << 20,   /* bytes of a log file: a line for each of ten thousand jobs */
    FILES_MOST = 256,    /* libzmq's few, the libraries' while they are loaded, the inputs' one */
};

/* --- limits --- */

static enum modal_status set_limit(int which, rlim_t most, const char *name,
                                   struct modal_error *err)
{
    struct rlimit limit;

    if (getrlimit((__rlimit_resource_t)which, &limit) == 0 && limit.rlim_max < most)
        most = limit.rlim_max;
    limit.rlim_cur = limit.rlim_max = most;
    return setrlimit((__rlimit_resource_t)which, &limit) == 0
               ? MODAL_OK
               : modal_fail(err, MODAL_IO, "worker: limit of %s: %s", name, strerror(errno));
}

/* Half of the threads that this user may have: the other half is the daemon's,
 * where both are one user. */
static enum modal_status limit_threads(struct modal_error *err)
{
    struct rlimit limit;

    if (getrlimit(RLIMIT_NPROC, &limit) < 0 || limit.rlim_max == RLIM_INFINITY)
        return MODAL_OK;
    return set_limit(RLIMIT_NPROC, limit.rlim_max / 2 + 1, "threads", err);
}

enum modal_status confine_death(struct modal_error *err)
{
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) < 0)
        return modal_fail(err, MODAL_IO, "worker: parent's death: %s", strerror(errno));
    return MODAL_OK;
}

enum modal_status confine_survive(struct modal_error *err)
{
    if (prctl(PR_SET_PDEATHSIG, 0) < 0)
        return modal_fail(err, MODAL_IO, "worker: parent's death: %s", strerror(errno));
    return MODAL_OK;
}

/* No file grows, but the one that stderr may be by what a few hundred jobs say. */
static rlim_t file_most(const struct confine_options *options)
{
    struct stat known;

    return options->elsewhere && fstat(STDERR_FILENO, &known) == 0 && S_ISREG(known.st_mode)
               ? (rlim_t)known.st_size + SAID_MOST : 0;
}

enum modal_status confine_limits(const struct confine_options *options, struct modal_error *err)
{
    enum modal_status rc;

    if (!options->elsewhere)
        setpgid(0, 0);                  /* fails where the parent has done it */
    if (getpriority(PRIO_PROCESS, 0) < NICE && setpriority(PRIO_PROCESS, 0, NICE) < 0)
        return modal_fail(err, MODAL_IO, "worker: nice: %s", strerror(errno));
    signal(SIGXFSZ, SIG_IGN);
    rc = set_limit(RLIMIT_CORE, 0, "core files", err);
    if (rc == MODAL_OK)
        rc = set_limit(RLIMIT_NOFILE, FILES_MOST, "descriptors", err);
    if (rc == MODAL_OK)
        rc = set_limit(RLIMIT_FSIZE, file_most(options), "file size", err);
    if (rc == MODAL_OK && MEMORY_LIMITED && options->memory > 0)
        rc = set_limit(RLIMIT_DATA, options->memory, "memory", err);
    if (rc == MODAL_OK)
        rc = limit_threads(err);
    return rc == MODAL_OK && !options->elsewhere ? confine_death(err) : rc;
}

/* --- files --- */

#define EVERY_FILE_ACCESS                                                                          \
    (LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_READ_FILE     \
     | LANDLOCK_ACCESS_FS_READ_DIR | LANDLOCK_ACCESS_FS_REMOVE_DIR                                 \
     | LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_MAKE_CHAR | LANDLOCK_ACCESS_FS_MAKE_DIR \
     | LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_MAKE_SOCK | LANDLOCK_ACCESS_FS_MAKE_FIFO   \
     | LANDLOCK_ACCESS_FS_MAKE_BLOCK | LANDLOCK_ACCESS_FS_MAKE_SYM)

static void allow_reading(int rules, const char *path)
{
    struct landlock_path_beneath_attr rule = { .allowed_access = LANDLOCK_ACCESS_FS_READ_FILE
                                                                 | LANDLOCK_ACCESS_FS_READ_DIR };
    struct stat known;

    rule.parent_fd = open(path, O_PATH | O_CLOEXEC);
    if (rule.parent_fd < 0)
        return;
    if (fstat(rule.parent_fd, &known) == 0 && !S_ISDIR(known.st_mode))
        rule.allowed_access = LANDLOCK_ACCESS_FS_READ_FILE;
    syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0);
    close(rule.parent_fd);
}

enum modal_status confine_files(const struct confine_options *options, bool *done,
                                struct modal_error *err)
{
    /* glibc and OpenBLAS ask how many processors and how much memory there are */
    static const char *const always[] = {
        "/proc/self",         "/proc/meminfo",           "/proc/cpuinfo",
        "/proc/stat",         "/sys/devices/system/cpu", "/usr/lib",
        "/usr/share/zoneinfo"
    };
    struct landlock_ruleset_attr handled = { .handled_access_fs = EVERY_FILE_ACCESS };
    int rules, failed;

    *done = false;
    if (options->data == NULL)
        return MODAL_OK;
    rules = (int)syscall(SYS_landlock_create_ruleset, &handled, sizeof handled, 0);
    if (rules < 0)
        return MODAL_OK;                /* a kernel without it: confine_opening */
    for (size_t i = 0; i < sizeof always / sizeof *always; i++)
        allow_reading(rules, always[i]);
    failed = prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) < 0
             || syscall(SYS_landlock_restrict_self, rules, 0) < 0;
    close(rules);
    if (failed)
        return modal_fail(err, MODAL_IO, "worker: landlock: %s", strerror(errno));
    *done = true;
    return MODAL_OK;
}

/* --- user --- */

enum modal_status confine_user(const struct confine_options *options, struct modal_error *err)
{
    const struct passwd *user;

    if (options->user == NULL)
        return MODAL_OK;
    user = getpwnam(options->user);
    if (user == NULL)
        return modal_fail(err, MODAL_NOT_FOUND, "worker: no user %s", options->user);
    if (geteuid() == 0
        && (setgroups(0, NULL) < 0 || setresgid(user->pw_gid, user->pw_gid, user->pw_gid) < 0
            || setresuid(user->pw_uid, user->pw_uid, user->pw_uid) < 0))
        return modal_fail(err, MODAL_DENIED, "worker: becoming %s: %s", options->user,
                          strerror(errno));
    if (geteuid() != user->pw_uid)
        return modal_fail(err, MODAL_DENIED, "worker: only root can become %s", options->user);
    return options->elsewhere ? MODAL_OK : confine_death(err);   /* which the change cleared */
}

/* --- system calls --- */

#if defined(__x86_64__)
#define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#define ARCHITECTURE AUDIT_ARCH_AARCH64
#endif

#define CALL(name) { #name, SYS_##name }
struct call { const char *name; int number; };

/* Allowed whatever the arguments. */
static const struct call free_calls[] = {
    /* what is open already */
    CALL(read), CALL(write), CALL(readv), CALL(writev), CALL(pread64), CALL(lseek), CALL(close),
    CALL(fstat), CALL(recvfrom), CALL(ppoll), CALL(pselect6), CALL(epoll_pwait), CALL(epoll_ctl),
    CALL(epoll_create1), CALL(eventfd2),
    /* looking */
    CALL(uname), CALL(sysinfo), CALL(getrusage), CALL(getpid), CALL(getppid), CALL(gettid),
    CALL(getuid), CALL(geteuid), CALL(getgid), CALL(getegid), CALL(sched_getaffinity),
    CALL(sched_getparam), CALL(sched_getscheduler), CALL(getcpu), CALL(getrandom),
    CALL(clock_gettime), CALL(clock_getres), CALL(gettimeofday),
    /* memory and threads */
    CALL(munmap), CALL(mremap), CALL(madvise), CALL(brk), CALL(futex), CALL(set_robust_list),
    CALL(rseq), CALL(sched_yield), CALL(nanosleep), CALL(clock_nanosleep), CALL(rt_sigaction),
    CALL(rt_sigprocmask), CALL(rt_sigreturn), CALL(sigaltstack), CALL(restart_syscall), CALL(exit),
    CALL(exit_group),
#if defined(__x86_64__)
    CALL(poll), CALL(select), CALL(epoll_wait), CALL(getrlimit), CALL(time),
#endif
};

/* 32 bits of the arguments, AT so many bytes into them: those of BITS must be IS.  No bits:
 * no check. */
struct check { int at; uint32_t bits, is; };
/* Allowed where all checks hold; a call with several rows, where one row does.
 * WHERE says it to a reader. */
struct rule { struct call call; struct check checks[3]; const char *where; };

/* The kernel takes descriptors, commands, flags and process numbers as 32 bits:
 * the lower half of an argument. */
#define ARGUMENT(n, bits, is) { 8 * (n), bits, (uint32_t)(is) }
#define NO_POINTER(n) ARGUMENT(n, ~0u, 0), { 8 * (n) + 4, ~0u, 0 }
#define WRITING (O_WRONLY | O_RDWR | O_CREAT | O_TRUNC | O_APPEND | O_ASYNC \
                 | (O_TMPFILE & ~O_DIRECTORY))
#define NOT_WRITING "to read: without O_WRONLY, O_RDWR, O_CREAT, O_TRUNC, O_APPEND, O_ASYNC, " \
                    "O_TMPFILE"
#define A_THREAD (CLONE_VM | CLONE_FS | CLONE_FILES | CLONE_SIGHAND | CLONE_THREAD \
                  | CLONE_SYSVSEM | CLONE_SETTLS | CLONE_PARENT_SETTID | CLONE_CHILD_CLEARTID)

enum {
    RULES_MOST = 20,     /* of list_rules, with room for a few more */
    OWN        = 0,      /* this process, as pid of a call */
};

/* The rules for process PID into OUT; their number. */
static int list_rules(struct rule out[RULES_MOST], uint32_t pid)
{
    const struct rule rules[] = {
        { CALL(openat), { ARGUMENT(2, WRITING, 0) }, NOT_WRITING },
#if defined(__x86_64__)
        { CALL(open), { ARGUMENT(1, WRITING, 0) }, NOT_WRITING },
#endif
        { CALL(fcntl), { ARGUMENT(1, ~0u, F_GETFD) }, "F_GETFD" },
        { CALL(fcntl), { ARGUMENT(1, ~0u, F_SETFD) }, "F_SETFD" },
        { CALL(fcntl), { ARGUMENT(1, ~0u, F_GETFL) }, "F_GETFL" },
        { CALL(fcntl), { ARGUMENT(1, ~0u, F_SETFL), ARGUMENT(2, O_ASYNC, 0) },
          "F_SETFL without O_ASYNC" },
        { CALL(fcntl), { ARGUMENT(1, ~0u, F_DUPFD_CLOEXEC) }, "F_DUPFD_CLOEXEC" },
        { CALL(recvmsg), { ARGUMENT(0, ~0u, CONFINE_INPUTS) },
          "of descriptor 3, by which inputs come" },
        { CALL(sendto), { NO_POINTER(4) }, "without an address" },
        { CALL(mmap), { ARGUMENT(2, PROT_EXEC, 0), ARGUMENT(3, MAP_SHARED, 0) },
          "private, without PROT_EXEC" },
        { CALL(mmap), { ARGUMENT(2, PROT_EXEC, 0), ARGUMENT(3, MAP_ANONYMOUS, 0) },
          "of a file, without PROT_EXEC" },
        { CALL(mprotect), { ARGUMENT(2, PROT_EXEC, 0) }, "without PROT_EXEC" },
        { CALL(clone), { ARGUMENT(0, ~0u, A_THREAD) },
          "a thread of its own, with the flags of pthread_create(3)" },
        { CALL(tgkill), { ARGUMENT(0, ~0u, pid) }, "of its own threads" },
        { CALL(prlimit64), { ARGUMENT(0, ~0u, OWN), NO_POINTER(2) }, "to read its own" },
        { CALL(prlimit64), { ARGUMENT(0, ~0u, pid), NO_POINTER(2) },
          "to read its own, by its number" },
        { CALL(prctl), { ARGUMENT(0, ~0u, PR_SET_NAME) }, "PR_SET_NAME" },
    };

    memcpy(out, rules, sizeof rules);
    return sizeof rules / sizeof *rules;
}

void confine_print(FILE *out)
{
    struct rule rules[RULES_MOST];
    int count = list_rules(rules, OWN);

    for (size_t i = 0; i < sizeof free_calls / sizeof *free_calls; i++)
        fprintf(out, "%s\n", free_calls[i].name);
    for (int i = 0; i < count; i++)
        fprintf(out, "%s: %s\n", rules[i].call.name, rules[i].where);
}

#if defined(ARCHITECTURE) && !SANITIZED

/* Instructions: the frame, two for each free call, twelve for each rule at most. */
enum { PROGRAM_MOST = 16 + 2 * (int)(sizeof free_calls / sizeof *free_calls) + 12 * RULES_MOST };

struct program { struct sock_filter code[PROGRAM_MOST]; unsigned short length; };

static void emit(struct program *program, unsigned short code, uint32_t k, unsigned char yes,
                 unsigned char no)
{
    program->code[program->length++] = (struct sock_filter) { code, yes, no, k };
}

static void emit_load(struct program *program, size_t at)
{
    emit(program, BPF_LD | BPF_W | BPF_ABS, (uint32_t)at, 0, 0);
}

static void emit_call(struct program *program, int call, uint32_t answer)
{
    emit(program, BPF_JMP | BPF_JEQ | BPF_K, (uint32_t)call, 0, 1);
    emit(program, BPF_RET | BPF_K, answer, 0, 0);
}

/* Allowed by this row, or on to what comes behind it. */
static void emit_rule(struct program *program, const struct rule *rule)
{
    const int most = sizeof rule->checks / sizeof *rule->checks;
    unsigned char left = 1;     /* instructions of the row behind the one emitted, and its answer */

    for (int i = 0; i < most; i++)
        left += rule->checks[i].bits != 0 ? 3 : 0;
    emit_load(program, offsetof(struct seccomp_data, nr));
    emit(program, BPF_JMP | BPF_JEQ | BPF_K, (uint32_t)rule->call.number, 0, left);
    for (int i = 0; i < most && rule->checks[i].bits != 0; i++) {
        left -= 3;
        emit_load(program, offsetof(struct seccomp_data, args) + (size_t)rule->checks[i].at);
        emit(program, BPF_ALU | BPF_AND | BPF_K, rule->checks[i].bits, 0, 0);
        emit(program, BPF_JMP | BPF_JEQ | BPF_K, rule->checks[i].is, 0, left);
    }
    emit(program, BPF_RET | BPF_K, SECCOMP_RET_ALLOW, 0, 0);
}

static void make_program(struct program *program)
{
    struct rule rules[RULES_MOST];
    int count = list_rules(rules, (uint32_t)getpid());

    program->length = 0;
    emit_load(program, offsetof(struct seccomp_data, arch));
    emit(program, BPF_JMP | BPF_JEQ | BPF_K, ARCHITECTURE, 1, 0);
    emit(program, BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS, 0, 0);
    emit_load(program, offsetof(struct seccomp_data, nr));
    for (size_t i = 0; i < sizeof free_calls / sizeof *free_calls; i++)
        emit_call(program, free_calls[i].number, SECCOMP_RET_ALLOW);
    emit_call(program, SYS_clone3, SECCOMP_RET_ERRNO | ENOSYS);
    emit_call(program, SYS_sched_setscheduler, SECCOMP_RET_ERRNO | 0);
    for (int i = 0; i < count; i++)
        emit_rule(program, &rules[i]);
    emit(program, BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM, 0, 0);
}

static enum modal_status install(struct program *program, struct modal_error *err)
{
    struct sock_fprog filter = { .filter = program->code, .len = program->length };

    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) < 0)
        return modal_fail(err, MODAL_IO, "worker: no_new_privs: %s", strerror(errno));
    if (syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_TSYNC, &filter) != 0)
        return modal_fail(err, MODAL_IO, "worker: seccomp: %s", strerror(errno));
    return MODAL_OK;
}

enum modal_status confine_calls(bool *done, struct modal_error *err)
{
    struct program program;
    enum modal_status rc;

    make_program(&program);
    rc = install(&program, err);
    *done = rc == MODAL_OK;
    return rc;
}

enum modal_status confine_opening(bool *done, struct modal_error *err)
{
    struct program program = { .length = 0 };
    enum modal_status rc;

    emit_load(&program, offsetof(struct seccomp_data, nr));
    emit_call(&program, SYS_openat, SECCOMP_RET_ERRNO | EPERM);
#if defined(__x86_64__)
    emit_call(&program, SYS_open, SECCOMP_RET_ERRNO | EPERM);
#endif
    emit(&program, BPF_RET | BPF_K, SECCOMP_RET_ALLOW, 0, 0);
    rc = install(&program, err);
    *done = rc == MODAL_OK;
    return rc;
}

#else
enum modal_status confine_calls(bool *done, struct modal_error *err)
{
    (void)err;
    *done = false;
    return MODAL_OK;
}

enum modal_status confine_opening(bool *done, struct modal_error *err)
{
    return confine_calls(done, err);
}
#endif
