/* lazy.h - a library is loaded at the first call into it
 *
 * Half a hundred libraries stand behind HDF5, libzmq, UMFPACK and the others; to load them all cost
 * modalctl more than its work on a small file.  So the linker finds their functions in the program:
 * `calls` lists what modalctl's archives call, lazy.S makes a jump of each name.  The first call
 * into a library loads it here; from then on a call costs what it costs through a linkage table.
 * No source knows of it, and where lazy.S has no jump for the processor they are linked as ever.
 */
#ifndef CTL_LAZY_H
#define CTL_LAZY_H
#include <stdbool.h>
#include <stddef.h>

struct lazy_library;

/* The layout is lazy.S's too. */
struct lazy_symbol {
    const char *name;
    size_t size;                    /* bytes of an object; 0: a function */
    void *at;                       /* where a call goes; an object: where the program has it */
    struct lazy_library *library;
};

struct lazy_library {
    struct lazy_symbol *first, *end;
    const char *files;              /* to load, in this order; each ends in 0, the last is empty */
    bool loaded;
};

/*
 * Load the library of CALLED, a function, where no call did so before, and say where CALLED is.  Of
 * any thread; called by lazy.S alone.  A library that is missing ends the process with 127 and a
 * line on stderr, as the loader does at a program's start.
 */
void *lazy_load(const struct lazy_symbol *called);
#endif
