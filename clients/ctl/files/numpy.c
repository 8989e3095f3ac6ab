/* numpy.c - see numpy.h
 *
 * NPY: "\x93NUMPY", two bytes of version, the length of a head (2 bytes, from version 2 on 4), the
 * head, which is a dictionary of Python's of three keys, the numbers.
 * ZIP (APPNOTE 6.3, 4.3): a directory stands at the end, and its end record behind it; the sizes
 * used are those of the directory.
 */
#include "numpy.h"
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include "arrays.h"

static const char npy_magic[6] = "\x93NUMPY";
static const char zip_file[4] = "PK\3\4", zip_entry[4] = "PK\1\2", zip_end[4] = "PK\5\6";

enum {
    HEAD_MOST = 1 << 16,     /* bytes of NPY's head */
    VERSION_MOST = 3,        /* of NPY */
    FLOAT_LEAST = 4,         /* bytes: of two there are none in C */
    STORED   = 0,            /* how an entry of a zip lies */
    DEFLATED = 8,            /* by RFC 1951 */
    END_BYTES   = 22,        /* of the zip's records: at its end, */
    ENTRY_BYTES = 46,        /* in its directory, */
    LOCAL_BYTES = 30,        /* before each file */
    COMMENT_MOST = UINT16_MAX,      /* behind the end */
};

static const struct number_type u16 = { NUMBER_UINT, 2, false }, u32 = { NUMBER_UINT, 4, false };

bool npy_is(const unsigned char *head, size_t length)
{
    return length >= sizeof npy_magic && memcmp(head, npy_magic, sizeof npy_magic) == 0;
}

bool npz_is(const unsigned char *head, size_t length)
{
    return length >= sizeof zip_file && (memcmp(head, zip_file, sizeof zip_file) == 0
                                         || memcmp(head, zip_end, sizeof zip_end) == 0);
}

/* ---- the head of an array ---- */

/* What stands behind 'KEY': in the dictionary HEAD, or NULL. */
static const char *value_of(const char *head, const char *key)
{
    const char *at = strstr(head, key);

    if (at == NULL || at == head || strchr("'\"", at[-1]) == NULL)
        return NULL;
    at += strlen(key);
    if (strchr("'\"", *at) == NULL || *at == 0)
        return NULL;
    at++;
    at += strspn(at, " \t:");
    return at;
}

/* '<f8' */
static struct number_type type_of(const char *descr)
{
    struct number_type type = { NUMBER_NONE, 0, false };
    char order, letter, end;
    int size;

    if (descr == NULL || sscanf(descr, "%*1['\"]%c%c%d%c", &order, &letter, &size, &end) != 4
        || strchr("'\"", end) == NULL || strchr("<>|=", order) == NULL)
        return type;
    if (size == 1 || size == 2 || size == 4 || size == 8)
        type.kind = letter == 'f' && size >= FLOAT_LEAST ? NUMBER_FLOAT
                    : letter == 'i'            ? NUMBER_INT
                    : letter == 'u' || (letter == 'b' && size == 1) ? NUMBER_UINT
                                               : NUMBER_NONE;
    type.size = size;
    type.big = order == '>';
    return type;
}

/* "(4000, 3)": one size is a column. */
static bool shape_of(const char *shape, struct array *out)
{
    size_t sizes[2] = { 1, 1 }, count = 0;
    char *end;

    if (shape == NULL || *shape++ != '(')
        return false;
    for (; *shape != ')'; shape = end + strspn(end, ", L")) {
        if (!isdigit((unsigned char)*shape) || count == 2)
            return false;
        sizes[count++] = strtoull(shape, &end, 10);
    }
    out->rows = sizes[0];
    out->columns = sizes[1];
    return true;
}

static void read_dictionary(const char *head, struct array *out)
{
    const char *order = value_of(head, "fortran_order");

    out->kind = type_of(value_of(head, "descr"));
    out->by_columns = order != NULL && strncmp(order, "True", 4) == 0;
    out->numbers = out->kind.kind != NUMBER_NONE && order != NULL
                   && shape_of(value_of(head, "shape"), out);
    out->single = out->kind.kind == NUMBER_FLOAT && out->kind.size == 4;
    out->type = out->kind.kind == NUMBER_NONE ? "of a type that is no real number"
                                              : "of more than two dimensions";
}

