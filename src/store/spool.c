/*
 * spool.c - inputs as HDF5 files filled by chunks; see spool.h
 *
 * Making an upload's file: HDF5 writes its structure and allocates the dataset (not filled); then
 * all blocks are reserved, and file and folder are synced.  From there on chunks go to the
 * dataset's offset by plain writes.  What is durable is what the ledger has chunks of; a file
 * without a row in the ledger is left over from a crash before the acknowledgement.
 */
#include "store/spool.h"
#include <assert.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include "base/crc32c.h"
#include "base/json.h"
#include "base/sha256.h"
#include "store/batch_h5.h"
#include "store/file.h"
#include "store/file_h5.h"
#include "store/ledger.h"
#include "store/mapping.h"

enum {
    PAGE       = 4096,       /* to which data are aligned: a mapping begins with them */
    READ_BACK  = 1 << 20,    /* bytes read at once after a restart: a chunk at least */
    CHECK_PART = 4 << 20,    /* bytes of a mapping checked before its pages may be given back */
};

struct upload {
    char dir[4096], part[4200], sealed[4200];
    int fd;
    uint64_t offset, bytes, received, hashed;
    uint32_t crc;
    struct sha256 identity;
    bool is_sealed;            /* the file has its final name already */
    bool ended;                /* the identity was taken */
};

static void set_paths(struct upload *upload, const char *dir, int64_t id)
{
    snprintf(upload->dir, sizeof upload->dir, "%s/spool", dir);
    snprintf(upload->part, sizeof upload->part, "%s/%lld.part", upload->dir, (long long)id);
    snprintf(upload->sealed, sizeof upload->sealed, "%s/%lld.h5", upload->dir, (long long)id);
}

/* --- limits --- */

static enum modal_status check_batch(const struct input_shape *shape, struct modal_error *err)
{
    if (shape->channels > SPOOL_CHANNELS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "channels",
                                "%llu channels; at most %d are taken",
                                (unsigned long long)shape->channels, SPOOL_CHANNELS_MOST);
    if (!isfinite(shape->dt) || !isfinite(shape->period))
        return modal_fail_field(err, MODAL_BAD_INPUT, isfinite(shape->dt) ? "period" : "dt",
                                "it is not a finite number of seconds");
    if (shape->units != NULL && strlen(shape->units) > SPOOL_NAME_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "units",
                                "units of %zu bytes; at most %d are taken", strlen(shape->units),
                                SPOOL_NAME_MOST);
    for (uint64_t s = 0; shape->names != NULL && s < shape->channels; s++)
        if (strlen(shape->names[s]) > SPOOL_NAME_MOST)
            return modal_fail_field(err, MODAL_TOO_LARGE, "channels",
                                    "the name of channel %llu has %zu bytes; at most %d are taken",
                                    (unsigned long long)s, strlen(shape->names[s]),
                                    SPOOL_NAME_MOST);
    return MODAL_OK;
}

static enum modal_status check_shape(const struct input_shape *shape, struct modal_error *err)
{
    uint64_t bytes = input_bytes(shape);

    if (bytes == 0 || bytes > SPOOL_BYTES_MOST)
        return modal_fail_field(
            err, bytes == 0 ? MODAL_BAD_INPUT : MODAL_TOO_LARGE,
            shape->type == INPUT_BATCH ? "samples" : "length",
            "an upload of %llu x %llu samples, %llu bytes; accepted: 1 to %llu bytes",
            (unsigned long long)shape->samples, (unsigned long long)shape->channels,
            (unsigned long long)bytes, (unsigned long long)SPOOL_BYTES_MOST);
    if (shape->attributes != NULL && strlen(shape->attributes) > SPOOL_ATTRIBUTES_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "attributes",
                                "attributes of %zu bytes; at most %d are taken",
                                strlen(shape->attributes), SPOOL_ATTRIBUTES_MOST);
    return shape->type == INPUT_BATCH ? check_batch(shape, err) : MODAL_OK;
}

/* --- beginning --- */

static enum modal_status make_set(hid_t file, const struct input_shape *shape,
                                  const cJSON *attributes, uint64_t *offset,
                                  struct modal_error *err)
{
    hid_t set = H5I_INVALID_HID;
    enum modal_status rc = batch_h5_make(file, shape, attributes, &set, err);
    haddr_t address;

