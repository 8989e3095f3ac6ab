/* zap.h - who may connect: the ZAP handler (ZeroMQ RFC 27), CURVE keys against the accounts */
#ifndef BROKER_ZAP_H
#define BROKER_ZAP_H
#include <stdbool.h>
#include <stddef.h>
#include "broker/core/core.h"

/* A bound handler socket of CONTEXT, before any socket with keys is bound; NULL on failure. */
void *zap_open(void *context);
/* Who was not admitted: how many, and the last one's key and address. */
struct zap_refused { int64_t count; char key[41], address[64]; };

/* The ZAP domains of the sockets with keys. */
#define ZAP_CLIENTS "modald"
#define ZAP_WORKERS "modald-workers"

/* Answer what waits.  A key of ACCOUNTS is admitted, where workers connect one of role worker alone
 * and elsewhere any other; its Z85 text becomes the User-Id of every message.  Others are added to
 * REFUSED. */
void zap_answer(void *socket, const struct account *accounts, size_t count,
                struct zap_refused *refused);
#endif
