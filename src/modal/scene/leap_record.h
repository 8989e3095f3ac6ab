/* leap_record.h - samples of a program's outputs out of leaps
 *
 * A leap of the whole writes its samples; a part made anew over some of its time adds to them what
 * its dofs differ by.
 */
#ifndef MODAL_LEAP_RECORD_H
#define MODAL_LEAP_RECORD_H
#include "modal/scene/leap.h"
#include "modal/scene/scene.h"

struct leap_record {
    const struct dofwise *of;        /* borrowed, as `time` */
    const struct scene_time *time;
    double *signals;                 /* samples x outputs: the caller's */
    long first, end;                 /* samples of the last leap of the whole: first .. end - 1 */
    int *start;                      /* n + 1: terms of dof i: term[start[i]] .. */
    struct triplet *term;            /* i: output, j: 0 x, 1 v, 2 a; value */
    bool accelerations;              /* any term reads them */
    double *y, *slope, *other;       /* 2 n of room each */
};

/* Arrays of SPACE. */
enum modal_status leap_record_init(struct leap_record *r, const struct dofwise *of,
                                   const struct scene_time *time, double *signals,
                                   struct workspace *space, struct modal_error *err);

/* Time of sample K, s. */
double leap_record_time(const struct leap_record *r, long k);
/* Samples of L, made with MEMORY, from r->first on: those before its end, all that are left where
 * LAST; r->end is the first that is not its.  Asked again, they are written anew. */
enum modal_status leap_record_whole(struct leap_record *r, const struct leap *l,
                                    const double *memory, bool last, struct modal_error *err);
/* Of PART, within WHOLE (made with MEMORY): samples *K .. up to PART's end, all of WHOLE's where
 * LAST; *K is moved past them. */
enum modal_status leap_record_part(struct leap_record *r, const struct leap *whole,
                                   const double *memory, const struct leap *part,
                                   const double *part_memory, bool last, long *k,
                                   struct modal_error *err);
#endif
