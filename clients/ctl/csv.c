/* csv.c - see csv.h
 *
 * Whether a column is time, and even, is files/steps.h's to say.
 *
 * What is printed to a unit u of its last digit is off by u/2 at most, and dt then by
 * u / 2 / (n - 1).  u is the finest unit of the last TAIL rows: a printer that drops zeros at the
 * end prints "10" after "9.99".
 */
#include "csv.h"
#include <ctype.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "base/utf8.h"
#include "files/steps.h"

enum { TAIL = 10 };              /* rows: one in ten ends in a digit that is not 0 */

struct table {
    const char *path;
    char separator;             /* ' ': any blanks */
    size_t columns, rows, room; /* room: doubles allocated */
    double *x;
    char **names, **units;      /* columns each, or NULL */
    bool short_of_memory;       /* for some of these */
    size_t preamble;            /* lines before names and numbers */
    size_t watched;             /* the column that may be time */
    double unit[TAIL];          /* of its last rows: of the last digit printed */
};

/* Does C stand in LINE, outside of quotes? */
static bool stands_in(const char *line, char c)
{
    bool quoted = false;

    for (; *line != 0; line++) {
        quoted ^= *line == '"';
        if (*line == c && !quoted)
            return true;
    }
    return false;
}

static char separator_of(const char *line)
{
    return stands_in(line, ';')    ? ';'
           : stands_in(line, '\t') ? '\t'
           : stands_in(line, ',')  ? ','
                                   : ' ';
}

/* What stands between the quotes that FIELD begins with, "" for one quote; *REST moves past the
 * separator. */
static char *quoted_field(char *field, char **rest, char separator)
{
    char *to = field + 1, *from = field + 1;

    while (*from != 0 && (*from != '"' || from[1] == '"')) {
        from += *from == '"';
        *to++ = *from++;
    }
    from += strcspn(from, separator == ' ' ? " \t" : (char[]) { separator, 0 });
    *rest = *from ? from + 1 : NULL;
    *to = 0;
    return field + 1;
}

/* The next field of *REST, blanks and quotes around it taken off; NULL at the end. */
static char *next_field(char **rest, char separator)
{
    char *field = *rest, *end;

    if (field == NULL)
        return NULL;
    field += strspn(field, separator == '\t' ? " " : " \t");
    if (*field == '"')
        return quoted_field(field, rest, separator);
    if (separator == ' ') {
        if (*field == 0)
            return *rest = NULL;
        end = field + strcspn(field, " \t");
        *rest = *end ? end + 1 : NULL;
        *end = 0;
        return field;
    }
    *rest = field;
    field = strsep(rest, (char[]) { separator, 0 });
    for (end = field + strlen(field); end > field && isspace((unsigned char)end[-1]); )
        *--end = 0;
    return field;
}

/* A decimal number: with a comma where that parts no columns, and with Fortran's D for its
 * exponent. */
static bool read_number(char *field, char separator, double *value)
{
    char *end, *comma = separator != ',' ? strchr(field, ',') : NULL,
               *letter = strpbrk(field, "dD");

    if (comma != NULL)
        *comma = '.';
    if (letter != NULL && letter > field
        && (isdigit((unsigned char)letter[-1]) || letter[-1] == '.'))
        *letter = 'e';
    *value = strtod(field, &end);
    return end != field && *end == 0 && strpbrk(field, "xX") == NULL;
}

/* The unit of the last digit of a number as read_number left it: 0.01 for 3.25,
 * 1e-5 for 3.250e-2. */
static double last_digit(const char *field)
{
    const char *point = strchr(field, '.'), *letter = strpbrk(field, "eE");
    size_t length = strlen(field), end = letter != NULL ? (size_t)(letter - field) : length;
    size_t decimals = point != NULL ? end - (size_t)(point - field) - 1 : 0;

    return pow(10, (letter != NULL ? strtod(letter + 1, NULL) : 0) - (double)decimals);
}

/* The next line of *REST that says something, without its end; NULL at the end.  *NUMBER counts
 * lines from 1, *REMARK is the last remark passed over, if any. */
static char *next_line(char **rest, size_t *number, char **remark)
{
    char *line;

    while ((line = strsep(rest, "\n")) != NULL) {
        size_t length = strlen(line);
        ++*number;
        if (length > 0 && line[length - 1] == '\r')
            line[--length] = 0;
        if (line[0] == '#' || line[0] == '%')
            *remark = line + 1;
        else if (line[strspn(line, " \t")] != 0)
            return line;
    }
    return NULL;
}

char *csv_copy(const char *line, size_t length)
{
    char *copy = cJSON_malloc(length + 1);

    if (copy != NULL) {
        length = strnlen(line, length);
        memcpy(copy, line, length);
        copy[length] = 0;
    }
    return copy;
}

