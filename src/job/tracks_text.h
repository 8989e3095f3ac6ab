/* tracks_text.h - the tracks of a stream as a line of numbers, from window to window and over a
 * restart of the daemon */
#ifndef JOB_TRACKS_TEXT_H
#define JOB_TRACKS_TEXT_H
#include "base/error.h"
#include "modal/identify/live/track.h"

/* The caller frees; NULL: no memory. */
char *tracks_text_write(const struct tracks *t);

/* What tracks_text_write wrote, to 12 digits.  Where a track is none that tracks_follow leaves, or
 * the text is of an earlier version, all begin anew, and their numbers go on: a stream is not to be
 * without windows for the sake of a number.  Fails with MODAL_BAD_INPUT, field "tracks", where
 * these are not to be had either, and leaves *T as it was. */
enum modal_status tracks_text_read(const char *text, struct tracks *t, struct modal_error *err);
#endif
