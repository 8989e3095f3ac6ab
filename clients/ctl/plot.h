/* plot.h - results as pictures: a small writer of SVG, and one drawing a kind of result
 *
 *   identify   damping over frequency with the bars of both; every order's frequencies (the
 *              stabilisation diagram); with signals at hand one channel with its reconstruction
 *   steady     spectrum and orbit; a curve: amplitude over the parameter, stable solid, unstable
 *              dashed, folds marked
 *   floquet    multipliers and the unit circle
 *   tradeoff   error over time, both logarithmic, the data's own bound as a line
 *   sweep      one value: the largest multiplier; two: where the system is stable (Strutt,
 *              Campbell)
 */
#ifndef CTL_PLOT_H
#define CTL_PLOT_H
#include "base/error.h"
#include "base/json.h"
#include "svg.h"

/* What a picture may show beside the result; all borrowed. */
struct plot_input {
    /* draws one panel more of an identification: its signals.  NULL: they are not at hand */
    void (*history)(struct svg *svg, const cJSON *result, const void *of);
    const void *of;
    const cJSON *scene;      /* of a sweep whose result has no grid; NULL: none */
};

/* Has a result of KIND a picture? */
bool plot_is_of(const char *kind);

/* Draw RESULT of a job of KIND into FILE, whose failures are FILE's to tell; INPUT may be NULL.
 * MODAL_BAD_INPUT, field "plot": nothing to draw in this kind of result. */
enum modal_status plot_draw(FILE *file, const char *kind, const cJSON *result,
                            const struct plot_input *input, struct modal_error *err);

#endif
