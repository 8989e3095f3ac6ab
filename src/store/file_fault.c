/* file_fault.c - making the n-th call of a kind fail; see file.h for the rules' text */
#include "store/file_fault.h"
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

const char *const file_calls[FILE_CALL_COUNT] = {
    "open",      "pread",     "pwrite", "fsync",  "fdatasync",
    "ftruncate", "fallocate", "rename", "unlink", "mkdir",
};

#ifdef MODALD_FAULTS
enum {
    RULES_MOST = 8,                  /* of one text */
    ANY        = FILE_CALL_COUNT,    /* a rule of every call */
};

struct rule {
    int call;              /* enum file_call or ANY */
    long from;
    bool onwards;
    struct file_fault fault;
    bool kill_before;
};

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static pthread_once_t once = PTHREAD_ONCE_INIT;
static struct rule rules[RULES_MOST];
static int rule_count;
static long calls[FILE_CALL_COUNT + 1];

static const struct { const char *name; struct file_fault fault; bool kill_before; } ways[] = {
    { "EIO", { EIO, false, false }, false },       { "ENOSPC", { ENOSPC, false, false }, false },
    { "EDQUOT", { EDQUOT, false, false }, false }, { "EMFILE", { EMFILE, false, false }, false },
    { "EACCES", { EACCES, false, false }, false }, { "ENOENT", { ENOENT, false, false }, false },
    { "EINTR", { EINTR, false, false }, false },   { "short", { 0, true, false }, false },
    { "kill", { 0, false, false }, true },         { "kill-after", { 0, false, true }, false },
};

static bool rule_read(const char *text, struct rule *out)
{
    char call[16], way[16];
    struct rule rule = { .call = -1 };
    char *end;

    if (sscanf(text, "%15[a-z]:", call) != 1)
        return false;
    for (int i = 0; i < FILE_CALL_COUNT; i++)
        if (strcmp(call, file_calls[i]) == 0)
            rule.call = i;
    if (strcmp(call, "any") == 0)
        rule.call = ANY;
    rule.from = strtol(text + strlen(call) + 1, &end, 10);
    rule.onwards = *end == '+';
    if (rule.call < 0 || rule.from < 1 || sscanf(end + rule.onwards, ":%15[A-Za-z-]", way) != 1)
        return false;
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++)
        if (strcmp(way, ways[i].name) == 0) {
            rule.fault = ways[i].fault;
            rule.kill_before = ways[i].kill_before;
            *out = rule;
            return true;
        }
    return false;
}

/* A test that asks for a fault and gets none would pass for the wrong reason: a rule that cannot be
 * read ends the process. */
static void rules_read(const char *text)
{
    rule_count = 0;
    memset(calls, 0, sizeof calls);
    while (text != NULL && *text != 0) {
        if (rule_count == RULES_MOST || !rule_read(text, &rules[rule_count])) {
            fprintf(stderr, "MODALD_FAULT: \"%s\" is no rule of store/file.h\n", text);
            abort();
        }
        rule_count++;
        text = strchr(text, ',');
        text = text != NULL ? text + 1 : NULL;
    }
}

static void from_environment(void)
{
    rules_read(getenv("MODALD_FAULT"));
}

bool file_fault(const char *text)
{
    pthread_once(&once, from_environment);
    pthread_mutex_lock(&mutex);
    rules_read(text);
    pthread_mutex_unlock(&mutex);
    return true;
}

long file_fault_count(enum file_call call)
{
    long count;

    pthread_mutex_lock(&mutex);
    count = calls[call];
    pthread_mutex_unlock(&mutex);
    return count;
}

struct file_fault file_fault_next(enum file_call call)
{
    struct file_fault fault = { 0, false, false };
    bool kill_now = false;

    pthread_once(&once, from_environment);
    pthread_mutex_lock(&mutex);
    calls[call]++;
    calls[ANY]++;
    for (int i = 0; i < rule_count; i++) {
        const struct rule *rule = &rules[i];
        long n = rule->call == ANY ? calls[ANY] : rule->call == (int)call ? calls[call] : 0;
        if (n == rule->from || (rule->onwards && n > rule->from)) {
            fault = rule->fault;
            kill_now = rule->kill_before;
        }
    }
    pthread_mutex_unlock(&mutex);
    if (kill_now)
        kill(getpid(), SIGKILL);
    return fault;
}

void file_fault_after(struct file_fault fault)
{
    if (fault.kill)
        kill(getpid(), SIGKILL);
}

#else
bool file_fault(const char *text)
{
    (void)text;
    return false;
}

long file_fault_count(enum file_call call)
{
    (void)call;
    return 0;
}
#endif
