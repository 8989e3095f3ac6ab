/*
 * confine.c - a worker shut in; see confine.h
 *
 * A job computes on data a user chose, some of it in a language of the user's own (Lua).  Should that take over the process, it
 * finds: no new sockets, programs, files or mappings that can be executed; nothing to read but its inputs; one
 * connection, on which the daemon believes only what fits the job it gave.
 *
 * The filter is a list of what computing, ZeroMQ's threads and glibc need.  Everything else fails with EPERM rather than
 * ending the process, so that a library that only asks in vain goes on; clone3 says ENOSYS, since its flags cannot be
 * seen and glibc then uses clone.
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

enum { NICE = 10, FILES_MOST = 256 };

/* --- limits --- */

static enum modal_status set_limit(int which, rlim_t most, const char *name, struct modal_error *err)
{
    struct rlimit limit;

    if (getrlimit((__rlimit_resource_t)which, &limit) == 0 && limit.rlim_max < most)
        most = limit.rlim_max;
    limit.rlim_cur = limit.rlim_max = most;
    return setrlimit((__rlimit_resource_t)which, &limit) == 0 ? MODAL_OK : modal_fail(err, MODAL_IO, "worker: limit of %s: %s", name, strerror(errno));
}

enum modal_status confine_limits(const struct confine_options *options, struct modal_error *err)
{
    enum modal_status rc;

    setpgid(0, 0);                      /* fails where the parent has done it */
    if (getpriority(PRIO_PROCESS, 0) < NICE && setpriority(PRIO_PROCESS, 0, NICE) < 0)
        return modal_fail(err, MODAL_IO, "worker: nice: %s", strerror(errno));
    signal(SIGXFSZ, SIG_IGN);
    rc = set_limit(RLIMIT_CORE, 0, "core files", err);
    if (rc == MODAL_OK)
        rc = set_limit(RLIMIT_NOFILE, FILES_MOST, "descriptors", err);
    if (rc == MODAL_OK)
        rc = set_limit(RLIMIT_FSIZE, 0, "file size", err);
    if (rc == MODAL_OK && options->memory > 0)
        rc = set_limit(RLIMIT_AS, options->memory, "memory", err);
    if (rc == MODAL_OK && options->user == NULL && prctl(PR_SET_PDEATHSIG, SIGKILL) < 0)
        rc = modal_fail(err, MODAL_IO, "worker: parent's death: %s", strerror(errno));
    return rc;
}

/* --- files --- */

#define EVERY_FILE_ACCESS                                                                                                     \
    (LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR | \
     LANDLOCK_ACCESS_FS_REMOVE_DIR | LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_MAKE_CHAR | LANDLOCK_ACCESS_FS_MAKE_DIR | \
     LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_MAKE_SOCK | LANDLOCK_ACCESS_FS_MAKE_FIFO | LANDLOCK_ACCESS_FS_MAKE_BLOCK | \
     LANDLOCK_ACCESS_FS_MAKE_SYM)

static void allow_reading(int rules, const char *path)
{
    struct landlock_path_beneath_attr rule = { .allowed_access = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR };
    struct stat known;

    rule.parent_fd = open(path, O_PATH | O_CLOEXEC);
    if (rule.parent_fd < 0)
        return;
    if (fstat(rule.parent_fd, &known) == 0 && !S_ISDIR(known.st_mode))
        rule.allowed_access = LANDLOCK_ACCESS_FS_READ_FILE;
    syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0);
    close(rule.parent_fd);
}

enum modal_status confine_files(const struct confine_options *options, bool *done, struct modal_error *err)
{
    /* glibc and OpenBLAS ask how many processors and how much memory there are */
    static const char *const always[] = { "/proc/self", "/proc/meminfo", "/proc/cpuinfo", "/proc/stat", "/sys/devices/system/cpu", "/usr/lib", "/usr/share/zoneinfo" };
    struct landlock_ruleset_attr handled = { .handled_access_fs = EVERY_FILE_ACCESS };
    char spool[4200];
    int rules, failed;

