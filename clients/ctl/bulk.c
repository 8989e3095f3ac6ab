/* bulk.c - `submit --from LIST.jsonl`: many submissions in flight, each accepted once
 *
 * A line is {"kind", "file", "options"?, "key"?, "priority"?, "run_limit_s"?, "deadline_s"?}; "-":
 * the list from stdin.  A line without a key gets LIST:N:HASH, its number and the FNV-1a of its
 * text, so that submitting the list again finds the jobs of the first time, and another list of
 * that name does not.  Each accepted line's queue document is one line of stdout, in order of
 * acceptance, with "line".  With --resume, LIST.accepted keeps number and hash of accepted lines
 * and those are not sent again; a line that was changed since is another.  With --wait the
 * documents of the ended jobs follow, in the list's order; lines that --resume would pass over are
 * asked for again then, by their keys, so that they are waited for like the others.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "outcome.h"
#include "progress.h"
#include "remote.h"
#include "verbs.h"
#include "wire/frame.h"

enum {
    WINDOW_DEFAULT = 256,            /* hides a round trip of 100 ms at 2,500 a second */
    WINDOW_MOST = 1024,              /* below what a daemon takes from one user at once */
    LIST_BYTES_MOST = 1 << 28,       /* a million lines */
    TOGETHER_MOST = 64,              /* the daemon's own limit of SUBMITS, PROTOCOL.md */
    FLIGHTS_MOST = WINDOW_MOST,      /* one submission a message */
    FLIGHTS_LEAST = 4,               /* messages in the window, so that one is always on its way */
    ITEM_SPARE = 64                  /* bytes of a header around its items */
};

/* JOB: its id, once accepted. */
struct item { cJSON *line; long number; uint64_t hash; char *job; };

/* Of the journal: by a line's number the hash of the text that was accepted; 0: none was. */
struct accepted { uint64_t *hash; long count; };

/* A message under way, and the items in it. */
struct flight { int64_t id; size_t items[TOGETHER_MOST]; int count; };

/* A message being filled: parts of SUBMITS, their inputs one behind the other. */
struct parcel { cJSON *jobs; char *body; size_t length, header; struct flight flight; };

struct bulk {
    const struct args *args;
    struct link *link;
    struct item *items;
    size_t count, done, next;            /* next: the first item not sent yet */
    struct flight flights[FLIGHTS_MOST]; /* count 0: not used */
    int window, together, flying, refused;      /* together: items a message; 1 where the daemon
                                                   does not know SUBMITS */
    size_t *again, agains;               /* items to send once more */
    FILE *journal;
    struct input input;                  /* of the last file read: lists name one file many times */
    char file[1024], kind[64], upload[128];
};

static const char *text(const cJSON *object, const char *key)
{
    return cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, key));
}

enum modal_status bulk_check_line(const cJSON *line, long number, struct modal_error *err)
{
    static const char *const keys[] = { "kind", "file", "options", "key", "priority",
                                        "run_limit_s", "deadline_s", "of", NULL };
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

static void make_key(const char *from, long number, uint64_t hash, char key[WIRE_KEY_MOST + 1])
{
    const char *base = strrchr(from, '/');

    snprintf(key, WIRE_KEY_MOST + 1, "%.90s:%ld:%016" PRIx64, base ? base + 1 : from, number, hash);
}

void bulk_key(const char *from, long number, const char *line, char key[WIRE_KEY_MOST + 1])
{
    make_key(from, number, fnv1a(line), key);
}

/* The lines of the list that are not in SKIP. */
static enum modal_status read_items(char *list, const struct accepted *skip, struct bulk *b,
                                    struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    long number = 0;

    for (char *line; rc == MODAL_OK && (line = strsep(&list, "\n")) != NULL; ) {
        cJSON *object = NULL;
        uint64_t hash = fnv1a(line);
        number++;
        if (line[strspn(line, " \t\r")] == 0
            || (number < skip->count && skip->hash[number] == hash))
            continue;
        rc = json_read(line, strlen(line), &object, err);
        if (rc == MODAL_OK)
            rc = bulk_check_line(object, number, err);
        struct item *more = rc == MODAL_OK ? realloc(b->items, (b->count + 1) * sizeof *more)
                                           : NULL;
        if (rc == MODAL_OK && more == NULL)
            rc = modal_fail(err, MODAL_NO_MEMORY, "no memory for the list");
        if (rc != MODAL_OK) {
            cJSON_Delete(object);
            if (err->field[0] == 0)
                snprintf(err->field, sizeof err->field, "line[%ld]", number);
            break;
        }
        b->items = more;
        b->items[b->count++] = (struct item) { object, number, hash, NULL };
    }
    return rc;
}

/* A line of the journal, NUMBER HASH; what a kill, a power cut or a full disk tore has no end, or
 * another hash, and is none. */
static enum modal_status note_accepted(struct accepted *all, const char *line,
                                       struct modal_error *err)
{
    long number;
    uint64_t hash;
    int end = 0;

