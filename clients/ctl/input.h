/* input.h - what a job of some kind runs on, read from the user's file */
#ifndef CTL_INPUT_H
#define CTL_INPUT_H
#include "args.h"
#include "job/job.h"
#include "modal/scene/scene_arrays.h"
#include "signals.h"
#include "stored.h"

struct input {
    const struct job_kind *kind;
    const cJSON *options;            /* borrowed from the arguments, or own_options */
    cJSON *own_options;
    struct signals signals;          /* of a batch */
    struct batch batch;              /* a view of it; samples 0 and `scene` not NULL: a scene */
    cJSON *scene;
    char *scene_text;                /* as it is sent, SCENE_LENGTH bytes */
    size_t scene_length;
    struct scene_arrays arrays;      /* behind the text, in it */
    char sha256[65];                 /* store/identity.h */
    char stored[STORED_NAME_ROOM];   /* "stream:NAME": what the daemon calls its batch; else "" */
};

/*
 * Read PATH, or find what "stream:NAME" is, for a job of kind KIND; of a `tradeoff`, OF says what
 * it is of (NULL: the option `of`, else by the file).  input_done frees it.  MODAL_BAD_INPUT names
 * "kind", "file" or what is wrong inside.
 */
enum modal_status input_read(const char *kind, const char *of, const char *path,
                             const struct args *args, struct input *out, struct modal_error *err);
void input_done(struct input *input);

#endif