    *done = false;
    if (options->data == NULL)
        return MODAL_OK;
    rules = (int)syscall(SYS_landlock_create_ruleset, &handled, sizeof handled, 0);
    if (rules < 0)
        return MODAL_OK;                /* a kernel without it: the other walls stand */
    for (size_t i = 0; i < sizeof always / sizeof *always; i++)
        allow_reading(rules, always[i]);
    snprintf(spool, sizeof spool, "%s/spool", options->data);
    allow_reading(rules, spool);
    failed = prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) < 0 || syscall(SYS_landlock_restrict_self, rules, 0) < 0;
    close(rules);
    if (failed)
        return modal_fail(err, MODAL_IO, "worker: landlock: %s", strerror(errno));
    *done = true;
    return MODAL_OK;
}

/* --- user --- */

/* The spool's files may be read by its group. */
static gid_t spool_group(const struct confine_options *options, gid_t otherwise)
{
    struct stat known;

    return options->data != NULL && stat(options->data, &known) == 0 ? known.st_gid : otherwise;
}

enum modal_status confine_user(const struct confine_options *options, struct modal_error *err)
{
    const struct passwd *user;
    gid_t group;

    if (options->user == NULL)
        return MODAL_OK;
    user = getpwnam(options->user);
    if (user == NULL)
        return modal_fail(err, MODAL_NOT_FOUND, "worker: no user %s", options->user);
    group = spool_group(options, user->pw_gid);
    if (geteuid() == 0 && (setgroups(0, NULL) < 0 || setresgid(group, group, group) < 0 || setresuid(user->pw_uid, user->pw_uid, user->pw_uid) < 0))
        return modal_fail(err, MODAL_DENIED, "worker: becoming %s: %s", options->user, strerror(errno));
    if (geteuid() != user->pw_uid)
        return modal_fail(err, MODAL_DENIED, "worker: only root can become %s", options->user);
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) < 0)       /* changing the user has cleared it */
        return modal_fail(err, MODAL_IO, "worker: parent's death: %s", strerror(errno));
    return MODAL_OK;
}

/* --- system calls --- */

#if defined(__x86_64__)
#define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#define ARCHITECTURE AUDIT_ARCH_AARCH64
#endif

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define SANITIZED 1
#endif
#endif

#if defined(ARCHITECTURE) && !defined(SANITIZED)

static const int free_calls[] = {
    /* what is open already */
    SYS_read, SYS_write, SYS_readv, SYS_writev, SYS_pread64, SYS_lseek, SYS_close, SYS_fstat, SYS_fcntl, SYS_recvmsg, SYS_recvfrom,
    SYS_sendmsg, SYS_sendto, SYS_getsockopt, SYS_setsockopt, SYS_getsockname, SYS_getpeername, SYS_shutdown, SYS_ppoll, SYS_pselect6,
    SYS_epoll_pwait, SYS_epoll_ctl, SYS_epoll_create1, SYS_eventfd2,
    /* looking */
    SYS_newfstatat, SYS_statx, SYS_readlinkat, SYS_faccessat, SYS_getcwd, SYS_uname, SYS_sysinfo, SYS_getrusage, SYS_times, SYS_getpid,
    SYS_getppid, SYS_gettid, SYS_getuid, SYS_geteuid, SYS_getgid, SYS_getegid, SYS_sched_getaffinity, SYS_getcpu, SYS_getrandom,
    SYS_prlimit64, SYS_sched_getparam, SYS_sched_getscheduler, SYS_clock_gettime, SYS_clock_getres, SYS_gettimeofday, SYS_getpriority,
    /* memory and threads */
    SYS_munmap, SYS_mremap, SYS_madvise, SYS_brk, SYS_futex, SYS_set_robust_list, SYS_rseq, SYS_membarrier, SYS_sched_yield, SYS_nanosleep,
    SYS_clock_nanosleep, SYS_rt_sigaction, SYS_rt_sigprocmask, SYS_rt_sigreturn, SYS_sigaltstack, SYS_restart_syscall, SYS_exit, SYS_exit_group,
#if defined(__x86_64__)
    SYS_poll, SYS_select, SYS_epoll_wait, SYS_stat, SYS_lstat, SYS_readlink, SYS_access, SYS_getrlimit, SYS_time,
#endif
};

