/* progress.c - see progress.h */
#include "progress.h"
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>
#include "base/utf8.h"
#include "client.h"
#include "terminal.h"

enum {
    BAR = 30,                 /* signs of a bar: a line of it fits 80 columns */
    LINE = 200                /* bytes of a line */
};
static const double SHOWN_S = 0.1;      /* between two on a terminal: as fast as one reads */
static const double SAID_S = 10;        /* between two lines in a pipe: a log stays short */

/* What is going on, since when, and when it was told last: s of link_now(). */
static struct { char what[16]; double begun, told; } now;

/* Is it time to tell WHAT again?  The first line in a pipe waits too: what is short is not told. */
static bool is_due(const char *what, bool terminal)
{
    double t = link_now();

    if (strcmp(now.what, what) != 0) {
        snprintf(now.what, sizeof now.what, "%s", what);
        now.begun = t;
        now.told = terminal ? -INFINITY : t;
    }
    if (t - now.told < (terminal ? SHOWN_S : SAID_S))
        return false;
    now.told = t;
    return true;
}

static void show(const char *line)
{
    FILE *to = terminal_stderr();

    fputc('\r', to);
    utf8_put(to, line, strlen(line));
    fputs("\033[K\r", to);
}

static void put(bool terminal, const char *line)
{
    if (terminal)
        show(line);
    else
        fprintf(stderr, "modalctl: %s\n", line);
}

void progress_tell(const char *what, double fraction)
{
    bool terminal = isatty(STDERR_FILENO);
    char line[LINE];

    if (!is_due(what, terminal))
        return;
    if (fraction > 0)
        snprintf(line, sizeof line, "%s %.0f %%, %.0f s", now.what, 100 * fraction,
                 link_now() - now.begun);
    else
        snprintf(line, sizeof line, "%s %.0f s", now.what, link_now() - now.begun);
    put(terminal, line);
}

void progress_count(const char *what, size_t done, size_t all, size_t failed)
{
    bool terminal = isatty(STDERR_FILENO), due = is_due(what, terminal);
    double passed = link_now() - now.begun;
    char line[LINE], bar[BAR + 1], left[40] = "";
    int full = all > 0 ? (int)(BAR * done / all) : 0;

    if (!due && !(terminal && done == all))
        return;
    memset(bar, '.', BAR);
    memset(bar, '#', (size_t)full);
    bar[BAR] = 0;
    if (done > 0 && done < all)
        snprintf(left, sizeof left, ", %.0f s left", passed / (double)done * (double)(all - done));
    snprintf(line, sizeof line, "%s [%s] %zu of %zu, %zu failed%s", what, bar, done, all, failed,
             left);
    put(terminal, line);
    if (terminal && done == all)
        fputc('\n', stderr);
}

void progress_end(void)
{
    if (now.what[0] != 0 && isatty(STDERR_FILENO))
        fputs("\r\033[K", terminal_stderr());
    now.what[0] = 0;
}
