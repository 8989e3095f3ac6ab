/* test_check.c - fsck names what is damaged and where, dump shows every row, a backup is a store */
/* Tests as well: backup.c dump.c ledger_db.c */
#include "check.h"
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>
#include "base/json.h"
#include "store/backup.h"
#include "store/check.h"
#include "store/dump.h"
#include "base/crc32c.h"
#include "store/ledger.h"
#include "store/spool.h"

enum { SAMPLES = 4000, BYTES = SAMPLES * 8, CHUNK = 8000, LARGE = LEDGER_RESULT_INLINE_MOST + 10 };

static char dir[64], problems[4096], rows[16384];
static double x[SAMPLES];
static uint64_t data_offset;

static void collect(void *context, const char *line)
{
    size_t used = strlen(context);
    size_t room = context == (void *)rows ? sizeof rows : sizeof problems;

    snprintf((char *)context + used, room - used, "%s\n", line);
}

/* A job with an inline input, one with an upload and a large result, an open upload. */
static struct ledger *start(void)
{
    struct input_shape shape = {
        .type = INPUT_BATCH, .samples = SAMPLES, .channels = 1, .dt = 0.5
    };
    struct ledger_change group[16] = { 0 };
    struct ledger *ledger = NULL;
    char *large = malloc(LARGE);
    size_t n = 0;

    snprintf(dir, sizeof dir, "/tmp/modald-test-XXXXXX");
    CHECK(mkdtemp(dir) != NULL);
    CHECK(ledger_open(dir, &ledger, NULL) == MODAL_OK);
    for (int i = 0; i < SAMPLES; i++)
        x[i] = sin(i);
    group[n].verb = LEDGER_INPUT_PUT;
    group[n++].input = (struct input_record) { .id = 1,
                                              .user = "ada",
                                              .shape = { .type = INPUT_SCENE, .length = 13 },
                                              .state = INPUT_SEALED,
                                              .crc = crc32c(0, "{\"omega\":1.5}", 13),
                                              .data = "{\"omega\":1.5}",
                                              .inline_data = true };
    for (int64_t id = 2; id <= 3; id++) {
        struct upload *upload;
        uint8_t digest[32] = { 0 };
        CHECK(upload_begin(dir, id, &shape, &upload, NULL) == MODAL_OK);
        for (uint64_t at = 0; at < (id == 2 ? BYTES : BYTES / 2); at += CHUNK, n++) {
            group[n].verb = LEDGER_CHUNK_PUT;
            group[n].input_id = id;
            group[n].chunk = (struct chunk_record) { .offset = at,
                                                    .length = CHUNK,
                                                    .crc = crc32c(0, (char *)x + at, CHUNK) };
            struct upload_part part = { (char *)x + at, CHUNK, group[n].chunk.crc };
            CHECK(upload_write(upload, at, &part, 1, NULL) == MODAL_OK);
            upload_hash(upload, &part, 1);
        }
        if (id == 2)
            CHECK(upload_seal(upload, digest, NULL) == MODAL_OK);
        data_offset = upload_offset(upload);
        group[n].verb = LEDGER_INPUT_PUT;
        group[n].input = (struct input_record) { .id = id,
                                                .user = "ada",
                                                .shape = shape,
                                                .state = id == 2 ? INPUT_SEALED : INPUT_OPEN,
                                                .crc = upload_crc(upload),
                                                .offset = upload_offset(upload) };
        memcpy(group[n++].input.sha256, digest, 32);
        upload_close(upload);
    }
    for (int64_t id = 1; id <= 2; id++) {
        group[n].verb = LEDGER_JOB_PUT;
        group[n++].job = (struct job_record) { .id = id,
                                              .user = "ada",
                                              .key = id == 1 ? "k" : NULL,
                                              .kind = "identify",
                                              .options = "{}",
                                              .input = id,
                                              .state = id == 1 ? JOB_QUEUED : JOB_DONE,
                                              .result_bytes = id == 1 ? 0 : LARGE };
    }
    memset(large, 'r', LARGE);
    group[n].verb = LEDGER_RESULT_PUT;
    CHECK(ledger_result_put(dir, 2, large, LARGE, &group[n++].result, NULL) == MODAL_OK);
    CHECK(ledger_commit(ledger, group, n, NULL) == MODAL_OK);
    free(large);
    return ledger;
}

static void stop(struct ledger *ledger)
{
    char command[160];

    ledger_close(ledger);
    snprintf(command, sizeof command, "rm -rf %s %s.copy", dir, dir);
    CHECK(system(command) == 0);
}

static struct check_report look(const char *folder)
{
    struct check_report report;

    problems[0] = 0;
    CHECK(check_folder(folder, collect, problems, &report, NULL) == MODAL_OK);
    return report;
}

static void flip(const char *name, off_t at)
{
    char path[128];
    unsigned char byte;
    int fd;

    snprintf(path, sizeof path, "%s/%s", dir, name);
    fd = open(path, O_RDWR);
    CHECK(fd >= 0 && pread(fd, &byte, 1, at) == 1);
    byte ^= 16;
    CHECK(pwrite(fd, &byte, 1, at) == 1);
    close(fd);
}

