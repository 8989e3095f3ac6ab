/* scene_file.c - see scene_file.h */
#include "scene_file.h"
#include <errno.h>
#include <hdf5.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include "apart.h"
#include "matrix_market.h"
#include "signals.h"
#include "store/batch_h5.h"
#include "store/h5_numbers.h"

static const char *const matrices[] = { "M", "K", "C", "G", NULL };

#define BAD_FILE(...) modal_fail_field(err, MODAL_BAD_INPUT, "structure.file", __VA_ARGS__)

/* The numbers of SET, of RANK dimensions, as doubles; the caller frees *X. */
static enum modal_status read_set(hid_t set, const char *name, int rank, hsize_t *dims, double **x,
                                  struct modal_error *err)
{
    struct h5_numbers of = { .set = set, .name = name, .field = "structure.file",
                             .most = (double)(SIGNALS_VALUES_MOST / 16 * sizeof(double)) };
    enum modal_status rc = h5_numbers_look(&of, err);
    double *values, count;

    if (rc != MODAL_OK)
        return rc;
    if (of.rank != rank)
        return BAD_FILE("dataset \"%s\" has %d dimensions; accepted: %d", name, of.rank, rank);
    count = (double)of.dims[0] * (double)of.dims[1];
    /* these, two copies and compressed rows that grow; and chunks, as in files/hdf5.c */
    apart_allow(6 * count * (double)sizeof *values + 4 * (double)of.piece, of.pieces);
    values = malloc((size_t)count * sizeof *values + 1);
    if (values == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory for dataset \"%s\"", name);
    rc = h5_numbers_read(&of, values, err);
    if (rc != MODAL_OK) {
        free(values);
        return rc;
    }
    memcpy(dims, of.dims, (size_t)rank * sizeof *dims);
    *x = values;
    return MODAL_OK;
}

static enum modal_status read_numbers(hid_t at, const char *name, int rank, hsize_t *dims,
                                      double **x, struct modal_error *err)
{
    hid_t set = H5Dopen2(at, name, H5P_DEFAULT);
    enum modal_status rc = set < 0 ? BAD_FILE("no dataset \"%s\"", name)
                                   : read_set(set, name, rank, dims, x, err);

    if (set >= 0)
        H5Dclose(set);
    return rc;
}

/* The entries of a dense matrix that are not exactly 0. */
static enum modal_status read_dense(hid_t file, const char *name, struct scene_arrays_made *arrays,
                                    cJSON **out, struct modal_error *err)
{
    hsize_t dims[2] = { 0 }, count = 0;
    double *x = NULL, *pointers = NULL, *columns = NULL, *values = NULL;
    enum modal_status rc = read_numbers(file, name, 2, dims, &x, err);

    if (rc == MODAL_OK && dims[0] != dims[1])
        rc = BAD_FILE("dataset \"%s\" is %llu x %llu; it must be square", name,
                      (unsigned long long)dims[0], (unsigned long long)dims[1]);
    if (rc != MODAL_OK)
        goto out;
    pointers = malloc((dims[0] + 1) * sizeof *pointers);
    columns = malloc(dims[0] * dims[1] * sizeof *columns + 1);
    values = malloc(dims[0] * dims[1] * sizeof *values + 1);
    if (pointers == NULL || columns == NULL || values == NULL) {
        rc = modal_fail(err, MODAL_NO_MEMORY, "no memory for matrix %s", name);
        goto out;
    }
    for (hsize_t i = 0; i < dims[0]; i++) {
        pointers[i] = (double)count;
        for (hsize_t j = 0; j < dims[1]; j++)
            if (x[i * dims[1] + j] != 0) {
                columns[count] = (double)j;
                values[count++] = x[i * dims[1] + j];
            }
    }
    pointers[dims[0]] = (double)count;
    rc = scene_arrays_add(arrays, "structure.file", dims[0], count, pointers, columns, values, out,
                          err);
out:
    free(x); free(pointers); free(columns); free(values);
    return rc;
}

