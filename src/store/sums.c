/* sums.c - see sums.h */
#include "store/sums.h"
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/crc32c.h"
#include "store/file.h"
#include "store/ledger.h"
#include "store/spool.h"

static enum modal_status put(struct sums *sums, const struct chunk_record *part,
                             struct modal_error *err)
{
    if (sums->count == sums->room) {
        size_t room = sums->room > 0 ? 2 * sums->room : 64;
        struct chunk_record *items = realloc(sums->items, room * sizeof *items);
        if (items == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "no memory for %zu checksums", room);
        sums->items = items;
        sums->room = room;
    }
    sums->items[sums->count++] = *part;
    return MODAL_OK;
}

enum modal_status sums_add(struct sums *sums, uint64_t length, uint32_t crc,
                           struct modal_error *err)
{
    struct chunk_record *last = sums->count > 0 ? &sums->items[sums->count - 1] : NULL;
    uint64_t end = last != NULL ? last->offset + last->length : 0;

    if (last == NULL || last->length + length > LEDGER_CHUNK_MOST)
        return put(sums, &(struct chunk_record) { end, length, crc }, err);
    last->crc = crc32c_join(last->crc, crc, length);
    last->length += length;
    return MODAL_OK;
}

/* What is asked of INPUT, with its file open. */
struct reading {
    const struct sealed_input *input;
    int fd;
    struct sums parts;          /* that the range touches */
    struct modal_error *err;
};

static enum modal_status damaged(const struct reading *r, const struct chunk_record *part)
{
    return modal_fail(r->err, MODAL_CORRUPT,
                      "the stored input is damaged: bytes %llu to %llu do not have their checksum",
                      (unsigned long long)part->offset,
                      (unsigned long long)(part->offset + part->length - 1));
}

/* PART's bytes into DATA; what is short or differs is never told as good. */
static enum modal_status get_part(const struct reading *r, const struct chunk_record *part,
                                  char *data)
{
    size_t got = 0;
    enum modal_status rc = file_read(r->fd, data, part->length, r->input->place + part->offset,
                                     &got, r->err);

    if (rc == MODAL_OK && (got < part->length || crc32c(0, data, got) != part->crc))
        rc = damaged(r, part);
    return rc;
}

static enum modal_status add_part(void *context, const struct chunk_record *part)
{
    struct reading *r = context;

    return put(&r->parts, part, r->err);
}

/* All of the input against the one checksum that there is; the parts' are the caller's from then
 * on. */
static enum modal_status sum_all(struct reading *r, struct sums *out)
{
    const struct sealed_input *input = r->input;
    char *block = malloc(LEDGER_CHUNK_MOST);
    struct sums sums = { NULL, 0, 0 };
    uint32_t crc = 0;
    enum modal_status rc = MODAL_OK;

    if (block == NULL)
        rc = modal_fail(r->err, MODAL_NO_MEMORY, "no memory to read an input");
    for (uint64_t at = 0; rc == MODAL_OK && at < input->bytes;) {
        uint64_t left = input->bytes - at;
        size_t want = left < LEDGER_CHUNK_MOST ? (size_t)left : LEDGER_CHUNK_MOST, got = 0;
        uint32_t part;
        rc = file_read(r->fd, block, want, input->place + at, &got, r->err);
        part = crc32c(0, block, got);
        crc = crc32c_join(crc, part, got);
        at += want;
        if (rc == MODAL_OK && (got < want || (at == input->bytes && crc != input->crc)))
            rc = damaged(r, &(struct chunk_record) { 0, input->bytes, 0 });
        if (rc == MODAL_OK)
            rc = sums_add(&sums, got, part, r->err);
    }
    free(block);
    if (rc == MODAL_OK)
        *out = sums;
    else
        free(sums.items);
    return rc;
}

/* The parts that the range touches: the ledger's, or those of OUT. */
static enum modal_status find_parts(struct reading *r, struct ledger_reader *reader, uint64_t from,
                                    uint64_t to, struct sums *out)
{
    enum modal_status rc = ledger_read_chunks(reader, r->input->id, from, to, add_part, r, r->err);

    if (rc != MODAL_OK || r->parts.count > 0)
        return rc;
    rc = sum_all(r, out);
    for (size_t i = 0; rc == MODAL_OK && i < out->count; i++)
        if (out->items[i].offset < to && out->items[i].offset + out->items[i].length > from)
            rc = put(&r->parts, &out->items[i], r->err);
    return rc;
}

/* Do the parts cover [FROM, TO) without a hole? */
static bool covers(const struct sums *parts, uint64_t from, uint64_t to)
{
    uint64_t end = from;

    for (size_t i = 0; i < parts->count; i++) {
        if (i == 0 ? parts->items[i].offset > from : parts->items[i].offset != end)
            return false;
        end = parts->items[i].offset + parts->items[i].length;
    }
    return end >= to;
}

static enum modal_status get_range(const struct reading *r, uint64_t from, uint64_t to, char **out)
{
    const struct chunk_record *first = r->parts.items, *last = first + r->parts.count - 1;
    char *data = malloc(last->offset + last->length - first->offset);
    enum modal_status rc = MODAL_OK;

    if (data == NULL)
        rc = modal_fail(r->err, MODAL_NO_MEMORY, "no memory to read an input");
    for (const struct chunk_record *part = first; rc == MODAL_OK && part <= last; part++)
        rc = get_part(r, part, data + (part->offset - first->offset));
    if (rc != MODAL_OK) {
        free(data);
        return rc;
    }
    memmove(data, data + (from - first->offset), to - from);
    *out = data;
    return MODAL_OK;
}

enum modal_status sums_read(const char *dir, struct ledger_reader *reader,
                            const struct sealed_input *input, uint64_t offset,
                            uint64_t length, char **data, size_t *got, struct sums *out,
                            struct modal_error *err)
{
    uint64_t from = offset < input->bytes ? offset : input->bytes;
    uint64_t to = length < input->bytes - from ? from + length : input->bytes;
    struct reading r = { .input = input, .fd = -1, .err = err };
    char path[4096];
    enum modal_status rc;

    spool_path(path, dir, input->id);
    rc = file_open(path, O_RDONLY, 0, &r.fd, err);
    if (rc == MODAL_NOT_FOUND)
        rc = modal_fail(err, MODAL_CORRUPT, "the stored input is damaged: its file is missing");
    if (rc == MODAL_OK && from < to)
        rc = find_parts(&r, reader, from, to, out);
    if (rc == MODAL_OK && from < to && !covers(&r.parts, from, to))
        rc = modal_fail(err, MODAL_CORRUPT, "the ledger lacks the checksum of a part of the input");
    if (rc == MODAL_OK && from < to)
        rc = get_range(&r, from, to, data);
    else if (rc == MODAL_OK && (*data = malloc(1)) == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "no memory to read an input");
    if (r.fd >= 0)
        close(r.fd);
    free(r.parts.items);
    if (rc == MODAL_OK)
        *got = (size_t)(to - from);
    return rc;
}
