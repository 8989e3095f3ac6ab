/* sbatch.c - see sbatch.h
 *
 * Nothing of a list's text reaches a shell: job.sh knows the folder, this program and numbers, and
 * `modalctl task` reads the rest from tasks.jsonl.  Every input is read here once, so that what
 * cannot be read is said now and not after a night in Slurm's queue, and named by its hash, so that
 * a file that is another by then is no task's input.
 */
#include "sbatch.h"
#include <errno.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "base/utf8.h"
#include "field.h"
#include "input.h"
#include "job/sweep.h"
#include "outcome.h"
#include "sweep_shares.h"
#include "task_folder.h"
#include "verbs.h"
#include "whole_file.h"

enum {
    ELEMENTS_DEFAULT = 1000,             /* Slurm's MaxArraySize is 1001 where nobody set it */
    SHARES_MOST = 1000,                  /* tasks of a sweep */
    LIST_BYTES_MOST = 1 << 28            /* as bulk.c */
};

/* What is being written. */
struct writing {
    const struct args *args;
    char folder[PATH_MAX];
    struct whole_file tasks;
    long count;
    int elements;
    char file[PATH_MAX], kind[64], sha256[65];     /* of the input that was read last */
};

/* DIR, which is made where it is not there, and tasks.jsonl in it. */
static enum modal_status writing_begin(struct writing *w, const struct args *args, long count,
                                       struct modal_error *err)
{
    static char place[TASK_PATH_MOST];
    double most = args->array > 0 ? args->array : ELEMENTS_DEFAULT;

    *w = (struct writing) { .args = args, .count = count,
                            .elements = (int)(most < (double)count ? most : (double)count) };
    if ((mkdir(args->sbatch, 0777) < 0 && errno != EEXIST)
        || realpath(args->sbatch, w->folder) == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "sbatch", "%.200s: %s", args->sbatch,
                                strerror(errno));
    enum modal_status rc = task_folder_place(w->folder, "tasks.jsonl", place, err);
    if (rc == MODAL_OK && access(place, F_OK) == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "sbatch", "%.200s holds tasks already; "
                                "accepted: a new folder (`modalctl gather` has its results)",
                                args->sbatch);
    return rc == MODAL_OK ? whole_file_begin(&w->tasks, place, "sbatch", err) : rc;
}

/* DOC, deleted here, as the next line. */
static enum modal_status add_line(struct writing *w, cJSON *doc, struct modal_error *err)
{
    char *text = json_print(doc);
    bool good = text != NULL && fprintf(w->tasks.file, "%s\n", text) > 0;

    free(text);
    cJSON_Delete(doc);
    return good ? MODAL_OK
                : modal_fail_field(err, MODAL_IO, "sbatch", "%.200s: a task could not be written",
                                   w->folder);
}

static enum modal_status add_head(struct writing *w, int points, struct modal_error *err)
{
    cJSON *head = cJSON_CreateObject();

    cJSON_AddStringToObject(head, "version", MODALD_VERSION);
    cJSON_AddNumberToObject(head, "tasks", (double)w->count);
    cJSON_AddNumberToObject(head, "elements", w->elements);
    if (points > 0)
        cJSON_AddNumberToObject(head, "points", points);
    return add_line(w, head, err);
}

/* A task without its `name`, `file`, `options` and `sha256`. */
static cJSON *new_task(const struct writing *w, long line, const char *kind)
{
    cJSON *task = cJSON_CreateObject();

    cJSON_AddNumberToObject(task, "line", (double)line);
    cJSON_AddStringToObject(task, "kind", kind);
    if (w->args->run_limit > 0)
        cJSON_AddNumberToObject(task, "run_limit_s", w->args->run_limit);
    return task;
}

/* NAME in the folder, to be written; PLACE holds its path until the end. */
static enum modal_status file_begin(const struct writing *w, const char *name,
                                    char place[TASK_PATH_MOST], struct whole_file *out,
                                    struct modal_error *err)
{
    enum modal_status rc = task_folder_place(w->folder, name, place, err);

    return rc == MODAL_OK ? whole_file_begin(out, place, "sbatch", err) : rc;
}

/* job.sh: every element computes its tasks one after the other, each a process of its own, so that
 * one that dies takes no other with it.  What is printed counts once it is whole. */
