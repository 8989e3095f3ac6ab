/* polynomial_spring.c - the sum of coefficients[i] d^(i+1); a polynomial of degree 1 is a linear spring and becomes one */
#include <math.h>
#include <stdlib.h>
#include "modal/scene/effects/local_law.h"

static enum modal_status lower(struct lowering *l, const struct scene_effect *e, struct modal_error *err)
{
    struct local_ends at;
    struct law law;
    double *c = NULL;
    size_t count = 0;
    char where[128];
    enum modal_status rc = lowering_ends(l, e, &at, err);

    if (rc == MODAL_OK)
        rc = json_get_numbers(e->json, e->path, "coefficients", -HUGE_VAL, HUGE_VAL, &c, &count, err);
    json_path(where, e->path, "coefficients");
    if (rc == MODAL_OK && (count < 1 || count > LAW_TERMS_MOST))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, where, "%s must list 1 to %d numbers", where, LAW_TERMS_MOST);
    while (count > 1 && c[count - 1] == 0)
        count--;
    if (rc == MODAL_OK && count == 1)
        lowering_between(l, PROGRAM_K, at, c[0]);
    if (rc == MODAL_OK && count > 1)
        rc = local_law_add(l, e, law_polynomial_spring(c, (int)count, &law, err), at, &law, err);
    free(c);
    return rc;
}

static const char *const keys[] = { "dof", "to", "coefficients", NULL };
const struct scene_effect_kind effect_polynomial_spring = { "polynomial_spring", keys, NULL, lower };
