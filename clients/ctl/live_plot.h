/* live_plot.h - the modes of a stream's windows as a picture that grows: frequency and damping over
 * the last sample, with their bars, a line through each track */
#ifndef CTL_LIVE_PLOT_H
#define CTL_LIVE_PLOT_H
#include "base/error.h"
#include "base/json.h"

enum { LIVE_DOTS = 4096 };                /* the oldest go first */

/* `at`: the last sample of a window, in seconds where the events say how far samples are apart. */
struct live_dot { double at, hertz, hertz_std, zeta, zeta_std, track; bool unstable; };
struct live_plot { struct live_dot dots[LIVE_DOTS]; int count; double epoch; bool seconds; };

/* An event of the stream: where it has modes they join the picture, and it is written to PATH in
 * one piece, so that who looks sees a whole one.  Fails with MODAL_BAD_INPUT, field "plot": it
 * cannot be written. */
enum modal_status live_plot_add(struct live_plot *plot, const char *path, const cJSON *event,
                                struct modal_error *err);
#endif