static enum modal_status write_script(const struct writing *w, struct modal_error *err)
{
    char place[TASK_PATH_MOST], program[PATH_MAX];
    ssize_t length = readlink("/proc/self/exe", program, sizeof program - 1);
    struct whole_file script;
    enum modal_status rc = file_begin(w, "job.sh", place, &script, err);

    if (rc != MODAL_OK)
        return rc;
    program[length > 0 ? length : 0] = 0;
    fprintf(script.file, "#!/bin/bash\n#SBATCH --job-name=modalctl\n#SBATCH --array=1-%d\n"
            "#SBATCH --ntasks=1\n#SBATCH --output=/dev/null\nfolder=", w->elements);
    task_folder_quote(script.file, w->folder);
    fprintf(script.file, "\nmodalctl=");
    task_folder_quote(script.file, length > 0 ? program : "modalctl");
    fprintf(script.file,
            "\nexec 2>> \"$folder/log.${SLURM_ARRAY_TASK_ID:?sbatch starts this}\"\n"
            "status=0\n"
            "for ((n = SLURM_ARRAY_TASK_ID; n <= %ld; n += %d)); do\n"
            "    part=$folder/$n.part.$HOSTNAME.$$\n"
            "    \"$modalctl\" --local --json task \"$folder\" \"$n\" > \"$part\" && ended=0 "
            "|| ended=$?\n"
            "    [ $ended = 0 ] || status=1\n"
            "    if [ $ended -lt 126 ] && [ -s \"$part\" ]; then     # it was not killed\n"
            "        mv -f -- \"$part\" \"$folder/$n.json\"\n"
            "    else\n"
            "        rm -f -- \"$part\"\n"
            "    fi\n"
            "done\n"
            "exit $status\n", w->count, w->elements);
    return whole_file_end(&script, err);
}

/* What is to be run now, ready to be pasted. */
static enum modal_status print_next(const struct writing *w, struct modal_error *err)
{
    char script[TASK_PATH_MOST];
    cJSON *answer;
    enum modal_status rc = task_folder_place(w->folder, "job.sh", script, err);

    if (rc == MODAL_OK && w->args->json) {
        answer = cJSON_CreateObject();
        cJSON_AddNumberToObject(answer, "tasks", (double)w->count);
        cJSON_AddNumberToObject(answer, "elements", w->elements);
        cJSON_AddStringToObject(answer, "script", script);
        rc = outcome_json(answer, err);
        cJSON_Delete(answer);
    } else if (rc == MODAL_OK) {
        printf("%ld tasks in an array of %d; now:\n    sbatch ", w->count, w->elements);
        task_folder_quote(stdout, script);
        printf("\nand when it has ended:\n    modalctl gather ");
        task_folder_quote(stdout, w->folder);
        printf("\n");
    }
    return rc;
}

/* RC is how the tasks were written: all of them, or nothing stays. */
static int writing_end(struct writing *w, enum modal_status rc, struct modal_error *err)
{
    char script[TASK_PATH_MOST];

    if (rc == MODAL_OK)
        rc = write_script(w, err);
    if (rc == MODAL_OK && (rc = whole_file_end(&w->tasks, err)) != MODAL_OK
        && task_folder_place(w->folder, "job.sh", script, NULL) == MODAL_OK)
        remove(script);
    if (rc == MODAL_OK)
        rc = print_next(w, err);
    if (w->tasks.file != NULL)
        whole_file_drop(&w->tasks);
    return rc == MODAL_OK ? 0 : outcome_failure(w->args->json, err, NULL);
}

/* ---- a sweep ---- */

static enum modal_status count_points(const struct input *input, int *points,
                                      struct modal_error *err)
{
    struct sweep *s = NULL;
    enum modal_status rc = sweep_new(input->scene, &s, err);

    *points = rc == MODAL_OK ? sweep_points(s) : 0;
    sweep_free(s);
    return rc;
}

/* The document itself, with every file that it names. */
static enum modal_status write_document(const struct writing *w, const struct input *input,
                                        struct modal_error *err)
{
    char place[TASK_PATH_MOST];
    struct whole_file file;
    enum modal_status rc = file_begin(w, "scene.json", place, &file, err);

    if (rc != MODAL_OK)
        return rc;
    fprintf(file.file, "%s\n", input->scene_text);
    return whole_file_end(&file, err);
}

