/* batch_h5.c - making the dataset of a batch and its attributes; see batch_h5.h */
#include "store/batch_h5.h"
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;

void batch_h5_lock(void)
{
    pthread_mutex_lock(&mutex);
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    H5PLset_loading_state(0);
}

void batch_h5_unlock(void)
{
    pthread_mutex_unlock(&mutex);
}

/* One attribute of COUNT values (0: a scalar) of memory and file type TYPE. */
static bool put_attribute(hid_t set, const char *name, hid_t type, hsize_t count,
                          const void *values)
{
    hid_t space = count == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &count, NULL),
          attribute = H5I_INVALID_HID;
    bool ok = false;

    if (space >= 0)
        attribute = H5Acreate2(set, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    if (attribute >= 0)
        ok = H5Awrite(attribute, type, values) >= 0;
    if (attribute >= 0)
        H5Aclose(attribute);
    if (space >= 0)
        H5Sclose(space);
    return ok;
}

static bool put_number(hid_t set, const char *name, double value)
{
    return put_attribute(set, name, H5T_IEEE_F64LE, 0, &value);
}

static bool put_texts(hid_t set, const char *name, hsize_t count, const char *const *texts)
{
    hid_t type = H5Tcopy(H5T_C_S1);
    bool ok = type >= 0 && H5Tset_size(type, H5T_VARIABLE) >= 0
              && H5Tset_cset(type, H5T_CSET_UTF8) >= 0
              && put_attribute(set, name, type, count, texts);

    if (type >= 0)
        H5Tclose(type);
    return ok;
}

static bool is_list_of(const cJSON *value, cJSON_bool (*is)(const cJSON *))
{
    const cJSON *item;

    if (!cJSON_IsArray(value) || value->child == NULL)
        return false;
    cJSON_ArrayForEach(item, value)
        if (!is(item))
            return false;
    return true;
}

static bool put_number_list(hid_t set, const char *name, const cJSON *list)
{
    hsize_t count = (hsize_t)cJSON_GetArraySize(list), i = 0;
    double *values = malloc(count * sizeof *values);
    const cJSON *item;
    bool ok = false;

    if (values != NULL) {
        cJSON_ArrayForEach(item, list)
            values[i++] = item->valuedouble;
        ok = put_attribute(set, name, H5T_IEEE_F64LE, count, values);
    }
    free(values);
    return ok;
}

static bool put_text_list(hid_t set, const char *name, const cJSON *list)
{
    hsize_t count = (hsize_t)cJSON_GetArraySize(list), i = 0;
    const char **texts = malloc(count * sizeof *texts);
    const cJSON *item;
    bool ok = false;

    if (texts != NULL) {
        cJSON_ArrayForEach(item, list)
            texts[i++] = item->valuestring;
        ok = put_texts(set, name, count, texts);
    }
    free(texts);
    return ok;
}

/* What HDF5 has no simple form for is kept as its JSON text. */
static bool put_json(hid_t set, const char *name, const cJSON *value)
{
    char *text = json_print(value);
    const char *texts[1] = { text };
    bool ok = text != NULL && put_texts(set, name, 0, texts);

    free(text);
    return ok;
}

static bool put_value(hid_t set, const cJSON *value)
{
    const char *texts[1] = { value->valuestring };

    if (cJSON_IsNumber(value))
        return put_number(set, value->string, value->valuedouble);
    if (cJSON_IsString(value))
        return put_texts(set, value->string, 0, texts);
    if (is_list_of(value, cJSON_IsNumber))
        return put_number_list(set, value->string, value);
    if (is_list_of(value, cJSON_IsString))
        return put_text_list(set, value->string, value);
    return put_json(set, value->string, value);
}

static bool put_shape(hid_t set, const struct input_shape *shape)
{
    const char *units[1] = { shape->units };

    return put_number(set, "dt", shape->dt)
           && (shape->period == 0 || put_number(set, "period", shape->period))
           && (shape->units == NULL || put_texts(set, "units", 0, units))
           && (shape->names == NULL || put_texts(set, "channels", shape->channels, shape->names));
}

static bool own_name(const char *name)
{
    static const char *const own[] = { "dt", "period", "units", "channels" };

    for (size_t i = 0; i < sizeof own / sizeof *own; i++)
        if (strcmp(name, own[i]) == 0)
            return true;
    return name[0] == 0;
}

static hid_t make_set(hid_t file, const struct input_shape *shape)
{
    bool batch = shape->type == INPUT_BATCH;
    hsize_t dims[2] = { batch ? shape->samples : shape->length, shape->channels };
    hid_t space = H5Screate_simple(batch ? 2 : 1, dims, NULL), plan = H5Pcreate(H5P_DATASET_CREATE),
          set = H5I_INVALID_HID;

    if (space >= 0 && plan >= 0 && H5Pset_layout(plan, H5D_CONTIGUOUS) >= 0
        && H5Pset_alloc_time(plan, H5D_ALLOC_TIME_EARLY) >= 0
        && H5Pset_fill_time(plan, H5D_FILL_TIME_NEVER) >= 0
        && H5Pset_attr_phase_change(plan, 0, 0) >= 0 && H5Pset_obj_track_times(plan, 0) >= 0)
        set = H5Dcreate2(file, batch ? "signals" : "scene", batch ? H5T_IEEE_F64LE : H5T_STD_U8LE,
                         space, H5P_DEFAULT, plan, H5P_DEFAULT);
    if (plan >= 0)
        H5Pclose(plan);
    if (space >= 0)
        H5Sclose(space);
    return set;
}

enum modal_status batch_h5_make(hid_t file, const struct input_shape *shape,
                                const cJSON *attributes, hid_t *set, struct modal_error *err)
{
    hid_t made = make_set(file, shape);
    bool ok = made >= 0 && (shape->type != INPUT_BATCH || put_shape(made, shape));
    const cJSON *value;

    cJSON_ArrayForEach(value, attributes)
        ok = ok && (own_name(value->string) || put_value(made, value));
    if (!ok) {
        if (made >= 0)
            H5Dclose(made);
        return modal_fail(err, MODAL_IO,
                          "batch: HDF5 could not write the dataset or its attributes");
    }
    *set = made;
    return MODAL_OK;
}
