/* matlab.c - see matlab.h
 *
 * [MAT] MATLAB MAT-File Format, version 5: 128 bytes of head, whose last four are the version and
 * "IM" where it is little endian, "MI" where big.  Then elements, each a tag (type, length: 4 bytes
 * each; or 2 and 2, and 4 bytes of data), its data, and bytes up to the next eighth.  A matrix is
 * an element that holds elements: flags, sizes, name, numbers.  A compressed element holds,
 * deflated, one matrix.
 */
#include "matlab.h"
#include <stdlib.h>
#include <string.h>
#include "arrays.h"

enum {
    HEAD_BYTES = 128,                    /* and where in them: */
    VERSION_AT = 124,                    /* two bytes */
    ORDER_AT   = 126,                    /* two letters */
    PREFIX = 1024,                       /* bytes of a matrix that hold its flags, sizes, name */
    TAG_BYTES = 8,                       /* of the long form */
    ALIGNED = 8,                         /* bytes: where an element begins */
    SHORT_MOST = 4,                      /* bytes of data that a tag can hold itself */
    TYPE_INT8       = 1,                 /* [MAT], table 1-1 */
    TYPE_INT32      = 5,                 /* of sizes */
    TYPE_UINT32     = 6,                 /* of flags */
    TYPE_MATRIX     = 14,                /* of elements, or deflated */
    TYPE_COMPRESSED = 15,                /* one deflated element */
    CLASS_DOUBLE    = 6,                 /* [MAT], table 1-3: numbers are from here */
    CLASS_SINGLE    = 7,                 /* of 24 bits */
    CLASS_UINT64    = 15,                /* to here */
    CLASS_MASK      = 0xff,              /* of the flags */
    FLAG_COMPLEX    = 0x0800,            /* two parts follow */
};

static const char begin[] = "MATLAB 5.0 MAT-file";

/* By the classes of [MAT], table 1-3. */
static const char *const classes[] = {
    "no array", "a cell array", "a struct", "an object", "text", "sparse", "double", "single",
    "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
};

bool matlab_is(const unsigned char *head, size_t length)
{
    if (length >= strlen(begin) && memcmp(head, begin, strlen(begin)) == 0)
        return true;
    return length >= HEAD_BYTES && ((memcmp(head + VERSION_AT, "\0\1IM", 4) == 0)
                                    || memcmp(head + VERSION_AT, "\1\0MI", 4) == 0);
}

/* [MAT], table 1-1: how numbers of an element of TYPE lie. */
static struct number_type type_of(size_t type, bool big)
{
    static const struct number_type types[] = {
        [1] = { NUMBER_INT, 1, false }, [2] = { NUMBER_UINT, 1, false },
        [3] = { NUMBER_INT, 2, false }, [4] = { NUMBER_UINT, 2, false },
        [5] = { NUMBER_INT, 4, false }, [6] = { NUMBER_UINT, 4, false },
        [7] = { NUMBER_FLOAT, 4, false }, [9] = { NUMBER_FLOAT, 8, false },
        [12] = { NUMBER_INT, 8, false }, [13] = { NUMBER_UINT, 8, false },
    };
    struct number_type found = { NUMBER_NONE, 0, false };

    if (type < sizeof types / sizeof *types)
        found = types[type];
    found.big = big;
    return found;
}

/* A tag and where its data are. */
struct element { size_t type, length; struct bytes data; };

/* The tag of the next element; its data may end behind FROM (a prefix of it). */
static bool next_tag(struct bytes *from, bool big, struct element *out)
{
    const struct number_type u32 = { NUMBER_UINT, 4, big };
    size_t first, high;

    if (!bytes_size(from, u32, &first))
        return false;
    high = first >> 16;
    if (high > 0) {                                       /* the short form */
        out->type = first & 0xffff;
        out->length = high;
        return high <= SHORT_MOST;
    }
    out->type = first;
    return bytes_size(from, u32, &out->length);
}

