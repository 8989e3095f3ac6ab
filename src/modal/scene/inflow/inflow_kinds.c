/* inflow_kinds.c - the table of inflow models: one line each
 *
 * A new model is a file with its row, named here and declared in inflow.h.
 */
#include "modal/scene/inflow/inflow.h"
#include <stddef.h>

const char *const inflow_names[] = { "none", "peters_2d", "jones", "peters_he", NULL };
const struct inflow_kind *const inflow_kinds[] = { &inflow_none, &inflow_peters_2d, &inflow_jones,
                                                   &inflow_peters_he, NULL };
