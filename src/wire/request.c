/* request.c - see request.h; one row a verb: its name, who may ask, its keys, its reader */
#include "wire/request.h"
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/json.h"
#include "base/utf8.h"
#include "wire/frame.h"
#include "wire/protocol.h"
#include "wire/pushes.h"

static const char *const wire_contents[] = { "batch", "scene", NULL };
const char *const wire_parts[] = { "document", "batch", "input", "stderr", NULL };
static const char *const wire_states[] = {
    "queued", "running", "done", "failed", "cancelled", "dead", NULL
};
const char *const wire_roles[] = { "none", "read", "submit", "admin", "worker", NULL };

#define DESCRIPTION "samples", "channels", "dt", "period", "names", "units", "attributes", "bytes"

static enum modal_status get_integer(const cJSON *object, const char *base, const char *key,
                                     uint64_t low, double high, bool needed, uint64_t *out,
                                     struct modal_error *err)
{
    char path[128];
    double value = (double)*out;
    enum modal_status rc = needed
                               ? json_need_number(object, base, key, (double)low, high, &value, err)
                               : json_get_number(object, base, key, (double)low, high, &value, err);

    if (rc == MODAL_OK && value != floor(value)) {
        json_path(path, base, key);
        rc = modal_fail_field(err, MODAL_BAD_INPUT, path, "%s is %g; accepted: a whole number",
                              path, value);
    }
    if (rc == MODAL_OK)
        *out = (uint64_t)value;
    return rc;
}

/* A text of LOW to HIGH bytes without control characters; absent is allowed and leaves *OUT. */
static enum modal_status get_text(const cJSON *object, const char *base, const char *key,
                                  size_t low, size_t high, const char **out,
                                  struct modal_error *err)
{
    const char *text = NULL, *p;
    char path[128];
    enum modal_status rc = json_get_string(object, base, key, &text, err);

    if (rc != MODAL_OK || text == NULL)
        return rc;
    p = utf8_control(text);
    if (*p == 0 && (size_t)(p - text) >= low && (size_t)(p - text) <= high) {
        *out = text;
        return MODAL_OK;
    }
    json_path(path, base, key);
    if (strlen(text) < low || strlen(text) > high)
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "%s has %zu bytes; accepted: %zu to %zu", path, strlen(text), low,
                                high);
    return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s has a control character at byte %td; "
                            "accepted: text without", path, p - text);
}

static enum modal_status need_text(const cJSON *object, const char *key, size_t high,
                                   const char **out, struct modal_error *err)
{
    enum modal_status rc;

    *out = NULL;
    rc = get_text(object, "", key, 1, high, out, err);
    if (rc == MODAL_OK && *out == NULL)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, key,
                              "%s is missing; accepted: a text of 1 to %zu bytes", key, high);
    return rc;
}

static enum modal_status get_hash(const cJSON *object, const char *base, const char **out,
                                  struct modal_error *err)
{
    char path[128];
    enum modal_status rc = json_get_string(object, base, "sha256", out, err);

    if (rc != MODAL_OK || *out == NULL)
        return rc;
    json_path(path, base, "sha256");
    if (strlen(*out) != 64 || strspn(*out, "0123456789abcdef") != 64)
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "%s is not a hash; accepted: 64 lower-case hex digits", path);
    return MODAL_OK;
}

static enum modal_status read_names(const cJSON *object, const char *base, struct wire_input *out,
                                    struct modal_error *err)
{
    const cJSON *names = json_member(object, "names"), *name;
    char path[128], item[160];
    uint64_t count = 0;

    if (names == NULL)
        return MODAL_OK;
    json_path(path, base, "names");
    if (!cJSON_IsArray(names))
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s must be a list of texts", path);
    cJSON_ArrayForEach(name, names) {
        snprintf(item, sizeof item, "%s[%llu]", path, (unsigned long long)count++);
        if (!cJSON_IsString(name) || strlen(name->valuestring) > WIRE_NAME_MOST
            || *utf8_control(name->valuestring) != 0)
            return modal_fail_field(err, MODAL_BAD_INPUT, item, "%s must be a text of at most %d "
                                    "bytes without control characters", item, WIRE_NAME_MOST);
    }
    if (count != out->channels)
        return modal_fail_field(err, MODAL_BAD_INPUT, path,
                                "%s has %llu names for %llu channels; accepted: one for each", path,
                                (unsigned long long)count, (unsigned long long)out->channels);
    out->names = names;
    return MODAL_OK;
}

