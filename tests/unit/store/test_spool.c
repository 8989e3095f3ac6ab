/* test_spool.c - uploads: written in chunks, resumed, sealed, mapped; every limit and every kind of
 * damage */
/* Tests as well: batch_h5.c file_h5.c mapping.c */
#include "check.h"
#include <dirent.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>
#include "store/batch_file.h"
#include "base/crc32c.h"
#include "store/file.h"
#include "store/ledger.h"
#include "store/spool.h"

enum { SAMPLES = 20000, CHANNELS = 3, BYTES = SAMPLES * CHANNELS * 8, CHUNK = 65536 };

static char dir[64];
static double x[SAMPLES * CHANNELS];
static const char *const names[CHANNELS] = { "root", "mid", "tip" };
static const struct input_shape shape = { .type = INPUT_BATCH,
                                          .samples = SAMPLES,
                                          .channels = CHANNELS,
                                          .dt = 0.0125,
                                          .period = 2.5,
                                          .units = "m",
                                          .names = names,
                                          .attributes = "{\"rig\":7,\"who\":\"ada\"}" };

static void start(void)
{
    char path[96];

    snprintf(dir, sizeof dir, "/tmp/modald-test-XXXXXX");
    CHECK(mkdtemp(dir) != NULL);
    snprintf(path, sizeof path, "%s/spool", dir);
    CHECK(file_make_dir(path, 0750, NULL) == MODAL_OK);
    snprintf(path, sizeof path, "%s/results", dir);
    CHECK(file_make_dir(path, 0750, NULL) == MODAL_OK);
    for (int i = 0; i < SAMPLES * CHANNELS; i++)
        x[i] = sin(i * 0.0123) * (i + 1);
}

static void stop(void)
{
    char command[96];

    snprintf(command, sizeof command, "rm -r %s", dir);
    CHECK(system(command) == 0);
}

static enum modal_status put(struct upload *upload, uint64_t at, const void *data, size_t length)
{
    struct upload_part part = { data, length, crc32c(0, data, length) };
    enum modal_status rc = upload_write(upload, at, &part, 1, NULL);

    if (rc == MODAL_OK)
        upload_hash(upload, &part, 1);
    return rc;
}

/* Write from upload_received to END in chunks, their records to CHUNKS; how many. */
static size_t feed(struct upload *upload, uint64_t end, struct chunk_record *chunks)
{
    size_t count = 0;

    for (uint64_t at = upload_received(upload); at < end; count++) {
        size_t length = end - at < CHUNK ? (size_t)(end - at) : CHUNK;
        CHECK(put(upload, at, (const char *)x + at, length) == MODAL_OK);
        if (chunks != NULL)
            chunks[count] =
                (struct chunk_record) { at, length, crc32c(0, (const char *)x + at, length) };
        at += length;
        CHECK(upload_received(upload) == at);
    }
    CHECK(upload_sync(upload, NULL) == MODAL_OK);
    return count;
}

static void check_sealed(int64_t id, uint64_t offset, uint32_t crc, const uint8_t digest[32])
{
    uint8_t expected[32];
    struct batch_file file;
    struct mapping map;
    char path[4096];
    int fd;

    identity_of(&shape, x, BYTES, expected);
    CHECK(memcmp(digest, expected, 32) == 0);
    CHECK(crc == crc32c(0, x, BYTES));
    spool_path(path, dir, id);
    fd = open(path, O_RDONLY);
    CHECK(spool_map_open(fd, path, offset, BYTES, crc, &map, NULL) == MODAL_OK);
    close(fd);
    CHECK(memcmp(map.data, x, BYTES) == 0 && (uintptr_t)map.data % 8 == 0);
    mapping_close(&map);
    /* any tool can open it */
    CHECK(batch_file_read(path, "signals", 0, &file, NULL) == MODAL_OK);
    CHECK(file.batch.samples == SAMPLES && file.batch.channels == CHANNELS &&
          file.batch.dt == 0.0125 && file.batch.period == 2.5);
    CHECK(memcmp(file.signals, x, BYTES) == 0);
    CHECK_STRING(file.batch.names[2], "tip");
    CHECK(cJSON_GetObjectItem(file.attributes, "rig")->valuedouble == 7);
    batch_file_done(&file);
}

