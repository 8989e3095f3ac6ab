/*
 * batch_file.c - reading and writing a user's HDF5 batch; see batch_file.h
 *
 * A foreign file is read with suspicion: the sizes it states are held against this machine's memory
 * before anything is allocated, filter plug-ins are not loaded, text that is not UTF-8 is taken for
 * Latin-1.
 */
#include "store/batch_file.h"
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "base/utf8.h"
#include "store/batch_h5.h"
#include "store/file.h"
#include "store/h5_numbers.h"

static const double SECONDS_MOST = 1e300;    /* past it sums of squares overflow */

/* Of a file that states its own sizes: more than provenance needs, too little to harm. */
enum {
    ATTRIBUTE_BYTES_MOST = 256 * 1024,    /* as SPOOL_ATTRIBUTES_MOST, of one */
    ATTRIBUTES_MOST      = 1000,          /* each is opened by itself */
};

/* --- attributes --- */

/* An attribute read whole: numbers or texts. */
struct values {
    size_t count;
    bool scalar, logical;          /* not a list; a boolean of h5py */
    double *numbers;
    char **texts;
};

static void values_done(struct values *values)
{
    for (size_t i = 0; values->texts != NULL && i < values->count; i++)
        free(values->texts[i]);
    free(values->texts);
    free(values->numbers);
    memset(values, 0, sizeof *values);
}

static bool read_variable_texts(hid_t attribute, hid_t type, hid_t space, struct values *out)
{
    char **raw = calloc(out->count, sizeof *raw);
    hid_t memory = H5Tcopy(H5T_C_S1);
    bool ok = raw != NULL && memory >= 0 && H5Tset_size(memory, H5T_VARIABLE) >= 0
              && H5Tset_cset(memory, H5Tget_cset(type)) >= 0
              && H5Aread(attribute, memory, raw) >= 0;

    for (size_t i = 0; ok && i < out->count; i++) {
        out->texts[i] = utf8_from(raw[i] != NULL ? raw[i] : "",
                                  raw[i] != NULL ? strlen(raw[i]) : 0);
        ok = out->texts[i] != NULL;
    }
    if (raw != NULL && memory >= 0)
        H5Dvlen_reclaim(memory, space, H5P_DEFAULT, raw);
    if (memory >= 0)
        H5Tclose(memory);
    free(raw);
    return ok;
}

static bool read_fixed_texts(hid_t attribute, hid_t type, struct values *out)
{
    size_t size = H5Tget_size(type);
    bool spaces = H5Tget_strpad(type) == H5T_STR_SPACEPAD, ok;
    char *raw = calloc(out->count, size + 1);

    ok = raw != NULL && H5Aread(attribute, type, raw) >= 0;
    for (size_t i = 0; ok && i < out->count; i++) {
        size_t length = strnlen(raw + i * size, size);
        while (spaces && length > 0 && raw[i * size + length - 1] == ' ')
            length--;
        out->texts[i] = utf8_from(raw + i * size, length);
        ok = out->texts[i] != NULL;
    }
    free(raw);
    return ok;
}

static bool is_logical(hid_t type)
{
    char *first = NULL;
    bool yes;

    if (H5Tget_class(type) != H5T_ENUM || H5Tget_nmembers(type) != 2)
        return false;
    first = H5Tget_member_name(type, 0);
    yes = first != NULL && strcmp(first, "FALSE") == 0;
    H5free_memory(first);
    return yes;
}

static bool read_values(hid_t attribute, hid_t type, hid_t space, struct values *out)
{
    H5T_class_t class = H5Tget_class(type);

    if (class == H5T_STRING) {
        out->texts = calloc(out->count, sizeof *out->texts);
        return out->texts != NULL
               && (H5Tis_variable_str(type) > 0 ? read_variable_texts(attribute, type, space, out)
                                                : read_fixed_texts(attribute, type, out));
    }
    if (class != H5T_INTEGER && class != H5T_FLOAT && class != H5T_ENUM)
        return false;
    out->logical = is_logical(type);
    out->numbers = calloc(out->count, sizeof *out->numbers);
    return out->numbers != NULL && H5Aread(attribute, H5T_NATIVE_DOUBLE, out->numbers) >= 0;
}

