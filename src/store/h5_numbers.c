/* h5_numbers.c - see h5_numbers.h */
#include "store/h5_numbers.h"
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

/* The type and the creation properties of the dataset beside what is asked of it. */
struct look { struct h5_numbers *of; hid_t type, space, how; };

#define BAD_SET(...) modal_fail_field(err, MODAL_BAD_INPUT, l->of->field, __VA_ARGS__)

static enum modal_status look_shape(const struct look *l, struct modal_error *err)
{
    H5T_class_t class = l->type >= 0 ? H5Tget_class(l->type) : H5T_NO_CLASS;
    struct h5_numbers *of = l->of;

    if (class != H5T_INTEGER && class != H5T_FLOAT)
        return BAD_SET("dataset `%s` does not hold numbers; accepted: any integer or "
                       "floating-point type", of->name);
    of->rank = l->space >= 0 ? H5Sget_simple_extent_ndims(l->space) : -1;
    if (of->rank < 0 || of->rank > 2)
        return BAD_SET("dataset `%s` has %d dimensions; accepted: 2, n_samples x n_channels, or 1",
                       of->name, of->rank < 0 ? 0 : of->rank);
    of->dims[0] = of->dims[1] = 1;
    if (H5Sget_simple_extent_type(l->space) == H5S_NULL)
        of->dims[0] = 0;
    else if (H5Sget_simple_extent_dims(l->space, of->dims, NULL) < 0)
        return BAD_SET("the shape of dataset `%s` cannot be read", of->name);
    double bytes = (double)sizeof(double) * (double)of->dims[0] * (double)of->dims[1];
    if (bytes > of->most)
        return modal_fail_field(err, MODAL_TOO_LARGE, of->field, "dataset `%s` of %llu x %llu "
                                "takes %.3g bytes; accepted: at most %.3g", of->name,
                                (unsigned long long)of->dims[0], (unsigned long long)of->dims[1],
                                bytes, of->most);
    return MODAL_OK;
}

/* Filter plug-ins are programs, of which none is loaded for a foreign file. */
static enum modal_status look_filters(const struct look *l, struct modal_error *err)
{
    int count = H5Pget_nfilters(l->how);

    for (int i = 0; i < count; i++) {
        char name[64] = "";
        unsigned flags, config;
        size_t values = 0;
        H5Z_filter_t filter = H5Pget_filter2(l->how, (unsigned)i, &flags, &values, NULL,
                                             sizeof name, name, &config);
        if (filter < 0 || H5Zfilter_avail(filter) <= 0)
            return BAD_SET("dataset `%s` is packed by filter %d (%.60s), which is not built in; "
                           "accepted: gzip, as `h5repack -f GZIP=1` makes it, or none", l->of->name,
                           (int)filter, name[0] != 0 ? name : "without a name");
    }
    return MODAL_OK;
}

/* Were all chunks written? */
static bool look_chunks(const struct look *l)
{
    struct h5_numbers *of = l->of;
    hsize_t chunk[2] = { 1, 1 }, written = 0, all = 1;
    int rank = H5Pget_layout(l->how) == H5D_CHUNKED ? H5Pget_chunk(l->how, 2, chunk) : 0;
    bool told = rank == of->rank && rank > 0
                && H5Dget_num_chunks(of->set, l->space, &written) >= 0;

    of->piece = rank > 0 ? (size_t)(chunk[0] * chunk[1]) * H5Tget_size(l->type) : 0;
    for (int i = 0; told && i < rank; i++)
        all *= (of->dims[i] + chunk[i] - 1) / chunk[i];
    of->pieces = told ? (double)all : 0;
    return told && written >= all;
}

/* That the numbers are in their own file; and that so few bytes can be so many, as far as deflate
 * can (RFC 1951): those never written have none.  Filters behind each other make less of what is
 * all the same. */
static enum modal_status look_held(const struct look *l, struct modal_error *err)
{
    enum { DEFLATE_RATIO = 1032 };        /* 8 * 258 bits by 2 */
    const struct h5_numbers *of = l->of;
    double said = (double)of->dims[0] * (double)of->dims[1] * (double)H5Tget_size(l->type);

    if (H5Pget_layout(l->how) == H5D_VIRTUAL || H5Pget_external_count(l->how) != 0)
        return BAD_SET("the numbers of dataset `%s` are in other files; accepted: in its own, as "
                       "`h5repack -l CONTI` makes it", of->name);
    double held = (double)H5Dget_storage_size(of->set);
    bool whole = look_chunks(l);
    if (said > DEFLATE_RATIO * held && !whole)
        return BAD_SET("dataset `%s` of %llu x %llu has %.0f bytes in the file: parts of it were "
                       "never written", of->name, (unsigned long long)of->dims[0],
                       (unsigned long long)of->dims[1], held);
    return MODAL_OK;
}

