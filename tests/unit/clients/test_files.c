/* test_files.c - files of other programs: cut or changed anywhere, they are refused by name
 *
 * The files are the small ones that the fuzzer begins with: a byte of options, then the file,
 * written by scipy, numpy, or from a format's description.
 */
#include "check.h"
#include <dirent.h>
#include <math.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>
#include "ctl/files/bytes.h"
#include "ctl/files/steps.h"
#include "ctl/signals.h"

#define SEEDS TEST_DATA "/../seeds/fuzz_files"

enum { SEED_MOST = 4096, FILES = 13 };

/* A file in memory: on a disk one that is cut to nothing and written anew is waited for. */
static int fd = -1;
static char path[64];

static void write_file(const unsigned char *data, size_t length)
{
    CHECK(ftruncate(fd, 0) == 0 && pwrite(fd, data, length, 0) == (ssize_t)length);
}

/* Read DATA as a file with a given step where FLAGS, the first byte of a seed, say so. */
static enum modal_status read_as(int flags, const unsigned char *data, size_t length,
                                 struct signals *out, struct modal_error *err)
{
    struct signals_options options = { .dt = flags & 1 ? 0.01 : 0,
                                       .dataset = flags & 4 ? "accel" : NULL };

    *out = (struct signals) { 0 };
    *err = (struct modal_error) { 0 };
    write_file(data, length);
    return signals_read(path, &options, out, err);
}

