/* secrets.h - memory of CURVE's handshakes, in place of libsodium's: made once, and used again */
#ifndef BROKER_SECRETS_H
#define BROKER_SECRETS_H
#include <stddef.h>

/* SIZE bytes that are locked in memory; of a size as handshakes ask for they are zero.  NULL: there
 * are none (errno). */
void *sodium_malloc(size_t size);
/* They are cleared, and may be had again; accepts NULL. */
void sodium_free(void *secret);
#endif
