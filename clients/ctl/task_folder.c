/* task_folder.c - see task_folder.h */
#include "task_folder.h"
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include "field.h"
#include "signals.h"

enum { ANSWER_BYTES_MOST = 1 << 30 };    /* the largest table of a sweep is a fifth of it */

enum modal_status task_folder_place(const char *path, const char *name, char out[TASK_PATH_MOST],
                                    struct modal_error *err)
{
    int n = name[0] == '/' ? snprintf(out, TASK_PATH_MOST, "%s", name)
                           : snprintf(out, TASK_PATH_MOST, "%s/%s", path, name);

    return n < TASK_PATH_MOST ? MODAL_OK
                              : modal_fail_field(err, MODAL_BAD_INPUT, "folder",
                                                 "%.200s: a path has at most %d bytes", path,
                                                 TASK_PATH_MOST - 1);
}

static enum modal_status is_none(const struct task_folder *folder, const char *why,
                                 struct modal_error *err)
{
    return modal_fail_field(err, MODAL_BAD_INPUT, "folder", "%.200s/tasks.jsonl: %s; accepted: a "
                            "folder that --sbatch wrote", folder->path, why);
}

/* The line of JSON that comes next. */
static enum modal_status read_line(struct task_folder *folder, cJSON **out,
                                   struct modal_error *err)
{
    ssize_t length = getline(&folder->line, &folder->room, folder->file);

    return length > 0 ? json_read(folder->line, (size_t)length, out, err)
                      : is_none(folder, "it ends too early", err);
}

static enum modal_status read_head(struct task_folder *folder, struct modal_error *err)
{
    cJSON *head = NULL;
    double tasks = 0, elements = 0, points = 0;
    enum modal_status rc = read_line(folder, &head, err);

    if (rc == MODAL_OK)
        rc = json_need_number(head, "tasks.jsonl", "tasks", 1, 1e9, &tasks, err);
    if (rc == MODAL_OK)
        rc = json_need_number(head, "tasks.jsonl", "elements", 1, tasks, &elements, err);
    if (rc == MODAL_OK)
        rc = json_get_number(head, "tasks.jsonl", "points", tasks, 1e9, &points, err);
    folder->tasks = (long)tasks;
    folder->elements = (int)elements;
    folder->points = (int)points;
    snprintf(folder->version, sizeof folder->version, "%s", field_word(head, "version", "-"));
    cJSON_Delete(head);
    return rc;
}

enum modal_status task_folder_open(const char *path, struct task_folder *out,
                                   struct modal_error *err)
{
    char place[TASK_PATH_MOST];
    enum modal_status rc = task_folder_place(path, "tasks.jsonl", place, err);

    *out = (struct task_folder) { .path = path };
    if (rc == MODAL_OK && (out->file = fopen(place, "re")) == NULL)
        rc = is_none(out, strerror(errno), err);
    return rc == MODAL_OK ? read_head(out, err) : rc;
}

void task_folder_done(struct task_folder *folder)
{
    if (folder->file != NULL)
        fclose(folder->file);
    free(folder->line);
    *folder = (struct task_folder) { 0 };
}

enum modal_status task_folder_next(struct task_folder *folder, cJSON **out,
                                   struct modal_error *err)
{
    folder->at++;
    return read_line(folder, out, err);
}

enum modal_status task_folder_answer(const struct task_folder *folder, long n, cJSON **out,
                                     struct modal_error *err)
{
    char name[32], place[TASK_PATH_MOST], *text = NULL;
    size_t length = 0;
    enum modal_status rc;

    snprintf(name, sizeof name, "%ld.json", n);
    rc = task_folder_place(folder->path, name, place, err);
    if (rc == MODAL_OK)
        rc = signals_read_text(place, ANSWER_BYTES_MOST, &text, &length, err);
    if (rc == MODAL_OK)
        rc = json_read(text, length, out, err);
    free(text);
    return rc == MODAL_OK || rc == MODAL_NO_MEMORY
               ? rc
               : modal_fail(err, MODAL_NOT_FOUND, "task %ld has no result; what its job said is in "
                            "%.300s/log.%d", n, folder->path, task_folder_element(folder, n));
}

int task_folder_element(const struct task_folder *folder, long n)
{
    return (int)((n - 1) % folder->elements) + 1;
}

void task_folder_quote(FILE *to, const char *word)
{
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                "/._-+,:@%";

    if (word[0] != 0 && word[strspn(word, plain)] == 0) {
        fputs(word, to);
        return;
    }
    fputc('\'', to);
    for (; *word != 0; word++)
        fputs(*word == '\'' ? "'\\''" : (char[]) { *word, 0 }, to);
    fputc('\'', to);
}
