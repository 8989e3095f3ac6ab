/* words.h - what this process says on stderr, kept as its last words for a daemon on another host
 *
 * On the daemon's own host stderr is a pipe of the daemon's.  Here it becomes a pipe to the link's
 * thread, which writes all of it on to where stderr went before and keeps the end of it.  A signal
 * that ends the process (SIGSEGV, SIGABRT, ...) waits until those words were sent, for a second at
 * most.
 */
#ifndef WORKER_WORDS_H
#define WORKER_WORDS_H
#include <stdbool.h>
#include <stddef.h>
#include "base/error.h"
#include "wire/protocol.h"

struct words {
    int pipe, was;                  /* the end that is read; where stderr went before.  -1: none */
    bool fresh;                     /* something came since words_sent() */
    size_t length;
    char text[WIRE_STDERR_MOST];    /* the last of them */
};

/* Nothing is kept: stderr is what it was. */
void words_init(struct words *words);
/* From here on stderr is kept.  Nothing happens under a sanitizer, whose report ends the process by
 * calls of its own. */
enum modal_status words_open(struct words *words, struct modal_error *err);
/* Take in what was said.  By the link's thread. */
void words_read(struct words *words);
/* Is the process about to end of a signal? */
bool words_last(void);
/* They are on their way. */
void words_sent(struct words *words);
/* stderr is what it was before words_open(). */
void words_close(struct words *words);
#endif
