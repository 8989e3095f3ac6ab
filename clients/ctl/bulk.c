/* bulk.c - `submit --from LIST.jsonl`: many submissions in flight, each accepted once
 *
 * A line is {"kind", "file", "options"?, "key"?, "priority"?, "run_limit_s"?, "deadline_s"?}; "-": the list from stdin.  A
 * line without a key gets LIST:N:HASH, its number and the FNV-1a of its text, so that submitting the list again finds the
 * jobs of the first time, and another list of that name does not.  Each
 * accepted line's queue document is one line of stdout, in order of acceptance, with "line".  With --resume, LIST.accepted
 * keeps the numbers of accepted lines and those are not sent again.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "answer.h"
#include "remote.h"
#include "verbs.h"
#include "wire/limits.h"

enum { WINDOW_DEFAULT = 64, WINDOW_MOST = 1024, LIST_BYTES_MOST = 1 << 28 };

struct item { cJSON *line; long number; uint64_t hash; };

struct flight { int64_t id; size_t item; bool used; };

struct bulk {
    const struct args *args;
    struct link *link;
    struct item *items;
    size_t count, done, next;            /* next: the first item not sent yet */
    struct flight flights[WINDOW_MOST];
    int window, flying, refused;
    size_t *again, agains;               /* items to send once more */
    FILE *journal;
    struct input input;                  /* of the last file read: lists name one file many times */
    char file[1024], kind[64], upload[128];
};

static const char *text(const cJSON *object, const char *key)
{
    return cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, key));
}

static enum modal_status check_line(const cJSON *line, long number, struct modal_error *err)
{
    static const char *const keys[] = { "kind", "file", "options", "key", "priority", "run_limit_s", "deadline_s", "of", NULL };
    const char *kind, *file;
    char base[64];
    enum modal_status rc;

    snprintf(base, sizeof base, "line[%ld]", number);
    rc = json_keys(line, base, keys, err);
    if (rc == MODAL_OK)
        rc = json_need_string(line, base, "kind", &kind, err);
    return rc == MODAL_OK ? json_need_string(line, base, "file", &file, err) : rc;
}

static uint64_t fnv1a(const char *text)
{
    uint64_t hash = 0xcbf29ce484222325u;

    for (; *text != 0 && *text != '\r'; text++)
        hash = (hash ^ (unsigned char)*text) * 0x100000001b3u;
    return hash;
}

/* The lines of the list that are not in SKIP (numbers of accepted ones, 0-terminated by count). */
static enum modal_status read_items(char *list, const bool *skip, long skips, struct bulk *b, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    long number = 0;

    for (char *line; rc == MODAL_OK && (line = strsep(&list, "\n")) != NULL; ) {
        cJSON *object = NULL;
        uint64_t hash = fnv1a(line);
        number++;
        if (line[strspn(line, " \t\r")] == 0 || (number < skips && skip[number]))
            continue;
        rc = json_read(line, strlen(line), &object, err);
        if (rc == MODAL_OK)
            rc = check_line(object, number, err);
        struct item *more = rc == MODAL_OK ? realloc(b->items, (b->count + 1) * sizeof *more) : NULL;
        if (rc == MODAL_OK && more == NULL)
            rc = modal_fail(err, MODAL_NO_MEMORY, "no memory for the list");
        if (rc != MODAL_OK) {
            cJSON_Delete(object);
            if (err->field[0] == 0)
                snprintf(err->field, sizeof err->field, "line[%ld]", number);
            break;
        }
        b->items = more;
        b->items[b->count++] = (struct item) { object, number, hash };
    }
    return rc;
}

/* LIST.accepted: numbers of lines, one a line. */
static enum modal_status open_journal(const struct args *args, bool **skip, long *skips, FILE **journal, struct modal_error *err)
{
    char path[4096];
    long number;

    if (!args->resume)
        return MODAL_OK;
    if (strcmp(args->from, "-") == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "resume", "--resume needs a list that is a file");
    snprintf(path, sizeof path, "%s.accepted", args->from);
    *journal = fopen(path, "a+e");
    if (*journal == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "resume", "%s cannot be written", path);
    rewind(*journal);
    while (fscanf(*journal, "%ld", &number) == 1) {
        if (number < 1 || number > LIST_BYTES_MOST)
            continue;
        if (number >= *skips) {
            bool *more = realloc(*skip, (size_t)(2 * number + 1) * sizeof *more);
            if (more == NULL)
                return modal_fail(err, MODAL_NO_MEMORY, "no memory for %s", path);
            memset(more + *skips, 0, (size_t)(2 * number + 1 - *skips) * sizeof *more);
            *skip = more;
            *skips = 2 * number + 1;
        }
        (*skip)[number] = true;
    }
    fseek(*journal, 0, SEEK_END);
    return MODAL_OK;
}

