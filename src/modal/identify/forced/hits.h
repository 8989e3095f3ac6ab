/* hits.h - inputs of hits so short that samples do not tell how hard and when they were */
#ifndef MODAL_HITS_H
#define MODAL_HITS_H
#include "modal/identify/forced/clipping.h"
#include "modal/identify/forced/transfer.h"

struct hits {
    int input;                   /* -1: none, or the responses agree with its samples */
    int count, longest;          /* hits; samples of the longest */
    bool in_colour;              /* it is the hits, of whatever colour the noise is */
};

/*
 * Do the responses of RECORD tell hits of an input other than its samples do?  By LINES of it and
 * T, as transfer_fit left it; see hits.c.  What T leaves is taken for white: where it is not, more
 * than hits may look so, but where `in_colour` is true.  Inputs are asked in their order until one
 * is told; not asked, so that nothing is said of it, is one of more than 16 hits, of one longer
 * than 9 samples, or whose hits take more than a tenth of the record.  Memory is 8 bytes a sample.
 * Fails with MODAL_NO_MEMORY.
 */
enum modal_status hits_find(const struct clipping_record *record, const struct lines *lines,
                            struct transfer *t, struct hits *out, struct modal_error *err);
#endif
