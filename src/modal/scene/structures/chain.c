/*
 * chain.c - masses in a row, springs and dampers between neighbours and to the ground at both ends
 *
 * Spring i of 0..n joins mass i-1 to mass i; masses -1 and n are the ground.  A spring or damper of 0 is none.
 * Keys: masses [kg] (n, > 0), springs [N/m] (n+1), dampers [N s/m] (n+1, default none).
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "modal/scene/lowering.h"

static enum modal_status add_masses(struct lowering *l, const double *m, size_t n, const char *path, struct modal_error *err)
{
    char where[128], name[32];

    for (size_t i = 0; i < n; i++) {
        if (m[i] <= 0) {
            snprintf(where, sizeof where, "%s.masses[%zu]", path, i);
            return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s is %g; a mass is > 0", where, m[i]);
        }
        snprintf(name, sizeof name, "x%zu", i + 1);
        lowering_add_dof(l, name);
        lowering_add(l, PROGRAM_M, (int)i, (int)i, m[i]);
    }
    return MODAL_OK;
}

/* n + 1 elements of KEY into MATRIX. */
static enum modal_status add_elements(struct lowering *l, int matrix, const char *key, size_t n, const cJSON *json,
                                      const char *path, struct modal_error *err)
{
    double *k = NULL;
    size_t count = 0;
    char where[128];
    enum modal_status rc = json_get_numbers(json, path, key, -HUGE_VAL, HUGE_VAL, &k, &count, err);

    if (rc == MODAL_OK && k != NULL && count != n + 1) {
        json_path(where, path, key);
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s has %zu numbers; %zu masses take %zu, ground to ground", where, count, n, n + 1);
    }
    for (size_t i = 0; rc == MODAL_OK && k != NULL && i <= n; i++)
        lowering_between(l, matrix, (struct local_ends) { i < n ? (int)i : -1, (int)i - 1 }, k[i]);
    free(k);
    return rc;
}

static enum modal_status need(const cJSON *json, const char *path, const char *key, struct modal_error *err)
{
    char where[128];

    if (cJSON_GetObjectItemCaseSensitive(json, key) != NULL)
        return MODAL_OK;
    json_path(where, path, key);
    return modal_fail_field(err, MODAL_BAD_INPUT, where, "%s is missing; accepted: a list of numbers", where);
}

static enum modal_status lower(struct lowering *l, const cJSON *json, const char *path, struct modal_error *err)
{
    double *m = NULL;
    size_t n = 0;
    enum modal_status rc = need(json, path, "masses", err);

    if (rc == MODAL_OK)
        rc = need(json, path, "springs", err);
    if (rc == MODAL_OK)
        rc = json_get_numbers(json, path, "masses", -HUGE_VAL, HUGE_VAL, &m, &n, err);
    if (rc == MODAL_OK && (n < 1 || n > LOWERING_DOFS_MOST))
        rc = modal_fail_field(err, n < 1 ? MODAL_BAD_INPUT : MODAL_TOO_LARGE, "structure.masses", "a chain has 1 to %d masses, not %zu",
                              LOWERING_DOFS_MOST, n);
    if (rc == MODAL_OK)
        rc = add_masses(l, m, n, path, err);
    if (rc == MODAL_OK)
        rc = add_elements(l, PROGRAM_K, "springs", n, json, path, err);
    if (rc == MODAL_OK)
        rc = add_elements(l, PROGRAM_C, "dampers", n, json, path, err);
    free(m);
    return rc;
}

static const char *const keys[] = { "masses", "springs", "dampers", NULL };
const struct scene_structure_kind structure_chain = { .name = "chain", .keys = keys, .lower = lower };
