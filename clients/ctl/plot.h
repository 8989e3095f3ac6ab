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
#include "input.h"

/* Is PATH a name for a picture in a file: FILE.svg?  Else MODAL_BAD_INPUT, field "plot". */
enum modal_status plot_path_check(const char *path, struct modal_error *err);

/* Draw RESULT of a job of KIND into the file PATH, "-" for stdout.
 * INPUT is what it ran on, NULL: not at hand.
 * MODAL_BAD_INPUT, field "plot": nothing to draw in this kind of result; MODAL_IO. */
enum modal_status plot_result(const char *path, const char *kind, const cJSON *result,
                              const struct input *input, struct modal_error *err);

#endif
