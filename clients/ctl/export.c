/* export.c - signals of a file, as identify reads them, of a stream or of a job, to a file of
 * ours */
#include <stdio.h>
#include "input.h"
#include "outcome.h"
#include "output.h"
#include "stored.h"
#include "verbs.h"
#include "whole_file.h"

/* A file that is there goes before a job of that name. */
static enum modal_status read_what(const struct args *args, struct input *input,
                                   struct modal_error *err)
{
    enum modal_status rc;

    if (!stored_is(args->word[1]))
        return input_read("identify", NULL, args->word[1], args, input, err);
    rc = stored_read(args->word[1], args, &input->signals, err);
    input->batch = signals_batch(&input->signals);
    return rc;
}

/* HDF5 keeps what else the file said; CSV has no place for it. */
static enum modal_status write_signals(const struct input *input, const char *path,
                                       struct modal_error *err)
{
    cJSON *doc = cJSON_CreateObject();
    enum modal_status rc;

    if (input->signals.attributes != NULL)
        cJSON_AddItemReferenceToObject(doc, "provenance", input->signals.attributes);
    rc = output_write(path, doc, &input->batch, err);
    cJSON_Delete(doc);
    return rc;
}

static enum modal_status say(const struct input *input, const struct args *args,
                             struct modal_error *err)
{
    const struct batch *b = &input->batch;
    cJSON *doc = NULL;
    enum modal_status rc;

    if (!args->json) {
        printf("%s: %zu samples of %zu channels, %g s apart\n", args->output, b->samples,
               b->channels, b->dt);
        return MODAL_OK;
    }
    doc = cJSON_CreateObject();
    cJSON_AddStringToObject(doc, "output", args->output);
    cJSON_AddNumberToObject(doc, "samples", (double)b->samples);
    cJSON_AddNumberToObject(doc, "channels", (double)b->channels);
    cJSON_AddNumberToObject(doc, "dt", b->dt);
    rc = outcome_json(doc, err);
    cJSON_Delete(doc);
    return rc;
}

int run_export(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    struct input input = { 0 };
    enum modal_status rc;

    (void)verb;
    rc = args->output == NULL ? modal_fail_field(&err, MODAL_BAD_INPUT, "output",
                                                 "-O OUT.h5 or -O OUT.csv is needed")
                              : output_check(args->output, &err);
    if (rc == MODAL_OK)
        rc = whole_file_check(args->output, "output", &err);
    if (rc == MODAL_OK)
        rc = read_what(args, &input, &err);
    if (rc == MODAL_OK && input.batch.dt == 0)
        rc = modal_fail_field(&err, MODAL_BAD_INPUT, "dt", "%.300s does not say its step; "
                              "accepted: --dt SECONDS", args->word[1]);
    if (rc == MODAL_OK)
        rc = write_signals(&input, args->output, &err);
    if (rc == MODAL_OK)
        rc = say(&input, args, &err);
    input_done(&input);
    return rc == MODAL_OK ? 0 : outcome_failure(args->json, &err, NULL);
}
