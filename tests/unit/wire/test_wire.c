/* test_wire.c - frames and requests against proto/PROTOCOL.md: each limit from both sides, and the
 * vectors of proto/vectors */
/* Tests as well: error.c frame.c pushes.c request.c */
#include "check.h"
#include <dirent.h>
#include <stdlib.h>
#include "base/crc32c.h"
#include "wire/frame.h"
#include "wire/protocol.h"
#include "wire/request.h"

#ifndef PROTO_VECTORS
#define PROTO_VECTORS TEST_DATA "/../../proto/vectors"
#endif

static struct wire_frame frame(const char *text)
{
    return (struct wire_frame) { text, strlen(text) };
}

/* The status of a message of these frames; the request, where one comes out, into *OUT. */
static enum modal_status read_frames(const struct wire_frame *frames, int count,
                                     struct modal_error *err)
{
    struct wire_message m;
    struct wire_request r;
    enum modal_status rc = wire_open(frames, count, WIRE_VERSION, true, &m, err);

    if (rc == MODAL_OK)
        rc = wire_request_read(&m, &r, err);
    wire_close(&m);
    return rc;
}

static enum modal_status read_text(const char *verb, const char *header, struct modal_error *err)
{
    struct wire_frame frames[3] = { frame(WIRE_VERSION), frame(verb), frame(header) };

    return read_frames(frames, 3, err);
}

/* RFC 3720, B.4: 32 bytes of zeros 0x8a9136aa, of ones 0x62a8ab43, 0..31 0x46dd794e, 31..0
 * 0x113fdb5c. */
TEST(crc32c_gives_the_values_of_rfc_3720)
{
    unsigned char up[32], down[32], zeros[32] = { 0 }, ones[32];

    for (int i = 0; i < 32; i++)
        up[i] = (unsigned char)i, down[i] = (unsigned char)(31 - i), ones[i] = 0xff;
    CHECK(crc32c(0, zeros, 32) == 0x8a9136aau);
    CHECK(crc32c(0, ones, 32) == 0x62a8ab43u);
    CHECK(crc32c(0, up, 32) == 0x46dd794eu);
    CHECK(crc32c(0, down, 32) == 0x113fdb5cu);
    CHECK(crc32c(0, "123456789", 9) == 0xe3069283u);
    CHECK(crc32c(0, "", 0) == 0);
}

TEST(a_message_has_3_to_8_frames)
{
    struct wire_frame frames[9] = { frame(WIRE_VERSION), frame("UPLOAD"), frame("{\"id\":1}") };
    struct wire_message m;

    for (int i = 3; i < 9; i++)
        frames[i] = frame("x");
    for (int count = 0; count <= 9; count++) {
        enum modal_status rc = wire_open(frames, count, WIRE_VERSION, true, &m, NULL);
        CHECK(rc == (count == 0               ? MODAL_BAD_VERSION
                     : count < 3 || count > 8 ? MODAL_BAD_FRAME
                                              : MODAL_OK));
        CHECK(rc != MODAL_OK || m.body_count == count - 3);
        wire_close(&m);
    }
}

TEST(a_verb_has_1_to_16_bytes_of_A_to_Z)
{
    struct modal_error err;

    CHECK(read_text("ABCDEFGHIJKLMNOP", "{\"id\":1}", &err) == MODAL_UNKNOWN_VERB);
    CHECK(read_text("ABCDEFGHIJKLMNOPQ", "{\"id\":1}", &err) == MODAL_BAD_FRAME);
    CHECK(read_text("", "{\"id\":1}", &err) == MODAL_BAD_FRAME);
    CHECK(read_text("HELLo", "{\"id\":1}", &err) == MODAL_BAD_FRAME);
}

/* A header of exactly SIZE bytes: {"id":1,"client":"xxx"} padded by blanks. */
TEST(a_header_has_at_most_65536_bytes)
{
    char *text = malloc(WIRE_HEADER_MOST + 2);
    struct modal_error err;

    for (int over = 0; over <= 1; over++) {
        memset(text, ' ', WIRE_HEADER_MOST + 1);
        text[WIRE_HEADER_MOST + over] = 0;
        memcpy(text, "{\"id\":1}", 8);
        CHECK(read_text("HELLO", text, &err) == (over ? MODAL_BAD_FRAME : MODAL_OK));
    }
    free(text);
}

