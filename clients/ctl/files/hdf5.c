/* hdf5.c - see hdf5.h */
#include "hdf5.h"
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "arrays.h"
#include "steps.h"
#include "ctl/apart.h"
#include "store/batch_file.h"
#include "store/batch_h5.h"
#include "store/h5_numbers.h"

enum {
    USER_BLOCK_LEAST = 512,       /* bytes: the format's */
    MATRIX           = 2,         /* dimensions */
    NAME_MOST        = 255,       /* bytes of a dataset's name, with the groups it is in */
    SHARED_MOST      = 1024,      /* objects with more than one name: files have a few */
};

/* Where a number of the list is: struct array.at. */
enum place { IN_DATASET, IN_ROOT, ON_SIGNALS };

static const char matlab_begin[] = "MATLAB 7.3 MAT-file";

bool hdf5_is(const unsigned char *head, size_t length)
{
    static const char signature[8] = "\x89HDF\r\n\x1a\n";

    if (length >= strlen(matlab_begin) && memcmp(head, matlab_begin, strlen(matlab_begin)) == 0)
        return true;
    for (size_t at = 0; at + sizeof signature <= length; at = at > 0 ? 2 * at : USER_BLOCK_LEAST)
        if (memcmp(head + at, signature, sizeof signature) == 0)
            return true;
    return false;
}

/* ---- the list ---- */

/* The one text that ATTRIBUTE is, of TYPE, or what there is room for of it. */
static void read_text(hid_t attribute, hid_t type, char *text, size_t room)
{
    hid_t head = H5Tcopy(type);
    char *own = NULL;

    if (H5Tis_variable_str(type) > 0) {
        if (H5Aread(attribute, type, &own) >= 0 && own != NULL)
            snprintf(text, room, "%s", own);
        H5free_memory(own);
    } else if (head < 0 || H5Tset_size(head, room) < 0 || H5Tset_strpad(head, H5T_STR_NULLTERM) < 0
               || H5Aread(attribute, head, text) < 0)
        text[0] = 0;
    if (head >= 0)
        H5Tclose(head);
}

/* The attribute NAME of SET, where it is one text, as far as there is ROOM for it; else "". */
static void text_attribute(hid_t set, const char *name, char *text, size_t room)
{
    hid_t attribute = H5Aexists(set, name) > 0 ? H5Aopen(set, name, H5P_DEFAULT) : H5I_INVALID_HID;
    hid_t type = attribute >= 0 ? H5Aget_type(attribute) : H5I_INVALID_HID;
    hid_t space = attribute >= 0 ? H5Aget_space(attribute) : H5I_INVALID_HID;

    memset(text, 0, room);
    if (type >= 0 && space >= 0 && H5Tget_class(type) == H5T_STRING
        && H5Sget_simple_extent_npoints(space) == 1)
        read_text(attribute, type, text, room);
    if (space >= 0)
        H5Sclose(space);
    if (type >= 0)
        H5Tclose(type);
    if (attribute >= 0)
        H5Aclose(attribute);
}

static void shape_of(hid_t set, bool matlab, struct array *out)
{
    hid_t space = H5Dget_space(set);
    hsize_t dims[H5S_MAX_RANK] = { 1, 1 };
    int rank = space >= 0 ? H5Sget_simple_extent_dims(space, dims, NULL) : -1;
    bool empty = space >= 0 && H5Sget_simple_extent_type(space) == H5S_NULL;

    if (space >= 0)
        H5Sclose(space);
    out->numbers = rank >= 0 && rank <= MATRIX && !empty;
    out->type = empty ? "empty" : "of more than two dimensions";
    out->rows = dims[0];
    out->columns = rank == MATRIX ? dims[1] : 1;
    out->by_columns = matlab && rank == MATRIX;
    if (out->by_columns) {
        out->rows = dims[1];
        out->columns = dims[0];
    }
}

/* Through a file's groups by our own hand: H5Ovisit finds each object by its whole name again, and
 * takes a minute for 2000 groups inside each other. */
