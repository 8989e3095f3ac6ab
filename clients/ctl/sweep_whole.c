/* sweep_whole.c - see sweep_whole.h */
#include "sweep_whole.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "field.h"

bool sweep_whole_as_text(const struct args *args)
{
    return args->json && args->plot == NULL;
}

static void add_number(cJSON *to, const cJSON *from, const char *key)
{
    cJSON *item = cJSON_GetObjectItemCaseSensitive(to, key);

    if (cJSON_IsNumber(item))
        cJSON_SetNumberValue(item, item->valuedouble + field_number(from, key, 0));
}

static void add_cost(cJSON *to, const cJSON *from)
{
    cJSON *stages = cJSON_GetObjectItemCaseSensitive(to, "stages"),
          *peak = cJSON_GetObjectItemCaseSensitive(to, "peak_bytes"), *stage;

    add_number(to, from, "wall_s");
    add_number(to, from, "cpu_s");
    cJSON_ArrayForEach(stage, stages)
        add_number(stages, cJSON_GetObjectItemCaseSensitive(from, "stages"), stage->string);
    if (cJSON_IsNumber(peak))
        cJSON_SetNumberValue(peak, fmax(peak->valuedouble, field_number(from, "peak_bytes", 0)));
}

/* A list of points as one item of text; NULL: none, no memory, or one of them failed, which the
 * exit status asks for. */
static cJSON *printed(const cJSON *points)
{
    const cJSON *point;
    cJSON *raw = NULL;
    char *text;

    cJSON_ArrayForEach(point, points)
        if (cJSON_HasObjectItem(point, "error"))
            return NULL;
    text = points->child != NULL ? json_print(points) : NULL;

    if (text != NULL) {
        text[strlen(text) - 1] = '\0';                 /* without its brackets */
        raw = cJSON_CreateRaw(text + 1);
    }
    free(text);
    return raw;
}

/* The points of FROM behind those of TO.  Where only their text is wanted they are printed while
 * other shares are computed, so that the last share leaves little to do. */
static void append(const struct sweep_whole *whole, cJSON *to, cJSON *from)
{
    cJSON *raw = whole->as_text ? printed(from) : NULL;

    if (raw != NULL)
        cJSON_AddItemToArray(to, raw);
    while (raw == NULL && from->child != NULL)
        cJSON_AddItemToArray(to, cJSON_DetachItemViaPointer(from, from->child));
}

void sweep_whole_add(struct sweep_whole *whole, cJSON *result)
{
    cJSON *points = cJSON_DetachItemFromObjectCaseSensitive(result, "points");
    bool first = whole->result == NULL;

    whole->taken += cJSON_GetArraySize(points);
    if (first) {
        whole->result = result;
        cJSON_AddArrayToObject(result, "points");
    }
    if (points != NULL)
        append(whole, cJSON_GetObjectItemCaseSensitive(whole->result, "points"), points);
    cJSON_Delete(points);
    if (first)
        return;
    add_cost(cJSON_GetObjectItemCaseSensitive(whole->result, "cost"),
             cJSON_GetObjectItemCaseSensitive(result, "cost"));
    cJSON_Delete(result);
}

/* The whole's provenance is of all points, not of the first share. */
enum modal_status sweep_whole_end(struct sweep_whole *whole, int points, cJSON **out,
                                  struct modal_error *err)
{
    cJSON *options = cJSON_GetObjectItemCaseSensitive(
        cJSON_GetObjectItemCaseSensitive(whole->result, "provenance"), "options");
    cJSON *count = cJSON_GetObjectItemCaseSensitive(options, "count");

    if (whole->taken != points)
        return modal_fail(err, MODAL_INTERNAL, "the shares hold %d of %d points", whole->taken,
                          points);
    if (cJSON_IsNumber(count))
        cJSON_SetNumberValue(count, points);
    *out = whole->result;
    whole->result = NULL;
    return MODAL_OK;
}

void sweep_whole_done(struct sweep_whole *whole)
{
    cJSON_Delete(whole->result);
    *whole = (struct sweep_whole) { 0 };
}
