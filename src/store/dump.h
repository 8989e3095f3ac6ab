/* dump.h - all rows of a data folder's ledger as JSON, beside a running daemon or without one */
#ifndef STORE_DUMP_H
#define STORE_DUMP_H
#include "base/error.h"

/* All rows of DIR's ledger as JSON, one object a call: {"row":"job", ...}.  Data and results are
 * told by size, not written out. */
enum modal_status dump_folder(const char *dir, void (*line)(void *context, const char *json),
                              void *context, struct modal_error *err);
#endif
