/* apart.h - reading a foreign file in a process of its own, whose end is not ours
 *
 * A library of some 300,000 lines reads HDF5, and a damaged file ends the process it is in, or
 * keeps it for ever, in more ways than can be checked from outside.  So a child reads it, under
 * limits of memory and processor time, and what it found comes back by a pipe.
 */
#ifndef CTL_APART_H
#define CTL_APART_H
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include "base/error.h"

struct apart {
    /* in the child: read, with apart_allow() ahead of what takes long */
    enum modal_status (*work)(void *context, struct modal_error *err);
    /* in the child: what was found; it is the parent's twin, in which texts of the program lie at
     * the same place.  False: it cannot be told. */
    bool (*tell)(void *context, FILE *to);
    /* in the parent: the same, in the same order.  False: there is less, or no memory. */
    bool (*hear)(void *context, FILE *from);
};

/*
 * Do HOW->work for PATH in a child, with CONTEXT.  Fails as it does; with MODAL_BAD_INPUT, field
 * FIELD, where the library broke down or met the limit of time; MODAL_NO_MEMORY, of the child or
 * where HOW->hear failed with more to be heard; MODAL_IO where no child was to be had, or somebody
 * ended it.
 */
enum modal_status apart_do(const struct apart *how, void *context, const char *path,
                           const char *field, struct modal_error *err);

/* The child may take BYTES more than it holds, to read or make as many: memory, and time; and time
 * for PIECES that they lie in. */
void apart_allow(double bytes, double pieces);

/* A text, or NULL, to the other end; the caller frees *TEXT.  False: it did not get there, or there
 * is no memory. */
bool apart_tell_text(const char *text, FILE *to);
bool apart_hear_text(char **text, FILE *from);
#endif
