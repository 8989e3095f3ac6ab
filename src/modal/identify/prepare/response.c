/* response.c - see response.h; tested by tests/unit/modal/identify/test_ambient.c, test_forced.c */
#include "modal/identify/prepare/response.h"

const char *const identify_response_names[RESPONSE_COUNT + 1] = { "free", "ambient", "forced",
                                                                    NULL };

/* The first option set that says nothing, or NULL. */
static const char *idle_option(const struct identify_options *o, bool pod)
{
    const struct { const char *field; bool set; } others[] = {
        { "method", o->method != IDENTIFY_AUTO },
        { "rank.rule", o->rank.rule != RANK_AUTO && o->rank.rule != RANK_FIXED },
        { "rank.energy", o->rank.energy > 0 }, { "rank.threshold", o->rank.threshold > 0 },
        { "pod.rank", !pod && o->pod_rank > 0 }, { "pod.energy", !pod && o->pod_energy > 0 },
        { "rows", o->rows > 0 }, { "columns", o->columns > 0 }, { "stride", o->stride > 1 },
        { "difference", o->difference }, { "refine", o->refine == CHOICE_NO },
        { "target.error", o->target_error > 0 }, { "target.seconds", o->target_seconds > 0 },
    };

    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (others[i].set)
            return others[i].field;
    return NULL;
}

enum modal_status response_check(const struct batch *batch, const struct identify_options *o,
                                 const struct response_limits *limits, struct modal_error *err)
{
    const char *response = identify_response_names[o->response];
    const char *idle = idle_option(o, limits->signals_most > 0);
    double period = o->period < 0 ? 0 : o->period > 0 ? o->period : batch->period;

    if (idle != NULL)
        return modal_fail_field(err, MODAL_BAD_INPUT, idle, "%s says nothing of response=%s; "
                                "accepted beside it: %s", idle, response, limits->beside);
    if (o->window[0] == WINDOW_AUTO)
        return modal_fail_field(err, MODAL_BAD_INPUT, "window", "window=auto is for free "
                                "responses; accepted with response=%s: T0,T1", response);
    if (period > 0 && !limits->periodic)
        return modal_fail_field(err, MODAL_BAD_INPUT, "period", "period is %g s, but response=%s "
                                "takes constant systems only; accepted: period=0, constant "
                                "coefficients", period, response);
    if (o->azimuth != NULL && !limits->periodic)
        return modal_fail_field(err, MODAL_BAD_INPUT, "azimuth", "azimuth says nothing of "
                                "response=%s; accepted beside it: %s", response, limits->beside);
    if (o->azimuth != NULL && o->period != 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "azimuth", "azimuth beside `period`: the "
                                "angle says what a period is; accepted: one of the two");
    if ((period > 0 || o->azimuth != NULL) && o->band[1] > 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "band", "band beside a period or an azimuth: "
                                "modes of a periodic system move in many bands; accepted with "
                                "response=%s: one of them, or period=0", response);
    if (o->pod_rank > limits->signals_most)
        return modal_fail_field(err, MODAL_BAD_INPUT, "pod.rank", "pod.rank is %d; accepted with "
                                "response=%s: 1 to %d", o->pod_rank, response,
                                limits->signals_most);
    if (o->rank.fixed > 2 * limits->modes_most || o->rank.fixed % 2 != 0)
        return modal_fail_field(err, MODAL_BAD_INPUT, "rank.fixed", "rank.fixed is %d; accepted "
                                "with response=%s: 2, 4, .. %d, two a pair", o->rank.fixed,
                                response, 2 * limits->modes_most);
    return MODAL_OK;
}

void response_stage(const struct identify_options *o, double *clock, const char *name,
                    struct identify_result *out)
{
    double now = o->clock != NULL ? o->clock(o->context) : 0;

    if (name != NULL && out->stage_count < IDENTIFY_STAGES)
        out->stages[out->stage_count++] = (struct identify_stage) { name, now - *clock };
    *clock = now;
}
