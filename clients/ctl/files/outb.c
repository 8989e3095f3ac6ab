/* outb.c - see outb.h
 *
 * Little endian throughout: the form (16 bits: 1 with packed times, 2 with a step, 3 with a step
 * and doubles, 4 as 2 with names of a length that follows), the number of channels and of samples
 * (32 bits), two doubles (1: scale and offset of times; else the first time and the step), but in
 * form 3 a scale and an offset of each channel (singles), the length of a description, that, names
 * and then units of time and each channel, in form 1 the times (32 bits), the samples.  A number is
 * (packed - offset) / scale.
 */
#include "outb.h"
#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/utf8.h"
#include "steps.h"

enum {
    WITH_TIMES = 1,                             /* forms */
    DOUBLES    = 3,                             /* nothing packed */
    NAMES_TOLD = 4,                             /* how long they are */
    NAME_BYTES = 10,                            /* where the form does not tell */
    NAME_MOST  = 1000,                          /* bytes: OpenFAST's are 20 */
};

static const struct number_type i16 = { NUMBER_INT, 2, false }, i32 = { NUMBER_INT, 4, false },
                                f32 = { NUMBER_FLOAT, 4, false }, f64 = { NUMBER_FLOAT, 8, false };

/* A file taken apart: everything points into it. */
struct outb {
    size_t form, name, channels, samples;
    double first, second;
    const unsigned char *scales, *offsets, *names, *units, *times, *packed;
};

bool outb_is(const unsigned char *head, size_t length)
{
    return length >= 2 && head[0] >= WITH_TIMES && head[0] <= NAMES_TOLD && head[1] == 0;
}

/* COUNT pieces of SIZE bytes each. */
static const unsigned char *pieces(struct bytes *file, size_t count, size_t size)
{
    return count <= bytes_left(file) / size ? bytes_next(file, count * size) : NULL;
}

/* False where the file is too short for what it announces. */
static bool take_apart(struct bytes *file, struct outb *o)
{
    const unsigned char *two;
    size_t description;

    o->name = NAME_BYTES;
    if (!bytes_size(file, i16, &o->form) || (o->form == NAMES_TOLD
                                             && !bytes_size(file, i16, &o->name)))
        return false;
    if (!bytes_size(file, i32, &o->channels) || !bytes_size(file, i32, &o->samples)
        || (two = pieces(file, 2, sizeof(double))) == NULL)
        return false;
    o->first = number_decode(f64, two);
    o->second = number_decode(f64, two + sizeof(double));
    if (o->form != DOUBLES
        && ((o->scales = pieces(file, o->channels, sizeof(float))) == NULL
            || (o->offsets = pieces(file, o->channels, sizeof(float))) == NULL))
        return false;
    if (!bytes_size(file, i32, &description) || bytes_next(file, description) == NULL
        || o->name == 0 || o->name > NAME_MOST)
        return false;
    o->names = pieces(file, o->channels + 1, o->name);
    o->units = pieces(file, o->channels + 1, o->name);
    if (o->form == WITH_TIMES)
        o->times = pieces(file, o->samples, (size_t)i32.size);
    if (o->names == NULL || o->units == NULL || (o->form == WITH_TIMES && o->times == NULL))
        return false;
    size_t wide = o->form == DOUBLES ? sizeof(double) : (size_t)i16.size;
    if (o->channels == 0 || o->samples == 0
        || o->samples > bytes_left(file) / wide / o->channels)
        return false;
    o->packed = bytes_next(file, o->samples * o->channels * wide);
    return bytes_left(file) == 0;
}

static enum modal_status unpack(const struct outb *o, const char *path, double *x,
                                struct modal_error *err)
{
    size_t wide = o->form == DOUBLES ? sizeof(double) : (size_t)i16.size;

