/*
 * matrix_market.c - see matrix_market.h
 *
 * A banner, comments, a line of sizes, then one line an entry: `i j value` counted from 1, or of an
 * array the value alone, column after column.  Of a symmetric matrix the lower triangle stands
 * there; of a skew one without its diagonal.
 *
 * CalculiX has no such head: lines `row column value`, of its symmetric matrices one of each pair,
 * with every diagonal entry, so that the largest row is not past the number of lines.
 *
 * [MM] Boisvert, Pozo, Remington, The Matrix Market exchange formats, NISTIR 5935, 1996.
 */
#include "matrix_market.h"
#include <ctype.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "modal/scene/lowering.h"
#include "signals.h"

enum {
    TEXT_MOST = 1 << 30               /* bytes: 20 million entries of 50 */
};

/* A file under way: where, and what its banner said. */
struct market {
    const char *path, *field, *at;
    long line;
    bool begun;                       /* the first line has been looked at */
    bool array;
    int turned;                       /* of (j, i) for (i, j): 1, -1 or 0 */
    int m, n;
    size_t count, room;
    struct market_entry { int i, j; double value; } *entry;
};

#define BAD_LINE(k, ...) \
    modal_fail_field(err, MODAL_BAD_INPUT, (k)->field, __VA_ARGS__)

/* The next line that is not blank or a comment, at its first word; false at the end. */
static bool next_line(struct market *k)
{
    while (k->at != NULL && *k->at != '\0') {
        const char *end = strchr(k->at, '\n');

        if (k->begun) {
            k->at = end != NULL ? end + 1 : k->at + strlen(k->at);
            k->line++;
        }
        k->begun = true;
        while (*k->at == ' ' || *k->at == '\t' || *k->at == '\r')
            k->at++;
        if (*k->at != '\0' && *k->at != '%' && *k->at != '\n')
            return true;
    }
    return false;
}

/* A number of the line under way; false: there is none. */
static bool next_number(struct market *k, double *x)
{
    char *end;

    while (*k->at == ' ' || *k->at == '\t')
        k->at++;
    if (*k->at == '\0' || isspace((unsigned char)*k->at))
        return false;
    *x = strtod(k->at, &end);
    if (end == k->at || (*end != '\0' && !isspace((unsigned char)*end)))
        return false;
    k->at = end;
    return true;
}

/* What the first line says. */
static enum modal_status read_banner(struct market *k, struct modal_error *err)
{
    enum { FORMS = 3 };    /* of symmetry */
    static const char *const forms[FORMS] = { "general", "symmetric", "skew-symmetric" };
    char form[24] = "", numbers[24] = "", symmetry[24] = "";
    int which = 0;

    if (sscanf(k->at, "%%%%MatrixMarket matrix %23s %23s %23s", form, numbers, symmetry) != 3)
        return BAD_LINE(k, "%.300s: no Matrix Market file: its first line is not "
                        "\"%%%%MatrixMarket matrix ...\"", k->path);
    while (which < FORMS && strcasecmp(symmetry, forms[which]) != 0)
        which++;
    k->array = strcasecmp(form, "array") == 0;
    if (which == FORMS || (!k->array && strcasecmp(form, "coordinate") != 0)
        || (strcasecmp(numbers, "real") != 0 && strcasecmp(numbers, "integer") != 0))
        return BAD_LINE(k, "%.300s: %s %s %s; accepted: coordinate or array, real or integer, "
                        "general, symmetric or skew-symmetric", k->path, form, numbers, symmetry);
    k->turned = which == 0 ? 0 : which == 1 ? 1 : -1;
    return MODAL_OK;
}

/* Rows, columns and, but for an array, entries. */
static enum modal_status read_sizes(struct market *k, struct modal_error *err)
{
    double m = 0, n = 0, count = 0;

    if (!next_line(k) || !next_number(k, &m) || !next_number(k, &n)
        || (!k->array && !next_number(k, &count)))
        return BAD_LINE(k, "%.300s, line %ld: sizes are wanted", k->path, k->line);
    if (k->array)
        count = k->turned != 0 ? n * (n + 1) / 2 - (k->turned < 0 ? n : 0) : m * n;
    if (!(m >= 1 && m <= LOWERING_DOFS_MOST) || m != n || m != floor(m) || !(count >= 0)
        || count != floor(count) || count > LOWERING_ENTRIES_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, k->field,
                                "%.300s is %g x %g with %g entries; accepted: square, of 1 to %d "
                                "rows and at most %d entries", k->path, m, n, count,
                                LOWERING_DOFS_MOST, LOWERING_ENTRIES_MOST);
    k->m = k->n = (int)m;
    k->room = (size_t)count;
    k->entry = malloc((2 * k->room + 1) * sizeof *k->entry);
    return k->entry != NULL ? MODAL_OK
                            : modal_fail(err, MODAL_NO_MEMORY, "no memory for %.300s", k->path);
}

/* Of CalculiX's lines: how many there are, the largest row, and whether they are one triangle. */
static enum modal_status count_lines(struct market *k, struct modal_error *err)
{
    struct market at = *k;
    double i, j, value, n = 0;
    bool lower = false, upper = false;

