/*
 * file_vfs.c - SQLite's files through the fault points of file.h, with a checksum on each page of a
 * database
 *
 * SQLite checks the frames of its write-ahead log, but not the pages of a database: a flipped bit
 * in a row would be read as if it had been written.  A database made with 8 reserved bytes a page
 * (byte 20 of its header) gets, at the end of each page as it is written to the database file, the
 * CRC-32C of the page's offset and its other bytes, and four bytes "mdlc"; every page read is
 * checked, so that a changed, zeroed or misplaced page is SQLITE_IOERR_DATA. Pages in the log keep
 * SQLite's own checksum; they get ours when they are copied to the database.
 *
 * SQLite writes its log by frames, 24 bytes and a page each.  They are held here until a commit's
 * frame comes, or what needs them in the file: a group is one write, where each of its pages was
 * two.  Nobody else is told of a frame before its commit is there.  That is right of one connection
 * that writes, whose group is synced before it is told (synchronous=FULL): headers that SQLite
 * writes anew behind the commit's frame, and frames of a group taken back, are held until then.
 *
 * All else is the default VFS's.
 */
#include "store/file.h"
#include <errno.h>
#include <pthread.h>
#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>
#include "base/crc32c.h"
#include "store/file_fault.h"

enum { DATABASE_HEADER = 100 };    /* bytes of page 1: SQLite's format */

enum {
    PAGE     = 4096,     /* SQLite's default, which ledgers are made with */
    RESERVED = PAGE - FILE_PAGE_DATA,    /* bytes at its end, 8: the checksum and "mdlc" */
    FRAME_HEADER = 24,       /* bytes: SQLite's format */
    HELD_MOST = 16 * (FRAME_HEADER + PAGE),      /* bytes: a page has a sixteenth of a call */
};

struct vfs_file {
    sqlite3_file base;
    bool checked;            /* a database whose pages carry checksums */
    bool database;
    bool log;
    bool commits;            /* the latest frame of the log ends a transaction */
    char *held;              /* of the log, from `held_at` on, not in the file yet; NULL: no room */
    int held_size;
    sqlite3_int64 held_at;
    sqlite3_file real[];     /* the default VFS's file, szOsFile bytes */
};

static sqlite3_vfs *under;   /* the default VFS */

static sqlite3_file *real(sqlite3_file *file)
{
    return ((struct vfs_file *)file)->real;
}

/* The fault of one call as SQLite's code; SQLITE_OK: none. */
static int fault_code(struct file_fault fault, int code)
{
    if (fault.error == 0 || fault.error == EINTR)
        return SQLITE_OK;
    return fault.error == ENOSPC || fault.error == EDQUOT ? SQLITE_FULL : code;
}

#define GUARDED(WHICH, CODE, CALL)                                \
    ({                                                            \
        struct file_fault fault_ = file_fault_next(WHICH);        \
        int code_ = fault_code(fault_, CODE);                     \
        if (code_ == SQLITE_OK)                                   \
            code_ = (CALL);                                       \
        file_fault_after(fault_);                                 \
        code_;                                                    \
    })

static void page_sum(const void *page, sqlite3_int64 offset, unsigned char sum[RESERVED])
{
    uint32_t crc = crc32c(crc32c(0, &offset, sizeof offset), page, PAGE - RESERVED);

    memcpy(sum, &crc, 4);
    memcpy(sum + 4, "mdlc", 4);
}

static bool is_page(const struct vfs_file *file, int amount, sqlite3_int64 offset)
{
    return file->database && amount == PAGE && offset % PAGE == 0;
}

/* Page 1 says whether this database has room for checksums. */
static void learn(struct vfs_file *file, const void *page, int amount, sqlite3_int64 offset)
{
    if (file->database && offset == 0 && amount >= DATABASE_HEADER
        && memcmp(page, "SQLite format 3", 16) == 0)
        file->checked = ((const unsigned char *)page)[20] == RESERVED;
}

/* As the default VFS writes, which takes of what file.h has for a full disk ENOSPC alone. */
static int write_real(sqlite3_file *base, const void *data, int amount, sqlite3_int64 offset)
{
    int rc;

    errno = 0;
    rc = real(base)->pMethods->xWrite(real(base), data, amount, offset);
    return rc == SQLITE_IOERR_WRITE && (errno == EDQUOT || errno == EFBIG) ? SQLITE_FULL : rc;
}

static int write_through(sqlite3_file *base, const void *data, int amount, sqlite3_int64 offset,
                         bool cut)
{
    int half = cut ? amount / 2 : 0;
    int rc = half > 0 ? write_real(base, data, half, offset) : SQLITE_OK;

    return rc != SQLITE_OK
               ? rc
               : write_real(base, (const char *)data + half, amount - half, offset + half);
}

