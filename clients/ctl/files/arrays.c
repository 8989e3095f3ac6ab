/* arrays.c - see arrays.h */
#include "arrays.h"
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/near.h"
#include "base/utf8.h"
#include "steps.h"

enum { NAMES_MOST = 64 };            /* of arrays that are compared with a name that is none */

/* ---- the list ---- */

struct array *arrays_add(struct arrays *arrays, const char *name, size_t length)
{
    struct array *one;

    if (arrays->count == ARRAYS_MOST)
        return NULL;
    if (arrays->count == arrays->room) {
        size_t room = 2 * arrays->room + 8;
        struct array *list = realloc(arrays->list, room * sizeof *list);
        if (list == NULL)
            return NULL;
        arrays->list = list;
        arrays->room = room;
    }
    one = &arrays->list[arrays->count];
    *one = (struct array) { .name = utf8_from(name, length), .type = "something else" };
    if (one->name == NULL)
        return NULL;
    arrays->count++;
    return one;
}

void arrays_done(struct arrays *arrays)
{
    for (size_t i = 0; i < arrays->count; i++)
        free(arrays->list[i].name);
    free(arrays->list);
    arrays->list = NULL;
    arrays->count = arrays->room = 0;
}

/* ---- names ---- */

static size_t folder_of(const char *name)
{
    const char *slash = strrchr(name, '/');

    return slash != NULL ? (size_t)(slash - name) + 1 : 0;
}

/* The unit that an array of times says by its name, `t_ms`; "": it is none of times, or says none.
 * A letter may be large in it: `T_h` is another quantity. */
static const char *unit_of_name(const struct array *array)
{
    const char *own = array->name + folder_of(array->name), *behind = steps_behind_time(own);

    return own[0] == 'T' && behind == own + 1 ? "" : steps_unit(behind);
}

/* What an array of this name says of the step; the last two by the unit in its name only, where it
 * may be something else: a temperature `t_s`. */
enum says { SAYS_NOTHING, SAYS_STEP, SAYS_RATE, SAYS_TIMES, SAYS_SECONDS, SAYS_OTHER_UNIT,
            SAYS_END };

static enum says says(const struct array *array)
{
    static const struct { const char *name; enum says says; } words[] = {
        { "dt", SAYS_STEP }, { "fs", SAYS_RATE }, { "Fs", SAYS_RATE },
        { "time", SAYS_TIMES }, { "Time", SAYS_TIMES }, { "t", SAYS_TIMES },
    };
    const char *own = array->name + folder_of(array->name);

    for (size_t i = 0; array->numbers && i < sizeof words / sizeof *words; i++)
        if (strcmp(own, words[i].name) == 0)
            return words[i].says;
    if (!array->numbers || unit_of_name(array)[0] == 0 || (array->rows != 1 && array->columns != 1))
        return SAYS_NOTHING;
    return strcmp(unit_of_name(array), "s") == 0 ? SAYS_SECONDS : SAYS_OTHER_UNIT;
}

/* ---- the signals ---- */

static bool may_be_signals(const struct array *array)
{
    return array->numbers && says(array) == SAYS_NOTHING
           && (array->rows > 1 || array->columns > 1);
}

/* "accel (4000 x 3), note (char)", as far as a message goes. */
static void print_list(const struct arrays *arrays, bool (*wanted)(const struct array *), char *to,
                       size_t room)
{
    size_t used = 0;

    to[0] = 0;
    for (size_t i = 0; i < arrays->count && used < room; i++) {
        const struct array *a = &arrays->list[i];
        if (wanted != NULL && !wanted(a))
            continue;
        used += (size_t)snprintf(to + used, room - used, "%s%.60s ", used > 0 ? ", " : "", a->name);
        if (used < room && a->numbers)
            used += (size_t)snprintf(to + used, room - used, "(%zu x %zu)", a->rows, a->columns);
        else if (used < room)
            used += (size_t)snprintf(to + used, room - used, "(%s)", a->type);
    }
    if (used >= room)
        snprintf(to + room - sizeof "...", sizeof "...", "...");
}

