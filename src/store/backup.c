/*
 * backup.c - see backup.h
 *
 * A backup's ledger is a snapshot; the files of its rows must be in the copy too.  Sealed files
 * never change, appear before their row and go after it.  So files are linked before the snapshot,
 * which catches those about to go, and after it, which catches those that came; should one both
 * come and go in between, the snapshot is taken again.
 */
#include "store/backup.h"
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include "store/file.h"
#include "store/ledger_db.h"
#include "store/samples.h"
#include "store/tape.h"
#include "store/spool.h"

enum {
    BLOCK = 1 << 20,       /* copied at once: a disk's transfer takes longer than the call does */
    PATH  = 4200,          /* PATH_MAX and the name of a file of ours */
    /* snapshots: each is spoilt only by a file that came and went within it */
    TRIES = 5,
};

struct backup {
    const char *dir, *to;
    enum modal_status rc;
    struct modal_error *err;
    bool missing;                /* a row's file is not in the copy */
};

static enum modal_status copy_file(const char *from, const char *to, struct modal_error *err)
{
    unsigned char *block = malloc(BLOCK);
    int in = -1, out = -1;
    uint64_t at = 0;
    size_t got = 0;
    enum modal_status rc = block != NULL
                               ? file_open(from, O_RDONLY, 0, &in, err)
                               : modal_fail(err, MODAL_NO_MEMORY, "no memory to copy %s", from);

    if (rc == MODAL_OK)
        rc = file_open(to, O_WRONLY | O_CREAT | O_TRUNC, 0640, &out, err);
    for (;
         rc == MODAL_OK && (rc = file_read(in, block, BLOCK, at, &got, err)) == MODAL_OK && got > 0;
         at += got)
        rc = file_write(out, block, got, at, err);
    if (rc == MODAL_OK)
        rc = file_sync(out, err);
    if (out >= 0)
        close(out);
    if (in >= 0)
        close(in);
    free(block);
    return rc;
}

/* A file that went while we looked is no failure: its row went before. */
static void copy_found(void *context, enum spool_file what, int64_t id, uint64_t bytes,
                       const char *path)
{
    struct backup *backup = context;
    char to[PATH];

    (void)id;
    (void)bytes;
    if (what == SPOOL_OTHER || backup->rc != MODAL_OK)
        return;
    snprintf(to, sizeof to, "%s%s", backup->to, path + strlen(backup->dir));
    if (what != SPOOL_PART && what != SPOOL_SAMPLES
        && (link(path, to) == 0 || errno == EEXIST || errno == ENOENT))
        return;
    backup->rc = copy_file(path, to, backup->err);
    if (backup->rc == MODAL_NOT_FOUND)
        backup->rc = MODAL_OK;
}

static enum modal_status copy_files(struct backup *backup)
{
    enum modal_status rc;

    backup->rc = MODAL_OK;
    rc = spool_list(backup->dir, copy_found, backup, backup->err);
    return rc == MODAL_OK ? backup->rc : rc;
}

/* Before the ledger: what leaves it meanwhile has its rows there.  A copy that is damaged may have
 * met a tape that began anew: not another time so soon. */
static enum modal_status copy_tape(struct backup *backup)
{
    char from[PATH], to[PATH];
    enum modal_status rc = MODAL_CORRUPT;
    uint64_t bytes;

    tape_path(from, backup->dir);
    tape_path(to, backup->to);
    for (int i = 0; i < 2 && rc == MODAL_CORRUPT; i++) {
        rc = copy_file(from, to, backup->err);
        if (rc == MODAL_OK)
            rc = tape_check(backup->to, &bytes, backup->err);
    }
    return rc == MODAL_NOT_FOUND ? MODAL_OK : rc;
}