/*
 * Read attribute NAME of OBJECT.  False, with *OUT empty, where it is absent, empty, of a type that
 * is neither number nor text, or past ATTRIBUTE_BYTES_MOST; *THERE says whether there is one of
 * that name.
 */
static bool values_read(hid_t object, const char *name, struct values *out, bool *there)
{
    hid_t attribute = H5I_INVALID_HID, type = H5I_INVALID_HID, space = H5I_INVALID_HID;
    hssize_t count;
    bool ok = false;

    memset(out, 0, sizeof *out);
    *there = H5Aexists(object, name) > 0;
    if (!*there)
        return false;
    attribute = H5Aopen(object, name, H5P_DEFAULT);
    if (attribute >= 0) {
        type = H5Aget_type(attribute);
        space = H5Aget_space(attribute);
    }
    if (type >= 0 && space >= 0) {
        count = H5Sget_simple_extent_npoints(space);
        out->scalar = H5Sget_simple_extent_ndims(space) == 0;
        if (count > 0 && H5Tget_size(type) <= ATTRIBUTE_BYTES_MOST / (size_t)count) {
            out->count = (size_t)count;
            ok = read_values(attribute, type, space, out);
        }
    }
    if (!ok)
        values_done(out);
    if (space >= 0)
        H5Sclose(space);
    if (type >= 0)
        H5Tclose(type);
    if (attribute >= 0)
        H5Aclose(attribute);
    return ok;
}

/* The contract takes an attribute from the dataset, else from the root. */
static bool values_find(hid_t set, hid_t root, const char *name, struct values *out, bool *there)
{
    bool ok = values_read(set, name, out, there);

    return *there ? ok : values_read(root, name, out, there);
}

static enum modal_status read_time(hid_t set, hid_t root, const char *name, bool required,
                                   double *out, struct modal_error *err)
{
    struct values values;
    bool there, ok = values_find(set, root, name, &values, &there) && values.numbers != NULL
                     && values.count == 1;
    double value = ok ? values.numbers[0] : 0;

    values_done(&values);
    if (!there && required)
        return modal_fail_field(err, MODAL_BAD_INPUT, name,
                                "neither the dataset nor the root has an attribute `%s`; "
                                "accepted: `dt` [s], `fs` [Hz] there, or --dt SECONDS", name);
    if (!there)
        return MODAL_OK;
    if (!ok)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, name,
            "attribute `%s` is not one number; accepted: a positive number of seconds", name);
    if (!(value > 0 && value <= SECONDS_MOST))
        return modal_fail_field(err, MODAL_BAD_INPUT, name,
                                "attribute `%s` is %.17g; accepted: a positive number of seconds",
                                name, value);
    *out = value;
    return MODAL_OK;
}

static enum modal_status read_names(hid_t set, hid_t root, size_t channels, char ***out,
                                    struct modal_error *err)
{
    struct values values;
    bool there, ok = values_find(set, root, "channels", &values, &there) && values.texts != NULL;
    size_t count = values.count;

    if (there && ok && count == channels) {
        *out = values.texts;
        values.texts = NULL;
    }
    values_done(&values);
    if (there && !ok)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "channels",
            "attribute `channels` is not text; accepted: one name for each of %zu channels",
            channels);
    if (there && count != channels)
        return modal_fail_field(err, MODAL_BAD_INPUT, "channels",
                                "attribute `channels` has %zu names for %zu channels", count,
                                channels);
    return MODAL_OK;
}

/* Several units are joined by ", ". */
static enum modal_status read_units(hid_t set, hid_t root, char **out, struct modal_error *err)
{
    struct values values;
    bool there, ok = values_find(set, root, "units", &values, &there) && values.texts != NULL;
    size_t length = 1;

