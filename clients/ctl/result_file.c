/* result_file.c - see result_file.h */
#include "result_file.h"
#include <hdf5.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "field.h"

static const char *kind_of(const cJSON *doc)
{
    return cJSON_IsString(field_get(doc, "kind")) ? field_get(doc, "kind")->valuestring : "";
}

bool result_file_fits(const cJSON *doc)
{
    return strcmp(kind_of(doc), "steady") == 0 || strcmp(kind_of(doc), "curve") == 0
           || strcmp(kind_of(doc), "backbone") == 0;
}

/* What one value of each point is, and where its number stands in the point. */
static double converged(const cJSON *point) { return cJSON_IsTrue(field_get(point, "converged")); }
static double omega(const cJSON *point) { return field_real(point, "omega"); }
static double total_error(const cJSON *point) { return field_real(point, "total_error"); }
static double damping_ratio(const cJSON *point) { return field_real(point, "damping_ratio"); }
static double energy(const cJSON *point) { return field_real(point, "energy"); }
static double stable(const cJSON *point)
{
    const cJSON *verdict = field_get(field_get(point, "stability"), "stable");

    return cJSON_IsBool(verdict) ? cJSON_IsTrue(verdict) : -1;
}

static const struct column {
    const char *name;
    bool backbone, steady;
    double (*of)(const cJSON *point);
} columns[] = {
    { "omega", true, true, omega }, { "converged", true, true, converged },
    { "stable", false, true, stable },
    { "total_error", false, true, total_error }, { "damping_ratio", true, false, damping_ratio },
    { "energy", true, false, energy },
};

struct table { int points, dofs, harmonics; const cJSON *first; }; /* first point, then its
                                                                      siblings */

static const cJSON *next_point(const struct table *t, const cJSON *point)
{
    return t->points > 1 ? point->next : NULL;
}

static struct table measure(const cJSON *doc)
{
    const cJSON *list = field_get(doc, "points"), *rows;
    struct table t = { .points = list != NULL ? cJSON_GetArraySize(list) : 1,
                       .first = list != NULL ? list->child : doc };

    t.dofs = t.points > 0 ? cJSON_GetArraySize(field_get(t.first, "harmonics")) : 0;
    for (const cJSON *p = t.first; p != NULL && t.points > 0; p = next_point(&t, p)) {
        rows = field_get(p, "harmonics");
        if (rows != NULL && rows->child != NULL
            && cJSON_GetArraySize(field_get(rows->child, "k")) > t.harmonics)
            t.harmonics = cJSON_GetArraySize(field_get(rows->child, "k"));
    }
    return t;
}

static bool write_numbers(hid_t file, const char *name, int rank, const hsize_t *size,
                          const double *x)
{
    hid_t space = H5Screate_simple(rank, size, NULL);
    hid_t set = space < 0 ? H5I_INVALID_HID
                          : H5Dcreate2(file, name, H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT,
                                       H5P_DEFAULT);
    bool ok = set >= 0 && H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, x) >= 0;

    if (set >= 0) H5Dclose(set);
    if (space >= 0) H5Sclose(space);
    return ok;
}

static hid_t text_type(void)
{
    hid_t type = H5Tcopy(H5T_C_S1);

    H5Tset_size(type, H5T_VARIABLE);
    H5Tset_cset(type, H5T_CSET_UTF8);
    return type;
}

