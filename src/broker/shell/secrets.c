/*
 * secrets.c - see secrets.h: sodium_malloc and sodium_free as libzmq calls them
 *
 * What a CURVE handshake seals or opens libzmq has in memory from sodium_malloc, six times a
 * handshake: mapped, locked, set between guard pages, and all of it undone a moment later by system
 * calls.  They were a third of what a handshake takes of the one thread that reads for all, for
 * whom those wait who are served while others come and go.  Here SLOTS such places are one piece of
 * sodium_malloc's, which stays: locked, out of core dumps, between guard pages as before, though
 * there is none between one secret and another.  Each is cleared when it is given back.
 *
 * What is larger, or more at once, has its own as before.
 */
#include "broker/shell/secrets.h"
#include <assert.h>
#include <dlfcn.h>
#include <pthread.h>
#include <stdbool.h>
#include <string.h>

enum {
    /* INITIATE's is the largest: 160 bytes of padding, key and voucher before the client's
     * properties, which take some 70 */
    SLOT = 512,
    SLOTS = 8,                   /* a page; an I/O thread has two at once */
};

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static unsigned char *slots;     /* of libsodium; NULL: none were asked for yet */
static bool used[SLOTS];

static void *own_malloc(size_t size)
{
    static void *(*sodium)(size_t size);

    if (sodium == NULL)
        *(void **)&sodium = dlsym(RTLD_NEXT, "sodium_malloc");
    assert(sodium != NULL);
    return sodium(size);
}

static void own_free(void *secret)
{
    static void (*sodium)(void *secret);

    if (sodium == NULL)
        *(void **)&sodium = dlsym(RTLD_NEXT, "sodium_free");
    assert(sodium != NULL);
    sodium(secret);
}

/* A slot that nobody has; NULL: there is none. */
static void *take_slot(void)
{
    if (slots == NULL) {
        slots = own_malloc(SLOTS * SLOT);
        if (slots == NULL)
            return NULL;
        memset(slots, 0, SLOTS * SLOT);
    }
    for (int i = 0; i < SLOTS; i++)
        if (!used[i]) {
            used[i] = true;
            return slots + (size_t)i * SLOT;
        }
    return NULL;
}

void *sodium_malloc(size_t size)
{
    void *secret;

    pthread_mutex_lock(&lock);
    secret = size <= SLOT ? take_slot() : NULL;
    if (secret == NULL)
        secret = own_malloc(size);
    pthread_mutex_unlock(&lock);
    return secret;
}

/* Whether SECRET was a slot, which it is no more. */
static bool give_slot(unsigned char *secret)
{
    if (slots == NULL || secret < slots || secret >= slots + SLOTS * SLOT)
        return false;
    explicit_bzero(secret, SLOT);
    used[(secret - slots) / SLOT] = false;
    return true;
}

void sodium_free(void *secret)
{
    pthread_mutex_lock(&lock);
    if (!give_slot(secret))
        own_free(secret);
    pthread_mutex_unlock(&lock);
}
