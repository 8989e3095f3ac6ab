/* identify_job.c - modal_identify as a job; see identify_job.h;
 * tested by tests/unit/job/test_job_identify.c */
#include "job/identify_job.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>
#include "job/blas_core.h"
#include "job/cost.h"
#include "job/identify_ladder.h"
#include "modal/identify/linear/exponents.h"

static cJSON *print_std(const struct identify_mode *m)
{
    cJSON *std = cJSON_CreateObject();

    json_set_number(std, "frequency_hz", m->std_frequency_hz);
    json_set_number(std, "damping_ratio", m->std_damping_ratio);
    cJSON_AddItemToObject(std, "exponent", json_complex(m->std_re, m->std_im));
    json_set_number(std, "multiplier", m->std_multiplier);
    return std;
}

static cJSON *print_complex_list(const double complex *z, int count)
{
    cJSON *list = cJSON_CreateArray();

    for (int i = 0; i < count; i++)
        cJSON_AddItemToArray(list, json_complex(creal(z[i]), cimag(z[i])));
    return list;
}

static void print_harmonics(cJSON *o, const struct identify_mode *m)
{
    cJSON *list = cJSON_AddArrayToObject(o, "harmonics");

    for (int i = 0; i < m->harmonic_count; i++) {
        cJSON *h = cJSON_CreateObject();
        cJSON_AddNumberToObject(h, "k", m->harmonics[i].k);
        json_set_number(h, "magnitude", m->harmonics[i].magnitude);
        cJSON_AddItemToArray(list, h);
    }
    cJSON_AddNumberToObject(o, "resolved_k", m->resolved_k);
    json_set_number(o, "runner_up", m->runner_up);
}

/* Twice the record, excited as this one is, has half the variance. */
static void print_cycles(cJSON *o, const struct identify_mode *m)
{
    cJSON *bound = cJSON_CreateObject();

    json_set_number(o, "cycles", m->cycles);
    json_set_number(bound, "frequency_hz", m->std_frequency_hz * M_SQRT1_2);
    json_set_number(bound, "damping_ratio", m->std_damping_ratio * M_SQRT1_2);
    cJSON_AddItemToObject(o, "bound_at_2x", bound);
}

static cJSON *print_mode(const struct identify_result *r, const struct identify_mode *m)
{
    cJSON *o = cJSON_CreateObject();
    double omega = frequency_of(m->resolved);

    json_set_number(o, "frequency_hz", omega / (2 * M_PI));
    json_set_number(o, "frequency_rad_s", omega);
    json_set_number(o, "damped_frequency_rad_s", fabs(cimag(m->resolved)));
    json_set_number(o, "damping_ratio", damping_ratio_of(m->resolved));
    cJSON_AddItemToObject(o, "exponent", json_complex(creal(m->exponent), cimag(m->exponent)));
    cJSON_AddItemToObject(o, "resolved_exponent",
                          json_complex(creal(m->resolved), cimag(m->resolved)));
    cJSON_AddItemToObject(o, "multiplier",
                          json_complex(creal(m->multiplier), cimag(m->multiplier)));
    json_set_number(o, "amplitude", m->amplitude);
    json_set_number(o, "energy", m->energy);
    json_set_number(o, "persistence", m->persistence);
    json_set_number(o, "residual", m->residual);
    cJSON_AddItemToObject(o, "std", print_std(m));
    json_set_number(o, "bar", m->bar);
    if (m->shape != NULL) {
        cJSON_AddItemToObject(o, "shape", print_complex_list(m->shape, r->channel_count));
        json_set_number(o, "mpc", m->mpc);
    }
    if (m->participation != NULL)
        cJSON_AddItemToObject(o, "participation",
                              print_complex_list(m->participation, r->input_count));
    if (r->period > 0)
        print_harmonics(o, m);
    if (m->cycles > 0)
        print_cycles(o, m);
    return o;
}

static cJSON *print_stability(const struct identify_result *r)
{
    cJSON *o = cJSON_CreateObject();

    if (r->verdict == VERDICT_UNDECIDED)
        cJSON_AddNullToObject(o, "stable");
    else
        cJSON_AddBoolToObject(o, "stable", r->verdict == VERDICT_STABLE);
    json_set_number(o, "max_multiplier", r->max_multiplier);
    json_set_number(o, "margin", r->margin);
    json_set_number(o, "margin_std", r->margin_std);
    if (r->decides >= 0)
        cJSON_AddNumberToObject(o, "decides", r->decides);
    else
        cJSON_AddNullToObject(o, "decides");
    return o;
}

