/* heap.h - a binary heap of numbered items, least `key` first, equal keys by `order` */
#ifndef BROKER_HEAP_H
#define BROKER_HEAP_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct heap_item { int64_t key, order; void *value; int what; };
struct heap { struct heap_item *items; size_t count, room; };

/* ITEM, copied, into it; false when memory runs out. */
bool heap_push(struct heap *heap, struct heap_item item);
/* The least item, until the next change; NULL: empty. */
const struct heap_item *heap_least(const struct heap *heap);
/* The least item, taken out; there must be one. */
struct heap_item heap_pop(struct heap *heap);
/* Only those that KEEP wants stay. */
void heap_sift(struct heap *heap, bool (*keep)(const void *context, const struct heap_item *item),
               const void *context);
/* The items go; what their values point to stays. */
void heap_done(struct heap *heap);
#endif
