/* scene_path.c - see scene_path.h; tested by tests/unit/job/test_scene_jobs.c */
#include "job/scene_path.h"
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

enum {
    KEY_MOST = 64,               /* bytes of a key: the longest of a scene has 22 */
    INDEX_MOST = 1000000         /* of a list: no scene has as many entries */
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

enum modal_status scene_path_set(cJSON *scene, const char *path, double value, const char *field,
                                 struct modal_error *err)
{
    cJSON *parent, *at;
    char key[KEY_MOST];
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
    return modal_fail_field(err, MODAL_BAD_INPUT, field,
                            "\"%.80s\" is no number of this scene; accepted: a path such as omega "
                            "or effects[0].stiffness",
                            path);
}
