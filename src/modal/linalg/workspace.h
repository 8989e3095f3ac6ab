/* workspace.h - memory that is given back all at once, with one failure to ask after */
#ifndef MODAL_WORKSPACE_H
#define MODAL_WORKSPACE_H
#include <stdbool.h>
#include <stddef.h>
#include "base/error.h"

struct workspace {                /* zeros: nothing yet */
    void **held;
    size_t count, room;
    bool failed;                  /* once, and so for good */
};

/* COUNT zeros of SIZE bytes, W's; of none, a pointer all the same.  NULL where there is no memory:
 * W has failed. */
void *workspace_zeros(struct workspace *w, size_t count, size_t size);

/* The same, of any content: for what is filled at once. */
void *workspace_room(struct workspace *w, size_t count, size_t size);

/* M x N zeros that are numbers. */
double *workspace_numbers(struct workspace *w, size_t m, size_t n);

/* MODAL_OK, or MODAL_NO_MEMORY with TEXT where W has failed. */
enum modal_status workspace_check(const struct workspace *w, const char *text,
                                  struct modal_error *err);

/* Frees all of W, which may be used anew. */
void workspace_free(struct workspace *w);
#endif
