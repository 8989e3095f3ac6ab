/* canonical.c - see canonical.h */
#include "base/canonical.h"
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "base/json.h"

static int by_key(const void *a, const void *b)
{
    return strcmp((*(cJSON *const *)a)->string, (*(cJSON *const *)b)->string);
}

/* A copy with the members of every object in the order of their names; NULL: no memory. */
static cJSON *sorted(const cJSON *value)
{
    cJSON *copy = cJSON_Duplicate(value, false), *whole = NULL;
    size_t count = (size_t)cJSON_GetArraySize(value), done = 0;
    const cJSON **members = malloc((count + 1) * sizeof *members), *child = value->child;

    if (copy == NULL || members == NULL)
        goto out;
    for (size_t i = 0; i < count; i++, child = child->next)
        members[i] = child;
    if (cJSON_IsObject(value))
        qsort(members, count, sizeof *members, by_key);
    /* with its name */
    while (done < count && cJSON_AddItemToArray(copy, sorted(members[done])))
        done++;
    if (done == count) {
        whole = copy;
        copy = NULL;
    }
out:
    free(members);
    cJSON_Delete(copy);
    return whole;
}

/* Whether every object in VALUE has its members in that order already: nearly always. */
static bool is_sorted(const cJSON *value)
{
    bool object = cJSON_IsObject(value);

    for (const cJSON *child = value->child; child != NULL; child = child->next)
        if ((object && child->next != NULL && strcmp(child->string, child->next->string) > 0)
            || !is_sorted(child))
            return false;
    return true;
}

char *canonical_text(const cJSON *value)
{
    cJSON *copy = NULL;
    char *text;

    if (value == NULL)
        return strdup("{}");
    if (!is_sorted(value) && (value = copy = sorted(value)) == NULL)
        return NULL;
    text = json_print(value);
    cJSON_Delete(copy);
    return text;
}