/* An empty database with room for checksums from its first page on, then all pages. */
static enum modal_status copy_ledger(struct backup *backup)
{
    char path[PATH];
    int reserved = 8, code;
    sqlite3 *from = NULL, *to = NULL;
    sqlite3_backup *copy = NULL;
    enum modal_status rc = ledger_db_open(backup->dir, false, &from, backup->err);

    snprintf(path, sizeof path, "%s/ledger.db", backup->to);
    if (rc == MODAL_OK)
        rc = file_unlink(path, backup->err);
    if (rc == MODAL_OK)
        rc = ledger_db_make(path, backup->err);
    if (rc != MODAL_OK)
        goto out;
    code = sqlite3_open_v2(path, &to, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, file_vfs());
    if (code != SQLITE_OK) {
        rc = ledger_db_fail(to, code, path, backup->err);
        goto out;
    }
    sqlite3_file_control(to, "main", SQLITE_FCNTL_RESERVE_BYTES, &reserved);
    rc = ledger_db_run(to, "PRAGMA auto_vacuum=INCREMENTAL; CREATE TABLE room(for_checksums)",
                       backup->err);
    if (rc != MODAL_OK)
        goto out;
    copy = sqlite3_backup_init(to, "main", from, "main");
    code = copy != NULL ? sqlite3_backup_step(copy, -1) : sqlite3_errcode(to);
    if (code != SQLITE_DONE)
        rc = ledger_db_fail(to, code, "backup", backup->err);
    if (copy != NULL && sqlite3_backup_finish(copy) != SQLITE_OK && rc == MODAL_OK)
        rc = ledger_db_fail(to, sqlite3_errcode(to), "backup", backup->err);
out:
    sqlite3_close(to);
    sqlite3_close(from);
    return rc;
}

static enum modal_status find_file(void *context, const struct input_record *input)
{
    struct backup *backup = context;
    char path[PATH];

    snprintf(path, sizeof path, "%s/spool/%" PRId64 ".%s", backup->to, input->id,
             input->state == INPUT_SEALED ? "h5" : "part");
    if (!input->inline_data && access(path, F_OK) != 0) {
        snprintf(path, sizeof path, "%s/spool/%" PRId64 ".h5", backup->to, input->id);
        backup->missing |= access(path, F_OK) != 0;
    }
    return MODAL_OK;
}

/* A stream's file grows: the copy has at least what it had when the ledger's was made, unless the
 * stream ended between. */
static enum modal_status find_samples(void *context, const struct segment_record *segment)
{
    struct backup *backup = context;
    struct stat known;
    char path[PATH];

    samples_path(path, backup->to, segment->stream);
    backup->missing |= stat(path, &known) != 0
                       || (uint64_t)known.st_size < segment->offset + segment->length;
    return MODAL_OK;
}

static enum modal_status find_missing(struct backup *backup)
{
    struct ledger_visitor visitor = { .context = backup,
                                      .input = find_file,
                                      .segment = find_samples };
    struct ledger_reader *reader = NULL;
    enum modal_status rc = ledger_reader_open(backup->to, &reader, backup->err);

    backup->missing = false;
    if (rc == MODAL_OK)
        rc = ledger_reader_load(reader, &visitor, backup->err);
    ledger_reader_close(reader);
    return rc;
}

static enum modal_status make_copy(struct backup *backup)
{
    enum modal_status rc = MODAL_OK;

    backup->missing = true;
    for (int i = 0; rc == MODAL_OK && backup->missing; i++) {
        if (i == TRIES)
            return modal_fail(backup->err, MODAL_BUSY,
                              "files of %s come and go faster than they can be copied: try again",
                              backup->dir);
        rc = copy_files(backup);
        if (rc == MODAL_OK)
            rc = copy_tape(backup);
        if (rc == MODAL_OK)
            rc = copy_ledger(backup);
        if (rc == MODAL_OK)
            rc = copy_files(backup);
        if (rc == MODAL_OK)
            rc = find_missing(backup);
    }
    return rc;
}