    if (rc != MODAL_OK)
        return rc;
    address = H5Dget_offset(set);
    H5Dclose(set);
    if (address == HADDR_UNDEF)
        return modal_fail(err, MODAL_INTERNAL, "spool: HDF5 gave the dataset no place in the file");
    *offset = address;
    return MODAL_OK;
}

/* HDF5's own structure, through file_h5. */
static enum modal_status make_file(const char *path, const struct input_shape *shape,
                                   uint64_t *offset, struct modal_error *err)
{
    uint64_t bytes = input_bytes(shape);
    hid_t access = H5I_INVALID_HID, file = H5I_INVALID_HID;
    cJSON *attributes = NULL;
    enum modal_status rc = MODAL_OK;

    if (shape->attributes != NULL)
        rc = json_read(shape->attributes, strlen(shape->attributes), &attributes, err);
    if (rc != MODAL_OK)
        return rc;
    batch_h5_lock();
    access = file_h5_access(bytes < PAGE ? bytes : PAGE, PAGE);
    if (access >= 0)
        file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, access);
    rc = file >= 0 ? make_set(file, shape, attributes, offset, err)
                   : modal_fail(err, MODAL_IO, "%s cannot be made", path);
    if (file >= 0 && H5Fclose(file) < 0 && rc == MODAL_OK)
        rc = modal_fail(err, MODAL_IO, "%s: HDF5 could not close the file", path);
    if (access >= 0)
        H5Pclose(access);
    if (file_h5_status(err) != MODAL_OK)
        rc = file_h5_status(err);
    batch_h5_unlock();
    cJSON_Delete(attributes);
    return rc;
}

static enum modal_status reserve_file(struct upload *upload, struct modal_error *err)
{
    struct stat known;
    enum modal_status rc = file_open(upload->part, O_RDWR, 0, &upload->fd, err);

    if (rc == MODAL_OK && fstat(upload->fd, &known) < 0)
        rc = modal_fail(err, MODAL_IO, "%s: %s", upload->part, strerror(errno));
    return rc == MODAL_OK ? file_reserve(upload->fd, (uint64_t)known.st_size, err) : rc;
}

static struct upload *upload_new(const char *dir, int64_t id, const struct input_shape *shape)
{
    struct upload *upload = calloc(1, sizeof *upload);

    if (upload == NULL)
        return NULL;
    upload->fd = -1;
    upload->bytes = input_bytes(shape);
    identity_begin(&upload->identity, shape);
    set_paths(upload, dir, id);
    return upload;
}

enum modal_status upload_begin(const char *dir, int64_t id, const struct input_shape *shape,
                               struct upload **out, struct modal_error *err)
{
    enum modal_status rc = check_shape(shape, err);
    struct upload *upload;

    if (rc != MODAL_OK)
        return rc;
    upload = upload_new(dir, id, shape);
    if (upload == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "spool: no memory for an upload");
    rc = make_file(upload->part, shape, &upload->offset, err);
    if (rc == MODAL_OK)
        rc = reserve_file(upload, err);
    if (rc != MODAL_OK) {
        file_unlink(upload->part, NULL);
        upload_close(upload);
        return rc;
    }
    *out = upload;
    return MODAL_OK;
}

enum modal_status upload_keep(struct upload *upload, struct modal_error *err)
{
    enum modal_status rc = file_sync(upload->fd, err);

    return rc == MODAL_OK ? file_sync_dir(upload->dir, err) : rc;
}

/* --- going on --- */

enum modal_status spool_offset(const char *path, const struct input_shape *shape, uint64_t *offset,
                               struct modal_error *err)
{
    hid_t access, file = H5I_INVALID_HID, set = H5I_INVALID_HID;
    haddr_t address = HADDR_UNDEF;

    batch_h5_lock();
    access = file_h5_access(0, 0);
    if (access >= 0)
        file = H5Fopen(path, H5F_ACC_RDONLY, access);
    if (file >= 0)
        set = H5Dopen2(file, shape->type == INPUT_BATCH ? "signals" : "scene", H5P_DEFAULT);
    if (set >= 0) {
        address = H5Dget_offset(set);
        H5Dclose(set);
    }
    if (file >= 0)
        H5Fclose(file);
    if (access >= 0)
        H5Pclose(access);
    batch_h5_unlock();
    if (address == HADDR_UNDEF)
        return modal_fail(err, MODAL_CORRUPT, "%s: its HDF5 structure is damaged", path);
    *offset = address;
    return MODAL_OK;
}

