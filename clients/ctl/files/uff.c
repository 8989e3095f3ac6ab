/* uff.c - see uff.h
 *
 * A data set stands between two lines "    -1"; the line after the first is its number.  A 58 has
 * eleven lines of head in fixed columns: 6 says the function's type and its node, 7 how its numbers
 * lie: type (2 single, 4 double, 5 and 6 the same complex), how many, whether the steps are even,
 * the first abscissa, the step; 8 the abscissa's label and units, of 20 columns each.  Text has six
 * numbers of 13 columns in a line, doubles four of 20; uneven ones an abscissa of 13 columns before
 * each.  A 58b has the same head and says in its first line the order of bytes (1 little, 2 big
 * endian), the form (2: IEEE 754) and the bytes that follow, which writers get wrong: what line 7
 * says is held against the end of the data set.
 */
#include "uff.h"
#include <ctype.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/utf8.h"
#include "steps.h"

enum {
    LINE = 256,                              /* columns of a line that are looked at */
    HEAD_LINES = 11,                         /* of a function; in them: */
    TYPE_LINE  = 6,                          /* type and nodes */
    FORM_LINE  = 7,                          /* how numbers lie */
    TIME_LINE  = 8,                          /* of the abscissa: its label and units */
    TURNS      = 6,                          /* directions: three ways, three turns */
    NUMBER_COLUMNS = 6,                      /* of a data set's number; 58b has its b behind them */
    TIME_RESPONSE = 1,                       /* type of a function */
    SINGLE         = 2,                      /* types of numbers */
    DOUBLE         = 4,                      /* of 8 bytes */
    COMPLEX_SINGLE = 5,                      /* pairs of 2 */
    COMPLEX_DOUBLE = 6,                      /* pairs of 4 */
    NARROW = 13,                             /* columns of a number */
    WIDE   = 20,                             /* of a double */
    IEEE           = 2,                      /* form of binary numbers */
    BIG_ENDIAN_58B = 2,                      /* order of their bytes */
    END_ROOM = 4,                            /* bytes of line ends that may stand before "-1" */
    TYPES_TOLD = 200,                        /* bytes of a message */
};

/* One function: where its numbers are, and what its head says. */
struct function {
    int type, form;                          /* of the function, of its numbers */
    bool binary, big, even;
    size_t count;
    double step, digits;                     /* s, and what its last digit leaves open */
    const char *unit;                        /* of times, as steps_unit */
    size_t at;
    char name[LINE];
};

struct uff {
    struct bytes file;
    const char *path;
    size_t line;
    struct function *list;                   /* of time responses */
    size_t count, room;
    char others[TYPES_TOLD];                 /* types of other functions, told once each */
};

static enum modal_status damaged(const struct uff *u, const char *what, struct modal_error *err)
{
    return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: line %zu: %s; accepted: a whole "
                            "universal file with data sets 58 or 58b", u->path, u->line, what);
}

/* The next line without its end, cut at LINE; false at the end of the file. */
static bool next_line(struct uff *u, char line[LINE])
{
    const unsigned char *from = u->file.data + u->file.at, *end;
    size_t left = bytes_left(&u->file), length, kept;

    if (left == 0)
        return false;
    end = memchr(from, '\n', left);
    length = end != NULL ? (size_t)(end - from) : left;
    u->file.at += length + (end != NULL);
    u->line++;
    kept = length < LINE - 1 ? length : LINE - 1;
    memcpy(line, from, kept);
    line[kept] = 0;
    while (kept > 0 && isspace((unsigned char)line[kept - 1]))
        line[--kept] = 0;
    return true;
}

static bool is_mark(const char *line)
{
    return strcmp(line + strspn(line, " "), "-1") == 0;
}

