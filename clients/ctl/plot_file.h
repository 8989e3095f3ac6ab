/* plot_file.h - a result's picture in a file, with the signals it was found in */
#ifndef CTL_PLOT_FILE_H
#define CTL_PLOT_FILE_H
#include "input.h"

/* Is PATH a name for a picture in a file: FILE.svg?  Else MODAL_BAD_INPUT, field "plot". */
enum modal_status plot_path_check(const char *path, struct modal_error *err);

/* Draw RESULT of a job of KIND into the file PATH, "-" for stdout.
 * INPUT is what it ran on, NULL: not at hand.
 * MODAL_BAD_INPUT, field "plot": nothing to draw in this kind of result; MODAL_IO. */
enum modal_status plot_result(const char *path, const char *kind, const cJSON *result,
                              const struct input *input, struct modal_error *err);

#endif
