/* scene_path.c - see scene_path.h; tested by tests/unit/job/test_scene_jobs.c */
#include "job/scene_path.h"
#include <ctype.h>
#include <stdlib.h>
#include <string.h>
#include "base/near.h"

enum {
    KEY_MOST = 64,               /* bytes of a key: the longest of a scene has 22 */
    INDEX_MOST = 1000000,        /* of a list: no scene has as many entries */
    NAMES_MOST = 64              /* of an object's keys that are compared: none of ours has more */
};

/* One step of the path: a key or an index; *PATH moves past it.  False where the path is
 * malformed. */
static bool next_step(const char **path, char key[KEY_MOST], int *index)
{
    const char *p = *path;
    size_t n = 0;

    *index = -1;
    if (*p == '[') {
        char *end;
        long i = isdigit((unsigned char)p[1]) ? strtol(p + 1, &end, 10) : -1;

        if (i < 0 || i > INDEX_MOST || *end != ']')
            return false;
        *index = (int)i;
        p = end + 1;
    } else {
        while (p[n] != '\0' && p[n] != '[' && p[n] != '.' && n < KEY_MOST - 1)
            n++;
        if (n == 0 || n == KEY_MOST - 1)
            return false;
        memcpy(key, p, n);
        key[n] = '\0';
        p += n;
    }
    *path = *p == '.' && p[1] != '\0' && p[1] != '.' && p[1] != '[' ? p + 1 : p;
    return *p == '\0' || *p == '[' || *path != p;
}

static cJSON *walk(cJSON *at, const char *path, cJSON **parent, char key[KEY_MOST], int *index)
{
    *parent = NULL;
    while (at != NULL && *path != '\0') {
        if (!next_step(&path, key, index))
            return *parent = NULL, NULL;
        *parent = *index >= 0 ? cJSON_IsArray(at) ? at : NULL : cJSON_IsObject(at) ? at : NULL;
        at = *parent == NULL ? NULL
             : *index >= 0   ? cJSON_GetArrayItem(at, *index)
                             : cJSON_GetObjectItemCaseSensitive(at, key);
        if (at == NULL && *path != '\0')
            *parent = NULL;
    }
    return at;
}

/* Of the first object on the PATH that lacks its key: those of its keys that may be meant. */
static void suggest(const cJSON *at, const char *path, char meant[NEAR_TEXT])
{
    const char *names[NAMES_MOST + 1];
    char key[KEY_MOST];
    int index, count = 0;

    meant[0] = '\0';
    while (*path != '\0' && next_step(&path, key, &index)) {
        const cJSON *next = index >= 0 ? cJSON_GetArrayItem(at, index) : json_member(at, key);
        if (next == NULL && index < 0 && cJSON_IsObject(at)) {
            for (next = at->child; next != NULL && count < NAMES_MOST; next = next->next)
                names[count++] = next->string;
            names[count] = NULL;
            near_text(key, names, meant);
            return;
        }
        at = next;
    }
}

enum modal_status scene_path_set(cJSON *scene, const char *path, double value, const char *field,
                                 struct modal_error *err)
{
    cJSON *parent, *at;
    char key[KEY_MOST], meant[NEAR_TEXT];
    int index = -1;

    at = walk(scene, path, &parent, key, &index);
    if (at != NULL && cJSON_IsNumber(at)) {
        cJSON_SetNumberValue(at, value);
        return MODAL_OK;
    }
    if (at == NULL && parent != NULL && index < 0) {
        cJSON_AddNumberToObject(parent, key, value);
        return MODAL_OK;
    }
    suggest(scene, path, meant);
    return modal_fail_field(err, MODAL_BAD_INPUT, field, "\"%.80s\" is no number of this scene%s; "
                            "accepted: a path such as omega or effects[0].stiffness", path, meant);
}