bool uff_is(const unsigned char *head, size_t length)
{
    struct uff u = { .file = { head, length, 0 } };
    char line[LINE];

    do
        if (!next_line(&u, line))
            return false;
    while (line[0] == 0);
    if (strcmp(line, "    -1") != 0 || !next_line(&u, line))
        return false;
    size_t blanks = strspn(line, " "), digits = strspn(line + blanks, "0123456789");
    return blanks > 0 && digits > 0 && blanks + digits == NUMBER_COLUMNS
           && (line[NUMBER_COLUMNS] == 0 || line[NUMBER_COLUMNS] == 'b');
}

/* ---- numbers in columns ---- */

/* WIDTH columns of LINE from AT on, without blanks around. */
static const char *columns(const char *line, size_t at, size_t width, char field[LINE])
{
    size_t length = strlen(line);

    snprintf(field, LINE, "%.*s", (int)width, at < length ? line + at : "");
    for (length = strlen(field); length > 0 && field[length - 1] == ' '; )
        field[--length] = 0;
    return field + strspn(field, " ");
}

static bool number_in(const char *line, size_t at, size_t width, double *out)
{
    char field[LINE], *end, *letter;
    const char *from = columns(line, at, width, field);

    if ((letter = strpbrk(field, "dD")) != NULL)
        *letter = 'e';
    *out = strtod(from, &end);
    return end != from && *end == 0 && strpbrk(field, "xX") == NULL;
}

/* Half a unit of the last digit of a number in columns. */
static double last_digit(const char *line, size_t at, size_t width)
{
    char field[LINE];
    const char *from = columns(line, at, width, field), *point = strchr(from, '.');
    const char *letter = strpbrk(from, "eEdD");
    size_t decimals = point != NULL ? strspn(point + 1, "0123456789") : 0;

    return 0.5 * pow(10, (letter != NULL ? strtod(letter + 1, NULL) : 0) - (double)decimals);
}

/* ---- heads ---- */

/* How the numbers of a function alternate: an abscissa of its own before each where uneven. */
static size_t ordinate_bytes(const struct function *f)
{
    bool wide = f->form == DOUBLE || f->form == COMPLEX_DOUBLE;
    bool twice = f->form == COMPLEX_SINGLE || f->form == COMPLEX_DOUBLE;

    return (wide ? sizeof(double) : sizeof(float)) * (twice ? 2 : 1);
}

static size_t value_bytes(const struct function *f)
{
    return ordinate_bytes(f) + (f->even ? 0 : sizeof(float));
}

static enum modal_status read_form(struct uff *u, const char *line, struct function *f,
                                   struct modal_error *err)
{
    double form, count, even, step;
    size_t least;

    if (!number_in(line, 0, 10, &form) || !number_in(line, 10, 10, &count)
        || !number_in(line, 20, 10, &even) || !number_in(line, 43, NARROW, &step))
        return damaged(u, "no type, count, spacing and step of numbers in their columns", err);
    if (form != SINGLE && form != DOUBLE && form != COMPLEX_SINGLE && form != COMPLEX_DOUBLE)
        return damaged(u, "the type of its numbers is none of 2, 4, 5, 6", err);
    f->form = (int)form;
    f->even = even != 0;
    least = f->binary ? value_bytes(f) : f->form == DOUBLE ? WIDE : NARROW;
    if (!(count >= 1) || count > (double)(bytes_left(&u->file) / least + 1))
        return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: line %zu announces %.0f "
                                "samples, the file has %zu bytes more: it is cut short",
                                u->path, u->line, count, bytes_left(&u->file));
    f->count = (size_t)count;
    f->step = step;
    f->digits = last_digit(line, 43, NARROW);
    return MODAL_OK;
}

