/* map.h - a table from keys to values by open addressing; the keys stay with the values */
#ifndef BROKER_MAP_H
#define BROKER_MAP_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct map {
    /* value NULL: never used; MAP_GONE: removed */
    struct map_slot { uint64_t hash; void *value; } *slots;
    size_t count, used, room;                                 /* room is 0 or a power of two */
};

/* Whether VALUE has KEY. */
typedef bool map_match(const void *value, const void *key);

/* FNV-1a of SIZE bytes, mixed. */
uint64_t map_hash(const void *data, size_t size);
/* The same of a text. */
uint64_t map_hash_text(const char *text);
/* NUMBER, mixed: a bijection. */
uint64_t map_hash_number(uint64_t number);

/* The value that has KEY, whose hash HASH is; NULL: none. */
void *map_find(const struct map *map, uint64_t hash, map_match *match, const void *key);
/* The same in a table by numbers, whose hash, a bijection, is the key. */
void *map_find_number(const struct map *map, uint64_t number);
/* VALUE, whose key must be new; false when memory runs out. */
bool map_put(struct map *map, uint64_t hash, void *value);
/* VALUE out of it, if it is there. */
void map_remove(struct map *map, uint64_t hash, const void *value);
/* The table goes; the values stay. */
void map_done(struct map *map);
/* The values one after the other: start with *AT 0; NULL at the end.  No change in between
 * but map_remove. */
void *map_next(const struct map *map, size_t *at);
#endif
