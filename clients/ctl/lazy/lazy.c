/* lazy.c - see lazy.h */
#include "ctl/lazy/lazy.h"
#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum { NOT_LOADABLE = 127 };            /* ld.so's status */

static void end_unless(bool found)
{
    if (found)
        return;
    fprintf(stderr, "%s: %s\n", program_invocation_short_name, dlerror());
    _exit(NOT_LOADABLE);
}

/* What comes after the program in the order of search, so that a preloaded library comes first
 * here too.  An object is the program's for the library as well; it begins as it does there. */
static void find(struct lazy_symbol *symbol)
{
    void *found = dlsym(RTLD_NEXT, symbol->name);

    end_unless(found != NULL);
    if (symbol->size > 0)
        memcpy(symbol->at, found, symbol->size);
    else
        __atomic_store_n(&symbol->at, found, __ATOMIC_RELEASE);
}

/* RTLD_LAZY, as libraries are that a program is linked with: what they call of each other is bound
 * when they do. */
static void load(struct lazy_library *library)
{
    for (const char *file = library->files; *file != '\0'; file += strlen(file) + 1)
        end_unless(dlopen(file, RTLD_LAZY | RTLD_GLOBAL) != NULL);
    for (struct lazy_symbol *symbol = library->first; symbol < library->end; symbol++)
        find(symbol);
    library->loaded = true;
}

void *lazy_load(const struct lazy_symbol *called)
{
    static pthread_mutex_t one_at_a_time = PTHREAD_MUTEX_INITIALIZER;

    pthread_mutex_lock(&one_at_a_time);
    if (!called->library->loaded)
        load(called->library);
    pthread_mutex_unlock(&one_at_a_time);
    return called->at;
}
