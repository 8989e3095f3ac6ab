/* sound.h - a sound file (WAV, FLAC) as signals, by libsndfile: samples in -1 .. 1, dt from the
 * sample rate */
#ifndef CTL_SOUND_H
#define CTL_SOUND_H
#include "signals.h"

enum modal_status sound_read(const char *path, struct signals *out, struct modal_error *err);

#endif
