/* task.c - `task DIR N`: one task of a folder that --sbatch wrote, as job.sh has it run
 *
 * On stdout is what `--local --json` prints of the job; nothing, with exit status 0, where N.json
 * holds a result already, so that an array may be submitted again as a whole.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "field.h"
#include "outcome.h"
#include "task_folder.h"
#include "verbs.h"

static enum modal_status read_number(const char *text, const struct task_folder *folder, long *n,
                                     struct modal_error *err)
{
    char *end;

    *n = strtol(text, &end, 10);
    return end != text && *end == 0 && *n >= 1 && *n <= folder->tasks
               ? MODAL_OK
               : modal_fail_field(err, MODAL_BAD_INPUT, "arguments", "no task \"%.40s\"; accepted: "
                                  "1 to %ld", text, folder->tasks);
}

static enum modal_status find_task(struct task_folder *folder, const char *number, cJSON **task,
                                   struct modal_error *err)
{
    long n = 0;
    enum modal_status rc = read_number(number, folder, &n, err);

    if (rc == MODAL_OK && strcmp(folder->version, MODALD_VERSION) != 0)
        rc = modal_fail(err, MODAL_BAD_VERSION, "the tasks are of modalctl %s, this one is %s",
                        folder->version, MODALD_VERSION);
    while (rc == MODAL_OK && folder->at < n) {
        cJSON_Delete(*task);
        *task = NULL;
        rc = task_folder_next(folder, task, err);
    }
    return rc;
}

static bool is_done(const struct task_folder *folder)
{
    cJSON *answer = NULL;
    bool done = task_folder_answer(folder, folder->at, &answer, NULL) == MODAL_OK
                && !cJSON_HasObjectItem(answer, "error");

    cJSON_Delete(answer);
    return done;
}

/* TASK as if it stood on the command line. */
static int run_as_job(const struct task_folder *folder, const cJSON *task,
                      struct modal_error *err)
{
    const struct verb job = { .name = field_word(task, "kind", "") };
    const char *of = field_word(task, "of", NULL);
    char file[TASK_PATH_MOST], signals[TASK_PATH_MOST], name[32];
    struct args args = {
        .local = true, .json = true, .timeout = -1, .priority = -1,
        .options = cJSON_GetObjectItemCaseSensitive(task, "options"),
        .dt = field_number(task, "dt", 0), .scale = field_number(task, "scale", 0),
        .dataset = field_word(task, "dataset", NULL),
        .ignore_time = cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(task, "ignore_time")),
        .run_limit = field_number(task, "run_limit_s", 0),
        .sha256 = field_word(task, "sha256", ""),
        .word = { job.name, of != NULL ? of : file, file }, .words = of != NULL ? 3 : 2,
    };
    enum modal_status rc = task_folder_place(folder->path, field_word(task, "file", ""), file, err);

    snprintf(name, sizeof name, "%ld.h5", folder->at);
    if (rc == MODAL_OK)
        rc = task_folder_place(folder->path, name, signals, err);
    if (strcmp(job.name, "simulate") == 0)
        args.output = signals;
    return rc == MODAL_OK ? run_job(&job, &args) : outcome_failure(true, err, NULL);
}

int run_task(const struct verb *verb, const struct args *args)
{
    struct modal_error err = { 0 };
    struct task_folder folder = { 0 };
    cJSON *task = NULL;
    int status;
    enum modal_status rc = task_folder_open(args->word[1], &folder, &err);

    (void)verb;
    if (rc == MODAL_OK)
        rc = find_task(&folder, args->word[2], &task, &err);
    if (rc != MODAL_OK)
        status = outcome_failure(args->json, &err, NULL);
    else
        status = is_done(&folder) ? 0 : run_as_job(&folder, task, &err);
    cJSON_Delete(task);
    task_folder_done(&folder);
    return status;
}
