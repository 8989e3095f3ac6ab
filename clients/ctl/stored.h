/* stored.h - samples that a daemon holds: the batch a stream was sealed into, a job's signals */
#ifndef CTL_STORED_H
#define CTL_STORED_H
#include <stdbool.h>
#include "base/error.h"

struct args;
struct signals;

enum { STORED_NAME_ROOM = 65 };      /* of an upload's identifier, PROTOCOL.md section 3 */

/* NAME of "stream:NAME"; NULL: WORD is none. */
const char *stored_stream(const char *word);

/* Is WORD a stream, or what can only be a job: `key:K`, or 8 letters and digits where there is no
 * such file? */
bool stored_is(const char *word);

/*
 * What the server of ARGS calls the batch that the caller's stream NAME was sealed into last.
 * MODAL_BAD_INPUT: ARGS say --local, or of the samples what they say themselves; MODAL_NOT_FOUND;
 * MODAL_CONFLICT: the stream is open and has no batch yet.
 */
enum modal_status stored_find(const char *name, const struct args *args,
                              char stored[STORED_NAME_ROOM], struct modal_error *err);

/* The samples of WORD, which stored_is, into *OUT; signals_done frees what it holds.  Of a job of
 * `simulate` those that it made, else those that it ran on. */
enum modal_status stored_read(const char *word, const struct args *args, struct signals *out,
                              struct modal_error *err);
#endif
