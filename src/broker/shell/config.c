/*
 * config.c - see config.h
 *
 * The keys file has one line a key:
 *
 *     PUBLIC-KEY  USER  ROLE  [weight=2] [queued=1000] [running=4] [bytes=10G] [cpu_s_day=3600]
 *                             [upload_bytes_s=50M]
 *
 * ROLE is read, submit, admin or worker; several keys may name one user, whose limits are then
 * those of the last line.
 */
#include "broker/shell/config.h"
#include "base/near.h"
#include "base/machine.h"
#include "broker/kit/map.h"
#include "store/file.h"
#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#define DAY_NS (86400 * INT64_C(1000000000))   /* of UTC, which has no leap seconds here */
#define WORKERS_MOST 256         /* as the pool has slots */
#define SOCKET_PATH_MOST 107     /* bytes of sun_path but its end (unix(7)) */
#define RUNTIME_ROOM 80          /* of that, chosen: with "/modald/modald.ipc", 18, it fits */
#define FILE_MOST 1048576        /* bytes of a file: keys of 10,000 users, 100 bytes each */
#define LIMIT_MOST 1e15          /* a double below has all whole numbers, and bytes of a petabyte */
#define NOT_SAID (-1)   /* of settings that are 0 or more */
#define PORT_MOST 65535          /* 16 bits, RFC 9293 */
#define NANOSECOND 1e-9          /* s */

enum kind { TEXT, COUNT, BYTES, SECONDS, NANOSECONDS, MODE, SWITCH, BIND, ENTRY };

/* Every key of the file, its place and its range. */
static const struct row {
    const char *key;
    enum kind kind;
    size_t at;
    double low, high;
} rows[] = {
    { "data", TEXT, offsetof(struct config, data), 0, 0 },
    { "bind", BIND, 0, 0, 0 },
    { "worker_bind", ENTRY, 0, 0, 0 },
    { "workers", COUNT, offsetof(struct config, workers), 0, 256 },
    { "worker_jobs", BYTES, offsetof(struct config, settings.worker_jobs), 0, 1e15 },
    { "spool_threads", COUNT, offsetof(struct config, spool_threads), 1, 16 },
    { "connections", COUNT, offsetof(struct config, connections), 0, 65536 },
    { "ipc_mode", MODE, offsetof(struct config, ipc_mode), 0, 0777 },
    { "worker_path", TEXT, offsetof(struct config, worker_path), 0, 0 },
    { "worker_user", TEXT, offsetof(struct config, worker_user), 1, 0 },
    { "worker_memory", BYTES, offsetof(struct config, settings.worker_memory), 0, 1e15 },
    { "sandbox", SWITCH, offsetof(struct config, sandbox), 0, 0 },
    { "server_key", TEXT, offsetof(struct config, server_key), 0, 0 },
    { "keys", TEXT, offsetof(struct config, keys), 0, 0 },
    { "metrics_file", TEXT, offsetof(struct config, metrics_file), 0, 0 },
    { "metrics_s", SECONDS, offsetof(struct config, metrics_s), 0.1, 3600 },
    { "drain_s", SECONDS, offsetof(struct config, drain_s), 0, 86400 },
    { "queue_jobs", BYTES, offsetof(struct config, settings.queue_jobs), 1, 1e8 },
    { "input_bytes", BYTES, offsetof(struct config, settings.input_bytes), 1, 1e15 },
    { "window_bytes", BYTES, offsetof(struct config, settings.window_bytes), 262144, 1e12 },
    { "result_bytes", BYTES, offsetof(struct config, settings.result_bytes), 0, 1e15 },
    { "events_kept", BYTES, offsetof(struct config, settings.events_kept), 1024, 1e9 },
    { "jobs_kept", BYTES, offsetof(struct config, settings.jobs_kept), 1000, 1e9 },
    { "lease_s", NANOSECONDS, offsetof(struct config, settings.lease_ns), 0.5, 3600 },
    { "windows_elsewhere_s", NANOSECONDS, offsetof(struct config, settings.windows_elsewhere_ns), 0,
      60 },
    { "run_limit_s", NANOSECONDS, offsetof(struct config, settings.run_limit_ns), 0, 1e8 },
    { "result_age_s", NANOSECONDS, offsetof(struct config, settings.result_age_ns), 1, 3e9 },
    { "input_age_s", NANOSECONDS, offsetof(struct config, settings.input_age_ns), 1, 3e9 },
    { "tombstone_age_s", NANOSECONDS, offsetof(struct config, settings.tombstone_age_ns), 1, 3e9 },
    { "upload_idle_s", NANOSECONDS, offsetof(struct config, settings.upload_idle_ns), 1, 3e9 },
};

