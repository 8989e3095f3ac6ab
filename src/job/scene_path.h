/* scene_path.h - a place in a scene by its path, such as "effects[0].stiffness" or
 * "structure.K[1][0]" */
#ifndef JOB_SCENE_PATH_H
#define JOB_SCENE_PATH_H
#include "base/error.h"
#include "base/json.h"

/* Put VALUE at PATH in SCENE: the place must hold a number, or be a missing key of an object
 * that is there.  Fails with MODAL_BAD_INPUT, FIELD named, where it does not. */
enum modal_status scene_path_set(cJSON *scene, const char *path, double value, const char *field,
                                 struct modal_error *err);
#endif