struct walk {
    struct arrays *arrays;
    char name[NAME_MOST + 1];     /* of the group it is in, with a slash behind it, or empty */
    bool deep;                    /* something has a longer one, and is passed over */
    haddr_t shared[SHARED_MOST];  /* objects that have other names, and were met */
    int count;
};

/* A class is what MATLAB says that it is; "" for another's. */
static herr_t list_dataset(hid_t from, const char *link, struct walk *walk)
{
    char class[32], unit[128];
    struct array *a = arrays_add(walk->arrays, walk->name, strlen(walk->name));
    hid_t set = a != NULL ? H5Dopen2(from, link, H5P_DEFAULT) : H5I_INVALID_HID;

    if (set < 0)
        return -1;
    hid_t type = H5Dget_type(set);
    H5T_class_t kind = type >= 0 ? H5Tget_class(type) : H5T_NO_CLASS;
    text_attribute(set, "MATLAB_class", class, sizeof class);
    if (kind != H5T_INTEGER && kind != H5T_FLOAT)
        a->type = kind == H5T_STRING ? "text" : kind == H5T_COMPOUND ? "a compound" : "no numbers";
    else if (strcmp(class, "char") == 0)
        a->type = "text";
    else
        shape_of(set, class[0] != 0, a);
    a->single = kind == H5T_FLOAT && H5Tget_size(type) <= sizeof(float);
    text_attribute(set, "units", unit, sizeof unit);
    a->unit = steps_unit(unit)[0] != 0 ? steps_unit(unit) : steps_rate_unit(unit);
    if (type >= 0)
        H5Tclose(type);
    H5Dclose(set);
    return 0;
}

/* 1: it was met by another name; 0: not yet; -1: there are too many such. */
static int was_met(struct walk *walk, const H5O_info_t *info)
{
    if (info->rc < 2)
        return 0;
    for (int i = 0; i < walk->count; i++)
        if (walk->shared[i] == info->addr)
            return 1;
    if (walk->count == SHARED_MOST)
        return -1;
    walk->shared[walk->count++] = info->addr;
    return 0;
}

static herr_t list_link(hid_t from, const char *link, const H5L_info_t *what, void *context)
{
    struct walk *walk = context;
    size_t before = strlen(walk->name), length = strlen(link);
    H5O_info_t info;
    hid_t group;
    int met;
    herr_t rc = 0;

    if (what->type != H5L_TYPE_HARD)
        return 0;
    if (before + length + 1 > NAME_MOST) {
        walk->deep = true;
        return 0;
    }
    if (H5Oget_info_by_name(from, link, &info, H5P_DEFAULT) < 0
        || (met = was_met(walk, &info)) < 0)
        return -1;
    if (met > 0)
        return 0;
    memcpy(walk->name + before, link, length + 1);
    if (info.type == H5O_TYPE_DATASET)
        rc = list_dataset(from, link, walk);
    else if (info.type == H5O_TYPE_GROUP) {
        memcpy(walk->name + before + length, "/", 2);
        group = H5Gopen2(from, link, H5P_DEFAULT);
        rc = group < 0 ? -1 : H5Literate(group, H5_INDEX_NAME, H5_ITER_INC, NULL, list_link, walk);
        if (group >= 0)
            H5Gclose(group);
    }
    walk->name[before] = 0;
    return rc;
}

static enum modal_status list_all(hid_t file, const char *path, struct arrays *arrays,
                                  struct modal_error *err)
{
    struct walk walk = { .arrays = arrays };

    if (H5Literate(file, H5_INDEX_NAME, H5_ITER_INC, NULL, list_link, &walk) < 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s cannot be read as HDF5: it is "
                                "truncated or damaged, or has more than %d datasets, or %d with "
                                "more than one name", path, ARRAYS_MOST, SHARED_MOST);
    if (walk.deep && arrays->count == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: what it has lies in groups "
                                "whose names are longer than %d bytes together", path, NAME_MOST);
    return MODAL_OK;
}

