/* signals.c - see signals.h */
#include "signals.h"
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include "csv.h"
#include "sound.h"
#include "store/batch_file.h"

enum { TEXT_MOST = 1 << 30 };     /* bytes: some 100 million numbers */

static enum modal_status no_file(const char *path, struct modal_error *err)
{
    return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: %s", path, strerror(errno));
}

/* Read to the end, doubling; a pipe has no size to ask for. */
static enum modal_status read_all(FILE *file, const char *path, size_t most, char **text,
                                  size_t *length, struct modal_error *err)
{
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

static enum modal_status read_hdf5(const char *path, const struct signals_options *options,
                                   struct signals *out, struct modal_error *err)
{
    struct batch_file file;
    enum modal_status rc = options->map && !(options->scale > 0)
                               ? batch_file_map(path, options->dt, mapping_resident_most(), &file,
                                                err)
                               : batch_file_read(path, options->dt, &file, err);

    if (rc != MODAL_OK)
        return rc;
    *out = (struct signals){ .samples = file.batch.samples, .channels = file.batch.channels,
                             .x = file.signals, .map = file.map, .dt = file.batch.dt,
                             .dt_off = SIGNALS_DT_OFF * file.batch.dt,
                             .dt_from = "its attribute `dt`", .period = file.batch.period,
                             .names = file.names, .units = file.units,
                             .attributes = file.attributes };
    return MODAL_OK;                                    /* everything the file held has moved */
}

enum file_kind { FILE_HDF5, FILE_SOUND, FILE_TEXT };

/* By its first bytes. */
static enum file_kind kind_of(const char *head, size_t length)
{
    static const struct { const char *magic; size_t length; enum file_kind kind; } kinds[] = {
        { "\x89HDF\r\n\x1a\n", 8, FILE_HDF5 }, { "RIFF", 4, FILE_SOUND }, { "RF64", 4, FILE_SOUND },
        { "fLaC", 4, FILE_SOUND }, { "FORM", 4, FILE_SOUND }, { "OggS", 4, FILE_SOUND },
    };

    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++)
        if (length >= kinds[i].length && memcmp(head, kinds[i].magic, kinds[i].length) == 0)
            return kinds[i].kind;
    return FILE_TEXT;
}

static enum modal_status read_csv(const char *path, const struct signals_options *options,
                                  struct signals *out, struct modal_error *err)
{
    char *text = NULL;
    size_t length = 0;
    enum modal_status rc = signals_read_text(path, TEXT_MOST, &text, &length, err);

    if (rc == MODAL_OK && kind_of(text, length) != FILE_TEXT)
        rc = modal_fail_field(
            err, MODAL_BAD_INPUT, "file",
            "%s: HDF5 and sound cannot be read from a pipe; accepted: text, or a file", path);
    if (rc == MODAL_OK && memchr(text, 0, length) != NULL)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "signals",
                              "%s: neither HDF5, WAV, FLAC nor text in UTF-8 or Latin-1", path);
    if (rc == MODAL_OK)
        rc = csv_read(text, path, options, out, err);
    free(text);
    return rc;
}

static bool ends_in(const char *path, const char *end)
{
    size_t length = strlen(path), n = strlen(end);

    return length > n && strcmp(path + length - n, end) == 0;
}

/* What PATH is, looked into only where that takes nothing away: a pipe is text. */
static enum modal_status look_at(const char *path, enum file_kind *kind, struct modal_error *err)
{
    char head[8] = "";
    struct stat about;
    FILE *file;
    size_t got;

    *kind = FILE_TEXT;
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
    *kind = kind_of(head, got);
    if (*kind == FILE_TEXT && (ends_in(path, ".h5") || ends_in(path, ".hdf5")))
        /* let the reader say what is wrong with it */
        *kind = FILE_HDF5;
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
        return modal_fail_field(err, MODAL_BAD_INPUT, "dt", "%s: no column of time; accepted: one "
                                "named t or time, or --dt SECONDS", path);
    if (given > 0 && read->dt > 0 && !options->ignore_time
        && !(fabs(given - read->dt) <= read->dt_off))
        return modal_fail_field(err, MODAL_BAD_INPUT, "dt", "%s: --dt is %.9g s, but %s says %.9g "
                                "s; accepted: that, or no --dt; --ignore-time takes "
                                "the rows as --dt apart", path, given, read->dt_from, read->dt);
    if (given > 0)
        read->dt = given;
    return MODAL_OK;
}

enum modal_status signals_read(const char *path, const struct signals_options *options,
                               struct signals *out, struct modal_error *err)
{
    struct signals read = { 0 };
    enum file_kind kind;
    enum modal_status rc = look_at(path, &kind, err);

    if (rc == MODAL_OK)
        rc = kind == FILE_HDF5    ? read_hdf5(path, options, &read, err)
             : kind == FILE_SOUND ? sound_read(path, &read, err)
                                  : read_csv(path, options, &read, err);
    if (rc == MODAL_OK)
        rc = settle_step(path, options, &read, err);
    for (size_t i = 0; rc == MODAL_OK && options->scale > 0 && i < read.samples * read.channels;
         i++)
        read.x[i] *= options->scale;
    if (rc == MODAL_OK)
        *out = read;
    else
        signals_done(&read);
    return rc;
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
                           .release = signals->map.data != NULL ? mapping_release : NULL };
}
