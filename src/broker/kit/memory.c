/* memory.c - allocation that ends the process when there is no more: a restart loses nothing, a
 * guess might */
#include "broker/kit/memory.h"
#include "base/canonical.h"
#include "base/json.h"
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void end_without_memory(void)
{
    fputs("level=crit event=no_memory\n", stderr);
    fflush(stderr);
    abort();
}

static void *checked(void *p)
{
    if (p == NULL)
        end_without_memory();
    return p;
}

static void *allocate_or_end(size_t size)
{
    return checked(malloc(size));
}

void grab_documents(void)
{
    json_memory_by(allocate_or_end);
}

/* calloc passes the thread's own cache by, which is where small blocks come from. */
void *grab(size_t size)
{
    enum { SMALL = 1024 };   /* blocks that glibc keeps for a thread, rounded down */

    if (size > SMALL)
        return checked(calloc(1, size));
    return memset(checked(malloc(size > 0 ? size : 1)), 0, size);
}

void *regrab(void *old, size_t size)
{
    return checked(realloc(old, size));
}

char *grab_text(const char *text)
{
    return text == NULL ? NULL : checked(strdup(text));
}

char *grab_format(const char *format, ...)
{
    char *text = NULL;
    va_list args;

    va_start(args, format);
    if (vasprintf(&text, format, args) < 0)
        text = NULL;
    va_end(args);
    return checked(text);
}

void text_clean(char *text, size_t size)
{
    for (size_t i = 0; i < size; i++)
        if ((unsigned char)text[i] >= 0x7f
            || ((unsigned char)text[i] < 0x20 && text[i] != '\n' && text[i] != '\t'))
            text[i] = '?';
}

char *grab_canonical(const cJSON *value)
{
    return checked(canonical_text(value));
}

/*
 * Blocks of what lives long and goes about in the order it came: a block is freed with the last of
 * it.  Among the short-lived each would hold a page.  `live` counts what is out, and one for the
 * open block; before each lies the address of its block.
 */
struct region { size_t live, used; };

enum {
    REGION_FIRST = 32,                    /* head and address, aligned to 16 */
    REGION_BYTES = 16384 - REGION_FIRST,  /* four pages with malloc's own words: some 50 jobs */
};

void region_close(struct region **open)
{
    if (*open != NULL && --(*open)->live == 0)
        free(*open);
    *open = NULL;
}

void *region_grab(struct region **open, size_t size)
{
    struct region *block = *open;
    size_t at = block == NULL ? 0 : (block->used + sizeof block + 15) / 16 * 16;
    char *out;

    if (block == NULL || at + size > REGION_BYTES) {
        region_close(open);
        block = *open = checked(
            malloc(REGION_FIRST + size > REGION_BYTES ? REGION_FIRST + size : REGION_BYTES));
        block->live = 1;
        at = REGION_FIRST;
    }
    block->live++;
    block->used = at + size;
    out = (char *)block + at;
    memcpy(out - sizeof block, &block, sizeof block);
    return memset(out, 0, size);
}

char *region_text(struct region **open, const char *text)
{
    return text == NULL ? NULL : strcpy(region_grab(open, strlen(text) + 1), text);
}

void region_drop(void *out)
{
    struct region *block;

    if (out == NULL)
        return;
    memcpy(&block, (char *)out - sizeof block, sizeof block);
    if (--block->live == 0)
        free(block);
}

/* Texts of one life, freed together: blocks of nearly 1 kB, larger texts in a block of
 * their own. */
enum { ARENA_ROOM = 960 };      /* with its head within what glibc keeps for a thread */
struct arena { struct arena *next; size_t used, room; char bytes[]; };

const char *arena_text(struct arena **arena, const char *text)
{
    size_t size;
    struct arena *block = *arena;
    char *out;

    if (text == NULL)
        return NULL;
    size = strlen(text) + 1;
    if (block == NULL || block->room - block->used < size) {
        size_t room = size > ARENA_ROOM ? size : ARENA_ROOM;
        block = checked(malloc(sizeof *block + room));
        *block = (struct arena) { .next = *arena, .room = room };
        *arena = block;
    }
    out = block->bytes + block->used;
    memcpy(out, text, size);
    block->used += size;
    return out;
}

void arena_free(struct arena *arena)
{
    while (arena != NULL) {
        struct arena *next = arena->next;
        free(arena);
        arena = next;
    }
}
