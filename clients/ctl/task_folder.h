/* task_folder.h - a folder of tasks that an array of Slurm's computes, and what is where in it
 *
 *     tasks.jsonl   {"version", "tasks", "elements", "points"?}, and below it a line a task:
 *                   {"line", "name", "kind", "of"?, "file", "options", "dt"?, "scale"?, "dataset"?,
 *                   "ignore_time"?, "run_limit_s"?, "sha256"}; `points` is that of a sweep, of
 *                   which each task is a share
 *     scene.json    of a sweep: its document
 *     job.sh        the array; its element I computes tasks I, I + elements, I + 2 elements, ...
 *     N.json        what task N printed: its result or its error
 *     N.h5          of simulate: its signals
 *     log.I         what element I said on stderr
 */
#ifndef CTL_TASK_FOLDER_H
#define CTL_TASK_FOLDER_H
#include <stdio.h>
#include "base/error.h"
#include "base/json.h"

enum { TASK_PATH_MOST = 4096 };      /* PATH_MAX: the kernel opens no longer one */

struct task_folder {
    const char *path;           /* borrowed */
    FILE *file;
    long tasks, at;             /* at: the task that was read last, from 1 on */
    int elements, points;       /* points 0: of a list */
    char *line;
    size_t room;
    char version[64];           /* of the modalctl that wrote it */
};

/* The folder at PATH.  MODAL_BAD_INPUT, field "folder": it is none. */
enum modal_status task_folder_open(const char *path, struct task_folder *out,
                                   struct modal_error *err);
void task_folder_done(struct task_folder *folder);
/* The next task, folder->at, into *OUT, the caller's. */
enum modal_status task_folder_next(struct task_folder *folder, cJSON **out,
                                   struct modal_error *err);
/* PATH/NAME into OUT, PATH alone where NAME is absolute.  MODAL_BAD_INPUT: too long. */
enum modal_status task_folder_place(const char *path, const char *name, char out[TASK_PATH_MOST],
                                    struct modal_error *err);
/* N.json into *OUT, the caller's.  MODAL_NOT_FOUND: there is none, or none that is whole. */
enum modal_status task_folder_answer(const struct task_folder *folder, long n, cJSON **out,
                                     struct modal_error *err);
/* The element of job.sh that computes task N. */
int task_folder_element(const struct task_folder *folder, long n);
/* WORD as a shell reads it: in quotes where it needs them. */
void task_folder_quote(FILE *to, const char *word);
#endif
