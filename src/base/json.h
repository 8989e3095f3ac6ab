/* json.h - strict JSON: reading that refuses what cJSON would let pass (json_read.c), checked
 * access (json_tree.c), exact printing (json_text.c) */
#ifndef BASE_JSON_H
#define BASE_JSON_H
#include <stdbool.h>
#include <stddef.h>
#include <cjson/cJSON.h>
#include "base/error.h"

enum {
    JSON_DEPTH_MOST  = 32,    /* more than any document of ours; reading and deleting recurse */
    JSON_NUMBER_MOST = 511,   /* characters; the largest double written out has 309 digits */
};

/*
 * Parse TEXT (LENGTH bytes, need not end in 0) into *OUT; the caller frees it with cJSON_Delete.
 * Refused with MODAL_BAD_INPUT, naming line and column: anything that is not one JSON value,
 * nesting past JSON_DEPTH_MOST, duplicate keys (err->field is the key's path), escapes in keys, NaN
 * and Infinity, numbers that overflow a double or have more than JSON_NUMBER_MOST characters, bytes
 * that are not UTF-8, half a surrogate pair, a zero byte or the escape of one.
 */
enum modal_status json_read(const char *text, size_t length, cJSON **out, struct modal_error *err);

/*
 * The same, the tree in memory of its own: for documents that come often and are only looked at.
 * Nothing of it may be changed or given to cJSON_Delete (cJSON_Duplicate copies it as any other);
 * json_pool_free, which accepts NULL, frees all of it.
 */
struct json_pool;
enum modal_status json_read_pooled(const char *text, size_t length, cJSON **out,
                                   struct json_pool **pool, struct modal_error *err);
void json_pool_free(struct json_pool *pool);

struct json_part { const char *text; size_t length; };
/* Where the members KEYS, COUNT of them, of the object TEXT, which json_read took, have their
 * values: each into FOUND, its text as it is.  NULL: it has no such member, or is no object. */
void json_find_texts(const char *text, size_t length, const char *const *keys, size_t count,
                     struct json_part *found);

/* Print without spaces, numbers with the fewest of 15, 16 or 17 digits that read back bit for bit;
 * non-finite numbers print as null, bytes that are not UTF-8 as U+FFFD.  The caller frees the text
 * with free(); NULL when memory runs out, or ran out for a part of it (json_put). */
char *json_print(const cJSON *value);

/*
 * A text written member by member, without a tree: for short documents of known members that are
 * written often.  Starts as zeros; at the end `x` is the text (the caller's to free), or `failed`
 * says that memory ran out.  Commas are put where they belong; a KEY is written as it is, so it
 * must need no escape.
 */
struct json_text { char *x; size_t length, room; bool failed; };

/* Begin an object, as the member KEY or, where that is NULL, as the document or an element; and
 * end it. */
void json_text_open(struct json_text *text, const char *key);
void json_text_close(struct json_text *text);

/* A member of the open object; of `key` the value follows by one of the calls below.  A string of
 * NULL is null. */
void json_text_key(struct json_text *text, const char *key);
void json_text_string(struct json_text *text, const char *key, const char *value);
void json_text_number(struct json_text *text, const char *key, double value);
void json_text_bool(struct json_text *text, const char *key, bool value);

/* Without a key: JSON as it is, also behind json_text_key; COUNT bytes of any text as they are; a
 * string in its quotes. */
void json_text_raw(struct json_text *text, const char *json);
void json_text_bytes(struct json_text *text, const char *bytes, size_t count);
void json_text_quoted(struct json_text *text, const char *value);

enum { JSON_PATH_SIZE = 128 };      /* bytes of a path, its end among them */
/* A path for error messages: "effects[2]" + "stiffness" -> "effects[2].stiffness"; "" + "a" ->
 * "a". */
void json_path(char out[JSON_PATH_SIZE], const char *base, const char *key);

/* The member KEY of OBJECT; NULL: there is none, or it is no object. */
const cJSON *json_member(const cJSON *object, const char *key);

/* Every key of OBJECT must be one of NAMES (NULL-terminated); else MODAL_BAD_INPUT names it and
 * lists them. */
enum modal_status json_keys(const cJSON *object, const char *base, const char *const *names,
                            struct modal_error *err);

/* Checked access: the member KEY of OBJECT into *OUT, which keeps its value (the default) where KEY
 * is absent.  A wrong type or a value outside [low, high] is MODAL_BAD_INPUT with the path, the
 * value and what is accepted. */
enum modal_status json_get_number(const cJSON *object, const char *base, const char *key,
                                  double low, double high, double *out, struct modal_error *err);
enum modal_status json_get_int(const cJSON *object, const char *base, const char *key, int low,
                               int high, int *out, struct modal_error *err);
enum modal_status json_get_bool(const cJSON *object, const char *base, const char *key, bool *out,
                                struct modal_error *err);
/* The string stays owned by OBJECT. */
enum modal_status json_get_string(const cJSON *object, const char *base, const char *key,
                                  const char **out, struct modal_error *err);
/* As above, but absence is an error too. */
enum modal_status json_need_number(const cJSON *object, const char *base, const char *key,
                                   double low, double high, double *out, struct modal_error *err);
enum modal_status json_need_string(const cJSON *object, const char *base, const char *key,
                                   const char **out, struct modal_error *err);
/* One of WORDS (NULL-terminated); its index into *OUT. */
enum modal_status json_get_choice(const cJSON *object, const char *base, const char *key,
                                  const char *const *words, int *out, struct modal_error *err);
/* A list of numbers; the caller frees *OUT.  Absent: *out NULL, *count 0. */
enum modal_status json_get_numbers(const cJSON *object, const char *base, const char *key,
                                   double low, double high, double **out, size_t *count,
                                   struct modal_error *err);

/* For a program, before its first document: parts of documents are blocks of ALLOCATE's, free's to
 * take back; where there is none for one it ends the program.  malloc's NULL cJSON takes for a part
 * to leave out: what is told is less, or another thing, without a word. */
void json_memory_by(void *(*allocate)(size_t size));

/* Members of what a library builds, which may not end its program: VALUE, or ITEM, which is taken
 * over (NULL: there was no memory for it), as KEY of OBJECT.  Where there is none for the member
 * OBJECT is spoiled, and json_print gives NULL for it and all that it is part of. */
void json_put_string(cJSON *object, const char *key, const char *value);
void json_put_number(cJSON *object, const char *key, double value);
void json_put(cJSON *object, const char *key, cJSON *item);

/* Building results, the caller's to delete: [re, im], and a list of COUNT numbers; one that is not
 * finite is null. */
cJSON *json_complex(double re, double im);
cJSON *json_numbers(const double *x, size_t count);

/* Add the member KEY to OBJECT: VALUE, or null where it is not finite. */
void json_set_number(cJSON *object, const char *key, double value);
#endif
