/*
 * fuzz_event.c - any bytes as a server's answer to a stream: none is read past its end, and nothing
 * is believed that is no number
 *
 * The first byte chooses REPLY, ERROR or EVENT; the rest is the header.  What the daemon's own
 * strict reader takes as an object, the library's must read alike, member by member.  The library
 * is taken in whole: what reads headers is its own business.
 */
#include "modald_stream.c"
#include "base/json.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void compare_members(const char *header)
{
    const char *members[MEMBERS],
        *end = read_object(skip_space(header), member_names, MEMBERS, members);
    cJSON *object = NULL;

    if (json_read(header, strlen(header), &object, NULL) != MODAL_OK || !cJSON_IsObject(object)) {
        cJSON_Delete(object);
        return;
    }
    if (end == NULL || *skip_space(end) != 0)
        abort();
    for (int i = 0; i < MEMBERS; i++) {
        const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, member_names[i]);
        if ((value != NULL) != (members[i] != NULL))
            abort();
        if (cJSON_IsNumber(value) && number_at(members[i], NAN) != value->valuedouble)
            abort();
        if (value != NULL && cJSON_IsString(value) != (*members[i] == '"'))
            abort();
    }
    cJSON_Delete(object);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const char *const kinds[] = { "REPLY", "ERROR", "EVENT" };
    static modald_stream s;
    static struct link link = { .streams = { &s }, .slots = 1, .warned = true };
    char *header = size > 0 ? strndup((const char *)data + 1, size - 1) : NULL;

    if (header == NULL)
        return 0;
    link.questions = 4;
    s = (modald_stream) { .spill_fd = -1, .ring_fd = -1, .channels = 1, .warned = true,
                          .stream = "abcd", .opened = (data[0] & 4) != 0, .link = &link,
                          .opening = (data[0] & 8) != 0, .open_id = 1 * LINK_STREAMS,
                          .events_id = 2 * LINK_STREAMS };
    on_message(&link, kinds[data[0] % 3], header, NULL);
    compare_members(header);
    free(header);
    if (!isfinite(s.estimate.frequency_hz) || !isfinite(s.estimate.damping_ratio)
        || !isfinite(s.estimate.sample))
        abort();
    if (s.credit > (size_t)1 << 53 || s.epoch > (uint64_t)1 << 53)
        abort();
    if (strlen(s.stream) >= sizeof s.stream || s.quiet_until > now() + 1)
        abort();
    return 0;
}