static cJSON *print_rank(const struct identify_result *r)
{
    cJSON *o = cJSON_CreateObject();

    cJSON_AddNumberToObject(o, "pod", r->pod_rank);
    cJSON_AddNumberToObject(o, "hankel", r->hankel_rank);
    cJSON_AddStringToObject(o, "rule", rank_rule_names[r->rule]);
    json_set_number(o, "energy", r->energy);
    cJSON_AddItemToObject(o, "singular_values", json_numbers(r->singular, r->singular_count));
    cJSON_AddNumberToObject(o, "freedom", r->freedom);
    return o;
}

static void name_channel(cJSON *o, const char *key, const struct batch *b, int c)
{
    char own[24];

    snprintf(own, sizeof own, "ch%d", c);
    cJSON_AddStringToObject(o, key, b->names != NULL && b->names[c] != NULL ? b->names[c] : own);
}

static cJSON *print_reconstruction(const struct identify_result *r, const struct batch *b)
{
    cJSON *o = cJSON_CreateObject(), *list = cJSON_AddArrayToObject(o, "signals");

    for (int i = 0; i < r->channel_count; i++) {
        cJSON *s = cJSON_CreateObject();
        name_channel(s, "name", b, r->channel[i]);
        json_set_number(s, "rms_error", r->rms_error[i]);
        json_set_number(s, "relative_error", r->relative_error[i]);
        cJSON_AddItemToArray(list, s);
    }
    json_set_number(o, "relative_error", r->total_relative_error);
    return o;
}

/* A curve for each input and response. */
static cJSON *print_frf(const struct identify_result *r, const struct batch *b)
{
    const struct identify_frf *f = &r->frf;
    cJSON *o = cJSON_CreateObject(), *list;

    cJSON_AddItemToObject(o, "frequency_hz", json_numbers(f->hertz, f->count));
    list = cJSON_AddArrayToObject(o, "curves");
    for (int j = 0; j < f->inputs; j++)
        for (int i = 0; i < f->responses; i++) {
            size_t at = (size_t)f->count * (i + (size_t)f->responses * j);
            cJSON *curve = cJSON_CreateObject();
            name_channel(curve, "input", b, f->input[j]);
            name_channel(curve, "name", b, r->channel[i]);
            cJSON_AddItemToObject(curve, "value", print_complex_list(f->value + at, f->count));
            cJSON_AddItemToObject(curve, "std", json_numbers(f->std + at, f->count));
            cJSON_AddItemToArray(list, curve);
        }
    return o;
}

static cJSON *print_order(const struct identify_result *r)
{
    cJSON *o = cJSON_CreateObject(), *list;

    cJSON_AddStringToObject(o, "rule", r->rule == RANK_AUTO ? "bic" : rank_rule_names[r->rule]);
    list = cJSON_AddArrayToObject(o, "candidates");
    for (int i = 0; i < r->candidate_count; i++) {
        const struct identify_candidate *c = &r->candidates[i];
        cJSON *k = cJSON_CreateObject();
        cJSON_AddNumberToObject(k, "order", c->order);
        json_set_number(k, "bic", c->bic);
        json_set_number(k, "residual", c->residual);
        cJSON_AddBoolToObject(k, "refined", c->refined);
        cJSON_AddBoolToObject(k, "converged", c->converged);
        cJSON_AddBoolToObject(k, "chosen", c->chosen);
        cJSON_AddItemToArray(list, k);
    }
    return o;
}

/* Poles against order: what a stabilisation diagram draws. */
static cJSON *print_stabilisation(const struct identify_result *r)
{
    cJSON *list = cJSON_CreateArray();

    for (int i = 0; i < r->pole_count; i++) {
        const struct identify_pole *p = &r->poles[i];
        cJSON *o = cJSON_CreateObject();
        cJSON_AddNumberToObject(o, "order", p->order);
        cJSON_AddItemToObject(o, "exponent", json_complex(creal(p->exponent), cimag(p->exponent)));
        json_set_number(o, "frequency_hz", frequency_of(p->exponent) / (2 * M_PI));
        json_set_number(o, "damping_ratio", damping_ratio_of(p->exponent));
        cJSON_AddItemToObject(o, "std", json_complex(p->std_re, p->std_im));
        if (p->mode >= 0)
            cJSON_AddNumberToObject(o, "mode", p->mode);
        else
            cJSON_AddNullToObject(o, "mode");
        cJSON_AddItemToArray(list, o);
    }
    return list;
}

