/* bytes.c - see bytes.h */
#define ZLIB_CONST                    /* it changes nothing that it reads */
#include "bytes.h"
#include <limits.h>
#include <string.h>
#include <zlib.h>

enum {
    FLOAT_BYTES   = 4,        /* of the short kind */
    DEFLATE_RATIO = 1032,     /* 258 bytes by two bits, the most that deflate can say */
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

bool inflate_bytes(struct bytes from, bool raw, unsigned char *to, size_t room, size_t *got)
{
    z_stream z = { .next_in = from.data + from.at };
    size_t left = bytes_left(&from);
    int rc = inflateInit2(&z, raw ? -MAX_WBITS : MAX_WBITS);

    *got = 0;
    if (rc != Z_OK)
        return false;
    while (rc == Z_OK && *got < room) {
        uInt in = left < UINT_MAX ? (uInt)left : UINT_MAX;
        uInt out = room - *got < UINT_MAX ? (uInt)(room - *got) : UINT_MAX;
        z.avail_in = in;
        z.avail_out = out;
        z.next_out = to + *got;
        rc = inflate(&z, Z_NO_FLUSH);
        left -= in - z.avail_in;
        *got += out - z.avail_out;
    }
    inflateEnd(&z);
    return rc == Z_STREAM_END || (rc == Z_OK && *got == room);
}
