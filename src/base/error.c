/* error.c - see error.h */
#include "base/error.h"
#include "base/utf8.h"
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* One row a status, in the order of the enum; the codes are listed in proto/PROTOCOL.md. */
static const struct {
    const char *code;
    int exit;
} statuses[MODAL_STATUS_COUNT] = {
    [MODAL_OK]             = { "ok", 0 },
    [MODAL_BAD_INPUT]      = { "bad_input", 2 },
    [MODAL_TOO_LARGE]      = { "too_large", 2 },
    [MODAL_NO_MEMORY]      = { "no_memory", 1 },
    [MODAL_NO_CONVERGENCE] = { "no_convergence", 1 },
    [MODAL_ELEMENT_FAILED] = { "element_failed", 1 },
    [MODAL_OVERFLOW]       = { "overflow", 1 },
    [MODAL_CANCELLED]      = { "cancelled", 1 },
    [MODAL_RUN_LIMIT]      = { "run_limit", 1 },
    [MODAL_DEADLINE]       = { "deadline", 1 },
    [MODAL_IO]             = { "io_error", 1 },
    [MODAL_STORAGE_FULL]   = { "storage_full", 4 },
    [MODAL_CORRUPT]        = { "corrupt", 1 },
    [MODAL_BUSY]           = { "busy", 4 },
    [MODAL_QUOTA]          = { "quota", 4 },
    [MODAL_CONFLICT]       = { "conflict", 4 },
    [MODAL_EXPIRED]        = { "expired", 4 },
    [MODAL_NOT_FOUND]      = { "not_found", 4 },
    [MODAL_DENIED]         = { "denied", 4 },
    [MODAL_BAD_FRAME]      = { "bad_frame", 2 },
    [MODAL_BAD_VERSION]    = { "bad_version", 2 },
    [MODAL_UNKNOWN_VERB]   = { "unknown_verb", 2 },
    [MODAL_NO_SERVER]      = { "no_server", 3 },
    [MODAL_TIMEOUT]        = { "timeout", 5 },
    [MODAL_WORKER_DIED]    = { "worker_died", 1 },
    [MODAL_DRAINING]       = { "draining", 4 },
    [MODAL_INTERNAL]       = { "internal", 1 },
};

/* A text of LENGTH bytes that was cut at ROOM ends with a whole character. */
static void end_whole(char *text, int length, size_t room)
{
    char *end, *last;

    if (length < 0 || (size_t)length < room)
        return;
    end = last = text + strlen(text);
    while (last > text && ((unsigned char)last[-1] & 0xc0) == 0x80)
        last--;
    if (last > text && utf8_length(last - 1, end) == 0)
        last[-1] = 0;
}

static void fill(struct modal_error *err, enum modal_status status, const char *field,
                 const char *format, va_list args)
{
    if (err == NULL)
        return;
    err->status = status;
    end_whole(err->field, snprintf(err->field, sizeof err->field, "%s", field), sizeof err->field);
    end_whole(err->message, vsnprintf(err->message, sizeof err->message, format, args),
              sizeof err->message);
}

enum modal_status modal_fail(struct modal_error *err, enum modal_status status, const char *format,
                             ...)
{
    va_list args;

    va_start(args, format);
    fill(err, status, "", format, args);
    va_end(args);
    return status;
}

enum modal_status modal_fail_field(struct modal_error *err, enum modal_status status,
                                   const char *field, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    fill(err, status, field, format, args);
    va_end(args);
    return status;
}

const char *modal_status_code(enum modal_status status)
{
    return (unsigned)status < MODAL_STATUS_COUNT ? statuses[status].code : "internal";
}

enum modal_status modal_status_from_code(const char *code)
{
    for (int i = 0; code != NULL && i < MODAL_STATUS_COUNT; i++)
        if (strcmp(code, statuses[i].code) == 0)
            return (enum modal_status)i;
    return MODAL_INTERNAL;
}

int modal_status_exit(enum modal_status status)
{
    return (unsigned)status < MODAL_STATUS_COUNT ? statuses[status].exit : 1;
}
