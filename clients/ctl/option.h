/* option.h - `KEY=VALUE` of a command line as a member of a job's options object
 *
 * VALUE is read as, in this order: true, false, null; a number; JSON if it begins with [ { or "; a
 * list if it has a comma (each part by these rules); else a word.  Keys are flat: `rank.fixed` is
 * one key.
 */
#ifndef CTL_OPTION_H
#define CTL_OPTION_H
#include <stdbool.h>
#include "base/error.h"
#include "base/json.h"

/* Add or replace.  MODAL_BAD_INPUT, its field the key: no '=', an empty key or value, a number
 * beyond a double. */
enum modal_status option_add(cJSON *options, const char *text, struct modal_error *err);
enum modal_status option_set_text(cJSON *options, const char *key, const char *value,
                                  struct modal_error *err);

/* Does TEXT have the form of an option: a name of letters, digits, '.', '_', '[' or ']' and then
 * '='? */
bool option_looks_like(const char *text);

#endif