enum { ROWS = sizeof rows / sizeof *rows };

void config_init(struct config *c)
{
    long cores = sysconf(_SC_NPROCESSORS_ONLN);

    memset(c, 0, sizeof *c);
    c->workers = cores > 1 ? (int)cores - (cores > 2) : 1;
    if (c->workers > WORKERS_MOST)
        c->workers = WORKERS_MOST;
    c->spool_threads = 3;
    c->ipc_mode = -1;
    c->sandbox = true;
    c->drain_s = 60;
    c->metrics_s = 10;
    c->settings = (struct settings) { .cores = cores > 1 ? (int)cores : 1, .worker_jobs = 10000,
        .queue_jobs = 100000, .input_bytes = INT64_C(16) << 30, .window_bytes = 64 << 20,
        .lease_ns = 10 * INT64_C(1000000000), .run_limit_ns = NOT_SAID, .worker_memory = NOT_SAID,
        .result_age_ns = 30 * DAY_NS, .input_age_ns = DAY_NS, .tombstone_age_ns = 365 * DAY_NS,
        .upload_idle_ns = DAY_NS, .result_bytes = INT64_C(10) << 30, .events_kept = 100000,
        .jobs_kept = 1000000 };
}

void config_done(struct config *c)
{
    free(c->accounts);
    c->accounts = NULL;
    c->account_count = 0;
}

/* A number with an optional suffix k, M, G, T (1024 each); NaN where it is none. */
static double quantity(const char *text)
{
    static const char suffixes[] = "kMGT";
    char *end;
    double value = strtod(text, &end);
    const char *suffix = *end != 0 && end != text ? strchr(suffixes, *end) : NULL;

    if (end == text || (suffix == NULL && *end != 0) || (suffix != NULL && end[1] != 0))
        return NAN;
    for (long i = suffix == NULL ? -1 : suffix - suffixes; i >= 0; i--)
        value *= 1024;
    return value;
}

static enum modal_status set_text(char *place, size_t room, const char *key, const char *value,
                                  struct modal_error *err)
{
    if (strlen(value) >= room)
        return modal_fail_field(err, MODAL_BAD_INPUT, key,
                                "%s has %zu bytes; accepted: at most %zu", key, strlen(value),
                                room - 1);
    strcpy(place, value);
    return MODAL_OK;
}

static enum modal_status set_number(char *place, const struct row *row, const char *value,
                                    struct modal_error *err)
{
    bool octal = row->kind == MODE && value[0] != 0 && value[strspn(value, "01234567")] == 0;
    double x = octal ? (double)strtol(value, NULL, 8) : row->kind == MODE ? NAN : quantity(value);

    if (row->kind == NANOSECONDS && x > 0 && x < NANOSECOND)   /* it would be 0: no limit */
        return modal_fail_field(err, MODAL_BAD_INPUT, row->key,
                                "%s is \"%.60s\", less than a nanosecond; accepted: from %.15g to "
                                "%.15g", row->key, value, fmax(row->low, NANOSECOND), row->high);
    if (!(x >= row->low && x <= row->high)
        || (row->kind != SECONDS && row->kind != NANOSECONDS && x != floor(x)))
        return modal_fail_field(err, MODAL_BAD_INPUT, row->key,
                                "%s is \"%.60s\"; accepted: %s from %.15g to %.15g", row->key,
                                value,
                                row->kind == MODE ? "an octal number, in decimal" : "a number",
                                row->low, row->high);
    if (row->kind == COUNT || row->kind == MODE)
        *(int *)(void *)place = (int)x;
    else if (row->kind == BYTES)
        *(int64_t *)(void *)place = (int64_t)x;
    else if (row->kind == NANOSECONDS)
        *(int64_t *)(void *)place = (int64_t)(x * 1e9);
    else
        *(double *)(void *)place = x;
    return MODAL_OK;
}

