/* terminal.c - see terminal.h: a stream of our own (fopencookie(3)) in front of the terminal's */
#include "terminal.h"
#include <string.h>
#include <unistd.h>
#include "base/utf8.h"

/* The terminal's stream, and the beginning of a sequence that comes in two pieces. */
struct guard { FILE *under; char begun[4]; size_t count; };

static struct guard out, err;

/* The beginning that was kept and the first bytes of TEXT: how many of these are done with it. */
static size_t complete(struct guard *g, const char *text, size_t length)
{
    char joined[2 * sizeof g->begun];
    size_t more = length < sizeof g->begun ? length : sizeof g->begun, left;

    memcpy(joined, g->begun, g->count);
    memcpy(joined + g->count, text, more);
    left = g->count + more;
    left -= utf8_put(g->under, joined, left);
    memcpy(g->begun, joined + g->count + more - left, left);
    g->count = left > more ? left : 0;             /* still only begun: TEXT was short */
    return g->count > 0 ? more : more - left;
}

static ssize_t guarded(void *cookie, const char *text, size_t length)
{
    struct guard *g = cookie;
    size_t done = g->count > 0 ? complete(g, text, length) : 0;

    done += utf8_put(g->under, text + done, length - done);
    g->count = length - done > 0 ? length - done : g->count;
    memcpy(g->begun, text + done, length - done);
    return fflush(g->under) == 0 ? (ssize_t)length : 0;
}

/* What prints to STREAM from now on: itself where that is no terminal. */
static FILE *put_before(FILE *stream, struct guard *g, int mode)
{
    FILE *file;

    g->under = stream;
    if (!isatty(fileno(stream)))
        return stream;
    file = fopencookie(g, "w", (cookie_io_functions_t) { .write = guarded });
    if (file == NULL)
        return stream;
    setvbuf(file, NULL, mode, 0);
    return file;
}

void terminal_guard(void)
{
    stdout = put_before(stdout, &out, _IOLBF);
    stderr = put_before(stderr, &err, _IONBF);
}

FILE *terminal_stdout(void)
{
    fflush(stdout);
    return out.under != NULL ? out.under : stdout;
}

FILE *terminal_stderr(void)
{
    return err.under != NULL ? err.under : stderr;
}
