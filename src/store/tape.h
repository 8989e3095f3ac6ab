/* tape.h - samples of all streams on stable storage by one write a group: DIR/tape, until they lie
 * in their streams' files
 *
 * A hundred streams that send a few samples each would cost a hundred synced files a group.  So the
 * ledger's thread writes short segments of a group to the tape, one behind the other, and syncs
 * that alone; they are as durable as in their files.  Now and then (ledger_settle) all go to their
 * files, many in one piece with one row, and the tape begins anew.  Those of one stream go there
 * when somebody is to read them (LEDGER_SAMPLES_SETTLE); they stay on the tape as well, where their
 * rows, or that their stream is gone, tell that they are done with.  A tape that is found at the
 * start is settled before anything is read, so that only rows speak of samples.
 */
#ifndef STORE_TAPE_H
#define STORE_TAPE_H
#include "store/ledger.h"

enum {
    /* bytes; a longer segment goes to its file at once: writing it twice costs more than a sync */
    TAPE_SEGMENT_MOST = 32 << 10,
#if MODALD_FAULTS
    TAPE_MOST = 16 << 10,       /* small, so that what is done with a long one meets each fault */
#else
    TAPE_MOST = 16 << 20,       /* when it is settled: as large as the log may become */
#endif
    TAPE_SECRET = 8,            /* bytes; nobody guesses one of 2^64 */
};

struct tape {
    int fd;                      /* -1: not open */
    uint64_t start, end;         /* where its groups begin and end; equal: it has none */
    uint64_t number;             /* of the next group */
    char secret[TAPE_SECRET];    /* what a group of this tape begins with */
    char *group; size_t length, room;     /* the group that is being made */
};

/* Segments that were on the tape, those that follow one another joined, by stream and offset. */
struct tape_pieces {
    struct ledger_change *changes;        /* LEDGER_SEGMENT_ROW; segment.data is in `bytes` */
    size_t count;
    char *bytes;
};

/* Open DIR's tape, made if absent.  MODAL_CORRUPT: a group in it is damaged, and others follow. */
enum modal_status tape_open(struct tape *tape, const char *dir, struct modal_error *err);
/* Accepts one that is not open. */
void tape_close(struct tape *tape);
/* SEGMENT, its data copied, at the end of the group. */
enum modal_status tape_add(struct tape *tape, const struct segment_record *segment,
                           struct modal_error *err);
/* The group is on stable storage, or, but for MODAL_IO, is not there. */
enum modal_status tape_write(struct tape *tape, struct modal_error *err);
/* The group that was added or written last, at END, is not there any more. */
enum modal_status tape_revert(struct tape *tape, uint64_t end, struct modal_error *err);
/* What is on it of STREAMS, COUNT of them; of all, where COUNT is 0.  The caller calls
 * tape_pieces_done in any case.  MODAL_CORRUPT: it has been damaged since it was written. */
enum modal_status tape_read(const struct tape *tape, const int64_t *streams, size_t count,
                            struct tape_pieces *out, struct modal_error *err);
void tape_pieces_done(struct tape_pieces *pieces);
/* Its groups before END, of those that it had, are not on TAPE any more, which is DIR's; where
 * there are others behind it is another file then.  MODAL_STORAGE_FULL: it is as it was. */
enum modal_status tape_drop(struct tape *tape, const char *dir, uint64_t end,
                            struct modal_error *err);

/* Is the tape of DIR whole?  One that is absent, or ends within a group, is; *BYTES: of it. */
enum modal_status tape_check(const char *dir, uint64_t *bytes, struct modal_error *err);
/* The path of DIR's. */
void tape_path(char path[4200], const char *dir);
#endif