static cJSON *print_clusters(const struct identify_result *r)
{
    cJSON *list = cJSON_CreateArray();

    for (int i = 0; i < r->cluster_count; i++) {
        const struct identify_cluster *c = &r->clusters[i];
        cJSON *o = cJSON_CreateObject();
        cJSON_AddItemToObject(o, "centroid", json_complex(creal(c->centroid), cimag(c->centroid)));
        json_set_number(o, "radius", c->radius);
        cJSON_AddItemToObject(o, "members", cJSON_CreateIntArray(c->members, c->member_count));
        cJSON_AddBoolToObject(o, "near_defective", c->near_defective);
        cJSON_AddItemToArray(list, o);
    }
    return list;
}

/* The strongest vibration, part by part, where it is not the same throughout. */
static cJSON *print_trend(const struct identify_result *r)
{
    cJSON *list = cJSON_CreateArray();

    for (int i = 0; i < r->trend_count; i++) {
        const struct identify_window *w = &r->trend[i];
        cJSON *o = cJSON_CreateObject(), *std = cJSON_CreateObject();
        json_set_number(o, "t", w->t);
        json_set_number(o, "frequency_hz", w->frequency_hz);
        json_set_number(o, "damping_ratio", w->damping_ratio);
        json_set_number(o, "amplitude", w->amplitude);
        json_set_number(std, "frequency_hz", w->std_frequency_hz);
        json_set_number(std, "damping_ratio", w->std_damping_ratio);
        cJSON_AddItemToObject(o, "std", std);
        cJSON_AddItemToArray(list, o);
    }
    return list;
}

static cJSON *print_diagnostics(const struct identify_result *r)
{
    cJSON *list = cJSON_CreateArray();

    for (int i = 0; i < r->diagnostic_count; i++) {
        const struct identify_diagnostic *d = &r->diagnostics[i];
        cJSON *o = cJSON_CreateObject();
        cJSON_AddStringToObject(o, "code", d->code);
        cJSON_AddStringToObject(o, "message", d->message);
        if (d->channel >= 0)
            cJSON_AddNumberToObject(o, "channel", d->channel);
        cJSON_AddItemToArray(list, o);
    }
    return list;
}

/* ---- cost and provenance ---- */

/* Its stages are the identification's own. */
static cJSON *print_cost(const struct identify_result *r, struct cost *cost)
{
    _Static_assert((int)IDENTIFY_STAGES <= (int)COST_STAGES_MOST, "room for all");
    cost->stages = r->stage_count;
    for (int i = 0; i < r->stage_count; i++) {
        cost->stage[i].name = r->stages[i].name;
        cost->stage[i].seconds = r->stages[i].seconds;
    }
    return cost_print(cost);
}

static cJSON *print_provenance(const struct job_request *q, const struct identify_result *r,
                               int threads)
{
    cJSON *o = cJSON_CreateObject(), *input = cJSON_CreateObject();
    char host[256] = "";

    cJSON_AddStringToObject(o, "version", MODALD_VERSION);
    cJSON_AddItemToObject(o, "options", identify_options_write(&r->used, q->options, threads));
    if (q->input_sha256 != NULL)
        cJSON_AddStringToObject(o, "input_sha256", q->input_sha256);
    else
        cJSON_AddNullToObject(o, "input_sha256");
    cJSON_AddNumberToObject(input, "samples", (double)q->batch->samples);
    cJSON_AddNumberToObject(input, "channels", (double)q->batch->channels);
    cJSON_AddNumberToObject(input, "dt", q->batch->dt);
    cJSON_AddNumberToObject(input, "period", q->batch->period);
    if (q->batch->units != NULL && q->batch->units[0] != 0)
        cJSON_AddStringToObject(input, "units", q->batch->units);
    if (q->attributes != NULL)
        cJSON_AddItemToObject(input, "attributes", cJSON_Duplicate(q->attributes, true));
    cJSON_AddItemToObject(o, "input", input);
    cJSON_AddNumberToObject(o, "samples_used", r->samples);
    cJSON_AddNumberToObject(o, "dt_used", r->dt);
    cJSON_AddNumberToObject(o, "decimation", r->decimation);
    gethostname(host, sizeof host - 1);
    cJSON_AddStringToObject(o, "host", host);
    cJSON_AddNumberToObject(o, "threads", threads);
    cJSON_AddStringToObject(o, "blas_core", blas_core_name());
    return o;
}