static enum modal_status read_attributes(const cJSON *object, const char *base,
                                         struct wire_input *out, struct modal_error *err)
{
    const cJSON *attributes = json_member(object, "attributes");
    char path[128], *text;
    size_t size;

    if (attributes == NULL)
        return MODAL_OK;
    json_path(path, base, "attributes");
    if (!cJSON_IsObject(attributes))
        return modal_fail_field(err, MODAL_BAD_INPUT, path, "%s must be an object", path);
    text = json_print(attributes);
    if (text == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "out of memory");
    size = strlen(text);
    free(text);
    if (size > WIRE_ATTRIBUTES_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, path,
                                "%s has %zu bytes as JSON; accepted: at most %d", path, size,
                                WIRE_ATTRIBUTES_MOST);
    out->attributes = attributes;
    return MODAL_OK;
}

/* What every batch, sealed or streamed, has beside its number of samples. */
static enum modal_status read_channels(const cJSON *object, const char *base,
                                       struct wire_input *out, struct modal_error *err)
{
    enum modal_status rc = get_integer(object, base, "channels", 1, WIRE_CHANNELS_MOST, true,
                                       &out->channels, err);

    if (rc == MODAL_OK)
        rc = json_need_number(object, base, "dt", DBL_TRUE_MIN, DBL_MAX, &out->dt, err);
    if (rc == MODAL_OK)
        rc = json_get_number(object, base, "period", 0, DBL_MAX, &out->period, err);
    if (rc == MODAL_OK)
        rc = get_text(object, base, "units", 0, WIRE_NAME_MOST, &out->units, err);
    if (rc == MODAL_OK)
        rc = read_names(object, base, out, err);
    if (rc == MODAL_OK)
        rc = read_attributes(object, base, out, err);
    return rc;
}

enum modal_status wire_input_read(const cJSON *object, const char *base, enum wire_content content,
                                  struct wire_input *out, struct modal_error *err)
{
    enum modal_status rc;

    *out = (struct wire_input) { .content = content };
    if (content == WIRE_SCENE) {
        rc = get_integer(object, base, "bytes", 1, WIRE_INTEGER_MOST, false, &out->bytes, err);
        if (rc == MODAL_OK)
            rc = get_integer(object, base, "arrays", 0, WIRE_INTEGER_MOST, false,
                             &out->arrays, err);
        out->bytes += out->arrays;
        return rc;
    }
    rc = get_integer(object, base, "samples", 1, WIRE_INTEGER_MOST, true, &out->samples, err);
    if (rc == MODAL_OK)
        rc = read_channels(object, base, out, err);
    if (rc != MODAL_OK)
        return rc;
    if ((double)out->samples * (double)out->channels * 8 > WIRE_INTEGER_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "samples",
                                "%llu samples of %llu channels; accepted: at most 2^53 bytes",
                                (unsigned long long)out->samples,
                                (unsigned long long)out->channels);
    out->bytes = out->samples * out->channels * 8;
    return MODAL_OK;
}

void wire_input_write(cJSON *object, const struct wire_input *input)
{
    json_put_string(object, "content", wire_contents[input->content]);
    if (input->content == WIRE_SCENE) {
        json_put_number(object, "bytes", (double)(input->bytes - input->arrays));
        if (input->arrays > 0)
            json_put_number(object, "arrays", (double)input->arrays);
        return;
    }
    json_put_number(object, "samples", (double)input->samples);
    json_put_number(object, "channels", (double)input->channels);
    json_put_number(object, "dt", input->dt);
    if (input->period > 0)
        json_put_number(object, "period", input->period);
    if (input->names != NULL)
        json_put(object, "names", cJSON_Duplicate(input->names, true));
    if (input->units != NULL)
        json_put_string(object, "units", input->units);
    if (input->attributes != NULL)
        json_put(object, "attributes", cJSON_Duplicate(input->attributes, true));
}

/* ---- one reader a verb ----------------------------------------------------------------------- */

static enum modal_status read_job(const cJSON *header, struct wire_request *out,
                                  struct modal_error *err)
{
    const char *job;
    enum modal_status rc = need_text(header, "job", WIRE_KEY_MOST + 4, &job, err);

    if (rc != MODAL_OK)
        return rc;
    if (strncmp(job, "key:", 4) == 0)
        out->job.key = job + 4;
    else
        out->job.id = job;
    return MODAL_OK;
}

static enum modal_status read_nothing(const struct wire_message *m, struct wire_request *out,
                                      struct modal_error *err)
{
    (void)m, (void)out, (void)err;
    return MODAL_OK;
}

static enum modal_status read_only_job(const struct wire_message *m, struct wire_request *out,
                                       struct modal_error *err)
{
    return read_job(m->header, out, err);
}