static enum modal_status add_endpoint(char list[BINDS_MOST][PATH_ROOM], int *count,
                                      const char *key, const char *value, struct modal_error *err)
{
    if (*count == BINDS_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, key, "more than %d endpoints", BINDS_MOST);
    return set_text(list[(*count)++], PATH_ROOM, key, value, err);
}

static int find_row(const char *key)
{
    for (int i = 0; i < ROWS; i++)
        if (strcmp(rows[i].key, key) == 0)
            return i;
    return -1;
}

enum modal_status config_set(struct config *c, const char *key, const char *value,
                             struct modal_error *err)
{
    const char *names[ROWS + 1] = { NULL };
    char list[NEAR_ACCEPTED];
    int at = find_row(key);

    if (at < 0) {
        for (int i = 0; i < ROWS; i++)
            names[i] = rows[i].key;
        near_accepted(key, names, list);
        return modal_fail_field(err, MODAL_BAD_INPUT, key, "unknown key \"%.60s\"%s", key, list);
    }
    char *place = (char *)c + rows[at].at;
    switch (rows[at].kind) {
    case BIND: return add_endpoint(c->bind, &c->bind_count, key, value, err);
    case ENTRY: return add_endpoint(c->worker_bind, &c->worker_bind_count, key, value, err);
    case TEXT:
        return set_text(place, rows[at].low > 0 ? sizeof c->worker_user : PATH_ROOM, key, value,
                        err);
    case SWITCH:
        if (strcmp(value, "on") != 0 && strcmp(value, "off") != 0)
            return modal_fail_field(err, MODAL_BAD_INPUT, key,
                                    "%s is \"%.60s\"; accepted: on, off", key, value);
        *(bool *)place = strcmp(value, "on") == 0;
        return MODAL_OK;
    default: return set_number(place, &rows[at], value, err);
    }
}

/* ---- files ----------------------------------------------------------------------------------- */

static char *trim(char *text)
{
    char *end;

    while (isspace((unsigned char)*text))
        text++;
    end = text + strlen(text);
    while (end > text && isspace((unsigned char)end[-1]))
        *--end = 0;
    return text;
}

/* A whole file of text; the caller frees it.  A zero byte, as a crash leaves them in a file that
 * was not synced, would hide what follows. */
static enum modal_status get_text(const char *file, const char *field, char **text, size_t *length,
                                  struct modal_error *err)
{
    struct modal_error why;

    *text = NULL;
    if (file_get(file, FILE_MOST, text, length, &why) != MODAL_OK)
        return modal_fail_field(err, MODAL_BAD_INPUT, field, "%s", why.message);
    if (strlen(*text) == *length)
        return MODAL_OK;
    modal_fail_field(err, MODAL_BAD_INPUT, field, "%s has a zero byte at %zu; accepted: text", file,
                     strlen(*text));
    explicit_bzero(*text, *length);
    free(*text);
    *text = NULL;
    return MODAL_BAD_INPUT;
}

/* The next line of *AT without its comment, trimmed; NULL at the end. */
static char *next_line(char **at, int *number)
{
    char *line = *at, *end;

    if (line == NULL || *line == 0)
        return NULL;
    end = strchr(line, '\n');
    *at = end == NULL ? NULL : end + 1;
    if (end != NULL)
        *end = 0;
    if (strchr(line, '#') != NULL)
        *strchr(line, '#') = 0;
    ++*number;
    return trim(line);
}

/* key = value, the value perhaps in quotes; false: neither. */
static bool split(char *line, char **key, char **value)
{
    char *equals = strchr(line, '=');
    size_t length;

    if (equals == NULL)
        return false;
    *equals = 0;
    *key = trim(line);
    *value = trim(equals + 1);
    length = strlen(*value);
    if (length >= 2 && (*value)[0] == '"' && (*value)[length - 1] == '"') {
        (*value)[length - 1] = 0;
        ++*value;
    }
    return true;
}