/* The attributes of OBJECT that can say a step. */
static void list_attributes(hid_t object, enum place place, struct arrays *arrays)
{
    static const char *const names[] = { "dt", "fs", "Fs" };

    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        hid_t a = H5Aexists(object, names[i]) > 0 ? H5Aopen(object, names[i], H5P_DEFAULT)
                                                  : H5I_INVALID_HID;
        hid_t type = a >= 0 ? H5Aget_type(a) : H5I_INVALID_HID;
        hid_t space = a >= 0 ? H5Aget_space(a) : H5I_INVALID_HID;
        H5T_class_t kind = type >= 0 ? H5Tget_class(type) : H5T_NO_CLASS;
        struct array *one = NULL;
        if ((kind == H5T_INTEGER || kind == H5T_FLOAT) && space >= 0
            && H5Sget_simple_extent_npoints(space) == 1)
            one = arrays_add(arrays, names[i], strlen(names[i]));
        if (one != NULL) {
            one->numbers = true;
            one->rows = one->columns = 1;
            one->at = place;
            one->single = kind == H5T_FLOAT && H5Tget_size(type) <= sizeof(float);
        }
        if (space >= 0)
            H5Sclose(space);
        if (type >= 0)
            H5Tclose(type);
        if (a >= 0)
            H5Aclose(a);
    }
}

/* The file, and the name of the dataset whose attributes are in the list. */
struct source { hid_t file; const char *signals; };

/* What reading the numbers OF takes, COPIES of them at a time; libhdf5 unpacks a chunk into what it
 * doubles until that fits, beside the packed one. */
static void allow(const struct h5_numbers *of, int copies)
{
    apart_allow(copies * (double)sizeof(double) * (double)of->dims[0] * (double)of->dims[1]
                + 4 * (double)of->piece, of->pieces);
}

static enum modal_status load_attribute(hid_t object, const struct array *array, double *to)
{
    hid_t a = H5Aopen(object, array->name, H5P_DEFAULT);
    bool ok = a >= 0 && H5Aread(a, H5T_NATIVE_DOUBLE, to) >= 0;

    if (a >= 0)
        H5Aclose(a);
    return ok ? MODAL_OK : MODAL_BAD_INPUT;
}

static enum modal_status load_dataset(hid_t set, const struct array *array, double *to,
                                      struct modal_error *err)
{
    struct h5_numbers of = { .set = set, .name = array->name, .field = array->name,
                             .most = (double)(SIGNALS_VALUES_MOST * sizeof(double)) };
    enum modal_status rc = h5_numbers_look(&of, err);

    if (rc == MODAL_OK && of.dims[0] * of.dims[1] != array->rows * array->columns)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, array->name, "dataset `%s` is damaged",
                              array->name);
    if (rc == MODAL_OK) {
        allow(&of, 0);                                      /* their place is there */
        rc = h5_numbers_read(&of, to, err);
    }
    return rc;
}

/* Of times and steps: the signals are the batch's, and none of these is turned. */
static enum modal_status load(const struct arrays *arrays, const struct array *array,
                              struct numbers *into, struct modal_error *err)
{
    const struct source *from = arrays->from;
    const char *name = array->at == ON_SIGNALS ? from->signals : array->name;
    hid_t set = array->at != IN_ROOT ? H5Dopen2(from->file, name, H5P_DEFAULT) : H5I_INVALID_HID;
    enum modal_status rc = MODAL_BAD_INPUT;

    modal_fail_field(err, rc, array->name, "%s: `%s` cannot be read: the file is truncated or "
                     "damaged", arrays->path, array->name);
    if (array->at != IN_DATASET)
        rc = load_attribute(array->at == IN_ROOT ? from->file : set, array, into->to);
    else if (set >= 0)
        rc = load_dataset(set, array, into->to, err);
    if (set >= 0)
        H5Dclose(set);
    return rc;
}

/* ---- the signals ---- */

/* What to read of a file, and what it says of their step. */
struct plan {
    char name[NAME_MOST + 1];
    size_t rows, columns;
    bool turned, by_columns;
    struct signals step;
};

static enum modal_status plan_signals(struct arrays *arrays, struct source *from,
                                      const struct signals_options *options, struct plan *plan,
                                      struct modal_error *err)
{
    const struct array *picked;
    enum modal_status rc = arrays_pick(arrays, options->dataset, &picked, err);