/* Allowed where (argument & mask) == value. */
struct checked { int call, argument; uint32_t mask, value; };
#define WRITING (O_WRONLY | O_RDWR | O_CREAT | O_TRUNC | O_APPEND | (O_TMPFILE & ~O_DIRECTORY))

enum { CHECKED_MOST = 8, PROGRAM_MOST = 16 + 2 * (int)(sizeof free_calls / sizeof *free_calls) + 6 * CHECKED_MOST };

struct program { struct sock_filter code[PROGRAM_MOST]; unsigned short length; };

static void emit(struct program *program, unsigned short code, uint32_t k, unsigned char yes, unsigned char no)
{
    program->code[program->length++] = (struct sock_filter) { code, yes, no, k };
}

static void emit_call(struct program *program, int call, uint32_t answer)
{
    emit(program, BPF_JMP | BPF_JEQ | BPF_K, (uint32_t)call, 0, 1);
    emit(program, BPF_RET | BPF_K, answer, 0, 0);
}

static void emit_checked(struct program *program, const struct checked *rule)
{
    emit(program, BPF_JMP | BPF_JEQ | BPF_K, (uint32_t)rule->call, 0, 5);
    emit(program, BPF_LD | BPF_W | BPF_ABS, (uint32_t)(offsetof(struct seccomp_data, args) + 8 * (size_t)rule->argument), 0, 0);
    emit(program, BPF_ALU | BPF_AND | BPF_K, rule->mask, 0, 0);
    emit(program, BPF_JMP | BPF_JEQ | BPF_K, rule->value, 0, 1);
    emit(program, BPF_RET | BPF_K, SECCOMP_RET_ALLOW, 0, 0);
    emit(program, BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM, 0, 0);
}

static void make_program(struct program *program)
{
    const struct checked rules[] = {
        { SYS_openat, 2, WRITING, 0 },
        { SYS_mmap, 2, PROT_EXEC, 0 },
        { SYS_mprotect, 2, PROT_EXEC, 0 },
        { SYS_clone, 0, CLONE_THREAD, CLONE_THREAD },
        { SYS_tgkill, 0, ~0u, (uint32_t)getpid() },      /* abort() */
        { SYS_prctl, 0, ~0u, PR_SET_NAME },
        { SYS_sched_setscheduler, 1, ~0u, SCHED_OTHER }, /* what ZeroMQ sets on a thread it starts */
#if defined(__x86_64__)
        { SYS_open, 1, WRITING, 0 },
#endif
    };

    program->length = 0;
    emit(program, BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, arch), 0, 0);
    emit(program, BPF_JMP | BPF_JEQ | BPF_K, ARCHITECTURE, 1, 0);
    emit(program, BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS, 0, 0);
    emit(program, BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr), 0, 0);
    for (size_t i = 0; i < sizeof free_calls / sizeof *free_calls; i++)
        emit_call(program, free_calls[i], SECCOMP_RET_ALLOW);
    for (size_t i = 0; i < sizeof rules / sizeof *rules; i++)
        emit_checked(program, &rules[i]);
    emit_call(program, SYS_clone3, SECCOMP_RET_ERRNO | ENOSYS);
    emit(program, BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM, 0, 0);
}

enum modal_status confine_calls(bool *done, struct modal_error *err)
{
    struct program program;
    struct sock_fprog filter = { .filter = program.code };

    make_program(&program);
    filter.len = program.length;
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) < 0)
        return modal_fail(err, MODAL_IO, "worker: no_new_privs: %s", strerror(errno));
    if (syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_TSYNC, &filter) != 0)
        return modal_fail(err, MODAL_IO, "worker: seccomp: %s", strerror(errno));
    *done = true;
    return MODAL_OK;
}

#else
enum modal_status confine_calls(bool *done, struct modal_error *err)
{
    (void)err;
    *done = false;
    return MODAL_OK;
}
#endif