static int write_out(sqlite3_file *base, const void *data, int amount, sqlite3_int64 offset)
{
    struct file_fault fault = file_fault_next(FILE_PWRITE);
    int rc = fault_code(fault, SQLITE_IOERR_WRITE);

    if (rc == SQLITE_OK)
        rc = write_through(base, data, amount, offset, fault.cut);
    file_fault_after(fault);
    return rc;
}

/* What is held goes to the file, or is lost with its transaction, which fails of that. */
static int write_held(sqlite3_file *base)
{
    struct vfs_file *file = (struct vfs_file *)base;
    const int size = file->held_size;

    file->held_size = 0;
    return size > 0 ? write_out(base, file->held, size, file->held_at) : SQLITE_OK;
}

/* A piece of the log; a commit's frame goes to the file with what is held before it. */
static int hold(sqlite3_file *base, const void *data, int amount, sqlite3_int64 offset)
{
    struct vfs_file *file = (struct vfs_file *)base;
    const unsigned char *p = data;
    int rc = SQLITE_OK;

    if (offset != file->held_at + file->held_size || amount > HELD_MOST - file->held_size)
        rc = write_held(base);
    if (file->held == NULL)
        file->held = malloc(HELD_MOST);
    if (rc != SQLITE_OK || file->held == NULL || amount > HELD_MOST)
        return rc != SQLITE_OK ? rc : write_out(base, data, amount, offset);
    if (file->held_size == 0)
        file->held_at = offset;
    memcpy(file->held + file->held_size, data, (size_t)amount);
    file->held_size += amount;
    if (amount != FRAME_HEADER)
        return file->commits ? write_held(base) : SQLITE_OK;
    file->commits = (p[4] | p[5] | p[6] | p[7]) != 0;      /* the pages of the database then */
    return SQLITE_OK;
}

static int vfs_close(sqlite3_file *base)
{
    free(((struct vfs_file *)base)->held);         /* of no transaction that was committed */
    return real(base)->pMethods->xClose(real(base));
}

static int vfs_read(sqlite3_file *base, void *data, int amount, sqlite3_int64 offset)
{
    struct vfs_file *file = (struct vfs_file *)base;
    int rc = write_held(base);

    if (rc == SQLITE_OK)
        rc = GUARDED(FILE_PREAD, SQLITE_IOERR_READ,
                     real(base)->pMethods->xRead(real(base), data, amount, offset));

    if (rc != SQLITE_OK)
        return rc;
    learn(file, data, amount, offset);
    if (!file->checked || !is_page(file, amount, offset))
        return rc;
    return file_vfs_page_good(data, offset) ? SQLITE_OK : SQLITE_IOERR_DATA;
}

static int vfs_write(sqlite3_file *base, const void *data, int amount, sqlite3_int64 offset)
{
    struct vfs_file *file = (struct vfs_file *)base;
    unsigned char page[PAGE];

    if (file->log)
        return hold(base, data, amount, offset);
    learn(file, data, amount, offset);
    if (file->checked && is_page(file, amount, offset)) {
        memcpy(page, data, PAGE);
        page_sum(page, offset, page + PAGE - RESERVED);
        data = page;
    }
    return write_out(base, data, amount, offset);
}

static int vfs_truncate(sqlite3_file *file, sqlite3_int64 size)
{
    int rc = write_held(file);

    return rc != SQLITE_OK ? rc
                           : GUARDED(FILE_FTRUNCATE, SQLITE_IOERR_TRUNCATE,
                                     real(file)->pMethods->xTruncate(real(file), size));
}

static int vfs_sync(sqlite3_file *file, int flags)
{
    int rc = write_held(file);

    if (rc != SQLITE_OK)
        return rc;
    rc = GUARDED(FILE_FDATASYNC, SQLITE_IOERR_FSYNC,
                 real(file)->pMethods->xSync(real(file), flags));
    /* whatever the reason, what is on the disk is unknown */
    return rc == SQLITE_FULL ? SQLITE_IOERR_FSYNC : rc;
}

static int vfs_file_size(sqlite3_file *file, sqlite3_int64 *size)
{
    int rc = write_held(file);

    return rc != SQLITE_OK ? rc : real(file)->pMethods->xFileSize(real(file), size);
}

static int vfs_lock(sqlite3_file *file, int level)
{
    return real(file)->pMethods->xLock(real(file), level);
}

static int vfs_unlock(sqlite3_file *file, int level)
{
    return real(file)->pMethods->xUnlock(real(file), level);
}

static int vfs_check_reserved(sqlite3_file *file, int *out)
{
    return real(file)->pMethods->xCheckReservedLock(real(file), out);
}

static int vfs_control(sqlite3_file *file, int op, void *argument)
{
    return real(file)->pMethods->xFileControl(real(file), op, argument);
}

