/* fuzz_scene.c - any text is refused by name, or is a scene that lowers, and then steps and has
 * exponents without a bad number; what stands behind a zero byte are its matrices
 *
 * What lowers is small here: scenes of many dofs or samples are left at lowering, so that the
 * fuzzer stays quick.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include "base/json.h"
#include "modal/scene/floquet.h"
#include "modal/scene/scene.h"
#include "modal/scene/scene_arrays.h"
#include "modal/scene/simulate.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void step(const cJSON *scene, struct program *p)
{
    struct scene_time t = { .dt = 0.1, .samples = 4, .duration = 0.3 };
    struct simulate_result s;
    double *x = malloc(((size_t)t.samples * (size_t)p->outputs + 1) * sizeof *x);

    (void)scene;
    if (x != NULL && simulate(p, &t, NULL, x, &s, NULL) == MODAL_OK)
        for (int i = 0; i < (int)t.samples * p->outputs; i++)
            if (isnan(x[i]))
                abort();
    free(x);
}

static void solve(const struct program *p)
{
    struct floquet f;

    if (floquet(p, &(struct floquet_options) { .tolerance = 1e-6 }, &f, NULL) != MODAL_OK)
        return;
    for (int i = 0; i < f.count; i++)
        if (f.resolved[i] && isnan(creal(f.exponent[i])))
            abort();
    floquet_done(&f);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct modal_error err = { 0 };
    struct program *p = NULL;
    struct scene_time t;
    cJSON *scene = NULL;
    struct scene_arrays arrays;
    struct scene_options options = { .arrays = &arrays };
    size_t length = scene_arrays_split(data, size, &arrays);

    if (json_read((const char *)data, length, &scene, &err) != MODAL_OK)
        return 0;
    if (scene_lower(scene, &options, &p, &err) == MODAL_OK) {
        (void)scene_time(scene, p, &t, &err);
        if (p->n <= 12 && p->n_linear <= 12 && p->effects <= 8 && p->loads <= 8) {
            step(scene, p);
            solve(p);
        }
    } else if (err.status == MODAL_BAD_INPUT && err.field[0] == '\0' && cJSON_IsObject(scene)) {
        abort();                                  /* bad input always has a place */
    }
    program_free(p);
    cJSON_Delete(scene);
    return 0;
}
