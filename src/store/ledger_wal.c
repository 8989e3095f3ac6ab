/*
 * ledger_wal.c - is SQLite's log damaged, or only torn at its end?
 *
 * The log [SQLite file format, section 4] is a header of 32 bytes and frames of 24 bytes and a
 * page, all numbers big-endian:
 *
 *     header   magic 0x377f0682 or ..83, version 3007000, page size, sequence, salt 1, salt 2,
 *              sum 1, sum 2
 *     frame    page number, pages of the database after a commit (0: not a commit's frame), salt 1,
 *              salt 2, sum 1, sum 2
 *
 * Frames of an earlier life of the file have other salts.  The sums run from the header through all
 * frames: over pairs of words, a += word + b, b += word + a; words are little-endian for magic
 * ..82.  After the first frame whose sums are wrong no sum can be checked, but salts and commit
 * marks can be read: a frame with our salts after a later commit's frame was written when the bad
 * group had been synced.  The last group has none behind it; of that the mark tells:
 *
 *     mark     "mdm2", salt 1, salt 2 (as in the log), u64 bytes of the log that were synced, the
 *              page of the last frame among them and the CRC-32C of what it has of the page,
 *              CRC-32C of the 28 bytes before; numbers little-endian
 *
 * A log without a life, empty or gone, says nothing of what it had.  Where the mark is open (its
 * bytes are not 0) and the marked page is not in the database as the mark's last frame had it, the
 * log was lost with acknowledged groups.  No power cut looks so:
 *
 *   - An open mark is written after a commit's sync, when the log has that group on the disk, with
 *     its length and its name.
 *   - Only two places here make a log shorter than its first frame: ledger_idle, and trim() of what
 *     a torn beginning left.  Both have the mark ended (0 bytes) and synced before.
 *
 * So whenever an open mark may be found on the disk, the log there has a frame, of the marked life
 * or of a later one that was written over it.  The page is asked for because other programs move a
 * log to the database too, and remove it: sqlite3, earlier versions.  These wrote "mdmk", the same
 * without the page, which tells nothing of an empty log.
 */
#include "store/ledger_db.h"
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "base/crc32c.h"
#include "store/file.h"

enum {
    HEADER = 32,             /* bytes of the log's, of a frame's: the format */
    FRAME_HEADER = 24,   /* the format */
    LEDGER_PAGE = 4096,      /* a page of our databases */
    PAGE_LEAST = 512,        /* and of any: the format */
    PAGE_MOST = 65536,   /* the format */
    MARK = 32,               /* bytes of the mark: see above */
    MARK_BEFORE = 24,        /* and of the one of earlier versions */
    LOOKS = 4                /* a writer is in the way of one, rarely of two in a row */
};
#define MAGIC 0x377f0682u        /* the format; with bit 0 sums are big-endian */
#define VERSION 3007000u         /* the format, since SQLite 3.7.0 */

struct sums { uint32_t a, b; };

/* What a mark says of the life with these salts: so many BYTES of it were synced; 0: not known.
 * The last PAGE among them, from 1, and the sum of what it has; 0: not known. */
struct marked { unsigned char salts[8]; uint64_t bytes; uint32_t page, sum; };

struct wal {
    int fd;
    uint64_t size;
    unsigned char header[HEADER], frame[FRAME_HEADER + PAGE_MOST];
    uint32_t page;            /* bytes of a page */
    uint32_t salt[2];
    bool big;                 /* the sums read words big-endian */
    struct marked marked;
    /* the first read that failed, and why: nothing is concluded from what could not be read */
    enum modal_status read;
    struct modal_error why;
};