/* The next element whole. */
static bool next_element(struct bytes *from, bool big, struct element *out)
{
    size_t at = from->at, room;
    const unsigned char *data;

    if (!next_tag(from, big, out))
        return false;
    bool is_short = from->at - at == 4;
    data = bytes_next(from, out->length);
    if (data == NULL)
        return false;
    out->data = (struct bytes) { data, out->length, 0 };
    room = is_short ? SHORT_MOST - out->length
                    : (ALIGNED - out->length % ALIGNED) % ALIGNED;
    if (out->type != TYPE_COMPRESSED && bytes_next(from, room) == NULL)
        from->at = from->length;                          /* the last one may lack them */
    return true;
}

/* Flags, sizes and name of the matrix MATRIX, or of its first bytes, which then stands at its
 * numbers. */
static bool read_head(struct bytes *matrix, bool big, struct array *a, struct bytes *name)
{
    const struct number_type u32 = { NUMBER_UINT, 4, big }, i32 = { NUMBER_INT, 4, big };
    struct element flags, sizes, text;
    size_t bits, class;

    if (!next_element(matrix, big, &flags) || flags.type != TYPE_UINT32
        || !next_element(matrix, big, &sizes) || sizes.type != TYPE_INT32
        || !next_element(matrix, big, &text) || text.type != TYPE_INT8
        || !bytes_size(&flags.data, u32, &bits))
        return false;
    class = bits & CLASS_MASK;
    a->type = (bits & FLAG_COMPLEX) != 0                     ? "complex"
              : class < sizeof classes / sizeof *classes ? classes[class]
                                                             : "something else";
    a->numbers = class >= CLASS_DOUBLE && class <= CLASS_UINT64 && (bits & FLAG_COMPLEX) == 0
                 && sizes.length == 2 * (size_t)i32.size;
    a->single = class == CLASS_SINGLE;
    a->by_columns = true;
    *name = text.data;
    return !a->numbers || (bytes_size(&sizes.data, i32, &a->rows)
                           && bytes_size(&sizes.data, i32, &a->columns));
}

static enum modal_status damaged(const char *path, struct modal_error *err)
{
    return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s is cut short or damaged; accepted: a "
                            "whole MATLAB file of version 5 to 7.3", path);
}

struct matlab { struct bytes file; bool big; };

/* A matrix: its first bytes, all of them where MORE is NULL, else what comes behind them. */
struct matrix { struct bytes first; size_t length; struct inflater *more;
                unsigned char own[PREFIX]; };

static void matrix_close(struct matrix *x)
{
    inflater_free(x->more);
}

/* A compressed element, E, says one matrix and its length, which deflate can have made of it. */
static bool inflate_first(const struct matlab *m, const struct element *e, struct matrix *out)
{
    unsigned char tag[TAG_BYTES];
    struct bytes first = { tag, sizeof tag, 0 };
    struct element inner;
    size_t got;

    if (!inflater_read(out->more, tag, sizeof tag, &got) || got < sizeof tag
        || !next_tag(&first, m->big, &inner) || inner.type != TYPE_MATRIX
        || inner.length > inflated_most(e->length))
        return false;
    out->length = inner.length;
    out->first = (struct bytes) { out->own, inner.length < PREFIX ? inner.length : PREFIX, 0 };
    return inflater_read(out->more, out->own, out->first.length, &got) && got == out->first.length;
}

/* The element at AT, which matrix_close closes whatever comes back. */
static enum modal_status matrix_open(const struct matlab *m, const char *path, size_t at,
                                     struct matrix *out, struct modal_error *err)
{
    struct bytes from = m->file;
    struct element e;

    out->more = NULL;
    from.at = at;
    if (!next_element(&from, m->big, &e))
        return damaged(path, err);
    out->first = e.data;
    out->length = e.length;
    if (e.type != TYPE_COMPRESSED)
        return MODAL_OK;
    out->more = inflater_new(e.data, false);
    if (out->more == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "%s: no memory to unpack it", path);
    return inflate_first(m, &e, out) ? MODAL_OK : damaged(path, err);
}