static enum modal_status read_hello(const struct wire_message *m, struct wire_request *out,
                                    struct modal_error *err)
{
    const cJSON *versions = json_member(m->header, "versions"), *one;

    out->hello.speaks_ours = versions == NULL;
    if (versions != NULL && !cJSON_IsArray(versions))
        return modal_fail_field(err, MODAL_BAD_INPUT, "versions",
                                "versions must be a list of texts; accepted: [\"" WIRE_VERSION
                                "\"]");
    cJSON_ArrayForEach(one, versions)
        if (cJSON_IsString(one) && strcmp(one->valuestring, WIRE_VERSION) == 0)
            out->hello.speaks_ours = true;
    return get_text(m->header, "", "client", 0, WIRE_NAME_MOST, &out->hello.client, err);
}

static enum modal_status read_begin(const cJSON *header, struct wire_request *out,
                                    struct modal_error *err)
{
    int content = -1;
    const struct wire_input *in = &out->upload.input;
    enum modal_status rc = json_get_choice(header, "", "content", wire_contents, &content, err);

    if (rc == MODAL_OK && content < 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "content",
                              "content is missing; accepted: batch, scene");
    if (rc == MODAL_OK)
        rc = wire_input_read(header, "", (enum wire_content)content, &out->upload.input, err);
    if (rc == MODAL_OK && in->bytes == in->arrays)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "bytes", "bytes is missing; accepted: 1 to %d",
                              WIRE_SCENE_MOST);
    if (rc == MODAL_OK && content == WIRE_SCENE && in->bytes - in->arrays > WIRE_SCENE_MOST)
        rc = modal_fail_field(err, MODAL_TOO_LARGE, "bytes", "a scene's text of %llu bytes; "
                              "accepted: at most %d, and matrices of more as arrays behind it",
                              (unsigned long long)(in->bytes - in->arrays), WIRE_SCENE_MOST);
    if (rc == MODAL_OK)
        rc = get_text(header, "", "key", 1, WIRE_KEY_MOST, &out->upload.key, err);
    if (rc == MODAL_OK)
        rc = get_hash(header, "", &out->upload.sha256, err);
    return rc;
}

static enum modal_status read_chunk(const struct wire_message *m, struct wire_request *out,
                                    struct modal_error *err)
{
    uint64_t crc = 0;
    enum modal_status rc = get_integer(m->header, "", "offset", 0, WIRE_INTEGER_MOST, true,
                                       &out->upload.offset, err);

    if (rc == MODAL_OK)
        rc = get_integer(m->header, "", "crc32c", 0, 4294967295.0, true, &crc, err);
    if (rc != MODAL_OK)
        return rc;
    out->upload.crc32c = (uint32_t)crc;
    if (m->body_count != 1 || m->body[0].size == 0)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "body",
            "a chunk of %d body frames and %zu bytes; accepted: one frame of 1 to %d bytes",
            m->body_count, m->body_bytes, WIRE_CHUNK_MOST);
    if (m->body[0].size > WIRE_CHUNK_MOST)
        return modal_fail_field(err, MODAL_TOO_LARGE, "body",
                                "a chunk of %zu bytes; accepted: 1 to %d", m->body[0].size,
                                WIRE_CHUNK_MOST);
    return MODAL_OK;
}

static enum modal_status read_seal(const cJSON *header, struct wire_request *out,
                                   struct modal_error *err)
{
    enum modal_status rc = get_hash(header, "", &out->upload.sha256, err);

    if (rc == MODAL_OK && out->upload.sha256 == NULL)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "sha256",
                              "sha256 is missing; accepted: the input's identity in hex");
    return rc;
}

static enum modal_status read_upload(const struct wire_message *m, struct wire_request *out,
                                     struct modal_error *err)
{
    static const char *const ops[] = { "begin", "chunk", "seal", "abort", NULL };
    int op = -1;
    enum modal_status rc = json_get_choice(m->header, "", "op", ops, &op, err);

    if (rc == MODAL_OK && op < 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "op",
                              "op is missing; accepted: begin, chunk, seal, abort");
    if (rc != MODAL_OK)
        return rc;
    out->upload.op = op;
    if (op == WIRE_BEGIN)
        return read_begin(m->header, out, err);
    rc = need_text(m->header, "upload", WIRE_ID_MOST, &out->upload.upload, err);
    if (rc != MODAL_OK || op == WIRE_ABORT)
        return rc;
    return op == WIRE_CHUNK ? read_chunk(m, out, err) : read_seal(m->header, out, err);
}

