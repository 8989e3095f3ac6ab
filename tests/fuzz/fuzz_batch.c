/* fuzz_batch.c - identify answers any small batch of finite or other doubles with a document of
 * finite numbers, or refuses it by name
 *
 * The input: one byte each for channels, options and scale, then doubles.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "job/job.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static const char *const options_of[] = {
    "{}",
    "{\"rank.fixed\":2}",
    "{\"rank.fixed\":4,\"shapes\":true}",
    "{\"method\":\"partial-floquet\"}",
    "{\"method\":\"autoregressive\",\"rank.energy\":0.99}",
    "{\"detrend\":\"mean\"}",
    "{\"difference\":true}",
    "{\"band\":[0.1,2]}",
    "{\"window\":[0.5,3]}",
    "{\"rows\":8,\"columns\":8}",
    "{\"signals\":\"all\"}",
};

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 3)
        return 0;
    size_t channels = 1 + data[0] % 4, values = (size - 3) / sizeof(double);
    struct batch batch = { .channels = channels,
                           .samples = values / channels,
                           .dt = 0.1,
                           .period = data[0] & 64    ? 0.8
                                     : data[0] & 128 ? 0.77
                                                     : 0 };
    if (batch.samples > 300)
        batch.samples = 300;
    double *x = malloc((batch.samples * channels + 1) * sizeof *x);
    if (x == NULL)
        return 0;
    memcpy(x, data + 3, batch.samples * channels * sizeof *x);
    if (data[2] & 1)
        /* tame most of them: exponents of a few units */
        for (size_t i = 0; i < batch.samples * channels; i++)
            x[i] = isfinite(x[i]) && x[i] != 0 ? copysign(exp(fmod(log(fabs(x[i])), 3)), x[i]) : 0;
    batch.signals = x;

    const char *text = options_of[data[1] % (sizeof options_of / sizeof *options_of)];
    cJSON *options = NULL;
    struct modal_error err = { 0 };
    struct job_result result;
    if (json_read(text, strlen(text), &options, &err) != MODAL_OK)
        abort();
    enum modal_status rc =
        job_run(&(struct job_request) { .kind = "identify", .options = options, .batch = &batch },
                &result, &err);
    if (rc == MODAL_BAD_INPUT && err.field[0] == '\0')
        abort();
    if (rc == MODAL_INTERNAL)
        abort();
    job_result_done(&result);
    cJSON_Delete(options);
    free(x);
    return 0;
}
