/* h5_numbers.h - the numbers of one dataset of a foreign HDF5 file: what it says of them, judged
 * before anything is allocated; and they themselves */
#ifndef STORE_H5_NUMBERS_H
#define STORE_H5_NUMBERS_H
#include <hdf5.h>
#include "base/error.h"

struct h5_numbers {
    hid_t set;             /* borrowed */
    const char *name;      /* its, for messages */
    const char *field;     /* at fault where it is: that of the error */
    double most;           /* bytes that they may take as doubles */
    int rank;              /* 0 to 2 dimensions */
    hsize_t dims[2];       /* 1 where there is none */
    size_t piece;          /* bytes that are unpacked at once: of a chunk; 0: there are none */
    double pieces;         /* chunks */
};

/*
 * Look at OUT->set, whose `name`, `field` and `most` the caller has set, for the rest of OUT.
 * MODAL_TOO_LARGE; MODAL_BAD_INPUT where it holds no numbers, or more than two dimensions of them;
 * where they are in other files, which may be anybody's, or were never written; where a filter
 * packs them that is not built in.
 */
enum modal_status h5_numbers_look(struct h5_numbers *out, struct modal_error *err);

/* All of them, in the order of the file, into TO; beside them it holds a few chunks, however many
 * there are.  MODAL_BAD_INPUT: damaged; MODAL_NO_MEMORY. */
enum modal_status h5_numbers_read(const struct h5_numbers *of, double *to,
                                  struct modal_error *err);
#endif
