/*
 * libmalloc.c - preloaded: the n-th allocation of this process fails, once (F10)
 *
 * $MALLOC_FAIL holds n, counted from the start of a process named $MALLOC_PROGRAM (or of any, where
 * that is not set).  Where an allocation fails, a line on descriptor 2 says so, or the file
 * $MALLOC_MARK is made, so that a test can tell that it was reached.
 */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

extern char *program_invocation_short_name;
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);

static atomic_long made;
static long failing = -1;                    /* -1: not read yet; 0: none */

static void read_rule(void)
{
    const char *n = getenv("MALLOC_FAIL"), *program = getenv("MALLOC_PROGRAM");

    failing = n != NULL && (program == NULL || strcmp(program, program_invocation_short_name) == 0)
                  ? atol(n)
                  : 0;
}

static bool fails(void)
{
    static const char line[] = "level=notice event=allocation_failed\n";
    const char *mark = getenv("MALLOC_MARK");

    if (failing < 0 && environ != NULL)
        read_rule();
    if (failing <= 0 || atomic_fetch_add(&made, 1) + 1 != failing)
        return false;
    if (mark != NULL)
        close(open(mark, O_CREAT | O_WRONLY | O_CLOEXEC, 0600));
    else if (write(2, line, sizeof line - 1) < 0)
        _exit(9);
    errno = ENOMEM;
    return true;
}

void *malloc(size_t size)
{
    return fails() ? NULL : __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    return fails() ? NULL : __libc_calloc(count, size);
}

void *realloc(void *old, size_t size)
{
    return fails() ? NULL : __libc_realloc(old, size);
}
