/* sums.h - the checksums of a sealed input's parts, and its bytes held against them
 *
 * The ledger has a CRC-32C of each chunk of an upload.  A batch that the daemon puts together
 * itself (a sealed stream) gets rows like those of chunks, of at most LEDGER_CHUNK_MOST bytes
 * each; those of before have only the CRC-32C of the whole.
 */
#ifndef STORE_SUMS_H
#define STORE_SUMS_H
#include <stddef.h>
#include <stdint.h>
#include "base/error.h"

struct chunk_record;
struct ledger_reader;

/* Parts that follow each other from offset 0; zero it, free `items`. */
struct sums {
    struct chunk_record *items;
    size_t count, room;
};

/* LENGTH more bytes (at most LEDGER_CHUNK_MOST) of checksum CRC: to the last part while there is
 * room in it. */
enum modal_status sums_add(struct sums *sums, uint64_t length, uint32_t crc,
                           struct modal_error *err);

/* Sealed input ID: BYTES of data at PLACE of its file, of checksum CRC in all. */
struct sealed_input { int64_t id; uint64_t place, bytes; uint32_t crc; };

/*
 * Bytes [OFFSET, OFFSET + LENGTH) of INPUT, as far as it goes; the caller frees *DATA.  Each part
 * that they touch is read whole and held against its checksum.  Where the ledger has no checksums
 * of parts all of the input is read and held against its own, and OUT gets those of its parts, to
 * be put into the ledger; else OUT stays empty.  MODAL_CORRUPT: bytes are missing or differ, or
 * the file is missing.  MODAL_NO_MEMORY, MODAL_IO, MODAL_BUSY.
 */
enum modal_status sums_read(const char *dir, struct ledger_reader *reader,
                            const struct sealed_input *input, uint64_t offset,
                            uint64_t length, char **data, size_t *got, struct sums *out,
                            struct modal_error *err);
#endif
