/* outcome.h - what modalctl says: one JSON document on stdout, or text; errors as values of the
 * same kind */
#ifndef CTL_OUTCOME_H
#define CTL_OUTCOME_H
#include <stdbool.h>
#include "base/error.h"
#include "base/json.h"

/* One line of JSON on stdout. A failed write is MODAL_IO. */
enum modal_status outcome_json(const cJSON *document, struct modal_error *err);

/* {"error":{"code","message","field"?,"detail"?}}; DETAIL is borrowed, may be NULL.  The caller
 * frees the answer. */
cJSON *outcome_error(const struct modal_error *err, const cJSON *detail);

/* Say that ERR ended the command: as JSON on stdout, or as text on stderr. Returns the exit
 * status. */
int outcome_failure(bool json, const struct modal_error *err, const cJSON *detail);

/* Before any file is opened: of stdin, stdout and stderr those that are closed are /dev/null, of
 * which what uses them fails; else a file would have the number, and what is printed go into it.
 * From then on a document that there is no memory for ends the program, which says so as *JSON has
 * it. */
void outcome_begin(const bool *json);
/* The exit status of what had STATUS: where not all that was printed could be written, that of
 * MODAL_IO, which is told on stderr. */
int outcome_end(int status);

#endif