static bool write_attribute(hid_t at, const char *name, const char *text)
{
    hid_t type = text_type(), space = H5Screate(H5S_SCALAR);
    hid_t attribute = H5Acreate2(at, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = attribute >= 0 && text != NULL && H5Awrite(attribute, type, &text) >= 0;

    if (attribute >= 0) H5Aclose(attribute);
    H5Sclose(space);
    H5Tclose(type);
    return ok;
}

static bool write_json(hid_t file, const char *name, const cJSON *value)
{
    char *text = value != NULL ? cJSON_PrintUnformatted(value) : NULL;
    bool ok = value == NULL || write_attribute(file, name, text);

    cJSON_free(text);
    return ok;
}

static bool write_names(hid_t file, const struct table *t)
{
    const char **names = calloc((size_t)t->dofs + 1, sizeof *names);
    hsize_t size = (hsize_t)t->dofs;
    hid_t type = text_type(), space = H5Screate_simple(1, &size, NULL);
    hid_t set = H5Dcreate2(file, "dofs", type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    const cJSON *row;
    int i = 0;
    bool ok;

    cJSON_ArrayForEach(row, field_get(t->first, "harmonics"))
        if (names != NULL)
            names[i++] = field_get(row, "dof")->valuestring;
    ok = names != NULL && set >= 0
         && H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, names) >= 0;
    if (set >= 0) H5Dclose(set);
    H5Sclose(space);
    H5Tclose(type);
    free(names);
    return ok;
}

static bool write_columns(hid_t file, const cJSON *doc, const struct table *t)
{
    bool backbone = strcmp(kind_of(doc), "backbone") == 0, ok = true;
    const char *parameter = backbone ? "amplitude"
                            : cJSON_IsString(field_get(doc, "parameter"))
                                ? field_get(doc, "parameter")->valuestring
                                : "omega";
    double *x = calloc((size_t)t->points + 1, sizeof *x);
    hsize_t size = (hsize_t)t->points;
    int i = 0;
    hid_t set;

    if (x == NULL)
        return false;
    for (const cJSON *p = t->first; p != NULL; p = next_point(t, p))
        x[i++] = field_real(p, parameter);
    ok = write_numbers(file, "points", 1, &size, x);
    set = ok ? H5Dopen2(file, "points", H5P_DEFAULT) : H5I_INVALID_HID;
    ok = set >= 0 && write_attribute(set, "parameter", parameter);
    if (set >= 0) H5Dclose(set);
    for (size_t c = 0; ok && c < sizeof columns / sizeof *columns; c++) {
        if (!(backbone ? columns[c].backbone : columns[c].steady))
            continue;
        i = 0;
        for (const cJSON *p = t->first; p != NULL; p = next_point(t, p))
            x[i++] = columns[c].of(p);
        ok = write_numbers(file, columns[c].name, 1, &size, x);
    }
    free(x);
    return ok;
}

static bool write_spectra(hid_t file, const struct table *t, const char *part)
{
    hsize_t size[3] = { (hsize_t)t->points, (hsize_t)t->dofs, (hsize_t)t->harmonics };
    double *x = calloc((size_t)(size[0] * size[1] * size[2]) + 1, sizeof *x), *at = x;
    const cJSON *row, *value;
    bool ok;

    for (const cJSON *p = t->first; x != NULL && p != NULL; p = next_point(t, p)) {
        int i = 0;

        cJSON_ArrayForEach(row, field_get(p, "harmonics")) {
            int k = 0;

            cJSON_ArrayForEach(value, field_get(row, part))
                if (i < t->dofs && k < t->harmonics)
                    at[i * t->harmonics + k++] = cJSON_IsNumber(value) ? value->valuedouble : NAN;
            i++;
        }
        at += t->dofs * t->harmonics;
    }
    ok = x != NULL && write_numbers(file, part, 3, size, x);
    free(x);
    return ok;
}

static bool write_waveform(hid_t file, const cJSON *time)
{
    const cJSON *t = field_get(time, "t"), *rows = field_get(time, "x"), *row, *value;
    hsize_t size[2] = { (hsize_t)cJSON_GetArraySize(rows), (hsize_t)cJSON_GetArraySize(t) };
    double *x = calloc((size_t)((size[0] + 1) * size[1]) + 1, sizeof *x), *at = x;
    bool ok = x != NULL;

    if (ok)
        cJSON_ArrayForEach(value, t)
            *at++ = value->valuedouble;
    ok = ok && write_numbers(file, "t", 1, &size[1], x);
    at = x;
    if (ok)
        cJSON_ArrayForEach(row, rows)
            cJSON_ArrayForEach(value, row)
                *at++ = value->valuedouble;
    ok = ok && write_numbers(file, "x", 2, size, x);
    free(x);
    return ok;
}

static bool write_all(hid_t file, const cJSON *doc)
{
    struct table t = measure(doc);
    bool ok = write_attribute(file, "kind", kind_of(doc))
              && write_json(file, "provenance", field_get(doc, "provenance"))
              && write_json(file, "plan", field_get(doc, "plan"));

    if (!ok || t.points == 0)
        return ok;
    ok = write_columns(file, doc, &t) && write_names(file, &t) && write_spectra(file, &t, "re")
         && write_spectra(file, &t, "im");
    return ok && (field_get(doc, "time") == NULL || write_waveform(file, field_get(doc, "time")));
}

enum modal_status result_file_write(const char *path, const cJSON *doc, struct modal_error *err)
{
    hid_t file;
    bool ok;

    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    ok = file >= 0 && write_all(file, doc);
    if (file >= 0)
        ok = H5Fclose(file) >= 0 && ok;
    return ok ? MODAL_OK
              : modal_fail_field(err, MODAL_BAD_INPUT, "output", "%.300s cannot be written", path);
}
