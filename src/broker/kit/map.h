/* map.h - a table from keys to values by open addressing; the keys stay with the values */
#ifndef BROKER_MAP_H
#define BROKER_MAP_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct map {
    struct map_slot { uint64_t hash; void *value; } *slots;   /* value NULL: never used; MAP_GONE: removed */
    size_t count, used, room;                                 /* room is 0 or a power of two */
};

/* Whether VALUE has KEY. */
typedef bool map_match(const void *value, const void *key);

uint64_t map_hash(const void *data, size_t size);             /* FNV-1a, mixed */
uint64_t map_hash_text(const char *text);
uint64_t map_hash_number(uint64_t number);

void *map_find(const struct map *map, uint64_t hash, map_match *match, const void *key);   /* NULL: none */
bool map_put(struct map *map, uint64_t hash, void *value);    /* the key must be new; false when memory runs out */
void map_remove(struct map *map, uint64_t hash, const void *value);
void map_done(struct map *map);                               /* the values stay */
/* The values one after the other: start with *AT 0; NULL at the end.  No change in between but map_remove. */
void *map_next(const struct map *map, size_t *at);
#endif