    if (ok) {
        for (size_t i = 0; i < values.count; i++)
            length += strlen(values.texts[i]) + 2;
        *out = calloc(length, 1);
        for (size_t i = 0; *out != NULL && i < values.count; i++)
            strcat(strcat(*out, i > 0 ? ", " : ""), values.texts[i]);
    }
    values_done(&values);
    if (there && !ok)
        return modal_fail_field(err, MODAL_BAD_INPUT, "units", "attribute `units` is not text");
    return ok && *out == NULL ? modal_fail(err, MODAL_NO_MEMORY, "batch: no memory for its units")
                              : MODAL_OK;
}

static cJSON *value_json(const struct values *values, size_t i)
{
    if (values->texts != NULL)
        return cJSON_CreateString(values->texts[i]);
    if (values->logical)
        return cJSON_CreateBool(values->numbers[i] != 0);
    return cJSON_CreateNumber(values->numbers[i]);
}

static cJSON *values_json(const struct values *values)
{
    cJSON *list;

    if (values->scalar)
        return value_json(values, 0);
    list = cJSON_CreateArray();
    for (size_t i = 0; list != NULL && i < values->count; i++)
        cJSON_AddItemToArray(list, value_json(values, i));
    return list;
}

/* Iteration over the attributes of one object into a JSON object that may hold some already. */
struct gather { cJSON *into; size_t count; };

static herr_t gather_one(hid_t object, const char *name, const H5A_info_t *info, void *context)
{
    static const char *const own[] = { "dt", "period", "units", "channels" };
    struct gather *gather = context;
    struct values values;
    char *key;
    bool there;

    (void)info;
    for (size_t i = 0; i < sizeof own / sizeof *own; i++)
        if (strcmp(name, own[i]) == 0)
            return 0;
    if (gather->count >= ATTRIBUTES_MOST || !values_read(object, name, &values, &there))
        return 0;
    key = utf8_from(name, strlen(name));
    if (key != NULL && key[0] != 0 && !cJSON_HasObjectItem(gather->into, key)) {
        cJSON_AddItemToObject(gather->into, key, values_json(&values));
        gather->count++;
    }
    free(key);
    values_done(&values);
    return 0;
}

static cJSON *read_attributes(hid_t set, hid_t root)
{
    struct gather gather = { cJSON_CreateObject(), 0 };

    if (gather.into != NULL) {
        H5Aiterate2(set, H5_INDEX_NAME, H5_ITER_INC, NULL, gather_one, &gather);
        H5Aiterate2(root, H5_INDEX_NAME, H5_ITER_INC, NULL, gather_one, &gather);
    }
    return gather.into;
}

/* --- signals --- */

/* Bytes from which signals are mapped where they can be: a copy of fewer costs next to nothing. */
enum { MAPPED_LEAST = 1 << 24 };

struct source { const char *path, *set; double dt; uint64_t kept; };  /* those of batch_file_map */

/* Where in the file the samples lie as they are used: whole, unfiltered, in no other file.  0: they
 * do not. */
static uint64_t place_of(hid_t set)
{
    hid_t type = H5Dget_type(set), how = H5Dget_create_plist(set), file = H5Iget_file_id(set),
          made = file >= 0 ? H5Fget_create_plist(file) : H5I_INVALID_HID;
    hsize_t before = 1;
    bool plain = type >= 0 && how >= 0 && made >= 0 && H5Tequal(type, H5T_NATIVE_DOUBLE) > 0
                 && H5Pget_layout(how) == H5D_CONTIGUOUS && H5Pget_external_count(how) == 0
                 && H5Pget_userblock(made, &before) >= 0 && before == 0;
    haddr_t place = plain ? H5Dget_offset(set) : HADDR_UNDEF;

    if (made >= 0)
        H5Pclose(made);
    if (file >= 0)
        H5Fclose(file);
    if (how >= 0)
        H5Pclose(how);
    if (type >= 0)
        H5Tclose(type);
    return place != HADDR_UNDEF && place % sizeof(double) == 0 ? place : 0;
}

