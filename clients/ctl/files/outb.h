/* outb.h - OpenFAST's binary output (.outb): channels of 16 bits with a scale each, or doubles */
#ifndef CTL_FILES_OUTB_H
#define CTL_FILES_OUTB_H
#include "bytes.h"
#include "ctl/signals.h"

/* By its form, 1 to 4 in 16 bits. */
bool outb_is(const unsigned char *head, size_t length);
/* FILE into *OUT (signals_done frees it).  MODAL_BAD_INPUT, field "file": its length is not that of
 * the channels and samples that it announces, an absurd scale or step. */
enum modal_status outb_read(struct bytes file, const char *path,
                            const struct signals_options *options, struct signals *out,
                            struct modal_error *err);
#endif