/* The KEY of line NUMBER is in LINES, but it may stand in several; else the later one would be
 * taken without a word. */
static enum modal_status check_first(int lines[ROWS], const char *key, int number,
                                     struct modal_error *err)
{
    int row = find_row(key);

    if (row < 0 || rows[row].kind == BIND || rows[row].kind == ENTRY)
        return MODAL_OK;
    if (lines[row] > 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, key, "%s stands in line %d too; accepted: "
                                "once", key, lines[row]);
    lines[row] = number;
    return MODAL_OK;
}

enum modal_status config_read(struct config *c, const char *file, struct modal_error *err)
{
    char *text, *at, *line, *key, *value;
    size_t length;
    int number = 0, lines[ROWS] = { 0 };
    bool first_bind = true;
    struct modal_error why;
    enum modal_status rc = get_text(file, "config", &text, &length, err);

    if (rc != MODAL_OK)
        return rc;
    snprintf(c->file, sizeof c->file, "%s", file);
    at = text;
    if (strncmp(at, "\xef\xbb\xbf", 3) == 0)       /* which editors put before UTF-8 */
        at += 3;
    while (rc == MODAL_OK && (line = next_line(&at, &number)) != NULL) {
        if (*line == 0)
            continue;
        if (!split(line, &key, &value)) {
            rc = modal_fail_field(err, MODAL_BAD_INPUT, "config", "%s:%d: not a line `key = value`",
                                  file, number);
            break;
        }
        if (strcmp(key, "bind") == 0 && first_bind) {
            c->bind_count = 0;                     /* the file's endpoints, not the ones before */
            first_bind = false;
        }
        rc = check_first(lines, key, number, &why);
        if (rc == MODAL_OK)
            rc = config_set(c, key, value, &why);
        if (rc != MODAL_OK)
            modal_fail_field(err, rc, why.field, "%s:%d: %s", file, number, why.message);
    }
    free(text);
    return rc;
}

/* A file with keys must be the owner's alone. */
static enum modal_status check_private(const char *file, struct modal_error *err)
{
    struct stat st;

    if (stat(file, &st) != 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "keys", "%s: %s", file, strerror(errno));
    if ((st.st_mode & 077) != 0)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "keys",
            "%s has mode %04o; accepted: 0600 or less, for nobody but its owner", file,
            (unsigned)st.st_mode & 07777);
    return MODAL_OK;
}

static bool is_z85(const char *text)
{
    static const char signs[] =
        "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#";

    return strlen(text) == 40 && strspn(text, signs) == 40;
}

static bool set_limit(struct account *a, const char *word)
{
    const struct { const char *name; int64_t *count; double *number, least, most;
    } limits[] = {
        { "weight", NULL, &a->weight, 1e-3, 1e3 },
        { "queued", &a->most.queued, NULL, 1, LIMIT_MOST },
        { "running", &a->most.running, NULL, 1, LIMIT_MOST },
        { "bytes", &a->most.bytes, NULL, 1, LIMIT_MOST },
        { "cpu_s_day", NULL, &a->most.cpu_s_day, 1e-9, LIMIT_MOST },
        { "upload_bytes_s", NULL, &a->most.upload_bytes_s, 1e-3, LIMIT_MOST },
    };
    const char *equals = strchr(word, '=');
    double value = equals == NULL ? NAN : quantity(equals + 1);

    for (size_t i = 0; equals != NULL && i < sizeof limits / sizeof *limits; i++)
        if (strlen(limits[i].name) == (size_t)(equals - word)
            && strncmp(limits[i].name, word, (size_t)(equals - word)) == 0) {
            if (!(value >= limits[i].least && value <= limits[i].most)
                || (limits[i].count != NULL && value != floor(value)))
                return false;
            if (limits[i].count != NULL)
                *limits[i].count = (int64_t)value;
            else
                *limits[i].number = value;
            return true;
        }
    return false;
}

