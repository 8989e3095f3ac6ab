/* test_scene_arrays.c - matrices behind a scene's text: what was put there is read, and nothing
 * else is */
#include "check.h"
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "modal/scene/lowering.h"
#include "modal/scene/scene.h"
#include "modal/scene/scene_arrays.h"

enum { ENTRIES = 4, BEFORE = 3 };    /* bytes ahead of the arrays: nothing lies aligned */

/* [2 -1; 0 3] with its 3 in two entries, as a matrix that stands BEFORE bytes behind the zero. */
struct sample {
    unsigned char bytes[BEFORE + 3 * sizeof(uint32_t) + ENTRIES * (sizeof(uint32_t)
                                                                   + sizeof(double))];
    uint32_t pointers[3], columns[ENTRIES];
    double values[ENTRIES];
};

static struct sample sample_of_two_rows(void)
{
    return (struct sample) { .pointers = { 0, 2, 4 }, .columns = { 1, 0, 1, 1 },
                             .values = { -1, 2, 1, 2 } };
}

/* What S's numbers are read as, with TEXT in the scene. */
static enum modal_status read_with(struct sample *s, const char *text, size_t length,
                                   struct triplet **out, int *count, struct modal_error *err)
{
    struct scene_arrays a = { s->bytes, length };
    cJSON *json = cJSON_Parse(text);
    unsigned char *at = s->bytes + BEFORE;
    int m, n;
    enum modal_status rc;

    memcpy(at, s->pointers, sizeof s->pointers);
    memcpy(at + sizeof s->pointers, s->columns, sizeof s->columns);
    memcpy(at + sizeof s->pointers + sizeof s->columns, s->values, sizeof s->values);
    assert_non_null(json);
    assert_true(scene_arrays_named(json));
    rc = scene_arrays_read(&a, json, "structure.K", out, count, &m, &n, err);
    if (rc == MODAL_OK)
        assert_true(m == 2 && n == 2);
    cJSON_Delete(json);
    return rc;
}

#define GOOD "{\"shape\":[2,2],\"entries\":4,\"offset\":3}"

TEST(arrays_at_any_address_are_the_entries_in_their_order)
{
    struct sample s = sample_of_two_rows();
    struct triplet *x = NULL;
    struct modal_error err = { 0 };
    int count = 0;

    CHECK(read_with(&s, GOOD, sizeof s.bytes, &x, &count, &err) == MODAL_OK && count == ENTRIES);
    CHECK(x[0].i == 0 && x[0].j == 1 && x[0].value == -1);
    CHECK(x[1].i == 0 && x[1].j == 0 && x[1].value == 2);
    CHECK(x[2].i == 1 && x[2].j == 1 && x[2].value == 1);
    CHECK(x[3].i == 1 && x[3].j == 1 && x[3].value == 2);
    free(x);
}

/* TEXT, of LENGTH bytes of S, is refused with STATUS and a message that has SAID. */
static void refused(struct sample s, const char *text, size_t length, enum modal_status status,
                    const char *said)
{
    struct triplet *x = NULL;
    struct modal_error err = { 0 };
    int count = 0;

    if (read_with(&s, text, length, &x, &count, &err) != status
        || strcmp(err.field, "structure.K") != 0 || strstr(err.message, said) == NULL)
        fail_msg("%s, %zu bytes: %s: %s", text, length, err.field, err.message);
    assert_null(x);
}

TEST(arrays_that_end_too_soon_or_begin_too_late_are_refused_with_what_there_is)
{
    struct sample s = sample_of_two_rows();
    size_t all = sizeof s.bytes;

    for (size_t length = 0; length < all; length++)
        refused(s, GOOD, length, MODAL_BAD_INPUT, "stand behind the scene's text");
    refused(s, "{\"shape\":[2,2],\"entries\":4,\"offset\":4}", all, MODAL_BAD_INPUT,
            "at offset 4 take 60 bytes; 63 bytes stand");
    refused(s, "{\"shape\":[2,2],\"entries\":4,\"offset\":9007199254740992}", all,
            MODAL_BAD_INPUT, "at offset 9007199254740992");
    refused(s, "{\"shape\":[1000000,1000000],\"entries\":100000000,\"offset\":3}", all,
            MODAL_BAD_INPUT, "take 1204000004 bytes");
}

TEST(numbers_in_the_text_that_are_no_sizes_are_refused)
{
    static const struct { const char *text; enum modal_status status; const char *said; } bad[] = {
        { "{\"shape\":[2,2.5],\"entries\":4,\"offset\":3}", MODAL_BAD_INPUT, "accepted" },
        { "{\"shape\":[2],\"entries\":4,\"offset\":3}", MODAL_BAD_INPUT, "accepted" },
        { "{\"entries\":4,\"offset\":3}", MODAL_BAD_INPUT, "accepted" },
        { "{\"shape\":[2,2],\"entries\":3.5,\"offset\":3}", MODAL_BAD_INPUT, "accepted" },
        { "{\"shape\":[2,2],\"entries\":4,\"offset\":0.5}", MODAL_BAD_INPUT, "accepted" },
        { "{\"shape\":[0,2],\"entries\":4,\"offset\":3}", MODAL_TOO_LARGE, "1 to 1000000" },
        { "{\"shape\":[2,1000001],\"entries\":4,\"offset\":3}", MODAL_TOO_LARGE, "1 to 1000000" },
        { "{\"shape\":[2,2],\"entries\":1e9,\"offset\":3}", MODAL_TOO_LARGE, "at most 100000000" },
    };
    struct sample s = sample_of_two_rows();

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        refused(s, bad[i].text, sizeof s.bytes, bad[i].status, bad[i].said);
}

