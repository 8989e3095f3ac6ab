/* heap.c - see heap.h */
#include "broker/kit/heap.h"
#include <stdlib.h>
#include <string.h>

static bool before(const struct heap_item *a, const struct heap_item *b)
{
    return a->key != b->key ? a->key < b->key : a->order < b->order;
}

bool heap_push(struct heap *heap, struct heap_item item)
{
    size_t i = heap->count;

    if (i == heap->room) {
        size_t room = heap->room ? 2 * heap->room : 64;
        struct heap_item *items = realloc(heap->items, room * sizeof *items);
        if (items == NULL)
            return false;
        heap->items = items;
        heap->room = room;
    }
    for (heap->count++; i > 0 && before(&item, &heap->items[(i - 1) / 2]); i = (i - 1) / 2)
        heap->items[i] = heap->items[(i - 1) / 2];
    heap->items[i] = item;
    return true;
}

const struct heap_item *heap_least(const struct heap *heap)
{
    return heap->count > 0 ? heap->items : NULL;
}

struct heap_item heap_pop(struct heap *heap)
{
    struct heap_item least = heap->items[0], last = heap->items[--heap->count];
    size_t i = 0, child;

    while ((child = 2 * i + 1) < heap->count) {
        if (child + 1 < heap->count && before(&heap->items[child + 1], &heap->items[child]))
            child++;
        if (!before(&heap->items[child], &last))
            break;
        heap->items[i] = heap->items[child];
        i = child;
    }
    if (heap->count > 0)
        heap->items[i] = last;
    return least;
}

void heap_sift(struct heap *heap, bool (*keep)(const void *, const struct heap_item *),
               const void *context)
{
    size_t count = heap->count;

    heap->count = 0;
    for (size_t i = 0; i < count; i++) {      /* pushed where those before it were: there is room */
        struct heap_item item = heap->items[i];
        if (keep(context, &item))
            heap_push(heap, item);
    }
}

void heap_done(struct heap *heap)
{
    free(heap->items);
    memset(heap, 0, sizeof *heap);
}