/* "12:+Z" of node 12 and direction 3. */
static void name_function(const char *line, struct function *f)
{
    static const char *const turns[] = { "", "X", "Y", "Z", "RX", "RY", "RZ" };
    char field[LINE];
    double node = 0, direction = 0;
    int way;

    if (!number_in(line, 41, 10, &node) || !number_in(line, 51, 4, &direction)
        || !(fabs(direction) <= TURNS))
        direction = 0;
    way = (int)direction;
    snprintf(field, sizeof field, "%s", columns(line, 31, 10, f->name));
    if (node == 0 && field[0] != 0 && strcmp(field, "NONE") != 0)
        snprintf(f->name, sizeof f->name, "%s", field);
    else
        snprintf(f->name, sizeof f->name, "%.0f%s%s%s", node, way != 0 ? ":" : "",
                 way > 0 ? "+" : way < 0 ? "-" : "", turns[abs(way)]);
}

/* The unit of time in the line of the abscissa; where its field has none, in the label: "Time
 * [ms]". */
static const char *unit_in(const char *line)
{
    char field[LINE];
    const char *unit = steps_unit(columns(line, 47, 20, field));

    return unit[0] != 0 ? unit : steps_unit(steps_behind_time(columns(line, 26, 20, field)));
}

/* The eleven lines. */
static enum modal_status read_head(struct uff *u, struct function *f, struct modal_error *err)
{
    char line[LINE], form[LINE] = "";
    size_t form_line = 0;
    double type;

    for (int i = 1; i <= HEAD_LINES; i++) {
        if (!next_line(u, line))
            return damaged(u, "the file ends in the head of a function", err);
        if (i == TYPE_LINE) {
            if (!number_in(line, 0, 5, &type) || !(fabs(type) < INT_MAX))
                return damaged(u, "no type of function in columns 1 to 5", err);
            f->type = (int)type;
            name_function(line, f);
        } else if (i == FORM_LINE) {
            memcpy(form, line, sizeof form);
            form_line = u->line;
        } else if (i == TIME_LINE)
            f->unit = unit_in(line);
    }
    size_t here = u->line;
    u->line = form_line;
    enum modal_status rc = read_form(u, form, f, err);
    u->line = here;
    f->at = u->file.at;
    return rc;
}

/* ---- what follows a head ---- */

/* The line "-1" right behind the binary numbers of F, which may have stray line ends before it. */
static enum modal_status pass_binary(struct uff *u, const struct function *f,
                                     struct modal_error *err)
{
    char line[LINE] = "";

    if (f->count > bytes_left(&u->file) / value_bytes(f)
        || bytes_next(&u->file, f->count * value_bytes(f)) == NULL)
        return damaged(u, "the file ends in the numbers of a function", err);
    for (int i = 0; i < END_ROOM && line[0] == 0; i++)
        if (!next_line(u, line))
            return damaged(u, "the file ends before the -1 of a data set", err);
    return is_mark(line) ? MODAL_OK
                         : damaged(u, "no -1 behind as many numbers as the head announces", err);
}

/* Lines up to "-1". */
static enum modal_status pass_text(struct uff *u, struct modal_error *err)
{
    char line[LINE];

    while (next_line(u, line))
        if (is_mark(line))
            return MODAL_OK;
    return damaged(u, "the file ends before the -1 of a data set", err);
}

static enum modal_status keep(struct uff *u, const struct function *f, struct modal_error *err)
{
    if (u->count == SIGNALS_CHANNELS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "signals", "%s: more than %d time responses",
                                u->path, SIGNALS_CHANNELS_MOST);
    if (u->count == u->room) {
        size_t room = 2 * u->room + 8;
        struct function *list = realloc(u->list, room * sizeof *list);
        if (list == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for its functions", u->path);
        u->list = list;
        u->room = room;
    }
    u->list[u->count++] = *f;
    return MODAL_OK;
}

/* "4 (frequency response)", once. */
static void tell_other(struct uff *u, int type)
{
    static const char *const types[] = {
        "general", "time response", "auto spectrum", "cross spectrum", "frequency response",
        "transmissibility", "coherence", "auto correlation", "cross correlation",
        "power spectral density", "energy spectral density", "probability density", "spectrum",
    };
    bool known = type >= 0 && type < (int)(sizeof types / sizeof *types);
    char one[60];
    size_t used = strlen(u->others);

    snprintf(one, sizeof one, "%d (%s)", type, known ? types[type] : "another");
    if (strstr(u->others, one) == NULL)
        snprintf(u->others + used, sizeof u->others - used, "%s%s", used > 0 ? ", " : "", one);
}

/* A data set 58 or 58b, whose first line was FIRST. */
static enum modal_status read_function(struct uff *u, const char *first, struct modal_error *err)
{
    struct function f = { 0 };
    int order = 0, form = 0;
    const char *rest = first + strspn(first, " ") + strlen("58");
    enum modal_status rc;

