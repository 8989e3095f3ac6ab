/* fuzz_csv.c - a user's text file is read into finite shapes, or refused with a reason */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "ctl/csv.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct signals signals = { 0 };
    struct modal_error err = { 0 };
    struct signals_options options = { .dt = size % 2 ? 0.01 : 0, .ignore_time = size % 3 == 0 };
    char *text = malloc(size + 1);

    if (text == NULL)
        return 0;
    memcpy(text, data, size);
    text[size] = '\0';
    enum modal_status rc = csv_read(text, "f.csv", &options, &signals, &err);
    if (rc == MODAL_OK) {
        double sum = 0;
        for (size_t i = 0; i < signals.samples * signals.channels; i++)
            sum += signals.x[i];
        if (signals.samples == 0 || signals.channels == 0 || !(signals.dt >= 0) ||
            (sum == 0 && signals.x == NULL))
            abort();
    } else if (err.message[0] == '\0') {
        abort();
    }
    signals_done(&signals);
    free(text);
    return 0;
}