    if (sscanf(line, "%ld %16" SCNx64 "%n", &number, &hash, &end) != 2
        || strcmp(line + end, "\n") != 0 || number < 1 || number > LIST_BYTES_MOST)
        return MODAL_OK;
    if (number >= all->count) {
        uint64_t *more = realloc(all->hash, (size_t)(2 * number + 1) * sizeof *more);
        if (more == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "no memory for the journal of accepted lines");
        memset(more + all->count, 0, (size_t)(2 * number + 1 - all->count) * sizeof *more);
        all->hash = more;
        all->count = 2 * number + 1;
    }
    all->hash[number] = hash;
    return MODAL_OK;
}

/* LIST.accepted; a line without its end is cut off, so that the next one is whole. */
static enum modal_status open_journal(const struct args *args, struct accepted *all, FILE **journal,
                                      struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    char path[4096], *line = NULL;
    size_t room = 0;
    long whole = 0;

    if (!args->resume)
        return MODAL_OK;
    if (strcmp(args->from, "-") == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "resume",
                                "--resume needs a list that is a file");
    snprintf(path, sizeof path, "%s.accepted", args->from);
    *journal = fopen(path, "a+e");
    if (*journal == NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "resume", "%s cannot be written", path);
    rewind(*journal);
    for (ssize_t n;
         rc == MODAL_OK && (n = getline(&line, &room, *journal)) > 0 && line[n - 1] == '\n';
         whole = ftell(*journal))
        rc = note_accepted(all, line, err);
    free(line);
    fseek(*journal, 0, SEEK_END);
    if (rc == MODAL_OK && whole < ftell(*journal) && ftruncate(fileno(*journal), whole) != 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "resume", "%s cannot be written", path);
    fseek(*journal, 0, SEEK_END);
    return rc;
}

/* Accepted lines past a journal that cannot be written are sent again by the next run, and found by
 * their keys. */
static void write_accepted(struct bulk *b, const struct item *item)
{
    if (b->journal == NULL
        || (fprintf(b->journal, "%ld %016" PRIx64 "\n", item->number, item->hash) > 0
            && fflush(b->journal) == 0))
        return;
    fprintf(stderr, "modalctl: the journal of accepted lines could not be written\n");
    fclose(b->journal);
    b->journal = NULL;
}

/* Before the link is used for an upload nothing may be in flight: its answers would be lost. */
static enum modal_status land_one(struct bulk *b, double deadline, struct modal_error *err);

static enum modal_status load(struct bulk *b, const cJSON *line, double deadline,
                              struct modal_error *err)
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
    return rc == MODAL_OK
               ? client_upload(b->link, &in, remote_progress(), deadline, b->upload, NULL, err)
               : rc;
}

static double get(const cJSON *line, const char *key, double otherwise)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(line, key);

    return cJSON_IsNumber(item) ? item->valuedouble : otherwise;
}

/* Item I as a part of SUBMITS, its text the caller's; its input is then in `b->input`, or in the
 * daemon as `b->upload`. */
static enum modal_status item_text(struct bulk *b, size_t i, double deadline, char **out,
                                   struct client_input *in, struct modal_error *err)
{
    const cJSON *line = b->items[i].line,
                *options = cJSON_GetObjectItemCaseSensitive(line, "options");
    char key[WIRE_KEY_MOST + 1];
    struct client_job job;
    cJSON *header;
    enum modal_status rc = load(b, line, deadline, err);