/* Before the link is used for an upload nothing may be in flight: its answers would be lost. */
static enum modal_status land_one(struct bulk *b, double deadline, struct modal_error *err);

static enum modal_status load(struct bulk *b, const cJSON *line, double deadline, struct modal_error *err)
{
    const char *file = text(line, "file"), *kind = text(line, "kind");
    struct client_input in;
    size_t length;
    enum modal_status rc;

    if (b->input.kind != NULL && strcmp(file, b->file) == 0 && strcmp(kind, b->kind) == 0)
        return MODAL_OK;
    input_done(&b->input);
    b->upload[0] = 0;
    rc = input_read(kind, text(line, "of"), file, b->args, &b->input, err);
    if (rc != MODAL_OK)
        return rc;
    snprintf(b->file, sizeof b->file, "%s", file);
    snprintf(b->kind, sizeof b->kind, "%s", kind);
    in = remote_input(&b->input);
    client_input_bytes(&in, &length);
    if (length <= WIRE_INLINE_MOST)
        return MODAL_OK;
    while (rc == MODAL_OK && b->flying > 0)
        rc = land_one(b, deadline, err);
    return rc == MODAL_OK ? client_upload(b->link, &in, remote_progress(), deadline, b->upload, NULL, err) : rc;
}

static double get(const cJSON *line, const char *key, double otherwise)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(line, key);

    return cJSON_IsNumber(item) ? item->valuedouble : otherwise;
}

static enum modal_status send_item(struct bulk *b, size_t i, double deadline, struct modal_error *err)
{
    const cJSON *line = b->items[i].line, *options = cJSON_GetObjectItemCaseSensitive(line, "options");
    const char *base = strrchr(b->args->from, '/');
    char key[WIRE_KEY_MOST + 1];
    enum modal_status rc = load(b, line, deadline, err);
    int slot = 0;

    if (rc != MODAL_OK)
        return rc;
    snprintf(key, sizeof key, "%.90s:%ld:%016llx", base ? base + 1 : b->args->from, b->items[i].number, (unsigned long long)b->items[i].hash);
    struct client_job job = remote_job(&b->input, b->args, text(line, "key") ? text(line, "key") : key);
    job.options = options ? options : job.options;
    job.priority = get(line, "priority", job.priority);
    job.run_limit = get(line, "run_limit_s", job.run_limit);
    job.deadline = get(line, "deadline_s", job.deadline);
    struct client_input in = remote_input(&b->input);
    struct link_ask ask = { .verb = "SUBMIT", .header = client_submit_header(&job, &in, b->upload[0] ? b->upload : NULL) };
    if (b->upload[0] == 0)
        ask.body = client_input_bytes(&in, &ask.length);
    while (b->flights[slot].used)
        slot++;
    rc = link_send(b->link, &ask, deadline, &b->flights[slot].id, err);
    if (rc != MODAL_OK)
        return rc;
    b->flights[slot].used = true;
    b->flights[slot].item = i;
    b->flying++;
    return MODAL_OK;
}

static void send_again(struct bulk *b, struct flight *flight)
{
    b->again[b->agains++] = flight->item;
    flight->used = false;
    b->flying--;
}

/* A submission is answered: said on stdout, or, where the daemon is full for now, to be sent again. */
static enum modal_status take_answer(struct bulk *b, struct flight *flight, struct link_message *message, struct modal_error *err)
{
    long number = b->items[flight->item].number;
    cJSON *doc = message->header;

