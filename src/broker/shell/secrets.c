/*
 * secrets.c - see secrets.h: sodium_malloc and sodium_free as libzmq calls them
 *
 * What a CURVE handshake seals or opens libzmq has in memory from sodium_malloc, six times a
 * handshake: mapped, locked, set between guard pages, and all of it undone a moment later by system
 * calls.  They were a third of what a handshake takes of the one thread that reads for all, for
 * whom those wait who are served while others come and go.  Here SLOTS such places are kept, each
 * one of sodium_malloc's: locked, out of core dumps, its end at a guard page, as before.  A secret
 * lies at its slot's end, so that what is written beyond it still ends the process; it is cleared
 * when it is given back.
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
    SLOTS = 4,                   /* an I/O thread has two at once */
};

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static struct slot {
    unsigned char *at;           /* of libsodium; NULL: not asked for yet */
    bool used;
} slots[SLOTS];

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

/* SIZE bytes at the end of a slot that nobody has; NULL: there is none. */
static void *take_slot(size_t size)
{
    for (int i = 0; i < SLOTS; i++)
        if (!slots[i].used) {
            if (slots[i].at == NULL && (slots[i].at = own_malloc(SLOT)) != NULL)
                memset(slots[i].at, 0, SLOT);
            slots[i].used = slots[i].at != NULL;
            return slots[i].used ? slots[i].at + SLOT - size : NULL;
        }
    return NULL;
}

void *sodium_malloc(size_t size)
{
    void *secret;

    pthread_mutex_lock(&lock);
    secret = size <= SLOT ? take_slot(size) : NULL;
    if (secret == NULL)
        secret = own_malloc(size);
    pthread_mutex_unlock(&lock);
    return secret;
}

/* Whether SECRET was in a slot, which is nobody's any more. */
static bool give_slot(const unsigned char *secret)
{
    for (int i = 0; i < SLOTS; i++)
        if (slots[i].used && secret >= slots[i].at && secret <= slots[i].at + SLOT) {
            explicit_bzero(slots[i].at, SLOT);
            slots[i].used = false;
            return true;
        }
    return false;
}

void sodium_free(void *secret)
{
    pthread_mutex_lock(&lock);
    if (!give_slot(secret))
        own_free(secret);
    pthread_mutex_unlock(&lock);
}