    if (rc != MODAL_OK)
        return rc;
    make_key(b->args->from, b->items[i].number, b->items[i].hash, key);
    job = remote_job(&b->input, b->args, text(line, "key") ? text(line, "key") : key);
    job.options = options ? options : job.options;
    job.priority = get(line, "priority", job.priority);
    job.run_limit = get(line, "run_limit_s", job.run_limit);
    job.deadline = get(line, "deadline_s", job.deadline);
    *in = remote_input(&b->input);
    header = client_submit_header(&job, in, b->upload[0] ? b->upload : NULL);
    if (b->upload[0] == 0 && in->scene != NULL) {
        size_t length;
        client_input_bytes(in, &length);
        cJSON_AddNumberToObject(cJSON_GetObjectItemCaseSensitive(header, "input"), "bytes",
                                (double)length);
    }
    *out = json_print(header);
    cJSON_Delete(header);
    return *out != NULL ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY, "no memory for a message");
}

/* Item I into P; *FULL: it has no room there and is to be sent in the next. */
static enum modal_status pack(struct bulk *b, struct parcel *p, size_t i, double deadline,
                              bool *full, struct modal_error *err)
{
    struct client_input in;
    size_t length = 0;
    const void *bytes;
    char *part = NULL;
    enum modal_status rc = item_text(b, i, deadline, &part, &in, err);

    if (rc != MODAL_OK)
        return rc;
    bytes = b->upload[0] ? NULL : client_input_bytes(&in, &length);
    *full = p->flight.count > 0
            && (p->header + strlen(part) + ITEM_SPARE > WIRE_HEADER_MOST
                || p->length + length > WIRE_BODY_MOST);
    if (!*full) {
        if (length > 0)
            memcpy(p->body + p->length, bytes, length);
        p->length += length;
        p->header += strlen(part) + 1;
        cJSON_AddItemToArray(p->jobs, cJSON_CreateRaw(part));
        p->flight.items[p->flight.count++] = i;
    }
    free(part);
    return MODAL_OK;
}

static size_t next_item(struct bulk *b)
{
    return b->agains > 0 ? b->again[--b->agains] : b->next++;
}

static enum modal_status fill(struct bulk *b, struct parcel *p, double deadline,
                              struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    bool full = false;

    while (rc == MODAL_OK && !full && p->flight.count < b->together
           && (b->agains > 0 || b->next < b->count)) {
        size_t i = next_item(b);
        rc = pack(b, p, i, deadline, &full, err);
        if (full)
            b->again[b->agains++] = i;
    }
    return rc;
}

/* As SUBMITS, or, where it is one, as SUBMIT. */
static enum modal_status send_parcel(struct bulk *b, struct parcel *p, double deadline,
                                     struct modal_error *err)
{
    struct link_ask ask = { .verb = "SUBMITS", .body = p->length > 0 ? p->body : NULL,
                            .length = p->length };
    struct flight *flight = b->flights;
    enum modal_status rc = MODAL_OK;

    if (p->flight.count == 1) {
        const char *only = cJSON_GetArrayItem(p->jobs, 0)->valuestring;
        ask.verb = "SUBMIT";
        rc = json_read(only, strlen(only), &ask.header, err);
    } else {
        ask.header = cJSON_CreateObject();
        cJSON_AddItemToObject(ask.header, "jobs", p->jobs);
        p->jobs = NULL;
    }
    while (flight->count > 0)
        flight++;
    if (rc == MODAL_OK)
        rc = link_send(b->link, &ask, deadline, &p->flight.id, err);
    if (rc != MODAL_OK)
        return rc;
    *flight = p->flight;
    b->flying += flight->count;
    return MODAL_OK;
}

static enum modal_status send_some(struct bulk *b, double deadline, struct modal_error *err)
{
    struct parcel p = { .jobs = cJSON_CreateArray(), .body = malloc(WIRE_BODY_MOST) };
    enum modal_status rc = p.body != NULL
                               ? fill(b, &p, deadline, err)
                               : modal_fail(err, MODAL_NO_MEMORY, "no memory for a message");

    if (rc == MODAL_OK)
        rc = send_parcel(b, &p, deadline, err);
    cJSON_Delete(p.jobs);
    free(p.body);
    return rc;
}

static void send_again(struct bulk *b, struct flight *flight)
{
    for (int i = 0; i < flight->count; i++)
        b->again[b->agains++] = flight->items[i];
    b->flying -= flight->count;
    flight->count = 0;
}

/* The error in PART, a header or a part of SUBMITS; the detail stays PART's. */
static void part_error(const cJSON *part, const cJSON **detail, struct modal_error *err)
{
    const cJSON *error = cJSON_GetObjectItemCaseSensitive(part, "error");

    wire_error_read(error, err);
    *detail = cJSON_GetObjectItemCaseSensitive(error, "detail");
}

