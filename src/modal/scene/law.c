/* law.c - what all laws share; each kind is a file of laws/
 *
 * A law is its class, the places where it acts, and the numbers that the class lays out in `data`;
 * copying the struct moves it, law_done ends it.
 */
#include "modal/scene/law.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

void law_clear(struct law *law, const struct law_class *kind)
{
    memset(law, 0, sizeof *law);
    law->kind = kind;
    for (int i = 0; i < LAW_INPUTS_MOST; i++)
        law->dof[i] = law->to[i] = -1;
}

enum modal_status law_check(const char *what, double value, double low, struct modal_error *err)
{
    if (isfinite(value) && value >= low)
        return MODAL_OK;
    return modal_fail_field(err, MODAL_BAD_INPUT, what,
                            "%s is %g; accepted: finite and at least %g", what, value, low);
}

void law_done(struct law *law)
{
    if (law->kind != NULL && law->kind->free != NULL)
        law->kind->free(law);
    else
        free(law->data);
    memset(law, 0, sizeof *law);
}
