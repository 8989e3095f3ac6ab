/* heap.h - a binary heap of numbered items, least `key` first, equal keys by `order` */
#ifndef BROKER_HEAP_H
#define BROKER_HEAP_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct heap_item { int64_t key, order; void *value; int what; };
struct heap { struct heap_item *items; size_t count, room; };

bool heap_push(struct heap *heap, struct heap_item item);     /* false when memory runs out */
const struct heap_item *heap_least(const struct heap *heap);  /* NULL: empty */
struct heap_item heap_pop(struct heap *heap);                 /* must not be empty */
/* Only those that KEEP wants stay. */
void heap_sift(struct heap *heap, bool (*keep)(const void *context, const struct heap_item *item),
               const void *context);
void heap_done(struct heap *heap);
#endif
