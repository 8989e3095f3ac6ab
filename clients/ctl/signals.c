/* signals.c - see signals.h */
#include "signals.h"
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include "csv.h"
#include "files/hdf5.h"
#include "files/matlab.h"
#include "files/numpy.h"
#include "files/outb.h"
#include "files/uff.h"
#include "sound.h"

enum { TEXT_MOST = 1 << 30 };             /* bytes: some 100 million numbers */
#define FILE_MOST ((size_t)1 << 32)       /* bytes of a file that is read into memory as a whole */

static enum modal_status no_file(const char *path, struct modal_error *err)
{
    return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: %s", path, strerror(errno));
}

/* Read to the end, doubling; a pipe has no size to ask for. */
static enum modal_status read_all(FILE *file, const char *path, size_t most, char **text,
                                  size_t *length, struct modal_error *err)
{
    static const char mark[] = "\xef\xbb\xbf";           /* which editors put before UTF-8 */
    size_t room = 1 << 16, used = 0, got;
    char *bytes = malloc(room + 1);

    while (bytes != NULL && (got = fread(bytes + used, 1, room - used, file)) > 0) {
        used += got;
        if (used < room)
            continue;
        char *larger = room < most ? realloc(bytes, 2 * room + 1) : NULL;
        if (larger == NULL) {
            free(bytes);
            return modal_fail_field(err, MODAL_TOO_LARGE, "file", "%s: more than %zu bytes", path,
                                    most);
        }
        bytes = larger;
        room *= 2;
    }
    if (bytes == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory", path);
    if (ferror(file)) {
        free(bytes);
        return no_file(path, err);
    }
    bytes[used] = 0;
    if (strncmp(bytes, mark, strlen(mark)) == 0) {
        used -= strlen(mark);
        memmove(bytes, bytes + strlen(mark), used + 1);
    }
    *text = bytes;
    *length = used;
    return MODAL_OK;
}

enum modal_status signals_read_text(const char *path, size_t most, char **text, size_t *length,
                                    struct modal_error *err)
{
    FILE *file = strcmp(path, "-") == 0 ? stdin : fopen(path, "rb");
    enum modal_status rc;

    if (file == NULL)
        return no_file(path, err);
    rc = read_all(file, path, most, text, length, err);
    if (file != stdin)
        fclose(file);
    return rc;
}

/* Files by what they are: read by a library from their place, or here from memory. */
static const struct format {
    bool (*is)(const unsigned char *head, size_t length);
    enum modal_status (*open)(const char *path, const struct signals_options *options,
                              struct signals *out, struct modal_error *err);
    enum modal_status (*read)(struct bytes file, const char *path,
                              const struct signals_options *options, struct signals *out,
                              struct modal_error *err);
    bool arrays;                               /* several, with names: --dataset */
} formats[] = {
    { hdf5_is,   hdf5_read,  NULL,        true },
    { sound_is,  sound_read, NULL,        false },
    { matlab_is, NULL,       matlab_read, true },
    { npy_is,    NULL,       npy_read,    false },
    { npz_is,    NULL,       npz_read,    true },
    { uff_is,    NULL,       uff_read,    false },
    { outb_is,   NULL,       outb_read,   false },
};

/* NULL: text. */
static const struct format *format_of(const unsigned char *head, size_t length)
{
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++)
        if (formats[i].is(head, length))
            return &formats[i];
    return NULL;
}

static enum modal_status check_dataset(const char *path, const struct format *format,
                                       const struct signals_options *options,
                                       struct modal_error *err)
{
    if (options->dataset == NULL || (format != NULL && format->arrays))
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, "dataset", "%s: no file of named arrays; "
                            "accepted: --dataset with HDF5, MATLAB and NPZ", path);
}

enum modal_status signals_check_text(const char *text, size_t length, const char *path,
                                     const char *field, const char *accepted,
                                     struct modal_error *err)
{
    if (length >= 2 && (memcmp(text, "\xff\xfe", 2) == 0 || memcmp(text, "\xfe\xff", 2) == 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s: text in UTF-16; accepted: "
                                "%s, in which other programs save it too", path, accepted);
    return MODAL_OK;
}

static enum modal_status read_text(char *text, size_t length, const char *path,
                                   const struct signals_options *options, struct signals *out,
                                   struct modal_error *err)
{
    if (length > TEXT_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "file", "%s: more than %d bytes of text",
                                path, TEXT_MOST);
    enum modal_status rc = signals_check_text(text, length, path, "signals", "UTF-8 or Latin-1",
                                              err);
    if (rc != MODAL_OK)
        return rc;
    if (memchr(text, 0, length) != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s: neither text in UTF-8 or "
                                "Latin-1 nor anything else that is known; accepted: "
                                SIGNALS_FILES, path);
    if (text[strspn(text, " \t\r\n")] == '{')
        return modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s is JSON, as scenes are, and "
                                "no signals; accepted: " SIGNALS_FILES "; scenes with steady, "
                                "simulate, floquet", path);
    out->open_end = length > 0 && text[length - 1] != '\n';
    return csv_read(text, path, options, out, NULL, err);
}

/* What is read into memory first: also of a pipe. */
static enum modal_status read_bytes(const char *path, const struct signals_options *options,
                                    struct signals *out, struct modal_error *err)
{
    const struct format *format = NULL;
    char *text = NULL;
    size_t length = 0;
    enum modal_status rc = signals_read_text(path, FILE_MOST, &text, &length, err);

