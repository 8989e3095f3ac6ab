/* loop_log.c - the clocks of the daemon's loop, and the lines of its log with their time */
#include "base/log.h"
#include "broker/shell/log_out.h"
#include "broker/shell/loop.h"
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* A wall clock set beyond it stands still there, in the year 2116, and one before 1970 at its
 * beginning: two such times can be added, and what has no time yet (0) is not to come. */
#define LATEST_S (INT64_MAX / SECOND / 2)

int64_t loop_clock_ns(clockid_t clock)
{
    struct timespec t;

    clock_gettime(clock, &t);
    if (t.tv_sec < 0)
        return 0;
    return t.tv_sec < LATEST_S ? t.tv_sec * SECOND + t.tv_nsec : LATEST_S * SECOND;
}

struct moment loop_now(void)
{
    return (struct moment) { loop_clock_ns(CLOCK_MONOTONIC), loop_clock_ns(CLOCK_REALTIME) };
}

void loop_flush_log(void)
{
    unsigned long dropped = log_out_flush();

    if (dropped > 0)
        loop_log("level=warning event=log_dropped lines=%lu "
                 "message=\"nobody read the log meanwhile\"", dropped);
}

void loop_write_line(const char *text)
{
    /* of the millisecond `stamped`: only one thread writes lines */
    static char stamp[48];
    static int64_t stamped = -1;
    int64_t now = loop_clock_ns(CLOCK_REALTIME), millisecond = now / 1000000;
    time_t seconds = now / SECOND;
    struct tm tm;

    if (millisecond != stamped) {
        char date[24];
        gmtime_r(&seconds, &tm);
        strftime(date, sizeof date, "%Y-%m-%dT%H:%M:%S", &tm);
        snprintf(stamp, sizeof stamp, "time=%s.%03dZ ", date, (int)(millisecond % 1000));
        stamped = millisecond;
    }
    log_out_put(stamp, text);
    if (strncmp(text, "level=info", 10) != 0)
        loop_flush_log();
}

void loop_log(const char *format, ...)
{
    va_list args;
    char *text;

    va_start(args, format);
    text = log_vtext(format, args);
    va_end(args);
    if (text == NULL)
        abort();
    loop_write_line(text);
    free(text);
}

void loop_log_error(const char *event, const struct modal_error *err)
{
    loop_log("level=error event=%s code=%s field=\"%s\" message=\"%s\"", event,
             modal_status_code(err->status), err->field, err->message);
}