/* One chunk back from the file, into the hash. */
static enum modal_status read_back(struct upload *upload, const struct chunk_record *chunk,
                                   unsigned char *buffer, struct modal_error *err)
{
    uint32_t crc = 0;

    if (chunk->offset != upload->received || chunk->length > upload->bytes - upload->received)
        return modal_fail(err, MODAL_CORRUPT,
                          "%s: the ledger's chunk at %llu does not follow the one before",
                          upload->part, (unsigned long long)chunk->offset);
    for (uint64_t done = 0; done < chunk->length;) {
        size_t want = chunk->length - done < READ_BACK ? (size_t)(chunk->length - done) : READ_BACK,
               got = 0;
        enum modal_status rc = file_read(upload->fd, buffer, want,
                                         upload->offset + chunk->offset + done, &got, err);
        if (rc == MODAL_OK && got < want)
            rc = modal_fail(err, MODAL_CORRUPT, "%s ends within the chunk at %llu", upload->part,
                            (unsigned long long)chunk->offset);
        if (rc != MODAL_OK)
            return rc;
        sha256_add(&upload->identity, buffer, got);
        crc = crc32c(crc, buffer, got);
        upload->crc = crc32c(upload->crc, buffer, got);
        done += got;
        upload->hashed += got;
    }
    if (crc != chunk->crc)
        return modal_fail(err, MODAL_CORRUPT,
                          "%s: the chunk at %llu (offset %llu of the file, %llu bytes) is damaged: "
                          "its checksum is %08x, not %08x",
                          upload->part, (unsigned long long)chunk->offset,
                          (unsigned long long)(upload->offset + chunk->offset),
                          (unsigned long long)chunk->length, crc, chunk->crc);
    upload->received += chunk->length;
    return MODAL_OK;
}

/* A crash may have come between the seal's rename and the ledger's row. */
static enum modal_status open_part(struct upload *upload, struct modal_error *err)
{
    enum modal_status rc = file_open(upload->part, O_RDWR, 0, &upload->fd, err);

    if (rc == MODAL_NOT_FOUND
        && file_open(upload->sealed, O_RDWR, 0, &upload->fd, NULL) == MODAL_OK) {
        upload->is_sealed = true;
        return MODAL_OK;
    }
    return rc == MODAL_NOT_FOUND
               ? modal_fail(err, MODAL_CORRUPT,
                            "%s, which the ledger has as an open upload, is missing", upload->part)
               : rc;
}

static enum modal_status resume(struct upload *upload, const struct input_shape *shape,
                                const struct chunk_record *chunks, size_t count,
                                struct modal_error *err)
{
    unsigned char *buffer = malloc(READ_BACK);
    enum modal_status rc = buffer != NULL
                               ? open_part(upload, err)
                               : modal_fail(err, MODAL_NO_MEMORY, "spool: no memory to read back");

    if (rc == MODAL_OK)
        rc = spool_offset(upload->is_sealed ? upload->sealed : upload->part, shape, &upload->offset,
                          err);
    for (size_t i = 0; rc == MODAL_OK && i < count; i++)
        rc = read_back(upload, &chunks[i], buffer, err);
    free(buffer);
    return rc;
}

enum modal_status upload_resume(const char *dir, int64_t id, const struct input_shape *shape,
                                const struct chunk_record *chunks, size_t count,
                                struct upload **out, struct modal_error *err)
{
    struct upload *upload = upload_new(dir, id, shape);
    enum modal_status rc;

    if (upload == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "spool: no memory for an upload");
    rc = resume(upload, shape, chunks, count, err);
    if (rc != MODAL_OK) {
        upload_close(upload);
        return rc;
    }
    *out = upload;
    return MODAL_OK;
}

uint64_t upload_received(const struct upload *upload)
{
    return upload->received;
}

uint64_t upload_offset(const struct upload *upload)
{
    return upload->offset;
}

uint32_t upload_crc(const struct upload *upload)
{
    return upload->crc;
}

