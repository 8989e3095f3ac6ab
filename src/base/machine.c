/* machine.c - see machine.h */
#include "base/machine.h"
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define GROUPS "/sys/fs/cgroup"
enum { PATH_MOST = 4096 };   /* PATH_MAX of Linux */

/* The path below GROUPS of the group that this process is in, of version 2; false: none. */
static bool own_group(char path[PATH_MOST])
{
    FILE *file = fopen("/proc/self/cgroup", "r");
    char line[PATH_MOST];
    bool found = false;

    while (file != NULL && !found && fgets(line, sizeof line, file) != NULL)
        if (strncmp(line, "0::/", 4) == 0) {
            line[strcspn(line, "\n")] = 0;
            snprintf(path, PATH_MOST, "%s", line + 3);
            found = true;
        }
    if (file != NULL)
        fclose(file);
    return found;
}

/* memory.max of the group at PATH; INT64_MAX: none. */
static int64_t limit_of(const char *path)
{
    char name[PATH_MOST + 64], text[32];
    int64_t limit = INT64_MAX;
    FILE *file;

    snprintf(name, sizeof name, GROUPS "%s/memory.max", path);
    file = fopen(name, "r");
    if (file == NULL)
        return limit;
    if (fgets(text, sizeof text, file) != NULL && strncmp(text, "max", 3) != 0)
        limit = strtoll(text, NULL, 10);
    fclose(file);
    return limit;
}

int64_t machine_memory(void)
{
    int64_t most = (int64_t)sysconf(_SC_PHYS_PAGES) * sysconf(_SC_PAGESIZE);
    char path[PATH_MOST];
    char *slash;

    if (!own_group(path))
        return most;
    do {
        int64_t limit = limit_of(path);
        most = limit < most ? limit : most;
        slash = strrchr(path, '/');
        if (slash != NULL)
            *slash = 0;
    } while (slash != NULL);
    return most;
}

int64_t machine_worker_memory(int64_t memory, int workers)
{
    int64_t share = memory / (workers + 1);

    return share > WORKER_MEMORY_LEAST ? share : WORKER_MEMORY_LEAST;
}
