/* scene_text.h - scenes for tests, written with single quotes */
#ifndef TESTS_SCENE_TEXT_H
#define TESTS_SCENE_TEXT_H
#include <stdlib.h>
#include <string.h>
#include "base/json.h"
#include "modal/scene/scene.h"

static inline cJSON *scene_text(const char *text)
{
    struct modal_error err;
    char *copy = strdup(text);
    cJSON *scene = NULL;

    for (char *c = copy; *c != '\0'; c++)
        if (*c == '\'')
            *c = '"';
    if (json_read(copy, strlen(copy), &scene, &err) != MODAL_OK)
        fail_msg("%s: %s", copy, err.message);
    free(copy);
    return scene;
}

static inline struct program *program_text(const char *text)
{
    struct modal_error err;
    struct program *p = NULL;
    cJSON *scene = scene_text(text);

    if (scene_lower(scene, NULL, &p, &err) != MODAL_OK)
        fail_msg("%s: %s: %s", text, err.field, err.message);
    cJSON_Delete(scene);
    return p;
}
#endif