static enum modal_status add_share(struct writing *w, const struct input *input, long i,
                                   int points, struct modal_error *err)
{
    int first = (int)((long long)points * i / w->count),
        after = (int)((long long)points * (i + 1) / w->count);
    char name[64];
    cJSON *task = new_task(w, i + 1, "sweep"),
          *options = cJSON_Duplicate(input->options, true);

    if (after - first == 1)
        snprintf(name, sizeof name, "point %d", first);
    else
        snprintf(name, sizeof name, "points %d to %d", first, after - 1);
    cJSON_AddStringToObject(task, "name", name);
    cJSON_AddStringToObject(task, "file", "scene.json");
    cJSON_AddNumberToObject(options, "first", first);
    cJSON_AddNumberToObject(options, "count", after - first);
    cJSON_AddItemToObject(task, "options", options);
    cJSON_AddStringToObject(task, "sha256", input->sha256);
    return add_line(w, task, err);
}

int sbatch_sweep(const struct args *args)
{
    struct modal_error err = { 0 };
    struct input input = { 0 };
    struct writing w = { .args = args };
    int points = 0, status;
    enum modal_status rc = args_check(args, "sweep --sbatch", TAKES_OPTIONS | TAKES_SBATCH, &err);

    if (rc == MODAL_OK && !sweep_is_whole(args))
        rc = modal_fail_field(&err, MODAL_BAD_INPUT, "sbatch", "--sbatch cuts the whole sweep; "
                              "accepted: no option first, count");
    if (rc == MODAL_OK)
        rc = input_read("sweep", NULL, args->word[1], args, &input, &err);
    if (rc == MODAL_OK)
        rc = count_points(&input, &points, &err);
    if (rc == MODAL_OK)
        rc = writing_begin(&w, args, points < SHARES_MOST ? points : SHARES_MOST, &err);
    if (rc == MODAL_OK)
        rc = write_document(&w, &input, &err);
    if (rc == MODAL_OK)
        rc = add_head(&w, points, &err);
    for (long i = 0; i < w.count && rc == MODAL_OK; i++)
        rc = add_share(&w, &input, i, points, &err);
    status = writing_end(&w, rc, &err);
    input_done(&input);
    return status;
}

/* ---- a list ---- */

/* The whole path of PATH, which the nodes know it by. */
static enum modal_status find_file(const char *path, char out[PATH_MAX], struct modal_error *err)
{
    if (strcmp(path, "-") == 0 || stored_stream(path) != NULL || realpath(path, out) == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "file", "%.200s: no file; accepted: one that "
                                "the nodes can read", path);
    return utf8_valid(out) ? MODAL_OK
                           : modal_fail_field(err, MODAL_BAD_INPUT, "file", "%.200s: its whole "
                                              "path is not UTF-8", path);
}

/* The file of LINE, with OPTIONS, is an input of its kind; its hash into W. */
static enum modal_status check_input(struct writing *w, const cJSON *line, cJSON *options,
                                     struct modal_error *err)
{
    const char *kind = field_word(line, "kind", "");
    char file[PATH_MAX];
    struct args args = *w->args;
    struct input input = { 0 };
    enum modal_status rc = find_file(field_word(line, "file", ""), file, err);

    if (rc != MODAL_OK                  /* a tradeoff's input is a scene or a batch, by `of` */
        || (strcmp(file, w->file) == 0 && strcmp(kind, w->kind) == 0
            && strcmp(kind, "tradeoff") != 0))
        return rc;
    args.options = options;
    args.local = true;
    rc = input_read(kind, field_word(line, "of", NULL), file, &args, &input, err);
    if (rc == MODAL_OK) {
        memcpy(w->file, file, sizeof w->file);
        snprintf(w->kind, sizeof w->kind, "%s", kind);
        memcpy(w->sha256, input.sha256, sizeof w->sha256);
    }
    input_done(&input);
    return rc;
}

/* What of the command line says how a file of signals is read. */
static void add_reading(cJSON *task, const struct args *args)
{
    if (args->dt > 0)
        cJSON_AddNumberToObject(task, "dt", args->dt);
    if (args->scale > 0)
        cJSON_AddNumberToObject(task, "scale", args->scale);
    if (args->dataset != NULL)
        cJSON_AddStringToObject(task, "dataset", args->dataset);
    if (args->ignore_time)
        cJSON_AddTrueToObject(task, "ignore_time");
}