enum modal_status h5_numbers_look(struct h5_numbers *out, struct modal_error *err)
{
    const struct look look = { out, H5Dget_type(out->set), H5Dget_space(out->set),
                               H5Dget_create_plist(out->set) }, *l = &look;
    enum modal_status rc = look_shape(l, err);

    if (rc == MODAL_OK && l->how < 0)
        rc = BAD_SET("how dataset `%s` is stored cannot be read", out->name);
    if (rc == MODAL_OK)
        rc = look_held(l, err);
    if (rc == MODAL_OK)
        rc = look_filters(l, err);
    if (l->how >= 0)
        H5Pclose(l->how);
    if (l->space >= 0)
        H5Sclose(l->space);
    if (l->type >= 0)
        H5Tclose(l->type);
    return rc;
}

/* ---- chunks ---- */

enum { FILTERS_MOST = 32 };           /* as many as the mask of a chunk has bits */

/* The pipeline of a chunk as its filters were applied, and the chunk that is looked at. */
struct chunks {
    const struct h5_numbers *of;
    H5Z_filter_t filters[FILTERS_MOST];
    int count;
    hsize_t size[2];                  /* of a chunk, numbers */
    bool bare_edges;                  /* those beyond the dataset's end are not filtered */
    size_t precision;                 /* bits of a number */
    unsigned char *packed;
    size_t room;
};

/* The filter that was applied last to the chunk at AT, MASK of which was left out; -1: none. */
static H5Z_filter_t last_filter(const struct chunks *c, const hsize_t at[2], uint32_t mask)
{
    int last = c->count - 1;

    for (int i = 0; i < c->of->rank; i++)
        if (c->bare_edges && at[i] + c->size[i] > c->of->dims[i])
            return -1;
    while (last >= 0 && (mask >> last & 1) != 0)
        last--;
    return last >= 0 ? c->filters[last] : -1;
}

static uint32_t first_word(const unsigned char *from)
{
    return from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 | (uint32_t)from[3] << 24;
}

/*
 * Are the SIZE bytes of the chunk at AT as many as libhdf5 1.10 reads of them?  It does not ask
 * itself, and takes what lies behind them.  Of scale-offset and n-bit these are the bits of each
 * number, the first behind 21 bytes that begin with their count; szip begins with the length that
 * it unpacks to; deflate and fletcher32 have checksums, by which it finds out.
 */
static bool is_whole(const struct chunks *c, const hsize_t at[2], uint32_t mask, hsize_t size)
{
    enum {
        SCALE_OFFSET_HEAD = 21,           /* bytes: H5Z_scaleoffset_g writes so many */
        WORD              = 4,            /* bytes of the numbers that lead a chunk */
    };
    double numbers = (double)c->size[0] * (double)c->size[1], had = 8 * (double)size;

    switch (last_filter(c, at, mask)) {
    case H5Z_FILTER_DEFLATE: case H5Z_FILTER_FLETCHER32:
        return true;
    case H5Z_FILTER_NBIT:
        return had >= numbers * (double)c->precision;
    case H5Z_FILTER_SCALEOFFSET:
        return size >= SCALE_OFFSET_HEAD
               && had >= 8 * SCALE_OFFSET_HEAD + numbers * (double)first_word(c->packed);
    case H5Z_FILTER_SZIP:
        return size >= WORD && first_word(c->packed) >= c->of->piece;
    default:
        return size >= c->of->piece;
    }
}

static enum modal_status check_chunk(struct chunks *c, const hsize_t at[2], struct modal_error *err)
{
    const struct h5_numbers *of = c->of;
    hsize_t size = 0;
    uint32_t mask = 0;
    bool ok = H5Dget_chunk_storage_size(of->set, at, &size) >= 0;

    if (ok && size == 0)                  /* never written */
        return MODAL_OK;
    if (ok && c->count > 0 && size > c->room) {
        unsigned char *larger = realloc(c->packed, size);
        ok = larger != NULL;              /* else it says more than any filter makes of it */
        c->packed = ok ? larger : c->packed;
        c->room = ok ? size : c->room;
    }
    if (ok && c->count > 0)
        ok = H5Dread_chunk(of->set, H5P_DEFAULT, at, &mask, c->packed) >= 0;
    if (ok && is_whole(c, at, mask, size))
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, of->field, "dataset `%s` is damaged: its chunk "
                            "at %llu, %llu has not the bytes that it says", of->name,
                            (unsigned long long)at[0], (unsigned long long)at[1]);
}

