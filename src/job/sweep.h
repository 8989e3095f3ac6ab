/* sweep.h - a scene over a grid of its values: points that can be computed in any order and any
 * share
 *
 * Document (the job's input): {"verb", "scene", "grid": [{"path", "values"}, ...], "options":
 * {...}}; verb is floquet, steady, or identify (of the scene's simulation); options are the verb's.
 * Point number p has the index [i, j, ...] with the last axis running fastest.
 */
#ifndef JOB_SWEEP_H
#define JOB_SWEEP_H
#include "base/key_table.h"
#include "job/job.h"

enum {
    SWEEP_AXES_MOST = 6,             /* two points an axis are 64 then: more are mistaken */
    SWEEP_POINTS_MOST = 1000000      /* a table of some 200 MB */
};

struct sweep;

/* What the job's options, the document and an axis of its grid may hold. */
extern const struct key_row sweep_option_rows[], sweep_document_rows[], sweep_axis_rows[];

/* DOCUMENT is borrowed.  Fails with MODAL_BAD_INPUT (field such as `grid[0].path`),
 * MODAL_TOO_LARGE. */
enum modal_status sweep_new(const cJSON *document, struct sweep **out, struct modal_error *err);
void sweep_free(struct sweep *s);
int sweep_points(const struct sweep *s);

/* The kind `sweep`.  Options: first, count (a share of the grid; default all), threads.  A
 * progress event per chunk: {"fraction", "done", "total", "first", "count", "points"}.  Every share
 * of the grid gives the same points, so that shares can be computed anywhere and put together. */
enum modal_status sweep_run(const struct job_request *request, struct job_result *out,
                            struct modal_error *err);

#endif