static int vfs_sector_size(sqlite3_file *file)
{
    return real(file)->pMethods->xSectorSize(real(file));
}

static int vfs_characteristics(sqlite3_file *file)
{
    return real(file)->pMethods->xDeviceCharacteristics(real(file));
}

static int vfs_shm_map(sqlite3_file *file, int page, int size, int extend, void volatile **out)
{
    return real(file)->pMethods->xShmMap(real(file), page, size, extend, out);
}

static int vfs_shm_lock(sqlite3_file *file, int offset, int count, int flags)
{
    return real(file)->pMethods->xShmLock(real(file), offset, count, flags);
}

static void vfs_shm_barrier(sqlite3_file *file)
{
    real(file)->pMethods->xShmBarrier(real(file));
}

static int vfs_shm_unmap(sqlite3_file *file, int delete)
{
    return real(file)->pMethods->xShmUnmap(real(file), delete);
}

/* Version 2: no mapped reading, so that every page passes vfs_read. */
static const sqlite3_io_methods methods = {
    .iVersion = 2,
    .xClose = vfs_close,
    .xRead = vfs_read,
    .xWrite = vfs_write,
    .xTruncate = vfs_truncate,
    .xSync = vfs_sync,
    .xFileSize = vfs_file_size,
    .xLock = vfs_lock,
    .xUnlock = vfs_unlock,
    .xCheckReservedLock = vfs_check_reserved,
    .xFileControl = vfs_control,
    .xSectorSize = vfs_sector_size,
    .xDeviceCharacteristics = vfs_characteristics,
    .xShmMap = vfs_shm_map,
    .xShmLock = vfs_shm_lock,
    .xShmBarrier = vfs_shm_barrier,
    .xShmUnmap = vfs_shm_unmap,
};

static int vfs_open(sqlite3_vfs *vfs, const char *name, sqlite3_file *base, int flags,
                    int *out_flags)
{
    struct vfs_file *file = (struct vfs_file *)base;
    int rc;

    (void)vfs;
    memset(file, 0, sizeof *file);
    file->database = (flags & SQLITE_OPEN_MAIN_DB) != 0;
    file->log = (flags & SQLITE_OPEN_WAL) != 0;
    rc = GUARDED(FILE_OPEN, SQLITE_CANTOPEN,
                 under->xOpen(under, name, real(base), flags, out_flags));
    if (rc == SQLITE_OK)
        file->base.pMethods = &methods;
    return rc;
}

static int vfs_delete(sqlite3_vfs *vfs, const char *name, int sync_dir)
{
    (void)vfs;
    return GUARDED(FILE_UNLINK, SQLITE_IOERR_DELETE, under->xDelete(under, name, sync_dir));
}

static int vfs_access(sqlite3_vfs *vfs, const char *name, int flags, int *out)
{
    (void)vfs;
    return under->xAccess(under, name, flags, out);
}

static int vfs_full_pathname(sqlite3_vfs *vfs, const char *name, int size, char *out)
{
    (void)vfs;
    return under->xFullPathname(under, name, size, out);
}

static int vfs_randomness(sqlite3_vfs *vfs, int size, char *out)
{
    (void)vfs;
    return under->xRandomness(under, size, out);
}

static int vfs_sleep(sqlite3_vfs *vfs, int microseconds)
{
    (void)vfs;
    return under->xSleep(under, microseconds);
}

static int vfs_current_time(sqlite3_vfs *vfs, double *out)
{
    (void)vfs;
    return under->xCurrentTime(under, out);
}

static int vfs_last_error(sqlite3_vfs *vfs, int size, char *out)
{
    (void)vfs;
    return under->xGetLastError(under, size, out);
}

static sqlite3_vfs ours = {
    .iVersion = 1,
    .zName = "modald",
    .xOpen = vfs_open,
    .xDelete = vfs_delete,
    .xAccess = vfs_access,
    .xFullPathname = vfs_full_pathname, .xRandomness = vfs_randomness, .xSleep = vfs_sleep,
    .xCurrentTime = vfs_current_time, .xGetLastError = vfs_last_error,
};

static void vfs_register(void)
{
    /* nobody asks for the figures, and each allocation would lock for them */
    sqlite3_config(SQLITE_CONFIG_MEMSTATUS, 0);
    under = sqlite3_vfs_find(NULL);
    ours.mxPathname = under->mxPathname;
    ours.szOsFile = (int)sizeof(struct vfs_file) + under->szOsFile;
    sqlite3_vfs_register(&ours, 0);
}

bool file_vfs_page_good(const void *page, int64_t offset)
{
    unsigned char sum[RESERVED];

    page_sum(page, offset, sum);
    return memcmp(sum, (const char *)page + PAGE - RESERVED, RESERVED) == 0;
}

const char *file_vfs(void)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;

    pthread_once(&once, vfs_register);
    return ours.zName;
}
