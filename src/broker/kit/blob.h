/* blob.h - bytes that pass from owner to owner without being copied: a received frame, a result's text */
#ifndef BROKER_BLOB_H
#define BROKER_BLOB_H
#include <stddef.h>

struct blob {
    const void *data;
    size_t size;
    int uses;                            /* owners, counted atomically: threads hand blobs to each other */
    void (*release)(struct blob *);      /* at the last blob_drop; frees the blob too */
};

/* A blob that owns DATA, which came from malloc; NULL (and DATA freed) when memory runs out. */
struct blob *blob_take(void *data, size_t size);
/* A blob with a copy of DATA. */
struct blob *blob_copy(const void *data, size_t size);
struct blob *blob_share(struct blob *blob);   /* one owner more; NULL stays NULL */
void blob_drop(struct blob *blob);            /* accepts NULL */
#endif