    f.binary = *rest == 'b';
    if (f.binary && (sscanf(rest + 1, "%d%d", &order, &form) != 2 || form != IEEE))
        return damaged(u, "58b whose form of numbers is not 2 (IEEE 754)", err);
    f.big = order == BIG_ENDIAN_58B;
    rc = read_head(u, &f, err);
    if (rc != MODAL_OK)
        return rc;
    if (f.type != TIME_RESPONSE)
        tell_other(u, f.type);
    else if (f.form == COMPLEX_SINGLE || f.form == COMPLEX_DOUBLE)
        return damaged(u, "a time response of complex numbers", err);
    else
        rc = keep(u, &f, err);
    if (rc == MODAL_OK)
        rc = f.binary ? pass_binary(u, &f, err) : pass_text(u, err);
    return rc;
}

static enum modal_status list_functions(struct uff *u, struct modal_error *err)
{
    char line[LINE], others[TYPES_TOLD];
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && next_line(u, line)) {
        if (line[0] == 0)
            continue;
        if (!is_mark(line))
            return damaged(u, "a data set begins with -1", err);
        if (!next_line(u, line))
            return damaged(u, "the file ends before the number of a data set", err);
        const char *number = line + strspn(line, " ");
        bool is_58 = strncmp(number, "58", 2) == 0 && !isdigit((unsigned char)number[2]);
        rc = is_58 ? read_function(u, line, err) : pass_text(u, err);
    }
    snprintf(others, sizeof others, "%s", u->others);
    if (rc == MODAL_OK && u->count == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: no time response; it has %s%s; "
                                "accepted: functions of type 1 (time response)", u->path,
                                others[0] ? "functions of type " : "no function (data set 58)",
                                others);
    return rc;
}

/* ---- numbers ---- */

static void decode(const struct uff *u, const struct function *f, double *x, double *t)
{
    const struct number_type single = { NUMBER_FLOAT, sizeof(float), f->big };
    const struct number_type own = { NUMBER_FLOAT, (int)ordinate_bytes(f), f->big };
    const unsigned char *from = u->file.data + f->at;
    size_t before = f->even ? 0 : sizeof(float);

    for (size_t k = 0; k < f->count; k++, from += value_bytes(f)) {
        if (!f->even)
            t[k] = number_decode(single, from);
        x[k] = number_decode(own, from + before);
    }
}

static enum modal_status read_columns(struct uff *u, const struct function *f, double *x, double *t,
                                      struct modal_error *err)
{
    size_t width = f->form == DOUBLE ? WIDE : NARROW, before = f->even ? 0 : NARROW;
    size_t in_line = f->form == DOUBLE ? (f->even ? 4 : 2) : (f->even ? 6 : 3);
    char line[LINE] = "";

    u->file.at = f->at;
    for (size_t k = 0; k < f->count; k++) {
        size_t at = k % in_line * (width + before);
        if (k % in_line == 0 && (!next_line(u, line) || is_mark(line)))
            return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: function %s has %zu "
                                    "samples, its head announces %zu", u->path, f->name, k,
                                    f->count);
        if ((!f->even && !number_in(line, at, NARROW, &t[k]))
            || !number_in(line, at + before, width, &x[k]))
            return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: function %s, sample %zu: "
                                    "no number in columns %zu to %zu of \"%.80s\"", u->path,
                                    f->name, k, at + before + 1, at + before + width, line);
    }
    return MODAL_OK;
}

