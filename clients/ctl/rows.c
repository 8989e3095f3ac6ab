/* rows.c - see rows.h */
#include "rows.h"
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "csv.h"

enum {
    HEAD_ROWS = 64,             /* the least window of a stream: nothing is told before them */
    HEAD_TRIES = 2,             /* a row below names, and one that says the step of a time */
    PREAMBLE_MOST = 1 << 20,    /* bytes: OpenFAST's is below one thousand */
    LINE_MOST = 4 << 20,        /* bytes: SIGNALS_CHANNELS_MOST numbers of 32 characters, twice */
    READ_BYTES = 1 << 16,       /* what a pipe holds */
};

struct rows {
    int fd;
    const char *path;
    struct signals_options options;
    char *text;                 /* read and not yet taken: from BEGIN to END, a 0 behind it */
    size_t begin, end, room;
    bool ended;
    size_t number;              /* lines taken */
    struct csv_shape shape;
    double dt;                  /* that times must keep; 0: they are not looked at */
};

/* More text, if any comes within WAIT_MS (-1: however long). */
static enum modal_status read_more(struct rows *rows, int wait_ms, struct modal_error *err)
{
    struct pollfd ready = { .fd = rows->fd, .events = POLLIN };
    ssize_t got;

    if (rows->begin > rows->end / 2) {
        memmove(rows->text, rows->text + rows->begin, rows->end - rows->begin);
        rows->end -= rows->begin;
        rows->begin = 0;
    }
    if (rows->room < rows->end + READ_BYTES + 1) {
        size_t room = 2 * rows->room + READ_BYTES + 1;
        char *text = realloc(rows->text, room);
        if (text == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for %zu bytes", rows->path,
                              room);
        rows->text = text;
        rows->room = room;
    }
    if (poll(&ready, 1, wait_ms) == 0)
        return MODAL_OK;
    got = read(rows->fd, rows->text + rows->end, READ_BYTES);
    if (got < 0 && errno != EINTR && errno != EAGAIN)
        return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: %s", rows->path,
                                strerror(errno));
    rows->ended = got == 0;
    rows->end += got > 0 ? (size_t)got : 0;
    rows->text[rows->end] = 0;
    return MODAL_OK;
}

/* The line at FROM, of the text read, its end made a 0; *NEXT is what stands behind it.  NULL: it
 * has no end yet. */
static char *line_at(struct rows *rows, size_t from, size_t *next)
{
    char *line, *stop;
    size_t length;

    if (from >= rows->end)
        return NULL;
    line = rows->text + from;
    stop = memchr(line, '\n', rows->end - from);
    if (stop == NULL && !rows->ended)
        return NULL;
    length = stop != NULL ? (size_t)(stop - line) : rows->end - from;
    *next = from + length + (stop != NULL);
    line[length] = 0;
    if (length > 0 && line[length - 1] == '\r')
        line[length - 1] = 0;
    return line;
}

/* Lines that say nothing: blank, or remarks. */
static bool is_idle(const char *line)
{
    return line[0] == '#' || line[0] == '%' || line[strspn(line, " \t")] == 0;
}

/* What is known of the lines that may be the head. */
struct look {
    size_t at;                  /* bytes looked at */
    size_t run, columns;        /* rows alike in succession, up to there */
    size_t run_at;              /* where they begin */
    int tries;
};

/* Look at one line more; false: there is none yet. */
static bool look_on(struct rows *rows, struct look *look)
{
    size_t next, columns, length;               /* of the line as a string, which a 0 may cut */
    char *copy, *end = look->at < rows->end
                           ? memchr(rows->text + look->at, '\n', rows->end - look->at) : NULL;

    if (look->at >= rows->end || (end == NULL && !rows->ended))
        return false;
    next = end != NULL ? (size_t)(end - rows->text) + 1 : rows->end;
    copy = csv_copy(rows->text + look->at, next - look->at - (end != NULL));
    length = copy != NULL ? strlen(copy) : 0;
    if (length > 0 && copy[length - 1] == '\r')
        copy[length - 1] = 0;
    if (copy != NULL && !is_idle(copy)) {
        columns = csv_is_row(copy);
        if (columns == 0 || columns != look->columns) {
            look->run = 0;
            look->run_at = look->at;
        }
        look->columns = columns;
        look->run += columns > 0;
    }
    free(copy);
    look->at = next;
    rows->number++;
    return true;
}