static enum modal_status check_chunks(struct chunks *c, hid_t how, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    unsigned options = 0, flags;
    size_t values = 0;

    c->count = H5Pget_nfilters(how);
    for (int i = 0; i < c->count && i < FILTERS_MOST; i++, values = 0)
        c->filters[i] = H5Pget_filter2(how, (unsigned)i, &flags, &values, NULL, 0, NULL, NULL);
    c->bare_edges = H5Pget_chunk_opts(how, &options) >= 0
                    && (options & H5D_CHUNK_DONT_FILTER_PARTIAL_CHUNKS) != 0;
    if (c->count > FILTERS_MOST || H5Pget_chunk(how, 2, c->size) != c->of->rank || c->size[0] == 0
        || c->size[1] == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, c->of->field, "how dataset `%s` is stored "
                                "cannot be read", c->of->name);
    for (hsize_t i = 0; rc == MODAL_OK && i < c->of->dims[0]; i += c->size[0])
        for (hsize_t j = 0; rc == MODAL_OK && j < c->of->dims[1]; j += c->size[1])
            rc = check_chunk(c, (const hsize_t[2]) { i, j }, err);
    free(c->packed);
    return rc;
}

/* That each chunk has the bytes that are read of it. */
static enum modal_status check_pieces(const struct h5_numbers *of, struct modal_error *err)
{
    hid_t how = H5Dget_create_plist(of->set), type = H5Dget_type(of->set);
    struct chunks chunks = { .of = of, .size = { 1, 1 },
                             .precision = type >= 0 ? H5Tget_precision(type) : 0 };
    enum modal_status rc = MODAL_OK;

    if (how >= 0 && H5Pget_layout(how) == H5D_CHUNKED)
        rc = check_chunks(&chunks, how, err);
    if (type >= 0)
        H5Tclose(type);
    if (how >= 0)
        H5Pclose(how);
    return rc;
}

/* ---- reading ---- */

/* OUT: was it for want of memory that the library's last call failed? */
static herr_t is_of_memory(unsigned n, const H5E_error2_t *error, void *out)
{
    (void)n;
    if (error->min_num == H5E_NOSPACE || error->min_num == H5E_CANTALLOC)
        *(bool *)out = true;
    return 0;
}

static enum modal_status not_read(const struct h5_numbers *of, struct modal_error *err)
{
    bool memory = false;

    H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, is_of_memory, &memory);
    if (memory)
        return modal_fail_field(err, MODAL_NO_MEMORY, of->field, "dataset `%s` cannot be read: no "
                                "memory for what its parts say that they take", of->name);
    return modal_fail_field(err, MODAL_BAD_INPUT, of->field, "dataset `%s` cannot be read: the "
                            "file is truncated or damaged", of->name);
}

/* Numbers of each dimension that are read at once: whole chunks, BLOCK_CHUNKS at most, and of whole
 * rows where a row has no more. */
static bool block_of(const struct h5_numbers *of, hsize_t block[2])
{
    enum { BLOCK_CHUNKS = 64 };       /* 0.25 MB of map; 1024 of one row took half more time each */
    hid_t how = H5Dget_create_plist(of->set);
    hsize_t chunk[2] = { 1, 1 }, left = BLOCK_CHUNKS;
    bool chunked = how >= 0 && H5Pget_layout(how) == H5D_CHUNKED,
         ok = how >= 0 && (!chunked || H5Pget_chunk(how, 2, chunk) == of->rank);

    block[0] = of->dims[0];
    block[1] = of->dims[1];
    for (int i = 1; ok && chunked && i >= 0; i--) {
        hsize_t chunks = (of->dims[i] - 1) / chunk[i] + 1, taken = chunks < left ? chunks : left;
        block[i] = taken * chunk[i];
        left /= taken;
    }
    if (how >= 0)
        H5Pclose(how);
    return ok;
}

/*
 * All of them, by blocks: libhdf5 1.10 makes a map of all chunks that one call reads, 3.8 kB of
 * each whatever its size, so that of a million rows in as many chunks it takes 4 GB for 32 MB.
 */
static bool read_blocks(const struct h5_numbers *of, hid_t space, double *to)
{
    hsize_t block[2], at[2], count[2];
    bool ok = block_of(of, block);

    for (at[0] = 0; ok && at[0] < of->dims[0]; at[0] += block[0])
        for (at[1] = 0; ok && at[1] < of->dims[1]; at[1] += block[1]) {
            for (int i = 0; i < 2; i++)
                count[i] = of->dims[i] - at[i] < block[i] ? of->dims[i] - at[i] : block[i];
            ok = (of->rank == 0
                  || H5Sselect_hyperslab(space, H5S_SELECT_SET, at, NULL, count, NULL) >= 0)
                 && H5Dread(of->set, H5T_NATIVE_DOUBLE, space, space, H5P_DEFAULT, to) >= 0;
        }
    return ok;
}

enum modal_status h5_numbers_read(const struct h5_numbers *of, double *to, struct modal_error *err)
{
    enum modal_status rc = of->dims[0] * of->dims[1] > 0 ? check_pieces(of, err) : MODAL_OK;
    hid_t space;

    if (rc != MODAL_OK || of->dims[0] * of->dims[1] == 0)
        return rc;
    space = H5Dget_space(of->set);
    if (space < 0 || !read_blocks(of, space, to))
        rc = not_read(of, err);
    if (space >= 0)
        H5Sclose(space);
    return rc;
}
