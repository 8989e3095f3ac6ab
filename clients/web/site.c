/* site.c - see site.h */
#include "site.h"
#include <string.h>

bool site_acts(const struct site *site)
{
    const char *role = site->service.role;

    return site->actions && (strcmp(role, "submit") == 0 || strcmp(role, "admin") == 0);
}