/* Read what was looked at as a file. */
static enum modal_status read_head(struct rows *rows, const struct look *look, struct signals *head,
                                   struct modal_error *err)
{
    char *copy;
    enum modal_status rc;

    if (memchr(rows->text, 0, look->at) != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s: not text; accepted from a "
                                "pipe: rows of numbers", rows->path);
    copy = strndup(rows->text, look->at);
    if (copy == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for %zu bytes", rows->path,
                          look->at);
    rc = signals_read_rows(copy, rows->path, &rows->options, head, &rows->shape, err);
    free(copy);
    return rc;
}

/* Is the head known by what was looked at?  A head that came whole is read whatever it says. */
static enum modal_status try_head(struct rows *rows, struct look *look, bool *known,
                                  struct signals *head, struct modal_error *err)
{
    bool whole = rows->ended && look->at == rows->end;

    *known = look->run >= HEAD_ROWS || whole;
    if (*known)
        return read_head(rows, look, head, err);
    if (rows->options.dt > 0 && look->run > 0 && look->tries < HEAD_TRIES) {
        look->tries++;
        *known = read_head(rows, look, head, &(struct modal_error) { 0 }) == MODAL_OK
                 && head->names != NULL;
        if (!*known)
            signals_done(head);
    }
    return MODAL_OK;
}

static enum modal_status find_head(struct rows *rows, struct signals *head,
                                   struct modal_error *err)
{
    struct look look = { 0 };
    bool known = false;
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && !known) {
        if (look_on(rows, &look) || rows->ended)
            rc = try_head(rows, &look, &known, head, err);
        else if (rows->end - look.at > LINE_MOST
                 || (look.run == 0 ? look.at : look.run_at) > PREAMBLE_MOST)
            rc = modal_fail_field(err, MODAL_TOO_LARGE, "signals", "%s: no row of numbers in its "
                                  "first %zu bytes", rows->path, rows->end);
        else
            rc = read_more(rows, -1, err);
    }
    rows->begin = look.at;
    return rc;
}

enum modal_status rows_open(int fd, const char *path, const struct signals_options *options,
                            struct rows **out, struct signals *head, struct modal_error *err)
{
    struct rows *rows = calloc(1, sizeof *rows);
    enum modal_status rc;

    *out = rows;
    if (rows == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory", path);
    *rows = (struct rows) { .fd = fd, .path = path, .options = *options };
    rc = find_head(rows, head, err);
    rows->dt = options->ignore_time ? 0 : head->dt;
    return rc;
}

enum modal_status rows_next(struct rows *rows, double *x, int wait_ms, enum rows_state *state,
                            struct modal_error *err)
{
    size_t next = 0, channels = rows->shape.columns - (rows->shape.time >= 0);
    char *line = line_at(rows, rows->begin, &next);
    enum modal_status rc = MODAL_OK;

    if (line == NULL && !rows->ended) {
        if (rows->end - rows->begin > LINE_MOST)
            return modal_fail_field(err, MODAL_TOO_LARGE, "signals", "%s: line %zu has over %d "
                                    "bytes", rows->path, rows->number + 1, LINE_MOST);
        rc = read_more(rows, wait_ms, err);
        line = rc == MODAL_OK ? line_at(rows, rows->begin, &next) : NULL;
    }
    *state = line == NULL && rows->ended ? ROWS_END : ROWS_NONE_YET;
    if (line == NULL)
        return rc;
    rows->begin = next;
    rows->number++;
    if (is_idle(line))
        return MODAL_OK;
    rc = csv_row(&rows->shape, line, rows->path, rows->number, rows->dt, x, err);
    for (size_t i = 0; rc == MODAL_OK && rows->options.scale > 0 && i < channels; i++)
        x[i] *= rows->options.scale;
    *state = ROWS_ROW;
    return rc;
}

void rows_close(struct rows *rows)
{
    if (rows != NULL)
        free(rows->text);
    free(rows);
}
