/* map.c - see map.h; linear probing, at most 2/3 used, removed slots marked and dropped when the
 * table grows */
#include "broker/kit/map.h"
#include <stdlib.h>
#include <string.h>

static char gone;
#define MAP_GONE ((void *)&gone)

uint64_t map_hash_number(uint64_t x)
{
    x ^= x >> 30, x *= 0xbf58476d1ce4e5b9u;      /* splitmix64's finish */
    x ^= x >> 27, x *= 0x94d049bb133111ebu;
    return x ^ x >> 31;
}

uint64_t map_hash(const void *data, size_t size)
{
    uint64_t hash = 0xcbf29ce484222325u;

    for (const unsigned char *p = data; size > 0; p++, size--)
        hash = (hash ^ *p) * 0x100000001b3u;
    return map_hash_number(hash);
}

uint64_t map_hash_text(const char *text)
{
    return map_hash(text, strlen(text));
}

void *map_find(const struct map *map, uint64_t hash, map_match *match, const void *key)
{
    if (map->room == 0)
        return NULL;
    for (size_t i = hash & (map->room - 1); map->slots[i].value != NULL;
         i = (i + 1) & (map->room - 1))
        if (map->slots[i].hash == hash && map->slots[i].value != MAP_GONE
            && (match == NULL || match(map->slots[i].value, key)))
            return map->slots[i].value;
    return NULL;
}

void *map_find_number(const struct map *map, uint64_t number)
{
    return map_find(map, map_hash_number(number), NULL, NULL);
}

static void insert(struct map *map, uint64_t hash, void *value)
{
    size_t i = hash & (map->room - 1);

    while (map->slots[i].value != NULL)
        i = (i + 1) & (map->room - 1);
    map->slots[i] = (struct map_slot) { hash, value };
}

static bool rebuild(struct map *map)
{
    struct map old = *map;
    size_t room = 16;

    while (room < 2 * (old.count + 1))
        room *= 2;
    map->slots = calloc(room, sizeof *map->slots);
    if (map->slots == NULL) {
        *map = old;
        return false;
    }
    map->room = room;
    map->used = old.count;
    for (size_t i = 0; i < old.room; i++)
        if (old.slots[i].value != NULL && old.slots[i].value != MAP_GONE)
            insert(map, old.slots[i].hash, old.slots[i].value);
    free(old.slots);
    return true;
}

bool map_put(struct map *map, uint64_t hash, void *value)
{
    if (3 * (map->used + 1) > 2 * map->room && !rebuild(map))
        return false;
    insert(map, hash, value);
    map->count++;
    map->used++;
    return true;
}

void map_remove(struct map *map, uint64_t hash, const void *value)
{
    if (map->room == 0)
        return;
    for (size_t i = hash & (map->room - 1); map->slots[i].value != NULL;
         i = (i + 1) & (map->room - 1))
        if (map->slots[i].value == value) {
            map->slots[i].value = MAP_GONE;
            map->count--;
            return;
        }
}

void *map_next(const struct map *map, size_t *at)
{
    while (*at < map->room) {
        void *value = map->slots[(*at)++].value;
        if (value != NULL && value != MAP_GONE)
            return value;
    }
    return NULL;
}

void map_done(struct map *map)
{
    free(map->slots);
    memset(map, 0, sizeof *map);
}