/* Every seed in turn through CHECK_ONE; how many there were. */
static int for_each_seed(void (*check_one)(const char *name, int flags, unsigned char *data,
                                           size_t length))
{
    DIR *folder = opendir(SEEDS);
    struct dirent *entry;
    int count = 0;

    fd = memfd_create("test_files", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    CHECK(folder != NULL && fd >= 0);
    while ((entry = readdir(folder)) != NULL) {
        unsigned char data[SEED_MOST];
        char from[sizeof SEEDS + 300];
        snprintf(from, sizeof from, SEEDS "/%s", entry->d_name);
        FILE *file = entry->d_name[0] != '.' ? fopen(from, "rb") : NULL;
        if (file == NULL)
            continue;
        size_t length = fread(data, 1, sizeof data, file);
        fclose(file);
        CHECK(length > 1 && length < SEED_MOST);
        check_one(entry->d_name, data[0], data + 1, length - 1);
        count++;
    }
    closedir(folder);
    close(fd);
    return count;
}

static void check_whole(const char *name, int flags, unsigned char *data, size_t length)
{
    struct signals s;
    struct modal_error err;

    (void)name;
    CHECK(read_as(flags, data, length, &s, &err) == MODAL_OK);
    CHECK(s.samples == 6 && s.channels == 3);
    CHECK_NEAR(s.dt, 0.01, 1e-9);
    CHECK_NEAR(s.x[0], 2.0, 4e-5);               /* 1 + 0.6 + 0.4, of 16 bits in an .outb */
    signals_done(&s);
}

TEST(every_small_file_is_read_whole)
{
    CHECK(for_each_seed(check_whole) == FILES);
}

static bool ends_in_blanks(const unsigned char *rest, size_t length)
{
    for (size_t i = 0; i < length; i++)
        if (rest[i] != '\r' && rest[i] != '\n' && rest[i] != 0)
            return false;
    return true;
}

static void check_cuts(const char *name, int flags, unsigned char *data, size_t length)
{
    for (size_t cut = 0; cut < length; cut++) {
        struct signals s;
        struct modal_error err;
        if (read_as(flags, data, cut, &s, &err) == MODAL_OK)
            /* nothing is missing but the last line's end, what pads an array, or whole arrays and
             * functions of a file that does not say how many it has */
            CHECK(s.samples == 6 && (strncmp(name, "mat", 3) == 0 || strncmp(name, "uff", 3) == 0
                                     || ends_in_blanks(data + cut, length - cut)));
        else
            CHECK(err.message[0] != 0 && err.field[0] != 0 && s.x == NULL);
        signals_done(&s);
    }
}

TEST(a_file_cut_at_any_byte_is_refused_with_a_field)
{
    CHECK(for_each_seed(check_cuts) == FILES);
}

static void check_changes(const char *name, int flags, unsigned char *data, size_t length)
{
    static const unsigned char values[] = { 0x00, 0x7f, 0x80, 0xff };

    (void)name;
    for (size_t at = 0; at < length; at++)
        for (size_t i = 0; i < sizeof values; i++) {
            unsigned char was = data[at];
            struct signals s;
            struct modal_error err;
            data[at] = values[i];
            if (read_as(flags, data, length, &s, &err) == MODAL_OK)
                CHECK(s.samples > 0 && s.channels > 0 && s.dt > 0);
            else
                CHECK(err.message[0] != 0 && err.field[0] != 0 && s.x == NULL);
            signals_done(&s);
            data[at] = was;
        }
}

TEST(a_file_with_any_byte_changed_is_read_or_refused_with_a_field)
{
    CHECK(for_each_seed(check_changes) == FILES);
}

TEST(numbers_of_either_order_keep_sign_and_last_bit)
{
    static const unsigned char big[] = { 0xff, 0xfe }, little[] = { 0xfe, 0xff };
    static const unsigned char third[] = { 0x3f, 0xd5, 0x55, 0x55, 0x55, 0x55, 0x55, 0x55 };

    CHECK_NEAR(number_decode((struct number_type) { NUMBER_INT, 2, true }, big), -2, 0);
    CHECK_NEAR(number_decode((struct number_type) { NUMBER_INT, 2, false }, little), -2, 0);
    CHECK_NEAR(number_decode((struct number_type) { NUMBER_UINT, 2, true }, big), 65534, 0);
    CHECK_NEAR(number_decode((struct number_type) { NUMBER_FLOAT, 8, true }, third), 1.0 / 3, 0);
    CHECK_NEAR(number_decode((struct number_type) { NUMBER_FLOAT, 4, true }, third),
               0x1.aaaaaap0, 0);
}

TEST(bytes_past_the_end_are_not_given)
{
    static const unsigned char data[5] = { 3, 0, 0, 0, 0x80 };
    struct bytes b = { data, sizeof data, 0 };
    size_t size = 7;

    CHECK(bytes_size(&b, (struct number_type) { NUMBER_UINT, 4, false }, &size) && size == 3);
    CHECK(bytes_next(&b, 2) == NULL && bytes_left(&b) == 1);
    CHECK(!bytes_size(&b, (struct number_type) { NUMBER_INT, 1, false }, &size));
    CHECK(size == 3);
}

/* Every time a ten-thousandth of a step from its place but one, a hundredth. */
TEST(steps_are_even_to_a_thousandth_of_one)
{
    double t[5] = { 1, 1.50005, 2, 2.50005, 3 };
    struct signals s = { 0 };
    struct modal_error err = { 0 };
    struct signals_options none = { 0 };

    CHECK(steps_read(t, 5, 0, "f", "it", &none, &s, NULL) == MODAL_OK);
    CHECK_NEAR(s.dt, 0.5, 1e-15);
    t[1] = 1.505;
    CHECK(steps_read(t, 5, 0, "f", "it", &none, &s, &err) == MODAL_BAD_INPUT);
    CHECK_STRING(err.field, "time");
    t[1] = 0.5;
    CHECK(steps_turn_back(t, 5, 1) == 1 && steps_deviation(t, 3, 2, &s.dt) == 0);
}

TEST(a_unit_of_time_is_the_first_word_bare_or_in_brackets_however_it_is_written)
{
    static const char *const others[] = {
        "ms", "msec", "msecs", "millisecond", "milliseconds", "us", "usec", "usecs",
        "microsecond", "microseconds", "ns", "nsec", "nsecs", "nanosecond", "nanoseconds",
        "min", "mins", "minute", "minutes", "h", "hr", "hrs", "hour", "hours", "d", "day", "days",
    };
    char text[64];

    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        CHECK_STRING(steps_unit(others[i]), others[i]);
        snprintf(text, sizeof text, " [%s]", others[i]);
        CHECK_STRING(steps_unit(text), others[i]);
        snprintf(text, sizeof text, "%s since 2020-01-01 00:00:00", others[i]);
        CHECK_STRING(steps_unit(text), others[i]);
    }
    CHECK_STRING(steps_unit("seconds since 2020-01-01"), "s");
    CHECK_STRING(steps_unit("stamp"), "");
    CHECK_STRING(steps_unit("kHz"), "");
    CHECK_STRING(steps_rate_unit("(khz)"), "kHz");
    CHECK_STRING(steps_rate_unit("ms"), "");
}