static uint32_t big_word(const unsigned char *p)
{
    return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

static uint32_t little_word(const unsigned char *p)
{
    return (uint32_t)p[3] << 24 | (uint32_t)p[2] << 16 | (uint32_t)p[1] << 8 | p[0];
}

static struct sums add(bool big, struct sums sums, const unsigned char *p, size_t length)
{
    for (size_t i = 0; i + 8 <= length; i += 8) {
        sums.a += (big ? big_word(p + i) : little_word(p + i)) + sums.b;
        sums.b += (big ? big_word(p + i + 4) : little_word(p + i + 4)) + sums.a;
    }
    return sums;
}

static bool same(struct sums sums, const unsigned char *stored)
{
    return sums.a == big_word(stored) && sums.b == big_word(stored + 4);
}

static uint64_t frame_offset(const struct wal *wal, uint64_t frame)
{
    return HEADER + frame * (uint64_t)(FRAME_HEADER + wal->page);
}

/* Read frame FRAME, with its page where WHOLE; false past the end, and where a read failed. */
static bool read_frame(struct wal *wal, uint64_t frame, bool whole)
{
    size_t length = FRAME_HEADER + (whole ? wal->page : 0), got = 0;

    if (wal->read != MODAL_OK || frame_offset(wal, frame) + FRAME_HEADER + wal->page > wal->size)
        return false;
    wal->read = file_read(wal->fd, wal->frame, length, frame_offset(wal, frame), &got, &wal->why);
    return wal->read == MODAL_OK && got == length;
}

static bool ours(const struct wal *wal)
{
    return big_word(wal->frame + 8) == wal->salt[0] && big_word(wal->frame + 12) == wal->salt[1];
}

static bool frame_good(const struct wal *wal, struct sums *sums)
{
    struct sums next = add(wal->big, add(wal->big, *sums, wal->frame, 8), wal->frame + FRAME_HEADER,
                           wal->page);

    if (!ours(wal) || !same(next, wal->frame + 16))
        return false;
    *sums = next;
    return true;
}

/* Whether, at FROM or after, a commit's frame of ours is followed by another frame of ours. */
static bool groups_after(struct wal *wal, uint64_t from)
{
    bool committed = false;

    for (uint64_t i = from; read_frame(wal, i, false); i++) {
        if (!ours(wal))
            continue;
        if (committed)
            return true;
        committed = big_word(wal->frame + 4) != 0;
    }
    return false;
}

static void put_big(unsigned char *p, uint32_t word)
{
    for (int i = 0; i < 4; i++)
        p[i] = (unsigned char)(word >> (24 - 8 * i));
}

/*
 * Is the header torn: the beginning of a new life's (sequence + 1, other salts and sums) before the
 * end of the old one's, whose salts the frames carry?  Only a bit of damage to the sequence number
 * can look so.
 */
static bool header_torn(const struct wal *wal, bool big)
{
    struct sums none = { 0, 0 }, sums;
    unsigned char old[HEADER];

    put_big(old, MAGIC | (uint32_t)big);
    put_big(old + 4, VERSION);
    put_big(old + 8, wal->page);
    put_big(old + 12, big_word(wal->header + 12) - 1);
    put_big(old + 16, wal->salt[0]);
    put_big(old + 20, wal->salt[1]);
    sums = add(big, none, old, 24);
    put_big(old + 24, sums.a);
    put_big(old + 28, sums.b);
    for (size_t cut = 16; cut < HEADER; cut++)
        if (memcmp(wal->header + cut, old + cut, HEADER - cut) == 0)
            return memcmp(wal->header, old, 12) == 0;
    return false;
}

/* Whether the mark speaks of the life that has these salts. */
static bool marked_life(const struct wal *wal, const unsigned char salts[8])
{
    return wal->marked.bytes > 0 && memcmp(wal->marked.salts, salts, 8) == 0;
}

/* Whether any frame has salts: those of the life that it is of. */
static bool find_life(struct wal *wal)
{
    wal->page = LEDGER_PAGE;
    wal->salt[0] = wal->salt[1] = 0;
    for (uint64_t i = 0; (wal->salt[0] | wal->salt[1]) == 0; i++) {
        if (!read_frame(wal, i, false))
            return false;
        wal->salt[0] = big_word(wal->frame + 8);
        wal->salt[1] = big_word(wal->frame + 12);
    }
    return true;
}

/* The header's own sums are wrong: torn while the log began anew, with the frames of an old life,
 * which was found, behind it, or damaged? */
static bool header_damaged(struct wal *wal)
{
    unsigned char salts[8];

    put_big(salts, wal->salt[0]);
    put_big(salts + 4, wal->salt[1]);
    return (groups_after(wal, 0) || marked_life(wal, salts)) && !header_torn(wal, false)
           && !header_torn(wal, true);
}

static bool header_good(struct wal *wal)
{
    struct sums none = { 0, 0 };
    uint32_t magic = big_word(wal->header), page = big_word(wal->header + 8);

    wal->big = magic & 1;
    if ((magic & ~1u) != MAGIC || big_word(wal->header + 4) != VERSION || page < PAGE_LEAST
        || page > PAGE_MOST || (page & (page - 1)) != 0)
        return false;
    wal->page = page;
    wal->salt[0] = big_word(wal->header + 16);
    wal->salt[1] = big_word(wal->header + 20);
    return same(add(wal->big, none, wal->header, 24), wal->header + 24);
}

/* The log at PATH has no life: whether what it had, MARKED, is in the database. */
static enum modal_status check_moved(const struct marked *marked, const char *path,
                                     struct modal_error *err)
{
    unsigned char page[LEDGER_PAGE];
    char database[4200];
    size_t got = 0;
    int fd = -1;
    enum modal_status rc = MODAL_OK;

    if (marked->page == 0)
        return MODAL_OK;
    snprintf(database, sizeof database, "%.*s", (int)(strlen(path) - 4), path);
    rc = file_open(database, O_RDONLY, 0, &fd, err);
    if (rc == MODAL_OK) {
        rc = file_read(fd, page, sizeof page, (uint64_t)(marked->page - 1) * LEDGER_PAGE, &got,
                       err);
        close(fd);
    }
    if (rc != MODAL_OK && rc != MODAL_NOT_FOUND)
        return rc;
    if (got == sizeof page && crc32c(0, page, FILE_PAGE_DATA) == marked->sum)
        return MODAL_OK;
    return modal_fail(err, MODAL_CORRUPT,
                      "%s is empty or gone, and groups that it had are not in %s though they were "
                      "acknowledged; without the file ledger.db-mark the ledger is read without "
                      "them", path, database);
}

static enum modal_status check_headless(struct wal *wal, const char *path, struct modal_error *err)
{
    if (!find_life(wal))
        return check_moved(&wal->marked, path, err);
    return header_damaged(wal) ? modal_fail(
               err, MODAL_CORRUPT,
               "%s: its header is damaged (offset 0), and acknowledged groups follow it", path)
                               : MODAL_OK;
}

/* The offset behind the last good commit's frame, up to which SQLite will read; 0 where it will
 * read nothing. */
static enum modal_status check(struct wal *wal, const char *path, uint64_t *end,
                               struct modal_error *err)
{
    struct sums sums;
    uint64_t i = 0;

    *end = 0;
    if (!header_good(wal))
        return check_headless(wal, path, err);
    *end = HEADER;
    sums = (struct sums) { big_word(wal->header + 24), big_word(wal->header + 28) };
    while (read_frame(wal, i, true) && frame_good(wal, &sums)) {
        i++;
        if (big_word(wal->frame + 4) != 0)
            *end = frame_offset(wal, i);
    }
    if (groups_after(wal, i))
        return modal_fail(
            err, MODAL_CORRUPT,
            "%s: frame %llu (offset %llu) is damaged, and acknowledged groups follow it", path,
            (unsigned long long)i, (unsigned long long)frame_offset(wal, i));
    if (wal->read == MODAL_OK && marked_life(wal, wal->header + 16) && *end < wal->marked.bytes)
        return modal_fail(err, MODAL_CORRUPT,
                          "%s: frame %llu (offset %llu) is damaged or missing, and its group was "
                          "acknowledged; without "
                          "the file ledger.db-mark the log is read up to there",
                          path, (unsigned long long)i, (unsigned long long)frame_offset(wal, i));
    return MODAL_OK;
}

/* --- the mark --- */

struct ledger_mark {
    char wal[4200];
    int fd, log;              /* log: the log's own, once it is there; -1 */
    bool ended;               /* it says so on stable storage */
    struct marked last;       /* what the log has had since it was emptied, or was found */
};

static void mark_path(char path[4200], const char *wal)
{
    snprintf(path, 4200, "%.*s-mark", (int)(strlen(wal) - 4), wal);      /* without "-wal" */
}

/* Of LENGTH bytes, the last four their sum. */
static bool mark_good(const unsigned char *mark, size_t length, const char *magic)
{
    uint32_t check;

    memcpy(&check, mark + length - 4, 4);
    return memcmp(mark, magic, 4) == 0 && check == crc32c(0, mark, length - 4);
}

/* Of the log at PATH; as it was where there is none. */
static void mark_read(struct marked *marked, const char *path)
{
    unsigned char mark[MARK];
    char name[4200];
    size_t got = 0;
    int fd = -1;

    mark_path(name, path);
    if (file_open(name, O_RDONLY, 0, &fd, NULL) != MODAL_OK)
        return;
    if (file_read(fd, mark, MARK, 0, &got, NULL) != MODAL_OK)
        got = 0;
    close(fd);
    if (got == MARK && mark_good(mark, MARK, "mdm2")) {
        memcpy(&marked->page, mark + 20, 4);
        memcpy(&marked->sum, mark + 24, 4);
    } else if (got < MARK_BEFORE || !mark_good(mark, MARK_BEFORE, "mdmk"))
        return;
    memcpy(marked->salts, mark + 4, 8);
    memcpy(&marked->bytes, mark + 12, 8);
}

/* What a mark says that ends at BYTES of the log.  *THERE: it has so many.  A read that failed
 * tells nothing. */
static enum modal_status look_at(struct ledger_mark *mark, uint64_t bytes, struct marked *out,
                                 bool *there)
{
    enum { STRIDE = FRAME_HEADER + LEDGER_PAGE };
    unsigned char frame[STRIDE];
    size_t got = 0;
    enum modal_status rc = MODAL_OK;

    if (mark->log < 0)
        rc = file_open(mark->wal, O_RDONLY, 0, &mark->log, NULL);
    if (rc == MODAL_OK)
        rc = file_read(mark->log, frame, STRIDE, bytes - STRIDE, &got, NULL);
    *there = rc == MODAL_OK && got == STRIDE;
    if (!*there)
        return rc;
    *out = (struct marked) { .bytes = bytes, .page = big_word(frame),
                             .sum = crc32c(0, frame + FRAME_HEADER, FILE_PAGE_DATA) };
    memcpy(out->salts, frame + 8, 8);
    return MODAL_OK;
}

/* Whether the log has what it had last; yes, where that cannot be read. */
static bool has_last(struct ledger_mark *mark)
{
    const struct marked *last = &mark->last;
    struct marked now;
    bool there = true;

    if (last->bytes == 0 || look_at(mark, last->bytes, &now, &there) != MODAL_OK)
        return true;
    return there && memcmp(now.salts, last->salts, 8) == 0 && now.page == last->page
           && now.sum == last->sum;
}

bool ledger_mark_holds(struct ledger_mark *mark)
{
    return mark == NULL || has_last(mark)
           || check_moved(&mark->last, mark->wal, NULL) != MODAL_CORRUPT;
}

struct ledger_mark *ledger_mark_open(const char *dir)
{
    struct ledger_mark *mark = calloc(1, sizeof *mark);
    char path[4200];

    if (mark == NULL)
        return NULL;
    mark->fd = mark->log = -1;
    snprintf(mark->wal, sizeof mark->wal, "%.4096s/ledger.db-wal", dir);
    mark_path(path, mark->wal);
    file_open(path, O_WRONLY | O_CREAT, 0640, &mark->fd, NULL);
    mark_read(&mark->last, mark->wal);
    if (mark->last.page == 0 || !has_last(mark))              /* it may be of a life that is over */
        mark->last.bytes = 0;
    return mark;
}

/* TEXT with its sum, into FD. */
static bool write_mark(int fd, unsigned char text[MARK])
{
    uint32_t sum = crc32c(0, text, MARK - 4);

    memcpy(text + MARK - 4, &sum, 4);
    return file_write(fd, text, MARK, 0, NULL) == MODAL_OK;
}

bool ledger_mark_put(struct ledger_mark *mark, int frames)
{
    const uint64_t bytes = HEADER + (uint64_t)frames * (FRAME_HEADER + LEDGER_PAGE);
    unsigned char text[MARK] = "mdm2";
    struct marked now;
    bool there = true;

    if (mark == NULL || look_at(mark, bytes, &now, &there) != MODAL_OK)
        return true;
    if (!there || (memcmp(now.salts, mark->last.salts, 8) == 0 && !has_last(mark)))
        return false;
    mark->last = now;
    memcpy(text + 4, now.salts, 8);
    memcpy(text + 12, &bytes, 8);
    memcpy(text + 20, &now.page, 4);
    memcpy(text + 24, &now.sum, 4);
    mark->ended = false;
    if (mark->fd >= 0)
        write_mark(mark->fd, text);
    return true;
}

/* FD's mark is ended, on stable storage; false: it was not written. */
static enum modal_status end_mark(int fd, bool *ended, struct modal_error *err)
{
    unsigned char text[MARK] = "mdm2";
    enum modal_status rc = MODAL_OK;

    *ended = write_mark(fd, text) && (rc = file_sync(fd, err)) == MODAL_OK;
    return rc;
}

enum modal_status ledger_mark_end(struct ledger_mark *mark, bool *ended, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (mark != NULL && mark->fd >= 0 && !mark->ended)
        rc = end_mark(mark->fd, &mark->ended, err);
    *ended = mark != NULL && mark->ended;
    return rc;
}

void ledger_mark_emptied(struct ledger_mark *mark)
{
    if (mark != NULL)
        mark->last.bytes = 0;
}

void ledger_mark_close(struct ledger_mark *mark)
{
    if (mark == NULL)
        return;
    if (mark->fd >= 0)
        close(mark->fd);
    if (mark->log >= 0)
        close(mark->log);
    free(mark);
}

/* --- the check --- */

/* A database has its first page before it has a log: SQLite takes one without for a new one, and
 * drops the log that is there. */
static enum modal_status check_database(const char *wal, struct modal_error *err)
{
    struct stat known;
    char path[4200];

    snprintf(path, sizeof path, "%.*s", (int)(strlen(wal) - 4), wal);
    if (stat(path, &known) < 0 ? errno != ENOENT : known.st_size > 0 || !S_ISREG(known.st_mode))
        return MODAL_OK;
    return modal_fail(err, MODAL_CORRUPT, "%s is empty, and the groups in its log, %s, were "
                      "acknowledged", path, wal);
}

/* Once, as it is now, or gone; the mark before it, for it may be moving. */
static enum modal_status look(struct wal *wal, const char *path, uint64_t *end,
                              struct modal_error *err)
{
    struct stat known;
    size_t got = 0;
    enum modal_status rc;

    *end = 0;
    wal->marked = (struct marked) { .bytes = 0 };
    mark_read(&wal->marked, path);
    if (wal->fd < 0)
        return check_moved(&wal->marked, path, err);
    if (fstat(wal->fd, &known) < 0)
        return modal_fail(err, MODAL_IO, "%s: %s", path, strerror(errno));
    wal->size = (uint64_t)known.st_size;
    rc = file_read(wal->fd, wal->header, HEADER, 0, &got, err);
    if (rc == MODAL_OK)
        rc = got == HEADER ? check(wal, path, end, err) : check_moved(&wal->marked, path, err);
    if (rc == MODAL_OK && *end > HEADER)
        rc = check_database(path, err);
    return wal->read == MODAL_OK ? rc : modal_fail(err, wal->read, "%s", wal->why.message);
}

/* The mark of the log at PATH is ended, before nothing of a life is left. */
static enum modal_status end_mark_of(const char *path, struct modal_error *err)
{
    char name[4200];
    int fd = -1;
    bool ended = false;
    enum modal_status rc;

    mark_path(name, path);
    rc = file_open(name, O_WRONLY, 0, &fd, err);
    if (rc == MODAL_OK)
        rc = end_mark(fd, &ended, err);
    if (rc == MODAL_OK && !ended)
        rc = modal_fail(err, MODAL_IO, "%s cannot be written", name);
    if (fd >= 0)
        close(fd);
    return rc;
}

/* What is left of a torn group, or of a life before, would be taken for later groups once others
 * are written before it. */
static enum modal_status trim(const struct wal *wal, const char *path, uint64_t end,
                              struct modal_error *err)
{
    enum modal_status rc;

    if (wal->size <= end)
        return MODAL_OK;
    if (end <= HEADER && wal->marked.page != 0 && (rc = end_mark_of(path, err)) != MODAL_OK)
        return rc;
    rc = file_truncate(wal->fd, end, err);
    return rc == MODAL_OK ? file_sync(wal->fd, err) : rc;
}

enum modal_status ledger_wal_check(const char *path, bool owner, struct modal_error *err)
{
    struct wal *wal = calloc(1, sizeof *wal);
    uint64_t end = 0;
    enum modal_status rc;

    if (wal == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory to check %s", path);
    wal->fd = -1;
    rc = file_open(path, owner ? O_RDWR : O_RDONLY, 0, &wal->fd, err);
    if (rc == MODAL_OK || rc == MODAL_NOT_FOUND)
        rc = look(wal, path, &end, err);
    /* it may have been written to meanwhile */
    for (int i = 0; rc == MODAL_CORRUPT && !owner && i < LOOKS; i++)
        rc = look(wal, path, &end, err);
    if (rc == MODAL_OK && owner && wal->fd >= 0)
        rc = trim(wal, path, end, err);
    if (wal->fd >= 0)
        close(wal->fd);
    free(wal);
    return rc;
}
