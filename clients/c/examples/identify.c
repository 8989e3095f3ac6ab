/* identify.c - modes of a batch from C by modald.h
 *
 * usage: example_identify CHANNELS DT [OPTIONS-JSON] < SIGNALS
 * The signals are raw doubles, sample by sample; prints the result's JSON.
 */
#include <stdio.h>
#include <stdlib.h>
#include "modald.h"

/* All of stdin; the caller frees it. */
static double *read_all(size_t *count)
{
    size_t room = 1 << 16, got;
    double *x = malloc(room * sizeof *x);

    *count = 0;
    while (x != NULL && (got = fread(x + *count, sizeof *x, room - *count, stdin)) > 0)
        if ((*count += got) == room) {
            double *more = realloc(x, 2 * room * sizeof *x);
            if (more == NULL)
                break;
            x = more;
            room *= 2;
        }
    return x;
}

int main(int argc, char **argv)
{
    struct modald_error error = { "", "", "", 0 };
    struct modald_job job = { 0 };
    struct modald_batch batch = { 0 };
    struct modald *modald = NULL;
    char *result = NULL;
    size_t count;
    int status;

    if (argc < 3 || argc > 4) {
        fprintf(stderr, "usage: example_identify CHANNELS DT [OPTIONS-JSON] < SIGNALS\n");
        return 2;
    }
    batch.channels = (size_t)atol(argv[1]);
    batch.dt = atof(argv[2]);
    job.options = argc > 3 ? argv[3] : NULL;
    double *x = read_all(&count);
    batch.signals = x;
    batch.samples = batch.channels > 0 ? count / batch.channels : 0;
    status = modald_connect(NULL, NULL, &modald, &error);
    if (status == MODALD_DONE)
        status = modald_run(modald, &job, &batch, 60, &result, &error);
    if (status == MODALD_DONE)
        puts(result);
    else
        fprintf(stderr, "%s: %s: %s\n", error.code, error.field, error.message);
    modald_free(result);
    modald_disconnect(modald);
    free(x);
    return status;
}
