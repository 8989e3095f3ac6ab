/* fuzz_files.c - a user's binary file, or universal file, is read into finite shapes, or refused
 * with a reason and a field
 *
 * The input: one byte for the options, then the file, which is what its first bytes say.
 */
#include <stdint.h>
#include <stdlib.h>
#include "ctl/files/matlab.h"
#include "ctl/files/numpy.h"
#include "ctl/files/outb.h"
#include "ctl/files/uff.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static enum modal_status read_file(struct bytes file, const struct signals_options *options,
                                   struct signals *out, struct modal_error *err)
{
    if (matlab_is(file.data, file.length))
        return matlab_read(file, "f", options, out, err);
    if (npy_is(file.data, file.length))
        return npy_read(file, "f", options, out, err);
    if (npz_is(file.data, file.length))
        return npz_read(file, "f", options, out, err);
    if (outb_is(file.data, file.length))
        return outb_read(file, "f", options, out, err);
    return uff_read(file, "f", options, out, err);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct signals signals = { 0 };
    struct modal_error err = { 0 };

    if (size == 0)
        return 0;
    struct signals_options options = { .dt = data[0] & 1 ? 0.01 : 0, .ignore_time = data[0] & 2,
                                       .dataset = data[0] & 4 ? "accel" : NULL };
    enum modal_status rc = read_file((struct bytes) { data + 1, size - 1, 0 }, &options, &signals,
                                     &err);
    if (rc == MODAL_OK) {
        double sum = 0;
        for (size_t i = 0; i < signals.samples * signals.channels; i++)
            sum += signals.x[i];
        if (signals.samples == 0 || signals.channels == 0 || !(signals.dt >= 0) ||
            (sum == 0 && signals.x == NULL))
            abort();
    } else if (err.message[0] == '\0' || (rc == MODAL_BAD_INPUT && err.field[0] == '\0')) {
        abort();
    }
    signals_done(&signals);
    return 0;
}