/* INPUT of SUBMIT with the bytes in the body: their number must be what the description says. */
static enum modal_status read_inline(const struct wire_message *m, const cJSON *input,
                                     struct wire_request *out, struct modal_error *err)
{
    static const char *const keys[] = { "content", DESCRIPTION, NULL };
    int content = -1;
    enum modal_status rc = json_keys(input, "input", keys, err);

    if (rc == MODAL_OK)
        rc = json_get_choice(input, "input", "content", wire_contents, &content, err);
    if (rc == MODAL_OK && content < 0)
        rc = modal_fail_field(
            err, MODAL_BAD_INPUT, "input.content",
            "input.content is missing; accepted: batch, scene, or upload or sha256 instead");
    if (rc == MODAL_OK)
        rc = wire_input_read(input, "", (enum wire_content)content, &out->submit.input, err);
    if (rc != MODAL_OK)
        return rc;
    if (m->body_bytes > WIRE_INLINE_MOST || out->submit.input.bytes > WIRE_INLINE_MOST)
        return modal_fail_field(
            err, MODAL_TOO_LARGE, "input",
            "an input of %llu bytes in SUBMIT; accepted: at most %d, more by UPLOAD",
            (unsigned long long)(out->submit.input.bytes > m->body_bytes ? out->submit.input.bytes
                                                                         : m->body_bytes),
            WIRE_INLINE_MOST);
    if (out->submit.input.bytes == 0)
        out->submit.input.bytes = m->body_bytes;
    if (m->body_bytes == 0 || m->body_bytes != out->submit.input.bytes)
        return modal_fail_field(err, MODAL_BAD_INPUT, "body",
                                "the body has %zu bytes; accepted: the %llu of the input described",
                                m->body_bytes, (unsigned long long)out->submit.input.bytes);
    return MODAL_OK;
}

static enum modal_status read_reference(const struct wire_message *m, const cJSON *input,
                                        struct wire_request *out, struct modal_error *err)
{
    static const char *const keys[] = { "upload", "sha256", NULL };
    enum modal_status rc = json_keys(input, "input", keys, err);

    if (rc == MODAL_OK)
        rc = get_text(input, "input", "upload", 1, WIRE_ID_MOST, &out->submit.upload, err);
    if (rc == MODAL_OK)
        rc = get_hash(input, "input", &out->submit.sha256, err);
    if (rc == MODAL_OK && out->submit.upload != NULL && out->submit.sha256 != NULL)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "input.sha256",
                              "input has both upload and sha256; accepted: one of them");
    if (rc == MODAL_OK && m->body_count != 0)
        rc = modal_fail_field(
            err, MODAL_BAD_INPUT, "body",
            "a body beside an input that is named by upload or sha256; accepted: none");
    return rc;
}

static enum modal_status read_limits(const cJSON *header, struct wire_request *out,
                                     struct modal_error *err)
{
    enum modal_status rc = json_get_int(header, "", "priority", 0, 255, &out->submit.priority, err);

    if (rc == MODAL_OK)
        rc = json_get_int(header, "", "max_attempts", 1, WIRE_ATTEMPTS_MOST,
                          &out->submit.max_attempts, err);
    if (rc == MODAL_OK)
        rc = json_get_number(header, "", "run_limit_s", 1e-3, 3e7, &out->submit.run_limit_s, err);
    if (rc == MODAL_OK)
        rc = json_get_number(header, "", "deadline_s", 1e-3, 3e8, &out->submit.deadline_s, err);
    if (rc == MODAL_OK)
        rc = json_get_number(header, "", "not_before", 0, 4e9, &out->submit.not_before, err);
    if (rc == MODAL_OK)
        rc = json_get_bool(header, "", "fresh", &out->submit.fresh, err);
    return rc;
}

static enum modal_status read_submit(const struct wire_message *m, struct wire_request *out,
                                     struct modal_error *err)
{
    const cJSON *input = json_member(m->header, "input");
    enum modal_status rc = need_text(m->header, "kind", 32, &out->submit.kind, err);

    out->submit.priority = WIRE_PRIORITY_DEFAULT;
    out->submit.max_attempts = WIRE_ATTEMPTS_DEFAULT;
    out->submit.options = json_member(m->header, "options");
    if (rc == MODAL_OK && out->submit.options != NULL && !cJSON_IsObject(out->submit.options))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "options", "options must be an object");
    if (rc == MODAL_OK)
        rc = get_text(m->header, "", "key", 1, WIRE_KEY_MOST, &out->submit.key, err);
    if (rc == MODAL_OK)
        rc = read_limits(m->header, out, err);
    if (rc == MODAL_OK && !cJSON_IsObject(input))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "input",
                              "input must be an object with upload, sha256 or content");
    if (rc != MODAL_OK)
        return rc;
    if (json_member(input, "upload") != NULL || json_member(input, "sha256") != NULL)
        return read_reference(m, input, out, err);
    return read_inline(m, input, out, err);
}