/* The head at the begin of FILE; out->inner: where the numbers begin.  LENGTH bytes in all. */
static bool read_head(struct bytes file, size_t length, struct array *out)
{
    const unsigned char *magic = bytes_next(&file, sizeof npy_magic),
                        *version = bytes_next(&file, 2), *head;
    size_t bytes = 0, numbers;
    char *copy;

    if (magic == NULL || version == NULL || !npy_is(magic, sizeof npy_magic) || version[0] == 0
        || version[0] > VERSION_MOST || !bytes_size(&file, version[0] == 1 ? u16 : u32, &bytes)
        || bytes > HEAD_MOST || (head = bytes_next(&file, bytes)) == NULL)
        return false;
    copy = strndup((const char *)head, bytes);
    if (copy == NULL)
        return false;
    read_dictionary(copy, out);
    free(copy);
    out->inner = file.at;
    out->length = length;
    numbers = length - file.at;
    return !out->numbers || out->rows == 0 || out->columns == 0
           || (out->rows <= numbers / out->columns / (size_t)out->kind.size
               && out->rows * out->columns * (size_t)out->kind.size == numbers);
}

static enum modal_status damaged(const char *path, const char *name, struct modal_error *err)
{
    return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: %s is cut short or damaged: its "
                            "head, its shape and its length do not agree; accepted: a whole file "
                            "of numpy.save, savez or savez_compressed", path, name);
}

/* ---- NPY ---- */

static enum modal_status load_plain(const struct arrays *arrays, const struct array *a,
                                    struct numbers *into, struct modal_error *err)
{
    const struct bytes *file = arrays->from;

    (void)err;
    numbers_put(a->kind, file->data + a->at + a->inner, a->rows * a->columns, into);
    return MODAL_OK;
}

enum modal_status npy_read(struct bytes file, const char *path,
                           const struct signals_options *options, struct signals *out,
                           struct modal_error *err)
{
    struct arrays arrays = { .path = path, .from = &file, .load = load_plain };
    struct array *one = arrays_add(&arrays, "the array", strlen("the array"));
    enum modal_status rc = MODAL_OK;

    if (one == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "%s: no memory", path);
    else if (!read_head(file, file.length, one))
        rc = damaged(path, "it", err);
    else if (!one->numbers)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "signals", "%s: the array is %s; accepted: a "
                              "matrix of real numbers, samples x channels", path, one->type);
    if (rc == MODAL_OK)
        rc = arrays_read(&arrays, options, out, err);
    arrays_done(&arrays);
    return rc;
}

/* ---- NPZ ---- */

/* An entry of the directory. */
struct entry { size_t method, flags, crc, packed, length, local, name_length, data;
               const char *name; };

/* The next entry of the directory; false where it is no entry.  Sizes that stand elsewhere, of
 * files past 4 GB, are past the end of this file. */
static bool next_entry(struct bytes *directory, struct entry *out)
{
    const unsigned char *e = bytes_next(directory, ENTRY_BYTES);
    size_t extra, comment;

    if (e == NULL || memcmp(e, zip_entry, sizeof zip_entry) != 0)
        return false;
    out->flags = (size_t)number_decode(u16, e + 8);
    out->method = (size_t)number_decode(u16, e + 10);
    out->crc = (size_t)number_decode(u32, e + 16);
    out->packed = (size_t)number_decode(u32, e + 20);
    out->length = (size_t)number_decode(u32, e + 24);
    out->name_length = (size_t)number_decode(u16, e + 28);
    extra = (size_t)number_decode(u16, e + 30);
    comment = (size_t)number_decode(u16, e + 32);
    out->local = (size_t)number_decode(u32, e + 42);
    out->name = (const char *)bytes_next(directory, out->name_length);
    return out->name != NULL && bytes_next(directory, extra + comment) != NULL;
}

/* Where the entry's bytes begin, all of which are in the FILE. */
static bool find_data(struct bytes file, struct entry *e)
{
    const unsigned char *local;

    file.at = e->local < file.length ? e->local : file.length;
    local = bytes_next(&file, LOCAL_BYTES);
    if (local == NULL || memcmp(local, zip_file, sizeof zip_file) != 0)
        return false;
    if (bytes_next(&file, (size_t)number_decode(u16, local + 26)
                              + (size_t)number_decode(u16, local + 28)) == NULL)
        return false;
    e->data = file.at;
    return e->packed <= bytes_left(&file)
           && (e->method == DEFLATED ? e->length <= inflated_most(e->packed)
                                     : e->method == STORED && e->length == e->packed)
           && (e->flags & 1) == 0;                       /* not encrypted */
}

