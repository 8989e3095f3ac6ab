/*
 * workspace.c - see workspace.h
 *
 * Each piece is the allocator's own, so that it lies as aligned as any other and a tool that
 * watches memory sees its ends.
 */
#include "modal/linalg/workspace.h"
#include <stdlib.h>

enum { ROOM_FIRST = 16 };         /* pieces: most owners have fewer, and the list never grows */

void *workspace_zeros(struct workspace *w, size_t count, size_t size)
{
    if (w->count == w->room) {
        size_t room = w->room > 0 ? 2 * w->room : ROOM_FIRST;
        void **held = realloc(w->held, room * sizeof *held);

        if (held == NULL) {
            w->failed = true;
            return NULL;
        }
        w->held = held;
        w->room = room;
    }
    void *x = calloc(count + 1, size);    /* one more: calloc(0) may be NULL */

    w->failed |= x == NULL;
    return w->held[w->count++] = x;
}

enum modal_status workspace_check(const struct workspace *w, const char *text,
                                  struct modal_error *err)
{
    return w->failed ? modal_fail(err, MODAL_NO_MEMORY, "%s", text) : MODAL_OK;
}

void workspace_free(struct workspace *w)
{
    for (size_t i = 0; i < w->count; i++)
        free(w->held[i]);
    free(w->held);
    *w = (struct workspace) { 0 };
}