/* Bytes of the input that JOB of SUBMITS has in the body; 0: none, or its own reader will refuse
 * it. */
static enum modal_status inline_bytes(const cJSON *job, const char *base, uint64_t *bytes,
                                      struct modal_error *err)
{
    const cJSON *input = json_member(job, "input");
    const char *content = cJSON_GetStringValue(json_member(input, "content"));
    uint64_t channels = 0;
    enum modal_status rc;

    *bytes = 0;
    if (content != NULL && strcmp(content, wire_contents[WIRE_SCENE]) == 0)
        return get_integer(input, base, "bytes", 1, WIRE_INLINE_MOST, true, bytes, err);
    if (content == NULL || strcmp(content, wire_contents[WIRE_BATCH]) != 0)
        return MODAL_OK;
    rc = get_integer(input, base, "samples", 1, WIRE_INLINE_MOST / 8, true, bytes, err);
    if (rc == MODAL_OK)
        rc = get_integer(input, base, "channels", 1, WIRE_INLINE_MOST / 8, true, &channels, err);
    if (rc != MODAL_OK)
        return rc;
    *bytes *= 8 * channels;
    return *bytes <= WIRE_INLINE_MOST
               ? MODAL_OK
               : modal_fail_field(
                   err, MODAL_TOO_LARGE, base,
                   "%s: an input of %llu bytes in the body; accepted: at most %d, more by UPLOAD",
                   base, (unsigned long long)*bytes, WIRE_INLINE_MOST);
}

static enum modal_status read_submits(const struct wire_message *m, struct wire_request *out,
                                      struct modal_error *err)
{
    const cJSON *jobs = json_member(m->header, "jobs"), *job;
    uint64_t bytes, all = 0;
    char base[40];
    int count = 0;

    cJSON_ArrayForEach(job, jobs) {
        if (!cJSON_IsObject(job) || json_member(job, "id") != NULL
            || inline_bytes(job, "", &bytes, NULL) != MODAL_OK)
            break;
        count++;
        all += bytes;
    }
    if (job != NULL && count < WIRE_JOBS_MOST) {       /* the one at fault, by its name */
        snprintf(base, sizeof base, "jobs[%d]", count);
        if (!cJSON_IsObject(job) || json_member(job, "id") != NULL)
            return modal_fail_field(err, MODAL_BAD_INPUT, base,
                                    "%s must be an object with the members of SUBMIT but id", base);
        return inline_bytes(job, strcat(base, ".input"), &bytes, err);
    }
    if (!cJSON_IsArray(jobs) || count < 1 || count > WIRE_JOBS_MOST)
        return modal_fail_field(err, MODAL_BAD_INPUT, "jobs",
                                "jobs must be a list of 1 to %d submissions", WIRE_JOBS_MOST);
    if (all != m->body_bytes)
        return modal_fail_field(
            err, MODAL_BAD_INPUT, "body",
            "the body has %zu bytes; accepted: the %llu of the inputs described", m->body_bytes,
            (unsigned long long)all);
    out->submits.jobs = jobs;
    return MODAL_OK;
}

void wire_part(const cJSON *job, const char **body, struct wire_message *part)
{
    uint64_t bytes = 0;

    inline_bytes(job, "", &bytes, NULL);
    memset(part, 0, sizeof *part);
    strcpy(part->verb, wire_verb_name(WIRE_SUBMIT));
    strcpy(part->id, "null");
    part->header = job;
    part->body[0] = (struct wire_frame) { *body, bytes };
    part->body_count = bytes > 0;
    part->body_bytes = bytes;
    *body += bytes;
}

static enum modal_status read_wait(const struct wire_message *m, struct wire_request *out,
                                   struct modal_error *err)
{
    enum modal_status rc = read_job(m->header, out, err);

    out->wait.timeout_s = WIRE_TIMEOUT_DEFAULT;
    if (rc == MODAL_OK)
        rc = json_get_number(m->header, "", "timeout_s", 0, WIRE_TIMEOUT_MOST, &out->wait.timeout_s,
                             err);
    if (rc == MODAL_OK)
        rc = json_get_bool(m->header, "", "result", &out->wait.result, err);
    return rc;
}