    while (next_line(&at)) {
        if (!next_number(&at, &i) || !next_number(&at, &j) || !next_number(&at, &value)
            || !(fmin(i, j) >= 1))
            return BAD_LINE(k, "%.300s, line %ld: \"row column value\" is wanted", k->path,
                            at.line);
        n = fmax(n, fmax(i, j));
        lower |= i > j;
        upper |= j > i;
        k->room++;
    }
    if (n > (double)k->room)
        return BAD_LINE(k, "%.300s: row %g in %zu lines; it is cut short, or no matrix of CalculiX",
                        k->path, n, k->room);
    if (n < 1 || n > LOWERING_DOFS_MOST || k->room > LOWERING_ENTRIES_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, k->field, "%.300s has %g rows and %zu "
                                "entries; accepted: 1 to %d rows and at most %d entries", k->path,
                                n, k->room, LOWERING_DOFS_MOST, LOWERING_ENTRIES_MOST);
    k->m = k->n = (int)n;
    k->turned = !(lower && upper);
    k->entry = malloc((2 * k->room + 1) * sizeof *k->entry);
    return k->entry != NULL ? MODAL_OK
                            : modal_fail(err, MODAL_NO_MEMORY, "no memory for %.300s", k->path);
}

static bool of_calculix(const char *path)
{
    const char *dot = strrchr(path, '.');

    return dot != NULL && (strcmp(dot, ".sti") == 0 || strcmp(dot, ".mas") == 0);
}

/* The entries, both triangles. */
static enum modal_status read_entries(struct market *k, struct modal_error *err)
{
    int row = k->turned < 0, column = 0;           /* of an array: the next place */

    for (size_t e = 0; e < k->room; e++) {
        double i = row + 1, j = column + 1, value;

        if (!next_line(k) || (!k->array && (!next_number(k, &i) || !next_number(k, &j)))
            || !next_number(k, &value) || !isfinite(value))
            return BAD_LINE(k, "%.300s, line %ld: %s is wanted", k->path, k->line,
                            k->array ? "a number" : "\"row column value\"");
        if (!(i >= 1 && i <= k->m && j >= 1 && j <= k->n) || i != floor(i) || j != floor(j))
            return BAD_LINE(k, "%.300s, line %ld: (%g, %g) is outside of %d x %d", k->path,
                            k->line, i, j, k->m, k->n);
        k->entry[k->count++] = (struct market_entry) { (int)i - 1, (int)j - 1, value };
        if (k->turned != 0 && i != j)
            k->entry[k->count++] =
                (struct market_entry) { (int)j - 1, (int)i - 1, k->turned * value };
        if (k->array && ++row == k->m) {
            column++;
            row = k->turned == 0 ? 0 : column + (k->turned < 0);
        }
    }
    return next_line(k) ? BAD_LINE(k, "%.300s, line %ld: more entries than its sizes say", k->path,
                                   k->line)
                        : MODAL_OK;
}

/* By rows: counted, then put. */
static enum modal_status compress(const struct market *k, struct scene_arrays_made *arrays,
                                  cJSON **out, struct modal_error *err)
{
    size_t rows = (size_t)k->m;
    double *pointer = calloc(rows + 2, sizeof *pointer),
           *column = malloc((k->count + 1) * sizeof *column),
           *value = malloc((k->count + 1) * sizeof *value);
    enum modal_status rc = MODAL_OK;

    if (pointer == NULL || column == NULL || value == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "no memory for %.300s", k->path);
    for (size_t e = 0; rc == MODAL_OK && e < k->count; e++)
        pointer[k->entry[e].i + 2]++;
    for (size_t i = 2; rc == MODAL_OK && i <= rows; i++)
        pointer[i] += pointer[i - 1];
    for (size_t e = 0; rc == MODAL_OK && e < k->count; e++) {
        size_t at = (size_t)pointer[k->entry[e].i + 1]++;     /* ends where the next row begins */

        column[at] = k->entry[e].j;
        value[at] = k->entry[e].value;
    }
    if (rc == MODAL_OK)
        rc = scene_arrays_add(arrays, k->field, rows, k->count, pointer, column, value, out, err);
    free(pointer);
    free(column);
    free(value);
    return rc;
}

enum modal_status matrix_market_read(const char *path, const char *field,
                                     struct scene_arrays_made *arrays, cJSON **out,
                                     struct modal_error *err)
{
    struct market k = { .path = path, .field = field, .line = 1 };
    char *text = NULL;
    size_t length = 0;
    enum modal_status rc = signals_read_text(path, TEXT_MOST, &text, &length, err);

    k.at = text;
    k.begun = !of_calculix(path);
    if (rc == MODAL_OK && !k.begun)
        rc = count_lines(&k, err);
    else if (rc == MODAL_OK && (rc = read_banner(&k, err)) == MODAL_OK)
        rc = read_sizes(&k, err);
    if (rc == MODAL_OK)
        rc = read_entries(&k, err);
    if (rc == MODAL_OK)
        rc = compress(&k, arrays, out, err);
    free(k.entry);
    free(text);
    return rc;
}
