/* error.h - errors are values: one status enum, one text, one table to codes and exit statuses */
#ifndef BASE_ERROR_H
#define BASE_ERROR_H

enum modal_status {
    MODAL_OK = 0,
    MODAL_BAD_INPUT,       /* the caller's input; err->field names it */
    MODAL_TOO_LARGE,       /* a limit of ours; the text names limit and value */
    MODAL_NO_MEMORY,
    MODAL_NO_CONVERGENCE,  /* an iteration of LAPACK or ours that should not fail, did */
    MODAL_ELEMENT_FAILED,  /* a user's own force (Lua) failed; the text names the line */
    MODAL_OVERFLOW,        /* the motion left the range of doubles; the text says when */
    MODAL_CANCELLED,       /* the caller's `cancelled` callback said so */
    MODAL_RUN_LIMIT,       /* the attempt ran past its run limit */
    MODAL_DEADLINE,        /* the job's deadline passed */
    MODAL_IO,              /* a read, write or sync failed */
    MODAL_STORAGE_FULL,
    MODAL_CORRUPT,         /* a checksum or structure on disk is wrong */
    MODAL_BUSY,            /* try again after detail.retry_after_s */
    MODAL_QUOTA,
    MODAL_CONFLICT,        /* the same key with other content */
    MODAL_EXPIRED,         /* the key's result is past its retention */
    MODAL_NOT_FOUND,
    MODAL_DENIED,
    MODAL_BAD_FRAME,       /* malformed message */
    MODAL_BAD_VERSION,
    MODAL_UNKNOWN_VERB,
    MODAL_NO_SERVER,
    MODAL_TIMEOUT,
    MODAL_WORKER_DIED,
    MODAL_DRAINING,
    MODAL_INTERNAL,        /* a bug of ours */
    MODAL_STATUS_COUNT
};

struct modal_error {
    enum modal_status status;
    char field[128];       /* option, dataset, attribute or scene path at fault; "" if none */
    char message[512];     /* what was wrong, where, what would be accepted */
};

/* Fill ERR (may be NULL) and return STATUS, so that failing is one statement. */
enum modal_status modal_fail(struct modal_error *err, enum modal_status status, const char *format,
                             ...) __attribute__((format(printf, 3, 4)));

/* The same, naming the FIELD at fault: an option, an attribute, or a path such as
 * `effects[2].stiffness`. */
enum modal_status modal_fail_field(struct modal_error *err, enum modal_status status,
                                   const char *field, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* The stable code of a status on the wire, such as "bad_input", and back (MODAL_INTERNAL if
 * unknown). */
const char *modal_status_code(enum modal_status status);
enum modal_status modal_status_from_code(const char *code);

/* The exit status of contracts.md that a program ends with: 0 .. 5. */
int modal_status_exit(enum modal_status status);

#endif
