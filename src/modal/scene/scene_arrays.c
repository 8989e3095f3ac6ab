/* scene_arrays.c - see scene_arrays.h; tested by tests/unit/modal/scene/test_scene_arrays.c
 *
 * The arrays come from anybody and lie at any address: every number is copied out before it is
 * looked at, and sizes are compared in 64 bits, in which those of the limits cannot overflow.
 */
#include "modal/scene/scene_arrays.h"
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/lowering.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers are read as they lie");

/* Bytes of an index and of a value. */
enum { INDEX = sizeof(uint32_t), VALUE = sizeof(double) };

/* A matrix as its text says it is. */
struct place { size_t rows, columns, entries, offset; };

#define BAD_ARRAYS(...) modal_fail_field(err, MODAL_BAD_INPUT, where, __VA_ARGS__)

size_t scene_arrays_split(const void *input, size_t length, struct scene_arrays *out)
{
    const unsigned char *zero = memchr(input, 0, length);

    *out = (struct scene_arrays) { 0 };
    if (zero == NULL)
        return length;
    size_t text = (size_t)(zero - (const unsigned char *)input);
    *out = (struct scene_arrays) { zero + 1, length - text - 1 };
    return text;
}

bool scene_arrays_named(const cJSON *json)
{
    return cJSON_IsObject(json)
           && (json_member(json, "offset") != NULL || json_member(json, "entries") != NULL);
}

static uint32_t index_at(const unsigned char *from, size_t i)
{
    uint32_t x;

    memcpy(&x, from + i * INDEX, sizeof x);
    return x;
}

/* Shape, entries and offset: whole, and within the limits. */
static enum modal_status read_place(const cJSON *json, const char *where, struct place *out,
                                    struct modal_error *err)
{
    static const char *const keys[] = { "shape", "entries", "offset", NULL };
    double *shape = NULL, entries = 0, offset = 0;
    size_t count = 0;
    enum modal_status rc = json_keys(json, where, keys, err);

    if (rc == MODAL_OK)
        rc = json_get_numbers(json, where, "shape", 0, HUGE_VAL, &shape, &count, err);
    if (rc == MODAL_OK)
        rc = json_need_number(json, where, "entries", 0, HUGE_VAL, &entries, err);
    if (rc == MODAL_OK)
        rc = json_need_number(json, where, "offset", 0, (double)(INT64_C(1) << 53), &offset, err);
    if (rc == MODAL_OK && (count != 2 || shape[0] != floor(shape[0]) || shape[1] != floor(shape[1])
                           || entries != floor(entries) || offset != floor(offset)))
        rc = BAD_ARRAYS("%s: accepted: \"shape\": [rows, columns], and whole numbers as "
                        "\"entries\" and \"offset\"", where);
    if (rc == MODAL_OK && (!(shape[0] >= 1 && shape[0] <= LOWERING_DOFS_MOST && shape[1] >= 1
                             && shape[1] <= LOWERING_DOFS_MOST)
                           || entries > LOWERING_ENTRIES_MOST))
        rc = modal_fail_field(err, MODAL_TOO_LARGE, where, "%s is %g x %g with %g entries; "
                              "accepted: 1 to %d rows and columns, and at most %d entries", where,
                              shape[0], shape[1], entries, LOWERING_DOFS_MOST,
                              LOWERING_ENTRIES_MOST);
    if (rc == MODAL_OK)
        *out = (struct place) { (size_t)shape[0], (size_t)shape[1], (size_t)entries,
                                (size_t)offset };
    free(shape);
    return rc;
}

/* Where its arrays begin, all of which are there. */
static enum modal_status find_arrays(const struct scene_arrays *a, const struct place *p,
                                     const char *where, const unsigned char **out,
                                     struct modal_error *err)
{
    size_t length = a != NULL ? a->length : 0,
           need = INDEX * (p->rows + 1) + (INDEX + VALUE) * p->entries;

    if (p->offset > length || need > length - p->offset)
        return BAD_ARRAYS("%s: %zu rows of %zu entries at offset %zu take %zu bytes; %zu bytes "
                          "stand behind the scene's text", where, p->rows, p->entries, p->offset,
                          need, length);
    *out = a->data + p->offset;
    return MODAL_OK;
}

