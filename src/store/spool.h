/* spool.h - large inputs as files of the data folder, filled by chunks and then never changed
 *
 * An input being uploaded is DIR/spool/ID.part: an HDF5 file whose dataset (`signals`, float64,
 * samples x channels; or `scene`, uint8) is contiguous, with its final shape and attributes from
 * the start and its blocks reserved, so that chunks are written at their offset and no later write
 * meets a full disk.  Sealing checks the length, hashes, syncs, renames to ID.h5, syncs the folder.
 * After that the file is never written again; any HDF5 tool can open it, workers map it.
 *
 * Chunks arrive in order.  One thread at a time works on an upload, but for upload_hash; different
 * uploads are independent.
 */
#ifndef STORE_SPOOL_H
#define STORE_SPOOL_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/error.h"
#include "store/identity.h"

struct mapping;

/* The wire's limits or more: what it let through is not refused here. */
enum {
    SPOOL_CHANNELS_MOST = 65536,   /* as WIRE_CHANNELS_MOST */
    SPOOL_NAME_MOST = 256,                  /* bytes of a channel's name, or of `units` */
    SPOOL_ATTRIBUTES_MOST = 256 * 1024,     /* bytes of the attributes' text */
};
#define SPOOL_BYTES_MOST ((uint64_t)1 << 40)   /* a TB: posix_fallocate asks the disk before that */

struct upload;

/* Begin upload ID in the data folder DIR: its file made, its space reserved.  MODAL_BAD_INPUT (a
 * shape out of range; the field is named), MODAL_STORAGE_FULL (nothing is left behind),
 * MODAL_IO. */
enum modal_status upload_begin(const char *dir, int64_t id, const struct input_shape *shape,
                               struct upload **out, struct modal_error *err);
/* That it was begun is on stable storage: it can be resumed.  MODAL_IO: end the process. */
enum modal_status upload_keep(struct upload *upload, struct modal_error *err);
/* Go on with upload ID after a restart: its first RECEIVED bytes, which the ledger holds as
 * durable, are read back, checked against the CRC-32C of each of CHUNKS (in order, covering them)
 * and hashed.  MODAL_CORRUPT names the chunk that differs. */
struct chunk_record;
enum modal_status upload_resume(const char *dir, int64_t id, const struct input_shape *shape,
                                const struct chunk_record *chunks, size_t count,
                                struct upload **out, struct modal_error *err);

/* Bytes written so far, which is the offset of the next chunk; the offset of the data in the file;
 * CRC-32C of the bytes written so far. */
uint64_t upload_received(const struct upload *upload);
uint64_t upload_offset(const struct upload *upload);
uint32_t upload_crc(const struct upload *upload);

/* A chunk, borrowed, and its CRC-32C. */
struct upload_part { const void *data; size_t length; uint32_t crc; };

/* Write COUNT chunks that follow each other from OFFSET, which must be upload_received.  Their
 * CRC-32C is taken as given.  They are durable, and may be put in the ledger, after
 * the next upload_sync; the disk writes already. MODAL_BAD_FRAME: out of order, or past the end. */
enum modal_status upload_write(struct upload *upload, uint64_t offset,
                               const struct upload_part *parts, size_t count,
                               struct modal_error *err);
/* The same chunks into the identity, in the same order; another thread may do it while they are
 * written and synced. */
void upload_hash(struct upload *upload, const struct upload_part *parts, size_t count);
/* All that was written is on stable storage.  MODAL_IO: its state is unknown, end the process. */
enum modal_status upload_sync(struct upload *upload, struct modal_error *err);
/* Seal it; its identity into SHA256.  MODAL_BAD_FRAME where bytes are missing.  The handle remains,
 * to be closed. */
enum modal_status upload_seal(struct upload *upload, uint8_t sha256[32], struct modal_error *err);
/* The same, but that it is sealed is on stable storage only after spool_sync: once for many. */
enum modal_status upload_name(struct upload *upload, uint8_t sha256[32], struct modal_error *err);
/* The names of DIR's spool are on stable storage.  MODAL_IO: end the process. */
enum modal_status spool_sync(const char *dir, struct modal_error *err);
/* Release the handle; the file stays as it is. */
void upload_close(struct upload *upload);

/* Where the data of the upload or input at PATH lies in it.  MODAL_CORRUPT: its HDF5 structure is
 * damaged. */
enum modal_status spool_offset(const char *path, const struct input_shape *shape, uint64_t *offset,
                               struct modal_error *err);

/* Remove input ID, sealed or not; absent is no error. */
enum modal_status spool_remove(const char *dir, int64_t id, struct modal_error *err);
/* The path of sealed input ID. */
void spool_path(char path[4096], const char *dir, int64_t id);
enum spool_file { SPOOL_PART, SPOOL_SEALED, SPOOL_SAMPLES, SPOOL_RESULT, SPOOL_OTHER };

/* Call FOUND for each file of the spool and the results: what recovery compares with the ledger, to
 * remove orphans and report the missing. */
enum modal_status spool_list(const char *dir,
                             void (*found)(void *context, enum spool_file what, int64_t id,
                                           uint64_t bytes, const char *path),
                             void *context, struct modal_error *err);

/* The data of a sealed input, mapped read-only for a worker, from its open file FD, which stays the
 * caller's and is PATH in messages.  The whole of it is checked against CRC: MODAL_CORRUPT. */
enum modal_status spool_map_open(int fd, const char *path, uint64_t offset, uint64_t length,
                                 uint32_t crc, struct mapping *out, struct modal_error *err);

/* Keep BYTES of DIR/RESERVE in hand, more or less than there were, or give them up when the disk is
 * full, so that results and deletes still pass.  Holding more takes a quarter of BYTES of room
 * besides, else MODAL_STORAGE_FULL and it stays as it was. */
enum modal_status reserve_hold(const char *dir, uint64_t bytes, struct modal_error *err);
enum modal_status reserve_release(const char *dir, struct modal_error *err);
/* How much less than BYTES is held of it now; 0: as much or more. */
uint64_t reserve_lacks(const char *dir, uint64_t bytes);

#endif
