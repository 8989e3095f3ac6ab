/* samples.c - see samples.h */
#include "store/samples.h"
#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>
#include "base/crc32c.h"
#include "store/file.h"

void samples_path(char path[4200], const char *dir, int64_t id)
{
    snprintf(path, 4200, "%s/spool/%lld.samples", dir, (long long)id);
}

enum modal_status samples_remove(const char *dir, int64_t id, struct modal_error *err)
{
    char path[4200];

    samples_path(path, dir, id);
    return file_unlink(path, err);
}

/* written before the disk begins with them, while more is written behind them */
enum { BEGIN_BYTES = 512 << 10 };

/* The open file of stream ID, which OFFSET is the first for in this group; where no more may be
 * open, those that are go to disk first. */
static enum modal_status file_of(struct samples_files *files, int64_t id, uint64_t offset,
                                 struct samples_file **file, struct modal_error *err)
{
    char path[4200];
    int fd = -1;
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < files->count; i++)
        if (files->file[i].id == id) {
            *file = &files->file[i];
            return MODAL_OK;
        }
    if (files->count == SAMPLES_FILES) {
        rc = samples_sync(files, err);
        samples_close(files);
    }
    samples_path(path, files->dir, id);
    if (rc == MODAL_OK)
        rc = file_open(path, O_WRONLY | O_CREAT, 0640, &fd, err);
    if (rc != MODAL_OK)
        return rc;
    *file = &files->file[files->count++];
    **file = (struct samples_file) { .id = id, .fd = fd, .first = offset };
    return MODAL_OK;
}

/* [FROM, TO) was written. */
static enum modal_status begin_writing(struct samples_file *file, uint64_t from, uint64_t to,
                                       struct modal_error *err)
{
    if (from != file->to || file->from == file->to)
        file->from = from;
    file->to = to;
    if (to - file->from < BEGIN_BYTES)
        return MODAL_OK;
    from = file->from;
    file->from = to;
    return file_sync_begin(file->fd, from, to - from, err);
}

enum modal_status samples_put(struct samples_files *files, const struct segment_record *segment,
                              struct modal_error *err)
{
    struct samples_file *file = NULL;
    enum modal_status rc = file_of(files, segment->stream, segment->offset, &file, err);

    files->made |= segment->offset == 0;
    if (rc == MODAL_OK)
        rc = file_write(file->fd, segment->data, segment->length, segment->offset, err);
    return rc == MODAL_OK
               ? begin_writing(file, segment->offset, segment->offset + segment->length, err)
               : rc;
}

enum modal_status samples_sync(struct samples_files *files, struct modal_error *err)
{
    char spool[4200];
    enum modal_status rc = MODAL_OK;

    /* the disk has all of it before the first is waited for */
    for (int i = 0; rc == MODAL_OK && files->count > 1 && i < files->count; i++) {
        const struct samples_file *file = &files->file[i];
        rc = file_sync_begin(file->fd, file->from, file->to - file->from, err);
    }
    for (int i = 0; rc == MODAL_OK && i < files->count; i++)
        rc = file_sync(files->file[i].fd, err);
    snprintf(spool, sizeof spool, "%s/spool", files->dir);
    if (rc == MODAL_OK && files->made)
        rc = file_sync_dir(spool, err);
    files->made = false;
    return rc;
}

void samples_revert(struct samples_files *files)
{
    for (int i = 0; i < files->count; i++)
        file_truncate(files->file[i].fd, files->file[i].first, NULL);
}

void samples_close(struct samples_files *files)
{
    while (files->count > 0)
        close(files->file[--files->count].fd);
}

enum modal_status samples_get(int fd, const struct segment_record *segment, void *data,
                              struct modal_error *err)
{
    size_t got = 0;
    enum modal_status rc = file_read(fd, data, segment->length, segment->offset, &got, err);

    if (rc == MODAL_OK && (got < segment->length || crc32c(0, data, got) != segment->crc))
        rc = modal_fail(err, MODAL_CORRUPT,
                        "the samples of stream %lld at offset %llu of its file (%llu bytes) are "
                        "damaged: %zu bytes, or a wrong checksum",
                        (long long)segment->stream, (unsigned long long)segment->offset,
                        (unsigned long long)segment->length, got);
    return rc;
}