/* The numbers of F as channel C of OUT; X and T are room for them. */
static enum modal_status read_channel(struct uff *u, const struct function *f, size_t c, double *x,
                                      double *t, const struct signals_options *options,
                                      struct signals *out, struct modal_error *err)
{
    struct signals one = { .dt = f->step, .dt_off = f->digits, .dt_from = "its abscissa step" };
    enum modal_status rc = steps_unit_check(f->unit, u->path, "its abscissa", options, err);

    if (rc == MODAL_OK && f->binary)
        decode(u, f, x, t);
    else if (rc == MODAL_OK)
        rc = read_columns(u, f, x, t, err);
    if (rc == MODAL_OK && !f->even) {
        one = (struct signals) { 0 };
        /* abscissae are singles, or have six digits */
        rc = steps_read(t, f->count, 1e-6, u->path, "its abscissa", options, &one, err);
    }
    if (rc == MODAL_OK && f->even && !(f->step > 0 && isfinite(f->step)))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "dt", "%s: function %s has a step of %g s; "
                              "accepted: a positive one", u->path, f->name, f->step);
    if (rc == MODAL_OK && c > 0 && !(fabs(one.dt - out->dt) <= one.dt_off + out->dt_off))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s: functions %s and %s have steps "
                              "of %.9g and %.9g s; accepted: one for all", u->path,
                              u->list[0].name, f->name, out->dt, one.dt);
    for (size_t k = 0; rc == MODAL_OK && k < f->count; k++)
        out->x[k * u->count + c] = x[k];
    if (rc == MODAL_OK && c == 0) {
        out->dt = one.dt;
        out->dt_off = one.dt_off;
        out->dt_from = one.dt_from;
    }
    return rc;
}

static void name_channels(const struct uff *u, struct signals *out)
{
    out->names = calloc(u->count, sizeof *out->names);
    for (size_t c = 0; out->names != NULL && c < u->count; c++)
        out->names[c] = utf8_from(u->list[c].name, strlen(u->list[c].name));
}

static enum modal_status read_functions(struct uff *u, const struct signals_options *options,
                                        struct signals *out, struct modal_error *err)
{
    size_t n = u->list[0].count;
    double *x, *t;
    enum modal_status rc = MODAL_OK;

    for (size_t c = 0; c < u->count; c++)
        if (u->list[c].count != n)
            return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s: functions %s and %s have "
                                    "%zu and %zu samples; accepted: one number for all", u->path,
                                    u->list[0].name, u->list[c].name, n, u->list[c].count);
    if (n > SIGNALS_VALUES_MOST / u->count)
        return modal_fail_field(err, MODAL_TOO_LARGE, "signals", "%s: more than %zu values",
                                u->path, SIGNALS_VALUES_MOST);
    x = malloc(n * sizeof *x);
    t = malloc(n * sizeof *t);
    out->x = malloc(n * u->count * sizeof *out->x);
    if (x == NULL || t == NULL || out->x == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for %zu x %zu numbers", u->path, n,
                        u->count);
    for (size_t c = 0; rc == MODAL_OK && c < u->count; c++)
        rc = read_channel(u, &u->list[c], c, x, t, options, out, err);
    out->samples = n;
    out->channels = u->count;
    if (rc == MODAL_OK)
        name_channels(u, out);
    free(x);
    free(t);
    return rc;
}

enum modal_status uff_read(struct bytes file, const char *path,
                           const struct signals_options *options, struct signals *out,
                           struct modal_error *err)
{
    struct uff u = { .file = file, .path = path };
    enum modal_status rc = list_functions(&u, err);

    if (rc == MODAL_OK)
        rc = read_functions(&u, options, out, err);
    free(u.list);
    return rc;
}
