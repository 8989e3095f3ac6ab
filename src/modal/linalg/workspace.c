/*
 * workspace.c - see workspace.h
 *
 * Each piece is the allocator's own, so that it lies as aligned as any other and a tool that
 * watches memory sees its ends.
 */
#include "modal/linalg/workspace.h"
#include <stdlib.h>

enum { ROOM_FIRST = 16 };         /* pieces: most owners have fewer, and the list never grows */

static void *keep(struct workspace *w, size_t count, size_t size, bool zeros)
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
    /* one more: calloc(0) may be NULL */
    void *x = zeros ? calloc(count + 1, size) : reallocarray(NULL, count + 1, size);

    w->failed |= x == NULL;
    return w->held[w->count++] = x;
}

void *workspace_zeros(struct workspace *w, size_t count, size_t size)
{
    return keep(w, count, size, true);
}

void *workspace_room(struct workspace *w, size_t count, size_t size)
{
    return keep(w, count, size, false);
}

double *workspace_numbers(struct workspace *w, size_t m, size_t n)
{
    return workspace_zeros(w, m * n, sizeof(double));
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
