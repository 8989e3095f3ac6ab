/* test_file.c - the calls of file.h do what they say, and say what went wrong where */
/* Tests as well: file_fault.c */
#include "check.h"
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include "store/file.h"

static char dir[64], path[128];

static void start(void)
{
    snprintf(dir, sizeof dir, "/tmp/modald-test-XXXXXX");
    CHECK(mkdtemp(dir) != NULL);
    snprintf(path, sizeof path, "%s/x", dir);
}

static void stop(void)
{
    file_fault(NULL);
    unlink(path);
    CHECK(rmdir(dir) == 0);      /* nothing else was left behind */
}

TEST(what_is_put_is_got_and_replaced_whole)
{
    char *data;
    size_t length;

    start();
    CHECK(file_put(path, "first", 5, 0640, NULL) == MODAL_OK);
    CHECK(file_put(path, "second one", 10, 0640, NULL) == MODAL_OK);
    CHECK(file_get(path, 10, &data, &length, NULL) == MODAL_OK);
    CHECK_STRING(data, "second one");
    CHECK(length == 10);
    free(data);
    stop();
}

TEST(errors_name_the_path_and_leave_the_outputs_alone)
{
    struct modal_error err;
    char *data = dir;
    size_t length = 77;
    int fd = 55;

    start();
    CHECK(file_open(path, O_RDONLY, 0, &fd, &err) == MODAL_NOT_FOUND && fd == 55);
    CHECK(strstr(err.message, path) != NULL);
    CHECK(file_get(path, 10, &data, &length, &err) == MODAL_NOT_FOUND && data == dir &&
          length == 77);
    CHECK(file_put(path, "eleven byte", 11, 0640, NULL) == MODAL_OK);
    CHECK(file_get(path, 10, &data, &length, &err) == MODAL_TOO_LARGE && data == dir);
    CHECK(file_make_dir(path, 0700, &err) == MODAL_IO);
    CHECK(file_make_dir(dir, 0700, &err) == MODAL_OK);
    CHECK(file_sync_dir(path, &err) == MODAL_IO);
    CHECK(file_rename("/tmp/modald-no-such", path, &err) == MODAL_NOT_FOUND);
    CHECK(file_unlink("/tmp/modald-no-such", &err) == MODAL_OK);
    stop();
}

TEST(a_read_past_the_end_is_short_and_a_reserved_file_has_its_length)
{
    struct stat known;
    char data[10];
    size_t got;
    int fd;

    start();
    CHECK(file_open(path, O_RDWR | O_CREAT, 0600, &fd, NULL) == MODAL_OK);
    CHECK(file_write(fd, "0123456789", 10, 5, NULL) == MODAL_OK);
    CHECK(file_read(fd, data, 10, 9, &got, NULL) == MODAL_OK && got == 6 &&
          memcmp(data, "456789", 6) == 0);
    CHECK(file_reserve(fd, 100000, NULL) == MODAL_OK && fstat(fd, &known) == 0);
    CHECK(known.st_size == 100000 && known.st_blocks * 512 >= 100000);
    CHECK(file_truncate(fd, 7, NULL) == MODAL_OK && fstat(fd, &known) == 0 && known.st_size == 7);
    CHECK(file_sync(fd, NULL) == MODAL_OK);
    close(fd);
    stop();
}

/* A file-size limit gives real short writes and EFBIG (F6). */
TEST(a_file_past_its_limit_is_a_full_disk)
{
    struct rlimit before, small = { 10000, 0 };
    struct modal_error err;
    static char data[20000];

    start();
    signal(SIGXFSZ, SIG_IGN);
    CHECK(getrlimit(RLIMIT_FSIZE, &before) == 0);
    small.rlim_max = before.rlim_max;
    CHECK(setrlimit(RLIMIT_FSIZE, &small) == 0);
    CHECK(file_put(path, data, sizeof data, 0600, &err) == MODAL_STORAGE_FULL);
    CHECK(setrlimit(RLIMIT_FSIZE, &before) == 0);
    CHECK(access(path, F_OK) != 0);
    stop();
}

TEST(with_fault_points_the_nth_call_fails_as_told_and_the_others_pass)
{
    struct modal_error err;

    start();
    if (!file_fault("pwrite:2:ENOSPC,fdatasync:3:EIO,rename:1:EINTR")) {
        print_message("this build has no fault points\n");
        stop();
        return;
    }
    CHECK(file_put(path, "a", 1, 0600, &err) == MODAL_OK);
    CHECK(file_put(path, "b", 1, 0600, &err) == MODAL_STORAGE_FULL);
    CHECK(file_put(path, "c", 1, 0600, &err) == MODAL_OK);
    CHECK(file_put(path, "d", 1, 0600, &err) == MODAL_IO);
    CHECK(file_put(path, "e", 1, 0600, &err) == MODAL_OK);
    CHECK(file_fault_count(FILE_PWRITE) == 5 && file_fault_count(FILE_FDATASYNC) == 4 &&
          file_fault_count(FILE_RENAME) == 4);
    CHECK(file_fault("pwrite:1+:short"));
    CHECK(file_put(path, "cut into pieces", 15, 0600, &err) == MODAL_OK);
    CHECK(file_fault_count(FILE_PWRITE) > 3);
    stop();
}

/* Neither is waited for: the other end of a FIFO may never come. */
TEST(what_is_no_file_in_the_place_of_one_is_refused_at_once)
{
    static const int ways[] = { O_RDONLY, O_WRONLY | O_CREAT, O_RDWR | O_CREAT };
    struct modal_error err;
    int fd = -1;

    start();
    CHECK(mkfifo(path, 0600) == 0);
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++) {
        CHECK(file_open(path, ways[i], 0600, &fd, &err) == MODAL_IO && fd == -1);
        CHECK(strstr(err.message, "/x is no file") != NULL);
        CHECK(file_open("/dev/zero", ways[i], 0600, &fd, &err) == MODAL_IO && fd == -1);
    }
    CHECK(unlink(path) == 0 && symlink("elsewhere", path) == 0);
    for (size_t i = 1; i < sizeof ways / sizeof *ways; i++)     /* what is written is no other's */
        CHECK(file_open(path, ways[i], 0600, &fd, &err) == MODAL_IO && fd == -1);
    CHECK(file_open(dir, O_RDONLY, 0, &fd, NULL) == MODAL_IO && fd == -1);
    CHECK(file_open(dir, O_RDONLY | O_DIRECTORY, 0, &fd, NULL) == MODAL_OK);
    close(fd);
    stop();
}