/* How many fields of LINE are numbers, and how many there are; LINE is left as it was. */
static size_t count_numbers(const char *line, char separator, size_t *fields)
{
    char *copy = csv_copy(line, strlen(line)), *rest = copy, *field;
    size_t numbers = 0;
    double value;

    *fields = 0;
    while (copy != NULL && (field = next_field(&rest, separator)) != NULL) {
        ++*fields;
        numbers += read_number(field, separator, &value);
    }
    free(copy);
    return numbers;
}

static void free_words(char **words, size_t count)
{
    for (size_t i = 0; words != NULL && i < count; i++)
        free(words[i]);
    free(words);
}

/* The words of LINE, one a column. */
static char **split_words(struct table *table, char *line)
{
    char **words = calloc(table->columns, sizeof *words), *field;

    table->short_of_memory |= words == NULL;
    for (size_t i = 0; words != NULL && i < table->columns
                       && (field = next_field(&line, table->separator)) != NULL; i++) {
        words[i] = utf8_from(field, strlen(field));
        table->short_of_memory |= words[i] == NULL;
    }
    return words;
}

/* A row's numbers into X, which has room for the table's columns; *UNIT: of the last digit of the
 * column watched. */
static enum modal_status read_row(const struct table *table, char *line, size_t number, double *x,
                                  double *unit, struct modal_error *err)
{
    size_t column = 0;
    char *field;

    while ((field = next_field(&line, table->separator)) != NULL) {
        char said[64];
        if (column == table->columns && *field == 0 && line == NULL)
            break;                                              /* a separator at the line's end */
        if (column == table->columns)
            return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                    "%s: line %zu has more than %zu columns", table->path, number,
                                    table->columns);
        snprintf(said, sizeof said, "%s", field);
        if (!read_number(field, table->separator, &x[column]))
            return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                    "%s: line %zu, column %zu: \"%.60s\" is not a number",
                                    table->path, number, column + 1, said);
        if (column == table->watched)
            *unit = last_digit(field);
        column++;
    }
    if (column != table->columns)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                "%s: line %zu has %zu columns, not %zu", table->path, number,
                                column, table->columns);
    return MODAL_OK;
}

static enum modal_status add_row(struct table *table, char *line, size_t number,
                                 struct modal_error *err)
{
    size_t need = (table->rows + 1) * table->columns;
    enum modal_status rc;

    if (need > SIGNALS_VALUES_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "signals", "%s: more than %zu values",
                                table->path, SIGNALS_VALUES_MOST);
    if (need > table->room) {
        size_t room = 2 * need + 1024;
        double *x = realloc(table->x, room * sizeof *x);
        if (x == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for %zu values", table->path,
                              room);
        table->x = x;
        table->room = room;
    }
    rc = read_row(table, line, number, table->x + need - table->columns,
                  &table->unit[table->rows % TAIL], err);
    table->rows += rc == MODAL_OK;
    return rc;
}

/* Names may stand in a remark, as NumPy writes them: as many words as columns, none a number. */
static void read_remark(struct table *table, char *remark)
{
    size_t fields = 0;

    if (remark != NULL && count_numbers(remark, table->separator, &fields) == 0
        && fields == table->columns)
        table->names = split_words(table, remark);
}

/* Columns of LINE, whose separator goes to *SEPARATOR; a separator at its end makes none. */
static size_t count_columns(const char *line, char *separator, size_t *numbers)
{
    size_t columns;

    *separator = separator_of(line);
    *numbers = count_numbers(line, *separator, &columns);
    return columns - (columns > 1 && *separator != ' ' && line[strlen(line) - 1] == *separator);
}

size_t csv_is_row(const char *line)
{
    char separator;
    size_t numbers, columns = count_columns(line, &separator, &numbers);

    return numbers == columns ? columns : 0;
}

/* A line that says something, as it lies in the text. */
struct seen { char *at; size_t number; char *copy; };

/* The next such line from *AT on, which is line *NUMBER + 1; the copy is the caller's. */
static bool look_on(char **at, size_t *number, struct seen *out)
{
    while (*at != NULL && **at != 0) {
        char *line = *at, *end = strchr(line, '\n');
        size_t length = end != NULL ? (size_t)(end - line) : strlen(line);
        ++*number;
        *at = end != NULL ? end + 1 : NULL;
        length -= length > 0 && line[length - 1] == '\r';
        if (line[0] == '#' || line[0] == '%' || strspn(line, " \t") >= length)
            continue;
        *out = (struct seen) { line, *number, csv_copy(line, length) };
        return out->copy != NULL;
    }
    return false;
}

/* Nothing but numbers, and so is the line behind it. */
static bool begins_rows(const char *line, char *at, size_t number)
{
    struct seen next;
    size_t columns = csv_is_row(line);
    bool same;

    if (columns == 0 || !look_on(&at, &number, &next))
        return false;
    same = csv_is_row(next.copy) == columns;
    free(next.copy);
    return same;
}