    if (rc == MODAL_OK) {
        format = format_of((const unsigned char *)text, length);
        rc = check_dataset(path, format, options, err);
    }
    if (rc == MODAL_OK && format != NULL && format->read == NULL)
        rc = modal_fail_field(
            err, MODAL_BAD_INPUT, "file",
            "%s: HDF5 and sound cannot be read from a pipe; accepted: any other, or a file", path);
    if (rc == MODAL_OK)
        rc = format == NULL
                 ? read_text(text, length, path, options, out, err)
                 : format->read((struct bytes) { (unsigned char *)text, length, 0 }, path, options,
                                out, err);
    free(text);
    return rc;
}

static bool ends_in(const char *path, const char *end)
{
    size_t length = strlen(path), n = strlen(end);

    return length > n && strcmp(path + length - n, end) == 0;
}

/* Who opens PATH itself, or NULL; looked into only where that takes nothing away. */
static enum modal_status look_at(const char *path, const struct format **out,
                                 struct modal_error *err)
{
    unsigned char head[HDF5_HEAD_BYTES];
    struct stat about;
    FILE *file;
    size_t got;

    *out = NULL;
    if (strcmp(path, "-") == 0)
        return MODAL_OK;
    if (stat(path, &about) != 0 || (S_ISDIR(about.st_mode) && (errno = EISDIR)))
        return no_file(path, err);
    if (!S_ISREG(about.st_mode))
        return MODAL_OK;
    file = fopen(path, "rb");
    if (file == NULL)
        return no_file(path, err);
    got = fread(head, 1, sizeof head, file);
    fclose(file);
    *out = format_of(head, got);
    if (*out == NULL && (ends_in(path, ".h5") || ends_in(path, ".hdf5")))
        *out = &formats[0];                    /* let the reader say what is wrong with it */
    if (*out != NULL && (*out)->open == NULL)
        *out = NULL;
    return MODAL_OK;
}

/* The step that was given against the one that the file says; one of them holds. */
static enum modal_status settle_step(const char *path, const struct signals_options *options,
                                     struct signals *read, struct modal_error *err)
{
    double given = options->dt;

    if (!(given > 0) && options->ignore_time)
        return modal_fail_field(err, MODAL_BAD_INPUT, "dt", "%s: --ignore-time needs --dt SECONDS",
                                path);
    if (!(given > 0) && !(read->dt > 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "dt", "%s: nothing says the step; accepted: "
                                "a column or an array named t or time, a dt, fs or Fs beside the "
                                "array, or --dt SECONDS", path);
    if (given > 0 && read->dt > 0 && !options->ignore_time
        && !(fabs(given - read->dt) <= read->dt_off))
        return modal_fail_field(err, MODAL_BAD_INPUT, "dt", "%s: --dt is %.9g s, but %s says %.9g "
                                "s; accepted: that, or no --dt; --ignore-time takes "
                                "the rows as --dt apart", path, given, read->dt_from, read->dt);
    if (given > 0)
        read->dt = given;
    return MODAL_OK;
}

static void apply_scale(const struct signals_options *options, struct signals *read)
{
    for (size_t i = 0; options->scale > 0 && i < read->samples * read->channels; i++)
        read->x[i] *= options->scale;
}

/* *OUT is what was READ, in its step and scale, or nothing; RC is how it was read. */
static enum modal_status finish(enum modal_status rc, const char *path,
                                const struct signals_options *options, struct signals *read,
                                struct signals *out, struct modal_error *err)
{
    if (rc == MODAL_OK)
        rc = settle_step(path, options, read, err);
    if (rc == MODAL_OK) {
        apply_scale(options, read);
        *out = *read;
    } else
        signals_done(read);
    return rc;
}

enum modal_status signals_read_rows(char *text, const char *path,
                                    const struct signals_options *options, struct signals *out,
                                    struct csv_shape *shape, struct modal_error *err)
{
    struct signals read = { 0 };
    enum modal_status rc = csv_read(text, path, options, &read, shape, err);

    return finish(rc, path, options, &read, out, err);
}

enum modal_status signals_read(const char *path, const struct signals_options *options,
                               struct signals *out, struct modal_error *err)
{
    struct signals read = { 0 };
    const struct format *format;
    enum modal_status rc = look_at(path, &format, err);

    if (rc == MODAL_OK && format != NULL)
        rc = check_dataset(path, format, options, err);
    if (rc == MODAL_OK)
        rc = format != NULL ? format->open(path, options, &read, err)
                            : read_bytes(path, options, &read, err);
    return finish(rc, path, options, &read, out, err);
}

void signals_done(struct signals *signals)
{
    free(signals->x);
    mapping_close(&signals->map);
    for (size_t i = 0; signals->names != NULL && i < signals->channels; i++)
        free(signals->names[i]);
    free(signals->names);
    free(signals->units);
    cJSON_Delete(signals->attributes);
    *signals = (struct signals) { 0 };
}

struct batch signals_batch(const struct signals *signals)
{
    return (struct batch){ .samples = signals->samples, .channels = signals->channels,
                           .signals = signals->x != NULL ? signals->x : signals->map.data,
                           .dt = signals->dt, .period = signals->period,
                           .names = (const char *const *)signals->names, .units = signals->units,
                           .release = signals->map.length > mapping_resident_most()
                                          ? mapping_release : NULL,
                           .spare = signals->map.data != NULL ? mapping_release : NULL };
}
