/* memory.h - allocation that ends the process when there is no more, and blocks for what lives and
 * goes together */
#ifndef BROKER_MEMORY_H
#define BROKER_MEMORY_H
#include <cjson/cJSON.h>
#include <stddef.h>

/* SIZE bytes of zeros, the caller's to free. */
void *grab(size_t size);
/* OLD, which may be NULL, with room for SIZE bytes; what is new is not zeroed. */
void *regrab(void *old, size_t size);
/* A copy of TEXT, the caller's to free; NULL stays NULL. */
char *grab_text(const char *text);
/* What printf would print, the caller's to free. */
char *grab_format(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Make SIZE bytes of TEXT, which others wrote, plain ASCII without zero bytes: it will stand in
 * JSON. */
void text_clean(char *text, size_t size);

/* From here on documents of cJSON end the process too where there is no memory for a part of
 * them. */
void grab_documents(void);
/* canonical_text of base/canonical.h, the caller's to free. */
char *grab_canonical(const cJSON *value);

/* Of what lives long and goes in about the order in which it came: jobs and inputs, their keys and
 * options.  *OPEN is the region new blocks come from, NULL at first. */
struct region;
/* SIZE bytes of zeros, which region_drop gives back. */
void *region_grab(struct region **open, size_t size);
/* A copy of TEXT, which region_drop gives back; NULL stays NULL. */
char *region_text(struct region **open, const char *text);
/* Give back OUT, which may be NULL; its region goes with the last of it. */
void region_drop(void *out);
/* Nothing more comes from *OPEN, which is NULL then; what came from it stays. */
void region_close(struct region **open);

/* Texts of one life: none is freed alone. */
struct arena;
/* A copy of TEXT in *ARENA, which is NULL at first; NULL stays NULL. */
const char *arena_text(struct arena **arena, const char *text);
/* All of its texts; accepts NULL. */
void arena_free(struct arena *arena);
#endif
