/* input.c - see input.h */
#include "input.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/near.h"
#include "base/sha256.h"
#include "option.h"
#include "scene_file.h"
#include "store/identity.h"

static const char suffix[] = ".json";        /* of a scene */

/* A batch that is larger than the memory limit. */
static void hash_in_order(const struct batch *b, const struct input_shape *shape,
                          uint8_t digest[32])
{
    const size_t part = (size_t)1 << 19, count = b->samples * b->channels;
    struct sha256 hash;

    identity_begin(&hash, shape);
    for (size_t i = 0, n; i < count; i += n) {
        n = count - i < part ? count - i : part;
        sha256_add(&hash, b->signals + i, n * sizeof *b->signals);
        b->release(b->signals + i, n * sizeof *b->signals);
    }
    sha256_end(&hash, digest);
}

static void hash(struct input *input)
{
    struct input_shape shape = { .type = INPUT_SCENE };
    const void *data = input->scene_text;
    size_t length;
    uint8_t digest[32];

    if (input->scene != NULL) {
        shape.length = length = input->scene_length;
    } else {
        shape = (struct input_shape){ .type = INPUT_BATCH, .samples = input->batch.samples,
                                      .channels = input->batch.channels, .dt = input->batch.dt,
                                      .period = input->batch.period, .units = input->batch.units,
                                      .names = input->batch.names };
        data = input->batch.signals;
        length = input->batch.samples * input->batch.channels * sizeof(double);
    }
    if (input->batch.release != NULL)
        hash_in_order(&input->batch, &shape, digest);
    else
        identity_of(&shape, data, length, digest);
    sha256_hex(digest, input->sha256);
}

static enum modal_status read_scene(const char *path, struct input *out, struct modal_error *err)
{
    struct scene_arrays_made arrays = { 0 };
    enum modal_status rc = scene_file_read(path, &out->scene, &arrays, err);
    char *text = rc == MODAL_OK ? json_print(out->scene) : NULL, *whole = NULL;
    size_t length = text != NULL ? strlen(text) : 0;

    if (text != NULL)
        whole = realloc(text, length + arrays.length + 1);
    if (rc == MODAL_OK && whole == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "%s: no memory for the scene", path);
    if (whole == NULL)
        free(text);
    else if (arrays.length > 0)
        memcpy(whole + length, arrays.data, arrays.length);
    free(arrays.data);
    out->scene_text = whole;
    out->scene_length = length + arrays.length;
    if (whole != NULL)
        scene_arrays_split(whole, out->scene_length, &out->arrays);
    return rc;
}

static enum modal_status read_batch(const char *path, const struct args *args, struct input *out,
                                    struct modal_error *err)
{
    struct signals_options options = { .dataset = args->dataset, .dt = args->dt,
                                       .ignore_time = args->ignore_time,
                                       .scale = args->scale, .map = args->local };
    enum modal_status rc = signals_read(path, &options, &out->signals, err);

    out->batch = signals_batch(&out->signals);
    if (rc == MODAL_OK && out->signals.preamble > 0)
        fprintf(stderr, "modalctl: %s: %zu lines before the columns were passed over\n", path,
                out->signals.preamble);
    if (rc == MODAL_OK && out->signals.open_end)
        fprintf(stderr, "modalctl: %s: its last line has no end, so it may be cut short: %zu "
                "samples were read\n", path, out->signals.samples);
    return rc;
}

/* Is a tradeoff's input a scene?  By what it is of; else by the file's first byte that is not
 * blank. */
static bool wants_scene(const struct input *input, const char *of, const char *path)
{
    if (input->kind->input != JOB_ON_EITHER)
        return input->kind->input == JOB_ON_SCENE;
    if (of == NULL)
        of = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(input->options, "of"));
    if (of != NULL)
        return strcmp(of, "identify") != 0;
    size_t length = strlen(path), own = strlen(suffix);
    return length > own && strcmp(path + length - own, suffix) == 0;
}

static enum modal_status find_kind(const char *name, struct input *out, struct modal_error *err)
{
    struct job_result unused;
    struct job_request request = { .kind = name };

    out->kind = job_kind_find(name);
    /* whose message lists the kinds */
    return out->kind != NULL ? MODAL_OK : job_run(&request, &unused, err);
}

/* What a tradeoff is of, before a file is read as the wrong thing. */
static enum modal_status check_of(const char *of, struct modal_error *err)
{
    static const char *const names[] = { "identify", "steady", "simulate", NULL };
    char list[NEAR_ACCEPTED];

    for (int i = 0; names[i] != NULL; i++)
        if (strcmp(of, names[i]) == 0)
            return MODAL_OK;
    near_accepted(of, names, list);
    return modal_fail_field(err, MODAL_BAD_INPUT, "of", "no tradeoff of \"%.40s\"%s", of, list);
}

enum modal_status input_read(const char *kind, const char *of, const char *path,
                             const struct args *args, struct input *out, struct modal_error *err)
{
    const char *stream = stored_stream(path);
    enum modal_status rc;

    *out = (struct input) { .options = args->options };
    rc = find_kind(kind, out, err);
    if (rc == MODAL_OK && of != NULL)
        rc = check_of(of, err);
    if (rc == MODAL_OK && of != NULL) {
        out->own_options = cJSON_Duplicate(args->options, true);
        out->options = out->own_options;
        rc = option_set_text(out->own_options, "of", of, err);
    }
    if (rc == MODAL_OK)
        rc = wants_scene(out, of, path) ? read_scene(path, out, err)
             : stream != NULL           ? stored_find(stream, args, out->stored, err)
                                        : read_batch(path, args, out, err);
    if (rc == MODAL_OK && out->stored[0] == 0)
        hash(out);
    if (rc != MODAL_OK)
        input_done(out);
    return rc;
}

void input_done(struct input *input)
{
    signals_done(&input->signals);
    cJSON_Delete(input->scene);
    free(input->scene_text);
    cJSON_Delete(input->own_options);
    *input = (struct input) { 0 };
}