/* Could LINE be names or units of COLUMNS columns?  *BROKEN: it looks like a row, or like names,
 * but not of this table, and who reads from it on says what is wrong. */
static bool is_head(const char *line, char separator, size_t columns, bool *broken)
{
    size_t fields, numbers = count_numbers(line, separator, &fields);

    fields -= fields > 1 && separator != ' ' && line[strlen(line) - 1] == separator;
    *broken = (fields == columns) == (numbers > 0) && fields > 1 && separator != ' ';
    return numbers == 0 && fields == columns;
}

/*
 * Where the table in TEXT begins, with its names and units: behind a preamble, whose lines are
 * counted in *PREAMBLE and passed in *NUMBER.  It is the begin of the text where that is a row, or
 * names of the rows that follow, or where no line is a row.
 */
static char *begin_of_table(char *text, size_t *number, size_t *preamble)
{
    enum { HEAD = 2 };                         /* lines: names, units */
    struct seen above[HEAD + 1] = { 0 }, line;
    size_t count = 0, n = *number, passed = n;
    char *at = text, *begin = text, *first = NULL;

    while (look_on(&at, &n, &line)) {
        bool found = begins_rows(line.copy, at, n), broken = false;
        char separator;
        size_t numbers, columns = count_columns(line.copy, &separator, &numbers), head = 0;
        while (found && head < count && head <= HEAD
               && is_head(above[head].copy, separator, columns, &broken))
            head++;
        bool named = found && first != NULL && is_head(first, separator, columns, &(bool) { 0 });
        if (count == 0)
            first = csv_copy(line.copy, strlen(line.copy));
        free(above[HEAD].copy);
        memmove(above + 1, above, HEAD * sizeof *above);
        above[0] = line;
        if (found && head < count && head <= HEAD && !named && !(head == 0 && broken)) {
            *preamble = count - head;
            begin = above[head].at;
            passed = above[head].number - 1;
        }
        if (found || (count == 0 && numbers == columns))
            break;
        count++;
    }
    for (size_t i = 0; i <= HEAD; i++)
        free(above[i].copy);
    free(first);
    *number = passed;
    return begin;
}

/* Names, where the first line has no number at all; then units, where the second has none
 * either.  Gives the first line of numbers, NULL where there is none. */
static char *read_head(struct table *table, char **rest, size_t *number)
{
    char *remark = NULL, *line;
    size_t fields = 0, numbers;

    *rest = begin_of_table(*rest, number, &table->preamble);
    line = next_line(rest, number, &remark);
    if (line == NULL)
        return NULL;
    table->columns = count_columns(line, &table->separator, &numbers);
    if (numbers > 0) {
        read_remark(table, remark);
        return line;
    }
    table->names = split_words(table, line);
    line = next_line(rest, number, &remark);
    if (line != NULL && count_numbers(line, table->separator, &fields) == 0
        && fields == table->columns) {
        table->units = split_words(table, line);
        line = next_line(rest, number, &remark);
    }
    return line;
}

/* The column that is called time; none: the first. */
static bool find_name(const struct table *table, size_t *column)
{
    *column = 0;
    for (size_t i = 0; table->names != NULL && i < table->columns; i++)
        if (steps_behind_time(table->names[i]) != NULL) {
            *column = i;
            return true;
        }
    return false;
}

static enum modal_status no_memory(const struct table *table, struct modal_error *err)
{
    return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for names or units", table->path);
}

static enum modal_status read_table(char *text, struct table *table, struct modal_error *err)
{
    char *rest = text, *line, *remark;
    size_t number = 0;
    enum modal_status rc = MODAL_OK;

    if (strncmp(rest, "\xef\xbb\xbf", 3) == 0)
        rest += 3;
    line = read_head(table, &rest, &number);
    if (table->short_of_memory)
        return no_memory(table, err);
    if (line == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                "%s: no line of numbers; accepted: " SIGNALS_FILES, table->path);
    if (table->columns > SIGNALS_CHANNELS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "signals", "%s: %zu columns; at most %d",
                                table->path, table->columns, SIGNALS_CHANNELS_MOST);
    find_name(table, &table->watched);
    for (; line != NULL && rc == MODAL_OK; line = next_line(&rest, &number, &remark))
        rc = add_row(table, line, number, err);
    return rc;
}

/* What the digits of the column leave open of its step; not less than a binary number's own. */
static double step_off(const struct table *table, double dt)
{
    double unit = HUGE_VAL;

    for (size_t i = 0; i < TAIL && i < table->rows; i++)
        unit = fmin(unit, table->unit[i]);
    return fmax(unit / 2 / (double)(table->rows - 1), SIGNALS_DT_OFF * dt);
}

