/* pull.c - see pull.h */
#include "worker/pull.h"
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include "base/crc32c.h"

struct pull {
    struct link *link;
    const char *job;
    int attempt;
    struct pulled *out;
    uint64_t asked, received;
    uint64_t *wanted;              /* offsets of the pieces under way */
    int count;
};

static uint64_t piece_size(const struct pull *p, uint64_t offset)
{
    const uint64_t most = (uint64_t)link_chunk(p->link), left = p->out->bytes - offset;

    return left < most ? left : most;
}

/* The next piece is asked for. */
static enum modal_status ask(struct pull *p, struct modal_error *err)
{
    cJSON *header = cJSON_CreateObject();
    const uint64_t size = piece_size(p, p->asked);

    cJSON_AddStringToObject(header, "job", p->job);
    cJSON_AddNumberToObject(header, "attempt", p->attempt);
    cJSON_AddNumberToObject(header, "offset", (double)p->asked);
    cJSON_AddNumberToObject(header, "length", (double)size);
    p->wanted[p->count++] = p->asked;
    p->asked += size;
    return link_send(p->link, "INPUT", header, NULL, 0, err);
}

/* Whether MESSAGE is for this attempt, as one for an earlier one may still come. */
static bool is_ours(const struct pull *p, const struct wire_message *message)
{
    const char *job = "";
    int attempt = -1;

    json_get_string(message->header, "", "job", &job, NULL);
    json_get_int(message->header, "", "attempt", 0, INT32_MAX, &attempt, NULL);
    return strcmp(message->verb, "CHUNK") == 0 && strcmp(job, p->job) == 0 && attempt == p->attempt;
}

/* The place of OFFSET among those under way, which it leaves; false: it was not asked for. */
static bool take_out(struct pull *p, uint64_t offset)
{
    for (int i = 0; i < p->count; i++)
        if (p->wanted[i] == offset) {
            p->wanted[i] = p->wanted[--p->count];
            return true;
        }
    return false;
}

static enum modal_status put_chunk(struct pull *p, const struct wire_message *message,
                                   struct modal_error *err)
{
    const cJSON *error = cJSON_GetObjectItemCaseSensitive(message->header, "error");
    double offset = 0, crc = 0;
    enum modal_status rc = json_need_number(message->header, "", "offset", 0, WIRE_INTEGER_MOST,
                                            &offset, err);

    if (rc == MODAL_OK && error != NULL) {
        wire_error_read(error, err);
        return err->status != MODAL_OK ? err->status : MODAL_INTERNAL;
    }
    if (rc == MODAL_OK)
        rc = json_need_number(message->header, "", "crc32c", 0, UINT32_MAX, &crc, err);
    if (rc != MODAL_OK)
        return rc;
    if (!take_out(p, (uint64_t)offset)
        || message->body_bytes != piece_size(p, (uint64_t)offset))
        return modal_fail(err, MODAL_BAD_FRAME, "worker: a piece of the input that was not asked "
                          "for, at %.0f", offset);
    wire_gather(message, (char *)p->out->data + (uint64_t)offset, message->body_bytes);
    if (crc32c(0, (char *)p->out->data + (uint64_t)offset, message->body_bytes) != (uint32_t)crc)
        return modal_fail_field(err, MODAL_CORRUPT, "input",
                                "the checksum of the input's piece at %.0f is wrong", offset);
    p->received += message->body_bytes;
    return MODAL_OK;
}

static enum modal_status pull_all(struct pull *p, struct modal_error *err)
{
    const struct wire_message *message;
    enum modal_status rc = MODAL_OK;

    while (rc == MODAL_OK && p->received < p->out->bytes) {
        while (rc == MODAL_OK && p->asked < p->out->bytes && p->count < link_credit(p->link))
            rc = ask(p, err);
        if (rc == MODAL_OK)
            rc = link_receive(p->link, &message, err);
        if (rc == MODAL_OK && is_ours(p, message))
            rc = put_chunk(p, message, err);
    }
    return rc;
}

enum modal_status pull_input(struct link *link, const char *job, int attempt, uint64_t bytes,
                             uint32_t crc, struct pulled *out, struct modal_error *err)
{
    struct pull p = { .link = link, .job = job, .attempt = attempt, .out = out };
    enum modal_status rc;

    out->bytes = bytes;
    out->data = mmap(NULL, bytes + 1, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    p.wanted = calloc((size_t)link_credit(link), sizeof *p.wanted);
    if (out->data == MAP_FAILED || p.wanted == NULL) {
        out->data = out->data == MAP_FAILED ? NULL : out->data;
        rc = modal_fail(err, MODAL_NO_MEMORY, "worker: no memory for an input of %llu bytes",
                        (unsigned long long)bytes);
    } else
        rc = pull_all(&p, err);
    if (rc == MODAL_OK && crc32c(0, out->data, bytes) != crc)
        rc = modal_fail_field(err, MODAL_CORRUPT, "input", "the input's checksum is wrong");
    free(p.wanted);
    if (rc != MODAL_OK)
        pull_done(out);
    return rc;
}

void pull_done(struct pulled *pulled)
{
    if (pulled->data != NULL)
        munmap(pulled->data, pulled->bytes + 1);
    *pulled = (struct pulled) { 0 };
}
