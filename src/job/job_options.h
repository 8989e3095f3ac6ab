/* job_options.h - every option of every kind: what help, manuals and tests walk */
#ifndef JOB_JOB_OPTIONS_H
#define JOB_JOB_OPTIONS_H
#include "base/key_table.h"

/* Which table belongs to which kind; a kind may have several. */
struct job_option_table {
    const char *kind;             /* a name of job_kinds, or "stream"; NULL: the end */
    const char *of;               /* of a tradeoff: what of; else NULL */
    const struct key_row *rows;   /* NULL: those of `as` alone */
    const char *as;               /* the kind whose options are taken too; NULL: none */
    const char *when;             /* what for, or when */
};
extern const struct job_option_table job_option_tables[];

/* What a sweep's document holds, and an axis of its grid: no options, but keys that a user
 * writes. */
extern const struct job_option_table job_document_tables[];
#endif