/* Row I from its place, into X. */
static enum modal_status read_row(const unsigned char *from, const struct place *p, size_t i,
                                  const char *where, struct triplet *x, struct modal_error *err)
{
    const unsigned char *columns = from + INDEX * (p->rows + 1),
                        *values = columns + INDEX * p->entries;
    size_t first = index_at(from, i), end = index_at(from, i + 1);

    if (end < first || end > p->entries)
        return BAD_ARRAYS("%s: row %zu has its entries from %zu to %zu; accepted: row_pointers "
                          "that do not descend, from 0 to %zu", where, i, first, end, p->entries);
    for (size_t k = first; k < end; k++) {
        size_t j = index_at(columns, k);
        double value;

        memcpy(&value, values + k * VALUE, sizeof value);
        if (j >= p->columns)
            return BAD_ARRAYS("%s: row %zu has an entry in column %zu; accepted: 0 to %zu", where,
                              i, j, p->columns - 1);
        if (!isfinite(value))
            return BAD_ARRAYS("%s: entry (%zu, %zu) is not finite", where, i, j);
        x[k] = (struct triplet) { (int)i, (int)j, value };
    }
    return MODAL_OK;
}

enum modal_status scene_arrays_read(const struct scene_arrays *a, const cJSON *json,
                                    const char *where, struct triplet **out, int *count, int *m,
                                    int *n, struct modal_error *err)
{
    const unsigned char *from = NULL;
    struct triplet *x = NULL;
    struct place p;
    enum modal_status rc = read_place(json, where, &p, err);

    if (rc == MODAL_OK)
        rc = find_arrays(a, &p, where, &from, err);
    if (rc == MODAL_OK && (index_at(from, 0) != 0 || index_at(from, p.rows) != p.entries))
        rc = BAD_ARRAYS("%s: row_pointers go from %u to %u; accepted: from 0 to %zu, its entries",
                        where, index_at(from, 0), index_at(from, p.rows), p.entries);
    if (rc == MODAL_OK && (x = malloc((p.entries + 1) * sizeof *x)) == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "scene: no memory for %zu entries", p.entries);
    for (size_t i = 0; rc == MODAL_OK && i < p.rows; i++)
        rc = read_row(from, &p, i, where, x, err);
    if (rc != MODAL_OK) {
        free(x);
        return rc;
    }
    *out = x;
    *count = (int)p.entries;        /* both below the limits of lowering.h */
    *m = (int)p.rows;
    *n = (int)p.columns;
    return MODAL_OK;
}

/* COUNT indices to AT; false: one is no whole number of 32 bits. */
static bool put_indices(unsigned char *at, const double *x, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        uint32_t index;

        if (!(x[i] >= 0 && x[i] <= UINT32_MAX) || x[i] != floor(x[i]))
            return false;
        index = (uint32_t)x[i];
        memcpy(at + i * INDEX, &index, sizeof index);
    }
    return true;
}

enum modal_status scene_arrays_add(struct scene_arrays_made *to, const char *where, size_t n,
                                   size_t count, const double *pointers, const double *columns,
                                   const double *values, cJSON **out, struct modal_error *err)
{
    size_t begin = to->length > 0 ? to->length : 1,           /* behind the zero byte */
           rows = INDEX * (n + 1), bytes = rows + (INDEX + VALUE) * count;
    unsigned char *data = realloc(to->data, begin + bytes);

    if (data == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for a matrix of %zu entries", count);
    to->data = data;
    data[0] = 0;
    if (!put_indices(data + begin, pointers, n + 1)
        || !put_indices(data + begin + rows, columns, count))
        return BAD_ARRAYS("%s: accepted: whole numbers from 0 as row pointers and columns", where);
    if (count > 0)
        memcpy(data + begin + rows + INDEX * count, values, VALUE * count);
    to->length = begin + bytes;
    *out = cJSON_CreateObject();
    cJSON_AddItemToObject(*out, "shape", json_numbers((double[]) { (double)n, (double)n }, 2));
    cJSON_AddNumberToObject(*out, "entries", (double)count);
    cJSON_AddNumberToObject(*out, "offset", (double)(begin - 1));
    return MODAL_OK;
}