/* A group of compressed rows: `data`, `indices`, `indptr`; square, as every matrix here. */
static enum modal_status read_csr(hid_t file, const char *name, struct scene_arrays_made *arrays,
                                  cJSON **out, struct modal_error *err)
{
    hid_t group = H5Gopen2(file, name, H5P_DEFAULT);
    hsize_t n = 0, count = 0, indices = 0;
    double *pointers = NULL, *columns = NULL, *values = NULL;
    enum modal_status rc = group < 0 ? BAD_FILE("\"%s\" is neither a dataset nor a group", name)
                                     : MODAL_OK;

    if (rc == MODAL_OK)
        rc = read_numbers(group, "indptr", 1, &n, &pointers, err);
    if (rc == MODAL_OK)
        rc = read_numbers(group, "indices", 1, &indices, &columns, err);
    if (rc == MODAL_OK)
        rc = read_numbers(group, "data", 1, &count, &values, err);
    if (rc == MODAL_OK && (n < 2 || indices != count || pointers[n - 1] != (double)count))
        rc = BAD_FILE(
            "group \"%s\": %llu pointers, %llu indices, %llu values do not belong together", name,
            (unsigned long long)n, (unsigned long long)indices, (unsigned long long)count);
    if (rc == MODAL_OK)
        rc = scene_arrays_add(arrays, "structure.file", n - 1, count, pointers, columns, values,
                              out, err);
    free(pointers); free(columns); free(values);
    if (group >= 0) H5Gclose(group);
    return rc;
}

static enum modal_status read_matrix(hid_t file, const char *name, struct scene_arrays_made *arrays,
                                     cJSON **out, struct modal_error *err)
{
    H5O_info_t info;

    *out = NULL;
    if (H5Lexists(file, name, H5P_DEFAULT) <= 0)
        return MODAL_OK;
    if (H5Oget_info_by_name(file, name, &info, H5P_DEFAULT) < 0)
        return BAD_FILE("\"%s\" cannot be read", name);
    return info.type == H5O_TYPE_GROUP ? read_csr(file, name, arrays, out, err)
                                       : read_dense(file, name, arrays, out, err);
}

/* `dir` of the scene's own path + NAME, unless NAME is absolute. */
static void beside(char *out, size_t size, const char *scene_path, const char *name)
{
    const char *slash = strrchr(scene_path, '/');

    snprintf(out, size, "%.*s%s",
             name[0] == '/' || slash == NULL ? 0 : (int)(slash - scene_path + 1), scene_path, name);
}

/* The matrices of the HDF5 file PATH, read in a child: what the scene's text says of them, and the
 * arrays behind it. */
struct reading { const char *path; cJSON *said; struct scene_arrays_made *arrays; };

static enum modal_status read_here(void *context, struct modal_error *err)
{
    struct reading *to = context;
    enum modal_status rc = MODAL_OK;

    batch_h5_lock();
    hid_t file = H5Fopen(to->path, H5F_ACC_RDONLY, H5P_DEFAULT);
    to->said = cJSON_CreateObject();
    if (file < 0)
        rc = BAD_FILE("%.300s cannot be read as HDF5: it is another file, truncated or damaged",
                      to->path);
    for (int i = 0; rc == MODAL_OK && matrices[i] != NULL; i++) {
        cJSON *matrix = NULL;
        rc = read_matrix(file, matrices[i], to->arrays, &matrix, err);
        if (rc == MODAL_OK && matrix != NULL)
            cJSON_AddItemToObject(to->said, matrices[i], matrix);
    }
    if (file >= 0)
        H5Fclose(file);
    batch_h5_unlock();
    return rc;
}

static bool tell(void *context, FILE *to)
{
    const struct reading *from = context;
    const struct scene_arrays_made *arrays = from->arrays;
    char *said = json_print(from->said);

    return said != NULL && apart_tell_text(said, to)
           && fwrite(&arrays->length, sizeof arrays->length, 1, to) == 1
           && fwrite(arrays->data, 1, arrays->length, to) == arrays->length;
}

static bool hear(void *context, FILE *from)
{
    struct reading *to = context;
    struct scene_arrays_made *arrays = to->arrays;
    char *said = NULL;
    bool ok = apart_hear_text(&said, from) && said != NULL
              && json_read(said, strlen(said), &to->said, NULL) == MODAL_OK
              && fread(&arrays->length, sizeof arrays->length, 1, from) == 1;

    free(said);
    free(arrays->data);                   /* of which the child has told all again */
    arrays->data = ok ? malloc(arrays->length + 1) : NULL;
    if (arrays->data == NULL)
        arrays->length = 0;
    return ok && arrays->data != NULL
           && fread(arrays->data, 1, arrays->length, from) == arrays->length;
}

static enum modal_status check_file(const char *path, struct modal_error *err)
{
    struct stat known;

