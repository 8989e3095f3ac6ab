/* outcome.c - see outcome.h */
#include "outcome.h"
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum modal_status outcome_json(const cJSON *document, struct modal_error *err)
{
    char *text = json_print(document);
    bool written = text != NULL && puts(text) != EOF && fflush(stdout) == 0;

    if (text == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "no memory to print the answer");
    free(text);
    return written ? MODAL_OK
                   : modal_fail(err, MODAL_IO, "stdout: the answer could not be written");
}

cJSON *outcome_error(const struct modal_error *err, const cJSON *detail)
{
    cJSON *document = cJSON_CreateObject(), *error = cJSON_AddObjectToObject(document, "error");

    cJSON_AddStringToObject(error, "code", modal_status_code(err->status));
    cJSON_AddStringToObject(error, "message", err->message);
    if (err->field[0] != 0)
        cJSON_AddStringToObject(error, "field", err->field);
    if (detail != NULL)
        cJSON_AddItemToObject(error, "detail", cJSON_Duplicate(detail, true));
    return document;
}

/* Does the text begin with the field that it is about, as most do? */
static bool names_field(const struct modal_error *err)
{
    size_t n = strlen(err->field);

    return strncmp(err->message, err->field, n) == 0
        && (err->message[n] == ' ' || err->message[n] == ':');
}

int outcome_failure(bool json, const struct modal_error *err, const cJSON *detail)
{
    cJSON *document = outcome_error(err, detail);

    if (json)
        outcome_json(document, NULL);
    else if (err->field[0] != 0 && !names_field(err))
        fprintf(stderr, "modalctl: %s: %s: %s\n", modal_status_code(err->status), err->field,
                err->message);
    else
        fprintf(stderr, "modalctl: %s: %s\n", modal_status_code(err->status), err->message);
    cJSON_Delete(document);
    return modal_status_exit(err->status);
}

static const bool *as_json;

static void *allocate_or_end(size_t size)
{
    void *block = malloc(size);

    if (block != NULL)
        return block;
    if (*as_json)
        puts("{\"error\":{\"code\":\"no_memory\",\"message\":\"no memory for a document\"}}");
    else
        fputs("modalctl: no_memory: no memory for a document\n", stderr);
    exit(modal_status_exit(MODAL_NO_MEMORY));
}

void outcome_begin(const bool *json)
{
    as_json = json;
    json_memory_by(allocate_or_end);
    for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; fd++)
        if (fcntl(fd, F_GETFD) < 0 && errno == EBADF
            && open("/dev/null", fd == STDIN_FILENO ? O_WRONLY : O_RDONLY) != fd)
            _exit(modal_status_exit(MODAL_IO));
}

/* Whoever read it has gone, having had enough. */
static bool was_enough(void)
{
    struct pollfd out = { .fd = STDOUT_FILENO, .events = POLLOUT };

    return poll(&out, 1, 0) == 1 && (out.revents & POLLERR) != 0;
}

int outcome_end(int status)
{
    struct modal_error err;
    int lost;

    if ((fflush(stdout) == 0 && !ferror(stdout)) || was_enough())
        return status;
    modal_fail(&err, MODAL_IO, "stdout: not all of the answer could be written");
    lost = outcome_failure(false, &err, NULL);
    return status != 0 ? status : lost;
}