    if (message->type == LINK_ERROR) {
        struct modal_error why = { 0 };
        cJSON *detail = NULL;
        enum modal_status rc = link_error(message, &detail, &why);
        double pause = get(detail, "retry_after_s", 0.1);
        if (rc == MODAL_BUSY || rc == MODAL_DRAINING || (rc == MODAL_QUOTA && cJSON_HasObjectItem(detail, "retry_after_s"))) {
            struct timespec t = { (time_t)pause, (long)(1e9 * (pause - floor(pause))) };
            nanosleep(&t, NULL);
            cJSON_Delete(detail);
            send_again(b, flight);
            return MODAL_OK;
        }
        b->refused++;
        doc = answer_error(&why, detail);
        cJSON_Delete(detail);
    } else {
        message->header = NULL;
        cJSON_DeleteItemFromObjectCaseSensitive(doc, "id");
        cJSON_DeleteItemFromObjectCaseSensitive(doc, "verb");
        if (b->journal != NULL && (fprintf(b->journal, "%ld\n", number) < 0 || fflush(b->journal) != 0))
            fprintf(stderr, "modalctl: the journal of accepted lines could not be written\n");
    }
    cJSON_AddNumberToObject(doc, "line", (double)number);
    enum modal_status rc = answer_json(doc, err);
    cJSON_Delete(doc);
    flight->used = false;
    b->flying--;
    b->done++;
    return rc;
}

static enum modal_status land_one(struct bulk *b, double deadline, struct modal_error *err)
{
    struct link_message message;
    enum modal_status rc = link_receive(b->link, fmin(deadline, link_now() + 10), &message, err);

    if (rc == MODAL_NO_SERVER || (rc == MODAL_TIMEOUT && link_now() < deadline)) {
        for (int i = 0; i < b->window; i++)
            if (b->flights[i].used)
                send_again(b, &b->flights[i]);
        return MODAL_OK;
    }
    if (rc != MODAL_OK)
        return rc;
    for (int i = 0; i < b->window; i++)
        if (b->flights[i].used && b->flights[i].id == link_message_id(&message)) {
            rc = take_answer(b, &b->flights[i], &message, err);
            break;
        }
    link_message_done(&message);
    return rc;
}

static enum modal_status submit_all(struct bulk *b, double deadline, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && b->done < b->count) {
        while (rc == MODAL_OK && b->flying < b->window && (b->agains > 0 || b->next < b->count)) {
            size_t i = b->agains > 0 ? b->again[--b->agains] : b->next++;
            rc = send_item(b, i, deadline, err);
        }
        if (rc == MODAL_OK && b->flying > 0)
            rc = land_one(b, deadline, err);
    }
    return rc;
}

static void bulk_done(struct bulk *b)
{
    for (size_t i = 0; i < b->count; i++)
        cJSON_Delete(b->items[i].line);
    free(b->items);
    free(b->again);
    if (b->journal != NULL)
        fclose(b->journal);
    input_done(&b->input);
    link_close(b->link);
    free(b);
}

int run_bulk(const struct args *args)
{
    struct modal_error err = { 0 };
    struct bulk *b = calloc(1, sizeof *b);
    bool *skip = NULL;
    char *list = NULL;
    size_t length = 0;
    long skips = 0;
    enum modal_status rc;
    int status;

    if (b == NULL)
        return answer_failure(args->json, &(struct modal_error) { .status = MODAL_NO_MEMORY, .message = "no memory" }, NULL);
    b->args = args;
    b->window = args->window > 0 ? (int)args->window : WINDOW_DEFAULT;
    if (b->window > WINDOW_MOST)
        rc = modal_fail_field(&err, MODAL_BAD_INPUT, "window", "--window is %d; accepted: a whole number from 1 to %d", b->window, WINDOW_MOST);
    else
        rc = args->local ? modal_fail_field(&err, MODAL_BAD_INPUT, "local", "--from speaks to a daemon") : open_journal(args, &skip, &skips, &b->journal, &err);
    if (rc == MODAL_OK)
        rc = signals_read_text(args->from, LIST_BYTES_MOST, &list, &length, &err);
    if (rc == MODAL_OK)
        rc = read_items(list, skip, skips, b, &err);
    if (rc == MODAL_OK && (b->again = calloc(b->count + 1, sizeof *b->again)) == NULL)
        rc = modal_fail(&err, MODAL_NO_MEMORY, "no memory for the list");
    if (rc == MODAL_OK)
        rc = remote_open(args, &b->link, &err);
    if (rc == MODAL_OK)
        rc = submit_all(b, remote_deadline(args), &err);
    status = rc != MODAL_OK ? answer_failure(args->json, &err, NULL) : b->refused > 0 ? 4 : 0;
    if (!args->json)
        fprintf(stderr, "%zu of %zu accepted\n", b->done - (size_t)b->refused, b->count);
    free(list);
    free(skip);
    bulk_done(b);
    return status;
}
