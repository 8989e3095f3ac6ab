/* remote.c - see remote.h */
#include "remote.h"

enum modal_status remote_run(const struct input *input, const struct args *args, struct job_result *out,
                             cJSON **detail, struct modal_error *err)
{
    (void)input; (void)out; (void)detail;
    return modal_fail(err, MODAL_NO_SERVER, "no server at %s", args->server ? args->server : "the default endpoints");
}