/* The column of time, or -1; what it says of the step. */
static enum modal_status find_time(const struct table *table, const struct signals_options *options,
                                   int *column, struct signals *out, struct modal_error *err)
{
    size_t at;
    bool named = find_name(table, &at);
    double dt, off = steps_deviation(table->x + at, table->rows, table->columns, &dt);
    char what[64];

    *column = named || (table->names == NULL && table->columns > 1 && off <= STEPS_UNEVEN_MOST)
                  ? (int)at : -1;
    if (*column < 0 || options->ignore_time)
        return MODAL_OK;
    const char *unit = named ? steps_unit(steps_behind_time(table->names[at])) : "";
    if (unit[0] == 0 && named && table->units != NULL)
        unit = steps_unit(table->units[at]);
    snprintf(what, sizeof what, "column %zu", at + 1);
    enum modal_status rc = steps_unit_check(unit, table->path, what, options, err);
    if (rc != MODAL_OK)
        return rc;
    if (!(off <= STEPS_UNEVEN_MOST))
        return steps_refuse(table->x + at, table->rows, table->columns, off, table->path, what,
                            options, err);
    out->dt = dt;
    out->dt_off = step_off(table, dt);
    out->dt_from = "its column of time";
    return MODAL_OK;
}

static char *same_unit(struct table *table, int time)
{
    char **units = table->units, *copy;
    const char *one = NULL;

    for (size_t i = 0; units != NULL && i < table->columns; i++) {
        if ((int)i == time || units[i] == NULL)
            continue;
        if (one != NULL && strcmp(one, units[i]) != 0)
            return NULL;
        one = units[i];
    }
    copy = one != NULL ? strdup(one) : NULL;
    table->short_of_memory |= one != NULL && copy == NULL;
    return copy;
}

/* Everything but the column of time into OUT; names move. */
static enum modal_status move_signals(struct table *table, int time, struct signals *out,
                                      struct modal_error *err)
{
    size_t channels = table->columns - (time >= 0), s = 0, to = 0;

    if (channels == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s: no channel beside time",
                                table->path);
    out->units = same_unit(table, time);
    if (table->names != NULL)
        out->names = calloc(channels, sizeof *out->names);
    if (table->short_of_memory || (table->names != NULL && out->names == NULL)) {
        free(out->units);
        free(out->names);
        out->units = NULL;
        out->names = NULL;
        return no_memory(table, err);
    }
    for (size_t i = 0; table->names != NULL && i < table->columns; i++)
        if ((int)i != time) {
            out->names[s++] = table->names[i];
            table->names[i] = NULL;
        }
    for (size_t k = 0; k < table->rows; k++)
        for (size_t i = 0; i < table->columns; i++)
            if ((int)i != time)
                table->x[to++] = table->x[k * table->columns + i];
    out->preamble = table->preamble;
    out->samples = table->rows;
    out->channels = channels;
    out->x = table->x;
    table->x = NULL;
    return MODAL_OK;
}

enum modal_status csv_read(char *text, const char *path, const struct signals_options *options,
                           struct signals *out, struct csv_shape *shape, struct modal_error *err)
{
    struct table table = { .path = path };
    int time = -1;
    enum modal_status rc = read_table(text, &table, err);

    if (rc == MODAL_OK)
        rc = find_time(&table, options, &time, out, err);
    if (rc == MODAL_OK && shape != NULL)
        *shape = (struct csv_shape) {
            .separator = table.separator, .columns = table.columns, .time = time,
            .before = time >= 0 ? table.x[(table.rows - 1) * table.columns + (size_t)time] : 0,
        };
    if (rc == MODAL_OK)
        rc = move_signals(&table, time, out, err);
    free_words(table.names, table.columns);
    free_words(table.units, table.columns);
    free(table.x);
    return rc;
}

enum modal_status csv_row(struct csv_shape *shape, char *line, const char *path, size_t number,
                          double dt, double *x, struct modal_error *err)
{
    struct table table = { .path = path, .separator = shape->separator,
                           .columns = shape->columns, .watched = (size_t)shape->time };
    double unit = 0, time, step;
    enum modal_status rc = read_row(&table, line, number, x, &unit, err);

    if (rc != MODAL_OK || shape->time < 0)
        return rc;
    time = x[shape->time];
    step = time - shape->before;
    if (dt > 0 && !(fabs(step - dt) <= 2 * STEPS_UNEVEN_MOST * dt + unit))
        return modal_fail_field(err, MODAL_BAD_INPUT, "time", "%s: line %zu: %.9g s after the row "
                                "before it; accepted: %.9g s, the stream's step; "
                                "--ignore-time takes the rows as even", path, number, step, dt);
    shape->before = time;
    memmove(x + shape->time, x + shape->time + 1,
            (shape->columns - 1 - (size_t)shape->time) * sizeof *x);
    return MODAL_OK;
}