    if (stat(path, &known) != 0)
        return BAD_FILE("%.300s: %s", path, strerror(errno));
    return S_ISREG(known.st_mode) ? MODAL_OK : BAD_FILE("%.300s is no file; accepted: HDF5", path);
}

static enum modal_status inline_file(cJSON *structure, const char *scene_path,
                                     struct scene_arrays_made *arrays, struct modal_error *err)
{
    static const struct apart how = { .work = read_here, .tell = tell, .hear = hear };
    const cJSON *key = cJSON_GetObjectItemCaseSensitive(structure, "file");
    struct reading to = { .arrays = arrays };
    enum modal_status rc;
    char path[4096];

    if (key == NULL)
        return MODAL_OK;
    if (!cJSON_IsString(key))
        return BAD_FILE("accepted: the name of an HDF5 file");
    beside(path, sizeof path, scene_path, key->valuestring);
    to.path = path;
    rc = check_file(path, err);
    if (rc == MODAL_OK)
        rc = apart_do(&how, &to, path, "structure.file", err);
    for (cJSON *matrix; rc == MODAL_OK && (matrix = to.said->child) != NULL;) {
        cJSON_DetachItemViaPointer(to.said, matrix);
        if (cJSON_HasObjectItem(structure, matrix->string)) {
            rc = BAD_FILE("matrix %s stands in the scene and in the file", matrix->string);
            cJSON_Delete(matrix);
        } else
            cJSON_AddItemToObject(structure, matrix->string, matrix);
    }
    cJSON_Delete(to.said);
    if (rc == MODAL_OK)
        cJSON_DeleteItemFromObjectCaseSensitive(structure, "file");
    return rc;
}

/* M, K, C, G that name Matrix Market files, in their place. */
static enum modal_status inline_matrices(cJSON *structure, const char *scene_path,
                                         struct scene_arrays_made *arrays, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    char path[4096], field[24];

    for (int i = 0; rc == MODAL_OK && matrices[i] != NULL; i++) {
        const cJSON *name = cJSON_GetObjectItemCaseSensitive(structure, matrices[i]);
        cJSON *matrix = NULL;

        if (!cJSON_IsString(name))
            continue;
        snprintf(field, sizeof field, "structure.%s", matrices[i]);
        beside(path, sizeof path, scene_path, name->valuestring);
        rc = matrix_market_read(path, field, arrays, &matrix, err);
        if (rc == MODAL_OK)
            cJSON_ReplaceItemInObjectCaseSensitive(structure, matrices[i], matrix);
    }
    return rc;
}

/* Nothing, signals and whatever else is no JSON are called so, and not JSON with a fault at its
 * first byte. */
static enum modal_status check_begin(const char *text, size_t length, const char *path,
                                     struct modal_error *err)
{
    size_t blanks = strspn(text, " \t\r\n");
    enum modal_status rc = signals_check_text(text, length, path, "scene", "UTF-8", err);

    if (rc != MODAL_OK || text[blanks] == '{')
        return rc;
    return modal_fail_field(err, MODAL_BAD_INPUT, "scene", "%s is %s; accepted: a JSON object, "
                            "{\"structure\": ...} (modalctl help scene)%s", path,
                            blanks == length ? "empty" : "no scene",
                            blanks == length ? "" : "; signals with identify");
}

enum modal_status scene_file_read(const char *path, cJSON **out, struct scene_arrays_made *arrays,
                                  struct modal_error *err)
{
    char *text = NULL;
    size_t length = 0;
    cJSON *scene = NULL, *inner;
    struct modal_error inside = { 0 };
    enum modal_status rc = signals_read_text(path, SCENE_TEXT_MOST, &text, &length, err);

    if (rc == MODAL_OK)
        rc = check_begin(text, length, path, err);
    if (rc == MODAL_OK && (rc = json_read(text, length, &scene, &inside)) != MODAL_OK)
        rc = modal_fail_field(err, rc, inside.field[0] ? inside.field : "scene", "%s: %s", path,
                              inside.message);
    if (rc == MODAL_OK) {
        inner = cJSON_GetObjectItemCaseSensitive(scene, "scene");
        inner = cJSON_GetObjectItemCaseSensitive(inner ? inner : scene, "structure");
        rc = inline_file(inner, path, arrays, err);
        if (rc == MODAL_OK)
            rc = inline_matrices(inner, path, arrays, err);
    }
    free(text);
    if (rc == MODAL_OK)
        *out = scene;
    else
        cJSON_Delete(scene);
    return rc;
}
