/* bytes.c - see bytes.h */
#define ZLIB_CONST                    /* it changes nothing that it reads */
#include "bytes.h"
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

enum {
    FLOAT_BYTES   = 4,        /* of the short kind */
    DEFLATE_RATIO = 1032,     /* 258 bytes by two bits, the most that deflate can say */
    PIECE = 16384,            /* bytes, whole numbers of any size: what fits a first cache */
};

size_t bytes_left(const struct bytes *bytes)
{
    return bytes->length - bytes->at;
}

const unsigned char *bytes_next(struct bytes *bytes, size_t count)
{
    const unsigned char *here = bytes->data + bytes->at;

    if (count > bytes_left(bytes))
        return NULL;
    bytes->at += count;
    return here;
}

static uint64_t bits_of(struct number_type type, const unsigned char *from)
{
    uint64_t bits = 0;

    for (int i = 0; i < type.size; i++)
        bits |= (uint64_t)from[type.big ? type.size - 1 - i : i] << (CHAR_BIT * i);
    return bits;
}

double number_decode(struct number_type type, const unsigned char *from)
{
    uint64_t bits = bits_of(type, from);
    int above = CHAR_BIT * ((int)sizeof bits - type.size);
    uint32_t half = (uint32_t)bits;
    double number;
    float single;

    if (type.kind == NUMBER_UINT)
        return (double)bits;
    if (type.kind == NUMBER_INT)
        return (double)((int64_t)(bits << above) >> above);
    memcpy(&number, &bits, sizeof number);
    memcpy(&single, &half, sizeof single);
    return type.size == FLOAT_BYTES ? (double)single : number;
}

void numbers_decode(struct number_type type, const unsigned char *from, size_t count, double *to)
{
    for (size_t i = 0; i < count; i++)
        to[i] = number_decode(type, from + i * (size_t)type.size);
}

void numbers_put(struct number_type type, const unsigned char *from, size_t count,
                 struct numbers *into)
{
    for (size_t i = 0; i < count; i++) {
        into->to[into->at * into->lines + into->at_line] =
            number_decode(type, from + i * (size_t)type.size);
        if (++into->at == into->line) {
            into->at = 0;
            into->at_line++;
        }
    }
}

bool bytes_size(struct bytes *bytes, struct number_type type, size_t *out)
{
    const unsigned char *from = bytes_next(bytes, (size_t)type.size);

    if (from == NULL || (type.kind == NUMBER_INT && number_decode(type, from) < 0))
        return false;
    *out = (size_t)bits_of(type, from);
    return true;
}

size_t inflated_most(size_t length)
{
    return length < SIZE_MAX / DEFLATE_RATIO ? length * DEFLATE_RATIO : SIZE_MAX;
}

struct inflater { z_stream z; size_t left; bool raw, ended; uint32_t crc; };

struct inflater *inflater_new(struct bytes from, bool raw)
{
    struct inflater *f = calloc(1, sizeof *f);

    if (f == NULL)
        return NULL;
    f->z.next_in = from.data + from.at;
    f->left = bytes_left(&from);
    f->raw = raw;
    if (inflateInit2(&f->z, raw ? -MAX_WBITS : MAX_WBITS) != Z_OK) {
        free(f);
        return NULL;
    }
    return f;
}

void inflater_free(struct inflater *f)
{
    if (f != NULL)
        inflateEnd(&f->z);
    free(f);
}

bool inflater_read(struct inflater *f, unsigned char *to, size_t room, size_t *got)
{
    int rc = f->ended ? Z_STREAM_END : Z_OK;

    *got = 0;
    while (rc == Z_OK && *got < room) {
        uInt in = f->left < UINT_MAX ? (uInt)f->left : UINT_MAX;
        uInt out = room - *got < UINT_MAX ? (uInt)(room - *got) : UINT_MAX;
        f->z.avail_in = in;
        f->z.avail_out = out;
        f->z.next_out = to + *got;
        rc = inflate(&f->z, Z_NO_FLUSH);
        f->left -= in - f->z.avail_in;
        *got += out - f->z.avail_out;
    }
    f->ended = rc == Z_STREAM_END;
    if (f->raw)
        f->crc = (uint32_t)crc32_z(f->crc, to, *got);
    return rc == Z_OK || rc == Z_STREAM_END;
}

bool inflater_numbers(struct inflater *f, struct number_type type, size_t count,
                      struct numbers *into)
{
    unsigned char piece[PIECE];
    size_t most = PIECE / (size_t)type.size, got;

    while (count > 0) {
        size_t n = count < most ? count : most;
        if (!inflater_read(f, piece, n * (size_t)type.size, &got) || got < n * (size_t)type.size)
            return false;
        numbers_put(type, piece, n, into);
        count -= n;
    }
    return true;
}

bool inflater_pass(struct inflater *f, size_t count)
{
    unsigned char piece[PIECE];
    size_t got;

    for (; count > 0; count -= got)
        if (!inflater_read(f, piece, count < PIECE ? count : PIECE, &got) || got == 0)
            return false;
    return true;
}

uint32_t inflater_crc(const struct inflater *f)
{
    return f->crc;
}

bool inflate_bytes(struct bytes from, unsigned char *to, size_t room, size_t *got)
{
    struct inflater *f = inflater_new(from, true);
    bool ok = f != NULL && inflater_read(f, to, room, got);

    inflater_free(f);
    return ok;
}