/* Names of arrays that may be meant by DATASET. */
static void suggest(const struct arrays *arrays, const char *dataset, char meant[NEAR_TEXT])
{
    const char *names[NAMES_MOST + 1];
    int count = 0;

    for (size_t i = 0; i < arrays->count && count < NAMES_MOST; i++)
        if (may_be_signals(&arrays->list[i]))
            names[count++] = arrays->list[i].name;
    names[count] = NULL;
    near_text(dataset, names, meant);
}

/* The array called DATASET, for which FIELD asked. */
static enum modal_status find_named(const struct arrays *arrays, const char *dataset,
                                    const char *field, const struct array **out,
                                    struct modal_error *err)
{
    char list[300], meant[NEAR_TEXT];

    dataset += dataset[0] == '/';
    for (size_t i = 0; i < arrays->count; i++)
        if (strcmp(arrays->list[i].name, dataset) == 0)
            *out = &arrays->list[i];
    if (*out != NULL && (*out)->numbers)
        return MODAL_OK;
    print_list(arrays, may_be_signals, list, sizeof list);
    suggest(arrays, dataset, meant);
    if (*out != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s: `%s` is %s; accepted: a "
                                "matrix of real numbers, samples x channels%s%s", arrays->path,
                                dataset, (*out)->type, list[0] ? ": " : "", list);
    return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s has no `%s`%s; accepted: %s",
                            arrays->path, dataset, meant, list[0] ? list : "nothing that is in it");
}

enum modal_status arrays_pick(const struct arrays *arrays, const char *dataset,
                              const struct array **out, struct modal_error *err)
{
    size_t found = 0;
    char list[300];

    *out = NULL;
    if (dataset != NULL)
        return find_named(arrays, dataset, "dataset", out, err);
    for (size_t i = 0; i < arrays->count; i++) {
        const struct array *a = &arrays->list[i];
        if (strcmp(a->name, "signals") == 0)
            return find_named(arrays, "signals", "signals", out, err);
        if (may_be_signals(a)) {
            found++;
            *out = a;
        }
    }
    if (found == 1)
        return MODAL_OK;
    print_list(arrays, found > 0 ? may_be_signals : NULL, list, sizeof list);
    if (found > 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "dataset", "%s: %zu arrays may be the "
                                "signals; accepted: --dataset with one of %s", arrays->path, found,
                                list);
    return modal_fail_field(err, MODAL_BAD_INPUT, "dataset", "%s: no array of numbers that could "
                            "be signals; it has %s; accepted: a matrix, samples x channels",
                            arrays->path, list[0] ? list : "nothing");
}

/* ---- the step ---- */

/* ARRAY as it lies, or TURNED, rows for columns. */
static enum modal_status load(const struct arrays *arrays, const struct array *array, bool turned,
                              double **out, struct modal_error *err)
{
    size_t lines = array->by_columns ? array->columns : array->rows;
    enum modal_status rc;

    *out = NULL;
    if (array->columns == 0 || array->rows == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s: `%s` is empty", arrays->path,
                                array->name);
    if (array->rows > SIGNALS_VALUES_MOST / array->columns)
        return modal_fail_field(err, MODAL_TOO_LARGE, "signals", "%s: `%s` has more than %zu "
                                "values", arrays->path, array->name, SIGNALS_VALUES_MOST);
    *out = malloc(array->rows * array->columns * sizeof **out);
    if (*out == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for %zu x %zu numbers",
                          arrays->path, array->rows, array->columns);
    struct numbers into = { .to = *out, .line = array->rows * array->columns, .lines = 1 };
    if (turned) {
        into.line /= lines;
        into.lines = lines;
    }
    rc = arrays->load(arrays, array, &into, err);
    if (rc != MODAL_OK) {
        free(*out);
        *out = NULL;
    }
    return rc;
}

