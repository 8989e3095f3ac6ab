/* key_table.c - see key_table.h */
#include "base/key_table.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/near.h"

enum { ROWS_MOST = 64 };          /* of two tables together: twice the longest there is */
static const double
    /* json.h: a range from below this is told as that of positive numbers */
    LEAST = 1e-290,
    MOST = 1e290;                 /* and one to above this as without end */

enum modal_status key_table_check(const struct key_row *rows, const struct key_row *more,
                                  const cJSON *object, const char *base, struct modal_error *err)
{
    const char *names[ROWS_MOST + 1];
    int count = 0;

    for (; rows->name != NULL && count < ROWS_MOST; rows++)
        names[count++] = rows->name;
    for (; more != NULL && more->name != NULL && count < ROWS_MOST; more++)
        names[count++] = more->name;
    names[count] = NULL;
    return json_keys(object, base, names, err);
}

static int word_index(const char *const *words, const char *word)
{
    int i = 0;

    while (words[i] != NULL && strcmp(words[i], word) != 0)
        i++;
    return i;
}

void key_table_defaults(const struct key_row *rows, void *into)
{
    for (const struct key_row *r = rows; r->name != NULL; r++) {
        void *at = (char *)into + r->at;

        if (r->initial == NULL)
            continue;
        if (r->type == KEY_NUMBER)
            *(double *)at = strtod(r->initial, NULL);
        else if (r->type == KEY_WHOLE)
            *(int *)at = (int)strtol(r->initial, NULL, 10);
        else if (r->type == KEY_TRUTH)
            *(bool *)at = strcmp(r->initial, "true") == 0;
        else if (r->type == KEY_CHOICE)
            *(int *)at = word_index(r->words, r->initial);
    }
}

/* A word in place of an interval. */
static enum modal_status read_word(const struct key_row *r, const char *word, const char *path,
                                   double out[2], struct modal_error *err)
{
    int i = word_index(r->words, word);
    char near[NEAR_ACCEPTED];

    if (r->words[i] != NULL) {
        out[0] = -1 - i, out[1] = 0;
        return MODAL_OK;
    }
    near_accepted(word, r->words, near);
    return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s is \"%.40s\"%s, or two numbers, the "
                            "first below the second", path, word, near);
}

static enum modal_status read_interval(const struct key_row *r, const cJSON *object,
                                       const char *base, double out[2], struct modal_error *err)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, r->name);
    double *x = NULL;
    size_t count = 0;
    char path[128];
    enum modal_status rc;

    json_path(path, base, r->name);
    if (r->words != NULL && cJSON_IsString(item))
        return read_word(r, item->valuestring, path, out, err);
    rc = json_get_numbers(object, base, r->name, r->low, r->high, &x, &count, err);
    if (rc == MODAL_BAD_INPUT && err != NULL)
        /* the key; the message says which number of it */
        snprintf(err->field, sizeof err->field, "%s", path);
    if (rc == MODAL_OK && x != NULL && count != 2)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, path,
                              "%s has %zu numbers; accepted: two, the first below the second", path,
                              count);
    else if (rc == MODAL_OK && x != NULL && !(x[1] > x[0]))
        rc = modal_fail_field(
            err, MODAL_BAD_INPUT, path,
            "%s is [%.6g, %.6g]; accepted: two numbers, the first below the second", path, x[0],
            x[1]);
    if (rc == MODAL_OK && x != NULL)
        out[0] = x[0], out[1] = x[1];
    free(x);
    return rc;
}

static enum modal_status read_row(const struct key_row *r, const cJSON *object, const char *base,
                                  void *at, struct modal_error *err)
{
    switch (r->type) {
    case KEY_NUMBER:   return json_get_number(object, base, r->name, r->low, r->high, at, err);
    case KEY_WHOLE:
        return json_get_int(object, base, r->name, (int)r->low, (int)r->high, at, err);
    case KEY_TRUTH:    return json_get_bool(object, base, r->name, at, err);
    case KEY_CHOICE:   return json_get_choice(object, base, r->name, r->words, at, err);
    case KEY_TEXT:     return json_get_string(object, base, r->name, at, err);
    case KEY_INTERVAL: return read_interval(r, object, base, at, err);
    case KEY_OWN:      return MODAL_OK;
    }
    return MODAL_INTERNAL;
}

/* What would be accepted stands in the message; its unit and an instance of it here. */
static void add_example(const struct key_row *r, struct modal_error *err)
{
    size_t length = err != NULL ? strlen(err->message) : 0;

    if (length > 0 && r->type != KEY_TRUTH && r->type != KEY_CHOICE)
        snprintf(err->message + length, sizeof err->message - length, "%s%s, such as %s",
                 r->unit != NULL ? ", in " : "", r->unit != NULL ? r->unit : "", r->example);
}

