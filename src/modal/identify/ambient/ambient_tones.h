/* ambient_tones.h - lines of constant amplitude among modes, told by the model of these */
#ifndef MODAL_AMBIENT_TONES_H
#define MODAL_AMBIENT_TONES_H
#include "modal/identify/ambient/ambient_lines.h"
#include "modal/identify/ambient/ambient_order.h"
#include "modal/identify/prepare/pod.h"

/* Of the columns Y, reduced to POD, SPECTRUM is that of what is left beside COUNT lines, and MODEL
 * was fitted to it, in BINS. */
struct ambient_tones_input {
    struct matrix *Y;
    const struct pod *pod;
    const struct spectrum *spectrum;
    const struct whittle *model;
    const struct bins *bins;
    bool (*cancelled)(void *context);
    void *context;
};

/*
 * From Y, as long as LINE has room: sinusoids that stand out of what is about them by more than
 * chance and leave no more than it; those that a narrow pair of the model was fitted to, where one
 * sinusoid is likelier; and those that a mode's peak hides.  Of LINE those move that the noise that
 * the model has would have elsewhere.  *changed: there were some.  Fails with MODAL_NO_MEMORY,
 * MODAL_CANCELLED.
 */
enum modal_status ambient_tones_take(const struct ambient_tones_input *in,
                                     struct ambient_line *line, int *count, bool *changed,
                                     struct modal_error *err);
#endif