/* What every answer begins with. */
static cJSON *print_modes(const struct identify_result *r)
{
    cJSON *o = cJSON_CreateObject(), *modes;

    cJSON_AddStringToObject(o, "kind", "identify");
    cJSON_AddStringToObject(o, "response", identify_response_names[r->used.response]);
    modes = cJSON_AddArrayToObject(o, "modes");
    for (int i = 0; i < r->mode_count; i++)
        cJSON_AddItemToArray(modes, print_mode(r, &r->modes[i]));
    cJSON_AddItemToObject(o, "stability", print_stability(r));
    return o;
}

static cJSON *print_result(const struct job_request *q, const struct identify_result *r,
                           struct cost *cost, int threads)
{
    cJSON *o = print_modes(r);

    cJSON_AddItemToObject(o, "rank", print_rank(r));
    cJSON_AddItemToObject(o, "reconstruction", print_reconstruction(r, q->batch));
    if (r->frf.count > 0)
        cJSON_AddItemToObject(o, "frf", print_frf(r, q->batch));
    cJSON_AddItemToObject(o, "offset",
                          json_numbers(r->offset, r->offset != NULL ? r->channel_count : 0));
    cJSON_AddItemToObject(o, "order", print_order(r));
    cJSON_AddItemToObject(o, "stabilisation", print_stabilisation(r));
    cJSON_AddItemToObject(o, "clusters", print_clusters(r));
    cJSON_AddItemToObject(o, "trend", print_trend(r));
    cJSON_AddItemToObject(o, "proposed_window",
                          r->proposed[1] > 0 ? json_numbers(r->proposed, 2) : cJSON_CreateNull());
    cJSON_AddItemToObject(o, "diagnostics", print_diagnostics(r));
    cJSON_AddItemToObject(o, "cost", print_cost(r, cost));
    cJSON_AddItemToObject(o, "provenance", print_provenance(q, r, threads));
    return o;
}

cJSON *identify_modes_write(const struct identify_result *r)
{
    cJSON *o = print_modes(r);

    cJSON_AddItemToObject(o, "diagnostics", print_diagnostics(r));
    return o;
}

/* ---- the rungs below and above ---- */

/* The rungs of an ordinary job, of which at least one is run. */
struct own_ladder {
    const struct job_request *request;
    cJSON *settings[IDENTIFY_RUNGS_MOST];
    struct identify_result answer[IDENTIFY_RUNGS_MOST];
    struct ladder_rung rungs[IDENTIFY_RUNGS_MOST];
    int count, chosen;
    const char *stop;             /* why it stopped; NULL: no target was set */
};

static enum modal_status climb(void *context, int i, double *error, struct modal_error *err)
{
    struct own_ladder *l = context;
    enum modal_status rc = identify_ladder_answer(l->request, l->settings[i], &l->answer[i], err);

    if (rc == MODAL_BAD_INPUT && i + 1 < l->count)
        return MODAL_NO_CONVERGENCE;              /* too short a part of the record for this rung */
    if (rc == MODAL_OK)
        *error = identify_error(&l->answer[i]);
    return rc;
}

static double cpu_seconds(void *context)
{
    (void)context;
    return cost_cpu_s();
}

static bool climb_stopped(void *context)
{
    return job_cancelled(((struct own_ladder *)context)->request);
}

/* By what was asked alone, as the last rung, or the named procedure's. */
static enum modal_status answer_once(struct own_ladder *l, const struct identify_settings *settings,
                                     struct modal_error *err)
{
    double start = cpu_seconds(NULL);
    enum modal_status rc;

    l->chosen = settings->opt.method == IDENTIFY_AUTO ? l->count - 1 : 0;
    cJSON_Delete(l->settings[l->chosen]);
    l->settings[l->chosen] = l->request->options != NULL
                                 ? cJSON_Duplicate(l->request->options, true)
                                 : cJSON_CreateObject();
    rc = identify_answer(l->request, settings, &l->answer[l->chosen], err);
    if (rc == MODAL_OK)
        l->rungs[l->chosen] = (struct ladder_rung){ .ran = true,
                                                    .error = identify_error(&l->answer[l->chosen]),
                                                    .seconds = cpu_seconds(NULL) - start };
    return rc;
}

/* Climb until a target is met; without one, or with a procedure named, what was asked for is the
 * one rung that runs. */
