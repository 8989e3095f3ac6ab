/* csv.c - see csv.h
 *
 * Time t_k, k = 0 .. n-1, is taken as t_0 + k dt with dt = (t_{n-1} - t_0) / (n - 1); the deviation
 * is max_k |t_k - t_0 - k dt| / dt, in steps.  The file is refused where it passes CSV_UNEVEN_MOST:
 * a sample displaced by a part d of a step is wrong by about omega dt d of its amplitude.
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

enum { TAIL = 10 };              /* rows: one in ten ends in a digit that is not 0 */

struct table {
    const char *path;
    char separator;             /* ' ': any blanks */
    size_t columns, rows, room; /* room: doubles allocated */
    double *x;
    char **names, **units;      /* columns each, or NULL */
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

/* How many fields of LINE are numbers, and how many there are; LINE is left as it was. */
static size_t count_numbers(const char *line, char separator, size_t *fields)
{
    char *copy = strdup(line), *rest = copy, *field;
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

static char **split_words(char *line, char separator, size_t count)
{
    char **words = calloc(count, sizeof *words), *field;

    for (size_t i = 0; words != NULL && i < count && (field = next_field(&line, separator)) != NULL;
         i++)
        words[i] = utf8_from(field, strlen(field));
    return words;
}

static enum modal_status add_row(struct table *table, char *line, size_t number,
                                 struct modal_error *err)
{
    size_t column = 0, need = (table->rows + 1) * table->columns;
    char *field;

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
    while ((field = next_field(&line, table->separator)) != NULL) {
        char said[64];
        if (column == table->columns && *field == 0 && line == NULL)
            break;                                              /* a separator at the line's end */
        if (column == table->columns)
            return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                    "%s: line %zu has more than %zu columns", table->path, number,
                                    table->columns);
        snprintf(said, sizeof said, "%s", field);
        if (!read_number(field, table->separator, &table->x[table->rows * table->columns + column]))
            return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                    "%s: line %zu, column %zu: \"%.60s\" is not a number",
                                    table->path, number, column + 1, said);
        if (column == table->watched)
            table->unit[table->rows % TAIL] = last_digit(field);
        column++;
    }
    if (column != table->columns)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                "%s: line %zu has %zu columns, not %zu", table->path, number,
                                column, table->columns);
    table->rows++;
    return MODAL_OK;
}

/* Names may stand in a remark, as NumPy writes them: as many words as columns, none a number. */
static void read_remark(struct table *table, char *remark)
{
    size_t fields = 0;

    if (remark != NULL && count_numbers(remark, table->separator, &fields) == 0
        && fields == table->columns)
        table->names = split_words(remark, table->separator, table->columns);
}

/* Names, where the first line has no number at all; then units, where the second has none
 * either.  Gives the first line of numbers, NULL where there is none. */
static char *read_head(struct table *table, char **rest, size_t *number)
{
    char *remark = NULL, *line = next_line(rest, number, &remark);
    size_t fields = 0;

    if (line == NULL)
        return NULL;
    table->separator = separator_of(line);
    size_t numbers = count_numbers(line, table->separator, &table->columns);
    if (table->columns > 1 && table->separator != ' ' && line[strlen(line) - 1] == table->separator)
        table->columns--;                                       /* a separator at the line's end */
    if (numbers > 0) {
        read_remark(table, remark);
        return line;
    }
    table->names = split_words(line, table->separator, table->columns);
    line = next_line(rest, number, &remark);
    if (line != NULL && count_numbers(line, table->separator, &fields) == 0
        && fields == table->columns) {
        table->units = split_words(line, table->separator, table->columns);
        line = next_line(rest, number, &remark);
    }
    return line;
}

/* "t", "time", "Zeit", "Time [s]", "t_s", "time (sec)" */
static bool names_time(const char *name)
{
    static const char *const words[] = { "time", "zeit", "temps", "tiempo", "t" };

    for (size_t i = 0; name != NULL && i < sizeof words / sizeof *words; i++) {
        size_t n = strlen(words[i]);
        if (strncasecmp(name, words[i], n) == 0 && !isalnum((unsigned char)name[n]))
            return true;
    }
    return false;
}

/* The column that is called time; none: the first. */
static bool find_name(const struct table *table, size_t *column)
{
    *column = 0;
    for (size_t i = 0; table->names != NULL && i < table->columns; i++)
        if (names_time(table->names[i])) {
            *column = i;
            return true;
        }
    return false;
}

static enum modal_status read_table(char *text, struct table *table, struct modal_error *err)
{
    char *rest = text, *line, *remark;
    size_t number = 0;
    enum modal_status rc = MODAL_OK;