static enum modal_status read_result(const struct wire_message *m, struct wire_request *out,
                                     struct modal_error *err)
{
    int part = WIRE_DOCUMENT;
    bool of_job = json_member(m->header, "job") != NULL;
    enum modal_status rc = get_text(m->header, "", "upload", 1, WIRE_ID_MOST, &out->result.upload,
                                    err);

    out->result.length = WIRE_BODY_MOST;
    if (rc == MODAL_OK && of_job && out->result.upload != NULL)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "upload",
                              "job and upload are both given; accepted: one of them");
    if (rc == MODAL_OK && out->result.upload == NULL)
        rc = read_job(m->header, out, err);
    if (rc == MODAL_OK)
        rc = json_get_choice(m->header, "", "part", wire_parts, &part, err);
    if (rc == MODAL_OK)
        rc = get_integer(m->header, "", "offset", 0, WIRE_INTEGER_MOST, false, &out->result.offset,
                         err);
    if (rc == MODAL_OK)
        rc = get_integer(m->header, "", "length", 1, WIRE_BODY_MOST, false, &out->result.length,
                         err);
    out->result.part = (enum wire_part)part;
    if (rc == MODAL_OK && out->result.upload != NULL && part != WIRE_INPUT)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "part",
                              "part is \"%s\" of what no job made; accepted: \"input\"",
                              wire_parts[part]);
    return rc;
}

/* s of UTC: three thousand years; of what has so many digits a double still holds microseconds */
static const double TIME_MOST = 1e11;

static enum modal_status read_list(const struct wire_message *m, struct wire_request *out,
                                   struct modal_error *err)
{
    enum modal_status rc;

    out->list.state = -1;
    out->list.limit = WIRE_PAGE_DEFAULT;
    rc = json_get_choice(m->header, "", "state", wire_states, &out->list.state, err);
    if (rc == MODAL_OK)
        rc = get_text(m->header, "", "kind", 1, 32, &out->list.kind, err);
    if (rc == MODAL_OK)
        rc = json_get_int(m->header, "", "limit", 1, WIRE_PAGE_MOST, &out->list.limit, err);
    if (rc == MODAL_OK)
        rc = get_text(m->header, "", "after", 1, WIRE_ID_MOST, &out->list.after, err);
    if (rc == MODAL_OK)
        rc = get_text(m->header, "", "key", 1, WIRE_KEY_MOST, &out->list.key, err);
    if (rc == MODAL_OK)
        rc = get_text(m->header, "", "user", 1, WIRE_NAME_MOST, &out->list.user, err);
    if (rc == MODAL_OK)
        rc = json_get_number(m->header, "", "since", 0, TIME_MOST, &out->list.since, err);
    return rc == MODAL_OK ? json_get_bool(m->header, "", "newest", &out->list.newest, err) : rc;
}

const char *const wire_events[] = { "state", "progress", "modes", "track", "alarm", NULL };

/* The events that are wanted, as bits; none named: all. */
static enum modal_status read_kinds(const cJSON *list, unsigned *out, struct modal_error *err)
{
    const cJSON *item;

    *out = 0;
    if (list == NULL)
        return MODAL_OK;
    cJSON_ArrayForEach(item, list) {
        unsigned n = 0;
        const char *name = cJSON_IsString(item) ? item->valuestring : "";
        while (wire_events[n] != NULL && strcmp(wire_events[n], name) != 0)
            n++;
        if (wire_events[n] == NULL)
            return modal_fail_field(err, MODAL_BAD_INPUT, "kinds",
                                    "kinds has \"%.40s\"; accepted: state, progress, modes, track, "
                                    "alarm",
                                    cJSON_IsString(item) ? item->valuestring : "what is no text");
        *out |= 1u << n;
    }
    if (!cJSON_IsArray(list) || *out == 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "kinds",
                                "kinds must be a list of one or more of state, progress, modes, "
                                "track, alarm");
    return MODAL_OK;
}

static enum modal_status read_events(const struct wire_message *m, struct wire_request *out,
                                     struct modal_error *err)
{
    static const char *const ops[] = { "subscribe", "cancel", NULL };
    int op = WIRE_SUBSCRIBE;
    enum modal_status rc = json_get_choice(m->header, "", "op", ops, &op, err);