static enum modal_status add_job(struct writing *w, const cJSON *line, long number,
                                 const char *name, struct modal_error *err)
{
    const cJSON *own = cJSON_GetObjectItemCaseSensitive(line, "options");
    const char *of = field_word(line, "of", NULL);
    double limit = field_number(line, "run_limit_s", 0);
    cJSON *task = new_task(w, number, field_word(line, "kind", "")),
          *options = cJSON_Duplicate(own != NULL ? own : w->args->options, true);
    enum modal_status rc = check_input(w, line, options, err);

    cJSON_AddItemToObject(task, "options", options);
    if (rc != MODAL_OK) {
        cJSON_Delete(task);
        return rc;
    }
    cJSON_AddStringToObject(task, "name", name);
    cJSON_AddStringToObject(task, "file", w->file);
    cJSON_AddStringToObject(task, "sha256", w->sha256);
    if (of != NULL)
        cJSON_AddStringToObject(task, "of", of);
    if (limit > 0) {
        cJSON_DeleteItemFromObjectCaseSensitive(task, "run_limit_s");
        cJSON_AddNumberToObject(task, "run_limit_s", limit);
    }
    add_reading(task, w->args);
    return add_line(w, task, err);
}

/* TEXT, a line of the list, as a task; its name is what its submission would have been called. */
static enum modal_status add_text(struct writing *w, const char *text, long number,
                                  struct modal_error *err)
{
    char own[WIRE_KEY_MOST + 1], name[WIRE_KEY_MOST + 8];
    struct modal_error why = { 0 };
    const char *key;
    cJSON *line = NULL;
    enum modal_status rc = json_read(text, strlen(text), &line, &why);

    if (rc == MODAL_OK)
        rc = bulk_check_line(line, number, &why);
    if (rc == MODAL_OK) {
        bulk_key(w->args->from, number, text, own);
        key = field_word(line, "key", own);
        snprintf(name, sizeof name, "key:%.*s", WIRE_KEY_MOST, key);
        rc = add_job(w, line, number, name, &why);
    }
    if (rc != MODAL_OK)
        modal_fail_field(err, rc, why.field, "line %ld: %s", number, why.message);
    cJSON_Delete(line);
    return rc;
}

static bool is_blank(const char *line)
{
    return line[strspn(line, " \t\r")] == 0;
}

/* How many of TEXT's lines are tasks. */
static long count_lines(const char *text)
{
    long count = 0;

    for (const char *end; *text != 0; text = *end != 0 ? end + 1 : end) {
        end = strchrnul(text, '\n');
        count += text + strspn(text, " \t\r") < end;
    }
    return count;
}

int sbatch_list(const struct args *args)
{
    struct modal_error err = { 0 };
    struct writing w = { .args = args };
    char *text = NULL, *rest, *line;
    size_t length = 0;
    long number = 0;
    int status;
    enum modal_status rc = args_check(args, "submit --sbatch", TAKES_OPTIONS | TAKES_SIGNALS
                                      | TAKES_CURVE | TAKES_FROM | TAKES_SBATCH, &err);

    if (rc == MODAL_OK && args->from == NULL)
        rc = modal_fail_field(&err, MODAL_BAD_INPUT, "sbatch", "--sbatch is of a list or a sweep; "
                              "accepted: submit --from LIST.jsonl --sbatch DIR");
    if (rc == MODAL_OK)
        rc = signals_read_text(args->from, LIST_BYTES_MOST, &text, &length, &err);
    if (rc == MODAL_OK && count_lines(text) == 0)
        rc = modal_fail_field(&err, MODAL_BAD_INPUT, "from", "%.200s: no line in it", args->from);
    if (rc == MODAL_OK)
        rc = writing_begin(&w, args, count_lines(text), &err);
    if (rc == MODAL_OK)
        rc = add_head(&w, 0, &err);
    for (rest = text; rc == MODAL_OK && (line = strsep(&rest, "\n")) != NULL;) {
        number++;
        if (!is_blank(line))
            rc = add_text(&w, line, number, &err);
    }
    status = writing_end(&w, rc, &err);
    free(text);
    return status;
}
