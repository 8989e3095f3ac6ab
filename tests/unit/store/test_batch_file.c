/* test_batch_file.c - a user's HDF5 file in, the same batch out; everything that is no batch named
 * for what it is */
#include "check.h"
#include <hdf5.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>
#include "store/batch_file.h"

static char folder[64], path[128];

static void start(void)
{
    snprintf(folder, sizeof folder, "/tmp/modald-test-XXXXXX");
    CHECK(mkdtemp(folder) != NULL);
    snprintf(path, sizeof path, "%s/batch.h5", folder);
}

static void stop(void)
{
    unlink(path);
    CHECK(rmdir(folder) == 0);     /* no .tmp stays behind */
}

/* --- making files with HDF5 itself --- */

static void put(hid_t object, const char *name, hid_t type, hsize_t count, const void *values)
{
    hid_t space = count == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &count, NULL);
    hid_t attribute = H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT);

    CHECK(attribute >= 0 && H5Awrite(attribute, type, values) >= 0);
    H5Aclose(attribute);
    H5Sclose(space);
}

static hid_t text_type(size_t size)
{
    hid_t type = H5Tcopy(H5T_C_S1);

    H5Tset_size(type, size);
    return type;
}

static hid_t make(hid_t *set, const char *name, hid_t type, int rank, const hsize_t *dims,
                  const void *values, hid_t memory)
{
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
          space = H5Screate_simple(rank, dims, NULL);

    *set = H5Dcreate2(file, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    if (values != NULL)
        CHECK(H5Dwrite(*set, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0);
    H5Sclose(space);
    return file;
}

static const double x[6] = { 2.385, -1.5, 1e-300, 7.25, 0.1, 3.0 };
static const hsize_t three_by_two[2] = { 3, 2 };

static void close_all(hid_t set, hid_t file)
{
    H5Dclose(set);
    H5Fclose(file);
}

/* Reading PATH fails with STATUS and FIELD and leaves its output alone. */
static void check_refused(enum modal_status status, const char *field)
{
    struct batch_file got, before;
    struct modal_error err = { 0 };

    memset(&got, 0x5a, sizeof got);
    before = got;
    CHECK(batch_file_read(path, "signals", 0, &got, &err) == status);
    CHECK_STRING(err.field, field);
    CHECK(err.message[0] != 0);
    CHECK(memcmp(&got, &before, sizeof got) == 0);
}

/* --- tests --- */

TEST(what_is_written_is_read_back_bit_for_bit)
{
    static const char *const names[2] = { "root", "tip \xc2\xb5" };
    struct batch batch = { .samples = 3,
                           .channels = 2,
                           .signals = x,
                           .dt = 0.1 + 0.2,
                           .period = 7.7,
                           .names = names,
                           .units = "m/s" };
    cJSON *attributes =
        cJSON_Parse("{\"rig\":\"seven\",\"gain\":2.385,\"list\":[1.5,2,3],\"words\":[\"a\","
                    "\"bc\"],\"deep\":{\"a\":[1,{}]},\"empty\":\"\"}");
    struct batch_file got;

    start();
    CHECK(batch_file_write(path, &batch, attributes, NULL) == MODAL_OK);
    CHECK(batch_file_read(path, "signals", 0, &got, NULL) == MODAL_OK);
    CHECK(got.batch.samples == 3 && got.batch.channels == 2);
    CHECK(memcmp(got.batch.signals, x, sizeof x) == 0);
    CHECK(got.batch.dt == 0.1 + 0.2 && got.batch.period == 7.7);
    CHECK_STRING(got.batch.names[1], "tip \xc2\xb5");
    CHECK_STRING(got.batch.units, "m/s");
    CHECK(cJSON_GetArraySize(got.attributes) == 6);
    CHECK_STRING(cJSON_GetObjectItem(got.attributes, "rig")->valuestring, "seven");
    CHECK(cJSON_GetArrayItem(cJSON_GetObjectItem(got.attributes, "list"), 0)->valuedouble == 1.5);
    CHECK_STRING(cJSON_GetArrayItem(cJSON_GetObjectItem(got.attributes, "words"), 1)->valuestring,
                 "bc");
    CHECK_STRING(cJSON_GetObjectItem(got.attributes, "deep")->valuestring, "{\"a\":[1,{}]}");
    batch_file_done(&got);
    cJSON_Delete(attributes);
    stop();
}

/* More than 64 kB of names, in HDF5's own form: as a simulation of so many dofs has them. */
TEST(names_of_20000_channels_are_read_back)
{
    enum { CHANNELS = 20000 };
    static char text[CHANNELS][16];
    static const char *names[CHANNELS];
    static double signals[2 * CHANNELS];
    struct batch batch = { .samples = 2, .channels = CHANNELS, .signals = signals, .dt = 1,
                           .names = names };
    struct batch_file got;

    for (int i = 0; i < CHANNELS; i++) {
        snprintf(text[i], sizeof text[i], "x%d", i + 1);
        names[i] = text[i];
    }
    start();
    CHECK(batch_file_write(path, &batch, NULL, NULL) == MODAL_OK);
    CHECK(batch_file_read(path, "signals", 0, &got, NULL) == MODAL_OK);
    CHECK(got.batch.channels == CHANNELS);
    CHECK_STRING(got.batch.names[CHANNELS - 1], "x20000");
    batch_file_done(&got);
    stop();
}

/* Of sixteen megabytes and one number: as it lies, to be given back; of a number less: a copy. */
TEST(signals_beyond_sixteen_megabytes_are_mapped_and_may_be_given_back)
{
    enum { MOST = (1 << 24) / 8 };
    double *long_one = calloc(MOST + 1, sizeof *long_one);

    CHECK(long_one != NULL);
    long_one[MOST - 1] = 2.385;
    for (int more = 0; more < 2; more++) {
        struct batch batch = { .samples = MOST + more, .channels = 1, .signals = long_one,
                               .dt = 1 };
        struct batch_file got;
        start();
        CHECK(batch_file_write(path, &batch, NULL, NULL) == MODAL_OK);
        CHECK(batch_file_map(path, "signals", 0, UINT64_MAX - 1, &got, NULL) == MODAL_OK);
        CHECK((got.map.data != NULL) == more && (got.batch.spare != NULL) == more);
        CHECK(got.batch.release == NULL && got.batch.signals[MOST - 1] == 2.385);
        if (more)
            got.batch.spare(got.batch.signals, 8 * MOST);
        CHECK(got.batch.signals[MOST - 1] == 2.385);
        batch_file_done(&got);
        stop();
    }
    free(long_one);
}

TEST(numbers_of_every_type_and_attributes_on_the_root_are_taken)
{
    static const int values[6] = { -7, 0, 32767, 5, -32768, 1 };
    static const float dt = 0.25f;
    static const char names[2][4] = { "ab", "cde" };
    hid_t types[4] = { H5T_STD_I16BE, H5T_STD_I64LE, H5T_IEEE_F32BE, H5T_STD_I32LE };

    for (int t = 0; t < 4; t++) {
        struct batch_file got;
        hid_t set, file, text = text_type(4);
        start();
        file = make(&set, "signals", types[t], 2, three_by_two, values, H5T_NATIVE_INT);
        put(file, "dt", H5T_NATIVE_FLOAT, 1, &dt);
        put(file, "channels", text, 2, names);
        put(file, "units", text, 0, "mm/");
        put(set, "run", H5T_NATIVE_INT, 0, &values[3]);
        H5Tclose(text);
        close_all(set, file);
        CHECK(batch_file_read(path, "signals", 0, &got, NULL) == MODAL_OK);
        for (int i = 0; i < 6; i++)
            CHECK(got.signals[i] == values[i]);
        CHECK(got.batch.dt == 0.25 && got.batch.period == 0);
        CHECK_STRING(got.batch.names[0], "ab");
        CHECK_STRING(got.batch.names[1], "cde");
        CHECK_STRING(got.batch.units, "mm/");
        CHECK(cJSON_GetObjectItem(got.attributes, "run")->valuedouble == 5);
        batch_file_done(&got);
        stop();
    }
}

TEST(a_step_that_the_file_does_not_say_may_be_given)
{
    const double own = 0.5;

    for (int said = 0; said < 2; said++) {
        struct batch_file got;
        hid_t set, file;

        start();
        file = make(&set, "signals", H5T_IEEE_F64LE, 2, three_by_two, x, H5T_NATIVE_DOUBLE);
        if (said)
            put(set, "dt", H5T_NATIVE_DOUBLE, 0, &own);
        close_all(set, file);
        CHECK(batch_file_read(path, "signals", 0.0625, &got, NULL) == MODAL_OK);
        CHECK(got.batch.dt == (said ? own : 0.0625));
        batch_file_done(&got);
        stop();
    }
}

TEST(an_attribute_of_the_dataset_goes_before_one_of_the_root)
{
    const double near = 0.5, far = 0.125;
    struct batch_file got;
    hid_t set, file;

    start();
    file = make(&set, "signals", H5T_IEEE_F64LE, 2, three_by_two, x, H5T_NATIVE_DOUBLE);
    put(file, "dt", H5T_NATIVE_DOUBLE, 0, &far);
    put(set, "dt", H5T_NATIVE_DOUBLE, 0, &near);
    put(file, "note", H5T_NATIVE_DOUBLE, 0, &far);
    put(set, "note", H5T_NATIVE_DOUBLE, 0, &near);
    close_all(set, file);
    CHECK(batch_file_read(path, "signals", 0, &got, NULL) == MODAL_OK);
    CHECK(got.batch.dt == near);
    CHECK(cJSON_GetObjectItem(got.attributes, "note")->valuedouble == near);
    batch_file_done(&got);
    stop();
}

TEST(text_that_is_latin_1_becomes_utf_8)
{
    const double dt = 0.5;
    struct batch_file got;
    hid_t set, file, text = text_type(8);

    start();
    file = make(&set, "signals", H5T_IEEE_F64LE, 2, three_by_two, x, H5T_NATIVE_DOUBLE);
    put(set, "dt", H5T_NATIVE_DOUBLE, 0, &dt);
    put(set, "units", text, 0, "\xb5m/s\0\0\0");
    H5Tclose(text);
    close_all(set, file);
    CHECK(batch_file_read(path, "signals", 0, &got, NULL) == MODAL_OK);
    CHECK_STRING(got.batch.units, "\xc2\xb5m/s");
    batch_file_done(&got);
    stop();
}

TEST(a_missing_file_and_one_that_is_not_hdf5_are_named)
{
    FILE *file;

    start();
    check_refused(MODAL_BAD_INPUT, "file");
    file = fopen(path, "w");
    fputs("time,a,b\n0,1,2\n", file);
    fclose(file);
    check_refused(MODAL_BAD_INPUT, "file");
    stop();
}

TEST(a_file_cut_anywhere_is_refused_or_read_as_it_was)
{
    struct batch batch = { .samples = 3, .channels = 2, .signals = x, .dt = 0.5 };
    struct batch_file got;
    long size;
    FILE *file;
    int refused = 0;

    start();
    CHECK(batch_file_write(path, &batch, NULL, NULL) == MODAL_OK);
    file = fopen(path, "r");
    fseek(file, 0, SEEK_END);
    size = ftell(file);
    fclose(file);
    for (long length = size - 1; length >= 0; length -= 7) {
        CHECK(truncate(path, length) == 0);
        if (batch_file_read(path, "signals", 0, &got, NULL) == MODAL_OK) {
            CHECK(memcmp(got.signals, x, sizeof x) == 0);
            batch_file_done(&got);
        } else {
            refused++;
        }
    }
    CHECK(refused > size / 14);
    stop();
}

/* A test that waits for the FIFO's other end is ended by its alarm. */
TEST(what_is_no_file_is_refused_and_nobody_is_waited_for)
{
    start();
    alarm(20);
    CHECK(mkfifo(path, 0600) == 0);
    check_refused(MODAL_BAD_INPUT, "file");
    CHECK(unlink(path) == 0 && mkdir(path, 0700) == 0);
    check_refused(MODAL_BAD_INPUT, "file");
    CHECK(rmdir(path) == 0);
    check_refused(MODAL_BAD_INPUT, "file");
    alarm(0);
    stop();
}

TEST(a_dataset_that_is_absent_or_of_the_wrong_type_or_rank_is_named)
{
    static const hsize_t three[3] = { 1, 3, 2 };
    const double dt = 0.5;
    hid_t set, file, text = text_type(4);
    const struct { const char *name; hid_t type; int rank; const hsize_t *dims; } cases[] = {
        { "signal", H5T_IEEE_F64LE, 2, three_by_two },
        { "signals", H5T_IEEE_F64LE, 3, three },
        { "signals", text, 2, three_by_two },
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        start();
        file = make(&set, cases[i].name, cases[i].type, cases[i].rank, cases[i].dims, NULL, 0);
        put(set, "dt", H5T_NATIVE_DOUBLE, 0, &dt);
        close_all(set, file);
        check_refused(MODAL_BAD_INPUT, "signals");
        stop();
    }
    H5Tclose(text);
}

TEST(a_dataset_of_one_dimension_and_of_another_name_is_one_channel)
{
    static const hsize_t six[1] = { 6 };
    const double dt = 0.5;
    struct batch_file got;
    hid_t set, file;

    start();
    file = make(&set, "tip", H5T_IEEE_F64LE, 1, six, x, H5T_NATIVE_DOUBLE);
    put(set, "dt", H5T_NATIVE_DOUBLE, 0, &dt);
    close_all(set, file);
    CHECK(batch_file_read(path, "tip", 0, &got, NULL) == MODAL_OK);
    CHECK(got.batch.samples == 6 && got.batch.channels == 1 && got.batch.dt == dt);
    CHECK(got.batch.signals[5] == x[5]);
    batch_file_done(&got);
    stop();
}

TEST(a_shape_past_this_machines_memory_is_refused_before_it_is_allocated)
{
    static const hsize_t huge[2] = { (hsize_t)1 << 40, 64 }, chunk[2] = { 1024, 64 };
    hid_t file, space, plan, set;

    start();
    file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    space = H5Screate_simple(2, huge, NULL);
    plan = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(plan, 2, chunk);
    set = H5Dcreate2(file, "signals", H5T_IEEE_F64LE, space, H5P_DEFAULT, plan, H5P_DEFAULT);
    H5Pclose(plan);
    H5Sclose(space);
    close_all(set, file);
    check_refused(MODAL_TOO_LARGE, "signals");
    stop();
}

TEST(attributes_that_are_missing_or_wrong_are_named)
{
    static const double good = 0.5, two[2] = { 1, 2 }, zero = 0, negative = -0.5,
                        infinite = INFINITY, nan = NAN;
    static const struct {
        const char *name;
        const double *value;
        hsize_t count;
        const char *field;
    } cases[] = {
        { "other", &good, 0, "dt" },     { "dt", two, 2, "dt" },
        { "dt", &zero, 0, "dt" },        { "dt", &negative, 0, "dt" },
        { "dt", &infinite, 0, "dt" },    { "dt", &nan, 0, "dt" },
        { "period", &nan, 0, "period" }, { "period", &negative, 0, "period" },
        { "units", &good, 0, "units" },  { "channels", two, 2, "channels" },
    };
    hid_t set, file;

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        start();
        file = make(&set, "signals", H5T_IEEE_F64LE, 2, three_by_two, x, H5T_NATIVE_DOUBLE);
        if (strcmp(cases[i].field, "dt") != 0)
            put(set, "dt", H5T_NATIVE_DOUBLE, 0, &good);
        put(set, cases[i].name, H5T_NATIVE_DOUBLE, cases[i].count, cases[i].value);
        close_all(set, file);
        check_refused(MODAL_BAD_INPUT, cases[i].field);
        stop();
    }
}

TEST(a_wrong_number_of_names_and_a_text_for_dt_are_named)
{
    static const char names[3][4] = { "a", "b", "c" };
    const double dt = 0.5;
    hid_t set, file, text = text_type(4);

    for (int wrong_dt = 0; wrong_dt < 2; wrong_dt++) {
        start();
        file = make(&set, "signals", H5T_IEEE_F64LE, 2, three_by_two, x, H5T_NATIVE_DOUBLE);
        if (wrong_dt)
            put(set, "dt", text, 0, "0.5");
        else
            put(set, "dt", H5T_NATIVE_DOUBLE, 0, &dt);
        put(set, "channels", text, 3, names);
        close_all(set, file);
        check_refused(MODAL_BAD_INPUT, wrong_dt ? "dt" : "channels");
        stop();
    }
    H5Tclose(text);
}

TEST(a_path_that_cannot_be_written_leaves_nothing)
{
    struct batch batch = { .samples = 3, .channels = 2, .signals = x, .dt = 0.5 };
    struct modal_error err;

    start();
    snprintf(path, sizeof path, "%s/no/such/folder.h5", folder);
    CHECK(batch_file_write(path, &batch, NULL, &err) == MODAL_IO);
    CHECK_STRING(err.field, "file");
    stop();
}