static enum modal_status answer(struct own_ladder *l, const struct identify_settings *settings,
                                struct modal_error *err)
{
    static const char *const stops[] = { [LADDER_RUN_OUT] = "exhausted",
                                         [LADDER_AT_ERROR] = "target.error",
                                         [LADDER_AT_SECONDS] = "target.seconds" };
    const struct identify_options *opt = &settings->opt;
    const struct batch *b = l->request->batch;
    struct identify_ladder_facts facts = { RESPONSE_FREE,
                                           b->samples,
                                           b->channels,
                                           b->dt,
                                           opt->period > 0   ? opt->period
                                           : opt->period < 0 ? 0
                                                             : b->period,
                                           0,
                                           0,
                                           { 0, (double)(b->samples - 1) * b->dt } };
    struct ladder ladder = { .target_error = opt->target_error,
                             .target_seconds = opt->target_seconds, .climb = climb,
                             .clock = cpu_seconds, .cancelled = climb_stopped, .context = l };
    struct ladder_outcome outcome;
    enum modal_status rc;

    l->count = ladder.rungs = identify_ladder_rungs(l->request->options, &facts, true, l->settings);
    if (opt->response != RESPONSE_FREE)           /* nothing cheaper is known */
        while (l->count > 1)
            cJSON_Delete(l->settings[--l->count]), l->settings[l->count] = NULL;
    if (opt->method != IDENTIFY_AUTO) {           /* a named procedure, and the default above it */
        for (int i = 0; i + 1 < l->count; i++)
            cJSON_Delete(l->settings[i]);
        l->settings[1] = l->settings[l->count - 1];
        l->settings[0] = NULL;
        l->count = 2;
    }
    for (int i = 0; i < l->count; i++)
        l->rungs[i] = (struct ladder_rung) { .error = NAN, .seconds = NAN };
    if ((opt->target_error > 0 || opt->target_seconds > 0) && opt->method == IDENTIFY_AUTO
        && opt->response == RESPONSE_FREE) {
        rc = ladder_run(&ladder, l->rungs, &outcome, err);
        if (rc == MODAL_OK
            && (outcome.chosen < 0
                || (outcome.stop == LADDER_RUN_OUT && isfinite(l->rungs[outcome.ran - 1].error))))
            /* all the data, where nothing says less is enough: estimates differ by chance */
            outcome.chosen = outcome.ran - 1;
        if (rc == MODAL_OK)
            l->chosen = outcome.chosen, l->stop = stops[outcome.stop];
        return rc;
    }
    return answer_once(l, settings, err);
}

static cJSON *print_ladder(struct own_ladder *l)
{
    cJSON *o = cJSON_CreateObject(), *list = cJSON_AddArrayToObject(o, "rungs");

    for (int i = 0; i < l->count; i++) {
        cJSON *rung = cJSON_CreateObject();
        cJSON_AddItemToObject(rung, "settings", l->settings[i]);
        l->settings[i] = NULL;
        json_set_number(rung, "error", l->rungs[i].error);
        json_set_number(rung, "seconds", l->rungs[i].seconds);
        cJSON_AddBoolToObject(rung, "ran", l->rungs[i].ran);
        cJSON_AddItemToArray(list, rung);
    }
    cJSON_AddNumberToObject(o, "chosen", l->chosen);
    if (l->stop != NULL)
        cJSON_AddStringToObject(o, "stop", l->stop);
    else
        cJSON_AddNullToObject(o, "stop");
    return o;
}

enum modal_status identify_by(const struct identify_settings *settings,
                              const struct job_request *request, struct job_result *out,
                              struct modal_error *err)
{
    struct own_ladder *ladder = calloc(1, sizeof *ladder);
    struct cost cost;
    enum modal_status rc;

    cost_start(&cost);
    if (ladder == NULL)
        return modal_fail(err, MODAL_NO_MEMORY, "identify: no memory for the ladder");
    ladder->request = request;
    rc = answer(ladder, settings, err);
    if (rc == MODAL_OK) {
        struct identify_result *r = &ladder->answer[ladder->chosen];
        r->used.target_error = settings->opt.target_error,
        r->used.target_seconds = settings->opt.target_seconds;
        out->result = print_result(request, r, &cost, settings->threads);
        cJSON_AddItemToObject(out->result, "ladder", print_ladder(ladder));
    }
    for (int i = 0; i < ladder->count; i++) {
        identify_result_done(&ladder->answer[i]);
        cJSON_Delete(ladder->settings[i]);
    }
    free(ladder);
    return rc;
}

enum modal_status identify_run(const struct job_request *request, struct job_result *out,
                               struct modal_error *err)
{
    struct identify_settings settings;
    enum modal_status rc = identify_options_read(request->options, request->batch, &settings, err);

    if (rc != MODAL_OK)
        return rc;
    rc = identify_by(&settings, request, out, err);
    identify_settings_done(&settings);
    return rc;
}
