/* identify_options.h - the options of the kind `identify`: from JSON, once, and written back with
 * their defaults */
#ifndef JOB_IDENTIFY_OPTIONS_H
#define JOB_IDENTIFY_OPTIONS_H
#include "base/key_table.h"
#include "modal/batch.h"
#include "modal/identify/identify.h"

/* What a job is to do: every option, checked. */
struct identify_settings {
    struct identify_options opt;      /* clock, cancelled and context are the caller's to set */
    int threads;
    int *channels;                    /* owned: opt.channels points to it; NULL: all */
    int *inputs;                      /* owned: opt.inputs points to it; NULL: none */
    double *starts;                   /* owned: opt.starts points to it; NULL: none */
    int *azimuth;                     /* owned: opt.azimuth points to it; NULL: none */
    bool refine;                      /* as it was given, for opt.refine */
};

extern const struct key_row identify_option_rows[];

/*
 * OPTIONS (NULL: none) are flat ("rank.fixed"); an object ("rank": {"fixed": 6}) is taken as its
 * dotted keys.  Channels are looked up in BATCH, whose samples are not looked at.
 * identify_settings_done frees what *OUT holds.  Unknown keys, wrong types and values out of range
 * are MODAL_BAD_INPUT with the option as field; *OUT is empty then.
 */
enum modal_status identify_options_read(const cJSON *options, const struct batch *batch,
                                        struct identify_settings *out, struct modal_error *err);
void identify_settings_done(struct identify_settings *settings);

/* Every option with the value that was USED, channels and times as they were ASKED for (NULL: not),
 * fit to be pasted back; the caller's. */
cJSON *identify_options_write(const struct identify_options *used, const cJSON *asked, int threads);
#endif
