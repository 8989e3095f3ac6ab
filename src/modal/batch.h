/* batch.h - signals sampled at equal steps: what identify reads and simulate writes */
#ifndef MODAL_BATCH_H
#define MODAL_BATCH_H
#include <stddef.h>

/*
 * Samples are rows, channels are columns, as in the file: entry (k, s), sample k of channel s,
 * is signals[k * channels + s].  Everything a batch points to is borrowed: who made it frees it.
 */
struct batch {
    size_t samples, channels;
    const double *signals;
    double dt;                  /* s, > 0 */
    double period;              /* s; 0: not a periodic system */
    const char *const *names;   /* `channels` names, or NULL: "ch0", "ch1", ... */
    const char *units;          /* text, or NULL */
};
#endif
