/* mapping.h - a piece of a file read where it lies, its pages given back when they have been
 * read */
#ifndef STORE_MAPPING_H
#define STORE_MAPPING_H
#include <stddef.h>
#include <stdint.h>
#include "base/error.h"

/* LENGTH bytes at DATA, at OFFSET of the file; BASE and MAPPED are whole pages.  All zero: nothing
 * is mapped. */
struct mapping { const void *data; size_t length; void *base; size_t mapped; uint64_t offset; };

/*
 * Map bytes OFFSET .. OFFSET + LENGTH of FD, read only and shared; FD may be closed after.  PATH is
 * for messages. MODAL_CORRUPT: the file is shorter; MODAL_NO_MEMORY, MODAL_IO.  A file made shorter
 * while it is mapped ends its reader (SIGBUS).
 */
enum modal_status mapping_open(int fd, const char *path, uint64_t offset, uint64_t length,
                               struct mapping *out, struct modal_error *err);
void mapping_close(struct mapping *map);

/*
 * BYTES bytes at FROM, inside a mapping, are not needed for now: their pages leave this process and
 * are read again where they are touched again, from the page cache or the disk.  What batch.h calls
 * release.
 */
void mapping_release(const void *from, size_t bytes);

/*
 * The memory limit of a batch, bytes: up to here it may stay resident as a whole, beyond it is read
 * in order and released.  256 MB, which with the work arrays keeps identify below 512 MB; less,
 * half of RLIMIT_DATA, where the process has less.
 */
uint64_t mapping_resident_most(void);
#endif