/* Take away the folder FOLDER and its files; what is not a backup's stays, and then the folder
 * does. */
static void empty_folder(const char *folder)
{
    struct dirent *entry;
    DIR *list = opendir(folder);

    while (list != NULL && (entry = readdir(list)) != NULL)
        if (entry->d_name[0] != '.')
            unlinkat(dirfd(list), entry->d_name, 0);
    if (list != NULL)
        closedir(list);
    rmdir(folder);
}

static void remove_unfinished(const char *folder)
{
    static const char *const folders[] = { "/spool", "/results", "" };
    char path[PATH + 16];

    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s%s", folder, folders[i]);
        empty_folder(path);
    }
}

/* FOLDER, empty and ours alone as long as *LOCK is open: what an earlier backup left there when it
 * was ended goes. */
static enum modal_status make_unfinished(const char *folder, int *lock, struct modal_error *err)
{
    static const char *const folders[] = { "/spool", "/results" };
    char path[PATH + 16];
    enum modal_status rc;

    for (int tries = 0; tries < 2; tries++) {
        rc = file_make_dir(folder, 0750, err);
        if (rc == MODAL_OK)
            rc = file_open(folder, O_RDONLY | O_DIRECTORY, 0, lock, err);
        if (rc != MODAL_OK)
            return rc;
        if (flock(*lock, LOCK_EX | LOCK_NB) != 0) {
            close(*lock);
            *lock = -1;
            return modal_fail_field(err, MODAL_BUSY, "to", "another backup makes %s", folder);
        }
        snprintf(path, sizeof path, "%s/spool", folder);
        if (tries > 0 || access(path, F_OK) != 0)
            break;
        remove_unfinished(folder);
        close(*lock);
        *lock = -1;
    }
    for (int i = 0; rc == MODAL_OK && i < 2; i++) {
        snprintf(path, sizeof path, "%s%s", folder, folders[i]);
        rc = file_make_dir(path, 0750, err);
    }
    return rc;
}

/* On the disk, and only then under its name. */
static enum modal_status finish(const char *unfinished, const char *to, struct modal_error *err)
{
    static const char *const folders[] = { "/spool", "/results", "" };
    char path[PATH + 16], *slash;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < 3; i++) {
        snprintf(path, sizeof path, "%s%s", unfinished, folders[i]);
        rc = file_sync_dir(path, err);
    }
    if (rc == MODAL_OK)
        rc = file_rename(unfinished, to, err);
    snprintf(path, sizeof path, "%s", to);
    slash = strrchr(path, '/');
    if (slash != NULL)
        slash[slash == path] = 0;
    return rc == MODAL_OK ? file_sync_dir(slash != NULL ? path : ".", err) : rc;
}

enum modal_status backup_folder(const char *dir, const char *to, struct modal_error *err)
{
    char name[PATH - 64], unfinished[PATH];
    struct backup backup = { .dir = dir, .to = unfinished, .err = err };
    enum modal_status rc;
    int lock = -1;

    if (snprintf(name, sizeof name, "%s", to) >= (int)sizeof name)
        return modal_fail_field(err, MODAL_BAD_INPUT, "to",
                                "a path of %zu bytes; accepted: at most %zu", strlen(to),
                                sizeof name - 1);
    for (size_t n = strlen(name); n > 1 && name[n - 1] == '/'; n--)
        name[n - 1] = 0;
    snprintf(unfinished, sizeof unfinished, "%s.unfinished", name);
    if (access(name, F_OK) == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "to",
                                "%s is there already; a backup makes its folder", name);
    rc = make_unfinished(unfinished, &lock, err);
    if (rc == MODAL_OK)
        rc = make_copy(&backup);
    if (rc == MODAL_OK)
        rc = finish(unfinished, name, err);
    if (rc != MODAL_OK && lock >= 0)
        remove_unfinished(unfinished);
    if (lock >= 0)
        close(lock);
    return rc;
}
