/* sound.h - a sound file (WAV, FLAC) as signals, by libsndfile: samples in -1 .. 1, dt from the
 * sample rate */
#ifndef CTL_SOUND_H
#define CTL_SOUND_H
#include "signals.h"

/* PATH into *OUT (signals_done frees it).  MODAL_BAD_INPUT, field "file": no sound file, damaged,
 * too large; MODAL_NO_MEMORY. */
enum modal_status sound_read(const char *path, const struct signals_options *options,
                             struct signals *out, struct modal_error *err);
bool sound_is(const unsigned char *head, size_t length);

#endif
