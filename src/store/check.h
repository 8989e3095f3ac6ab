/* check.h - a data folder looked over, beside a running daemon or without one */
#ifndef STORE_CHECK_H
#define STORE_CHECK_H
#include <stdint.h>
#include "base/error.h"

struct check_report {
    int64_t jobs, inputs, results, chunks, tombstones, bytes;   /* looked at; bytes of data read */
    int64_t problems;
    /* files without a row: left by a crash, removed at the next start; no problem */
    int64_t orphans;
};

/*
 * Read everything in DIR and hold it against its checksums: the log, every page of the ledger,
 * every row, every input and result.  PROBLEM is called with one line for each thing that is wrong:
 * which file, at which offset.  Nothing is changed. MODAL_OK however many problems there are
 * (OUT->problems); MODAL_BAD_VERSION, MODAL_NOT_FOUND (no ledger), MODAL_IO.
 */
enum modal_status check_folder(const char *dir, void (*problem)(void *context, const char *line),
                               void *context, struct check_report *out, struct modal_error *err);
#endif