TEST(an_upload_in_chunks_becomes_a_file_that_workers_map_and_tools_open)
{
    struct upload *upload;
    uint8_t digest[32];

    start();
    CHECK(upload_begin(dir, 4, &shape, &upload, NULL) == MODAL_OK);
    feed(upload, BYTES, NULL);
    CHECK(upload_seal(upload, digest, NULL) == MODAL_OK);
    check_sealed(4, upload_offset(upload), upload_crc(upload), digest);
    CHECK(upload_seal(upload, digest, NULL) == MODAL_BAD_FRAME);
    upload_close(upload);
    stop();
}

TEST(an_upload_is_resumed_where_it_was_and_gives_the_same_identity)
{
    for (int cut = 0; cut <= 8; cut++) {
        struct chunk_record chunks[16];
        struct upload *upload;
        uint8_t digest[32];
        size_t count;
        start();
        CHECK(upload_begin(dir, 4, &shape, &upload, NULL) == MODAL_OK);
        count = feed(upload, (uint64_t)cut * BYTES / 8, chunks);
        upload_close(upload);
        CHECK(upload_resume(dir, 4, &shape, chunks, count, &upload, NULL) == MODAL_OK);
        CHECK(upload_received(upload) == (uint64_t)cut * BYTES / 8);
        feed(upload, BYTES, NULL);
        CHECK(upload_seal(upload, digest, NULL) == MODAL_OK);
        check_sealed(4, upload_offset(upload), upload_crc(upload), digest);
        upload_close(upload);
        stop();
    }
}

TEST(a_crash_between_the_seals_rename_and_its_row_is_resumed)
{
    struct chunk_record chunks[16];
    struct upload *upload;
    uint8_t digest[32];
    size_t count;

    start();
    CHECK(upload_begin(dir, 4, &shape, &upload, NULL) == MODAL_OK);
    count = feed(upload, BYTES, chunks);
    CHECK(upload_seal(upload, digest, NULL) == MODAL_OK);
    upload_close(upload);
    CHECK(upload_resume(dir, 4, &shape, chunks, count, &upload, NULL) == MODAL_OK);
    CHECK(upload_seal(upload, digest, NULL) == MODAL_OK);
    check_sealed(4, upload_offset(upload), upload_crc(upload), digest);
    upload_close(upload);
    stop();
}

TEST(chunks_out_of_order_or_past_the_end_and_early_seals_are_refused)
{
    struct upload *upload;
    uint8_t digest[32];

    start();
    CHECK(upload_begin(dir, 4, &shape, &upload, NULL) == MODAL_OK);
    CHECK(put(upload, 8, x, 8) == MODAL_BAD_FRAME);
    CHECK(put(upload, 0, x, 16) == MODAL_OK);
    CHECK(put(upload, 0, x, 16) == MODAL_BAD_FRAME);
    CHECK(put(upload, 16, x, BYTES - 15) == MODAL_BAD_FRAME);
    CHECK(upload_received(upload) == 16);
    CHECK(upload_seal(upload, digest, NULL) == MODAL_BAD_FRAME);
    upload_close(upload);
    stop();
}

TEST(shapes_out_of_range_are_refused_with_their_field)
{
    static char long_name[SPOOL_NAME_MOST + 2];
    const char *const long_names[1] = { long_name };
    struct modal_error err;
    struct upload *upload = NULL;
    const struct {
        struct input_shape shape;
        enum modal_status status;
        const char *field;
    } cases[] = {
        { { .type = INPUT_BATCH, .samples = 0, .channels = 3, .dt = 1 },
          MODAL_BAD_INPUT,
          "samples" },
        { { .type = INPUT_BATCH, .samples = 5, .channels = 0, .dt = 1 },
          MODAL_BAD_INPUT,
          "samples" },
        { { .type = INPUT_BATCH, .samples = (uint64_t)1 << 40, .channels = 3, .dt = 1 },
          MODAL_TOO_LARGE,
          "samples" },
        { { .type = INPUT_BATCH, .samples = 5, .channels = SPOOL_CHANNELS_MOST + 1, .dt = 1 },
          MODAL_TOO_LARGE,
          "channels" },
        { { .type = INPUT_BATCH, .samples = 5, .channels = 1, .dt = NAN }, MODAL_BAD_INPUT, "dt" },
        { { .type = INPUT_BATCH, .samples = 5, .channels = 1, .dt = 1, .period = INFINITY },
          MODAL_BAD_INPUT,
          "period" },
        { { .type = INPUT_BATCH, .samples = 5, .channels = 1, .dt = 1, .units = long_name },
          MODAL_TOO_LARGE,
          "units" },
        { { .type = INPUT_BATCH, .samples = 5, .channels = 1, .dt = 1, .names = long_names },
          MODAL_TOO_LARGE,
          "channels" },
        { { .type = INPUT_SCENE, .length = 0 }, MODAL_BAD_INPUT, "length" },
    };

    memset(long_name, 'n', SPOOL_NAME_MOST + 1);
    start();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        CHECK(upload_begin(dir, 4, &cases[i].shape, &upload, &err) == cases[i].status);
        CHECK_STRING(err.field, cases[i].field);
        CHECK(upload == NULL);
    }
    stop();
}

