/*
 * key_table.h - the members that an object may have, a row each
 *
 * What a key is called, what it accepts, what holds without it and what it means stands in one row,
 * which its parser, the parser's messages, the help and the manuals all read.  A new key is a new
 * row.
 */
#ifndef BASE_KEY_TABLE_H
#define BASE_KEY_TABLE_H
#include <stddef.h>
#include "base/error.h"
#include "base/json.h"

/* What a key is in JSON, and in its owner's struct. */
enum key_type {
    KEY_NUMBER,         /* double */
    KEY_WHOLE,          /* int */
    KEY_TRUTH,          /* bool */
    KEY_CHOICE,         /* int, or an enum of its size: which of `words` */
    KEY_TEXT,           /* const char *, the object's own */
    KEY_INTERVAL,       /* double[2], the first below the second; or {-1, 0} for the first of
                           `words`, {-2, 0} for the next */
    KEY_OWN             /* its owner reads and writes it */
};

/* How its value stands among the options that a result says it used. */
enum key_shown { KEY_SHOWN, KEY_SHOWN_IF_SET, KEY_SHOWN_OR_NULL, KEY_SILENT };

struct key_row {
    const char *name;             /* "rank.fixed"; NULL: the end of the table */
    enum key_type type;
    enum key_shown shown;         /* set: other than 0 or NULL */
    size_t at;                    /* in the owner's struct; not of KEY_OWN */
    double low, high;             /* what numbers are accepted, ends included */
    const char *const *words;     /* what words are, NULL-terminated; of an interval NULL: none */
    const char *initial;          /* what holds without it, as JSON but words bare; NULL: what
                                     `meaning` says */
    const char *unit;             /* NULL: none */
    const char *form;             /* its value on a command line: "T0,T1"; NULL: the type's */
    const char *meaning;          /* a line */
    const char *example;          /* its value on a command line, accepted by the row */
};

/* Every member of OBJECT must be a row of ROWS or MORE (NULL: none); else MODAL_BAD_INPUT as
 * json_keys. */
enum modal_status key_table_check(const struct key_row *rows, const struct key_row *more,
                                  const cJSON *object, const char *base, struct modal_error *err);

/* What holds without them, where the rows say so, into the struct INTO; the rest of it stays. */
void key_table_defaults(const struct key_row *rows, void *into);

/*
 * The members of OBJECT (NULL: none) that ROWS name, but KEY_OWN, into INTO; of what OBJECT lacks
 * INTO keeps its value.  Text stays OBJECT's.  MODAL_BAD_INPUT, field the path from BASE: a wrong
 * type or a value out of range, told with an example.
 */
enum modal_status key_table_read(const struct key_row *rows, const cJSON *object, const char *base,
                                 void *into, struct modal_error *err);

/* All three of a job's OPTIONS (NULL: none): no other keys, the defaults, what was given. */
enum modal_status key_table_options(const struct key_row *rows, const cJSON *options, void *into,
                                    struct modal_error *err);

/* The values in FROM as members of OUT, in the rows' order, as their `shown` says; what its owner
 * wrote of KEY_OWN before goes to its place among them. */
void key_table_write(const struct key_row *rows, const void *from, cJSON *out);

/* "KEY=FORM" of a row, and "meaning, unit (range; default)", for the help. */
void key_row_form(const struct key_row *row, char *out, size_t room);
void key_row_text(const struct key_row *row, char *out, size_t room);
#endif