TEST(a_sound_store_has_no_problems_beside_its_daemon_and_after_it)
{
    struct ledger *ledger = start();
    struct check_report report = look(dir);

    CHECK_STRING(problems, "");
    CHECK(report.problems == 0 && report.orphans == 0 && report.jobs == 2 && report.inputs == 3 &&
          report.results == 1 && report.chunks == 6);
    ledger_close(ledger);
    CHECK(look(dir).problems == 0);
    stop(NULL);
}

TEST(a_flipped_bit_of_a_sealed_input_is_named_with_its_chunk_and_offset)
{
    struct ledger *ledger = start();
    char expected[64];

    flip("spool/2.h5", (off_t)data_offset + CHUNK + 77);
    CHECK(look(dir).problems == 1);
    snprintf(expected, sizeof expected, "the chunk at %d (offset %d of its file", CHUNK,
             (int)data_offset + CHUNK);
    CHECK(strstr(problems, "input 2:") != NULL && strstr(problems, expected) != NULL);
    stop(ledger);
}

TEST(damage_to_an_open_upload_a_result_and_the_ledger_is_named)
{
    struct ledger *ledger = start();
    int64_t left;

    flip("spool/3.part", (off_t)data_offset + 5);
    CHECK(look(dir).problems == 1 && strstr(problems, "input 3:") != NULL);
    flip("results/2.json", 100000);
    CHECK(look(dir).problems == 2 && strstr(problems, "result of job 2") != NULL);
    CHECK(ledger_vacuum(ledger, 1, &left, NULL) == MODAL_OK);
    ledger_close(ledger);
    flip("ledger.db", 3 * 4096 + 1000);
    CHECK(look(dir).problems >= 3 && strstr(problems, "page at offset 12288") != NULL);
    stop(NULL);
}

TEST(missing_files_are_problems_and_orphans_are_none)
{
    struct ledger *ledger = start();
    char path[128];
    struct check_report report;

    snprintf(path, sizeof path, "%s/spool/77.h5", dir);
    close(open(path, O_WRONLY | O_CREAT, 0600));
    report = look(dir);
    CHECK(report.problems == 0 && report.orphans == 1);
    snprintf(path, sizeof path, "%s/spool/2.h5", dir);
    unlink(path);
    snprintf(path, sizeof path, "%s/results/2.json", dir);
    unlink(path);
    report = look(dir);
    CHECK(report.problems == 2 && strstr(problems, "input 2") != NULL &&
          strstr(problems, "job 2") != NULL);
    stop(ledger);
}

TEST(a_folder_without_a_ledger_is_not_found)
{
    struct check_report report;
    struct modal_error err;

    CHECK(check_folder("/tmp/modald-no-such-folder", NULL, NULL, &report, &err) == MODAL_NOT_FOUND);
    CHECK(dump_folder("/tmp/modald-no-such-folder", collect, rows, &err) != MODAL_OK);
}

TEST(every_row_is_dumped_as_json)
{
    struct ledger *ledger = start();
    int count = 0;

    rows[0] = 0;
    CHECK(dump_folder(dir, collect, rows, NULL) == MODAL_OK);
    for (char *line = strtok(rows, "\n"); line != NULL; line = strtok(NULL, "\n"), count++) {
        cJSON *row = NULL;
        CHECK(json_read(line, strlen(line), &row, NULL) == MODAL_OK);
        CHECK(cJSON_IsString(cJSON_GetObjectItem(row, "row")));
        if (count == 3) {
            CHECK_STRING(cJSON_GetObjectItem(row, "row")->valuestring, "job");
            CHECK_STRING(cJSON_GetObjectItem(row, "id")->valuestring, "1");
            CHECK_STRING(cJSON_GetObjectItem(row, "key")->valuestring, "k");
            CHECK_STRING(cJSON_GetObjectItem(row, "state")->valuestring, "queued");
        }
        cJSON_Delete(row);
    }
    CHECK(count == 6);     /* 3 inputs, 2 jobs, 1 result */
    stop(ledger);
}

TEST(a_backup_taken_beside_the_daemon_is_a_store_of_its_own)
{
    struct ledger *ledger = start(), *second = NULL;
    struct modal_error err;
    struct stat here, there;
    char copy[80], a[128], b[128];

    snprintf(copy, sizeof copy, "%s.copy", dir);
    CHECK(backup_folder(dir, copy, &err) == MODAL_OK);
    CHECK(look(copy).problems == 0);
    CHECK(look(copy).jobs == 2 && look(copy).chunks == 6);
    snprintf(a, sizeof a, "%s/spool/2.h5", dir);
    snprintf(b, sizeof b, "%s/spool/2.h5", copy);
    CHECK(stat(a, &here) == 0 && stat(b, &there) == 0 && here.st_ino == there.st_ino);  /* linked */
    snprintf(a, sizeof a, "%s/spool/3.part", dir);
    snprintf(b, sizeof b, "%s/spool/3.part", copy);
    /* still written to: copied */
    CHECK(stat(a, &here) == 0 && stat(b, &there) == 0 && here.st_ino != there.st_ino);
    CHECK(backup_folder(dir, copy, &err) == MODAL_BAD_INPUT);
    ledger_close(ledger);
    CHECK(ledger_open(copy, &second, NULL) == MODAL_OK);
    stop(second);
}
