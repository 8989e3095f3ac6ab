/* uff.h - universal files: time responses of data sets 58 (text) and 58b (binary)
 *
 * Every function of type 1 (time response) is a channel, called after the node and direction of
 * its response ("12:+Z"); functions of other types (spectra, frequency responses) are passed over,
 * as other data sets are.  A file without a time response is refused with the types that it has.
 */
#ifndef CTL_FILES_UFF_H
#define CTL_FILES_UFF_H
#include "bytes.h"
#include "ctl/signals.h"

/* By its first two lines: a -1 in its columns, the number of a data set in its. */
bool uff_is(const unsigned char *head, size_t length);
/* FILE into *OUT (signals_done frees it).  MODAL_BAD_INPUT, field "file": cut, damaged, no time
 * response; "signals": functions of unlike lengths or steps; "dataset" is not asked. */
enum modal_status uff_read(struct bytes file, const char *path,
                           const struct signals_options *options, struct signals *out,
                           struct modal_error *err);
#endif