TEST(a_header_nests_at_most_32_deep)
{
    char text[200] = "{\"id\":1,\"options\":";
    struct modal_error err;

    for (int depth = 31; depth <= 32; depth++) {   /* the header itself is the first level */
        char *at = text + 18;
        memset(at, '[', (size_t)depth);
        memset(at + depth, ']', (size_t)depth);
        strcpy(at + 2 * depth, "}");
        CHECK(read_text("SUBMIT", text, &err) == (depth == 31 ? MODAL_BAD_INPUT : MODAL_BAD_FRAME));
    }
}

TEST(a_body_frame_has_at_most_1048576_bytes)
{
    char *data = calloc(1, WIRE_BODY_MOST + 1);
    struct wire_frame frames[4] = {
        frame(WIRE_VERSION), frame("UPLOAD"), frame("{\"id\":1}"), { data, WIRE_BODY_MOST }
    };
    struct wire_message m;

    CHECK(wire_open(frames, 4, WIRE_VERSION, true, &m, NULL) == MODAL_OK);
    wire_close(&m);
    frames[3].size++;
    CHECK(wire_open(frames, 4, WIRE_VERSION, true, &m, NULL) == MODAL_BAD_FRAME &&
          m.header == NULL);
    free(data);
}

TEST(a_failed_message_still_tells_verb_and_id_for_the_answer)
{
    struct wire_frame frames[4] = { frame(WIRE_VERSION),
                                    frame("STATUS"),
                                    frame("{\"id\":\"a\\\"b\"}"),
                                    { NULL, WIRE_BODY_MOST + 1 } };
    struct wire_message m;

    CHECK(wire_open(frames, 4, WIRE_VERSION, true, &m, NULL) == MODAL_BAD_FRAME);
    CHECK_STRING(m.verb, "STATUS");
    CHECK_STRING(m.id, "\"a\\\"b\"");
    CHECK(wire_open(frames, 2, WIRE_VERSION, true, &m, NULL) == MODAL_BAD_FRAME);
    CHECK_STRING(m.id, "null");
}

TEST(the_body_is_gathered_in_order_and_cut_to_the_room)
{
    struct wire_frame frames[5] = { frame(WIRE_VERSION), frame("SUBMIT"), frame("{\"id\":1}"),
                                    frame("abc"), frame("defg") };
    struct wire_message m;
    char out[8] = "";

    CHECK(wire_open(frames, 5, WIRE_VERSION, true, &m, NULL) == MODAL_OK);
    CHECK(wire_gather(&m, out, 5) == 5 && memcmp(out, "abcde", 5) == 0);
    CHECK(wire_gather(&m, out, 8) == 7 && memcmp(out, "abcdefg", 7) == 0);
    wire_close(&m);
}

TEST(an_error_survives_its_way_over_the_wire)
{
    struct modal_error err, back;
    char *text;
    cJSON *header;

    modal_fail_field(&err, MODAL_QUOTA, "a.b", "over \"%s\"", "x");
    text = wire_error_header("\"q\"", "SUBMIT", &err, NULL);
    CHECK_STRING(text, "{\"id\":\"q\",\"verb\":\"SUBMIT\",\"error\":{\"code\":\"quota\","
                       "\"message\":\"over \\\"x\\\"\",\"field\":\"a.b\"}}");
    header = cJSON_Parse(text);
    wire_error_read(cJSON_GetObjectItem(header, "error"), &back);
    CHECK(back.status == MODAL_QUOTA);
    CHECK_STRING(back.field, "a.b");
    CHECK_STRING(back.message, "over \"x\"");
    wire_error_read(NULL, &back);
    CHECK(back.status == MODAL_INTERNAL);
    cJSON_Delete(header);
    free(text);
}

TEST(every_verb_is_found_by_its_name_and_refuses_unknown_members)
{
    struct modal_error err;

    for (int v = 0; v < WIRE_VERB_COUNT; v++) {
        CHECK(wire_verb_find(wire_verb_name((enum wire_verb)v)) == v);
        CHECK(read_text(wire_verb_name((enum wire_verb)v), "{\"id\":1,\"zzz\":2}", &err) ==
              MODAL_BAD_INPUT);
        CHECK_STRING(err.field, "zzz");
    }
    CHECK(wire_verb_find("hello") == -1);
}