TEST(rows_columns_and_values_that_make_no_matrix_are_refused_where_they_stand)
{
    struct sample s = sample_of_two_rows();
    size_t all = sizeof s.bytes;

    s.pointers[0] = 1;
    refused(s, GOOD, all, MODAL_BAD_INPUT, "row_pointers go from 1 to 4");
    s = sample_of_two_rows();
    s.pointers[2] = 3;
    refused(s, GOOD, all, MODAL_BAD_INPUT, "row_pointers go from 0 to 3");
    s = sample_of_two_rows();
    s.pointers[1] = 5;
    refused(s, GOOD, all, MODAL_BAD_INPUT, "row 0 has its entries from 0 to 5");
    s.pointers[1] = UINT32_MAX;
    refused(s, GOOD, all, MODAL_BAD_INPUT, "row 0 has its entries from 0 to 4294967295");
    s = sample_of_two_rows();
    s.columns[2] = 2;
    refused(s, GOOD, all, MODAL_BAD_INPUT, "row 1 has an entry in column 2; accepted: 0 to 1");
    s.columns[2] = UINT32_MAX;
    refused(s, GOOD, all, MODAL_BAD_INPUT, "in column 4294967295");
    s = sample_of_two_rows();
    s.values[3] = NAN;
    refused(s, GOOD, all, MODAL_BAD_INPUT, "entry (1, 1) is not finite");
    s.values[3] = -HUGE_VAL;
    refused(s, GOOD, all, MODAL_BAD_INPUT, "entry (1, 1) is not finite");
}

TEST(a_text_without_a_zero_byte_has_nothing_behind_it)
{
    struct scene_arrays a = { (const unsigned char *)"x", 1 };

    CHECK(scene_arrays_split("{}", 2, &a) == 2 && a.length == 0);
    CHECK(scene_arrays_split("{}\0", 3, &a) == 2 && a.length == 0);
    CHECK(scene_arrays_split("{}\0ab\0", 6, &a) == 2 && a.length == 3 && a.data[0] == 'a');
}

/* The hash of the scene of two dofs whose K is K, with ARRAYS. */
static void hash_of(const char *K, const struct scene_arrays *arrays, char hash[65])
{
    struct scene_options options = { .arrays = arrays };
    struct modal_error err = { 0 };
    struct program *p = NULL;
    cJSON *scene = cJSON_Parse("{\"structure\":{\"type\":\"matrices\",\"M\":[[1,0],[0,1]]}}");

    cJSON_AddItemToObject(cJSON_GetObjectItem(scene, "structure"), "K", cJSON_Parse(K));
    if (scene_lower(scene, &options, &p, &err) != MODAL_OK)
        fail_msg("%s: %s", err.field, err.message);
    memcpy(hash, p->hash, 65);
    program_free(p);
    cJSON_Delete(scene);
}

TEST(a_scene_is_the_same_program_by_lists_and_by_the_arrays_that_were_made)
{
    struct scene_arrays_made made = { 0 };
    struct scene_arrays behind;
    struct modal_error err = { 0 };
    cJSON *first = NULL, *second = NULL;
    char listed[65], placed[65], *text;

    CHECK(scene_arrays_add(&made, "K", 2, 1, (double[]) { 0, 1, 1 }, (double[]) { 0 },
                           (double[]) { 7 }, &first, &err) == MODAL_OK);
    CHECK(scene_arrays_add(&made, "K", 2, 3, (double[]) { 0, 2, 3 }, (double[]) { 1, 0, 1 },
                           (double[]) { -1, 2, 3 }, &second, &err) == MODAL_OK);
    CHECK(scene_arrays_split(made.data, made.length, &behind) == 0);
    text = cJSON_PrintUnformatted(second);
    hash_of("[[2,-1],[0,3]]", NULL, listed);
    hash_of(text, &behind, placed);
    assert_string_equal(listed, placed);
    hash_of("[[2,-1],[0,4]]", NULL, placed);
    assert_string_not_equal(listed, placed);
    CHECK(scene_arrays_add(&made, "K", 2, 1, (double[]) { 0, 1, 1 }, (double[]) { 0.5 },
                           (double[]) { 7 }, &first, &err) == MODAL_BAD_INPUT);
    assert_string_equal(err.field, "K");
    free(text);
    cJSON_Delete(first);
    cJSON_Delete(second);
    free(made.data);
}
