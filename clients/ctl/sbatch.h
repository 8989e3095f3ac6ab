/* sbatch.h - --sbatch DIR: a sweep or a list of jobs as tasks for an array of Slurm's, with no
 * daemon in it
 *
 * Each task is a job of `modalctl --local`, which DIR/job.sh has run; task_folder.h says what
 * stands in DIR, gather.c puts the results together.
 */
#ifndef CTL_SBATCH_H
#define CTL_SBATCH_H
#include "args.h"

/* Write the tasks of `sweep FILE --sbatch DIR`, and say what is to be run; the exit status. */
int sbatch_sweep(const struct args *args);
/* Those of `submit --from LIST.jsonl --sbatch DIR`. */
int sbatch_list(const struct args *args);
#endif