/* ROOM bytes of the entry E, or all of it. */
static bool unpack(struct bytes file, const struct entry *e, unsigned char *to, size_t room)
{
    struct bytes packed = { file.data + e->data, e->packed, 0 };
    size_t got;

    if (e->method == STORED) {
        memcpy(to, packed.data, room);
        return true;
    }
    return inflate_bytes(packed, to, room, &got) && got == room;
}

static enum modal_status list_entry(struct bytes file, struct entry *e, struct arrays *arrays,
                                    struct modal_error *err)
{
    static const char suffix[] = ".npy";
    size_t own = strlen(suffix), most = HEAD_MOST + sizeof npy_magic + 6;
    size_t room = e->length < most ? e->length : most;
    bool named = e->name_length > own
                 && memcmp(e->name + e->name_length - own, suffix, own) == 0;
    unsigned char *head = malloc(room + 1);
    size_t name = e->name_length - (named ? own : 0);
    struct array *a = head != NULL ? arrays_add(arrays, e->name, name) : NULL;
    enum modal_status rc = MODAL_OK;

    if (a == NULL)
        rc = modal_fail_field(err, MODAL_TOO_LARGE, "file", "%s: no memory, or more than %d arrays",
                              arrays->path, ARRAYS_MOST);
    else if (!find_data(file, e) || !unpack(file, e, head, room)
             || (named && !read_head((struct bytes) { head, room, 0 }, e->length, a)))
        rc = damaged(arrays->path, a->name, err);
    else
        a->at = e->local;
    free(head);
    return rc;
}

/* The directory of FILE by the record at its end, which may have a comment behind it. */
static bool find_directory(struct bytes file, struct bytes *out, size_t *count)
{
    size_t least = file.length > END_BYTES + COMMENT_MOST
                       ? file.length - END_BYTES - COMMENT_MOST : 0;

    for (size_t at = file.length < END_BYTES ? 0 : file.length - END_BYTES; at > least; at--) {
        const unsigned char *e = file.data + at;
        size_t size, from;
        if (memcmp(e, zip_end, sizeof zip_end) != 0)
            continue;
        *count = (size_t)number_decode(u16, e + 10);
        size = (size_t)number_decode(u32, e + 12);
        from = (size_t)number_decode(u32, e + 16);
        if (from > at || size > at - from)
            return false;
        *out = (struct bytes) { file.data + from, size, 0 };
        return true;
    }
    return false;
}

/* The entry whose local record is at A->at, again. */
static bool find_entry(struct bytes file, const struct array *a, struct entry *out)
{
    struct bytes directory;
    size_t count;

    if (!find_directory(file, &directory, &count))
        return false;
    while (next_entry(&directory, out))
        if (out->local == a->at)
            return find_data(file, out);
    return false;
}

/* The numbers of A, which are all that is in the entry E behind its head. */
static bool decode(struct bytes file, const struct entry *e, const struct array *a,
                   struct numbers *into)
{
    struct bytes packed = { file.data + e->data, e->packed, 0 };
    size_t count = a->rows * a->columns;
    struct inflater *from;
    bool ok;

    if (e->method == STORED) {
        numbers_put(a->kind, packed.data + a->inner, count, into);
        return crc32_z(0, packed.data, e->length) == e->crc;
    }
    from = inflater_new(packed, true);
    ok = from != NULL && inflater_pass(from, a->inner)
         && inflater_numbers(from, a->kind, count, into) && inflater_crc(from) == e->crc;
    inflater_free(from);
    return ok;
}

static enum modal_status load_packed(const struct arrays *arrays, const struct array *a,
                                     struct numbers *into, struct modal_error *err)
{
    const struct bytes *file = arrays->from;
    struct entry e;

    if (!find_entry(*file, a, &e) || e.length != a->length || !decode(*file, &e, a, into))
        return damaged(arrays->path, a->name, err);
    return MODAL_OK;
}

enum modal_status npz_read(struct bytes file, const char *path,
                           const struct signals_options *options, struct signals *out,
                           struct modal_error *err)
{
    struct arrays arrays = { .path = path, .from = &file, .load = load_packed };
    struct bytes directory;
    struct entry e;
    size_t count;
    enum modal_status rc = MODAL_OK;

    if (!find_directory(file, &directory, &count))
        return damaged(path, "its directory", err);
    for (size_t i = 0; rc == MODAL_OK && i < count; i++)
        rc = next_entry(&directory, &e) ? list_entry(file, &e, &arrays, err)
                                        : damaged(path, "its directory", err);
    if (rc == MODAL_OK)
        rc = arrays_read(&arrays, options, out, err);
    arrays_done(&arrays);
    return rc;
}