static bool is_key(const void *value, const void *key)
{
    return strcmp(value, key) == 0;
}

/* KEY of line NUMBER is none of those MET, and is one of them then: else a user had the rights of
 * another's line. */
static enum modal_status meet_key(const struct config *c, struct map *met, char *key,
                                  const char *file, int number, struct modal_error *err)
{
    uint64_t hash = map_hash_text(key);
    size_t i = 0;

    if (map_find(met, hash, is_key, key) == NULL)
        return map_put(met, hash, key) ? MODAL_OK : modal_fail(err, MODAL_NO_MEMORY,
                                                               "out of memory");
    while (i + 1 < c->account_count && strcmp(c->accounts[i].key, key) != 0)
        i++;
    return modal_fail_field(err, MODAL_BAD_INPUT, "keys", "%s:%d: the key of user \"%s\" stands "
                            "here again; accepted: one line a key", file, number,
                            c->accounts[i].user);
}

/* The line's comment sign may be part of a key: keys come first, so the comment is cut after
 * them only.  MET: the keys of the lines before. */
static enum modal_status read_key(struct config *c, char *line, struct map *met, const char *file,
                                  int number, struct modal_error *err)
{
    struct account account = { .weight = 1 }, *all;
    char *rest, *word = strtok_r(line, " \t\r", &rest), list[NEAR_ACCEPTED];
    int role = 0;

    if (word == NULL || (word[0] == '#' && !is_z85(word)))
        return MODAL_OK;
    if (!is_z85(word))
        return modal_fail_field(err, MODAL_BAD_INPUT, "keys",
                                "%s:%d: the first word is not a public key of 40 signs", file,
                                number);
    strcpy(account.key, word);
    enum modal_status rc = meet_key(c, met, word, file, number, err);
    if (rc != MODAL_OK)
        return rc;
    word = strtok_r(NULL, " \t\r", &rest);
    if (word == NULL || strlen(word) >= NAME_MOST || strpbrk(word, "\"\\=") != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, "keys",
                                "%s:%d: the second word is not a user's name", file, number);
    strcpy(account.user, word);
    word = strtok_r(NULL, " \t\r", &rest);
    while (word != NULL && wire_roles[role] != NULL && strcmp(wire_roles[role], word) != 0)
        role++;
    if (word == NULL || wire_roles[role] == NULL || role == WIRE_ROLE_NONE) {
        near_accepted(word != NULL ? word : "", &wire_roles[WIRE_ROLE_READ], list);
        return modal_fail_field(err, MODAL_BAD_INPUT, "keys",
                                "%s:%d: the third word is not a role%s", file, number, list);
    }
    account.role = (enum wire_role)role;
    while ((word = strtok_r(NULL, " \t\r", &rest)) != NULL && word[0] != '#')
        if (!set_limit(&account, word))
            return modal_fail_field(
                err, MODAL_BAD_INPUT, "keys",
                "%s:%d: \"%.40s\"; accepted: weight from 0.001 to 1000, queued, running, bytes "
                "whole and "
                "cpu_s_day, upload_bytes_s any numbers above 0 up to 1e15, each as name=NUMBER",
                file, number, word);
    all = realloc(c->accounts, (c->account_count + 1) * sizeof *all);
    if (all == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "out of memory");
    c->accounts = all;
    all[c->account_count++] = account;
    return MODAL_OK;
}

static enum modal_status read_keys(struct config *c, struct modal_error *err)
{
    char *text = NULL, *line, *rest;
    struct map met = { 0 };
    size_t length;
    int number = 0;
    enum modal_status rc = check_private(c->keys, err);

    if (rc != MODAL_OK)
        return rc;
    rc = get_text(c->keys, "keys", &text, &length, err);
    if (rc != MODAL_OK)
        return rc;
    for (line = text; rc == MODAL_OK && line != NULL; line = rest) {
        rest = strchr(line, '\n');
        if (rest != NULL)
            *rest++ = 0;
        rc = read_key(c, line, &met, c->keys, ++number, err);
    }
    map_done(&met);
    free(text);
    return rc;
}

