/* samples.h - the samples of an open stream: DIR/spool/ID.samples, segments one behind the other
 *
 * A segment is a run of samples of one epoch.  The ledger's thread writes long ones, as they were
 * pushed, and what was on the tape (tape.h), and syncs their files before it commits their rows,
 * so that a row never speaks of bytes that are not on stable storage.  Bytes that no row speaks of
 * (of a refused group, of one cut off by a crash) are written over.  When the stream is sealed,
 * rows and file go.
 */
#ifndef STORE_SAMPLES_H
#define STORE_SAMPLES_H
#include "store/ledger.h"

/* The path of stream ID's file. */
void samples_path(char path[4200], const char *dir, int64_t id);
/* Remove it; absent is no error. */
enum modal_status samples_remove(const char *dir, int64_t id, struct modal_error *err);

/* The files of a group being written: zero it, put each segment, sync, close in any case. */
enum {
    SAMPLES_FILES = 32,            /* open at once: of the 128 that a daemon keeps for itself */
    SAMPLES_SEGMENT_MOST = 256 << 10,      /* bytes of a segment, as of a push */
};
struct samples_files {
    const char *dir;
    struct samples_file {
        int64_t id;
        int fd;
        uint64_t first;            /* offset of the group's first segment */
        uint64_t from, to;         /* written, the disk not told of it yet */
    } file[SAMPLES_FILES];
    int count;
    bool made;                     /* a file that begins: its name is to be synced too */
};
/* Write SEGMENT's data at its offset.  MODAL_STORAGE_FULL; MODAL_IO after which nothing may be
 * trusted. */
enum modal_status samples_put(struct samples_files *files, const struct segment_record *segment,
                              struct modal_error *err);
/* All that was put is on stable storage. */
enum modal_status samples_sync(struct samples_files *files, struct modal_error *err);
/* The group is refused for want of space: that of its segments is given back, as far as the files
 * are still open. */
void samples_revert(struct samples_files *files);
void samples_close(struct samples_files *files);

/* The bytes of SEGMENT from the open file FD into DATA, which has room for its length.
 * MODAL_CORRUPT: bytes are missing or differ. */
enum modal_status samples_get(int fd, const struct segment_record *segment, void *data,
                              struct modal_error *err);
#endif