enum modal_status key_table_read(const struct key_row *rows, const cJSON *object, const char *base,
                                 void *into, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    for (const struct key_row *r = rows; object != NULL && r->name != NULL && rc == MODAL_OK; r++) {
        rc = read_row(r, object, base, (char *)into + r->at, err);
        if (rc == MODAL_BAD_INPUT)
            add_example(r, err);
    }
    return rc;
}

enum modal_status key_table_options(const struct key_row *rows, const cJSON *options, void *into,
                                    struct modal_error *err)
{
    enum modal_status rc = options != NULL ? key_table_check(rows, NULL, options, "", err)
                                           : MODAL_OK;

    key_table_defaults(rows, into);
    return rc == MODAL_OK ? key_table_read(rows, options, "", into, err) : rc;
}

static cJSON *write_number(const struct key_row *r, double value)
{
    if ((r->shown == KEY_SHOWN_OR_NULL && !(value > 0)) || !isfinite(value))
        return cJSON_CreateNull();
    return cJSON_CreateNumber(value);
}

static cJSON *write_value(const struct key_row *r, const void *at)
{
    const double *x = at;
    const char *text;

    switch (r->type) {
    case KEY_NUMBER:   return write_number(r, *x);
    case KEY_WHOLE:    return write_number(r, *(const int *)at);
    case KEY_TRUTH:    return cJSON_CreateBool(*(const bool *)at);
    case KEY_CHOICE:   return cJSON_CreateString(r->words[*(const int *)at]);
    case KEY_TEXT:
        return (text = *(const char *const *)at) != NULL ? cJSON_CreateString(text)
                                                         : cJSON_CreateNull();
    case KEY_INTERVAL: return x[1] > 0 ? json_numbers(x, 2) : cJSON_CreateNull();
    case KEY_OWN:      break;
    }
    return NULL;
}

static bool is_set(const struct key_row *r, const void *at)
{
    return r->type == KEY_NUMBER ? *(const double *)at > 0
         : r->type == KEY_WHOLE ? *(const int *)at > 0
         : r->type != KEY_TEXT || *(const char *const *)at != NULL;
}

void key_table_write(const struct key_row *rows, const void *from, cJSON *out)
{
    for (const struct key_row *r = rows; r->name != NULL; r++) {
        const void *at = (const char *)from + r->at;
        cJSON *own = r->type == KEY_OWN ? cJSON_DetachItemFromObjectCaseSensitive(out, r->name)
                                        : NULL;

        if (own != NULL) /* to its place among the rows */
            cJSON_AddItemToObject(out, r->name, own);
        if (r->type != KEY_OWN && r->shown != KEY_SILENT
            && (r->shown != KEY_SHOWN_IF_SET || is_set(r, at)))
            cJSON_AddItemToObject(out, r->name, write_value(r, at));
    }
}

static void list_words(const char *const *words, char *out, size_t room)
{
    out[0] = '\0';
    for (int i = 0; words[i] != NULL; i++)
        snprintf(out + strlen(out), room - strlen(out), "%s%s", i > 0 ? "|" : "", words[i]);
}

void key_row_form(const struct key_row *row, char *out, size_t room)
{
    static const char *const forms[] = {
        [KEY_NUMBER] = "X",  [KEY_WHOLE] = "N",      [KEY_TRUTH] = "true|false",
        [KEY_TEXT] = "TEXT", [KEY_INTERVAL] = "A,B", [KEY_OWN] = "VALUE"
    };
    char words[128];

    if (row->form == NULL && row->type == KEY_CHOICE)
        list_words(row->words, words, sizeof words);
    else
        snprintf(words, sizeof words, "%s", row->form != NULL ? row->form : forms[row->type]);
    snprintf(out, room, "%s=%s", row->name, words);
}

/* "1 to 64", "0 or more"; nothing where every number will do. */
static void range_text(const struct key_row *r, char *out, size_t room)
{
    bool above = r->low > 0 && r->low < LEAST, open = r->high > MOST;

    out[0] = '\0';
    if ((r->type != KEY_NUMBER && r->type != KEY_WHOLE) || r->low < -MOST)
        return;
    if (above)
        snprintf(out, room, "above 0");
    else
        snprintf(out, room, open ? "%.10g or more" : "%.10g", r->low);
    if (!open)
        snprintf(out + strlen(out), room - strlen(out), "%s to %.10g", above ? "," : "", r->high);
}

void key_row_text(const struct key_row *row, char *out, size_t room)
{
    char range[64], words[160] = "";
    const char *list = range;

    range_text(row, range, sizeof range);
    if (row->type == KEY_CHOICE && row->form != NULL)
        list_words(row->words, words, sizeof words), list = words;
    snprintf(out, room, "%s%s%s", row->meaning, row->unit != NULL ? ", " : "",
             row->unit != NULL ? row->unit : "");
    if (list[0] != '\0' || row->initial != NULL)
        snprintf(out + strlen(out), room - strlen(out), " (%s%s%s%s)", list,
                 list[0] != '\0' && row->initial != NULL ? "; " : "",
                 row->initial != NULL ? "default " : "", row->initial != NULL ? row->initial : "");
}
