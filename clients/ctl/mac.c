/*
 * mac.c - modalctl mac A B: how alike the shapes of two identifications are
 *
 * The modal assurance criterion of shapes x of A and y of B, complex, over the same channels, is
 *
 *     MAC = |x^H y|^2 / ((x^H x) (y^H y)),                                                      (1)
 *
 * 1 where one is a multiple of the other, 0 where they are orthogonal.
 */
#include <complex.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "field.h"
#include "outcome.h"
#include "remote.h"
#include "signals.h"
#include "verbs.h"

enum {
    CELL = 10,                       /* letters of a column */
    RESULT_MOST = 1 << 28            /* bytes of a file: shapes of ten thousand channels */
};

/* One of the two: what it is called, its result and its modes. */
struct side {
    const char *name;
    cJSON *result;
    const cJSON *document, *modes;   /* in it */
    int channels;
};

/* NAME is a file where there is one, else a job. */
static enum modal_status fetch(const struct args *args, struct side *s, cJSON **detail,
                               struct modal_error *err)
{
    struct link *link = NULL;
    char *text = NULL;
    size_t length = 0;
    bool is_file = access(s->name, F_OK) == 0;
    enum modal_status rc = is_file ? signals_read_text(s->name, RESULT_MOST, &text, &length,
                                                       err)
                                   : remote_open(args, &link, err);

    if (rc == MODAL_OK && !is_file)
        rc = client_result(link, s->name, "document", remote_answer_by(remote_deadline(args)),
                           &text, &length, NULL, detail, err);
    if (rc == MODAL_OK)
        rc = json_read(text, length, &s->result, err);
    free(text);
    link_close(link);
    return rc;
}

static enum modal_status read_side(const struct args *args, struct side *s, cJSON **detail,
                                   struct modal_error *err)
{
    enum modal_status rc = fetch(args, s, detail, err);
    const cJSON *mode;

    if (rc != MODAL_OK)
        return rc;
    s->document = field_get(s->result, "result");             /* as `submit --wait` says it */
    s->document = s->document != NULL ? s->document : s->result;
    s->modes = field_get(s->document, "modes");
    if (strcmp(field_word(s->document, "kind", "-"), "identify") != 0 || !cJSON_IsArray(s->modes))
        return modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "%.100s is no result of "
                                "identify", s->name);
    s->channels = cJSON_GetArraySize(field_get(s->modes->child, "shape"));
    cJSON_ArrayForEach(mode, s->modes)
        if (s->channels == 0 || cJSON_GetArraySize(field_get(mode, "shape")) != s->channels)
            return modal_fail_field(err, MODAL_BAD_INPUT, "shapes", "%.100s holds no shapes; "
                                    "accepted: a result of identify -o shapes=true", s->name);
    return MODAL_OK;
}

static const char *channel(const struct side *s, int i)
{
    const cJSON *signals = field_get(field_get(s->document, "reconstruction"), "signals");

    return field_word(cJSON_GetArrayItem(signals, i), "name", "");
}

/* Channels are compared by their order; other names may be another numbering. */
static enum modal_status check_sides(const struct side s[2], struct modal_error *err)
{
    if (s[0].channels != s[1].channels && s[0].channels > 0 && s[1].channels > 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "%.100s has shapes of %d "
                                "channels, %.100s of %d; accepted: the same channels",
                                s[0].name, s[0].channels, s[1].name, s[1].channels);
    for (int i = 0; i < s[0].channels && i < s[1].channels; i++)
        if (strcmp(channel(&s[0], i), channel(&s[1], i)) != 0) {
            fprintf(stderr, "modalctl: channel %d is \"%s\" in %s and \"%s\" in %s: channels are "
                    "compared by their order\n", i, channel(&s[0], i), s[0].name,
                    channel(&s[1], i), s[1].name);
            break;
        }
    return MODAL_OK;
}

/* (1) */
static double mac_of(const cJSON *a, const cJSON *b)
{
    const cJSON *x = field_get(a, "shape")->child, *y = field_get(b, "shape")->child;
    double complex xy = 0;
    double xx = 0, yy = 0;

    for (; x != NULL && y != NULL; x = x->next, y = y->next) {
        double complex u = CMPLX(field_at(x, 0), field_at(x, 1)),
                       v = CMPLX(field_at(y, 0), field_at(y, 1));
        xy += conj(u) * v;
        xx += creal(conj(u) * u);
        yy += creal(conj(v) * v);
    }
    return creal(conj(xy) * xy) / (xx * yy);
}

static cJSON *frequencies(const struct side *s)
{
    cJSON *list = cJSON_CreateArray();
    const cJSON *mode;

    cJSON_ArrayForEach(mode, s->modes)
        cJSON_AddItemToArray(list, cJSON_CreateNumber(field_real(mode, "frequency_hz")));
    return list;
}

/* {"kind": "mac", "a": [Hz], "b": [Hz], "mac": a row a mode of A} */
static cJSON *print_matrix(const struct side s[2])
{
    cJSON *doc = cJSON_CreateObject(), *rows;
    const cJSON *a, *b;

    cJSON_AddStringToObject(doc, "kind", "mac");
    cJSON_AddItemToObject(doc, "a", frequencies(&s[0]));
    cJSON_AddItemToObject(doc, "b", frequencies(&s[1]));
    rows = cJSON_AddArrayToObject(doc, "mac");
    cJSON_ArrayForEach(a, s[0].modes) {
        cJSON *row = cJSON_CreateArray();
        cJSON_ArrayForEach(b, s[1].modes)
            cJSON_AddItemToArray(row, cJSON_CreateNumber(mac_of(a, b)));
        cJSON_AddItemToArray(rows, row);
    }
    return doc;
}

static void show_matrix(const cJSON *doc)
{
    const cJSON *a = field_get(doc, "a")->child, *row, *item;

    printf("%*s ", 2 * CELL, "Hz of A \\ of B");
    cJSON_ArrayForEach(item, field_get(doc, "b"))
        printf(" %*.6g", CELL, item->valuedouble);
    putchar('\n');
    cJSON_ArrayForEach(row, field_get(doc, "mac")) {
        printf("%*.8g ", 2 * CELL, a->valuedouble);
        cJSON_ArrayForEach(item, row)
            printf(" %*.4f", CELL, item->valuedouble);
        putchar('\n');
        a = a->next;
    }
}

int run_mac(const struct verb *verb, const struct args *args)
{
    struct side s[2] = { { .name = args->word[1] }, { .name = args->word[2] } };
    struct modal_error err = { 0 };
    cJSON *detail = NULL, *doc = NULL;
    enum modal_status rc = MODAL_OK;

    (void)verb;
    for (int i = 0; i < 2 && rc == MODAL_OK; i++)
        rc = read_side(args, &s[i], &detail, &err);
    if (rc == MODAL_OK)
        rc = check_sides(s, &err);
    if (rc == MODAL_OK) {
        doc = print_matrix(s);
        if (args->json)
            rc = outcome_json(doc, &err);
        else
            show_matrix(doc);
    }
    int status = rc == MODAL_OK ? 0 : outcome_failure(args->json, &err, detail);
    cJSON_Delete(doc);
    cJSON_Delete(detail);
    cJSON_Delete(s[0].result);
    cJSON_Delete(s[1].result);
    return status;
}
