/*
 * fuzz_event.c - any bytes as a server's answer to a stream: none is read past its end, and nothing
 * is believed that is no number
 *
 * The first byte chooses REPLY, ERROR or EVENT; the rest is the header.  The library is taken in
 * whole: what reads headers is its own business.
 */
#include "modald_stream.c"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const char *const kinds[] = { "REPLY", "ERROR", "EVENT" };
    static modald_stream s;
    char *header = size > 0 ? strndup((const char *)data + 1, size - 1) : NULL;

    if (header == NULL)
        return 0;
    s = (modald_stream) { .spill_fd = -1, .ring_fd = -1, .channels = 1, .told = true,
                          .stream = "abcd", .opened = (data[0] & 4) != 0, .next_id = 4,
                          .opening = (data[0] & 8) != 0, .open_id = 1, .events_id = 2 };
    take_message(&s, kinds[data[0] % 3], header);
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