static bool may_come_again(const struct modal_error *why, const cJSON *detail)
{
    return why->status == MODAL_BUSY || why->status == MODAL_DRAINING
           || (why->status == MODAL_QUOTA && cJSON_HasObjectItem(detail, "retry_after_s"));
}

/* A submission is answered: said on stdout, or, where the daemon is full for now, to be sent again
 * after *PAUSE. */
static enum modal_status read_part(struct bulk *b, size_t item, const cJSON *part, double *pause,
                                   struct modal_error *err)
{
    long number = b->items[item].number;
    cJSON *doc;

    if (!cJSON_HasObjectItem(part, "job")) {
        struct modal_error why = { 0 };
        const cJSON *detail;
        part_error(part, &detail, &why);
        if (may_come_again(&why, detail)) {
            *pause = fmax(*pause, client_pause(detail));
            b->again[b->agains++] = item;
            return MODAL_OK;
        }
        b->refused++;
        doc = outcome_error(&why, detail);
    } else {
        doc = cJSON_Duplicate(part, true);
        cJSON_DeleteItemFromObjectCaseSensitive(doc, "id");
        cJSON_DeleteItemFromObjectCaseSensitive(doc, "verb");
        write_accepted(b, &b->items[item]);
        free(b->items[item].job);
        b->items[item].job = strdup(text(doc, "job") ? text(doc, "job") : "");
    }
    cJSON_AddNumberToObject(doc, "line", (double)number);
    enum modal_status rc = outcome_json(doc, err);
    cJSON_Delete(doc);
    b->done++;
    return rc;
}

/* PARTS: the list of SUBMITS's answer; NULL: MESSAGE answers all alike. */
static enum modal_status read_parts(struct bulk *b, struct flight *flight, const cJSON *parts,
                                    const cJSON *message, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;
    double pause = 0;

    for (int i = 0; rc == MODAL_OK && i < flight->count; i++)
        rc = read_part(b, flight->items[i], parts == NULL ? message : cJSON_GetArrayItem(parts, i),
                       &pause, err);
    b->flying -= flight->count;
    flight->count = 0;
    if (pause > 0)
        nanosleep(&(struct timespec) { (time_t)pause, (long)(1e9 * (pause - floor(pause))) }, NULL);
    return rc;
}

static enum modal_status read_answer(struct bulk *b, struct flight *flight,
                                     struct link_message *message, struct modal_error *err)
{
    cJSON *list = NULL;
    enum modal_status rc = MODAL_OK;
    struct modal_error why = { 0 };
    const cJSON *detail;

    if (message->type == LINK_ERROR) {
        part_error(message->header, &detail, &why);
        /* a daemon of before SUBMITS */
        if (why.status == MODAL_UNKNOWN_VERB && b->together > 1) {
            b->together = 1;
            send_again(b, flight);
            return MODAL_OK;
        }
    } else if (flight->count > 1) {
        rc = message->body == NULL
                 ? modal_fail(err, MODAL_BAD_FRAME, "an answer to SUBMITS has no list")
                 : json_read(message->body, message->length, &list, err);
        if (rc == MODAL_OK
            && cJSON_GetArraySize(cJSON_GetObjectItemCaseSensitive(list, "jobs")) != flight->count)
            rc = modal_fail(err, MODAL_BAD_FRAME,
                            "an answer to SUBMITS is not about the jobs asked");
    }
    if (rc == MODAL_OK)
        rc = read_parts(b, flight, cJSON_GetObjectItemCaseSensitive(list, "jobs"), message->header,
                        err);
    cJSON_Delete(list);
    return rc;
}

static enum modal_status land_one(struct bulk *b, double deadline, struct modal_error *err)
{
    struct link_message message;
    enum modal_status rc = link_receive(b->link, fmin(deadline, link_now() + 10), &message, err);

    if (rc == MODAL_NO_SERVER || (rc == MODAL_TIMEOUT && link_now() < deadline)) {
        for (int i = 0; i < FLIGHTS_MOST; i++)
            send_again(b, &b->flights[i]);
        return MODAL_OK;
    }
    if (rc != MODAL_OK)
        return rc;
    for (int i = 0; i < FLIGHTS_MOST; i++)
        if (b->flights[i].count > 0 && b->flights[i].id == link_message_id(&message)) {
            rc = read_answer(b, &b->flights[i], &message, err);
            break;
        }
    link_message_done(&message);
    return rc;
}