    if (rc != MODAL_OK)
        return rc;
    if ((size_t)snprintf(plan->name, sizeof plan->name, "%s", picked->name) >= sizeof plan->name)
        return modal_fail_field(err, MODAL_BAD_INPUT, "dataset", "%s: a name of more than %zu "
                                "bytes", arrays->path, sizeof plan->name - 1);
    size_t at = (size_t)(picked - arrays->list);
    struct h5_numbers of = { .set = H5Dopen2(from->file, plan->name, H5P_DEFAULT),
                             .name = plan->name, .field = "signals",
                             .most = (double)(SIZE_MAX / 4) };
    from->signals = plan->name;
    if (of.set >= 0) {
        rc = h5_numbers_look(&of, err);
        list_attributes(of.set, ON_SIGNALS, arrays);        /* the list may move */
        H5Dclose(of.set);
    }
    picked = &arrays->list[at];
    plan->rows = picked->rows;
    plan->columns = picked->columns;
    plan->by_columns = picked->by_columns;
    if (rc == MODAL_OK) {
        allow(&of, 1);                                      /* a time for each sample */
        rc = arrays_step(arrays, picked, options, &plan->step, &plan->turned, err);
    }
    allow(&of, plan->by_columns != plan->turned ? 2 : 1);
    return rc;
}

static enum modal_status look_into(const char *path, const struct signals_options *options,
                                   struct plan *plan, struct modal_error *err)
{
    struct source from = { .file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT) };
    struct arrays arrays = { .path = path, .from = &from, .load = load };
    enum modal_status rc = MODAL_OK;

    snprintf(plan->name, sizeof plan->name, "signals");
    if (from.file < 0)
        return MODAL_OK;                                    /* who reads it says why not */
    rc = list_all(from.file, path, &arrays, err);
    if (rc == MODAL_OK) {
        list_attributes(from.file, IN_ROOT, &arrays);
        rc = plan_signals(&arrays, &from, options, plan, err);
    }
    arrays_done(&arrays);
    H5Fclose(from.file);
    return rc;
}

/* The array as it lies into samples x channels. */
static enum modal_status turn(const struct plan *plan, struct signals *out, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    size_t rows = out->samples, columns = out->channels;    /* as they lie */

    if (plan->by_columns != plan->turned)
        rc = arrays_turn(&out->x, rows, columns, err);
    if (rc == MODAL_OK && plan->rows > 0) {
        out->samples = plan->turned ? plan->columns : plan->rows;
        out->channels = plan->turned ? plan->rows : plan->columns;
    }
    return rc;
}

/* A file to read, in the child; and the signals in it, of which the parent hears. */
struct reading {
    const char *path;
    const struct signals_options *options;
    uint64_t kept;                /* as batch_file_map has it */
    struct signals read;
    uint64_t place, mapped;       /* bytes of the file; 0: none are mapped */
};

static enum modal_status read_here(void *context, struct modal_error *err)
{
    struct reading *to = context;
    const struct signals_options *options = to->options;
    struct plan plan = { 0 };
    struct batch_file file;
    enum modal_status rc;

    batch_h5_lock();
    rc = look_into(to->path, options, &plan, err);
    batch_h5_unlock();
    if (rc != MODAL_OK)
        return rc;
    double dt = plan.step.dt > 0 ? plan.step.dt : options->dt;
    bool mapped = options->map && !(options->scale > 0) && plan.by_columns == plan.turned;
    rc = mapped ? batch_file_map(to->path, plan.name, dt, to->kept, &file, err)
                : batch_file_read(to->path, plan.name, dt, &file, err);
    if (rc != MODAL_OK)
        return rc;
    to->read = (struct signals){ .samples = file.batch.samples, .channels = file.batch.channels,
                                 .x = file.signals, .map = file.map, .dt = file.batch.dt,
                                 .dt_off = SIGNALS_DT_OFF * file.batch.dt,
                                 .dt_from = "its attribute `dt`", .period = file.batch.period,
                                 .names = file.names, .units = file.units,
                                 .attributes = file.attributes };
    if (plan.step.dt > 0) {
        to->read.dt = plan.step.dt;
        to->read.dt_off = plan.step.dt_off;
        to->read.dt_from = plan.step.dt_from;
    }
    return turn(&plan, &to->read, err);                     /* all that the file held has moved */
}

