/* samples.c - see samples.h */
#include "store/samples.h"
#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>
#include "modal/crc32c.h"
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

/* The open file of stream ID; where no more may be open, those that are go to disk first. */
static enum modal_status file_of(struct samples_files *files, int64_t id, int *fd, struct modal_error *err)
{
    char path[4200];
    enum modal_status rc = MODAL_OK;

    for (int i = 0; i < files->count; i++)
        if (files->file[i].id == id) {
            *fd = files->file[i].fd;
            return MODAL_OK;
        }
    if (files->count == SAMPLES_FILES) {
        rc = samples_sync(files, err);
        samples_close(files);
    }
    samples_path(path, files->dir, id);
    if (rc == MODAL_OK)
        rc = file_open(path, O_WRONLY | O_CREAT, 0640, fd, err);
    if (rc == MODAL_OK)
        files->file[files->count++] = (struct samples_file) { id, *fd };
    return rc;
}

enum modal_status samples_put(struct samples_files *files, const struct segment_record *segment, struct modal_error *err)
{
    int fd = -1;
    enum modal_status rc = file_of(files, segment->stream, &fd, err);

    files->made |= segment->offset == 0;
    return rc == MODAL_OK ? file_write(fd, segment->data, segment->length, segment->offset, err) : rc;
}

enum modal_status samples_sync(struct samples_files *files, struct modal_error *err)
{
    char spool[4200];
    enum modal_status rc = MODAL_OK;

    for (int i = 0; rc == MODAL_OK && i < files->count; i++)
        rc = file_sync(files->file[i].fd, err);
    snprintf(spool, sizeof spool, "%s/spool", files->dir);
    if (rc == MODAL_OK && files->made)
        rc = file_sync_dir(spool, err);
    files->made = false;
    return rc;
}

void samples_close(struct samples_files *files)
{
    while (files->count > 0)
        close(files->file[--files->count].fd);
}

enum modal_status samples_get(int fd, const struct segment_record *segment, void *data, struct modal_error *err)
{
    size_t got = 0;
    enum modal_status rc = file_read(fd, data, segment->length, segment->offset, &got, err);

    if (rc == MODAL_OK && (got < segment->length || crc32c(0, data, got) != segment->crc))
        rc = modal_fail(err, MODAL_CORRUPT, "the samples of stream %lld at offset %llu of its file (%llu bytes) are damaged: %zu bytes, or a wrong checksum",
                        (long long)segment->stream, (unsigned long long)segment->offset, (unsigned long long)segment->length, got);
    return rc;
}