TEST(a_scene_and_the_smallest_batch_are_spooled)
{
    struct input_shape scene = { .type = INPUT_SCENE, .length = 13 },
                       least = { .type = INPUT_BATCH, .samples = 1, .channels = 1, .dt = 1 };
    const struct {
        const struct input_shape *shape;
        const void *data;
        size_t length;
    } cases[2] = { { &scene, "{\"omega\":1.5}", 13 }, { &least, x, 8 } };

    for (int i = 0; i < 2; i++) {
        uint8_t digest[32], expected[32];
        struct upload *upload;
        struct mapping map;
        char path[4096];
        start();
        CHECK(upload_begin(dir, 4, cases[i].shape, &upload, NULL) == MODAL_OK);
        CHECK(put(upload, 0, cases[i].data, cases[i].length) == MODAL_OK);
        CHECK(upload_seal(upload, digest, NULL) == MODAL_OK);
        identity_of(cases[i].shape, cases[i].data, cases[i].length, expected);
        CHECK(memcmp(digest, expected, 32) == 0);
        spool_path(path, dir, 4);
        int fd = open(path, O_RDONLY);
        CHECK(spool_map_open(fd, path, upload_offset(upload), cases[i].length, upload_crc(upload),
                             &map, NULL) == MODAL_OK);
        close(fd);
        CHECK(memcmp(map.data, cases[i].data, cases[i].length) == 0);
        mapping_close(&map);
        upload_close(upload);
        stop();
    }
}

TEST(damage_to_a_sealed_file_is_reported_and_names_it)
{
    struct upload *upload;
    struct modal_error err;
    struct mapping map = { 0 };
    uint8_t digest[32];
    uint64_t offset;
    uint32_t crc;
    char path[4096];
    int fd;

    start();
    CHECK(upload_begin(dir, 4, &shape, &upload, NULL) == MODAL_OK);
    feed(upload, BYTES, NULL);
    CHECK(upload_seal(upload, digest, NULL) == MODAL_OK);
    offset = upload_offset(upload);
    crc = upload_crc(upload);
    upload_close(upload);
    spool_path(path, dir, 4);
    fd = open(path, O_RDWR);
    CHECK(pwrite(fd, "\x7f", 1, (off_t)offset + 12345) == 1);
    CHECK(spool_map_open(fd, path, offset, BYTES, crc, &map, &err) == MODAL_CORRUPT);
    CHECK(strstr(err.message, path) != NULL && map.base == NULL);
    CHECK(ftruncate(fd, (off_t)offset + BYTES - 1) == 0);
    CHECK(spool_map_open(fd, path, offset, BYTES, crc, &map, &err) == MODAL_CORRUPT);
    close(fd);
    stop();
}