TEST(only_drain_and_undrain_need_an_admin_and_reading_needs_no_submitter)
{
    CHECK(wire_verb_role(WIRE_DRAIN) == WIRE_ROLE_ADMIN &&
          wire_verb_role(WIRE_UNDRAIN) == WIRE_ROLE_ADMIN);
    CHECK(wire_verb_role(WIRE_SUBMIT) == WIRE_ROLE_SUBMIT &&
          wire_verb_role(WIRE_CANCEL) == WIRE_ROLE_SUBMIT);
    CHECK(wire_verb_role(WIRE_LIST) == WIRE_ROLE_READ &&
          wire_verb_role(WIRE_EVENTS) == WIRE_ROLE_READ);
}

/* ---- vectors
 * -------------------------------------------------------------------------------------------------
 */

static char *read_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    char *text = calloc(1, 1 << 20);

    CHECK(file != NULL);
    CHECK(fread(text, 1, (1 << 20) - 1, file) > 0);
    fclose(file);
    return text;
}

/* A frame of a vector: {"text":…}, {"hex":…}, or {"repeat":text,"times":n}. */
static size_t make_frame(const cJSON *item, unsigned char **out)
{
    const cJSON *text = cJSON_GetObjectItem(item, "text"), *hex = cJSON_GetObjectItem(item, "hex"),
                *repeat = cJSON_GetObjectItem(item, "repeat");
    size_t size = text  ? strlen(text->valuestring)
                  : hex ? strlen(hex->valuestring) / 2
                        : strlen(repeat->valuestring) *
                              (size_t)cJSON_GetObjectItem(item, "times")->valuedouble;

    *out = malloc(size + 1);
    for (size_t i = 0; i < size; i++) {
        unsigned byte = 0;
        if (hex != NULL)
            sscanf(hex->valuestring + 2 * i, "%2x", &byte);
        (*out)[i] = text ? (unsigned char)text->valuestring[i] : hex ? (unsigned char)byte
                  : (unsigned char)repeat->valuestring[i % strlen(repeat->valuestring)];
    }
    return size;
}

static void replay(const cJSON *vector)
{
    const cJSON *item, *code = cJSON_GetObjectItem(vector, "code"),
                       *field = cJSON_GetObjectItem(vector, "field");
    struct wire_frame frames[16];
    unsigned char *data[16];
    struct modal_error err = { 0 };
    enum modal_status rc;
    int count = 0;

    cJSON_ArrayForEach(item, cJSON_GetObjectItem(vector, "frames")) {
        frames[count].size = make_frame(item, &data[count]);
        frames[count].data = data[count];
        count++;
    }
    rc = read_frames(frames, count, &err);
    if (strcmp(modal_status_code(rc), code->valuestring) != 0 ||
        (field != NULL && strcmp(err.field, field->valuestring) != 0))
        fail_msg("vector \"%s\": %s field \"%s\" (%s), not %s",
                 cJSON_GetObjectItem(vector, "name")->valuestring, modal_status_code(rc), err.field,
                 err.message, code->valuestring);
    while (count > 0)
        free(data[--count]);
}

TEST(every_request_vector_of_proto_gives_what_it_says)
{
    char *text = read_file(PROTO_VECTORS "/requests.json");
    cJSON *all = cJSON_Parse(text), *vector;
    int count = 0;

    CHECK(all != NULL);
    cJSON_ArrayForEach(vector, all) {
        replay(vector);
        count++;
    }
    CHECK(count >= 60);
    cJSON_Delete(all);
    free(text);
}

TEST(every_checksum_vector_of_proto_holds)
{
    char *text = read_file(PROTO_VECTORS "/crc32c.json");
    cJSON *all = cJSON_Parse(text), *vector;

    CHECK(all != NULL);
    cJSON_ArrayForEach(vector, all) {
        unsigned char *data;
        size_t size = make_frame(vector, &data);
        CHECK((double)crc32c(0, data, size) == cJSON_GetObjectItem(vector, "crc32c")->valuedouble);
        free(data);
    }
    cJSON_Delete(all);
    free(text);
}