    out->events.op = op;
    if (rc == MODAL_OK && op == WIRE_UNSUBSCRIBE)
        return need_text(m->header, "subscription", WIRE_ID_MOST, &out->events.subscription, err);
    out->events.replay = json_member(m->header, "from") != NULL;
    if (rc == MODAL_OK)
        rc = get_integer(m->header, "", "from", 0, WIRE_INTEGER_MOST, false, &out->events.from,
                         err);
    if (rc == MODAL_OK)
        rc = get_text(m->header, "", "stream", 1, WIRE_KEY_MOST, &out->events.stream, err);
    if (rc == MODAL_OK)
        rc = read_kinds(json_member(m->header, "kinds"), &out->events.kinds, err);
    if (rc == MODAL_OK && json_member(m->header, "job") != NULL)
        rc = read_job(m->header, out, err);
    return rc;
}

static enum modal_status read_open(const cJSON *header, struct wire_request *out,
                                   struct modal_error *err)
{
    const cJSON *window = json_member(header, "window");
    enum modal_status rc = need_text(header, "name", WIRE_KEY_MOST, &out->stream.name, err);

    if (rc == MODAL_OK)
        rc = read_channels(header, "", &out->stream.input, err);
    if (rc == MODAL_OK && window != NULL && !cJSON_IsObject(window))
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "window", "window must be an object");
    out->stream.window = window;
    return rc;
}

static enum modal_status read_push(const struct wire_message *m, struct wire_request *out,
                                   struct modal_error *err)
{
    uint64_t crc = 0;
    const struct { const char *key; uint64_t least; double most; uint64_t *to; } numbers[] = {
        { "epoch", 0, WIRE_INTEGER_MOST, &out->stream.epoch },
        { "first", 0, WIRE_INTEGER_MOST, &out->stream.first },
        { "count", 1, WIRE_BODY_MOST / 8, &out->stream.count },
        { "crc32c", 0, UINT32_MAX, &crc } }, *n;
    enum modal_status rc = MODAL_OK;

    for (n = numbers; rc == MODAL_OK && n < numbers + sizeof numbers / sizeof *numbers; n++)
        rc = get_integer(m->header, "", n->key, n->least, n->most, true, n->to, err);
    if (rc == MODAL_OK && m->body_count != 1)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "body",
                              "a push of %d body frames; accepted: one", m->body_count);
    if (rc == MODAL_OK && m->body_bytes > WIRE_CHUNK_MOST)
        rc = modal_fail_field(err, MODAL_TOO_LARGE, "body",
                              "a push of %zu bytes; accepted: at most %d", m->body_bytes,
                              WIRE_CHUNK_MOST);
    out->stream.crc32c = (uint32_t)crc;
    return rc;
}

static enum modal_status read_stream(const struct wire_message *m, struct wire_request *out,
                                     struct modal_error *err)
{
    static const char *const ops[] = { "open", "push", "pushes", "close", NULL };
    int op = -1;
    enum modal_status rc = json_get_choice(m->header, "", "op", ops, &op, err);

    if (rc != MODAL_OK)
        return rc;
    if (op < 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "op",
                                "op is missing; accepted: open, push, pushes, close");
    out->stream.op = op;
    if (op == WIRE_OPEN || op == WIRE_PUSHES)
        return op == WIRE_OPEN ? read_open(m->header, out, err)
                               : wire_pushes_check(m, &out->stream.parts, err);
    rc = need_text(m->header, "stream", WIRE_ID_MOST, &out->stream.stream, err);
    if (rc == MODAL_OK && op == WIRE_PUSH)
        return read_push(m, out, err);
    return rc != MODAL_OK ? rc
                          : json_get_bool(m->header, "", "broken", &out->stream.broken, err);
}

static enum modal_status read_streams(const struct wire_message *m, struct wire_request *out,
                                      struct modal_error *err)
{
    enum modal_status rc = get_text(m->header, "", "name", 1, WIRE_KEY_MOST, &out->streams.name,
                                    err);

    out->streams.limit = WIRE_PAGE_DEFAULT;
    if (rc == MODAL_OK)
        rc = json_get_int(m->header, "", "limit", 1, WIRE_PAGE_MOST, &out->streams.limit, err);
    if (rc == MODAL_OK)
        rc = get_text(m->header, "", "after", 1, WIRE_ID_MOST, &out->streams.after, err);
    return rc == MODAL_OK
               ? get_text(m->header, "", "user", 1, WIRE_NAME_MOST, &out->streams.user, err)
               : rc;
}