TEST(damage_to_an_open_upload_is_found_on_resuming_and_names_the_chunk)
{
    struct chunk_record chunks[16];
    struct upload *upload;
    struct modal_error err;
    char path[128];
    uint64_t offset;
    size_t count;
    int fd;

    start();
    CHECK(upload_begin(dir, 4, &shape, &upload, NULL) == MODAL_OK);
    count = feed(upload, BYTES / 2, chunks);
    offset = upload_offset(upload);
    upload_close(upload);
    snprintf(path, sizeof path, "%s/spool/4.part", dir);
    fd = open(path, O_RDWR);
    CHECK(pwrite(fd, "\x7f", 1, (off_t)offset + CHUNK + 5) == 1);
    close(fd);
    upload = NULL;
    CHECK(upload_resume(dir, 4, &shape, chunks, count, &upload, &err) == MODAL_CORRUPT);
    CHECK(strstr(err.message, "chunk at 65536") != NULL && upload == NULL);
    CHECK(spool_remove(dir, 4, NULL) == MODAL_OK);
    CHECK(upload_resume(dir, 4, &shape, chunks, count, &upload, &err) == MODAL_CORRUPT);
    stop();
}

struct found { int parts, sealed, results, others; uint64_t parts_held; };

static void count_found(void *context, enum spool_file what, int64_t id, uint64_t bytes,
                        const char *path)
{
    struct found *found = context;
    struct stat known;

    CHECK(path[0] == '/' && (what == SPOOL_OTHER || id == 4 || id == 9));
    (void)bytes;
    CHECK(stat(path, &known) == 0);
    if (what == SPOOL_PART)
        found->parts_held += (uint64_t)known.st_blocks * 512;
    found->parts += what == SPOOL_PART;
    found->sealed += what == SPOOL_SEALED;
    found->results += what == SPOOL_RESULT;
    found->others += what == SPOOL_OTHER;
}

TEST(the_folders_files_are_listed_counted_and_removed)
{
    struct found found = { 0 };
    struct upload *upload;
    uint8_t digest[32];
    char path[128];

    start();
    CHECK(upload_begin(dir, 4, &shape, &upload, NULL) == MODAL_OK);
    feed(upload, BYTES, NULL);
    CHECK(upload_seal(upload, digest, NULL) == MODAL_OK);
    upload_close(upload);
    CHECK(upload_begin(dir, 9, &shape, &upload, NULL) == MODAL_OK);
    upload_close(upload);
    snprintf(path, sizeof path, "%s/results/4.json", dir);
    CHECK(file_put(path, "{}", 2, 0640, NULL) == MODAL_OK);
    snprintf(path, sizeof path, "%s/results/4.json.tmp", dir);
    CHECK(file_put(path, "{}", 2, 0640, NULL) == MODAL_OK);
    CHECK(spool_list(dir, count_found, &found, NULL) == MODAL_OK);
    CHECK(found.parts == 1 && found.sealed == 1 && found.results == 1 && found.others == 1);
    CHECK(found.parts_held >= BYTES && found.parts_held < BYTES + 50000);   /* space is reserved */
    CHECK(spool_remove(dir, 4, NULL) == MODAL_OK && spool_remove(dir, 9, NULL) == MODAL_OK &&
          spool_remove(dir, 10, NULL) == MODAL_OK);
    found = (struct found) { 0 };
    CHECK(spool_list(dir, count_found, &found, NULL) == MODAL_OK);
    CHECK(found.parts == 0 && found.sealed == 0);
    stop();
}

TEST(the_reserve_is_held_and_released)
{
    char path[128], *data;
    size_t length;

    start();
    CHECK(reserve_hold(dir, 1 << 20, NULL) == MODAL_OK);
    snprintf(path, sizeof path, "%s/RESERVE", dir);
    CHECK(file_get(path, 1 << 21, &data, &length, NULL) == MODAL_OK);
    CHECK(length == 1 << 20);
    free(data);
    CHECK(reserve_hold(dir, 1 << 20, NULL) == MODAL_OK);
    CHECK(reserve_hold(dir, (uint64_t)1 << 60, NULL) == MODAL_STORAGE_FULL);
    CHECK(file_get(path, 1 << 21, &data, &length, NULL) == MODAL_OK);
    CHECK(length == 1 << 20);                      /* as it was */
    free(data);
    CHECK(reserve_hold(dir, 1 << 18, NULL) == MODAL_OK);
    CHECK(file_get(path, 1 << 21, &data, &length, NULL) == MODAL_OK);
    CHECK(length == 1 << 18);
    free(data);
    CHECK(reserve_release(dir, NULL) == MODAL_OK);
    CHECK(file_get(path, 1 << 21, &data, &length, NULL) == MODAL_NOT_FOUND);
    stop();
}