enum modal_status config_server_keys(const struct config *c, char public[41], char secret[41],
                                     struct modal_error *err)
{
    char *text = NULL, *at, *line, *key, *value;
    size_t length;
    enum modal_status rc = check_private(c->server_key, err);

    public[0] = secret[0] = 0;
    if (rc != MODAL_OK)
        return rc;
    rc = get_text(c->server_key, "server_key", &text, &length, err);
    if (rc != MODAL_OK)
        return rc;
    for (at = text; at != NULL; at = line) {
        line = strchr(at, '\n');
        if (line != NULL)
            *line++ = 0;
        if (trim(at)[0] == '#' || !split(trim(at), &key, &value) || !is_z85(value))
            continue;
        if (strcmp(key, "public-key") == 0)
            strcpy(public, value);
        if (strcmp(key, "secret-key") == 0)
            strcpy(secret, value);
    }
    explicit_bzero(text, length);
    free(text);
    if (public[0] == 0 || secret[0] == 0)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "server_key",
            "%s has no lines public-key = \"...\" and secret-key = \"...\" of 40 signs",
            c->server_key);
    return MODAL_OK;
}

/* ---- what belongs together ------------------------------------------------------------------- */

/* Where ENDPOINT ends in a port that there is, or `*`: else libzmq takes one modulo 65536. */
static bool has_port(const char *endpoint)
{
    const char *port = strrchr(endpoint, ':') + 1;
    size_t digits = strspn(port, "0123456789");

    if (strcmp(port, "*") == 0)
        return true;
    return digits > 0 && port[digits] == 0 && strtod(port, NULL) <= PORT_MOST;
}

static bool is_loopback(const char *endpoint)
{
    return strncmp(endpoint, "tcp://127.", 10) == 0 || strncmp(endpoint, "tcp://[::1]:", 12) == 0
        || strncmp(endpoint, "tcp://localhost:", 16) == 0;
}

static enum modal_status check_bind(const char *endpoint, bool keys, struct modal_error *err)
{
    bool ipc = strncmp(endpoint, "ipc://", 6) == 0, tcp = strncmp(endpoint, "tcp://", 6) == 0;

    if (!ipc && (!tcp || !has_port(endpoint)))
        return modal_fail_field(err, MODAL_BAD_INPUT, "bind",
                                "\"%.200s\"; accepted: ipc://PATH, tcp://HOST:PORT with a port "
                                "from 0 to 65535, or * for any", endpoint);
    if (ipc && strlen(endpoint) - 6 > SOCKET_PATH_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "bind",
                                "\"%.200s\": the path of a socket has at most 107 bytes", endpoint);
    if (tcp && !keys && !is_loopback(endpoint))
        return modal_fail_field(err, MODAL_BAD_INPUT, "bind",
                                "\"%.200s\": without keys everyone who reaches the port could do "
                                "everything; accepted without keys: "
                                "ipc://PATH, tcp://127.0.0.1:PORT, tcp://[::1]:PORT (for others "
                                "set server_key and keys)",
                                endpoint);
    return MODAL_OK;
}

/* Over TCP alone: on this host the daemon starts its workers itself. */
static enum modal_status check_worker_bind(const char *endpoint, bool keys,
                                           struct modal_error *err)
{
    if (strncmp(endpoint, "tcp://", 6) != 0 || !has_port(endpoint))
        return modal_fail_field(err, MODAL_BAD_INPUT, "worker_bind",
                                "\"%.200s\"; accepted: tcp://HOST:PORT with a port from 0 to "
                                "65535, or * for any", endpoint);
    if (!keys)
        return modal_fail_field(err, MODAL_BAD_INPUT, "worker_bind",
                                "\"%.200s\": without keys everyone who reaches the port would be "
                                "given jobs and believed; accepted: with server_key and keys",
                                endpoint);
    return MODAL_OK;
}

/* It is written over every metrics_s seconds: nothing else may lie there. */
static enum modal_status check_metrics(const char *file, struct modal_error *err)
{
    static const char first[] = "# HELP modald_";
    struct modal_error why;
    char begin[sizeof first];
    size_t got = 0;
    int fd = -1;
    enum modal_status rc = file_open(file, O_RDONLY, 0, &fd, &why);