/* X as it leaves, block by block, for the parent has them then; all of a block but its edges, where
 * pages may be another's too. */
static bool tell_numbers(const double *x, size_t bytes, FILE *to)
{
    enum {
        BLOCK = 1 << 22,                          /* bytes */
        EDGE  = 1 << 16,                          /* no page is larger */
    };
    const char *from = (const char *)x;
    bool ok = true;

    for (; ok && bytes > BLOCK; from += BLOCK, bytes -= BLOCK) {
        ok = fwrite(from, 1, BLOCK, to) == BLOCK;
        mapping_release(from + EDGE, BLOCK - 2 * EDGE);
    }
    return ok && fwrite(from, 1, bytes, to) == bytes;
}

static bool tell(void *context, FILE *to)
{
    const struct signals *s = &((const struct reading *)context)->read;
    char *attributes = json_print(s->attributes);
    bool ok = attributes != NULL && fwrite(s, sizeof *s, 1, to) == 1
              && apart_tell_text(attributes, to) && apart_tell_text(s->units, to);

    for (size_t i = 0; ok && s->names != NULL && i < s->channels; i++)
        ok = apart_tell_text(s->names[i], to);
    return ok && (s->x == NULL
                  || tell_numbers(s->x, s->samples * s->channels * sizeof *s->x, to));
}

/* The numbers, where they are not mapped: COUNT, or one where there are none. */
static bool hear_numbers(size_t count, double **x, FILE *from)
{
    *x = malloc((count > 0 ? count : 1) * sizeof **x);
    return *x != NULL && fread(*x, sizeof **x, count, from) == count;
}

static bool hear(void *context, FILE *from)
{
    struct reading *to = context;
    struct signals said, *s = &to->read;
    char *attributes = NULL;

    if (fread(&said, sizeof said, 1, from) != 1
        || (said.channels > 0 && said.samples > SIZE_MAX / sizeof(double) / said.channels))
        return false;
    *s = said;
    s->x = NULL;
    s->names = NULL;
    s->units = NULL;
    s->attributes = NULL;
    s->map = (struct mapping) { 0 };
    to->place = said.map.offset;
    to->mapped = said.x == NULL ? said.map.length : 0;
    bool ok = apart_hear_text(&attributes, from) && apart_hear_text(&s->units, from)
              && attributes != NULL
              && json_read(attributes, strlen(attributes), &s->attributes, NULL) == MODAL_OK;
    free(attributes);
    if (ok && said.names != NULL)
        ok = (s->names = calloc(s->channels + 1, sizeof *s->names)) != NULL;
    for (size_t i = 0; ok && s->names != NULL && i < s->channels; i++)
        ok = apart_hear_text(&s->names[i], from) && s->names[i] != NULL;
    return ok && (said.x == NULL || hear_numbers(s->samples * s->channels, &s->x, from));
}

/* What the child had mapped. */
static enum modal_status map_again(struct reading *of, struct modal_error *err)
{
    int fd = open(of->path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    enum modal_status rc = fd >= 0 ? mapping_open(fd, of->path, of->place, of->mapped,
                                                  &of->read.map, err)
                                   : modal_fail_field(err, MODAL_BAD_INPUT, "file", "%s: %s",
                                                      of->path, strerror(errno));

    if (fd >= 0)
        close(fd);
    return rc;
}

enum modal_status hdf5_read(const char *path, const struct signals_options *options,
                            struct signals *out, struct modal_error *err)
{
    static const struct apart how = { .work = read_here, .tell = tell, .hear = hear };
    struct reading to = { .path = path, .options = options, .kept = mapping_resident_most() };
    enum modal_status rc = apart_do(&how, &to, path, "file", err);

    if (rc == MODAL_OK && to.mapped > 0)
        rc = map_again(&to, err);
    *out = to.read;
    return rc;
}
