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
    /*
     * NULL: the signals may stay in memory.  Else they are larger than the memory limit of who made
     * them and are read in order, sample by sample, and the BYTES at FROM, which this calls, are
     * not needed until the next pass: whoever mapped them gives their pages back.
     */
    void (*release)(const void *from, size_t bytes);
    /* The same of signals that may stay, but are mapped: what has been copied is given back.  NULL:
     * they cannot be. */
    void (*spare)(const void *from, size_t bytes);
};
#endif