/* --- chunks --- */

enum modal_status upload_write(struct upload *upload, uint64_t offset,
                               const struct upload_part *parts, size_t count,
                               struct modal_error *err)
{
    uint64_t end = offset;
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; i < count; i++) {
        if (offset != upload->received || parts[i].length > upload->bytes - end)
            return modal_fail(
                err, MODAL_BAD_FRAME, "a chunk of %zu bytes at %llu; the next is at %llu of %llu",
                parts[i].length, (unsigned long long)end, (unsigned long long)upload->received,
                (unsigned long long)upload->bytes);
        end += parts[i].length;
    }
    for (size_t i = 0; rc == MODAL_OK && i < count; offset += parts[i++].length)
        rc = file_write(upload->fd, parts[i].data, parts[i].length, upload->offset + offset, err);
    if (rc == MODAL_OK)
        rc = file_sync_begin(upload->fd, upload->offset + upload->received, end - upload->received,
                             err);
    for (size_t i = 0; rc == MODAL_OK && i < count; i++) {
        upload->crc = crc32c_join(upload->crc, parts[i].crc, parts[i].length);
        upload->received += parts[i].length;
    }
    return rc;
}

void upload_hash(struct upload *upload, const struct upload_part *parts, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        sha256_add(&upload->identity, parts[i].data, parts[i].length);
        upload->hashed += parts[i].length;
    }
}

enum modal_status upload_sync(struct upload *upload, struct modal_error *err)
{
    return file_sync(upload->fd, err);
}

enum modal_status upload_name(struct upload *upload, uint8_t sha256[32], struct modal_error *err)
{
    enum modal_status rc;

    assert(upload->hashed == upload->received);
    if (upload->received != upload->bytes || upload->ended)
        return modal_fail(err, MODAL_BAD_FRAME,
                          upload->ended ? "the upload of %llu bytes (%llu there) is sealed already"
                                        : "the upload of %llu bytes has only %llu",
                          (unsigned long long)upload->bytes, (unsigned long long)upload->received);
    rc = file_sync(upload->fd, err);
    if (rc == MODAL_OK && !upload->is_sealed)
        rc = file_rename(upload->part, upload->sealed, err);
    if (rc != MODAL_OK)
        return rc;
    upload->is_sealed = upload->ended = true;
    sha256_end(&upload->identity, sha256);
    return MODAL_OK;
}

enum modal_status upload_seal(struct upload *upload, uint8_t sha256[32], struct modal_error *err)
{
    enum modal_status rc = upload_name(upload, sha256, err);

    return rc == MODAL_OK ? file_sync_dir(upload->dir, err) : rc;
}

void upload_close(struct upload *upload)
{
    if (upload == NULL)
        return;
    if (upload->fd >= 0)
        close(upload->fd);
    free(upload);
}

/* --- the folder --- */

enum modal_status spool_sync(const char *dir, struct modal_error *err)
{
    struct upload paths;

    set_paths(&paths, dir, 0);
    return file_sync_dir(paths.dir, err);
}

enum modal_status spool_remove(const char *dir, int64_t id, struct modal_error *err)
{
    struct upload paths;
    enum modal_status rc;

    set_paths(&paths, dir, id);
    rc = file_unlink(paths.part, err);
    return rc == MODAL_OK ? file_unlink(paths.sealed, err) : rc;
}

void spool_path(char path[4096], const char *dir, int64_t id)
{
    snprintf(path, 4096, "%s/spool/%lld.h5", dir, (long long)id);
}

/* "12.part" is part 12, and so on; anything else is SPOOL_OTHER. */
static enum spool_file classify(const char *name, bool results, int64_t *id)
{
    char *end;

    errno = 0;
    *id = strtoll(name, &end, 10);
    if (errno != 0 || end == name || *id < 1 || name[0] < '1' || name[0] > '9')
        return SPOOL_OTHER;
    if (results)
        return strcmp(end, ".json") == 0 ? SPOOL_RESULT : SPOOL_OTHER;
    return strcmp(end, ".part") == 0      ? SPOOL_PART
           : strcmp(end, ".h5") == 0      ? SPOOL_SEALED
           : strcmp(end, ".samples") == 0 ? SPOOL_SAMPLES
                                          : SPOOL_OTHER;
}