/* Is A a vector of a time for each row or, TURNED then, each column of the signals? */
static bool fits(const struct array *a, const struct array *signals, bool *turned)
{
    size_t n = a->rows * a->columns;

    if (a->rows != 1 && a->columns != 1)
        return false;
    *turned = signals->rows == 1 || (n == signals->columns && n != signals->rows);
    return n == (*turned ? signals->columns : signals->rows);
}

/* `S/s`, samples a second, is read as s. */
static enum modal_status check_number_unit(const struct arrays *arrays, const struct array *a,
                                           struct modal_error *err)
{
    const char *wanted = says(a) == SAYS_RATE ? "Hz" : "s", *unit = a->unit != NULL ? a->unit : "";

    if (unit[0] == 0 || strcmp(unit, wanted) == 0 || strcmp(unit, "s") == 0)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, a->name, "%s: `%s` is in %s; accepted: in %s, or "
                            "--dt SECONDS with --ignore-time", arrays->path, a->name, unit, wanted);
}

static enum modal_status read_number(const struct arrays *arrays, const struct array *a,
                                     double *value, struct modal_error *err)
{
    double *x;
    enum modal_status rc = check_number_unit(arrays, a, err);

    if (rc != MODAL_OK)
        return rc;
    if (a->rows != 1 || a->columns != 1)
        return modal_fail_field(err, MODAL_BAD_INPUT, a->name, "%s: `%s` is %zu x %zu; accepted: "
                                "one number", arrays->path, a->name, a->rows, a->columns);
    rc = load(arrays, a, false, &x, err);
    if (rc != MODAL_OK)
        return rc;
    *value = x[0];
    free(x);
    if (*value > 0 && isfinite(*value) && isfinite(1 / *value))
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, a->name, "%s: `%s` is %g; accepted: a positive "
                            "number", arrays->path, a->name, *value);
}

/* The step of the times A of SIGNALS into ONE; nothing where these are no times after all. */
static enum modal_status step_of_times(const struct arrays *arrays, const struct array *a,
                                       const struct array *signals,
                                       const struct signals_options *options, struct signals *one,
                                       bool *turned, struct modal_error *err)
{
    bool plain = says(a) == SAYS_TIMES, turn, fit = fits(a, signals, &turn);
    const char *unit = !plain ? unit_of_name(a) : a->unit != NULL ? a->unit : "";
    size_t n = a->rows * a->columns;
    double *t;
    char what[48];
    enum modal_status rc;

    if (!fit && !plain)
        return MODAL_OK;
    if (!fit)
        return modal_fail_field(err, MODAL_BAD_INPUT, a->name, "%s: `%s` is %zu x %zu, the signals "
                                "`%s` are %zu x %zu; accepted: a time for each sample",
                                arrays->path, a->name, a->rows, a->columns, signals->name,
                                signals->rows, signals->columns);
    rc = load(arrays, a, false, &t, err);
    if (rc == MODAL_OK && (plain || steps_turn_back(t, n, 1) == 0)) {
        *turned = turn;
        snprintf(what, sizeof what, "`%.40s`", a->name);
        rc = steps_unit_check(unit, arrays->path, what, options, err);
        if (rc == MODAL_OK)
            rc = steps_read(t, n, a->single ? FLT_EPSILON : 0, arrays->path, "its array of times",
                            options, one, err);
    }
    free(t);
    return rc;
}

/* What A says of the step of SIGNALS into ONE. */
static enum modal_status step_of(const struct arrays *arrays, const struct array *a,
                                 const struct array *signals,
                                 const struct signals_options *options, struct signals *one,
                                 bool *turned, struct modal_error *err)
{
    bool rate = says(a) == SAYS_RATE;
    double value = 0;
    enum modal_status rc;

    if (!rate && says(a) != SAYS_STEP)
        return step_of_times(arrays, a, signals, options, one, turned, err);
    rc = read_number(arrays, a, &value, err);
    one->dt = rc != MODAL_OK ? 0 : rate ? 1 / value : value;
    one->dt_off = (a->single ? FLT_EPSILON : SIGNALS_DT_OFF) * one->dt;
    one->dt_from = rate ? "its sampling rate" : "its `dt`";
    return rc;
}