/* COUNT numbers from where X stands, at their tag, and the rest of what is compressed: its checksum
 * is at the end. */
static bool decode(const struct matlab *m, struct matrix *x, size_t count, struct numbers *into)
{
    struct bytes first = x->first;
    struct element numbers;

    if (!next_tag(&first, m->big, &numbers) || numbers.length > x->length - first.at)
        return false;
    struct number_type type = type_of(numbers.type, m->big);
    if (type.kind == NUMBER_NONE || count != numbers.length / (size_t)type.size
        || numbers.length % (size_t)type.size != 0)
        return false;
    size_t here = bytes_left(&first) / (size_t)type.size;     /* whole ones: it is ALIGNED */
    here = here < count ? here : count;
    numbers_put(type, first.data + first.at, here, into);
    return x->more == NULL
           || (inflater_numbers(x->more, type, count - here, into)
               && inflater_pass(x->more, x->length - x->first.length
                                             - (count - here) * (size_t)type.size));
}

static enum modal_status load(const struct arrays *arrays, const struct array *a,
                              struct numbers *into, struct modal_error *err)
{
    const struct matlab *m = arrays->from;
    struct array again = { 0 };
    struct matrix x;
    struct bytes name;
    enum modal_status rc = matrix_open(m, arrays->path, a->at, &x, err);

    if (rc == MODAL_OK && (!read_head(&x.first, m->big, &again, &name)
                           || !decode(m, &x, a->rows * a->columns, into)))
        rc = damaged(arrays->path, err);
    matrix_close(&x);
    return rc;
}

/* The element E at AT into the list, where it is a matrix. */
static enum modal_status list_element(struct arrays *arrays, const struct element *e, size_t at,
                                      struct modal_error *err)
{
    const struct matlab *m = arrays->from;
    struct array a = { 0 }, *one;
    struct matrix x;
    struct bytes name;
    enum modal_status rc;

    if (e->type != TYPE_MATRIX && e->type != TYPE_COMPRESSED)
        return MODAL_OK;
    rc = matrix_open(m, arrays->path, at, &x, err);
    size_t most = e->type == TYPE_COMPRESSED ? inflated_most(e->length) : e->length;
    if (rc == MODAL_OK && (!read_head(&x.first, m->big, &a, &name)
                           || (a.numbers && a.columns > 0 && a.rows > most / a.columns)))
        rc = damaged(arrays->path, err);                  /* a number takes a byte or more */
    /* a matrix without a name is what MATLAB keeps for itself */
    if (rc == MODAL_OK && name.length > 0) {
        one = arrays_add(arrays, (const char *)name.data, name.length);
        if (one == NULL)
            rc = modal_fail_field(err, MODAL_TOO_LARGE, "file", "%s: no memory, or more than %d "
                                  "arrays", arrays->path, ARRAYS_MOST);
        else {
            a.name = one->name;
            a.at = at;
            *one = a;
        }
    }
    matrix_close(&x);
    return rc;
}

enum modal_status matlab_read(struct bytes file, const char *path,
                              const struct signals_options *options, struct signals *out,
                              struct modal_error *err)
{
    struct matlab m = { .file = file };
    struct arrays arrays = { .path = path, .from = &m, .load = load };
    const unsigned char *head = bytes_next(&file, HEAD_BYTES);
    struct element e;
    enum modal_status rc = MODAL_OK;

    if (head == NULL)
        return damaged(path, err);
    m.big = memcmp(head + ORDER_AT, "MI", 2) == 0;
    while (rc == MODAL_OK && bytes_left(&file) > 0) {
        size_t at = file.at;
        rc = next_element(&file, m.big, &e) ? list_element(&arrays, &e, at, err)
                                            : damaged(path, err);
    }
    if (rc == MODAL_OK)
        rc = arrays_read(&arrays, options, out, err);
    arrays_done(&arrays);
    return rc;
}