typedef void found_file(void *context, enum spool_file what, int64_t id, uint64_t bytes,
                        const char *path);

static enum modal_status list_one(const char *dir, bool results, found_file *found, void *context,
                                  struct modal_error *err)
{
    char folder[4200], path[8192];
    struct dirent *entry;
    struct stat known;
    DIR *open;

    snprintf(folder, sizeof folder, "%s/%s", dir, results ? "results" : "spool");
    open = opendir(folder);
    if (open == NULL)
        return modal_fail(err, errno == ENOENT ? MODAL_NOT_FOUND : MODAL_IO, "%s: %s", folder,
                          strerror(errno));
    while ((entry = readdir(open)) != NULL) {
        int64_t id = 0;
        enum spool_file what = classify(entry->d_name, results, &id);
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        if (entry->d_name[0] != '.' && lstat(path, &known) == 0)
            found(context, what, id, (uint64_t)known.st_size, path);
    }
    closedir(open);
    return MODAL_OK;
}

enum modal_status spool_list(const char *dir, found_file *found, void *context,
                             struct modal_error *err)
{
    enum modal_status rc = list_one(dir, false, found, context, err);

    return rc == MODAL_OK ? list_one(dir, true, found, context, err) : rc;
}

/* --- mapping --- */

/* The checksum of what is mapped; pages beyond the memory limit are not kept. */
static uint32_t check_of(const struct mapping *map)
{
    const size_t part = CHECK_PART;
    bool keep = map->length <= mapping_resident_most();
    uint32_t crc = 0;

    for (size_t at = 0, n; at < map->length; at += n) {
        const char *from = (const char *)map->data + at;
        n = map->length - at < part ? map->length - at : part;
        crc = crc32c(crc, from, n);
        if (!keep)
            mapping_release(from, n);
    }
    return crc;
}

enum modal_status spool_map_open(int fd, const char *path, uint64_t offset, uint64_t length,
                                 uint32_t crc, struct mapping *out, struct modal_error *err)
{
    struct mapping map;
    enum modal_status rc = mapping_open(fd, path, offset, length, &map, err);

    if (rc != MODAL_OK)
        return rc;
    madvise(map.base, map.mapped, MADV_SEQUENTIAL);
    if (check_of(&map) != crc) {
        mapping_close(&map);
        return modal_fail(err, MODAL_CORRUPT, "%s is damaged: the checksum of its data is wrong",
                          path);
    }
    madvise(map.base, map.mapped, MADV_NORMAL);
    *out = map;
    return MODAL_OK;
}

/* --- the reserve --- */

static uint64_t held_now(const char *path)
{
    struct stat known;

    return stat(path, &known) == 0 ? (uint64_t)known.st_size : 0;
}

uint64_t reserve_lacks(const char *dir, uint64_t bytes)
{
    char path[4200];
    uint64_t held;

    snprintf(path, sizeof path, "%s/RESERVE", dir);
    held = held_now(path);
    return held < bytes ? bytes - held : 0;
}

enum modal_status reserve_hold(const char *dir, uint64_t bytes, struct modal_error *err)
{
    char path[4200];
    struct statvfs room;
    uint64_t held;
    int fd = -1;
    enum modal_status rc;

    snprintf(path, sizeof path, "%s/RESERVE", dir);
    held = held_now(path);
    if (held == bytes)
        return MODAL_OK;
    if (held < bytes && statvfs(dir, &room) == 0
        && (uint64_t)room.f_bavail * room.f_frsize < bytes - held + bytes / 4)
        return modal_fail(err, MODAL_STORAGE_FULL, "no room for a reserve of %llu bytes",
                          (unsigned long long)bytes);
    rc = file_open(path, O_RDWR | O_CREAT, 0640, &fd, err);
    if (rc == MODAL_OK)
        rc = file_reserve(fd, bytes, err);
    if (rc == MODAL_OK)
        rc = file_truncate(fd, bytes, err);
    if (fd >= 0)
        close(fd);
    if (rc != MODAL_OK)
        file_unlink(path, NULL);
    return rc;
}

enum modal_status reserve_release(const char *dir, struct modal_error *err)
{
    char path[4200];

    snprintf(path, sizeof path, "%s/RESERVE", dir);
    return file_unlink(path, err);
}
