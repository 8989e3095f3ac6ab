/* blob.h - bytes that pass from owner to owner without being copied: a received frame, a
 * result's text */
#ifndef BROKER_BLOB_H
#define BROKER_BLOB_H
#include <stddef.h>

struct blob {
    const void *data;
    size_t size;
    /* owners, counted atomically: threads hand blobs to each other */
    int uses;
    void (*release)(struct blob *);      /* at the last blob_drop; frees the blob too */
};

/* A blob that owns DATA, which came from malloc; NULL (and DATA freed) when memory runs out. */
struct blob *blob_take(void *data, size_t size);
/* A blob with a copy of DATA; NULL when memory runs out. */
struct blob *blob_copy(const void *data, size_t size);
/* One owner more; NULL stays NULL. */
struct blob *blob_share(struct blob *blob);
/* One owner less, the last frees it; accepts NULL. */
void blob_drop(struct blob *blob);
#endif