/* PATH, read; nobody waits for the other end of a FIFO. */
static enum modal_status open_plain(const char *path, int *fd, struct modal_error *err)
{
    int got = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    struct stat known;

    if (got < 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: %s", path, strerror(errno));
    if (fstat(got, &known) == 0 && !S_ISREG(known.st_mode)) {
        close(got);
        return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s is no file; accepted: a file, no "
                                "device, FIFO, socket or folder in its place", path);
    }
    *fd = got;
    return MODAL_OK;
}

static enum modal_status map_signals(const struct source *from, uint64_t place, size_t bytes,
                                     struct batch_file *out, struct modal_error *err)
{
    int fd = -1;
    enum modal_status rc = open_plain(from->path, &fd, err);

    if (rc != MODAL_OK)
        return rc;
    rc = mapping_open(fd, from->path, place, bytes, &out->map, err);
    close(fd);
    if (rc == MODAL_CORRUPT)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                                "dataset `%s` cannot be read: the file is truncated", from->set);
    out->batch.signals = out->map.data;
    out->batch.release = bytes > from->kept ? mapping_release : NULL;
    out->batch.spare = mapping_release;
    return rc;
}

static enum modal_status read_signals(hid_t set, const struct source *from, struct batch_file *out,
                                      struct modal_error *err)
{
    uint64_t place = from->kept < UINT64_MAX ? place_of(set) : 0;
    double memory = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);
    struct h5_numbers of = { .set = set, .name = from->set, .field = "signals",
                             .most = place > 0 ? (double)(SIZE_MAX / 4) : memory };
    enum modal_status rc = h5_numbers_look(&of, err);
    size_t count, bytes;

    if (rc == MODAL_OK && of.rank == 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "signals", "dataset `%s` is one number; "
                              "accepted: n_samples x n_channels, or n_samples", from->set);
    if (rc != MODAL_OK)
        return rc;
    out->batch.samples = (size_t)of.dims[0];
    out->batch.channels = (size_t)of.dims[1];
    count = out->batch.samples * out->batch.channels;
    bytes = count * sizeof *out->signals;
    if (place > 0 && (bytes > from->kept || bytes > MAPPED_LEAST))
        return map_signals(from, place, bytes, out, err);
    out->signals = malloc((count > 0 ? count : 1) * sizeof *out->signals);
    if (out->signals == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "batch: no memory for %zu samples", count);
    out->batch.signals = out->signals;
    return h5_numbers_read(&of, out->signals, err);
}

/* --- the file --- */

static enum modal_status open_file(const char *path, hid_t *out, struct modal_error *err)
{
    int fd = -1;
    enum modal_status rc = open_plain(path, &fd, err);

    if (rc != MODAL_OK)
        return rc;
    close(fd);
    if (H5Fis_hdf5(path) <= 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "file",
                                "%s is not an HDF5 file; accepted: HDF5, CSV, WAV, FLAC", path);
    *out = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    if (*out < 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "file",
                                "%s cannot be read as HDF5: it is truncated or damaged", path);
    return MODAL_OK;
}

static enum modal_status open_set(const struct source *from, hid_t file, hid_t *out,
                                  struct modal_error *err)
{
    *out = H5Dopen2(file, from->set, H5P_DEFAULT);
    if (*out < 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s has no dataset `%s`",
                                from->path, from->set);
    return MODAL_OK;
}

static enum modal_status read_all(hid_t set, hid_t root, const struct source *from,
                                  struct batch_file *out, struct modal_error *err)
{
    enum modal_status rc = read_signals(set, from, out, err);

