/* blob.c - see blob.h */
#include "broker/kit/blob.h"
#include <stdlib.h>
#include <string.h>

static void release(struct blob *blob)
{
    free((void *)blob->data);
    free(blob);
}

struct blob *blob_take(void *data, size_t size)
{
    struct blob *blob = data == NULL ? NULL : malloc(sizeof *blob);

    if (blob == NULL) {
        free(data);
        return NULL;
    }
    *blob = (struct blob) { data, size, 1, release };
    return blob;
}

struct blob *blob_copy(const void *data, size_t size)
{
    void *copy = malloc(size + 1);

    if (copy != NULL && size > 0)
        memcpy(copy, data, size);
    return blob_take(copy, size);
}

struct blob *blob_share(struct blob *blob)
{
    if (blob != NULL)
        __atomic_add_fetch(&blob->uses, 1, __ATOMIC_RELAXED);
    return blob;
}

void blob_drop(struct blob *blob)
{
    if (blob != NULL && __atomic_sub_fetch(&blob->uses, 1, __ATOMIC_ACQ_REL) == 0)
        blob->release(blob);
}
