/* gather.c - `gather DIR`: the results of a folder that --sbatch wrote, as the daemon gives them
 *
 * A sweep is one result, as of `sweep --wait`; a list a line each, as of `results --from`.  Tasks
 * without a result are named, with the command that computes them.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "field.h"
#include "outcome.h"
#include "result_lines.h"
#include "result_show.h"
#include "sweep_point.h"
#include "sweep_whole.h"
#include "task_folder.h"
#include "verbs.h"
#include "wire/frame.h"

enum { NAMED_MOST = 300 };       /* bytes of the list of those that are missing, in a message */

struct gather {
    const struct args *args;
    struct task_folder folder;
    struct result_lines lines;       /* of a list */
    struct sweep_whole whole;        /* of a sweep */
    bool *missing;                   /* the elements of job.sh that have work left, from 1 on */
    long left;                       /* tasks of them */
    char names[NAMED_MOST];
};

/* Task N has no result yet. */
static void note_missing(struct gather *g, const cJSON *task)
{
    size_t used = strlen(g->names);

    g->left++;
    g->missing[task_folder_element(&g->folder, g->folder.at)] = true;
    snprintf(g->names + used, sizeof g->names - used, "%s%s", used > 0 ? ", " : "",
             field_word(task, "name", "-"));
}

/* The error that ANSWER is, into ERR; its detail stays ANSWER's. */
static enum modal_status read_error(const cJSON *answer, const cJSON **detail,
                                    struct modal_error *err)
{
    const cJSON *error = cJSON_GetObjectItemCaseSensitive(answer, "error");

    if (error == NULL)
        return MODAL_OK;
    *detail = cJSON_GetObjectItemCaseSensitive(error, "detail");
    wire_error_read(error, err);
    return err->status;
}

/* One task of a list; what has no result does not end it. */
static enum modal_status add_line(struct gather *g, const cJSON *task, cJSON *answer,
                                  enum modal_status rc, struct modal_error *err)
{
    long line = field_index(task, "line");
    const char *name = field_word(task, "name", "-");
    const cJSON *detail = NULL;

    if (rc == MODAL_OK)
        rc = read_error(answer, &detail, err);
    if (rc == MODAL_OK)
        rc = result_lines_add(&g->lines, line, name, answer, err);
    return rc != MODAL_OK && rc != MODAL_IO && rc != MODAL_NO_MEMORY
               ? result_lines_fail(&g->lines, line, name, detail, err) : rc;
}

/* One task of a sweep, of which nothing is said before all are there. */
static enum modal_status add_share(struct gather *g, const cJSON *task, cJSON **answer,
                                   struct modal_error *err)
{
    const cJSON *detail = NULL;
    struct modal_error why = { 0 };
    enum modal_status rc = read_error(*answer, &detail, &why);

    if (rc != MODAL_OK)
        return modal_fail_field(err, rc, why.field, "task %ld, %s: %s", g->folder.at,
                                field_word(task, "name", "-"), why.message);
    sweep_whole_add(&g->whole, *answer);
    *answer = NULL;
    return MODAL_OK;
}

static enum modal_status gather_next(struct gather *g, struct modal_error *err)
{
    cJSON *task = NULL, *answer = NULL;
    enum modal_status rc = task_folder_next(&g->folder, &task, err);

    if (rc == MODAL_OK) {
        rc = task_folder_answer(&g->folder, g->folder.at, &answer, err);
        if (rc == MODAL_NOT_FOUND)
            note_missing(g, task);
        if (g->folder.points == 0)
            rc = add_line(g, task, answer, rc, err);
        else if (rc == MODAL_OK)
            rc = add_share(g, task, &answer, err);
        else if (rc == MODAL_NOT_FOUND)
            rc = MODAL_OK;
    }
    cJSON_Delete(task);
    cJSON_Delete(answer);
    return rc;
}

/* The elements that have work left as sbatch(1) takes them: 3,17-20. */
static void print_elements(const struct gather *g)
{
    const char *between = "";

    for (int i = 1, last; i <= g->folder.elements; i = last + 1) {
        for (last = i; last < g->folder.elements && g->missing[i] && g->missing[last + 1];)
            last++;
        if (!g->missing[i])
            continue;
        fprintf(stderr, last > i ? "%s%d-%d" : "%s%d", between, i, last);
        between = ",";
    }
}

static void print_left(const struct gather *g)
{
    char script[TASK_PATH_MOST];

    if (g->left == 0 || task_folder_place(g->folder.path, "job.sh", script, NULL) != MODAL_OK)
        return;
    fprintf(stderr, "modalctl: %ld of %ld tasks have no result; to compute them, once none is "
            "queued or running:\n    sbatch --array=", g->left, g->folder.tasks);
    print_elements(g);
    fputc(' ', stderr);
    task_folder_quote(stderr, script);
    fputc('\n', stderr);
}

static enum modal_status finish(struct gather *g, int *status, struct modal_error *err)
{
    cJSON *result = NULL;
    enum modal_status rc;

    if (g->folder.points == 0) {
        *status = g->lines.status;
        return MODAL_OK;
    }
    if (g->left > 0)
        return modal_fail(err, MODAL_NOT_FOUND, "%ld of %ld tasks have no result: %s", g->left,
                          g->folder.tasks, g->names);
    rc = sweep_whole_end(&g->whole, g->folder.points, &result, err);
    if (rc == MODAL_OK)
        rc = result_show(g->args, result, NULL, err);
    *status = rc == MODAL_OK ? sweep_exit(result) : 0;
    cJSON_Delete(result);
    return rc;
}

static enum modal_status gather_begin(struct gather *g, struct modal_error *err)
{
    enum modal_status rc = task_folder_open(g->args->word[1], &g->folder, err);

    if (rc == MODAL_OK)
        rc = result_show_check(g->args, err);
    if (rc == MODAL_OK && g->args->plot != NULL && g->folder.points == 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "plot", "--plot draws one result, and a list "
                              "has many; accepted: --csv, --json");
    if (rc == MODAL_OK
        && (g->missing = calloc((size_t)g->folder.elements + 1, sizeof *g->missing)) == NULL)
        rc = modal_fail(err, MODAL_NO_MEMORY, "no memory for %d elements", g->folder.elements);
    return rc;
}

int run_gather(const struct verb *verb, const struct args *args)
{
    struct gather g = { .args = args, .lines.csv = args->csv,
                        .whole.as_text = sweep_whole_as_text(args) };
    struct modal_error err = { 0 };
    int status = 0;
    enum modal_status rc = gather_begin(&g, &err);

    (void)verb;
    while (rc == MODAL_OK && g.folder.at < g.folder.tasks)
        rc = gather_next(&g, &err);
    if (rc == MODAL_OK)
        rc = finish(&g, &status, &err);
    if (rc != MODAL_OK)
        status = outcome_failure(args->json, &err, NULL);
    print_left(&g);
    sweep_whole_done(&g.whole);
    task_folder_done(&g.folder);
    free(g.missing);
    return status;
}