static enum modal_status submit_all(struct bulk *b, double deadline, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && b->done < b->count) {
        while (rc == MODAL_OK && b->flying + b->together <= b->window
               && (b->agains > 0 || b->next < b->count))
            rc = send_some(b, deadline, err);
        if (rc == MODAL_OK && b->flying > 0)
            rc = land_one(b, deadline, err);
    }
    return rc;
}

/* Until accepted job I has ended: its document on stdout; *GOOD: it is done. */
static enum modal_status wait_one(struct bulk *b, size_t i, double deadline, bool *good,
                                  struct modal_error *err)
{
    cJSON *doc = NULL;
    enum modal_status rc = client_wait(b->link, b->items[i].job, NULL, deadline, &doc, NULL, err);

    if (rc == MODAL_OK) {
        *good = text(doc, "state") != NULL && strcmp(text(doc, "state"), "done") == 0;
        cJSON_AddNumberToObject(doc, "line", (double)b->items[i].number);
        rc = outcome_json(doc, err);
    }
    cJSON_Delete(doc);
    return rc;
}

/* Until all that was accepted has ended; the exit status of them all into *STATUS. */
static enum modal_status wait_all(struct bulk *b, double deadline, int *status,
                                  struct modal_error *err)
{
    size_t done = 0, others = 0, all = 0;
    enum modal_status rc = MODAL_OK;

    for (size_t i = 0; i < b->count; i++)
        all += b->items[i].job != NULL;
    for (size_t i = 0; rc == MODAL_OK && i < b->count; i++) {
        bool good = false;
        if (b->items[i].job == NULL)
            continue;
        rc = wait_one(b, i, deadline, &good, err);
        done += rc == MODAL_OK && good;
        others += rc == MODAL_OK && !good;
        progress_count("jobs", done + others, all, others);
    }
    if (others > 0 && *status == 0)
        *status = 1;
    if (!b->args->json)
        fprintf(stderr, "%zu done, %zu failed, cancelled or dead\n", done, others);
    return rc;
}

static void bulk_done(struct bulk *b)
{
    for (size_t i = 0; i < b->count; i++) {
        cJSON_Delete(b->items[i].line);
        free(b->items[i].job);
    }
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
    struct accepted skip = { NULL, 0 };
    char *list = NULL;
    size_t length = 0;
    enum modal_status rc;
    int status = 0;

    if (b == NULL)
        return outcome_failure(args->json,
                               &(struct modal_error){ .status = MODAL_NO_MEMORY,
                                                      .message = "no memory" },
                               NULL);
    b->args = args;
    b->window = args->window > 0 ? (int)args->window : WINDOW_DEFAULT;
    b->together = b->window < FLIGHTS_LEAST                   ? 1
                  : b->window / FLIGHTS_LEAST < TOGETHER_MOST ? b->window / FLIGHTS_LEAST
                                                              : TOGETHER_MOST;
    if (b->window > WINDOW_MOST)
        rc = modal_fail_field(&err, MODAL_BAD_INPUT, "window",
                              "--window is %d; accepted: a whole number from 1 to %d", b->window,
                              WINDOW_MOST);
    else
        rc = args->local
                 ? modal_fail_field(&err, MODAL_BAD_INPUT, "local", "--from speaks to a daemon")
                 : open_journal(args, &skip, &b->journal, &err);
    skip.count = args->wait ? 0 : skip.count;
    if (rc == MODAL_OK)
        rc = signals_read_text(args->from, LIST_BYTES_MOST, &list, &length, &err);
    if (rc == MODAL_OK)
        rc = read_items(list, &skip, b, &err);
    if (rc == MODAL_OK && (b->again = calloc(b->count + 1, sizeof *b->again)) == NULL)
        rc = modal_fail(&err, MODAL_NO_MEMORY, "no memory for the list");
    if (rc == MODAL_OK)
        rc = remote_open(args, &b->link, &err);
    if (rc == MODAL_OK)
        rc = submit_all(b, args->wait ? INFINITY : remote_deadline(args), &err);
    if (!args->json)
        fprintf(stderr, "%zu of %zu accepted\n", b->done - (size_t)b->refused, b->count);
    status = b->refused > 0 ? 4 : 0;
    if (rc == MODAL_OK && args->wait)
        rc = wait_all(b, remote_deadline(args), &status, &err);
    if (rc != MODAL_OK)
        status = outcome_failure(args->json, &err, NULL);
    free(list);
    free(skip.hash);
    bulk_done(b);
    return status;
}
