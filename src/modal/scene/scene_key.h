/* scene_key.h - the keys that a part of a scene accepts: a row each, by which it is read, told and
 * tested
 *
 * A structure, an effect, an excitation and a sensor each have such tables, and so have the scene
 * itself, its `initial`, its `time`.  A new key is a row here and a member of the struct that the
 * rows are read into; what a message says of a key, and what a manual or a schema will, comes from
 * its row.
 */
#ifndef MODAL_SCENE_KEY_H
#define MODAL_SCENE_KEY_H
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include "base/error.h"
#include "base/json.h"
#include "modal/scene/law.h"

/* Ends of ranges, besides 0 and +-HUGE_VAL (any double: JSON has neither NaN nor infinity here). */
/* the least that counts as > 0: its reciprocal is a double too */
#define SCENE_POSITIVE 1e-300
#define SCENE_LARGE 1e300          /* of what is summed: 1e8 of the largest are still a double */

enum scene_key_type {              /* and what the member is that such a key is read into */
    SCENE_NUMBER,                  /* double */
    SCENE_WHOLE,                   /* int */
    SCENE_TRUTH,                   /* bool; absent: false */
    SCENE_WORD,                    /* int: which of `words`; absent: `standard` */
    SCENE_TEXT,                    /* const char *, the scene's; absent: NULL */
    SCENE_NUMBERS,                 /* struct scene_numbers */
    SCENE_DOF,                     /* int: a dof of the structure; "ground" or absent: -1 */
    SCENE_ENDS,                    /* struct scene_ends: weights by dof name */
    SCENE_PLACE,                   /* struct scene_ends: a dof's name, or weights by such */
    /* const cJSON *: a list of `low` to `high` objects of `members`, which its owner reads */
    SCENE_LIST,
    /* const cJSON *: a form of its own, read by its owner; absent: NULL */
    SCENE_OWN,
};

/* absent: NULL and 0; scene_keys_free frees */
struct scene_numbers { double *x; size_t count; };
struct scene_ends { struct law_end *x; int count; };

/* `at` of a key that whoever asks for the table has read before, such as "type". */
enum { SCENE_ELSEWHERE = -1 };

struct scene_key {
    const char *name;  /* NULL: the end of the table */
    enum scene_key_type type;  /* how it is read */
    int at;                        /* offset of the member it is read into, or SCENE_ELSEWHERE */
    const char *unit;              /* of numbers, SI; "": a pure number */
    /* numbers, whole numbers, elements of lists; how many of SCENE_LIST: both ends accepted */
    double low, high;
    bool needed;  /* absent: MODAL_BAD_INPUT */
    const char *unless;            /* needed only where this key is absent; NULL: always */
    const char *with;              /* needed where this key stands */
    double standard;               /* what an absent number, whole number or word is */
    const char *otherwise;         /* the default in words where `standard` is not it */
    const char *const *words;      /* NULL-terminated */
    const struct scene_key *members;   /* of an object, of each of a list: its own rows */
    const char *means;             /* what it is in the law, with its sign; one line */
    const char *example;           /* a value, as JSON */
};

enum { SCENE_TABLES_MOST = 4 };    /* of rows that one part has, a NULL at the end included */

/* One part that a scene may have, as scene_tables (scene.h) walks them. */
struct scene_table {
    /* where: "structure", "effects", "excitation", "sensors", "time", .. */
    const char *list;
    const char *name;              /* its "type"; NULL: it has none */
    const char *const *structures; /* that take it, NULL-terminated; NULL: all */
    const struct scene_key *keys[SCENE_TABLES_MOST];   /* each ends with a row without name */
    const char *law;               /* what it adds, with its sign; one line */
};

/* The only row of what has nothing but its type, and the first of all that have one. */
extern const struct scene_key scene_type_keys[];

struct lowering;

/*
 * Read the members of JSON, which stands at PATH, into VALUES as the rows of TABLES say (an array
 * that ends with NULL).  L finds dofs; NULL where no row is one.  VALUES' lists are the caller's to
 * free, by scene_keys_free, on failure too.  Fails with MODAL_BAD_INPUT, the path in err->field,
 * for an unknown key, one that is missing, a wrong type or range; MODAL_NO_MEMORY.
 */
enum modal_status scene_keys_read(const struct lowering *l, const cJSON *json, const char *path,
                                  const struct scene_key *const *tables, void *values,
                                  struct modal_error *err);
/* The lists in VALUES, which is zeros or has been read into; the struct itself is the caller's. */
void scene_keys_free(const struct scene_key *const *tables, void *values);

/* MODAL_BAD_INPUT where JSON lacks the key NAME of KEYS, for one that only some askers need. */
enum modal_status scene_key_need(const cJSON *json, const char *path, const struct scene_key *keys,
                                 const char *name, struct modal_error *err);
#endif