/* The protocol's verbs, in the order of PROTOCOL.md. */
static const struct row {
    const char *name;
    enum wire_role least;
    enum modal_status (*read)(const struct wire_message *, struct wire_request *,
                              struct modal_error *);
    bool body;                      /* a body is looked at; else it must be absent */
    const char *keys[24];           /* accepted members */
} verbs[WIRE_VERB_COUNT] = {
    [WIRE_HELLO]   = { "HELLO",   WIRE_ROLE_READ,   read_hello,    false,
        { "id", "versions", "client" } },
    [WIRE_UPLOAD]  = { "UPLOAD",  WIRE_ROLE_SUBMIT, read_upload,   true,
        { "id", "op", "content", "key", "sha256", "upload", "offset", "crc32c", "arrays",
          DESCRIPTION } },
    [WIRE_SUBMIT]  = { "SUBMIT",  WIRE_ROLE_SUBMIT, read_submit,   true,
        { "id", "kind", "options", "input", "key", "priority", "run_limit_s", "deadline_s",
          "not_before", "max_attempts", "fresh" } },
    [WIRE_SUBMITS] = { "SUBMITS", WIRE_ROLE_SUBMIT, read_submits,  true,  { "id", "jobs" } },
    [WIRE_STATUS]  = { "STATUS",  WIRE_ROLE_READ,   read_only_job, false, { "id", "job" } },
    [WIRE_WAIT]    = { "WAIT",    WIRE_ROLE_READ,   read_wait,     false,
        { "id", "job", "timeout_s", "result" } },
    [WIRE_RESULT]  = { "RESULT",  WIRE_ROLE_READ,   read_result,   false,
        { "id", "job", "upload", "part", "offset", "length" } },
    [WIRE_CANCEL]  = { "CANCEL",  WIRE_ROLE_SUBMIT, read_only_job, false, { "id", "job" } },
    [WIRE_RETRY]   = { "RETRY",   WIRE_ROLE_SUBMIT, read_only_job, false, { "id", "job" } },
    [WIRE_DELETE]  = { "DELETE",  WIRE_ROLE_SUBMIT, read_only_job, false, { "id", "job" } },
    [WIRE_LIST]    = { "LIST",    WIRE_ROLE_READ,   read_list,     false,
        { "id", "state", "kind", "limit", "after", "key", "user", "since", "newest" } },
    [WIRE_EVENTS]  = { "EVENTS",  WIRE_ROLE_READ,   read_events,   false,
        { "id", "op", "from", "job", "stream", "kinds", "subscription" } },
    [WIRE_STATS]   = { "STATS",   WIRE_ROLE_READ,   read_nothing,  false, { "id" } },
    [WIRE_METRICS] = { "METRICS", WIRE_ROLE_READ,   read_nothing,  false, { "id" } },
    [WIRE_WHOAMI]  = { "WHOAMI",  WIRE_ROLE_READ,   read_nothing,  false, { "id" } },
    [WIRE_DRAIN]   = { "DRAIN",   WIRE_ROLE_ADMIN,  read_nothing,  false, { "id" } },
    [WIRE_UNDRAIN] = { "UNDRAIN", WIRE_ROLE_ADMIN,  read_nothing,  false, { "id" } },
    [WIRE_STREAM]  = { "STREAM",  WIRE_ROLE_SUBMIT, read_stream,   true,
        { "id", "op", "name", "stream", "epoch", "first", "count", "crc32c", "parts", "broken",
          "window", DESCRIPTION } },
    [WIRE_STREAMS] = { "STREAMS", WIRE_ROLE_READ,   read_streams,  false,
        { "id", "name", "user", "limit", "after" } },
};

const char *wire_verb_name(enum wire_verb verb)
{
    return verbs[verb].name;
}

int wire_verb_find(const char *name)
{
    for (int i = 0; i < WIRE_VERB_COUNT; i++)
        if (strcmp(verbs[i].name, name) == 0)
            return i;
    return -1;
}

enum wire_role wire_verb_role(enum wire_verb verb)
{
    return verbs[verb].least;
}

enum modal_status wire_request_read(const struct wire_message *message, struct wire_request *out,
                                    struct modal_error *err)
{
    int verb = wire_verb_find(message->verb);
    struct wire_request request = { .id = message->id };
    enum modal_status rc;

    if (verb < 0)
        return modal_fail(err, MODAL_UNKNOWN_VERB, "unknown verb \"%s\"", message->verb);
    request.verb = (enum wire_verb)verb;
    rc = json_keys(message->header, "", verbs[verb].keys, err);
    if (rc == MODAL_OK && !verbs[verb].body && message->body_count > 0)
        rc = modal_fail_field(err, MODAL_BAD_INPUT, "body", "%s has no body", verbs[verb].name);
    if (rc == MODAL_OK)
        rc = verbs[verb].read(message, &request, err);
    if (rc == MODAL_OK)
        *out = request;
    return rc;
}