static enum modal_status twice(const struct arrays *arrays, const struct signals *a,
                               const struct signals *b, struct modal_error *err)
{
    return modal_fail_field(err, MODAL_BAD_INPUT, "dt", "%s: %s says steps of %.9g s, %s %.9g s; "
                            "accepted: one step; --dt SECONDS with --ignore-time says which",
                            arrays->path, a->dt_from, a->dt, b->dt_from, b->dt);
}

/* Does A stand in the folder of ARRAY, or at the top? */
static bool is_beside(const struct array *a, const struct array *array)
{
    size_t own = folder_of(a->name);

    return a != array && (own == 0 || (own == folder_of(array->name)
                                       && strncmp(a->name, array->name, own) == 0));
}

/* The step of ARRAY into OUT by those that say it in the ways FIRST to the one before END. */
static enum modal_status step_by(const struct arrays *arrays, const struct array *array,
                                 enum says first, enum says end,
                                 const struct signals_options *options, struct signals *out,
                                 bool *turned, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; rc == MODAL_OK && i < arrays->count; i++) {
        const struct array *a = &arrays->list[i];
        struct signals one = { 0 };

        if (!is_beside(a, array) || says(a) < first || says(a) >= end)
            continue;
        rc = step_of(arrays, a, array, options, &one, turned, err);
        if (rc != MODAL_OK || one.dt == 0)
            continue;
        if (out->dt > 0 && !(fabs(out->dt - one.dt) <= out->dt_off + one.dt_off))
            rc = twice(arrays, out, &one, err);
        else if (out->dt == 0 || one.dt_off < out->dt_off) {
            out->dt = one.dt;
            out->dt_off = one.dt_off;
            out->dt_from = one.dt_from;
        }
    }
    return rc;
}

enum modal_status arrays_step(const struct arrays *arrays, const struct array *array,
                              const struct signals_options *options, struct signals *out,
                              bool *turned, struct modal_error *err)
{
    static const enum says ways[] = { SAYS_STEP, SAYS_SECONDS, SAYS_OTHER_UNIT, SAYS_END };
    enum modal_status rc = MODAL_OK;

    *turned = array->rows == 1;
    for (int i = 0; rc == MODAL_OK && ways[i] != SAYS_END; i++)
        if (out->dt == 0 && !options->ignore_time)
            rc = step_by(arrays, array, ways[i], ways[i + 1], options, out, turned, err);
    return rc;
}

enum modal_status arrays_turn(double **x, size_t rows, size_t columns, struct modal_error *err)
{
    double *turned;

    if (rows == 1 || columns == 1)                 /* it lies the same */
        return MODAL_OK;
    turned = malloc(rows * columns * sizeof *turned);
    if (turned == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory to turn %zu x %zu numbers", rows,
                          columns);
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < columns; j++)
            turned[j * rows + i] = (*x)[i * columns + j];
    free(*x);
    *x = turned;
    return MODAL_OK;
}

enum modal_status arrays_read(const struct arrays *arrays, const struct signals_options *options,
                              struct signals *out, struct modal_error *err)
{
    const struct array *array;
    bool turned = false;
    enum modal_status rc = arrays_pick(arrays, options->dataset, &array, err);

    if (rc == MODAL_OK)
        rc = arrays_step(arrays, array, options, out, &turned, err);
    if (rc == MODAL_OK)
        rc = load(arrays, array, array->by_columns != turned, &out->x, err);
    if (rc != MODAL_OK)
        return rc;
    out->samples = turned ? array->columns : array->rows;
    out->channels = turned ? array->rows : array->columns;
    return MODAL_OK;
}
