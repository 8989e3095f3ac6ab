/* result_show.c - see result_show.h */
#include "result_show.h"
#include <string.h>
#include "field.h"
#include "outcome.h"
#include "plot_file.h"
#include "result_csv.h"
#include "show.h"
#include "whole_file.h"

static bool plots_to_stdout(const struct args *args)
{
    return args->plot != NULL && strcmp(args->plot, "-") == 0;
}

/* Of what goes to stdout there is one. */
enum modal_status result_show_check(const struct args *args, struct modal_error *err)
{
    enum modal_status rc = MODAL_OK;

    if (args->csv && args->json)
        return modal_fail_field(err, MODAL_BAD_INPUT, "csv", "--csv and --json both write to "
                                "stdout; accepted: one of them");
    if (plots_to_stdout(args) && (args->json || args->csv))
        return modal_fail_field(err, MODAL_BAD_INPUT, "plot", "--plot - and --%s both write to "
                                "stdout; accepted: FILE.svg", args->json ? "json" : "csv");
    if (args->plot != NULL && !plots_to_stdout(args)) {
        rc = plot_path_check(args->plot, err);
        if (rc == MODAL_OK)
            rc = whole_file_check(args->plot, "plot", err);
    }
    return rc;
}

enum modal_status result_show(const struct args *args, const cJSON *result,
                              const struct input *input, struct modal_error *err)
{
    const char *kind = field_word(result, "kind", "-");
    enum modal_status rc = args->plot != NULL ? plot_result(args->plot, kind, result, input, err)
                                              : MODAL_OK;

    if (rc != MODAL_OK || plots_to_stdout(args))
        return rc;
    if (args->json)
        return outcome_json(result, err);
    if (args->csv)
        return result_csv(stdout, result, NULL, true, err);
    show_result(kind, result);
    return MODAL_OK;
}
