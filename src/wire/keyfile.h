/* keyfile.h - a client's or a worker's CURVE keys in a file of its own
 *
 * Lines `public-key = "Z85"`, `secret-key = "Z85"`, `server-key = "Z85"`; # begins a comment.  The
 * file must belong to the caller and be readable by nobody else (mode 0600 or less): a secret never
 * stands in arguments or environment.
 */
#ifndef WIRE_KEYFILE_H
#define WIRE_KEYFILE_H
#include "base/error.h"

/* Each in Z85, 0-terminated; "": not in the file. */
struct keyfile { char public[41], secret[41], server[41]; };

/* Read the file at PATH into *KEYS.  MODAL_BAD_INPUT, field "keyfile": absent, readable by others,
 * a line of another form, a key of other than 40 signs. */
enum modal_status keyfile_read(const char *path, struct keyfile *keys, struct modal_error *err);

/* Make a new pair and write it to PATH, which must not exist; SERVER may be NULL.  The public key
 * into PUBLIC[41]; it begins with no '-', for it is given as an argument. */
enum modal_status keyfile_make(const char *path, const char *server, char *public,
                               struct modal_error *err);

/* Overwrite the keys. */
void keyfile_wipe(struct keyfile *keys);

#endif