    if (rc == MODAL_NOT_FOUND)
        return MODAL_OK;
    if (rc == MODAL_OK) {
        rc = file_read(fd, begin, sizeof first - 1, 0, &got, &why);
        close(fd);
    }
    if (rc != MODAL_OK)
        return modal_fail_field(err, MODAL_BAD_INPUT, "metrics_file", "%s", why.message);
    if (got > 0 && (got < sizeof first - 1 || memcmp(begin, first, got) != 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "metrics_file", "%s has something else in "
                                "it, which would be lost; accepted: no file, an empty one, or "
                                "one with modald's metrics", file);
    return MODAL_OK;
}

static enum modal_status default_bind(struct config *c, struct modal_error *err)
{
    const char *runtime = getenv("XDG_RUNTIME_DIR");
    char folder[PATH_ROOM - 32];

    if (runtime != NULL && runtime[0] == '/' && strlen(runtime) < RUNTIME_ROOM)
        snprintf(folder, sizeof folder, "%s/modald", runtime);
    else
        snprintf(folder, sizeof folder, "/run/modald");
    if (mkdir(folder, 0755) != 0 && errno != EEXIST)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "bind",
            "no endpoint was named and the default's folder %s cannot be made: %s", folder,
            strerror(errno));
    snprintf(c->bind[0], PATH_ROOM, "ipc://%s/modald.ipc", folder);
    c->bind_count = 1;
    return MODAL_OK;
}

/* Who was put into the group modald may use its daemon; a daemon of one's own is its user's
 * alone. */
static int default_ipc_mode(void)
{
    const struct group *group = getgrgid(getegid());

    return group != NULL && strcmp(group->gr_name, "modald") == 0 ? 0660 : 0600;
}

enum modal_status config_finish(struct config *c, struct modal_error *err)
{
    bool keys = c->server_key[0] != 0 || c->keys[0] != 0;
    enum modal_status rc = MODAL_OK;

    config_done(c);
    if (c->data[0] == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "data",
                                "no data folder: --data DIR, or --config FILE with a "
                                "line `data = DIR`");
    if (keys && (c->server_key[0] == 0 || c->keys[0] == 0))
        return modal_fail_field(err, MODAL_BAD_INPUT, "keys",
                                "server_key and keys belong together; one is missing");
    if (c->ipc_mode < 0)
        c->ipc_mode = default_ipc_mode();
    if (c->bind_count == 0)
        rc = default_bind(c, err);
    for (int i = 0; rc == MODAL_OK && i < c->bind_count; i++)
        rc = check_bind(c->bind[i], keys, err);
    for (int i = 0; rc == MODAL_OK && i < c->worker_bind_count; i++)
        rc = check_worker_bind(c->worker_bind[i], keys, err);
    if (rc == MODAL_OK && c->metrics_file[0] != 0)
        rc = check_metrics(c->metrics_file, err);
    if (rc == MODAL_OK && keys)
        rc = read_keys(c, err);
    if (rc != MODAL_OK)
        return rc;
    if (!keys) {                                   /* who can open the socket is the one user */
        c->accounts = calloc(1, sizeof *c->accounts);
        if (c->accounts == NULL)
            return modal_fail(err, MODAL_NO_MEMORY, "out of memory");
        c->accounts[0] = (struct account) { .user = "local", .role = WIRE_ROLE_ADMIN, .weight = 1 };
        c->account_count = 1;
    }
    /* One user's jobs are his own affair; of many, none takes what is the others'. */
    if (c->settings.worker_memory == NOT_SAID)
        c->settings.worker_memory = keys ? machine_worker_memory(machine_memory(), c->workers) : 0;
    if (c->settings.run_limit_ns == NOT_SAID)
        c->settings.run_limit_ns = keys ? DAY_NS : 0;
    c->settings.accounts = c->accounts;
    c->settings.account_count = c->account_count;
    c->settings.workers = c->workers;
    return MODAL_OK;
}
