/* identify_options.h - the options of the kind `identify`: from JSON, and written back with their defaults */
#ifndef JOB_IDENTIFY_OPTIONS_H
#define JOB_IDENTIFY_OPTIONS_H
#include "modal/batch.h"
#include "modal/identify/identify.h"
#include "base/json.h"

/*
 * identify's options, each a key of the flat object `options` ("rank.fixed"); an object ("rank": {"fixed": 6}) is taken as its dotted keys.
 * `channels` is the caller's to free: opt->channels points to it.  Unknown keys, wrong types and values out of range are MODAL_BAD_INPUT
 * with the option as field.
 */
enum modal_status identify_options_read(const cJSON *options, const struct batch *batch, struct identify_options *opt, int *threads,
                                        int **channels, struct modal_error *err);

/* Every option with its value after defaults, as it can be pasted back. */
cJSON *identify_options_write(const struct identify_options *used, const cJSON *asked, int threads);
#endif