    out->batch.dt = from->dt;
    if (rc == MODAL_OK)
        rc = read_time(set, root, "dt", !(from->dt > 0), &out->batch.dt, err);
    if (rc == MODAL_OK)
        rc = read_time(set, root, "period", false, &out->batch.period, err);
    if (rc == MODAL_OK)
        rc = read_names(set, root, out->batch.channels, &out->names, err);
    if (rc == MODAL_OK)
        rc = read_units(set, root, &out->units, err);
    if (rc != MODAL_OK)
        return rc;
    out->batch.names = (const char *const *)out->names;
    out->batch.units = out->units;
    out->attributes = read_attributes(set, root);
    return out->attributes != NULL
               ? MODAL_OK
               : modal_fail(err, MODAL_NO_MEMORY, "batch: no memory for its attributes");
}

enum modal_status batch_file_map(const char *path, const char *set_name, double dt,
                                 uint64_t kept, struct batch_file *out, struct modal_error *err)
{
    const struct source from = { path, set_name, dt, kept };
    hid_t file = H5I_INVALID_HID, root = H5I_INVALID_HID, set = H5I_INVALID_HID;
    struct batch_file read = { 0 };
    enum modal_status rc;

    batch_h5_lock();
    rc = open_file(path, &file, err);
    if (rc == MODAL_OK)
        rc = open_set(&from, file, &set, err);
    if (rc == MODAL_OK) {
        root = H5Gopen2(file, "/", H5P_DEFAULT);
        rc = read_all(set, root, &from, &read, err);
    }
    if (set >= 0)
        H5Dclose(set);
    if (root >= 0)
        H5Gclose(root);
    if (file >= 0)
        H5Fclose(file);
    batch_h5_unlock();
    if (rc == MODAL_OK)
        *out = read;
    else
        batch_file_done(&read);
    return rc;
}

enum modal_status batch_file_read(const char *path, const char *set, double dt,
                                  struct batch_file *out, struct modal_error *err)
{
    return batch_file_map(path, set, dt, UINT64_MAX, out, err);
}

void batch_file_done(struct batch_file *file)
{
    for (size_t i = 0; file->names != NULL && i < file->batch.channels; i++)
        free(file->names[i]);
    free(file->names);
    free(file->units);
    free(file->signals);
    mapping_close(&file->map);
    cJSON_Delete(file->attributes);
    memset(file, 0, sizeof *file);
}

/* A new file in the format of HDF5 1.8: an earlier one's attributes end at 64 kB, which 4096 names
 * of channels have. */
static hid_t make_file(const char *path)
{
    hid_t access = H5Pcreate(H5P_FILE_ACCESS), file = H5I_INVALID_HID;

    if (access >= 0 && H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_V18) >= 0)
        file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, access);
    if (access >= 0)
        H5Pclose(access);
    return file;
}

static enum modal_status write_file(const char *path, const struct batch *batch,
                                    const cJSON *attributes, struct modal_error *err)
{
    struct input_shape shape = { .type = INPUT_BATCH,
                                 .samples = batch->samples,
                                 .channels = batch->channels,
                                 .dt = batch->dt,
                                 .period = batch->period,
                                 .units = batch->units,
                                 .names = batch->names };
    hid_t file = make_file(path), set = H5I_INVALID_HID;
    enum modal_status rc;

    if (file < 0)
        return modal_fail_field(err, MODAL_IO, "file", "%s cannot be made", path);
    rc = batch_h5_make(file, &shape, attributes, &set, err);
    if (rc == MODAL_OK && input_bytes(&shape) > 0
        && H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, batch->signals) < 0)
        rc = modal_fail(err, MODAL_IO, "%s: HDF5 could not write the signals", path);
    if (set >= 0)
        H5Dclose(set);
    if (H5Fclose(file) < 0 && rc == MODAL_OK)
        rc = modal_fail(err, MODAL_IO, "%s: HDF5 could not close the file", path);
    return rc;
}

enum modal_status batch_file_write(const char *path, const struct batch *batch,
                                   const cJSON *attributes, struct modal_error *err)
{
    enum modal_status rc;

    batch_h5_lock();
    rc = write_file(path, batch, attributes, err);
    batch_h5_unlock();
    if (rc != MODAL_OK)
        unlink(path);
    return rc;
}