    if (strncmp(rest, "\xef\xbb\xbf", 3) == 0)
        rest += 3;
    line = read_head(table, &rest, &number);
    if (line == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                "%s: no line of numbers; accepted: HDF5, CSV, WAV, FLAC",
                                table->path);
    if (table->columns > SIGNALS_CHANNELS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "signals", "%s: %zu columns; at most %d",
                                table->path, table->columns, SIGNALS_CHANNELS_MOST);
    find_name(table, &table->watched);
    for (; line != NULL && rc == MODAL_OK; line = next_line(&rest, &number, &remark))
        rc = add_row(table, line, number, err);
    return rc;
}

/* The first row whose time is not after the one before, or 0. */
static size_t turns_back(const struct table *table, size_t column)
{
    const double *t = table->x + column;

    for (size_t k = 1; k < table->rows; k++)
        if (!(t[k * table->columns] > t[(k - 1) * table->columns]))
            return k;
    return 0;
}

static double deviation_of(const struct table *table, size_t column, double *dt)
{
    const double *t = table->x + column;
    size_t n = table->rows, c = table->columns;
    double most = 0;

    *dt = n < 2 ? 0 : (t[(n - 1) * c] - t[0]) / (double)(n - 1);
    for (size_t k = 0; k < n && *dt > 0; k++) {
        double off = fabs(t[k * c] - t[0] - (double)k * *dt) / *dt;
        if (!(off <= most))
            most = off;
    }
    return *dt > 0 ? most : HUGE_VAL;
}

static enum modal_status uneven(const struct table *table, const struct signals_options *options,
                                double off, struct modal_error *err)
{
    const char *field = options->dt > 0 ? "dt" : "time";
    const char *way = options->dt > 0 ? "--ignore-time takes the rows as even"
                                      : "or --dt SECONDS with --ignore-time";
    size_t column = table->watched, back = turns_back(table, column);

    if (back > 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s: column %zu is time, but it does "
                                "not grow at sample %zu; accepted: even steps forward; %s",
                                table->path, column + 1, back, way);
    return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s: column %zu is time, but its steps "
                            "are uneven: a sample is %.3g steps from its place, "
                            "accepted: %g; resample; %s", table->path, column + 1, off,
                            CSV_UNEVEN_MOST, way);
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
    double dt, off = deviation_of(table, at, &dt);

    *column = named || (table->names == NULL && table->columns > 1 && off <= CSV_UNEVEN_MOST)
                  ? (int)at : -1;
    if (*column < 0 || options->ignore_time)
        return MODAL_OK;
    if (!(off <= CSV_UNEVEN_MOST))
        return uneven(table, options, off, err);
    out->dt = dt;
    out->dt_off = step_off(table, dt);
    out->dt_from = "its column of time";
    return MODAL_OK;
}

static char *same_unit(char **units, size_t columns, int time)
{
    const char *one = NULL;

    for (size_t i = 0; units != NULL && i < columns; i++) {
        if ((int)i == time || units[i] == NULL)
            continue;
        if (one != NULL && strcmp(one, units[i]) != 0)
            return NULL;
        one = units[i];
    }
    return one ? strdup(one) : NULL;
}

/* Everything but the column of time into OUT; names move. */
static enum modal_status move_signals(struct table *table, int time, struct signals *out,
                                      struct modal_error *err)
{
    size_t channels = table->columns - (time >= 0), s = 0, to = 0;

    if (channels == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s: no channel beside time",
                                table->path);
    out->units = same_unit(table->units, table->columns, time);
    if (table->names != NULL) {
        out->names = calloc(channels, sizeof *out->names);
        for (size_t i = 0; out->names != NULL && i < table->columns; i++)
            if ((int)i != time) {
                out->names[s++] = table->names[i];
                table->names[i] = NULL;
            }
    }
    for (size_t k = 0; k < table->rows; k++)
        for (size_t i = 0; i < table->columns; i++)
            if ((int)i != time)
                table->x[to++] = table->x[k * table->columns + i];
    out->samples = table->rows;
    out->channels = channels;
    out->x = table->x;
    table->x = NULL;
    return MODAL_OK;
}

enum modal_status csv_read(char *text, const char *path, const struct signals_options *options,
                           struct signals *out, struct modal_error *err)
{
    struct table table = { .path = path };
    int time = -1;
    enum modal_status rc = read_table(text, &table, err);

    if (rc == MODAL_OK)
        rc = find_time(&table, options, &time, out, err);
    if (rc == MODAL_OK)
        rc = move_signals(&table, time, out, err);
    free_words(table.names, table.columns);
    free_words(table.units, table.columns);
    free(table.x);
    return rc;
}