    for (size_t c = 0; c < o->channels; c++) {
        double scale = 1, offset = 0;
        if (o->form != DOUBLES) {
            scale = number_decode(f32, o->scales + c * sizeof(float));
            offset = number_decode(f32, o->offsets + c * sizeof(float));
        }
        if (!isfinite(scale) || !isfinite(offset) || scale == 0)
            return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: channel %zu has scale %g "
                                    "and offset %g; accepted: finite ones, no scale of 0", path,
                                    c + 1, scale, offset);
        for (size_t k = 0; k < o->samples; k++) {
            const unsigned char *from = o->packed + (k * o->channels + c) * wide;
            x[k * o->channels + c] = o->form == DOUBLES
                                         ? number_decode(f64, from)
                                         : (number_decode(i16, from) - offset) / scale;
        }
    }
    return MODAL_OK;
}

static enum modal_status read_times(const struct outb *o, const char *path,
                                    const struct signals_options *options, struct signals *out,
                                    struct modal_error *err)
{
    double *t, digits = 1.0 / (double)INT32_MAX;            /* packed over the record */
    char unit[NAME_MOST + 1];
    enum modal_status rc;

    snprintf(unit, sizeof unit, "%.*s", (int)o->name, (const char *)o->units);
    rc = steps_unit_check(steps_unit(unit), path, "its column of time", options, err);
    if (rc != MODAL_OK)
        return rc;
    if (o->form != WITH_TIMES) {
        out->dt = o->second;
        out->dt_off = SIGNALS_DT_OFF * out->dt;
        out->dt_from = "its step";
        if (isfinite(o->second) && o->second > 0)
            return MODAL_OK;
        return modal_fail_field(err, MODAL_BAD_INPUT, "dt", "%s has a step of %g s; accepted: a "
                                "positive one", path, o->second);
    }
    t = malloc(o->samples * sizeof *t);
    if (t == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for %zu times", path, o->samples);
    numbers_decode(i32, o->times, o->samples, t);
    for (size_t k = 0; k < o->samples; k++)
        t[k] = (t[k] - o->second) / o->first;
    rc = steps_read(t, o->samples, digits, path, "its array of times", options, out, err);
    free(t);
    return rc;
}

/* The text of NAME bytes at FROM, without what pads it; the caller frees it. */
static char *text_of(const unsigned char *from, size_t name)
{
    size_t length = strnlen((const char *)from, name);

    while (length > 0 && isspace(from[length - 1]))
        length--;
    while (length > 0 && isspace(*from))
        from++, length--;
    return utf8_from((const char *)from, length);
}

/* Names of channels, and their unit where it is one; those of time come first in the file. */
static void read_names(const struct outb *o, struct signals *out)
{
    const unsigned char *unit = o->units + o->name;
    bool same = true;

    out->names = calloc(o->channels, sizeof *out->names);
    for (size_t c = 0; out->names != NULL && c < o->channels; c++) {
        out->names[c] = text_of(o->names + (c + 1) * o->name, o->name);
        same = same && memcmp(unit, unit + c * o->name, o->name) == 0;
    }
    out->units = same ? text_of(unit, o->name) : NULL;
}

enum modal_status outb_read(struct bytes file, const char *path,
                            const struct signals_options *options, struct signals *out,
                            struct modal_error *err)
{
    struct outb o = { 0 };
    enum modal_status rc;

    if (!take_apart(&file, &o))
        return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: %zu channels x %zu samples of "
                                "OpenFAST's form %zu do not make its %zu bytes: it is cut short or "
                                "damaged; accepted: a whole .outb file", path, o.channels,
                                o.samples, o.form, file.length);
    out->samples = o.samples;
    out->channels = o.channels;
    out->x = malloc(o.samples * o.channels * sizeof *out->x);
    if (out->x == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for %zu x %zu numbers", path,
                          o.samples, o.channels);
    rc = unpack(&o, path, out->x, err);
    if (rc == MODAL_OK)
        rc = read_times(&o, path, options, out, err);
    if (rc == MODAL_OK)
        read_names(&o, out);
    return rc;
}
